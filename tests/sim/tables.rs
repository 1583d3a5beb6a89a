//! Fraction of trials in which the true model has the largest weight.

use mmae::engine::Weighting;
use mmae::observer;
use mmae::observer::ObserverKind;
use mmae::par::RunControl;
use mmae::weight::Law;

use crate::setup::{case, plants};

/// `S_i = s_i I` of the steady filters.
const S: [[f64; 4]; 4] = [
    [10.45604921, 10.64354150, 11.22626852, 11.42735740],
    [10.63396595, 10.06243216, 11.22626852, 11.83971895],
    [11.22626852, 8.04412388, 8.71754376, 9.36758630],
    [11.22626852, 12.24911136, 12.74913812, 13.24246619],
];

#[test]
fn steady_innovations_of_the_cases() {
    for number in 1..=4 {
        let (plants, _) = plants(number);
        for (o, s) in observer::design(ObserverKind::Kalman, &plants).iter().zip(S[number - 1]) {
            let o = o.as_ref().unwrap();
            for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let want = if i == j { s } else { 0.0 };
                assert!((o.S[(i, j)] - want).abs() < 6e-9, "case {number}: {}", o.S[(i, j)]);
            }
        }
    }
}

/// At 20, 50, 100 and 200 steps; the numbers are from an independent simulation
/// of 4000 trials.
const TABLE: [(usize, Law, [f64; 4]); 12] = [
    (1, Law::Bayes, [0.905, 0.955, 0.992, 0.999]),
    (1, Law::Zhang { n_max: 1.0 }, [0.877, 0.903, 0.937, 0.973]),
    (1, Law::Zhang { n_max: f64::INFINITY }, [0.888, 0.933, 0.980, 0.999]),
    (2, Law::Bayes, [1.0; 4]),
    (2, Law::Zhang { n_max: 1.0 }, [1.0; 4]),
    (2, Law::Zhang { n_max: f64::INFINITY }, [1.0; 4]),
    (3, Law::Bayes, [0.644, 0.755, 0.838, 0.927]),
    (3, Law::Zhang { n_max: 1.0 }, [0.557, 0.600, 0.644, 0.701]),
    (3, Law::Zhang { n_max: f64::INFINITY }, [0.615, 0.676, 0.716, 0.767]),
    (4, Law::Bayes, [0.632, 0.652, 0.694, 0.770]),
    (4, Law::Zhang { n_max: 1.0 }, [0.521, 0.547, 0.560, 0.590]),
    (4, Law::Zhang { n_max: f64::INFINITY }, [0.564, 0.604, 0.644, 0.682]),
];

#[test]
fn fractions_identified() {
    for (number, law, want) in TABLE {
        let mut experiment = case(number);
        experiment.weighting = Weighting { law, ..Weighting::default() };
        let (_, truth) = plants(number);
        let summary = experiment.run(&RunControl::default()).unwrap();
        for (k, want) in [20, 50, 100, 200].into_iter().zip(want) {
            let at = summary.record.iter().find(|m| m.step == k).unwrap();
            let got = at.identified[truth];
            let near = if want == 1.0 { got > 0.997 } else { (got - want).abs() < 0.025 };
            assert!(near, "case {number} {law:?} k = {k}: {got} for {want}");
            assert!((at.identified.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            assert!((at.p.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        }
        // the filter of the true model is consistent
        let nis: f64 = summary.record.iter().map(|m| m.nis[truth]).sum::<f64>() / 20.0;
        assert!((nis - 2.0).abs() < 5.0 * (4.0 / 80_000_f64).sqrt(), "case {number}: {nis}");
    }
}
