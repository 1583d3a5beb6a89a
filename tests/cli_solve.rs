//! `mmae solve` from the outside: a file of equations in, a JSON text out.
#![cfg(feature = "cli")]

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use serde_json::Value;

fn solve(args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mmae"));
    command.arg("solve").args(args).stdin(Stdio::null()).output().unwrap()
}

fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).unwrap()
}

/// A file with this text.
fn file(name: &str, text: &str) -> String {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("solve");
    fs::create_dir_all(&dir).unwrap();
    let path = dir.join(name);
    fs::write(&path, text).unwrap();
    path.display().to_string()
}

fn cases(out: &Output) -> Vec<Value> {
    let document: Value = serde_json::from_slice(&out.stdout).unwrap();
    document["cases"].as_array().unwrap().clone()
}

fn entries(x: &Value) -> Vec<f64> {
    let rows = x.as_array().unwrap().iter();
    rows.flat_map(|r| r.as_array().unwrap()).map(|v| v.as_f64().unwrap()).collect()
}

#[test]
fn the_collections_are_solved_in_their_order() {
    for (name, spectrum) in [("carex", "cl_abscissa"), ("darex", "cl_radius"), ("lyap", "")] {
        let path = format!("{}/tests/data/{name}.json", env!("CARGO_MANIFEST_DIR"));
        let out = solve(&[&path, "--json"]);
        assert!(out.status.success(), "{}", text(&out.stderr));
        let wanted: Value = serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
        let wanted = wanted["cases"].as_array().unwrap();
        let found = cases(&out);
        assert_eq!(found.len(), wanted.len());
        for (f, w) in found.iter().zip(wanted) {
            assert_eq!(f["id"], w["id"]);
            if f["status"] == "error" {
                assert!(f["X"].is_null() && f["code"].is_string(), "{f}");
                assert!(f["message"].as_str().unwrap().contains(": "), "{f}");
                continue;
            }
            assert_eq!(f["status"], "ok");
            assert!(f["error_bound"].as_f64().is_some_and(|e| e >= 0.0), "{f}");
            if w["expect"] == "critical" {
                assert_eq!(f["reliable"], false, "{f}");
            }
            assert!(f["residual"].as_f64().unwrap() < 1e-8, "{f}");
            assert!(f["iterations"].as_u64().unwrap() > 0);
            if w["expect"] == "solution" {
                let (x, y) = (entries(&f["X"]), entries(&w["X"]));
                let scale = y.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
                let tolerance = w["tol_forward"].as_f64().unwrap().max(1e-12);
                for (x, y) in x.iter().zip(&y) {
                    assert!((x - y).abs() <= tolerance * scale, "{}: {x} {y}", f["id"]);
                }
            }
            if let Some(stated) = w[spectrum].as_f64() {
                let got = f[spectrum].as_f64().unwrap();
                // four digits are stated; one closed loop is nilpotent, its radius rounding
                if f["id"] != "darex_1.4" {
                    assert!((got - stated).abs() <= 6e-4 * stated.abs(), "{f}");
                }
            }
        }
    }
}

#[test]
fn a_bad_case_is_an_entry_and_leaves_the_others_alone() {
    let good = r#"{"id": 7, "eq": "care", "A": [[1]], "B": [[1]], "Q": [[3]], "R": [[1]]}"#;
    let mixed = format!(
        r#"{{"cases": [
        {{"id": "nan", "eq": "clyap", "A": [[NaN, 0], [0, -1]], "Q": [[1, 0], [0, 1]]}},
        {{"id": "inf", "eq": "clyap", "A": [[-1, -Infinity], [0, -1]], "Q": [[1, 0], [0, 1]]}},
        {{"id": "null NaN", "eq": "clyap", "A": [[-1, null], [0, -1]], "Q": [[1, 0], [0, 1]]}},
        {{"id": "ragged", "eq": "clyap", "A": [[-1, 0], [0]], "Q": [[1, 0], [0, 1]]}},
        {{"id": "no B", "eq": "dare", "A": [[1]], "Q": [[1]], "R": [[1]]}},
        {{"id": "E", "eq": "clyap", "A": [[-1]], "Q": [[1]], "E": [[2]]}},
        {{"id": "empty", "eq": "clyap", "A": [], "Q": []}},
        {good}
        ]}}"#
    );
    let out = solve(&[&file("mixed.json", &mixed), "--json"]);
    assert!(out.status.success(), "{}", text(&out.stderr));
    let found = cases(&out);
    let codes: Vec<&str> = found.iter().filter_map(|f| f["code"].as_str()).collect();
    assert_eq!(
        codes,
        ["not_finite", "not_finite", "not_finite", "shape", "conflict", "conflict", "empty"]
    );
    assert!(found[1]["message"].as_str().unwrap().starts_with("A[0][1]"), "{}", found[1]);
    assert_eq!(found[2]["id"], "null NaN");
    // x^2 - 2 x - 3 = 0
    let alone = solve(&[&file("alone.json", &format!(r#"{{"cases": [{good}]}}"#)), "--json"]);
    assert_eq!(found[7], cases(&alone)[0]);
    assert_eq!(found[7]["id"], "7");
    assert!((entries(&found[7]["X"])[0] - 3.0).abs() < 1e-14);
    assert!((found[7]["cl_abscissa"].as_f64().unwrap() + 2.0).abs() < 1e-14);
    assert!(text(&out.stderr).contains("7 of 8 equations"), "{}", text(&out.stderr));
}

#[test]
fn a_file_that_is_no_list_of_problems_ends_with_its_place() {
    for (name, body, code, needle) in [
        ("cut.json", "{\"cases\": [\n  {\"id\": 1,", 3, "cut.json:2:"),
        (
            "unknown.json",
            r#"{"cases": [{"id": "x", "eq": "lyap", "A": [[1]], "Q": [[1]]}]}"#,
            3,
            "care",
        ),
        (
            "typed.json",
            r#"{"cases": [{"id": "x", "eq": "clyap", "A": [["one"]], "Q": [[1]]}]}"#,
            3,
            "a number",
        ),
        (
            "huge.json",
            r#"{"cases": [{"id": "x", "eq": "clyap", "A": [[1e999]], "Q": [[1]]}]}"#,
            3,
            "out of range",
        ),
        ("empty.json", "", 3, "empty.json:1:"),
    ] {
        let out = solve(&[&file(name, body)]);
        let err = text(&out.stderr);
        assert_eq!(out.status.code(), Some(code), "{name}: {err}");
        assert!(err.contains(needle) && err.starts_with("error: "), "{name}: {err}");
        assert!(out.stdout.is_empty());
    }
    let none = solve(&["no such file.json"]);
    assert_eq!(none.status.code(), Some(6));
    let unsolved = r#"{"cases": [{"id": "a", "eq": "dlyap", "A": [[-1]], "Q": [[1]]}]}"#;
    let out = solve(&[&file("unsolved.json", unsolved), "--json"]);
    assert_eq!(out.status.code(), Some(4));
    assert_eq!(cases(&out)[0]["status"], "error");
}
