//! Text, JSON, table, picture and result directories of studies made by hand.
#![cfg(feature = "cli")]

#[path = "report/cases.rs"]
mod cases;

use std::fs;
use std::path::{Path, PathBuf};

use mmae::eip::EipSets;
use mmae::report::{figure, json, lock, table, text, write};
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;
use serde_json::Value;

fn scratch(name: &str) -> PathBuf {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("report").join(name);
    let _ = fs::remove_dir_all(&dir);
    fs::create_dir_all(&dir).unwrap();
    dir
}

fn read_table(name: &str, sets: &EipSets) -> SerializedFileReader<fs::File> {
    let path = scratch(name).join("upsilon.parquet");
    table::write(sets, fs::File::create(&path).unwrap()).unwrap();
    SerializedFileReader::new(fs::File::open(&path).unwrap()).unwrap()
}

fn parsed(sets: &EipSets) -> Value {
    serde_json::from_str(&json::to_string(sets)).unwrap()
}

/// Set `MMAE_BLESS` to write the expected texts anew, then read them.
#[test]
fn texts_read_as_before() {
    let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/report");
    for (name, sets) in [
        ("pendulum", cases::pendulum()),
        ("delays", cases::delays()),
        ("twelve", cases::twelve()),
        ("troubled", cases::troubled()),
        ("doubtful", cases::doubtful()),
        ("plane", cases::plane([61, 41])),
    ] {
        let path = dir.join(format!("{name}.txt"));
        let text = text::render(&sets);
        if std::env::var_os("MMAE_BLESS").is_some() {
            fs::write(&path, &text).unwrap();
        }
        assert_eq!(text, fs::read_to_string(&path).unwrap_or_default(), "{}", path.display());
    }
}

#[test]
fn texts_fit_80_columns() {
    for (name, sets) in cases::all() {
        let text = text::render(&sets);
        assert!(text.ends_with('\n') && text.is_ascii(), "{name}");
        for line in text.lines() {
            assert!(line.chars().count() <= 80, "{name}: {line}");
            assert_eq!(line, line.trim_end(), "{name}");
        }
    }
}

#[test]
fn json_has_the_promised_fields() {
    let v = parsed(&cases::pendulum());
    assert_eq!(v["schema"], "mmae.eip/1");
    assert_eq!(v["parameter"], "L");
    assert_eq!(v["models"], serde_json::json!([1.025, 1.287, 1.526, 1.778]));
    assert_eq!(v["convention"], "ito");
    assert_eq!(v["grid"].as_array().unwrap().len(), 401);
    assert_eq!(v["grid"][400], 1.9);
    assert_eq!(v["upsilon"].as_array().unwrap().len(), 401);
    assert_eq!(v["upsilon"][7].as_array().unwrap().len(), 4);
    assert_eq!((&v["winner"][0], &v["winner"][400]), (&0.into(), &3.into()));
    let second = &v["boundaries"][1];
    assert_eq!((&second["left"], &second["right"]), (&1.into(), &2.into()));
    assert_eq!(second["value"], 1.404518669);
    assert_eq!(v["sets"][3]["model"], 3);
    assert_eq!(v["sets"][3]["intervals"], serde_json::json!([[1.649832352, 1.9]]));
    assert_eq!(v["undecidable"], serde_json::json!([]));
    assert_eq!(v["unstable"], serde_json::json!([]));
    assert_eq!(v["pseudo_norm"][1][3], 285.0);
    assert!(v.get("cases").is_none(), "one delay is told once");
}

#[test]
fn json_tells_what_is_missing() {
    let v = parsed(&cases::troubled());
    assert!(v["upsilon"][0][1].is_null());
    assert_eq!(v["failures"][0]["model"], 1);
    assert!(v["failures"][0]["message"].as_str().unwrap().contains("x_dot"));
    assert_eq!(v["duplicates"], serde_json::json!([{"model": 3, "of": 0}]));

    let v = parsed(&cases::doubtful());
    assert_eq!(v["failed"].as_array().unwrap().len(), 20);
    assert!(v["failed"][0]["message"].as_str().unwrap().contains("A[2][1]"));
    assert_eq!(v["failed_intervals"], serde_json::json!([[0.9987, 1.0488]]));
    let undecided = &v["undecided"][0];
    assert_eq!((&undecided["plant"], &undecided["margin"]), (&200.into(), &0.25.into()));
    assert_eq!(undecided["models"], serde_json::json!([1, 2]));
    assert_eq!(v["replaced"], 12);
    assert!(v["winner"][200].is_null());

    let v = parsed(&cases::hopeless());
    assert!(v["winner"].as_array().unwrap().iter().all(Value::is_null));
    assert_eq!(v["unstable"].as_array().unwrap().len(), 401);
    assert_eq!(v["unstable"][5]["plant"], 5);
    assert_eq!(v["unstable"][5]["mode"], serde_json::json!({"re": 0.41, "im": 1.93}));
    assert_eq!(v["unstable_intervals"], serde_json::json!([[0.9, 1.9]]));

    assert!(parsed(&cases::single())["margin"][0].is_null(), "no runner-up, no margin");
}

#[test]
fn models_that_nothing_tells_apart_are_told() {
    let mut sets = cases::pendulum();
    assert!(!text::render(&sets).contains("every margin is zero"));
    sets.cases[0].margin.fill(0.0);
    assert!(text::render(&sets).contains("every margin is zero"));
    // duplicates alone have no runner-up
    sets.cases[0].margin.fill(f64::INFINITY);
    assert!(text::render(&sets).contains("every margin is zero"));
    assert!(!text::render(&cases::single()).contains("every margin is zero"));
}

#[test]
fn json_of_several_delays_and_parameters() {
    let v = parsed(&cases::delays());
    assert_eq!(v["delay"], 0.0);
    assert_eq!(v["delays"], serde_json::json!([0.0, 0.002, 0.02]));
    assert_eq!(v["cases"].as_array().unwrap().len(), 3);
    assert_eq!(v["cases"][0]["upsilon"], v["upsilon"]);
    assert_eq!(v["cases"][2]["boundaries"][0]["value"], 1.154061902);
    assert_eq!(
        v["undecidable"][0],
        serde_json::json!({"interval": [1.153616065, 1.154061902], "models": [0, 1]})
    );

    let v = parsed(&cases::plane([5, 3]));
    assert!(v["parameter"].is_null());
    assert_eq!(v["parameters"], serde_json::json!(["L", "m"]));
    assert_eq!(v["models"][1], serde_json::json!({"L": 1.05, "m": 0.9}));
    assert_eq!(v["grid"]["m"].as_array().unwrap().len(), 3);
    assert_eq!(v["winner"].as_array().unwrap().len(), 15);
    assert_eq!((&v["convention"], &v["dt"]), (&"baram".into(), &0.001.into()));
}

#[test]
fn json_numbers_read_back_as_the_same_bits() {
    let sets = cases::plane([7, 3]);
    let text = json::to_string(&sets);
    let from = text.find("\"upsilon\": [").unwrap();
    let to = from + text[from..].find("\n  ]").unwrap();
    let numbers: Vec<f64> = text[from + 12..to]
        .split(|c: char| c == ',' || c == '[' || c == ']' || c.is_whitespace())
        .filter(|word| !word.is_empty())
        .map(|word| if word == "null" { f64::NAN } else { word.parse().unwrap() })
        .collect();
    assert_eq!(numbers.len(), sets.cases[0].upsilon.len());
    for (a, b) in numbers.iter().zip(&sets.cases[0].upsilon) {
        assert!(a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan()));
    }
}

#[test]
fn table_reads_back() {
    let sets = cases::troubled();
    let reader = read_table("table", &sets);
    let names: Vec<String> = reader
        .metadata()
        .file_metadata()
        .schema()
        .get_fields()
        .iter()
        .map(|f| f.name().to_string())
        .collect();
    assert_eq!(
        names,
        ["delay", "L", "plant", "model", "label", "upsilon", "error", "winner", "margin"]
    );
    let case = &sets.cases[0];
    let mut rows = 0;
    for (k, row) in reader.get_row_iter(None).unwrap().enumerate() {
        let row = row.unwrap();
        let fields: Vec<&Field> = row.get_column_iter().map(|(_, field)| field).collect();
        let (plant, model) = (k / 4, k % 4);
        let optional = |v: f64| if v.is_finite() { Field::Double(v) } else { Field::Null };
        let expected = [
            Field::Double(0.0),
            Field::Double(sets.grid.point(plant)[0]),
            Field::Long(plant as i64),
            Field::Int(model as i32),
            Field::Str(sets.models[model].label.clone()),
            optional(case.upsilon[k]),
            optional(case.error[k]),
            Field::Bool(case.winner[plant] == Some(model)),
            optional(case.margin[plant]),
        ];
        assert!(fields.iter().copied().eq(expected.iter()), "row {k}: {row}");
        rows += 1;
    }
    assert_eq!(rows, 401 * 4);
}

#[test]
fn table_is_cut_into_groups_and_keeps_its_own_names() {
    let mut sets = cases::many(60, 2001);
    let reader = read_table("groups", &sets);
    assert_eq!(reader.metadata().num_row_groups(), 2);
    assert_eq!(reader.metadata().file_metadata().num_rows(), 60 * 2001);

    sets = cases::lone_plant();
    let axis = sets.grid.axes()[0].1.clone();
    sets.grid = mmae::model::Grid::new(vec![("delay".into(), axis)]).unwrap();
    let reader = read_table("own_names", &sets);
    assert_eq!(reader.metadata().file_metadata().schema().get_fields()[1].name(), "plant_delay");
}

/// Every tag closed in order, attributes quoted, no bare `<` or `&` in text.
fn assert_well_formed(name: &str, svg: &str) {
    let body = svg.strip_prefix("<?xml version=\"1.0\" encoding=\"UTF-8\"?>").expect(name);
    let mut open: Vec<&str> = Vec::new();
    let mut rest = body;
    while let Some(at) = rest.find('<') {
        let text = &rest[..at];
        for (k, _) in text.match_indices('&') {
            let entity = ["&amp;", "&lt;", "&gt;", "&quot;", "&apos;"];
            assert!(entity.iter().any(|e| text[k..].starts_with(e)), "{name}: {text}");
        }
        let end = at + rest[at..].find('>').expect(name);
        let tag = &rest[at + 1..end];
        rest = &rest[end + 1..];
        if let Some(closed) = tag.strip_prefix('/') {
            assert_eq!(open.pop(), Some(closed), "{name}");
        } else {
            assert_eq!(tag.matches('"').count() % 2, 0, "{name}: {tag}");
            if !tag.ends_with('/') {
                open.push(tag.split_whitespace().next().expect(name));
            }
        }
    }
    assert!(open.is_empty(), "{name}: {open:?}");
}

/// The pictures also land in `target/tmp/gallery`, for a look.
#[test]
fn pictures_are_well_formed() {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("gallery");
    fs::create_dir_all(&dir).unwrap();
    for (name, sets) in cases::all() {
        let picture = figure::to_string(&sets);
        fs::write(dir.join(format!("{name}.svg")), &picture).unwrap();
        assert_well_formed(name, &picture);
        for bad in ["NaN", "inf", "e+", "-0 "] {
            assert!(!picture.contains(bad), "{name} contains {bad}");
        }
        assert!(picture.contains("viewBox=\"0 0 960 "), "{name}");
        assert_eq!(picture, figure::to_string(&sets), "{name}: same study, same bytes");
    }
}

#[test]
fn pictures_show_labels_and_hatches() {
    let picture = figure::to_string(&cases::delays());
    for text in ["1.15362", "1.404519", "20 ms", "L = 1.778", "url(#undecidable)", "margin"] {
        assert!(picture.contains(text), "{text}");
    }
    assert!(figure::to_string(&cases::twelve()).contains("worn bearing &lt;1 &amp; m..."));
    assert!(figure::to_string(&cases::hopeless()).contains("no plant has a winner"));
    assert!(figure::to_string(&cases::space()).contains("slice at friction coefficient = 0.5"));
}

fn names(dir: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(dir).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn put(dir: &Path, force: bool, content: &str) -> Result<(), write::Error> {
    let mut output = write::Output::open(dir, &["a.json", write::MANIFEST], force)?;
    output.add("a.json", |out| out.write_all(content.as_bytes()))?;
    let written = output.written();
    assert_eq!(written[0].bytes, content.len() as u64);
    assert_eq!(written[0].sha256, write::sha256(content.as_bytes()));
    output.add(write::MANIFEST, |out| out.write_all(b"{}\n"))?;
    output.commit()
}

#[test]
fn a_result_is_whole_and_not_replaced_unasked() {
    let dir = scratch("whole").join("deep/er");
    put(&dir, false, "one").unwrap();
    assert_eq!(names(&dir), ["a.json", "manifest.json"]);
    let refused = put(&dir, false, "two").unwrap_err();
    assert!(matches!(&refused, write::Error::Exists { path } if path.ends_with("a.json")));
    assert!(refused.to_string().contains("--force"));
    assert_eq!(fs::read_to_string(dir.join("a.json")).unwrap(), "one");
    put(&dir, true, "three").unwrap();
    assert_eq!(fs::read_to_string(dir.join("a.json")).unwrap(), "three");
    assert_eq!(names(&dir), ["a.json", "manifest.json"]);
}

#[test]
fn nothing_is_left_of_a_failed_write() {
    let root = scratch("failed");
    let dir = root.join("new/dir");
    let mut output = write::Output::open(&dir, &["a.json"], false).unwrap();
    output.add("a.json", |out| out.write_all(b"whole")).unwrap();
    let failed = output.add("b.json", |out| {
        out.write_all(b"half")?;
        Err(std::io::Error::other("the pen broke"))
    });
    assert!(failed.unwrap_err().to_string().contains("the pen broke"));
    drop(output);
    assert!(names(&root).is_empty(), "directories that were made go too");
    // but not those that somebody else uses
    let output = write::Output::open(&dir, &["a.json"], false).unwrap();
    fs::write(dir.join("note.txt"), "mine").unwrap();
    drop(output);
    assert_eq!(names(&dir), ["note.txt"]);
}

#[test]
fn a_directory_removed_meanwhile_is_an_error() {
    let dir = scratch("removed").join("out");
    let mut output = write::Output::open(&dir, &["a.json"], false).unwrap();
    fs::remove_dir_all(&dir).unwrap();
    let e = output.add("a.json", |out| out.write_all(b"x")).unwrap_err();
    assert!(matches!(e, write::Error::Io { .. }), "{e}");
    drop(output);
    assert!(!dir.exists());
}

#[test]
fn odd_targets_are_refused() {
    let root = scratch("odd");
    for name in ["", "a\nb", "a\0b"] {
        let e = write::Output::open(Path::new(name), &[], false).unwrap_err();
        assert!(matches!(e, write::Error::Name { .. }), "{name:?}: {e}");
    }
    fs::write(root.join("file"), "x").unwrap();
    let e = write::Output::open(&root.join("file"), &[], false).unwrap_err();
    assert!(matches!(e, write::Error::NotDirectory { .. }), "{e}");
    let e = write::Output::open(&root.join("file/inside"), &[], false).unwrap_err();
    assert!(matches!(e, write::Error::Io { .. }), "{e}");
    let e = write::Output::open(&root.join("n".repeat(300)), &[], false).unwrap_err();
    assert!(matches!(e, write::Error::Io { .. }), "{e}");
    assert_eq!(names(&root), ["file"]);
}

#[cfg(unix)]
#[test]
fn links_are_neither_followed_nor_replaced() {
    let root = scratch("links");
    let (dir, outside) = (root.join("out"), root.join("outside.txt"));
    fs::create_dir(&dir).unwrap();
    fs::write(&outside, "precious").unwrap();
    std::os::unix::fs::symlink(&outside, dir.join("a.json")).unwrap();
    for force in [false, true] {
        let e = put(&dir, force, "x").unwrap_err();
        assert!(matches!(e, write::Error::NotRegular { .. }), "{e}");
    }
    fs::remove_file(dir.join("a.json")).unwrap();
    std::os::unix::fs::symlink(&outside, dir.join(lock::NAME)).unwrap();
    assert!(matches!(put(&dir, true, "x").unwrap_err(), write::Error::NotRegular { .. }));
    assert_eq!(fs::read_to_string(&outside).unwrap(), "precious");
}

#[test]
fn one_writer_at_a_time_and_stale_locks_are_taken_over() {
    let dir = scratch("locked");
    let first = lock::Lock::acquire(&dir).unwrap();
    let e = put(&dir, true, "x").unwrap_err();
    assert!(e.to_string().contains(&format!("process {}", std::process::id())), "{e}");
    drop(first);
    assert!(names(&dir).is_empty());
    // a killed process leaves its files, but not its lock
    fs::write(dir.join(lock::NAME), "4194304999\n").unwrap();
    fs::write(dir.join(".mmae-abc123.tmp"), "half").unwrap();
    put(&dir, false, "x").unwrap();
    assert_eq!(names(&dir), ["a.json", "manifest.json"]);
}
