//! Observers: published numbers, fixed points, typed errors.

mod common;

use common::data::{load, matrix, number};
use common::matrix::{M, eye, mul, t};
use mmae::model::{Names, Plant, Time};
use mmae::observer::{Observer, ObserverKind, design, design_with};
use mmae::par::RunControl;
use mmae::{Error, Mat};

fn mat(x: &M) -> Mat<f64> {
    Mat::from_fn(x.len(), x.first().map_or(0, Vec::len), |i, j| x[i][j])
}

/// The design model of the pendulum with length `l`: position, angle, their
/// rates, and the coloured disturbance force.
fn pendulum(l: f64) -> Plant {
    let (big, m, g, b, k) = (1.0, 0.75, 9.8, 0.1, 0.15);
    let a = vec![
        vec![0.0, 0.0, 1.0, 0.0, 0.0],
        vec![0.0, 0.0, 0.0, 1.0, 0.0],
        vec![-k / big, -m * g / big, -b / big, 0.0, -1.0 / big],
        vec![k / (l * big), (m + big) * g / (l * big), b / (l * big), 0.0, 1.0 / (l * big)],
        vec![0.0, 0.0, 0.0, 0.0, -1.0],
    ];
    Plant {
        time: Time::Continuous,
        A: mat(&a),
        B: Mat::zeros(5, 0),
        G: Mat::from_fn(5, 1, |i, _| if i == 4 { 1.0 } else { 0.0 }),
        C: Mat::from_fn(2, 5, |i, j| if i == j { 1.0 } else { 0.0 }),
        Q: mat(&eye(1)),
        R: mat(&vec![vec![1e-7, 0.0], vec![0.0, 1e-8]]),
    }
}

fn close(what: &str, got: &Mat<f64>, want: &M, tol: f64) {
    let want = mat(want);
    let error = (got - &want).norm_l2() / want.norm_l2();
    assert!(error <= tol, "{what}: {error:e}");
}

#[test]
fn pendulum_bank() {
    let file = load("pendulum.json");
    let half_traces = [22.81320103, 21.38114764, 20.42087807, 19.64057517];
    let items = file["observers5"].as_array().unwrap();
    let models: Vec<Plant> = items.iter().map(|item| pendulum(number(&item["L"]))).collect();
    for kind in [ObserverKind::KalmanBucy, ObserverKind::Krener] {
        let observers = design(kind, &models);
        for ((item, observer), half_trace) in items.iter().zip(&observers).zip(half_traces) {
            let o: &Observer = observer.as_ref().unwrap();
            close("P", &o.P, &matrix(&item["P"]), 1e-10);
            close("H", &o.L, &matrix(&item["H"]), 1e-10);
            let half = 0.5 * (o.P[(0, 0)] / 1e-7 + o.P[(1, 1)] / 1e-8);
            assert!((half / half_trace - 1.0).abs() < 1e-9, "{half}");
            assert!((half / number(&item["half_tr_CPC_Rinv"]) - 1.0).abs() < 1e-10, "{half}");
            assert!(o.report.margin > 0.5 && o.K == o.L && o.S == o.plant.R, "{:?}", o.report);
        }
    }
}

#[test]
fn oscillator_bank() {
    let file = load("oscillator.json");
    let models: Vec<Plant> = file["care"]["items"]
        .as_array()
        .unwrap()
        .iter()
        .map(|item| Plant {
            time: Time::Continuous,
            A: mat(&matrix(&item["A"])),
            B: mat(&vec![vec![5.0], vec![0.0], vec![0.0]]),
            G: mat(&vec![vec![5.0], vec![0.0], vec![0.0]]),
            C: mat(&vec![vec![0.0, 1.0, 0.0]]),
            Q: mat(&vec![vec![100.0]]),
            R: mat(&vec![vec![0.1]]),
        })
        .collect();
    let observers = design(ObserverKind::KalmanBucy, &models);
    for (item, observer) in file["care"]["items"].as_array().unwrap().iter().zip(&observers) {
        let o = observer.as_ref().unwrap();
        close("P", &o.P, &matrix(&item["P"]), 1e-9);
        let gain = common::data::vector(&item["L"]);
        close("L", &o.L, &t(&vec![gain]), 1e-9);
    }
}

/// A constant-velocity model, sampled, with position seen.
fn tracker(dt: f64, q: f64, r: f64) -> Plant {
    Plant {
        time: Time::Discrete { dt },
        A: mat(&vec![vec![1.0, dt], vec![0.0, 1.0]]),
        B: Mat::zeros(2, 0),
        G: mat(&vec![vec![0.5 * dt * dt], vec![dt]]),
        C: mat(&vec![vec![1.0, 0.0]]),
        Q: mat(&vec![vec![q]]),
        R: mat(&vec![vec![r]]),
    }
}

fn lists(x: &Mat<f64>) -> M {
    (0..x.nrows()).map(|i| (0..x.ncols()).map(|j| x[(i, j)]).collect()).collect()
}

#[test]
fn steady_kalman_filter_is_the_fixed_point_of_the_recursion() {
    let model = tracker(0.1, 2.0, 0.5);
    let o = design(ObserverKind::Kalman, std::slice::from_ref(&model)).remove(0).unwrap();
    let (a, c, g) = (lists(&model.A), lists(&model.C), lists(&model.G));
    let q = common::matrix::prod(&[&g, &lists(&model.Q), &t(&g)]);
    let mut p = eye(2);
    for _ in 0..2000 {
        let s = mul(&mul(&c, &p), &t(&c))[0][0] + 0.5;
        let k = common::matrix::scale(1.0 / s, &mul(&p, &t(&c)));
        let kept = common::matrix::sub(&eye(2), &mul(&k, &c));
        p = common::matrix::add(&common::matrix::prod(&[&a, &kept, &p, &t(&a)]), &q);
    }
    close("P", &o.P, &p, 1e-12);
    let s = p[0][0] + 0.5;
    assert!((o.S[(0, 0)] / s - 1.0).abs() < 1e-12);
    let k = common::matrix::scale(1.0 / s, &mul(&p, &t(&c)));
    close("K", &o.K, &k, 1e-12);
    close("L", &o.L, &mul(&a, &k), 1e-12);
}

#[test]
fn a_bad_model_leaves_the_others_alone() {
    let good = [tracker(0.1, 2.0, 0.5), tracker(0.2, 2.0, 0.5), tracker(0.1, 1.0, 0.1)];
    let alone: Vec<_> = good
        .iter()
        .map(|m| design(ObserverKind::Kalman, std::slice::from_ref(m)).remove(0))
        .collect();
    let mut nan = good[0].clone();
    nan.Q[(0, 0)] = f64::NAN;
    let mut blind = good[0].clone();
    blind.C[(0, 0)] = 0.0;
    let mut still = good[0].clone();
    still.Q[(0, 0)] = 0.0;
    let scalar = Plant {
        time: Time::Discrete { dt: 1.0 },
        A: mat(&eye(1)),
        B: Mat::zeros(1, 0),
        G: mat(&eye(1)),
        C: mat(&eye(1)),
        Q: mat(&vec![vec![1469.1]]),
        R: mat(&vec![vec![15099.0]]),
    };
    let mixed = [
        nan,
        good[0].clone(),
        blind,
        scalar.clone(),
        good[1].clone(),
        pendulum(1.0),
        good[2].clone(),
        still,
    ];
    let names = Names { states: vec!["position".into(), "velocity".into()], ..Default::default() };
    let control = RunControl::default();
    let all = design_with(ObserverKind::Kalman, &mixed, Some(&names), &control).unwrap();
    for (k, of) in [(1, 0), (4, 1), (6, 2)] {
        assert_eq!(all[k], alone[of]);
        assert!(all[k].is_ok());
    }
    assert!(matches!(&all[0], Err(Error::NonFinite { what, .. }) if what == "Q"), "{:?}", all[0]);
    let Err(Error::Undetectable { eigenvalue, states }) = &all[2] else { panic!("{:?}", all[2]) };
    assert!((eigenvalue.re - 1.0).abs() < 1e-6);
    assert!(states.contains("position"), "{states}");
    // P = (q + sqrt(q^2 + 4 q r))/2
    let p: f64 = 0.5 * (1469.1 + (1469.1_f64.powi(2) + 4.0 * 1469.1 * 15099.0).sqrt());
    assert!((all[3].as_ref().unwrap().P[(0, 0)] / p - 1.0).abs() < 1e-14);
    assert!(matches!(&all[5], Err(Error::Conflict { .. })), "{:?}", all[5]);
    let Err(Error::Unstabilizable { states, .. }) = &all[7] else { panic!("{:?}", all[7]) };
    assert!(!states.is_empty());
}

#[test]
fn unstable_modes_without_noise_are_stabilized() {
    // x' = x: P = 2 r
    let model = |a: f64| Plant {
        time: Time::Continuous,
        A: mat(&vec![vec![a]]),
        B: Mat::zeros(1, 0),
        G: Mat::zeros(1, 0),
        C: mat(&eye(1)),
        Q: Mat::zeros(0, 0),
        R: mat(&vec![vec![3.0]]),
    };
    let observers = design(ObserverKind::KalmanBucy, &[model(1.0), model(-1.0), model(0.0)]);
    assert!((observers[0].as_ref().unwrap().P[(0, 0)] - 6.0).abs() < 1e-14);
    assert_eq!(observers[1].as_ref().unwrap().P[(0, 0)], 0.0);
    assert!(matches!(observers[2], Err(Error::Unstabilizable { .. })), "{:?}", observers[2]);
    assert!(design(ObserverKind::Kalman, &[]).is_empty());
}
