//! What must hold of any bank.

use mmae::bank::{GainMode, Initial, Members, Settings, StartTime};
use mmae::engine::{Estimate, Innovation, Mixing, Mmae, Weighting};
use mmae::model::{Plant, Time};
use mmae::observer::ObserverKind;
use mmae::weight::{DwsgScheme, Law, Transition};
use mmae::{Mat, mat};

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

fn members(models: usize) -> Members {
    let plants = (0..models).map(|i| model(0.5 + 0.02 * i as f64)).collect();
    let mut members = Members::new(ObserverKind::Kalman, plants);
    members.initial =
        vec![Initial { x_hat: vec![0.5, -0.5], P: Some(mat![[2.0, 0.0], [0.0, 1.0]]) }];
    members
}

/// Equal by bits, NaN included: the shortest decimals that tell floats apart.
#[track_caller]
fn assert_same(a: &Estimate, b: &Estimate) {
    assert_eq!(format!("{a:?}"), format!("{b:?}"));
}

fn record(steps: usize) -> Vec<([f64; 1], [f64; 2])> {
    let wave = |k: usize, f: f64| (f * k as f64).sin() * 1.5;
    (0..steps).map(|k| ([wave(k, 0.3)], [wave(k, 0.7), wave(k, 1.1)])).collect()
}

fn engine(members: &Members, gains: GainMode, law: Law) -> Mmae {
    let settings = Settings { gains, ..Settings::default() };
    let weighting = Weighting { law, ..Weighting::default() };
    let prior = vec![1.0; members.plants.len()];
    Mmae::new(members, &settings, &weighting, &prior).unwrap()
}

const LAWS: [Law; 4] = [
    Law::Bayes,
    Law::Zhang { n_max: 1.0 },
    Law::Zhang { n_max: 50.0 },
    Law::Dwsg { lambda: 0.4, tempering: 0.5, scheme: DwsgScheme::Left },
];

#[test]
fn a_run_in_two_parts_has_the_bits_of_the_whole() {
    for law in LAWS {
        let mut whole = engine(&members(11), GainMode::Recursive, law);
        let record = record(60);
        for (u, y) in &record[..25] {
            whole.step(u, y).unwrap();
        }
        let mut second = whole.clone();
        for (u, y) in &record[25..] {
            whole.step(u, y).unwrap();
        }
        for (u, y) in &record[25..] {
            second.step(u, y).unwrap();
        }
        assert_same(whole.estimate(), second.estimate());
        // and a bank that was reset has them too
        second.reset();
        for (u, y) in &record {
            second.step(u, y).unwrap();
        }
        assert_same(whole.estimate(), second.estimate());
    }
}

#[test]
fn members_do_not_see_each_other() {
    let record = record(40);
    let mut all = engine(&members(19), GainMode::Recursive, Law::Bayes);
    for (u, y) in &record {
        all.step(u, y).unwrap();
    }
    for i in [0, 7, 8, 18] {
        let mut one = members(19);
        one.plants = vec![one.plants[i].clone()];
        let mut alone = engine(&one, GainMode::Recursive, Law::Bayes);
        for (u, y) in &record {
            alone.step(u, y).unwrap();
        }
        let (mut x, mut x_alone) = ([0.0; 2], [0.0; 2]);
        all.bank().x_hat_into(i, &mut x);
        alone.bank().x_hat_into(0, &mut x_alone);
        assert_eq!(x, x_alone, "model {i}");
        assert_eq!(all.estimate().log_lik_models[i], alone.estimate().log_lik_models[0]);
    }
}

#[test]
fn recursive_gains_tend_to_the_steady_ones() {
    let (mut a, mut b) = (
        engine(&members(5), GainMode::Recursive, Law::Bayes),
        engine(&members(5), GainMode::Steady, Law::Bayes),
    );
    for (u, y) in record(400) {
        a.step(&u, &y).unwrap();
        b.step(&u, &y).unwrap();
    }
    for i in 0..5 {
        let (mut x, mut y) = ([0.0; 2], [0.0; 2]);
        a.bank().x_hat_into(i, &mut x);
        b.bank().x_hat_into(i, &mut y);
        assert!((x[0] - y[0]).abs() < 1e-12 && (x[1] - y[1]).abs() < 1e-12, "{x:?} {y:?}");
    }
    let (r, s) = (a.estimate().nis.clone(), b.estimate().nis.clone());
    for (r, s) in r.iter().zip(&s) {
        assert!((r - s).abs() < 1e-11 * s.abs());
    }
}

#[test]
fn a_bad_model_is_flagged_and_the_rest_renormalise() {
    let mut bad = members(9);
    bad.plants[3].A[(0, 0)] = f64::NAN;
    let mut with = engine(&bad, GainMode::Recursive, Law::Bayes);
    assert!(with.bank().failures()[3].is_some());
    let mut without = bad.clone();
    without.plants.remove(3);
    let mut clean = engine(&without, GainMode::Recursive, Law::Bayes);
    for (u, y) in record(30) {
        with.step(&u, &y).unwrap();
        clean.step(&u, &y).unwrap();
    }
    let mut rest = with.estimate().p.clone();
    assert_eq!(rest.remove(3), 0.0);
    assert_eq!(with.estimate().failed.iter().filter(|f| **f).count(), 1);
    for (a, b) in rest.iter().zip(&clean.estimate().p) {
        assert!((a - b).abs() < 1e-13);
    }
}

#[test]
fn a_member_that_runs_away_is_flagged() {
    let mut members = members(3);
    // unstable in steady state is impossible; a recursion with Q = 0 follows
    members.plants[1].A = mat![[1e200, 0.0], [0.0, 1e200]];
    members.plants[1].Q = mat![[0.0, 0.0], [0.0, 0.0]];
    let mut mmae = engine(&members, GainMode::Recursive, Law::Bayes);
    for (u, y) in record(10) {
        let e = mmae.step(&u, &y).unwrap();
        assert!(e.x_hat.iter().all(|x| x.is_finite()));
        assert!((e.p.iter().sum::<f64>() - 1.0).abs() < 1e-13);
    }
    assert_eq!(mmae.estimate().failed, [false, true, false]);
    assert_eq!(mmae.estimate().p[1], 0.0);
}

#[test]
fn missing_samples() {
    let none = [f64::NAN, f64::NAN];
    for gains in [GainMode::Recursive, GainMode::Steady] {
        let mut mmae = engine(&members(4), gains, Law::Bayes);
        mmae.step(&[0.1], &[0.3, 0.2]).unwrap();
        let before = mmae.estimate().clone();
        let after = mmae.step(&[0.1], &none).unwrap();
        assert_eq!(after.p, before.p);
        assert_eq!(after.log_lik_models, before.log_lik_models);
        assert_ne!(after.x_hat, before.x_hat);
        // a channel that is missing is a channel that is not there
        let half = mmae.step(&[0.1], &[0.4, f64::NAN]).unwrap().clone();
        assert!(half.p.iter().all(|p| p.is_finite()));
    }
    let mut one = members(4);
    for plant in &mut one.plants {
        plant.C = mat![[1.0, 0.5]];
        plant.R = mat![[0.5]];
    }
    let mut half = engine(&members(4), GainMode::Recursive, Law::Bayes);
    let mut single = engine(&one, GainMode::Recursive, Law::Bayes);
    for (u, y) in record(20) {
        half.step(&u, &[y[0], f64::NAN]).unwrap();
        single.step(&u, &[y[0]]).unwrap();
    }
    for (a, b) in half.estimate().p.iter().zip(&single.estimate().p) {
        assert!((a - b).abs() < 1e-13);
    }
}

#[test]
fn bad_signals_are_refused_and_change_nothing() {
    let mut mmae = engine(&members(4), GainMode::Recursive, Law::Bayes);
    mmae.step(&[0.1], &[0.3, 0.2]).unwrap();
    let before = mmae.estimate().clone();
    for (u, y) in [
        (&[0.1][..], &[0.3][..]),
        (&[], &[0.3, 0.2]),
        (&[f64::NAN], &[0.3, 0.2]),
        (&[0.1], &[f64::INFINITY, 0.2]),
    ] {
        assert!(mmae.step(u, y).is_err());
    }
    assert_same(mmae.estimate(), &before);
    let mut twin = engine(&members(4), GainMode::Recursive, Law::Bayes);
    twin.step(&[0.1], &[0.3, 0.2]).unwrap();
    assert_eq!(mmae.step(&[0.2], &[0.1, 0.0]).unwrap(), twin.step(&[0.2], &[0.1, 0.0]).unwrap());
}

/// Scalar models `x' = -a x + w`, `y = x + v`, or of two independent states.
fn rate(a: f64) -> Plant {
    Plant {
        time: Time::Continuous,
        A: mat![[-1.0, 0.0], [0.0, -a]],
        B: mat![[1.0], [1.0]],
        G: Mat::identity(2, 2),
        C: Mat::identity(2, 2),
        Q: mat![[1.0, 0.0], [0.0, 1.0]],
        R: mat![[0.1, 0.0], [0.0, 0.1]],
    }
}

#[test]
fn continuous_observers_without_a_sample_are_the_models_alone() {
    for gains in [GainMode::Steady, GainMode::Recursive] {
        let mut members = Members::new(ObserverKind::KalmanBucy, vec![rate(2.0), rate(3.0)]);
        members.initial[0].x_hat = vec![1.0, 1.0];
        let settings = Settings { dt: Some(0.1), gains, ..Settings::default() };
        for law in [Law::Likelihood, Law::Bayes, Law::Ode { substeps: 2 }] {
            let weighting = Weighting { law, ..Weighting::default() };
            let mut mmae = Mmae::new(&members, &settings, &weighting, &[1.0; 2]).unwrap();
            for _ in 0..10 {
                mmae.step(&[0.0], &[f64::NAN, f64::NAN]).unwrap();
            }
            let mut x = [0.0; 2];
            mmae.bank().x_hat_into(1, &mut x);
            assert!((x[0] - (-1.0_f64).exp()).abs() < 1e-14, "{x:?}");
            assert!((x[1] - (-3.0_f64).exp()).abs() < 1e-14, "{x:?}");
            assert_eq!(mmae.estimate().p, [0.5, 0.5]);
            // models that differ in an output that is never seen stay level
            for k in 0..50 {
                mmae.step(&[1.0], &[(0.3 * f64::from(k)).sin(), f64::NAN]).unwrap();
            }
            assert!((mmae.estimate().p[0] - 0.5).abs() < 1e-12, "{:?}", mmae.estimate().p);
        }
    }
}

#[test]
fn steady_innovations_leave_out_what_is_missing() {
    let other = |q: f64| Plant { Q: mat![[0.3, 0.0], [0.0, q]], ..model(0.5) };
    let plain = |q: f64| Plant {
        A: mat![[0.5, 0.0], [0.0, 0.8]],
        C: Mat::identity(2, 2),
        R: mat![[0.5, 0.0], [0.0, 0.4]],
        ..other(q)
    };
    let members = Members::new(ObserverKind::Kalman, vec![plain(0.2), plain(2.0)]);
    let settings = Settings::default();
    for innovation in [Innovation::Filter, Innovation::Steady] {
        let weighting = Weighting { innovation, ..Weighting::default() };
        let mut mmae = Mmae::new(&members, &settings, &weighting, &[1.0; 2]).unwrap();
        for (u, y) in record(30) {
            mmae.step(&u, &[y[0], f64::NAN]).unwrap();
        }
        assert!((mmae.estimate().p[0] - 0.5).abs() < 1e-12, "{:?}", mmae.estimate().p);
    }
}

#[test]
fn a_recursion_without_a_start_is_the_steady_filter() {
    for start in [StartTime::StepBefore, StartTime::FirstMeasurement] {
        let mut members = members(3);
        members.initial[0].P = None;
        members.start = start;
        let mut a = engine(&members, GainMode::Recursive, Law::Bayes);
        let mut b = engine(&members, GainMode::Steady, Law::Bayes);
        for (u, y) in record(20) {
            a.step(&u, &y).unwrap();
            b.step(&u, &y).unwrap();
        }
        for (x, y) in a.estimate().log_lik_models.iter().zip(&b.estimate().log_lik_models) {
            assert!((x - y).abs() < 1e-11 * y.abs(), "{start:?}: {x} {y}");
        }
    }
}

#[test]
fn members_that_failed_never_come_back() {
    let mut bad = members(3);
    bad.plants[1].A[(0, 0)] = f64::NAN;
    let pi = Transition::sticky(3, 0.8).unwrap();
    let settings = Settings { gains: GainMode::Recursive, ..Settings::default() };
    for mixing in [Mixing::Markov(pi.clone()), Mixing::Imm(pi), Mixing::Reseed { threshold: 0.2 }] {
        let weighting = Weighting { mixing, ..Weighting::default() };
        let mut mmae = Mmae::new(&bad, &settings, &weighting, &[1.0; 3]).unwrap();
        for (k, (u, y)) in record(12).iter().enumerate() {
            let y = if k % 3 == 2 { [f64::NAN; 2] } else { *y };
            let e = mmae.step(u, &y).unwrap();
            assert_eq!(e.p[1], 0.0);
            assert!((e.p.iter().sum::<f64>() - 1.0).abs() < 1e-13);
        }
    }
}

#[test]
fn a_bank_that_ran_away_has_no_estimate() {
    let mut gone = members(2);
    for plant in &mut gone.plants {
        plant.A = mat![[1e200, 0.0], [0.0, 1e200]];
        plant.Q = mat![[0.0, 0.0], [0.0, 0.0]];
    }
    let mut mmae = engine(&gone, GainMode::Recursive, Law::Bayes);
    let last = (0..6).map(|_| mmae.step(&[0.1], &[f64::NAN; 2]).map(|_| ())).last().unwrap();
    assert!(matches!(last, Err(mmae::Error::AllFailed { .. })), "{last:?}");
}
