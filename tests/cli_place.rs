//! `mmae place` from the outside: cells in, nominal values out.
#![cfg(feature = "cli")]

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use serde_json::Value;

fn mmae(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_mmae")).args(args).stdin(Stdio::null()).output().unwrap()
}

fn pendulum() -> String {
    format!("{}/examples/pendulum.toml", env!("CARGO_MANIFEST_DIR"))
}

#[track_caller]
fn place(args: &[&str]) -> Value {
    let file = pendulum();
    let out = mmae(&[&["place", &file, "--json"], args].concat());
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    assert!(out.stderr.is_empty(), "{}", String::from_utf8_lossy(&out.stderr));
    serde_json::from_slice(&out.stdout).unwrap()
}

fn numbers(v: &Value) -> Vec<f64> {
    v.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

#[track_caller]
fn near(got: &Value, want: &[f64], tol: f64) {
    let got = numbers(got);
    assert_eq!(got.len(), want.len(), "{got:?}");
    for (g, w) in got.iter().zip(want) {
        assert!((g - w).abs() <= tol, "{got:?} for {want:?}");
    }
}

const QUARTERS: [f64; 3] = [1.15, 1.4, 1.65];

/// The numbers of Hassani et al. (2009), corrected: the sets are the quarters of
/// 0.9 .. 1.9.
#[test]
fn four_pendulums() {
    let anchored = place(&["--cells", "4", "--anchor", "1.025"]);
    let want = [1.025, 1.279_498_399, 1.524_672_244, 1.779_770_191];
    near(&anchored["nominals"], &want, 1e-8);
    near(&anchored["edges"], &QUARTERS, 1e-9);
    near(&anchored["sensitivity"], &[1.0, -1.073, 1.149, -1.232], 1e-3);

    let canonical = place(&["--cells", "4"]);
    let want = [1.026_794_367, 1.277_573_555, 1.526_733_767, 1.777_561_227];
    near(&canonical["nominals"], &want, 1e-6);
    near(&canonical["edges"], &QUARTERS, 1e-9);
    let excess = numbers(&canonical["excess"]);
    assert_eq!(excess.len(), 5);
    let worst = |v: &Value| numbers(v).iter().fold(0.0_f64, |m, e| m.max(*e));
    assert!((excess[0] - excess[1]).abs() < 1e-6, "{excess:?}");
    assert!(worst(&canonical["excess"]) < worst(&anchored["excess"]));
    let [low, high] = numbers(&canonical["feasible"])[..] else { panic!() };
    assert!(low < 1.025 && 1.027 < high && low >= 0.9 && high <= 1.15);

    // as many as the scenario has models, and edges in either way of writing
    assert_eq!(place(&[])["nominals"], canonical["nominals"]);
    assert_eq!(place(&["--edges", "1.15,1.4,1.65"])["nominals"], canonical["nominals"]);
    let all = place(&["--edges", "0.9,1.15,1.4,1.65,1.9"]);
    assert_eq!(all["nominals"], canonical["nominals"]);
    let uneven = place(&["--edges", "1.1,1.4"]);
    near(&uneven["edges"], &[1.1, 1.4], 1e-9);
}

#[test]
fn a_bound_asks_for_as_few_models_as_keep_it() {
    let few = place(&["--excess", "50"]);
    let n = numbers(&few["nominals"]).len();
    let worst = |v: &Value| numbers(&v["excess"]).iter().fold(0.0_f64, |m, e| m.max(*e));
    assert!(worst(&few) <= 50.0 && n > 1, "{few}");
    let fewer = place(&["--cells", &(n - 1).to_string()]);
    assert!(worst(&fewer) > 50.0, "{fewer}");
}

#[test]
fn the_scenario_is_written_with_the_new_values() {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("place");
    fs::create_dir_all(&dir).unwrap();
    let path = dir.join("placed.toml");
    let _ = fs::remove_file(&path);
    let shown = path.display().to_string();
    let file = pendulum();
    let args = ["place", &file, "--cells", "3", "--out", &shown];
    assert!(mmae(&args).status.success());
    let (old, new) = (fs::read_to_string(&file).unwrap(), fs::read_to_string(&path).unwrap());
    let changed = old.lines().zip(new.lines()).filter(|(a, b)| a != b).count();
    assert_eq!((old.lines().count(), changed), (new.lines().count(), 1));
    let out = mmae(&["eip", &shown, "--json"]);
    let study: Value = serde_json::from_slice(&out.stdout).unwrap();
    let edges: Vec<f64> = study["boundaries"]
        .as_array()
        .unwrap()
        .iter()
        .map(|b| b["value"].as_f64().unwrap())
        .collect();
    for (edge, want) in edges.iter().zip([0.9 + 1.0 / 3.0, 0.9 + 2.0 / 3.0]) {
        assert!((edge - want).abs() < 1e-9);
    }
    assert_eq!(mmae(&args).status.code(), Some(6), "an earlier file is kept");
}

#[test]
fn what_cannot_be_placed_is_told() {
    let file = pendulum();
    let refuse = |args: &[&str], code: i32, words: &str| {
        let out = mmae(&[&["place", &file], args].concat());
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(code), "{said}");
        assert!(said.contains(words), "{said}");
        assert!(out.stdout.is_empty());
    };
    refuse(&["--cells", "0"], 2, "cells");
    refuse(&["--cells", "2", "--edges", "1.2"], 2, "cannot be used");
    refuse(&["--edges", "1.4,1.2"], 3, "rise");
    refuse(&["--edges", "2.5"], 3, "inside");
    refuse(&["--anchor", "1.5"], 3, "anchor");
    refuse(&["--excess", "-1"], 3, "bound");
    let two = format!("{}/examples/two_parameters.toml", env!("CARGO_MANIFEST_DIR"));
    let out = mmae(&["place", &two, "--anchor", "1"]);
    assert_eq!(out.status.code(), Some(3));
    assert!(String::from_utf8_lossy(&out.stderr).contains("several parameters"));
    // one plant more than may be nominal values
    let out = mmae(&["place", &two]);
    assert_eq!(out.status.code(), Some(7));
    assert!(String::from_utf8_lossy(&out.stderr).contains("coarser grid"));
}
