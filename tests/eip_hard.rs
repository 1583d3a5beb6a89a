//! Studies that go wrong in parts: winners that neither route vouches for,
//! ties, dips beside the grid points, plants that cannot be built.

use std::sync::Arc;

use mmae::eip::{Bank, Case, Convention, EipSets, Method, Study, Verify};
use mmae::error::Error;
use mmae::model::{Axis, FnFamily, Grid, Names, Plant, Time, systems};
use mmae::observer::ObserverKind;
use mmae::par::RunControl;
use mmae::{Mat, mat, model::Family};

fn run(study: &Study) -> EipSets {
    study.run(&RunControl::default()).unwrap()
}

fn bank(name: &str, models: &[f64]) -> Bank {
    Bank::along(ObserverKind::KalmanBucy, name, models)
}

fn explicit(name: &str, values: &[f64]) -> Grid {
    Grid::new(vec![(name.into(), Axis::Explicit(values.to_vec()))]).unwrap()
}

/// A smooth signal behind a sensor of rate `p`.
fn sensor(r: f64) -> Arc<dyn Family> {
    Arc::new(FnFamily::new(
        &[("p", 10.0)],
        Names::numbered(3, 0, 1, 1),
        Time::Continuous,
        move |theta| {
            let p = theta[0];
            Ok(Plant {
                time: Time::Continuous,
                A: mat![[-1.0, 1.0, 0.0], [0.0, -1.0, 0.0], [p, 0.0, -p]],
                B: mmae::Mat::zeros(3, 0),
                G: mat![[0.0], [1.0], [0.0]],
                C: mat![[0.0, 0.0, 1.0]],
                Q: mat![[1.0]],
                R: mat![[r]],
            })
        },
    ))
}

/// `x' = -(a + h(k)) x + w`, measured with noise: a grid over `k`, models over
/// `a`.
fn scalar(h: impl Fn(f64) -> f64 + Send + Sync + 'static) -> Arc<dyn Family> {
    Arc::new(FnFamily::new(
        &[("k", f64::NAN), ("a", 0.0)],
        Names::numbered(1, 0, 1, 1),
        Time::Continuous,
        move |theta| {
            // nominal k: the models themselves
            let shift = if theta[0].is_nan() { 1.0 } else { h(theta[0]) };
            Ok(Plant {
                time: Time::Continuous,
                A: mat![[-(theta[1] + shift)]],
                B: mmae::Mat::zeros(1, 0),
                G: mat![[1.0]],
                C: mat![[1.0]],
                Q: mat![[1.0]],
                R: mat![[0.1]],
            })
        },
    ))
}

/// The plant between models `1` and `2` of [`scalar`] where they tie.
fn tie() -> f64 {
    let study = Study::new(scalar(|k| k), bank("a", &[0.0, 1.0]), explicit("k", &[1.0, 1.5, 2.0]));
    let boundaries = &run(&study).cases[0].boundaries;
    assert_eq!(boundaries.len(), 1);
    boundaries[0].value
}

fn winners(case: &Case) -> Vec<usize> {
    case.winner.iter().map(|w| w.unwrap()).collect()
}

#[test]
fn rates_far_apart_take_the_frequency_integral() {
    let grid = Axis::Logarithmic { from: 1.0, to: 1e12, points: 19 };
    let grid = Grid::new(vec![("p".into(), grid)]).unwrap();
    let want: Vec<usize> = (0..19).map(|k| [0, 0, 1, 1, 1, 2][k.min(5)]).collect();
    for r in [1e-2, 1e-6] {
        let mut study = Study::new(sensor(r), bank("p", &[1e1, 1e3, 1e6]), grid.clone());
        for verify in [Verify::All, Verify::Auto, Verify::None] {
            study.verify = verify;
            let sets = run(&study);
            let case = &sets.cases[0];
            assert_eq!(winners(case), want, "{verify:?}");
            assert!(case.replaced > 10 && case.undecided.is_empty(), "{verify:?}");
            assert!(case.upsilon.iter().all(|u| *u > 0.0), "{verify:?}");
            assert!(case.route_difference < 1e-6, "of what was kept");
            assert!(sets.at_nominals.iter().all(|u| *u > 0.0));
            assert_eq!(case.boundaries.len(), 2);
            assert!(case.sets.iter().all(|set| set.len() == 1), "{:?}", case.sets);
            // the sharp one; the other two models differ by 1e-12 at r = 0.01
            let b = &case.boundaries[0];
            assert!(b.uncertainty < 1e-5 * b.value, "{b:?}");
            assert_eq!(case.error.len(), case.upsilon.len());
            for (row, error) in case.upsilon.chunks(3).zip(case.error.chunks(3)) {
                for (u, e) in row.iter().zip(error) {
                    assert!(*e < 1e-6 * u, "{u} {e}");
                }
            }
        }
    }
}

#[test]
fn a_large_grid_is_searched_around_the_plants_that_differ() {
    let grid = Axis::Logarithmic { from: 1.0, to: 1e12, points: 1500 };
    let grid = Grid::new(vec![("p".into(), grid)]).unwrap();
    let study = Study::new(sensor(1e-6), bank("p", &[1e1, 1e3, 1e6]), grid);
    let sets = run(&study);
    let case = &sets.cases[0];
    assert!(case.checked_pairs < case.upsilon.len(), "a sample");
    let found = winners(case);
    let turns: Vec<_> = (1..found.len()).filter(|&k| found[k] != found[k - 1]).collect();
    assert_eq!(turns.len(), 2, "{turns:?}");
    assert_eq!(case.boundaries.len(), 2);
}

#[test]
fn equal_models_share_one_interval() {
    // equal to rounding
    let models = [0.0, 2e-15, 1.0, 1.0 + 1e-15];
    let study =
        Study::new(scalar(|k| k), bank("a", &models), Grid::linear("k", 0.9, 2.3, 57).unwrap());
    let sets = run(&study);
    assert_eq!(sets.models[1].duplicate_of, Some(0));
    assert_eq!(sets.models[3].duplicate_of, Some(2));
    assert_eq!(sets.cases[0].boundaries.len(), 1);
    assert!(sets.cases[0].margin.iter().all(|m| *m > 1e-3));

    // the same system in other coordinates
    let family = FnFamily::new(
        &[("k", 1.0), ("s", 1.0)],
        Names::numbered(2, 0, 1, 1),
        Time::Continuous,
        |theta| {
            let s = theta[1];
            Ok(Plant {
                time: Time::Continuous,
                A: mat![[-theta[0], 0.3 / s], [0.2 * s, -2.0]],
                B: mmae::Mat::zeros(2, 0),
                G: mat![[1.0], [0.7 * s]],
                C: mat![[1.0, 0.5 / s]],
                Q: mat![[1.0]],
                R: mat![[0.1]],
            })
        },
    );
    // the plants have s = 1, so only models whose error does not see s tie
    let mut bank = bank("s", &[1.0, 1.0]);
    bank.parameters = vec!["s".into(), "k".into()];
    bank.models = vec![vec![1.0, 1.0], vec![1.0, 1.0 + 3e-13]];
    let study = Study::new(Arc::new(family), bank, Grid::linear("k", 0.5, 2.0, 41).unwrap());
    let case = &run(&study).cases[0];
    assert!(case.boundaries.len() <= 1, "{:?}", case.boundaries);
}

#[test]
fn a_bank_that_failed_is_an_error() {
    let family = scalar(|k| k);
    let study =
        Study::new(family, bank("a", &[f64::INFINITY, f64::NAN]), explicit("k", &[1.0, 2.0]));
    let error = study.run(&RunControl::default()).unwrap_err();
    let Error::AllFailed { what: "models", count: 2, source } = &error else { panic!("{error}") };
    assert!(matches!(**source, Error::Model { index: 0, .. }), "{source}");
    assert!(error.to_string().starts_with("none of the 2 models can be used; the first: model 0"));
}

#[test]
fn dips_in_the_end_cells_and_between_uneven_points_are_found() {
    let least = tie() - 0.1;
    // a bowl that goes below the tie between two points of each grid
    for (centre, grid) in [
        (0.45, vec![0.0, 1.0, 1.6, 2.0]),
        (1.6, vec![0.0, 0.4, 1.0, 2.2]),
        (1.0, vec![0.1, 0.5, 1.5, 1.9]),
        (0.45, vec![0.0, 1.0, 1.2]),
    ] {
        let study = Study::new(
            scalar(move |k| least + 0.5 * (k - centre).powi(2)),
            bank("a", &[0.0, 1.0]),
            explicit("k", &grid),
        );
        let case = &run(&study).cases[0];
        let on_grid: Vec<usize> = winners(case);
        assert!(on_grid.iter().all(|&w| w == 1), "{centre} {grid:?} {on_grid:?}");
        assert_eq!(case.boundaries.len(), 2, "{centre} {grid:?}");
        let half = (0.1_f64 / 0.5).sqrt();
        for (b, want) in case.boundaries.iter().zip([centre - half, centre + half]) {
            assert!((b.value - want).abs() < 1e-9, "{b:?} {want}");
        }
    }
}

#[test]
fn the_uncertainty_of_a_flat_crossing_is_large() {
    let at = tie();
    let study = |h: fn(f64) -> f64| {
        let family = scalar(move |k| at + h(k - 0.3));
        let grid = Grid::linear("k", 0.0, 1.0, 11).unwrap();
        run(&Study::new(family, bank("a", &[0.0, 1.0]), grid)).cases[0].boundaries.clone()
    };
    let steep = study(|x| 0.2 * x);
    assert_eq!(steep.len(), 1);
    assert!((steep[0].value - 0.3).abs() < 1e-9 && steep[0].uncertainty < 1e-8, "{steep:?}");
    let flat = study(|x| 0.2 * x.powi(3));
    assert_eq!(flat.len(), 1);
    let (off, claimed) = ((flat[0].value - 0.3).abs(), flat[0].uncertainty);
    assert!(claimed >= off && claimed > 1e-6 && claimed < 1e-2, "{claimed} {off}");
}

#[test]
fn plants_that_cannot_be_built_leave_the_others_alone() {
    let hole = |k: f64| if (1.7..=1.9).contains(&k) { f64::NAN } else { k };
    let grid = Grid::linear("k", 0.9, 2.3, 57).unwrap();
    let mut study = Study::new(scalar(hole), bank("a", &[0.0, 1.0]), grid);
    let sets = run(&study);
    let case = &sets.cases[0];
    assert_eq!(case.failed.len(), 8, "{:?}", case.failed);
    assert!(case.unstable.is_empty() && case.unstable_intervals.is_empty());
    let failed = &case.failed[0];
    assert!((failed.values[0] - 1.725).abs() < 1e-9);
    let message = failed.error.to_string();
    assert!(message.contains("plant at k = 1.72") && message.contains("A[0][0]"), "{message}");
    assert_eq!(case.winner[failed.plant], None);
    let [stretch] = case.failed_intervals[..] else { panic!("{:?}", case.failed_intervals) };
    assert!((stretch.from - 1.7).abs() < 1e-9 && (stretch.to - 1.9).abs() < 1e-9);
    assert_eq!(case.boundaries.len(), 1);
    assert!((case.boundaries[0].value - tie()).abs() < 1e-9);
    assert_eq!(case.sets[1].len(), 2, "around the hole");

    study.family = scalar(|_| f64::INFINITY);
    let error = study.run(&RunControl::default()).unwrap_err();
    assert!(matches!(error, Error::AllFailed { what: "plants", count: 57, .. }), "{error}");

    // what is wrong with the study, not with one plant, still ends it
    let mut names = Study::new(sensor(1.0), bank("p", &[1.0]), explicit("p", &[1.0]));
    names.surroundings.disturbance = systems::pendulum_surroundings().disturbance;
    if let Some(filter) = &mut names.surroundings.disturbance {
        filter.states.push("one too many".into());
    }
    let error = names.run(&RunControl::default()).unwrap_err().to_string();
    assert!(error.contains("names of states of disturbance"), "{error}");
    let build = |_: &[f64]| systems::tracker().plant(&[0.5, 0.5, 0.5, 0.5]);
    let few = FnFamily::new(&[("k", 1.0)], Names::default(), Time::Discrete { dt: 1.0 }, build);
    let bank = Bank::along(ObserverKind::Kalman, "k", &[1.0]);
    let study = Study::new(Arc::new(few), bank, explicit("k", &[1.0]));
    let error = study.run(&RunControl::default()).unwrap_err().to_string();
    assert!(error.contains("0 names of states"), "{error}");
}

#[test]
fn many_boundaries_on_any_threads_with_rising_progress() {
    let nominals: Vec<f64> = (0..40).map(|i| 0.92 + 0.024 * f64::from(i)).collect();
    let mut study = Study::new(
        Arc::new(systems::pendulum()),
        bank("L", &nominals),
        Grid::linear("L", 0.9, 1.9, 65).unwrap(),
    );
    study.surroundings = systems::pendulum_surroundings();
    study.convention = Convention::Ito;
    let seen = std::sync::Mutex::new(Vec::new());
    let report = |done: u64, total: u64| seen.lock().unwrap().push((done, total));
    let one = study.run(&RunControl::default().threads(1).progress(&report)).unwrap();
    let two = study.run(&RunControl::default().threads(2)).unwrap();
    assert_eq!(one.cases[0].boundaries, two.cases[0].boundaries);
    assert_eq!(one.cases[0].sets, two.cases[0].sets);
    assert_eq!(one.cases[0].boundaries.len(), 39);
    let seen = seen.into_inner().unwrap();
    assert!(seen.windows(2).all(|w| w[0].0 < w[1].0 && w[0].1 == w[1].1), "{seen:?}");
    let (last, total) = *seen.last().unwrap();
    assert!(last == total && total > 65, "{last} of {total}");
}

#[test]
fn boundaries_where_upsilon_is_negative() {
    // small noise: 1/2 ln det S makes every Upsilon negative; beyond 0.83 nothing can be built
    let family = FnFamily::new(
        &[("a", 0.5)],
        Names::numbered(1, 0, 1, 1),
        Time::Discrete { dt: 1.0 },
        |theta| {
            if theta[0] > 0.83 {
                return Err(Error::Empty { what: "plant".into() });
            }
            Ok(Plant {
                time: Time::Discrete { dt: 1.0 },
                A: mat![[theta[0]]],
                B: Mat::zeros(1, 0),
                G: mat![[1.0]],
                C: mat![[1.0]],
                Q: mat![[1e-4]],
                R: mat![[1e-4]],
            })
        },
    );
    let bank = Bank::along(ObserverKind::Kalman, "a", &[0.2, 0.4, 0.6, 0.8]);
    let grid = Grid::linear("a", 0.1, 0.95, 18).unwrap();
    let mut study = Study::new(Arc::new(family), bank, grid);
    study.verify = Verify::None;
    let by = |method: Method, study: &mut Study| {
        study.method = Some(method);
        study.run(&RunControl::default()).unwrap()
    };
    let (doubling, modal) = (by(Method::Doubling, &mut study), by(Method::Modal, &mut study));
    assert_eq!(modal.method, Method::Modal);
    let (doubling, modal) = (&doubling.cases[0], &modal.cases[0]);
    assert!(modal.upsilon.iter().any(|u| *u < 0.0));
    assert_eq!(modal.winner, doubling.winner);
    assert_eq!(modal.boundaries.len(), 3);
    for (m, d) in modal.boundaries.iter().zip(&doubling.boundaries) {
        assert!((m.value - d.value).abs() < 1e-9 && (m.left, m.right) == (d.left, d.right));
    }
    let failed = &modal.failed_intervals[0];
    assert!((failed.from - 0.83).abs() < 1e-9, "{failed:?}");
}
