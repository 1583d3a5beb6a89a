//! Records and arrays of records against one step after the other.

use mmae::bank::{GainMode, Initial, Members, Settings};
use mmae::engine::{Arrays, Courses, Innovation, Mixing, Mmae, Weighting};
use mmae::model::{Plant, Time};
use mmae::observer::ObserverKind;
use mmae::par::RunControl;
use mmae::weight::{DwsgScheme, Law, Modifiers, Transition, Window};
use mmae::{Error, Mat, mat};

const STEPS: usize = 24;
const RECORDS: usize = 43;

fn model(a: f64) -> Plant {
    Plant {
        time: Time::Discrete { dt: 0.1 },
        A: mat![[a, 0.3], [-0.2, 0.8]],
        B: mat![[0.0], [1.0]],
        G: Mat::identity(2, 2),
        C: mat![[1.0, 0.5], [0.0, 1.0]],
        Q: mat![[0.3, 0.1], [0.1, 0.2]],
        R: mat![[0.5, 0.1], [0.1, 0.4]],
    }
}

fn members(values: &[f64]) -> Members {
    let plants = values.iter().map(|a| model(*a)).collect();
    let mut members = Members::new(ObserverKind::Kalman, plants);
    members.initial = vec![Initial { x_hat: vec![0.5, -0.5], P: Some(Mat::identity(2, 2)) }];
    members
}

fn weightings() -> Vec<Weighting> {
    let plain = Weighting::default;
    let law = |law| Weighting { law, ..plain() };
    let w = mat![[0.5, 0.1], [0.1, 0.25]];
    let sticky = || Transition::sticky(3, 0.95).unwrap();
    vec![
        plain(),
        Weighting { innovation: Innovation::Steady, ..plain() },
        Weighting { innovation: Innovation::Common(w), ..law(Law::Zhang { n_max: 9.0 }) },
        law(Law::Zhang { n_max: 1.0 }),
        law(Law::Dwsg { lambda: 0.4, tempering: 0.5, scheme: DwsgScheme::Trapezoid }),
        Weighting {
            modifiers: Modifiers {
                floor: 1e-3,
                forgetting: 0.97,
                clip: 6.0,
                window: Window::Sliding(5),
            },
            ..plain()
        },
        Weighting { mixing: Mixing::Markov(sticky()), ..plain() },
        Weighting { mixing: Mixing::Imm(sticky()), ..plain() },
        Weighting { mixing: Mixing::Reseed { threshold: 0.2 }, ..plain() },
    ]
}

fn signals() -> (Vec<f64>, Vec<f64>) {
    let wave = |k: usize, f: f64| 1.5 * (f * k as f64).sin();
    let mut y: Vec<f64> = (0..RECORDS * STEPS * 2).map(|k| wave(k, 0.77)).collect();
    // samples that are missing: one output, all outputs, a whole record
    y[(3 * STEPS + 5) * 2] = f64::NAN;
    y[(12 * STEPS + 9) * 2..][..4].fill(f64::NAN);
    y[20 * STEPS * 2..][..2 * STEPS].fill(f64::NAN);
    (y, (0..RECORDS * STEPS).map(|k| wave(k, 0.31)).collect())
}

fn bits(list: &[f64]) -> Vec<u64> {
    // of numbers that are none, signs and payloads are free
    list.iter().map(|v| if v.is_nan() { u64::MAX } else { v.to_bits() }).collect()
}

/// Every record by `step`.
fn one_by_one(engine: &Mmae, arrays: &Arrays<'_>) -> Courses {
    let steps: Vec<usize> = match arrays.every {
        0 => vec![arrays.steps],
        e => (1..=arrays.steps).filter(|k| k % e == 0 || *k == arrays.steps).collect(),
    };
    let mut want = Courses {
        steps,
        log_p: Vec::new(),
        x_hat: Vec::new(),
        log_lik: Vec::new(),
        log_lik_models: Vec::new(),
        failed: Vec::new(),
    };
    let mut engine = engine.clone();
    for record in 0..arrays.records {
        engine.reset();
        let mut log_lik = 0.0;
        for k in 0..arrays.steps {
            let row = record * arrays.steps + k;
            let input = if arrays.u.len() == arrays.steps { k } else { row };
            let u = if arrays.u.is_empty() { &[0.0][..] } else { &arrays.u[input..=input] };
            let e = engine.step(u, &arrays.y[2 * row..][..2]).unwrap();
            log_lik += e.log_lik;
            if want.steps.contains(&(k + 1)) {
                want.log_p.extend(&e.log_p);
                want.x_hat.extend(&e.x_hat);
            }
        }
        want.log_lik.push(log_lik);
        want.log_lik_models.extend(&engine.estimate().log_lik_models);
        want.failed.extend(&engine.estimate().failed);
    }
    want
}

#[track_caller]
fn assert_same(got: &Courses, want: &Courses) {
    assert_eq!(got.steps, want.steps);
    assert_eq!(got.failed, want.failed);
    assert_eq!(bits(&got.log_p), bits(&want.log_p));
    assert_eq!(bits(&got.x_hat), bits(&want.x_hat));
    assert_eq!(bits(&got.log_lik), bits(&want.log_lik));
    assert_eq!(bits(&got.log_lik_models), bits(&want.log_lik_models));
}

#[test]
fn arrays_have_the_bits_of_steps() {
    let (y, u) = signals();
    for weighting in weightings() {
        for gains in [GainMode::Steady, GainMode::Recursive] {
            let settings = Settings { gains, ..Settings::default() };
            let members = members(&[0.4, 0.6, 0.9]);
            let engine = Mmae::new(&members, &settings, &weighting, &[1.0, 0.0, 2.0]).unwrap();
            let arrays = Arrays { records: RECORDS, steps: STEPS, y: &y, u: &u, every: 7 };
            for arrays in [
                arrays,
                Arrays { u: &u[..STEPS], every: 1, ..arrays },
                Arrays { u: &[], every: 0, ..arrays },
            ] {
                let want = one_by_one(&engine, &arrays);
                for threads in [1, 3] {
                    let control = RunControl::default().threads(threads);
                    assert_same(&engine.run_arrays(&arrays, &control).unwrap(), &want);
                }
            }
        }
    }
}

/// A model that cannot be designed, and one that runs away in some records.
#[test]
fn members_that_fail_leave_the_others_alone() {
    let (mut y, _) = signals();
    for v in &mut y[7 * STEPS * 2..][..2 * STEPS] {
        *v *= 1e307;
    }
    let mut plants = members(&[0.4, 0.6, 0.9]).plants;
    plants[1].R = mat![[-1.0, 0.0], [0.0, 1.0]];
    let mut members = members(&[0.4, 0.6, 0.9]);
    members.plants = plants;
    let engine =
        Mmae::new(&members, &Settings::default(), &Weighting::default(), &[1.0; 3]).unwrap();
    assert!(engine.bank().failures()[1].is_some());
    let arrays = Arrays { records: RECORDS, steps: STEPS, y: &y, u: &[], every: 1 };
    let got = engine.run_arrays(&arrays, &RunControl::default()).unwrap();
    // without the wild record all the others are the same
    let calm: Vec<f64> = [&y[..7 * STEPS * 2], &y[8 * STEPS * 2..]].concat();
    let arrays = Arrays { records: RECORDS - 1, y: &calm, ..arrays };
    let want = one_by_one(&engine, &arrays);
    let (rows, states) = (STEPS * 3, STEPS * 2);
    let log_p = [&got.log_p[..7 * rows], &got.log_p[8 * rows..]].concat();
    let x_hat = [&got.x_hat[..7 * states], &got.x_hat[8 * states..]].concat();
    assert_eq!(bits(&log_p), bits(&want.log_p));
    assert_eq!(bits(&x_hat), bits(&want.x_hat));
    assert!(got.failed.chunks(3).all(|f| f[1]));
    assert!(log_p.iter().all(|l| !l.is_nan()));
}

#[test]
fn wrong_arrays_are_refused() {
    let engine =
        Mmae::new(&members(&[0.4, 0.6]), &Settings::default(), &Weighting::default(), &[1.0, 1.0])
            .unwrap();
    let run = |arrays: Arrays<'_>| engine.run_arrays(&arrays, &RunControl::default());
    let y = [0.0; 12];
    let good = Arrays { records: 2, steps: 3, y: &y, ..Arrays::default() };
    assert!(run(good).is_ok());
    assert!(run(Arrays { records: 0, y: &[], ..good }).unwrap().log_p.is_empty());
    assert!(matches!(run(Arrays { y: &y[1..], ..good }), Err(Error::Shape { .. })));
    assert!(matches!(run(Arrays { u: &y[..4], ..good }), Err(Error::Shape { .. })));
    assert!(matches!(run(Arrays { steps: 0, ..good }), Err(Error::Range { .. })));
    let mut wild = y;
    wild[9] = f64::INFINITY;
    let error = run(Arrays { y: &wild, ..good }).unwrap_err();
    assert!(error.to_string().contains("y of record 1"), "{error}");
    let error = run(Arrays { u: &[0.0, f64::NAN, 0.0], ..good }).unwrap_err();
    assert!(matches!(error, Error::NonFinite { row: 1, .. }), "{error}");
}

#[test]
fn a_record_is_its_steps() {
    let (y, u) = signals();
    let (y, u) = (&y[3 * STEPS * 2..][..2 * STEPS], &u[..STEPS]);
    for weighting in weightings() {
        let members = members(&[0.4, 0.6, 0.9]);
        let new = || Mmae::new(&members, &Settings::default(), &weighting, &[1.0; 3]).unwrap();
        let (mut by_step, mut whole, mut parts) = (new(), new(), new());
        let record = whole.run(u, y).unwrap();
        let first = parts.run(&u[..9], &y[..18]).unwrap();
        let second = parts.run(&u[9..], &y[18..]).unwrap();
        assert_eq!(bits(&[first.log_p, second.log_p].concat()), bits(&record.log_p));
        assert_eq!(bits(&[first.nis, second.nis].concat()), bits(&record.nis));
        let values = [0.4, 0.6, 0.9];
        let theta = record.mean(&values);
        for k in 0..STEPS {
            let e = by_step.step(&u[k..=k], &y[2 * k..][..2]).unwrap();
            assert_eq!(bits(&e.p), bits(&record.p[3 * k..][..3]));
            assert_eq!(bits(&e.x_hat), bits(&record.x_hat[2 * k..][..2]));
            assert_eq!(bits(&e.r), bits(&record.r[6 * k..][..6]));
            assert_eq!(bits(&[e.log_lik, e.mean(&values)]), bits(&[record.log_lik[k], theta[k]]));
        }
        assert_eq!((record.steps, first.steps + second.steps), (STEPS, STEPS));
    }
    let engine = Mmae::new(&members(&[0.4]), &Settings::default(), &Weighting::default(), &[1.0]);
    let mut engine = engine.unwrap();
    assert!(matches!(engine.run(&[], &[1.0, 2.0, 3.0]), Err(Error::Shape { .. })));
    assert!(matches!(engine.run(&[1.0], &[0.0; 4]), Err(Error::Shape { .. })));
}
