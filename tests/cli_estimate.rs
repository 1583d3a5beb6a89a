//! `mmae estimate` from the outside: recorded data in, weights out.
#![cfg(feature = "cli")]

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use serde_json::Value;

fn estimate(args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mmae"));
    command.arg("estimate").args(args).stdin(Stdio::null()).output().unwrap()
}

fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).unwrap()
}

fn file(name: &str, text: &str) -> String {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("estimate");
    fs::create_dir_all(&dir).unwrap();
    let path = dir.join(name);
    fs::write(&path, text).unwrap();
    path.display().to_string()
}

fn example(name: &str) -> String {
    format!("{}/examples/{name}", env!("CARGO_MANIFEST_DIR"))
}

fn numbers(v: &Value) -> Vec<f64> {
    v.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

fn reference() -> Value {
    let path = format!("{}/tests/data/banks.json", env!("CARGO_MANIFEST_DIR"));
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

#[test]
fn the_nile_has_its_published_posterior() {
    let (scenario, data) = (example("nile.toml"), example("nile.csv"));
    let out = estimate(&[&scenario, "--data", &data, "--json", "--every", "50"]);
    assert!(out.status.success(), "{}", text(&out.stderr));
    let got: Value = serde_json::from_slice(&out.stdout).unwrap();
    let want = reference()["cases"][0]["expected"].as_array().unwrap().last().unwrap().clone();
    assert_eq!(want["t"], got["samples"]);
    for (g, w) in [("p", "post"), ("log_weights", "logpost"), ("loglik", "loglik_models")] {
        for (g, w) in numbers(&got[g]).iter().zip(numbers(&want[w])) {
            assert!((g - w).abs() <= 1e-9 * w.abs().max(1e-3), "{g} {w}");
        }
    }
    assert_eq!(got["record"].as_array().unwrap().len(), 2);
    assert_eq!(numbers(&got["identified"]).iter().sum::<f64>(), 1.0);
    assert_eq!(got["theta_hat"].as_array().unwrap().len(), 2);
    // the published variances, model 13, explain their residuals
    let (nis, band) = (numbers(&got["nis_mean"]), numbers(&got["nis_band"]));
    assert!((band[0] - 0.7422).abs() < 1e-4 && (band[1] - 1.2956).abs() < 1e-4, "{band:?}");
    assert!(band[0] < nis[12] && nis[12] < band[1] && nis[0] > band[1], "{nis:?}");
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("estimate-out");
    let _ = fs::remove_dir_all(&dir);
    let out_dir = dir.display().to_string();
    let args = [&scenario, "--data", &data, "--json", "--every", "50", "--out", &out_dir];
    assert_eq!(estimate(&args).stdout, out.stdout);
    assert_eq!(fs::read(dir.join("estimate.json")).unwrap(), out.stdout);
    let picture = fs::read_to_string(dir.join("weights.svg")).unwrap();
    assert!(picture.contains("Level of the Nile") && picture.contains("f_Q"), "{picture}");
    let picture = fs::read_to_string(dir.join("record.svg")).unwrap();
    assert!(picture.contains("flow residual") && !picture.contains("NaN"), "{picture}");
    assert_eq!(estimate(&args).status.code(), Some(6), "an earlier result is kept");
    let text_out = estimate(&[&scenario, "--data", &data]);
    assert!(
        text(&text_out.stdout).contains("100 samples, 25 models"),
        "{}",
        text(&text_out.stdout)
    );
}

/// The same bank, its models as matrices, on another law.
#[test]
fn models_as_matrices() {
    let case = &reference()["cases"][0];
    let rows = |v: &Value| v.to_string();
    let models: Vec<String> = case["models"]
        .as_array()
        .unwrap()
        .iter()
        .map(|m| {
            let keys = ["T", "Z", "H", "Q", "a1", "P1"];
            let list: Vec<String> =
                keys.iter().map(|k| format!("{k} = {}", rows(&m[*k]))).collect();
            format!("  {{ {} }},\n", list.join(", "))
        })
        .collect();
    let scenario = format!(
        "format = 1\n[plant]\ntime = \"discrete\"\ndt = 1\noutputs = [\"flow\"]\n\
         [bank]\nmodels = [\n{}]\n",
        models.concat()
    );
    let path = file("matrices.toml", &scenario);
    let out = estimate(&[&path, "--data", &example("nile.csv"), "--json"]);
    assert!(out.status.success(), "{}", text(&out.stderr));
    let family = estimate(&[&example("nile.toml"), "--data", &example("nile.csv"), "--json"]);
    let (a, b): (Value, Value) = (
        serde_json::from_slice(&out.stdout).unwrap(),
        serde_json::from_slice(&family.stdout).unwrap(),
    );
    for (a, b) in numbers(&a["log_weights"]).iter().zip(numbers(&b["log_weights"])) {
        assert!((a - b).abs() < 1e-9);
    }
    let other =
        estimate(&[&path, "--data", &example("nile.csv"), "--json", "--weighting", "zhang1"]);
    let c: Value = serde_json::from_slice(&other.stdout).unwrap();
    assert_eq!(c["law"], "zhang1");
    assert_ne!(c["p"], a["p"]);
}

#[test]
fn gaps_blanks_and_mistakes() {
    let scenario = example("nile.toml");
    let with =
        |name: &str, body: &str| estimate(&[&scenario, "--data", &file(name, body), "--json"]);
    // a year that is left out is a year without a measurement
    let gap = with("gap.csv", "t,flow\n1,1120\n2,1160\n4,1210\n");
    let blank = with("blank.csv", "t,flow\n1,1120\n2,1160\n3,\n4,1210\n");
    let (a, b): (Value, Value) = (
        serde_json::from_slice(&gap.stdout).unwrap(),
        serde_json::from_slice(&blank.stdout).unwrap(),
    );
    assert_eq!(a, b);
    for (name, body, needle) in [
        ("column.csv", "t,flaw\n1,2\n", "no such column"),
        ("number.csv", "flow\n1120\nabc\n", "number.csv:3:1: flow: 'abc' is not a finite number"),
        ("inf.csv", "flow\n1120\ninf\n", "not a finite number"),
        ("time.csv", "t,flow\n2,1\n1,1\n", "times must increase"),
        ("ratio.csv", "t,flow\n1,1\n2.5,1\n", "not a multiple of dt"),
        ("ragged.csv", "t,flow\n1,1\n2\n", "ragged.csv:3"),
        ("empty.csv", "flow\n", "no samples"),
    ] {
        let out = with(name, body);
        assert_eq!(out.status.code(), Some(3), "{name}: {}", text(&out.stderr));
        assert!(text(&out.stderr).contains(needle), "{name}: {}", text(&out.stderr));
    }
    let out = estimate(&[&scenario, "--data", "no such file.csv"]);
    assert_eq!(out.status.code(), Some(6));
}

/// A row holds what was measured at its time and the input from then on.
#[test]
fn inputs_act_from_their_row_on() {
    let scenario = file(
        "driven.toml",
        "format = 1\n[plant]\ntime = \"discrete\"\ndt = 1\nstates = [\"x\"]\ninputs = [\"u\"]\n\
         disturbances = [\"w\"]\noutputs = [\"y\"]\nA = \"a\"\nB = 1\nG = 1\nC = 1\nQ = 1e-4\nR = 1e-4\n\
         [plant.parameters]\na = 0.5\n[bank]\nmodels = { a = [0.2, 0.5, 0.8] }\n",
    );
    let (mut x, mut rows, mut sparse) = (0.0_f64, String::from("t,u,y\n"), String::from("t,u,y\n"));
    let mut u = 1.0;
    for k in 0..40 {
        rows += &format!("{k},{u},{x}\n");
        // the input holds over a gap
        if k % 4 == 0 {
            sparse += &format!("{k},{u},{x}\n");
        }
        x = 0.5 * x + u;
        if k % 4 == 3 {
            u = if k % 8 == 3 { -1.0 } else { 2.0 };
        }
    }
    for (name, body) in [("driven.csv", &rows), ("sparse.csv", &sparse)] {
        let out = estimate(&[&scenario, "--data", &file(name, body), "--json"]);
        let got: Value = serde_json::from_slice(&out.stdout).unwrap();
        assert!(numbers(&got["p"])[1] > 0.999, "{name}: {}", got["p"]);
    }
}

#[test]
fn blank_lines_of_a_single_column_are_samples() {
    let scenario = example("nile.toml");
    let with = |name: &str, body: &str| {
        let out = estimate(&[&scenario, "--data", &file(name, body), "--json"]);
        serde_json::from_slice::<Value>(&out.stdout).unwrap()
    };
    let single = with("single.csv", "flow\n1120\n\n\n1160\n\n\n");
    let double = with("double.csv", "flow,x\n1120,1\n,1\n,1\n1160,1\n");
    assert_eq!(single, double);
    assert_eq!(single["samples"], 4);
}

/// Writes columns of doubles, null for NaN, as a Parquet table.
fn table(path: &str, columns: &[(&str, Vec<f64>)], compression: parquet::basic::Compression) {
    use parquet::data_type::DoubleType;
    use parquet::file::properties::WriterProperties;
    use parquet::file::writer::SerializedFileWriter;
    use parquet::schema::parser::parse_message_type;
    let fields: Vec<String> =
        columns.iter().map(|(name, _)| format!("OPTIONAL DOUBLE {name};")).collect();
    let schema = parse_message_type(&format!("message t {{ {} }}", fields.join(" "))).unwrap();
    let properties = WriterProperties::builder().set_compression(compression).build();
    let out = fs::File::create(path).unwrap();
    let mut writer = SerializedFileWriter::new(out, schema.into(), properties.into()).unwrap();
    let mut group = writer.next_row_group().unwrap();
    for (_, values) in columns {
        let mut column = group.next_column().unwrap().unwrap();
        let present: Vec<f64> = values.iter().copied().filter(|v| !v.is_nan()).collect();
        let levels: Vec<i16> = values.iter().map(|v| i16::from(!v.is_nan())).collect();
        column.typed::<DoubleType>().write_batch(&present, Some(&levels), None).unwrap();
        column.close().unwrap();
    }
    group.close().unwrap();
    writer.close().unwrap();
}

#[test]
fn a_parquet_table_is_read_as_a_csv_file() {
    use parquet::basic::Compression;
    let scenario = example("nile.toml");
    let text_of = fs::read_to_string(example("nile.csv")).unwrap();
    let mut lines = text_of.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let mut columns: Vec<(&str, Vec<f64>)> = header.iter().map(|h| (*h, Vec::new())).collect();
    for line in lines {
        for (column, field) in columns.iter_mut().zip(line.split(',')) {
            column.1.push(field.trim().parse().unwrap_or(f64::NAN));
        }
    }
    // a hole in both
    let last = columns.len() - 1;
    columns[last].1[20] = f64::NAN;
    let row = |k: usize| {
        let fields = columns.iter().map(|(_, v)| v[k]);
        let shown = fields.map(|v| if v.is_nan() { String::new() } else { v.to_string() });
        shown.collect::<Vec<_>>().join(",")
    };
    let body: Vec<String> = (0..columns[0].1.len()).map(row).collect();
    let csv = file("hole.csv", &format!("{}\n{}\n", header.join(","), body.join("\n")));
    let want = estimate(&[&scenario, "--data", &csv, "--json"]);
    assert!(want.status.success(), "{}", text(&want.stderr));
    for (name, compression) in
        [("plain.parquet", Compression::UNCOMPRESSED), ("snappy.parquet", Compression::SNAPPY)]
    {
        let path = file(name, "");
        table(&path, &columns, compression);
        let got = estimate(&[&scenario, "--data", &path, "--json"]);
        assert!(got.status.success(), "{}", text(&got.stderr));
        assert_eq!(got.stdout, want.stdout, "{name}");
    }
    let path = file("infinite.parquet", "");
    columns[last].1[3] = f64::INFINITY;
    table(&path, &columns, Compression::UNCOMPRESSED);
    let got = estimate(&[&scenario, "--data", &path]);
    assert_eq!(got.status.code(), Some(3));
    assert!(text(&got.stderr).contains("infinite.parquet:4:"), "{}", text(&got.stderr));
    let whole = fs::read(&path).unwrap();
    let cut = file("cut.parquet", "");
    fs::write(&cut, &whole[..whole.len() / 2]).unwrap();
    let got = estimate(&[&scenario, "--data", &cut]);
    assert_eq!(got.status.code(), Some(3), "{}", text(&got.stderr));
    assert!(text(&got.stderr).contains("not a table that can be read"));
}

const WALK: &str = "format = 1\n[plant]\ntime = \"continuous\"\nstates = [\"x\"]\n\
    disturbances = [\"w\"]\noutputs = [\"y\"]\nA = \"-a\"\nG = 1\nC = 1\nQ = 2\nR = 0.05\n\
    [plant.parameters]\na = 0.1\n[bank]\nobserver = \"kalman\"\ndt = 0.5\nP0 = 1\n\
    models = { a = [0.1, 0.7] }\n";

/// A filter of samples of a continuous plant takes them when they come.
#[test]
fn samples_at_uneven_times() {
    let scenario = file("walk.toml", WALK);
    // s; a step of dt, two of them, and others
    let t: [f64; 7] = [0.5, 1.0, 2.0, 2.3, 3.7, 3.8, 4.1];
    let y = [0.3, 0.9, 1.4, 1.1, -0.2, 0.1, 0.4];
    let rows: Vec<String> = t.iter().zip(y).map(|(t, y)| format!("{t},{y}")).collect();
    let data = file("uneven.csv", &format!("t,y\n{}\n", rows.join("\n")));
    let out = estimate(&[&scenario, "--data", &data, "--json"]);
    assert!(out.status.success(), "{}", text(&out.stderr));
    let got: Value = serde_json::from_slice(&out.stdout).unwrap();
    for (i, a) in [0.1_f64, 0.7].into_iter().enumerate() {
        let (mut x, mut p, mut log_lik, mut last) = (0.0, 1.0, 0.0, 0.0);
        for (t, y) in t.iter().zip(y) {
            let dt: f64 = t - last;
            let f = (-a * dt).exp();
            x *= f;
            p = f * f * p + 2.0 * (1.0 - f * f) / (2.0 * a);
            let s = p + 0.05 / 0.5;
            let r = y - x;
            log_lik -= 0.5 * (r * r / s + (2.0 * std::f64::consts::PI * s).ln());
            x += p / s * r;
            p -= p * p / s;
            last = *t;
        }
        let got = got["loglik"][i].as_f64().unwrap();
        assert!((got - log_lik).abs() < 1e-11, "model {i}: {got} for {log_lik}");
    }
    // steady gains are those of one interval, and so are continuous observers
    let steady = file("steady.toml", &WALK.replace("P0 = 1\n", ""));
    let out = estimate(&[&steady, "--data", &data]);
    assert_eq!(out.status.code(), Some(3));
    assert!(text(&out.stderr).contains("gains = \"recursive\""), "{}", text(&out.stderr));
    let held = WALK.replace("observer = \"kalman\"\n", "").replace("P0 = 1\n", "");
    let out = estimate(&[&file("held.toml", &held), "--data", &data]);
    assert_eq!(out.status.code(), Some(3));
    assert!(text(&out.stderr).contains("observer = \"kalman\""), "{}", text(&out.stderr));
}

#[test]
fn every_law_can_be_named() {
    let scenario = file("laws.toml", WALK);
    let data = file("laws.csv", "y\n0.3\n0.9\n1.4\n");
    for law in ["bayes", "zhang1", "zhang2", "dwsg"] {
        let out = estimate(&[&scenario, "--data", &data, "--json", "--weighting", law]);
        assert!(out.status.success(), "{law}: {}", text(&out.stderr));
        let got: Value = serde_json::from_slice(&out.stdout).unwrap();
        assert!((numbers(&got["p"]).iter().sum::<f64>() - 1.0).abs() < 1e-12, "{law}");
    }
}

#[test]
fn columns_are_not_guessed() {
    let scenario = file("guess.toml", WALK);
    for (name, header, words) in [
        ("twice.csv", "y,y", "stands twice"),
        ("times.csv", "t,time,y", "two columns of times"),
        ("none.csv", "\n", "no header"),
    ] {
        let fields = vec!["0.5"; header.split(',').count()].join(",");
        let data = file(name, &format!("{header}\n{fields}\n"));
        let out = estimate(&[&scenario, "--data", &data]);
        assert_eq!(out.status.code(), Some(3), "{}", text(&out.stderr));
        assert!(text(&out.stderr).contains(words), "{}", text(&out.stderr));
    }
    let path = file("gap.csv", "t,y\n0.5,1\n9000000.5,2\n");
    let held = WALK.replace("observer = \"kalman\"\n", "").replace("P0 = 1\n", "");
    let out = estimate(&[&file("gap.toml", &held), "--data", &path]);
    assert_eq!(out.status.code(), Some(3));
    assert!(text(&out.stderr).contains("a gap of 9000000 s"), "{}", text(&out.stderr));
}
