//! What the weights settle on, against the reference numbers and simulations.

use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;

use mmae::eip::{Bank, Convention, Identification, OutcomeKind, Study, Verify, WeightLaw};
use mmae::model::{Axis, Grid, systems};
use mmae::observer::ObserverKind;
use mmae::par::RunControl;
use serde_json::Value;

const NOMINALS: [f64; 4] = [1.025, 1.287, 1.526, 1.778];

fn pendulum(nominals: &[f64], grid: Grid, tempering: f64) -> Study {
    let bank = Bank::along(ObserverKind::KalmanBucy, "L", nominals);
    let mut study = Study::new(Arc::new(systems::pendulum()), bank, grid);
    study.surroundings = systems::pendulum_surroundings();
    study.verify = Verify::None;
    study.convention = Convention::Baram { dt: 1e-3 };
    study.law = Some(WeightLaw::Dwsg { lambda: 1.0, tempering, dt: None });
    study
}

fn identify(study: &Study) -> Identification {
    study.run(&RunControl::default()).unwrap().identification.unwrap()
}

fn reference() -> Value {
    serde_json::from_str(include_str!("../data/pendulum.json")).unwrap()
}

#[test]
fn invasion_exponents_and_mixtures_of_a_pair() {
    let reference = reference();
    for row in reference["dwsg_theory"]["table"].as_array().unwrap() {
        let number = |key: &str| row[key].as_f64().unwrap();
        let (length, theta) = (number("L"), number("theta"));
        let axis = Axis::Explicit(vec![length]);
        let grid = Grid::new(vec![("L".into(), axis)]).unwrap();
        let found = identify(&pendulum(&NOMINALS[..2], grid, theta));
        let outcome = found.outcomes[0].as_ref().unwrap();
        let mean = number(if outcome.model == 0 { "E_l2_over_l1" } else { "E_l1_over_l2" });
        let p = number("pstar1");
        assert!((outcome.exponent - (mean - 1.0)).abs() < 1e-9, "{row}: {outcome:?}");
        assert!((outcome.weights[0] - p).abs() < 1e-6, "{row}: {outcome:?}");
        let averages = p > 0.0 && p < 1.0;
        let kind = if averages { OutcomeKind::Averages } else { OutcomeKind::Identifies };
        assert_eq!(outcome.kind, kind, "{row}");
    }
}

#[test]
fn bands_without_a_stable_model_shrink_with_the_tempering() {
    let reference = reference();
    let bands = &reference["dwsg_theory"]["no_stable_vertex_band_dt1ms"];
    let found = identify(&pendulum(&NOMINALS, Grid::linear("L", 0.9, 1.9, 16).unwrap(), 0.01));
    let mut width = f64::INFINITY;
    assert_eq!(found.bands.len(), 5);
    for band in &found.bands {
        let key = match band.tempering {
            1.0 => {
                // the bands touch at the nominal values
                let [all] = &band.intervals[..] else { panic!("{band:?}") };
                assert!((all.from - 1.025).abs() < 1e-6 && (all.to - 1.778).abs() < 1e-6);
                continue;
            }
            t => t.to_string(),
        };
        let want = bands[&key].as_array().unwrap();
        assert_eq!(band.intervals.len(), want.len(), "{key}");
        for (got, want) in band.intervals.iter().zip(want) {
            let digits = if key == "0.5" { 2e-5 } else { 1e-5 };
            assert!((got.from - want[0].as_f64().unwrap()).abs() < digits, "{key} {got:?} {want}");
            assert!((got.to - want[1].as_f64().unwrap()).abs() < digits, "{key} {got:?} {want}");
        }
        let sum: f64 = band.intervals.iter().map(|i| i.to - i.from).sum();
        assert!(sum < width);
        width = sum;
    }
    // the stretches tile the grid
    let all: f64 = found.stretches.iter().map(|s| s.interval.to - s.interval.from).sum();
    assert!((all - 1.0).abs() < 1e-12);
}

#[test]
fn the_oscillator_averages_under_the_differential_equation() {
    let bank = Bank::along(ObserverKind::KalmanBucy, "wn", &[0.7, 1.0, 2.0, 4.0]);
    let axis = Axis::Explicit(vec![0.7, 1.2, 2.7]);
    let grid = Grid::new(vec![("wn".into(), axis)]).unwrap();
    let mut study = Study::new(Arc::new(systems::oscillator()), bank, grid);
    study.law = Some(WeightLaw::Ode);
    let sets = study.run(&RunControl::default()).unwrap();
    let found = sets.identification.as_ref().unwrap();
    // diagonal of Gamma, likelihood winner, mixtures for smooth and for held noise
    let rows = [
        ([4.9948, 6.1258, 10.9958, 18.3324], 0, [1.0, 0.0, 0.0, 0.0], [0.390, 0.0, 0.0, 0.610]),
        (
            [23.197, 9.0083, 11.238, 19.217],
            1,
            [0.0, 0.6571, 0.3429, 0.0],
            [0.173, 0.120, 0.0, 0.707],
        ),
        (
            [955.96, 278.53, 22.054, 19.786],
            3,
            [0.0, 0.0, 0.4406, 0.5594],
            [0.0, 0.017, 0.155, 0.828],
        ),
    ];
    for (k, (gamma, winner, smooth, held)) in rows.into_iter().enumerate() {
        let upsilon = &sets.cases[0].upsilon[4 * k..4 * k + 4];
        for (u, g) in upsilon.iter().zip(gamma) {
            assert!((2.0 * u / g - 1.0).abs() < 5e-5, "{upsilon:?}");
        }
        assert_eq!(sets.cases[0].winner[k], Some(winner));
        let outcome = found.outcomes[k].as_ref().unwrap();
        for (got, want) in outcome.smooth.as_ref().unwrap().iter().zip(smooth) {
            assert!((got - want).abs() < 6e-5, "{outcome:?}");
        }
        for (got, want) in outcome.weights.iter().zip(held) {
            assert!((got - want).abs() < 6e-4, "{outcome:?}");
        }
        // the corrected lemma bounds the mixture of smooth noise
        let lemma = outcome.lemma.unwrap();
        assert!(outcome.smooth.as_ref().unwrap()[winner] >= lemma.bound, "{lemma:?}");
        assert!((lemma.eps - 2.0 * upsilon[winner]).abs() < 1e-8 * lemma.eps);
        assert_eq!(outcome.kind, OutcomeKind::Averages);
    }
}

#[test]
fn the_posterior_moves_at_the_margin() {
    let mut study = pendulum(&NOMINALS, Grid::linear("L", 0.9, 1.9, 6).unwrap(), 1.0);
    study.convention = Convention::Ito;
    study.law = Some(WeightLaw::Posterior);
    let sets = study.run(&RunControl::default()).unwrap();
    let found = sets.identification.as_ref().unwrap();
    for (k, outcome) in found.outcomes.iter().enumerate() {
        let outcome = outcome.as_ref().unwrap();
        assert_eq!(outcome.exponent, -sets.cases[0].margin[k]);
        assert_eq!(Some(outcome.model), sets.cases[0].winner[k]);
        assert_eq!(outcome.kind, OutcomeKind::Identifies);
    }
    assert_eq!(found.stretches.len(), 4);
}

#[test]
fn laws_without_what_they_need_are_refused() {
    let mut study = pendulum(&NOMINALS, Grid::linear("L", 0.9, 1.9, 3).unwrap(), 1.0);
    study.convention = Convention::Ito;
    let error = study.run(&RunControl::default()).unwrap_err().to_string();
    assert!(error.contains("without a sampling interval"), "{error}");
}

fn mmae(args: &[&str]) -> Value {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mmae"));
    let out = command.args(args).arg("--json").stdin(Stdio::null()).output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    serde_json::from_slice(&out.stdout).unwrap()
}

/// `mmae eip` says what the weights do, and `mmae run` does it.
#[test]
fn simulations_confirm_what_the_study_says() {
    let example = format!("{}/examples/pendulum_weights.toml", env!("CARGO_MANIFEST_DIR"));
    assert!(Path::new(&example).exists());
    let study = mmae(&["eip", &example]);
    let found = &study["identification"];
    assert_eq!(found["law"], "dwsg");
    let grid = study["grid"].as_array().unwrap();
    for (length, outcome, model) in [
        (1.0, "identifies", 0),
        (1.15, "averages", 0),
        (1.6, "averages", 2),
        (1.85, "identifies", 3),
    ] {
        let near = |v: &Value| (v.as_f64().unwrap() - length).abs() < 1e-9;
        let k = grid.iter().position(near).unwrap();
        assert_eq!((&found["outcome"][k], &found["model"][k]), (&outcome.into(), &model.into()));
        let run = mmae(&["run", &example, "--truth", &format!("L={length}")]);
        let p: Vec<f64> =
            run["p"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
        let most = p.iter().copied().fold(0.0, f64::max);
        if outcome == "identifies" {
            assert!(p[model] > 0.99, "L = {length}: {p:?}");
        } else {
            // the two models of the mixture share the weight
            let want = &found["weights"][k];
            assert!(most < 0.9, "L = {length}: {p:?}, expected {want}");
            for (p, want) in p.iter().zip(want.as_array().unwrap()) {
                assert!((p - want.as_f64().unwrap()).abs() < 0.15, "L = {length}: {p:?} {found}");
            }
        }
    }
    // the posterior picks one model where the generator does not
    let run = mmae(&["run", &example, "--truth", "L=1.1", "--weighting", "bayes"]);
    assert!(run["p"][0].as_f64().unwrap() > 0.99, "{}", run["p"]);
}
