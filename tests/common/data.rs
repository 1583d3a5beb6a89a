//! Reading `tests/data/*.json`: matrices are lists of rows.

use super::matrix::M;
use serde_json::Value;

/// The file `tests/data/<name>`.
#[track_caller]
pub fn load(name: &str) -> Value {
    let path = format!("{}/tests/data/{name}", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{path}: {e}"));
    serde_json::from_str(&text).unwrap_or_else(|e| panic!("{path}: {e}"))
}

/// The entries of `file["cases"]`.
pub fn cases(file: &Value) -> &[Value] {
    file["cases"].as_array().expect("cases is a list")
}

/// The case whose `key` (`"id"`, `"name"`) is `name`.
pub fn find<'a>(file: &'a Value, key: &str, name: &str) -> &'a Value {
    let hit = cases(file).iter().find(|c| c[key] == name);
    hit.unwrap_or_else(|| panic!("no case with {key} = {name}"))
}

/// A number; the collections write NaN as a string or null.
#[track_caller]
pub fn number(v: &Value) -> f64 {
    match v {
        Value::Null => f64::NAN,
        Value::String(s) => s.parse().unwrap_or_else(|_| panic!("{s} is not a number")),
        _ => v.as_f64().unwrap_or_else(|| panic!("{v} is not a number")),
    }
}

/// A list of numbers.
#[track_caller]
pub fn vector(v: &Value) -> Vec<f64> {
    let list = v.as_array().unwrap_or_else(|| panic!("not a list: {v}"));
    list.iter().map(number).collect()
}

/// A matrix, as a list of rows.
#[track_caller]
pub fn matrix(v: &Value) -> M {
    let rows = v.as_array().unwrap_or_else(|| panic!("not a matrix: {v}"));
    rows.iter().map(vector).collect()
}

/// A matrix that may be absent.
pub fn optional(v: &Value) -> Option<M> {
    (!v.is_null()).then(|| matrix(v))
}

/// A Riccati or Lyapunov problem of `carex.json`, `darex.json`, `lyap.json`.
pub struct Equation {
    /// Name in the collection.
    pub id: String,
    /// `care`, `dare`, `clyap` or `dlyap`.
    pub eq: String,
    /// `A`.
    pub a: M,
    /// `B`; in Lyapunov problems a factor of `Q` when present.
    pub b: Option<M>,
    /// `Q`.
    pub q: M,
    /// `R`.
    pub r: Option<M>,
    /// `S`, zero when absent.
    pub s: Option<M>,
    /// `solution`, `error` or `critical`.
    pub expect: String,
    /// The solution, where there is one.
    pub x: Option<M>,
    /// Attainable relative forward error.
    pub tol: f64,
    /// `easy`, `moderate`, `hard`, `extreme`, `error`, `critical`.
    pub difficulty: String,
    /// Abscissa (continuous) or radius (discrete) of the closed loop.
    pub margin: Option<f64>,
}

/// The problems of one of the three collections.
pub fn equations(name: &str) -> Vec<Equation> {
    let text = |v: &Value| v.as_str().unwrap_or("").to_string();
    cases(&load(name))
        .iter()
        .map(|c| Equation {
            id: text(&c["id"]),
            eq: text(&c["eq"]),
            a: matrix(&c["A"]),
            b: optional(&c["B"]),
            q: matrix(&c["Q"]),
            r: optional(&c["R"]),
            s: optional(&c["S"]),
            expect: text(&c["expect"]),
            x: optional(&c["X"]),
            tol: c["tol_forward"].as_f64().unwrap_or(0.0),
            difficulty: text(&c["difficulty"]),
            margin: c["cl_abscissa"].as_f64().or(c["cl_radius"].as_f64()),
        })
        .collect()
}
