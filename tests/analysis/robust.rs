//! Undecidable sets of an unmodelled actuator and of a delay interval.

use std::sync::{Arc, OnceLock};

use faer::Mat;
use mmae::eip::{Bank, EipSets, Found, Study, Verify};
use mmae::model::{ActuatorBound, FnFamily, Grid, Names, Plant, Time, systems};
use mmae::observer::ObserverKind;
use mmae::par::RunControl;

/// Outer sets of the pendulum, computed independently: the first also stands in
/// tests/data/pendulum.json.
const OUTER: [[f64; 2]; 3] =
    [[1.152141586, 1.158037807], [1.403559, 1.406880], [1.649169, 1.651286]];

/// A delay that the bound covers; at 20 ms it falls short by .003 near 150 rad/s.
const COVERED: f64 = 0.019;

fn bound() -> ActuatorBound {
    ActuatorBound::from_polynomials(&[2.1, 0.0], &[1.0, 50.0]).unwrap()
}

fn pendulum(points: usize) -> Study {
    let bank = Bank::along(ObserverKind::KalmanBucy, "L", &[1.025, 1.287, 1.526, 1.778]);
    let grid = Grid::linear("L", 0.9, 1.9, points).unwrap();
    let mut study = Study::new(Arc::new(systems::pendulum()), bank, grid);
    study.surroundings = systems::pendulum_surroundings();
    study.verify = Verify::None;
    study.unmodelled = Some(bound());
    study
}

/// One study for all tests.
fn sets() -> &'static EipSets {
    static SETS: OnceLock<EipSets> = OnceLock::new();
    SETS.get_or_init(|| {
        let mut study = pendulum(21);
        study.delays = vec![0.0, COVERED];
        study.delay_interval = Some([0.0, COVERED]);
        study.run(&RunControl::default()).unwrap()
    })
}

#[test]
fn outer_sets_of_the_pendulum_are_those_of_the_theory() {
    let robust = sets().robust.as_ref().unwrap();
    assert_eq!(robust.undecidable.len(), 3);
    for (u, want) in robust.undecidable.iter().zip(OUTER) {
        assert!((u.interval.from - want[0]).abs() < 1e-6, "{u:?} {want:?}");
        assert!((u.interval.to - want[1]).abs() < 1e-6, "{u:?} {want:?}");
    }
    // robust stability: max |W T| = .55374
    let peak = robust.peak.unwrap();
    assert!((peak.size - 0.55374).abs() < 5e-6, "{peak:?}");
    assert!(robust.is_stable());
    // sets and outer estimates tile the grid, and the winners are the nominal ones
    let inside: f64 = robust.undecidable.iter().map(|u| u.interval.to - u.interval.from).sum();
    let certain: f64 = robust.sets.iter().flatten().map(|i| i.to - i.from).sum();
    assert!((inside + certain - 1.0).abs() < 1e-12);
    for (k, (&model, &lead)) in robust.guaranteed.iter().zip(&robust.lead).enumerate() {
        let case = &sets().cases[0];
        assert!(lead <= case.margin[k] + 1e-6, "the worst case leaves no more than the nominal");
        assert_eq!(model.is_some(), lead > 0.0);
        assert!(model.is_none() || model == case.winner[k]);
    }
}

#[test]
fn inner_sets_lie_inside_and_delay_sets_inside_both() {
    let robust = sets().robust.as_ref().unwrap();
    let sweep = sets().delay_sweep.as_ref().unwrap();
    assert_eq!(sweep.covered, Some(true));
    assert!(sweep.settled && sweep.moved < 1e-9, "{sweep:?}");
    for (k, u) in robust.undecidable.iter().enumerate() {
        let [inner] = &u.inner[..] else { panic!("one boundary: {u:?}") };
        let (outer, inner) = (&u.interval, &inner.interval);
        assert!(outer.from <= inner.from && inner.to <= outer.to);
        let share = (inner.to - inner.from) / (outer.to - outer.from);
        assert!(share > 0.4, "{inner:?} is {share} of {outer:?}");
        let delay = &sweep.undecidable[k].interval;
        assert!(
            inner.from <= delay.from + 1e-8 && delay.to <= inner.to + 1e-8,
            "{delay:?} {inner:?}"
        );
    }
    // the boundaries rise with the delay: the ends are those of the two ends
    for (u, ends) in sweep.undecidable.iter().zip(&sets().undecidable) {
        assert!((u.interval.from - ends.interval.from).abs() < 1e-10);
        assert!((u.interval.to - ends.interval.to).abs() < 1e-10);
    }
    assert!(bound().covered_delay(10.0) < 0.020);
}

#[test]
fn a_smaller_bound_leaves_smaller_sets_and_none_leaves_none() {
    let mut study = pendulum(6);
    study.unmodelled = Some(ActuatorBound::from_polynomials(&[1e-9], &[1.0, 50.0]).unwrap());
    let sets = study.run(&RunControl::default()).unwrap();
    for u in &sets.robust.as_ref().unwrap().undecidable {
        assert!(u.interval.to - u.interval.from < 1e-7, "{u:?}");
    }
    // a bound of more than one at low frequencies, where T is one
    study.unmodelled = Some(ActuatorBound::from_polynomials(&[60.0], &[1.0, 50.0]).unwrap());
    let sets = study.run(&RunControl::default()).unwrap();
    let robust = sets.robust.as_ref().unwrap();
    assert!(!robust.is_stable() && robust.sets.iter().all(Vec::is_empty));
    assert!((robust.fragile[0].from, robust.fragile[0].to) == (0.9, 1.9));
    assert!(robust.guaranteed.iter().all(Option::is_none));
}

#[test]
fn results_do_not_depend_on_threads() {
    let study = pendulum(6);
    let one = study.run(&RunControl::default().threads(1)).unwrap();
    let three = study.run(&RunControl::default().threads(3)).unwrap();
    assert_eq!(one.robust, three.robust);
}

#[test]
fn all_pass_factors_keep_the_size_of_the_bound() {
    for u in &sets().robust.as_ref().unwrap().undecidable {
        for found in [&u.inner[0].lower, &u.inner[0].upper].into_iter().flatten() {
            if let Found::AllPass { gain, real, pairs } = found {
                assert!(gain.abs() <= 1.0);
                assert!(real.iter().chain(pairs.iter().flatten()).all(|v| *v > 0.0));
            }
        }
    }
}

#[test]
fn what_cannot_be_analysed_is_refused() {
    let mut study = pendulum(3);
    study.surroundings.controller = None;
    let error = study.run(&RunControl::default()).unwrap_err().to_string();
    assert!(error.contains("nothing drives the input"), "{error}");
    let mut study = pendulum(3);
    study.convention = mmae::eip::Convention::Baram { dt: 0.01 };
    let error = study.run(&RunControl::default()).unwrap_err().to_string();
    assert!(error.contains("sampled study"), "{error}");
    // two inputs
    let names = Names {
        states: vec!["x".into()],
        inputs: vec!["a".into(), "b".into()],
        disturbances: vec!["w".into()],
        outputs: vec!["y".into()],
    };
    let family = FnFamily::new(&[("k", 1.0)], names, Time::Continuous, |theta: &[f64]| {
        let one = |v: f64| Mat::from_fn(1, 1, |_, _| v);
        Ok(Plant {
            time: Time::Continuous,
            A: one(-theta[0]),
            B: Mat::from_fn(1, 2, |_, _| 1.0),
            G: one(1.0),
            C: one(1.0),
            Q: one(1.0),
            R: one(0.1),
        })
    });
    let bank = Bank::along(ObserverKind::KalmanBucy, "k", &[1.0, 2.0]);
    let mut study = Study::new(Arc::new(family), bank, Grid::linear("k", 0.5, 2.5, 5).unwrap());
    study.unmodelled = Some(bound());
    let error = study.run(&RunControl::default()).unwrap_err().to_string();
    assert!(error.contains("with 2 inputs"), "{error}");
    for (numerator, denominator, part) in [
        (&[1.0][..], &[1.0, -2.0][..], "does not decay"),
        (&[1.0, 0.0, 0.0], &[1.0, 2.0], "grows without bound"),
        (&[1.0], &[0.0, 2.0], "out of range"),
        (&[], &[1.0], "empty"),
        (&[f64::NAN], &[1.0], "not a finite number"),
    ] {
        let error = ActuatorBound::from_polynomials(numerator, denominator).unwrap_err();
        assert!(error.to_string().contains(part), "{error}");
    }
}
