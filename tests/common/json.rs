//! Numbers out of the JSON files of tests/data.

use mmae::Mat;
use serde_json::Value;

pub(crate) fn read(name: &str) -> Value {
    let path = format!("{}/tests/data/{name}", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{path}: {e}"));
    serde_json::from_str(&text).unwrap_or_else(|e| panic!("{path}: {e}"))
}

/// A number, also one written as a string of many digits; NaN for null.
pub(crate) fn number(v: &Value) -> f64 {
    match v {
        Value::Null => f64::NAN,
        Value::String(s) => s.parse().unwrap(),
        _ => v.as_f64().unwrap(),
    }
}

pub(crate) fn vector(v: &Value) -> Vec<f64> {
    match v {
        Value::Array(list) => list.iter().flat_map(vector).collect(),
        _ => vec![number(v)],
    }
}

pub(crate) fn list(v: &Value) -> &[Value] {
    v.as_array().unwrap()
}

/// Rows of a matrix; a flat list is a column.
pub(crate) fn matrix(v: &Value) -> Mat<f64> {
    let rows: Vec<Vec<f64>> = list(v).iter().map(vector).collect();
    Mat::from_fn(rows.len(), rows[0].len(), |i, j| rows[i][j])
}

#[track_caller]
pub(crate) fn close(what: &str, got: &[f64], want: &[f64], relative: f64, absolute: f64) {
    assert_eq!(got.len(), want.len(), "{what}");
    let scale = want.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    for (g, w) in got.iter().zip(want) {
        let ok = (g - w).abs() <= relative * scale + absolute || g == w;
        assert!(ok, "{what}: {g} for {w} ({:e}) in {got:?} for {want:?}", (g - w).abs());
    }
}
