//! Placement: penalties of the state, several parameters, pictures.

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::sync::Arc;

use mmae::eip::{Bank, Cells, Study, Verify};
use mmae::model::{Axis, Grid, systems};
use mmae::observer::ObserverKind;
use mmae::par::RunControl;
use serde_json::Value;

fn oscillator(points: usize) -> Study {
    let bank = Bank::along(ObserverKind::KalmanBucy, "wn", &[1.0, 2.0]);
    let axis = |from, to| Axis::Linear { from, to, points };
    let axes = vec![("wn".into(), axis(0.7, 3.0)), ("zeta".into(), axis(0.1, 0.5))];
    let mut study = Study::new(Arc::new(systems::oscillator()), bank, Grid::new(axes).unwrap());
    study.verify = Verify::None;
    study
}

#[test]
fn the_descent_ends_where_no_single_move_is_better() {
    let study = oscillator(7);
    let placed = study.scatter(Some(5), &RunControl::default()).unwrap();
    assert!(placed.converged);
    assert!(placed.descent.windows(2).all(|w| w[1] <= w[0]), "{:?}", placed.descent);
    // the cells are those of a study with these models, and so are the excesses
    let mut check = study.clone();
    check.bank.parameters = placed.parameters.clone();
    check.bank.models = placed.nominals.clone();
    let sets = check.run(&RunControl::default()).unwrap();
    assert_eq!(sets.cases[0].winner, placed.cells);
    let mut own = study.clone();
    own.bank.parameters = placed.parameters.clone();
    own.bank.models = (0..study.grid.len()).map(|k| study.grid.point(k)).collect();
    let own = own.run(&RunControl::default()).unwrap();
    let n = study.grid.len();
    let all = &own.cases[0].upsilon;
    let cost = |c: usize, cell: &[usize]| -> f64 { cell.iter().map(|p| all[p * n + c]).sum() };
    let mut total = 0.0;
    for (i, &centre) in placed.plants.iter().enumerate() {
        let cell: Vec<usize> = (0..n).filter(|p| placed.cells[*p] == Some(i)).collect();
        let now = cost(centre, &cell);
        assert!(cell.iter().all(|&c| cost(c, &cell) >= now - 1e-9 * now.abs()));
        total += cell.iter().map(|&p| all[p * n + centre] - all[p * n + p]).sum::<f64>();
    }
    let last = *placed.descent.last().unwrap();
    assert!((total / n as f64 - last).abs() < 1e-9 * last.abs());
    // from the bank's own models
    let from_bank = study.scatter(None, &RunControl::default()).unwrap();
    assert_eq!(from_bank.nominals.len(), 2);
    for bad in [0, 1000] {
        assert!(study.scatter(Some(bad), &RunControl::default()).is_err());
    }
}

#[test]
fn a_state_penalty_is_zero_for_the_own_model_and_bounds_the_number_of_cells() {
    let bank = Bank::along(ObserverKind::KalmanBucy, "wn", &[1.0]);
    let grid = Grid::linear("wn", 0.8, 1.6, 9).unwrap();
    let mut study = Study::new(Arc::new(systems::oscillator()), bank, grid);
    study.verify = Verify::None;
    let control = RunControl::default();
    let at = |cells: usize| study.place(&Cells::Count(cells), None, &control).unwrap();
    let worst = |p: &mmae::eip::Placement| p.penalty.iter().copied().fold(0.0, f64::max);
    let (two, three) = (at(2), at(3));
    assert!(worst(&three) < worst(&two), "{:?} {:?}", two.penalty, three.penalty);
    assert!(two.penalty.iter().all(|v| *v > 0.0));
    let bound = 0.5 * (worst(&two) + worst(&three));
    let placed = study.place(&Cells::Penalty(bound), None, &control).unwrap();
    assert_eq!(placed.nominals, three.nominals);
    // a model of the very plant costs nothing
    let edge = at(1).nominals[0];
    let mut own = study.clone();
    own.grid = Grid::linear("wn", edge * (1.0 - 1e-9), edge * (1.0 + 1e-9), 2).unwrap();
    let own = own.place(&Cells::Count(1), None, &control).unwrap();
    assert!(worst(&own).abs() < 1e-9, "{:?}", own.penalty);
}

fn mmae(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_mmae")).args(args).stdin(Stdio::null()).output().unwrap()
}

fn example(name: &str) -> String {
    format!("{}/examples/{name}.toml", env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn the_command_places_in_two_parameters_and_draws_one() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("analysis_place");
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    let scenario = fs::read_to_string(example("two_parameters")).unwrap();
    let coarse: String = scenario.lines().map(|l| coarser(l) + "\n").collect();
    let file = folder.join("two.toml").display().to_string();
    fs::write(&file, coarse).unwrap();
    let placed = folder.join("placed.toml").display().to_string();
    let out = mmae(&["place", &file, "--cells", "3", "--json", "--out", &placed]);
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let json: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(json["nominals"].as_array().unwrap().len(), 3);
    assert_eq!(json["converged"], true);
    // the scenario that was written has these models
    let out = mmae(&["eip", &placed, "--json"]);
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let study: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(study["models"], json["nominals"]);
    assert_eq!(study["winner"], json["cells"]);
    let out = mmae(&["place", &file, "--anchor", "1"]);
    assert_eq!(out.status.code(), Some(3));
    assert!(String::from_utf8_lossy(&out.stderr).contains("--anchor"));

    let picture = folder.join("place.svg").display().to_string();
    let out = mmae(&["place", &example("pendulum"), "--cells", "4", "--picture", &picture]);
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let svg = fs::read_to_string(&picture).unwrap();
    assert!(svg.contains("before: L = 1.025") && svg.contains("after: L = 1.02679"), "{svg}");
    let again = mmae(&["place", &example("pendulum"), "--cells", "4", "--picture", &picture]);
    assert_eq!(again.status.code(), Some(6), "the picture is not overwritten");
}

/// Fewer points of a grid.
fn coarser(line: &str) -> String {
    match line.split_once("points = ") {
        Some((head, tail)) => {
            let rest = tail.trim_start_matches(|c: char| c.is_ascii_digit());
            format!("{head}points = 6{rest}")
        }
        None => line.into(),
    }
}
