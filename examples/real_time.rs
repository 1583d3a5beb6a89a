//! A bank in real time: one measurement in, one estimate out, nothing allocated.
//!
//!     cargo run --release --example real_time
#![expect(clippy::print_stdout, reason = "an example shows what it does")]

use mmae::bank::{Members, Settings};
use mmae::engine::{Mmae, Weighting};
use mmae::mat;
use mmae::model::{Plant, Time};
use mmae::observer::ObserverKind;

fn main() -> mmae::Result<()> {
    // a mass on a spring that is soft, normal or stiff, sampled at 50 Hz
    let dt = 0.02;
    let stiffness = [2.0, 4.0, 8.0];
    let plant = |k: f64| Plant {
        time: Time::Discrete { dt },
        A: mat![[1.0, dt], [-k * dt, 1.0 - 0.2 * dt]],
        B: mat![[0.0], [dt]],
        G: mat![[0.0], [dt]],
        C: mat![[1.0, 0.0]],
        Q: mat![[1.0]],
        R: mat![[1e-4]],
    };
    let members = Members::new(ObserverKind::Kalman, stiffness.map(plant).to_vec());
    let weighting = Weighting::default();
    let mut mmae = Mmae::new(&members, &Settings::default(), &weighting, &[1.0; 3])?;

    // the loop of a controller; the sensor is a simulation of the stiff spring
    let mut state = 1_u32;
    let mut noise = || {
        state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        3.0_f64.sqrt() * (f64::from(state >> 8) / f64::from(1 << 23) - 1.0)
    };
    let mut x = [0.1, 0.0];
    for step in 1..=1500 {
        let u = (0.5 * dt * f64::from(step)).sin().signum();
        let force = u - 8.0 * x[0] - 0.2 * x[1] + noise();
        x = [x[0] + dt * x[1], x[1] + dt * force];
        let y = x[0] + 0.01 * noise();
        // predict, innovate, weigh, fuse
        let estimate = mmae.step(&[u], &[y])?;
        if step % 10 == 0 && step <= 60 {
            println!(
                "{:.1} s   p = {:.4?}   k = {:.3}",
                dt * f64::from(step),
                estimate.p,
                estimate.mean(&stiffness)
            );
        }
    }
    let end = mmae.estimate();
    assert!((end.mean(&stiffness) - 8.0).abs() < 0.1, "the stiffness is found");
    let e = [end.x_hat[0] - x[0], end.x_hat[1] - x[1]];
    let p = mmae.covariance();
    let near = |i: usize| e[i].abs() < 5.0 * p[(i, i)].sqrt();
    assert!(near(0) && near(1), "and the state, as well as P says");
    Ok(())
}
