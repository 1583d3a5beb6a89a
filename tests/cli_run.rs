//! `mmae run` from the outside: scenarios in, tables of trials out.
#![cfg(feature = "cli")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use serde_json::Value;

fn run(args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mmae"));
    command.arg("run").args(args).stdin(Stdio::null()).output().unwrap()
}

fn mmae(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_mmae")).args(args).stdin(Stdio::null()).output().unwrap()
}

fn file(name: &str, text: &str) -> String {
    let path = folder(name);
    fs::write(&path, text).unwrap();
    path.display().to_string()
}

fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).unwrap()
}

fn example(name: &str) -> String {
    format!("{}/examples/{name}.toml", env!("CARGO_MANIFEST_DIR"))
}

fn folder(name: &str) -> PathBuf {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("run");
    fs::create_dir_all(&dir).unwrap();
    dir.join(name)
}

fn json(args: &[&str]) -> Value {
    let out = run(&[args, &["--json"]].concat());
    assert!(out.status.success(), "{}", text(&out.stderr));
    serde_json::from_slice(&out.stdout).unwrap()
}

fn numbers(v: &Value) -> Vec<f64> {
    v.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

/// Some of the published table, through the command.
#[test]
fn the_examples_have_the_published_fractions() {
    for (case, law, truth, at_50, at_end) in [
        (1, "bayes", 2, 0.955, 0.999),
        (1, "zhang1", 2, 0.903, 0.973),
        (2, "zhang2", 2, 1.0, 1.0),
        (3, "zhang2", 0, 0.676, 0.767),
        (4, "bayes", 0, 0.652, 0.770),
    ] {
        let file = example(&format!("tracker_case{case}"));
        let args = [&file, "--trials", "4000", "--seed", "1", "--weighting", law];
        let got = json(&args);
        assert_eq!((got["trials"].as_u64(), got["steps"].as_u64()), (Some(4000), Some(200)));
        let record = got["record"].as_array().unwrap();
        assert_eq!(record.len(), 20);
        let fifty = record.iter().find(|r| r["k"] == 50).unwrap();
        for (identified, want) in [(&fifty["identified"], at_50), (&got["identified"], at_end)] {
            let fraction = numbers(identified)[truth];
            assert!((fraction - want).abs() < 0.025, "case {case} {law}: {fraction} for {want}");
        }
        assert_eq!(record[19]["p"], got["p"]);
        assert_eq!(got["theta_hat"].as_array().unwrap().len(), 1);
        assert!(got["per_trial"].is_null());
    }
}

#[test]
fn seeds_threads_and_few_trials() {
    let file = example("tracker_case3");
    let base = [&file[..], "--trials", "100"];
    let one = json(&[&base[..], &["--threads", "1"]].concat());
    assert_eq!(one, json(&[&base[..], &["--threads", "3"]].concat()));
    assert_ne!(one, json(&[&base[..], &["--seed", "2"]].concat()));
    let few = json(&[&file, "--trials", "3"]);
    let each = few["per_trial"].as_array().unwrap();
    assert_eq!(each.len(), 3);
    for i in 0..4 {
        let mean = each.iter().map(|t| numbers(&t["p"])[i]).sum::<f64>() / 3.0;
        assert!((mean - numbers(&few["p"])[i]).abs() < 1e-12);
        let mean = each.iter().map(|t| numbers(&t["log_weights"])[i]).sum::<f64>() / 3.0;
        let got = numbers(&few["log_weights"])[i];
        assert!((mean - got).abs() < 1e-9 * got.abs().max(1.0));
    }
}

#[test]
fn another_truth_is_identified() {
    let file = example("tracker_case1");
    let best = |args: &[&str]| {
        let got = json(&[&[&file[..], "--trials", "50"], args].concat());
        let fractions = numbers(&got["identified"]);
        (0..4).max_by(|&i, &j| fractions[i].total_cmp(&fractions[j])).unwrap()
    };
    assert_eq!(best(&["--truth", "model=1"]), 0);
    assert_eq!(best(&["--truth", "rho=1.013"]), 3);
    let out = run(&[&file, "--truth", "rh=1"]);
    assert_eq!(out.status.code(), Some(3), "{}", text(&out.stderr));
    assert!(text(&out.stderr).contains("truth.parameters.rh"), "{}", text(&out.stderr));
    let out = run(&[&file, "--truth", "model=5"]);
    assert_eq!(out.status.code(), Some(3));
    for wrong in ["rho", "rho=abc", "rho=inf"] {
        assert_eq!(run(&[&file, "--truth", wrong]).status.code(), Some(2));
    }
}

#[test]
fn a_plant_that_changes_and_a_continuous_one() {
    let tracker = fs::read_to_string(example("tracker_case1")).unwrap();
    let path = folder("switch.toml");
    let switching = tracker
        .replace("model = 3", "model = [[0, 3], [60, 2]]")
        .replace("law = \"bayes\" # or \"zhang1\", \"zhang2\"", "mixing = \"imm\"\nstay = 0.98");
    fs::write(&path, switching).unwrap();
    let got = json(&[&path.display().to_string(), "--trials", "40"]);
    let at = |k: u64| {
        let record = got["record"].as_array().unwrap();
        numbers(&record.iter().find(|r| r["k"] == k).unwrap()["p"])
    };
    assert!(at(50)[2] > 0.5, "{:?}", at(50));
    assert!(at(150)[1] + at(150)[0] > 0.5, "{:?}", at(150));

    let path = folder("spring.toml");
    fs::write(
        &path,
        "format = 1\n[plant]\ntime = \"continuous\"\nstates = [\"x\", \"v\"]\noutputs = [\"x\"]\n\
         disturbances = [\"w\"]\nA = [[0, 1], [\"-k\", -0.4]]\nG = [0, 1]\nC = [1, 0]\nQ = 1\n\
         R = 0.001\n[plant.parameters]\nk = 2\n[bank]\nmodels = { k = [1, 2, 4] }\ndt = 0.01\n\
         [truth]\nparameters = { k = 4 }\n[run]\nduration = 100\ntrials = 10\n",
    )
    .unwrap();
    let got = json(&[&path.display().to_string()]);
    assert_eq!(got["steps"], 10_000);
    assert!(numbers(&got["identified"])[2] > 0.85, "{}", got["identified"]);
}

#[test]
fn mistakes_and_results() {
    let file = example("tracker_case1");
    for (name, from, to, needle) in [
        ("steps", "steps = 200\n", "", "run.steps: missing"),
        ("both", "steps = 200", "steps = 200\nduration = 3", "both steps and duration"),
        ("model", "model = 3", "model = 5", "not the number of a model"),
        ("name", "model = 3", "parameters = { rh = 1 }", "no parameter is called 'rh'"),
        ("times", "model = 3", "model = [[1, 3]]", "the times do not rise from 0"),
        ("ramp", "model = 3", "parameters = { rho = { ramp = [[0, 1], [0, 2]] } }", "do not rise"),
        ("slope", "model = 3", "parameters = { rho = { slope = 2 } }", "unknown key"),
        ("glide", "model = 3", "model = { ramp = [[0, 1], [10, 3]] }", "[time, number]"),
        ("kick", "[truth]", "[actuator]\ndelay = 0.5\n[truth]", "actuator.delay"),
        ("x0", "model = 3", "model = 3\nx0 = [1]", "1 numbers for 4 states"),
        ("run", "[run]", "[runs]", "unknown key"),
    ] {
        let path = folder(&format!("{name}.toml"));
        fs::write(&path, fs::read_to_string(&file).unwrap().replace(from, to)).unwrap();
        let out = run(&[&path.display().to_string()]);
        assert_eq!(out.status.code(), Some(3), "{name}: {}", text(&out.stderr));
        assert!(text(&out.stderr).contains(needle), "{name}: {}", text(&out.stderr));
    }
    let dir = folder("result");
    let _ = fs::remove_dir_all(&dir);
    let dir = dir.display().to_string();
    let out = run(&[&file, "--trials", "20", "--out", &dir]);
    assert!(out.status.success(), "{}", text(&out.stderr));
    assert!(text(&out.stdout).contains("20 trials of 200 steps, 4 models, law bayes, seed 1."));
    let saved: Value =
        serde_json::from_str(&fs::read_to_string(format!("{dir}/run.json")).unwrap()).unwrap();
    assert_eq!(saved, json(&[&file, "--trials", "20"]));
    assert!(Path::new(&format!("{dir}/manifest.json")).exists());
    for (picture, needle) in
        [("weights", "bands of 50 %"), ("errors", "root mean square"), ("trial", "x residual")]
    {
        let svg = fs::read_to_string(format!("{dir}/{picture}.svg")).unwrap();
        assert!(svg.contains(needle) && svg.trim_end().ends_with("</svg>"), "{picture}");
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{picture}");
    }
    assert_eq!(run(&[&file, "--trials", "20", "--out", &dir]).status.code(), Some(6));
    let pendulum = run(&[&example("pendulum")]);
    assert_eq!(pendulum.status.code(), Some(3));
}

const WALK: &str = "format = 1\n[plant]\ntime = \"discrete\"\ndt = 1\nstates = [\"x\"]\n\
    disturbances = [\"w\"]\noutputs = [\"y\"]\nA = \"a\"\nG = 1\nC = 1\nQ = 1\nR = 1\n\
    [plant.parameters]\na = 0.9\n[bank]\nmodels = { a = [0.5, 0.9] }\n";

/// A known noise is there when the measurement is taken.
#[test]
fn known_noise_comes_with_its_measurement() {
    for (start, jump) in [("step-before", 5), ("first-measurement", 6)] {
        let text = format!(
            "{WALK}start = \"{start}\"\n[signals.disturbances]\nw = 0\n[signals.noise]\n\
             y = {{ wave = \"table\", t = [0, 5], value = [0, 100] }}\n[run]\nsteps = 8\nevery = 1\n"
        );
        let out = run(&[&file("noise.toml", &text), "--json"]);
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
        let got: Value = serde_json::from_slice(&out.stdout).unwrap();
        for row in got["record"].as_array().unwrap() {
            let (k, nis) = (row["k"].as_u64().unwrap(), row["nis"][0].as_f64().unwrap());
            assert_eq!(nis > 1.0, k >= jump, "{start}, step {k}: {nis}");
        }
    }
}

#[test]
fn what_cannot_run_does_not_pass_the_check() {
    let refuse = |name: &str, text: &str, code: i32, key: &str, words: &str| {
        let path = file(name, text);
        for command in ["run", "check"] {
            let out = mmae(&[command, &path]);
            let said = String::from_utf8_lossy(&out.stderr).into_owned();
            assert_eq!(out.status.code(), Some(code), "{command}: {said}");
            assert!(said.contains(key) && said.contains(words), "{command}: {said}");
        }
    };
    let short = format!("{WALK}[run]\nduration = 0.1\n");
    refuse("short.toml", &short, 3, "run.duration", "0 steps");
    let unsampled = format!("{WALK}[run]\nsteps = 5\nmeasurement = \"continuous\"\n");
    refuse("unsampled.toml", &unsampled, 3, " run", "sampled measurement");
    // more jumps than can be prepared: told at once
    let example = format!("{}/examples/oscillator.toml", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(example).unwrap();
    for period in ["1e-300", "1e-9"] {
        let text = text.replace("period = 10 }", &format!("period = {period} }}"));
        refuse("jumps.toml", &text, 7, "run", "switches");
    }
}

#[test]
fn a_bank_that_has_run_away_identifies_nothing() {
    let text = WALK
        .replace("A = \"a\"", "A = \"4*a\"")
        .replace("a = 0.9\n[bank]", "a = 0.1\n[bank]")
        .replace("[0.5, 0.9]", "[0.1, 0.2]");
    let text = format!("{text}[truth]\nparameters = {{ a = 1000 }}\n[run]\nsteps = 200\n");
    let out = run(&[&file("away.toml", &text)]);
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(4), "{said}");
    assert!(said.contains("run away"), "{said}");
}
