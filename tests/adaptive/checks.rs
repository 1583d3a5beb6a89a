//! What is refused, and how it is told.

use mmae::adaptive::{Adaptive, Prior, Reading, Settings, Structure, Tuning, Unknown};
use mmae::{Error, mat};

use super::example::{structure, tuning};

fn refusal(structure: Structure, settings: Settings, tuning: Tuning) -> Error {
    match Adaptive::new(structure, settings, vec![tuning]) {
        Err(Error::AllFailed { source, .. }) => *source,
        Err(e) => e,
        Ok(_) => panic!("accepted"),
    }
}

fn bad(tuning: Tuning) -> Error {
    refusal(structure(), Settings::new(0.01), tuning)
}

#[test]
fn the_sign_of_the_papers_gain_is_named() {
    let error = bad(Tuning { K: mat![[-5.0], [5.0]], ..tuning(1e3) });
    let Error::ObserverUnstable { eigenvalue, opposite: true } = &error else { panic!("{error}") };
    assert!((eigenvalue.re - 2.0).abs() < 1e-12);
    let said = error.to_string();
    assert!(said.contains("turn the sign of K") && said.contains("Liu and Peng"), "{said}");
    // a gain that is wrong either way
    let error =
        bad(Tuning { K: mat![[-5.0], [0.0]], A: mat![[0.0, 1.0], [7.0, 2.0]], ..tuning(1e3) });
    assert!(matches!(error, Error::ObserverUnstable { opposite: false, .. }), "{error}");
}

#[test]
fn a_state_that_the_output_does_not_see_is_named() {
    let error = bad(Tuning { A: mat![[-7.0, 0.0], [1.0, -2.0]], ..tuning(1e3) });
    let Error::NotObservable { states, .. } = &error else { panic!("{error}") };
    assert_eq!(states, "x2");
}

#[test]
fn parameters_without_effect_are_named() {
    // twice the same column
    let mut twice = structure();
    twice.regressor = std::sync::Arc::new(mmae::adaptive::FnRegressor::new(2, |_, u, _, g, _| {
        g.copy_from_slice(&[0.0, u[0], 0.0, 2.0 * u[0]]);
    }));
    let error = refusal(twice, Settings::new(0.01), tuning(1e3));
    let said = error.to_string();
    assert!(said.starts_with("only 3 of 4"), "{said}");
    assert!(said.contains("changing b - 0.5000 c together leaves y unchanged"), "{said}");
    let mut none = structure();
    none.regressor = std::sync::Arc::new(mmae::adaptive::FnRegressor::new(2, |_, u, _, g, _| {
        g.copy_from_slice(&[0.0, u[0], 0.0, 0.0]);
    }));
    let said = refusal(none, Settings::new(0.01), tuning(1e3)).to_string();
    assert!(said.contains("c does not reach y"), "{said}");
}

#[test]
fn shapes_ranges_and_conflicts() {
    let shape = |e: Error| assert!(matches!(e, Error::Shape { .. }), "{e}");
    shape(bad(Tuning { A: mat![[0.0]], ..tuning(1e3) }));
    shape(bad(Tuning { theta: vec![0.0], ..tuning(1e3) }));
    shape(bad(Tuning { x_hat: vec![0.0], ..tuning(1e3) }));
    shape(bad(Tuning { bounds: Vec::new(), ..tuning(1e3) }));
    let range = |e: Error| assert!(matches!(e, Error::Range { .. }), "{e}");
    range(bad(Tuning { lambda: -0.1, ..tuning(1e3) }));
    range(bad(Tuning { lambda: f64::NAN, ..tuning(1e3) }));
    range(bad(tuning(0.0)));
    range(bad(Tuning { trace_cap: f64::NAN, ..tuning(1e3) }));
    range(bad(Tuning { R: vec![0.0], ..tuning(1e3) }));
    range(bad(Tuning { bounds: vec![[1.0, 2.0]; 4], ..tuning(1e3) }));
    range(bad(Tuning { resets: vec![2.0, 1.0], ..tuning(1e3) }));
    let with = |settings: Settings| refusal(structure(), settings, tuning(1e3));
    assert!(matches!(with(Settings::new(0.0)), Error::InvalidDt { .. }));
    let obs = Settings { reading: Reading::Obs, initial_state: true, ..Settings::new(0.01) };
    assert!(matches!(with(obs), Error::Conflict { .. }));
    range(with(Settings { window: 0, ..Settings::new(0.01) }));
    let mut other = structure();
    other.unknown[0] = Unknown::entry("da1", 2, 0);
    assert!(matches!(other.check(), Err(Error::Conflict { .. })));
    other.unknown[0] = Unknown::entry("da1", 1, 1);
    assert!(matches!(other.check(), Err(Error::Conflict { .. })));
    other.unknown[0] = Unknown::given("da1");
    assert!(matches!(other.check(), Err(Error::Conflict { .. })));
    other.unknown.clear();
    assert!(matches!(other.check(), Err(Error::Empty { .. })));
    let infinite = Prior::Sigma { theta: vec![1.0; 4], noise: 0.0 };
    assert!(matches!(bad(Tuning { prior: infinite, ..tuning(1e3) }), Error::NonFinite { .. }));
}

#[test]
fn a_sample_that_is_refused_changes_nothing() {
    let mut observer = Adaptive::new(structure(), Settings::new(0.01), vec![tuning(1e3)]).unwrap();
    for k in 0..5 {
        observer.step(&[1.0], &[0.1 * f64::from(k)]).unwrap();
    }
    let before = observer.theta(0);
    assert!(matches!(observer.step(&[f64::NAN], &[0.0]), Err(Error::NonFinite { .. })));
    assert!(matches!(observer.step(&[0.0], &[f64::INFINITY]), Err(Error::NonFinite { .. })));
    assert!(matches!(observer.step(&[], &[0.0]), Err(Error::Shape { .. })));
    assert_eq!(observer.theta(0), before);
    assert_eq!(observer.steps(), 5);
    // missing outputs are no error, and teach nothing
    observer.step(&[1.0], &[f64::NAN]).unwrap();
    assert_eq!(observer.theta(0), before);
}
