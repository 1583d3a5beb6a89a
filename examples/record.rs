//! A record at once: the level of the Nile under nine pairs of variances.
//!
//!     cargo run --release --example record
#![expect(clippy::print_stdout, reason = "an example shows what it does")]

use mmae::bank::{GainMode, Initial, Members, Settings, StartTime};
use mmae::engine::{Mmae, Weighting};
use mmae::model::{Plant, Time};
use mmae::observer::ObserverKind;
use mmae::{Mat, mat};

fn main() -> mmae::Result<()> {
    // the flow of 1871 to 1970; two years are lost
    let text = include_str!("nile.csv");
    let flow = text.lines().skip(1).filter_map(|line| line.split(',').nth(1)?.parse().ok());
    let mut y: Vec<f64> = flow.collect();
    y[40..42].fill(f64::NAN);

    // level + noise; variances a quarter, once and four times the published ones
    let scales = [0.25, 1.0, 4.0];
    let pairs: Vec<[f64; 2]> =
        scales.iter().flat_map(|q| scales.iter().map(move |r| [*q, *r])).collect();
    let plant = |[q, r]: [f64; 2]| Plant {
        time: Time::Discrete { dt: 1.0 },
        A: mat![[1.0]],
        B: Mat::zeros(1, 0),
        G: mat![[1.0]],
        C: mat![[1.0]],
        Q: mat![[1469.1 * q]],
        R: mat![[15099.0 * r]],
    };
    let plants = pairs.iter().map(|&pair| plant(pair)).collect();
    let mut members = Members::new(ObserverKind::Kalman, plants);
    members.initial = vec![Initial { x_hat: vec![1120.0], P: Some(mat![[1e7]]) }];
    members.start = StartTime::FirstMeasurement;
    let settings = Settings { gains: GainMode::Recursive, ..Settings::default() };
    let mut mmae = Mmae::new(&members, &settings, &Weighting::default(), &[1.0; 9])?;

    let record = mmae.run(&[], &y)?;
    for year in [9, 39, 40, 41, 99] {
        println!("{}   level {:6.1}", 1871 + year, record.x_hat[year]);
    }
    let end = mmae.estimate();
    let best = end.best.map(|i| pairs[i]);
    println!("ln likelihood {:.3}, best scales {best:?}", record.log_lik.iter().sum::<f64>());
    assert_eq!(record.steps, 100);
    assert_eq!(best, Some([1.0, 1.0]), "the published variances explain the record best");
    // the sum of the likelihoods is that of the mixture: prior times evidence
    let evidence: f64 = end.log_lik_models.iter().map(|l| (l - end.log_lik_models[4]).exp()).sum();
    let total = end.log_lik_models[4] + (evidence / 9.0).ln();
    assert!((record.log_lik.iter().sum::<f64>() - total).abs() < 1e-9);
    Ok(())
}
