//! Upsilon, boundaries and sets against the reference numbers.

use std::sync::Arc;

use mmae::eip::{Bank, Convention, EipSets, Method, Study, Verify};
use mmae::model::{Axis, Grid, systems};
use mmae::observer::ObserverKind;
use mmae::par::RunControl;
use serde_json::Value;

const NOMINALS: [f64; 4] = [1.025, 1.287, 1.526, 1.778];

fn reference() -> Value {
    serde_json::from_str(include_str!("data/pendulum.json")).unwrap()
}

fn numbers(v: &Value) -> Vec<f64> {
    v.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

fn pendulum(grid: Grid) -> Study {
    let bank = Bank::along(ObserverKind::KalmanBucy, "L", &NOMINALS);
    let mut study = Study::new(Arc::new(systems::pendulum()), bank, grid);
    study.surroundings = systems::pendulum_surroundings();
    study.verify = Verify::All;
    study
}

fn reference_grid() -> Grid {
    let values = numbers(&reference()["upsilon"]["L"]);
    Grid::new(vec![("L".into(), Axis::Explicit(values))]).unwrap()
}

fn run(study: &Study) -> EipSets {
    study.run(&RunControl::default()).unwrap()
}

fn worst(got: &[f64], want: &Value) -> f64 {
    let want: Vec<f64> = want.as_array().unwrap().iter().flat_map(numbers).collect();
    assert_eq!(got.len(), want.len());
    got.iter().zip(&want).map(|(g, w)| ((g - w) / w).abs()).fold(0.0, f64::max)
}

#[test]
fn pendulum_upsilon_in_the_three_conventions() {
    let reference = &reference()["upsilon"];
    for (convention, key, tolerance) in [
        (Convention::Ito, "lyapunov_tau0", 1e-8),
        (Convention::Identity, "S_identity_half_trace", 1e-8),
        (Convention::Baram { dt: 1e-3 }, "baram_dt1ms", 1e-8),
    ] {
        let mut study = pendulum(reference_grid());
        study.convention = convention;
        let sets = run(&study);
        let worst = worst(&sets.cases[0].upsilon, &reference[key]);
        assert!(worst < tolerance, "{key}: {worst:.2e}");
        assert!(sets.cases[0].route_difference < 1e-9);
        assert_eq!(sets.cases[0].checked_pairs, 20);
    }
}

#[test]
fn exact_delay_and_pade_of_order_four_agree() {
    let mut study = pendulum(reference_grid());
    study.delays = vec![0.02];
    let sets = run(&study);
    let worst = worst(&sets.cases[0].upsilon, &reference()["upsilon"]["freq_exact_delay_20ms"]);
    assert!(worst < 2e-8, "{worst:.2e}");
    assert!(sets.cases[0].route_difference < 2e-8);
}

#[test]
fn matched_identity() {
    // Upsilon_i(kappa_i) = 1/2 tr(C P_i C' Theta^-1)
    let sets = run(&pendulum(Grid::linear("L", 0.9, 1.9, 3).unwrap()));
    let want = [22.81320103000449, 21.381147644396712, 20.42087807, 19.64057517];
    for (i, (&w, tolerance)) in want.iter().zip([1e-9, 1e-9, 1e-9, 1e-9]).enumerate() {
        let got = sets.at_nominals[i * 4 + i];
        assert!(((got - w) / w).abs() < tolerance, "model {i}: {got}");
        assert_eq!(sets.pseudo_norm(i, i, i), 0.0);
    }
}

#[test]
fn boundaries_on_coarse_and_fine_grids() {
    let want = numbers(&reference()["eip"]["tau0"]);
    for points in [5, 11, 101] {
        let sets = run(&pendulum(Grid::linear("L", 0.9, 1.9, points).unwrap()));
        let boundaries = &sets.cases[0].boundaries;
        assert_eq!(boundaries.len(), 3, "{points} points");
        for (k, (b, w)) in boundaries.iter().zip(&want).enumerate() {
            assert!((b.value - w).abs() < 1e-9, "{points} points: {} {w}", b.value);
            assert!(b.uncertainty < 1e-9);
            assert_eq!((b.left, b.right), (k, k + 1));
        }
        assert_eq!(sets.model_at(0, 1.2), Some(1));
    }
}

#[test]
fn boundaries_in_other_conventions() {
    for (convention, key) in
        [(Convention::Identity, "S_identity"), (Convention::Baram { dt: 1e-3 }, "baram_dt1ms")]
    {
        let mut study = pendulum(Grid::linear("L", 0.9, 1.9, 11).unwrap());
        study.convention = convention;
        let sets = run(&study);
        assert_eq!(sets.cases[0].boundaries.len(), 3);
        for (b, w) in sets.cases[0].boundaries.iter().zip(numbers(&reference()["eip"][key])) {
            assert!((b.value - w).abs() < 1e-9, "{key}: {} {w}", b.value);
        }
    }
}

#[test]
fn delays_give_undecidable_sets() {
    let mut study = pendulum(Grid::linear("L", 0.9, 1.9, 21).unwrap());
    study.delays = vec![0.0, 0.002, 0.02];
    let sets = run(&study);
    let at =
        |case: usize| -> Vec<f64> { sets.cases[case].boundaries.iter().map(|b| b.value).collect() };
    for (case, want) in
        [(1, [1.153664611, 1.404549549, 1.649852831]), (2, [1.154061902, 1.404798068, 1.650014975])]
    {
        for (got, want) in at(case).iter().zip(want) {
            assert!((got - want).abs() < 2e-9, "{got} {want}");
        }
    }
    assert_eq!(sets.undecidable.len(), 3);
    for (k, u) in sets.undecidable.iter().enumerate() {
        assert_eq!((u.interval.from, u.interval.to), (at(0)[k], at(2)[k]));
        assert_eq!(u.models, [k, k + 1]);
    }
}

#[test]
fn modal_and_doubling_agree() {
    let nominals: Vec<f64> = (0..40).map(|i| 0.92 + 0.024 * f64::from(i)).collect();
    let grid = Grid::linear("L", 0.9, 1.9, 33).unwrap();
    let mut study = pendulum(grid);
    study.bank = Bank::along(ObserverKind::KalmanBucy, "L", &nominals);
    for (convention, tolerance) in [(Convention::Ito, 1e-8), (Convention::Baram { dt: 1e-3 }, 1e-6)]
    {
        study.convention = convention;
        study.verify = Verify::None;
        study.method = Some(Method::Doubling);
        let doubling = run(&study);
        study.method = Some(Method::Modal);
        let modal = run(&study);
        assert_eq!(modal.method, Method::Modal);
        let worst = doubling.cases[0]
            .upsilon
            .iter()
            .zip(&modal.cases[0].upsilon)
            .map(|(d, m)| ((d - m) / d).abs())
            .fold(0.0, f64::max);
        assert!(worst < tolerance, "{convention:?} {worst:.2e}");
        assert_eq!(doubling.cases[0].winner, modal.cases[0].winner);
    }
}

#[test]
fn unstable_plants_are_named_and_have_no_number() {
    let bank = Bank::along(ObserverKind::KalmanBucy, "L", &NOMINALS);
    let grid = Grid::linear("L", 0.9, 1.9, 5).unwrap();
    // no controller: the pendulum falls
    let mut study = Study::new(Arc::new(systems::pendulum()), bank, grid);
    study.surroundings.disturbance = systems::pendulum_surroundings().disturbance;
    let sets = run(&study);
    let case = &sets.cases[0];
    assert_eq!(case.unstable.len(), 5);
    assert!(case.upsilon.iter().all(|u| u.is_nan()));
    assert!(case.winner.iter().all(Option::is_none));
    assert!(case.unstable[0].mode.re > 4.0 && case.unstable[0].states.contains("theta"));
}
