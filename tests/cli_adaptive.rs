//! Adaptive observers from the outside: scenarios and records in, estimates out.
#![cfg(feature = "cli")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use mmae::adaptive::Tuning;
use mmae::par::RunControl;
use mmae::scenario::Scenario;
use serde_json::Value;

fn mmae(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_mmae")).args(args).stdin(Stdio::null()).output().unwrap()
}

fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).unwrap()
}

fn example(name: &str) -> String {
    format!("{}/examples/{name}.toml", env!("CARGO_MANIFEST_DIR"))
}

fn folder(name: &str) -> PathBuf {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("adaptive");
    fs::create_dir_all(&dir).unwrap();
    dir.join(name)
}

fn file(name: &str, text: &str) -> String {
    let path = folder(name);
    fs::write(&path, text).unwrap();
    path.display().to_string()
}

fn json(args: &[&str]) -> Value {
    let out = mmae(&[args, &["--json"]].concat());
    assert!(out.status.success(), "{}", text(&out.stderr));
    serde_json::from_slice(&out.stdout).unwrap()
}

fn numbers(v: &Value) -> Vec<f64> {
    v.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

/// Largest relative difference.
fn apart(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| ((a - b) / b).abs()).fold(0.0, f64::max)
}

#[test]
fn example_4_1_identifies_its_four_parameters() {
    let got = json(&["run", &example("adaptive_nonlinear")]);
    assert_eq!(got["schema"], "mmae.adaptive/1");
    assert_eq!(got["samples"], 12_001);
    let theta = numbers(&got["theta_hat"]);
    assert!(apart(&theta, &[3.0, -3.0, 4.5, -4.0]) < 0.01, "{theta:?}");
    assert_eq!(numbers(&got["theta"]), [3.0, -3.0, 4.5, -4.0]);
    let one = &got["observers"][0];
    assert_eq!(one["record"].as_array().unwrap().len(), 12);
    assert!(one["truth_error"].as_f64().unwrap() < 1e-11);
    // at 60 s the sampled observer is that of the reference to its order
    let sixty = numbers(&one["record"][5]["theta_hat"]);
    let want = [2.9240183493, -2.8782013488, 4.3767295453, -3.7132487472];
    assert!(apart(&sixty, &want) < 1e-4, "{sixty:?}");
    let x = numbers(&one["record"][11]["x"]);
    let x_hat = numbers(&one["record"][11]["x_hat"]);
    assert!(x.iter().zip(&x_hat).all(|(a, b)| (a - b).abs() < 2e-3), "{x:?} {x_hat:?}");
}

#[test]
fn example_4_2_is_identified_in_canonical_form_and_refused_as_posed() {
    let out = mmae(&["run", &example("vehicle"), "--json"]);
    assert!(out.status.success(), "{}", text(&out.stderr));
    let said = text(&out.stderr);
    assert!(said.contains("v_y -> alpha v_y + beta r leaves y unchanged"), "{said}");
    let got: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(got["refused"][0]["observer"], "as_posed");
    assert_eq!(got["refused"][0]["code"], "not_identifiable");
    let truth = [13.41417, 41.61957, 39.53694, 230.04811];
    assert!(apart(&numbers(&got["theta"]), &truth) < 1e-6);
    assert!(apart(&numbers(&got["theta_hat"]), &truth) < 0.01);
    let all = got["observers"].as_array().unwrap();
    let case = |name: &str| all.iter().find(|o| o["case"] == name).unwrap();
    let nominal = [22.37656, 131.40503, 60.46452, 633.89705];
    assert!(apart(&numbers(&case("nominal")["theta_hat"]), &nominal) < 0.01);
    for name in ["perturbed", "nominal"] {
        let behind = &case(name)["physical"];
        let (value, truth) = (numbers(&behind["value"]), numbers(&behind["truth"]));
        assert!(apart(&value, &truth) < 0.05, "{name}: {value:?} {truth:?}");
    }
    // with noise on the regressors the estimates are biased
    let d0 = |name: &str| numbers(&case(name)["theta_hat"])[1] / truth[1] - 1.0;
    let (r, u) = (d0("noise_of_r"), d0("noise_of_u"));
    assert!(r < -0.3 && u < -0.3, "{r} {u}");
}

#[test]
fn a_result_has_pictures_and_the_rows_that_were_asked_for() {
    let dir = folder("result");
    let _ = fs::remove_dir_all(&dir);
    let place = dir.display().to_string();
    let out = mmae(&["run", &example("adaptive_nonlinear"), "--out", &place]);
    assert!(out.status.success(), "{}", text(&out.stderr));
    assert!(text(&out.stdout).contains("da2"));
    let whole: Value = serde_json::from_slice(&fs::read(dir.join("run.json")).unwrap()).unwrap();
    assert_eq!(whole["observers"][0]["record"].as_array().unwrap().len(), 12);
    for name in ["parameters.svg", "states.svg"] {
        assert!(fs::read_to_string(dir.join(name)).unwrap().contains("</svg>"), "{name}");
    }
    assert!(dir.join("manifest.json").exists());
    // nothing is replaced without being asked
    let again = mmae(&["run", &example("adaptive_nonlinear"), "--out", &place]);
    assert_eq!(again.status.code(), Some(6));
}

#[test]
fn trials_do_not_depend_on_threads() {
    let noisy = fs::read_to_string(example("adaptive_nonlinear")).unwrap();
    let noisy = noisy.replace("x0 = [0, 0]", "x0 = [0, 0]\nnoise = { y = 0.001 }");
    let noisy = noisy.replace("duration = 120", "duration = 20");
    let path = file("noisy.toml", &noisy);
    let run = |threads: &str| {
        let args = ["run", &path, "--json", "--trials", "20", "--threads", threads];
        mmae(&args).stdout
    };
    let one = run("1");
    assert_eq!(one, run("3"));
    let got: Value = serde_json::from_slice(&one).unwrap();
    assert_eq!(got["trials"], 20);
    assert!(numbers(&got["observers"][0]["theta_spread"]).iter().all(|s| *s > 0.0));
    let quantiles = &got["observers"][0]["record"][1]["theta_quantiles"][0];
    assert!(numbers(quantiles).windows(2).all(|w| w[0] <= w[1]));
}

/// Courses of every trial have the noise and the bits of the run, whatever is run beside.
#[test]
fn courses_of_trials_are_those_of_the_run() {
    let noisy = fs::read_to_string(example("adaptive_nonlinear")).unwrap();
    let noisy = noisy.replace("x0 = [0, 0]", "x0 = [0, 0]\nnoise = { y = 0.001 }");
    let noisy = noisy.replace("duration = 120", "duration = 20\ntrials = 11");
    let scenario = Scenario::parse("noisy.toml", &noisy).unwrap();
    let trials = &scenario.adaptive_cases(&[]).unwrap()[0].trials[0];
    let control = RunControl::default().threads(2);
    let run = trials.run(&control).unwrap();
    let own = trials.tuning.clone();
    let other = Tuning { lambda: 0.5, ..own.clone() };
    let all = trials.courses(&[other, own], 0.02, &control).unwrap();
    let (reports, p, n) = (all.t.len(), 4, 2);
    assert_eq!(reports, run.record.len());
    for (r, moment) in run.record.iter().enumerate() {
        assert_eq!(all.t[r], moment.t);
        // of the second tuning, trial by trial
        let row = |trial: usize| (11 + trial) * reports + r;
        for i in 0..p {
            let sum: f64 = (0..11).map(|j| all.courses.theta[row(j) * p + i]).sum();
            assert_eq!(sum / 11.0, moment.mean[i]);
        }
        let first = &run.course[r];
        assert_eq!(all.courses.x_hat[row(0) * n..][..n], first.estimate.x_hat[..]);
        assert_eq!(all.courses.y[r..][..1], first.y[..]);
        assert_eq!(all.x[r * n..][..n], first.x[..]);
    }
}

#[test]
fn a_record_gives_the_estimates_of_its_run() {
    // what the run of the same observer saw, written down
    let (h, steps) = (0.01, 6001);
    let mut x = [0.0_f64; 2];
    let u = |t: f64| 1.1 * (0.3 * t).sin() + 1.2 * t.sin() + (1.5 * t).sin();
    let flow =
        |t: f64, x: [f64; 2]| [x[1], -4.0 * x[0] - 5.0 * x[1] + 4.5 * u(t) - 4.0 * x[0].sin()];
    let mut csv = String::from("t,u,y\n");
    for k in 0..steps {
        let t = f64::from(k) * h;
        let missing = k % 1000 == 999;
        let y = if missing { String::new() } else { x[0].to_string() };
        // a row that is left out altogether is a gap
        if k != 2500 {
            csv.push_str(&format!("{t},{},{y}\n", u(t)));
        }
        for part in 0..4 {
            let (t, h) = (t + f64::from(part) * h / 4.0, h / 4.0);
            let at = |k: [f64; 2], s: f64| [x[0] + s * h * k[0], x[1] + s * h * k[1]];
            let a = flow(t, x);
            let b = flow(t + h / 2.0, at(a, 0.5));
            let c = flow(t + h / 2.0, at(b, 0.5));
            let d = flow(t + h, at(c, 1.0));
            for i in 0..2 {
                x[i] += h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]);
            }
        }
    }
    let data = file("record.csv", &csv);
    let scenario = example("adaptive_nonlinear");
    let got = json(&["estimate", &scenario, "--data", &data, "--every", "2000"]);
    assert_eq!(got["samples"], 6001);
    let want = [2.9240183493, -2.8782013488, 4.3767295453, -3.7132487472];
    // seven samples were missing
    let theta = numbers(&got["theta_hat"]);
    assert!(apart(&theta, &want) < 0.02, "{theta:?}");
    assert_eq!(got["observers"][0]["record"].as_array().unwrap().len(), 3);
    let dir = folder("estimate");
    let _ = fs::remove_dir_all(&dir);
    let place = dir.display().to_string();
    let out = mmae(&["estimate", &scenario, "--data", &data, "--out", &place]);
    assert!(out.status.success(), "{}", text(&out.stderr));
    assert!(dir.join("estimate.json").exists() && dir.join("states.svg").exists());
    // times that do not fit the interval
    let uneven = file("uneven.csv", "t,u,y\n0,0,0\n0.01,0,0\n0.025,0,0\n");
    let out = mmae(&["estimate", &scenario, "--data", &uneven]);
    assert_eq!(out.status.code(), Some(3));
    assert!(text(&out.stderr).contains("uneven.csv:4:1: t:"), "{}", text(&out.stderr));
}

#[test]
fn the_check_tells_what_can_be_used() {
    let out = mmae(&["check", &example("adaptive_nonlinear")]);
    assert!(out.status.success(), "{}", text(&out.stderr));
    assert!(text(&out.stdout).contains("2 states, 4 parameters, reading zhang"));
    let got = json(&["check", &example("vehicle")]);
    assert_eq!((&got["valid"], got["adaptive"].as_array().unwrap().len()), (&true.into(), 2));
    assert_eq!(got["adaptive"][1]["usable"], false);
}

#[test]
fn what_is_wrong_is_named_with_its_place() {
    let plain = fs::read_to_string(example("adaptive_nonlinear")).unwrap();
    let cases = [
        ("K = [5, -5]", "K = [-5, 5]", 4, "turn the sign of K"),
        ("C = [1, 0]", "C = [1, 0, 0]", 3, ".C: "),
        ("\"sin(y)\"]", "\"sin(x1)\"]", 3, "no parameter is called 'x1'"),
        ("entry = [\"x2\", \"x1\"]", "entry = [\"x2\", \"x3\"]", 3, "no state is called 'x3'"),
        ("P0 = 1e3", "P0 = -1", 3, ".P0: "),
        ("max = 2.4", "max = -1", 3, "inside the bounds"),
        ("lambda = 0.15", "lamda = 0.15", 3, "did you mean 'lambda'"),
        ("derivative = [\"x2\",", "derivative = [", 3, "1 entries, wanted 2"),
        ("duration = 120", "duration = -1", 3, "run.duration"),
        ("c*sin(x1)\"]", "c*sin(x1) + 100*x1^3\"]", 3, "runs away"),
        ("b = { column = [0, \"u\"]", "b = { column = [\"u\", 0]", 0, ""),
    ];
    for (from, to, code, says) in cases {
        assert!(plain.contains(from), "{from}");
        let path =
            file("wrong.toml", &plain.replace(from, to).replace("duration = 120", "duration = 2"));
        let out = mmae(&["run", &path]);
        let said = text(&out.stderr);
        assert_eq!(out.status.code(), Some(code), "{to}: {said}");
        assert!(said.contains(says), "{to}: {said}");
        if code == 3 {
            assert!(said.starts_with("error: ") && said.contains("wrong.toml:"), "{said}");
        }
    }
    let out = mmae(&["run", &example("adaptive_nonlinear"), "--truth", "a9=1"]);
    assert_eq!(out.status.code(), Some(3));
    assert!(text(&out.stderr).contains("no parameter 'a9'"), "{}", text(&out.stderr));
    let out = mmae(&["eip", &example("adaptive_nonlinear")]);
    assert_eq!(out.status.code(), Some(3), "{}", text(&out.stderr));
}

/// By how much the errors of the re-centred bank are smaller, at least.
const THETA_FACTOR: f64 = 50.0;
const STATE_FACTOR: f64 = 10.0;

#[test]
fn a_bank_that_is_recentred_beats_the_bank_alone() {
    let got = json(&["run", &example("oscillator_recentred")]);
    let r = &got["recentring"];
    assert_eq!(r["moved"], 1.0);
    let number = |v: &Value| v.as_f64().unwrap();
    let theta = number(&r["theta_error_rms_alone"][0]) / number(&r["theta_error_rms"][0]);
    let state = number(&r["x_error_rms_alone"]) / number(&r["x_error_rms"]);
    assert!(theta > THETA_FACTOR && state > STATE_FACTOR, "{theta} {state}");
    assert!((number(&r["theta_hat"][0]) - 2.4).abs() < 0.1);
    // the new member stands where the lowest weight was, and holds the weight
    let trial = &r["per_trial"][0];
    assert_eq!(trial["moves"].as_array().unwrap().len(), 1);
    // the fixed bank is told as ever
    assert_eq!(got["parameters"][0], "wn");
    assert!(number(&r["theta_hat_alone"][0]) <= 1.3);
    let threads = json(&["run", &example("oscillator_recentred"), "--threads", "1"]);
    assert_eq!(threads["recentring"], *r);
    assert!(mmae(&["check", &example("oscillator_recentred")]).status.success());
}
