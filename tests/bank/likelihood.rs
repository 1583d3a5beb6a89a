//! Log-likelihoods without weights: the bits of the whole engine.

use mmae::bank::{GainMode, Members, Settings};
use mmae::engine::{Arrays, Mmae, Weighting};
use mmae::model::{Plant, Time};
use mmae::observer::ObserverKind;
use mmae::par::RunControl;
use mmae::{Error, Mat};

/// Entries in [-1, 1).
fn uniform(state: &mut u64) -> f64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 11) as f64 * 2.0_f64.powi(-52) - 1.0
}

fn bank(n: usize, q: usize, models: usize, gains: GainMode) -> Mmae {
    let mut state = (100 * n + q) as u64;
    let plant = |_| Plant {
        time: Time::Discrete { dt: 1.0 },
        A: Mat::from_fn(n, n, |_, _| uniform(&mut state) / (1.2 * (n as f64).sqrt())),
        B: Mat::zeros(n, 0),
        G: Mat::identity(n, n),
        C: Mat::from_fn(q, n, |_, _| uniform(&mut state)),
        Q: Mat::identity(n, n),
        R: Mat::identity(q, q),
    };
    let members = Members::new(ObserverKind::Kalman, (0..models).map(plant).collect());
    let settings = Settings { gains, ..Settings::default() };
    Mmae::new(&members, &settings, &Weighting::default(), &vec![1.0; models]).unwrap()
}

#[test]
fn they_are_those_of_the_engine() {
    for n in 1..=8 {
        for q in 1..=3 {
            for (records, steps, gains) in [
                (1, 1, GainMode::Steady),
                (33, 65, GainMode::Steady),
                (70, 40, GainMode::Recursive),
            ] {
                let mmae = bank(n, q, 3, gains);
                let mut state = 7;
                let mut y: Vec<f64> =
                    (0..records * steps * q).map(|_| 3.0 * uniform(&mut state)).collect();
                if records > 1 {
                    // a sample that is missing, and one that overflows a square
                    y[5 * steps * q] = f64::NAN;
                    y[17 * steps * q + q] = 1e200;
                }
                let arrays = Arrays { records, steps, y: &y, ..Arrays::default() };
                let control = RunControl::default();
                let want = mmae.run_arrays(&arrays, &control).unwrap().log_lik_models;
                for threads in [1, 3] {
                    let got = mmae.log_likelihoods(&arrays, &control.threads(threads)).unwrap();
                    let bits = |v: &[f64]| v.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
                    assert_eq!(bits(&got), bits(&want), "n = {n}, q = {q}, {records} records");
                }
            }
        }
    }
}

/// Both routes above take several records and steps at a time; this one neither.
#[test]
fn they_are_those_of_steps() {
    for n in 1..=9 {
        for q in 1..=4 {
            for gains in [GainMode::Steady, GainMode::Recursive] {
                let (records, steps) = (9, 37);
                let mut mmae = bank(n, q, 3, gains);
                let mut state = 11;
                let y: Vec<f64> =
                    (0..records * steps * q).map(|_| 3.0 * uniform(&mut state)).collect();
                let arrays = Arrays { records, steps, y: &y, ..Arrays::default() };
                let got = mmae.log_likelihoods(&arrays, &RunControl::default()).unwrap();
                for (record, got) in y.chunks(steps * q).zip(got.chunks(3)) {
                    mmae.reset();
                    for y in record.chunks(q) {
                        mmae.step(&[], y).unwrap();
                    }
                    let want = &mmae.estimate().log_lik_models;
                    assert_eq!(got, &want[..], "n = {n}, q = {q}, {gains:?}");
                }
            }
        }
    }
}

#[test]
fn wrong_sizes_are_refused() {
    let mmae = bank(2, 1, 2, GainMode::Steady);
    let arrays = Arrays { records: 2, steps: 3, y: &[0.0; 5], ..Arrays::default() };
    assert!(mmae.log_likelihoods(&arrays, &RunControl::default()).is_err());
    let none = Arrays { records: 0, steps: 3, y: &[], ..Arrays::default() };
    assert!(mmae.log_likelihoods(&none, &RunControl::default()).unwrap().is_empty());
}

#[test]
fn an_infinite_measurement_is_named() {
    let steps = 40;
    for (records, place) in [(1, 0), (80, 70)] {
        let mut y = vec![0.5; records * steps * 2];
        y[(place * steps + 11) * 2 + 1] = f64::NEG_INFINITY;
        // before it, what is no error
        y[0] = f64::NAN;
        let arrays = Arrays { records, steps, y: &y, ..Arrays::default() };
        let mmae = bank(2, 2, 3, GainMode::Steady);
        let error = mmae.log_likelihoods(&arrays, &RunControl::default()).unwrap_err();
        let what = format!("y of record {place}");
        assert_eq!(error, mmae.run_arrays(&arrays, &RunControl::default()).unwrap_err());
        assert!(matches!(error, Error::NonFinite { what: w, row: 11, col: 1 } if w == what));
    }
}
