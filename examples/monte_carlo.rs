//! Many trials: how often is the right model found, and can the filters be
//! trusted?
//!
//!     cargo run --release --example monte_carlo
#![expect(clippy::print_stdout, reason = "an example shows what it does")]

use mmae::Mat;
use mmae::bank::{GainMode, Initial, Members, Settings};
use mmae::model::{Family, systems};
use mmae::observer::ObserverKind;
use mmae::par::RunControl;
use mmae::sim::{MonteCarlo, Truth};

fn main() -> mmae::Result<()> {
    // the two-axis tracker of Zhang et al. (2018), case 1; the third model is right
    let family = systems::tracker();
    let values = [0.96, 0.97, 1.0, 1.01];
    let mut plants = Vec::new();
    for rho in values {
        plants.push(family.plant(&family.theta_with(&[("rho", rho)])?)?);
    }
    let x0 = vec![-100.0, 2.0, 200.0, 20.0];
    let truth = Truth { x0: x0.clone(), ..Truth::new(plants[2].clone()) };
    let mut members = Members::new(ObserverKind::Kalman, plants);
    members.initial = vec![Initial { x_hat: x0, P: Some(Mat::zeros(4, 4)) }];
    let experiment = MonteCarlo {
        settings: Settings { gains: GainMode::Recursive, ..Settings::default() },
        every: 50,
        values: values.map(|rho| vec![rho]).to_vec(),
        ..MonteCarlo::new(members, truth, 200, 4000)
    };
    let summary = experiment.run(&RunControl::default())?;

    println!("step  identified  rho: 5 %  50 %  95 %     NEES of the right model");
    for at in &summary.record {
        let [low, _, middle, _, high] = at.theta_hat_quantiles[0];
        let rho = format!("{low:.4} {middle:.4} {high:.4}");
        println!("{:4}  {:10.4}  {rho}   {:.3}", at.step, at.identified[2], at.nees[2]);
    }
    let end = summary.last();
    let [low, high] = summary.nees_band;
    println!("95 % band of the mean NEES: {low:.3} to {high:.3}");
    assert!((end.identified[2] - 0.999).abs() < 0.01, "as published");
    assert!((end.nees[2] - 4.0).abs() < 0.25, "four states, an honest covariance");
    assert!(end.nees[0] > high, "the filter of a wrong model is not honest");
    assert!((end.theta_hat_quantiles[0][2] - 1.0).abs() < 1e-3);
    Ok(())
}
