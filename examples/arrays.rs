//! Arrays in, arrays out: many records at once, for tools that sweep.
//!
//!     cargo run --release --example arrays
#![expect(clippy::print_stdout, reason = "an example shows what it does")]

use mmae::bank::{Members, Settings};
use mmae::engine::{Arrays, Mmae, Weighting};
use mmae::model::{Plant, Time};
use mmae::observer::ObserverKind;
use mmae::par::RunControl;
use mmae::{Mat, mat};

fn main() -> mmae::Result<()> {
    // x(k+1) = a x(k) + w, y = x + v: how fast does it forget?
    let values: Vec<f64> = (0..16).map(|i| 0.05 + 0.06 * f64::from(i)).collect();
    let plant = |&a: &f64| Plant {
        time: Time::Discrete { dt: 1.0 },
        A: mat![[a]],
        B: Mat::zeros(1, 0),
        G: mat![[1.0]],
        C: mat![[1.0]],
        Q: mat![[1.0]],
        R: mat![[0.1]],
    };
    let members = Members::new(ObserverKind::Kalman, values.iter().map(plant).collect());
    let weighting = Weighting::default();
    let mut mmae = Mmae::new(&members, &Settings::default(), &weighting, &[1.0; 16])?;

    // measurements of shape (record, step, output): each record forgets at a rate
    // of its own, its disturbances come from a small generator
    let (records, steps) = (2000, 400);
    let mut state = 1_u32;
    let mut noise = || {
        state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        f64::from(state >> 8) / f64::from(1 << 23) - 1.0
    };
    let mut y = vec![0.0; records * steps];
    for (record, y) in y.chunks_mut(steps).enumerate() {
        let (a, mut x) = (0.1 + 0.8 * record as f64 / records as f64, 0.0);
        for y in y {
            x = a * x + 3.0_f64.sqrt() * noise();
            *y = x + 0.3_f64.sqrt() * noise();
        }
    }
    let arrays = Arrays { records, steps, y: &y, ..Arrays::default() };
    let out = mmae.run_arrays(&arrays, &RunControl::default())?;

    let mut error = 0.0;
    for (record, log_p) in out.log_p.chunks(16).enumerate() {
        let estimate: f64 = log_p.iter().zip(&values).map(|(l, a)| l.exp() * a).sum();
        error += (estimate - (0.1 + 0.8 * record as f64 / records as f64)).powi(2);
    }
    let rms = (error / records as f64).sqrt();
    println!("{records} records of {steps} samples: rms error of a {rms:.4}");
    assert!(rms < 0.06, "sqrt((1 - a^2) / 400) is 0.05 at most");
    // each record has the bits that it has alone
    let one = mmae.run(&[], &y[5 * steps..6 * steps])?;
    assert_eq!(out.log_p[5 * 16..6 * 16], one.log_p[(steps - 1) * 16..]);
    Ok(())
}
