//! Blocks, shards, merges, refinement: against the study at once.

use std::fs;
use std::path::Path;

use allocation_counter::measure;
use mmae::eip::EipSets;
use mmae::par::RunControl;
use mmae::scenario::Scenario;
use mmae::sweep::{self, Shard};
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::{Field, Row};

use crate::setup::{contents, plan, resume, scenario, scratch, shard};

/// Rows of a table of parts, in the order of the blocks.
fn rows(dir: &Path, table: &str) -> Vec<Row> {
    let mut paths: Vec<_> =
        fs::read_dir(dir.join(table)).unwrap().map(|e| e.unwrap().path()).collect();
    paths.sort();
    let open = |path| SerializedFileReader::new(fs::File::open(path).unwrap()).unwrap();
    paths.into_iter().flat_map(|path| open(path).into_iter().map(Result::unwrap)).collect()
}

fn field<'a>(row: &'a Row, name: &str) -> &'a Field {
    row.get_column_iter().find(|(n, _)| *n == name).unwrap().1
}

fn number(row: &Row, name: &str) -> Option<f64> {
    match field(row, name) {
        Field::Double(v) => Some(*v),
        Field::Long(v) => Some(*v as f64),
        Field::Int(v) => Some(f64::from(*v)),
        Field::Null => None,
        other => panic!("{name}: {other:?}"),
    }
}

fn at_once(text: &str) -> EipSets {
    let study = Scenario::parse("study.toml", text).unwrap().study().unwrap();
    study.run(&RunControl::default()).unwrap()
}

/// Bits of a number of a table and of a study.
fn same(found: Option<f64>, wanted: f64) -> bool {
    match found {
        Some(found) => found.to_bits() == wanted.to_bits(),
        None => !wanted.is_finite(),
    }
}

#[test]
fn parts_have_the_bits_of_the_study_at_once() {
    let text = scenario(41, 33);
    let sets = at_once(&text);
    let case = &sets.cases[0];
    assert!(!case.unstable.is_empty());
    let dir = scratch("bits").join("out");
    let done = shard(&plan(&text, 100, false), Shard::WHOLE, &dir).unwrap();
    assert!(done.manifest.complete && done.computed == 14 && done.kept == 0);
    let pairs = rows(&dir, "upsilon");
    assert_eq!([pairs.len(), case.error.len()], [case.upsilon.len(); 2]);
    for (row, (upsilon, error)) in pairs.iter().zip(case.upsilon.iter().zip(&case.error)) {
        assert!(same(number(row, "upsilon"), *upsilon) && same(number(row, "error"), *error));
    }
    let plants = rows(&dir, "plants");
    assert_eq!(plants.len(), sets.grid.len());
    for (k, row) in plants.iter().enumerate() {
        assert_eq!(number(row, "plant"), Some(k as f64));
        let point = sets.grid.point(k);
        assert!(same(number(row, "k"), point[0]) && same(number(row, "c"), point[1]));
        assert_eq!(number(row, "winner"), case.winner[k].map(|w| w as f64));
        assert!(same(number(row, "margin"), case.margin[k]));
        let unstable = case.unstable.iter().any(|u| u.plant == k);
        let status = if unstable { "unstable" } else { "decided" };
        assert_eq!(field(row, "status"), &Field::Str(status.into()));
        assert_eq!(matches!(field(row, "detail"), Field::Null), !unstable);
    }
    let summary = &done.manifest.summary[0];
    assert_eq!(summary.unstable, case.unstable.len());
    assert_eq!(summary.checked_pairs, case.checked_pairs);
    assert_eq!(summary.route_difference.to_bits(), case.route_difference.to_bits());
}

#[test]
fn row_groups_say_what_they_hold() {
    let dir = scratch("statistics").join("out");
    shard(&plan(&scenario(21, 16), 64, false), Shard::WHOLE, &dir).unwrap();
    for table in ["plants", "upsilon"] {
        for entry in fs::read_dir(dir.join(table)).unwrap() {
            let reader =
                SerializedFileReader::new(fs::File::open(entry.unwrap().path()).unwrap()).unwrap();
            for group in reader.metadata().row_groups() {
                for column in group.columns() {
                    let statistics = column.statistics().unwrap();
                    let nulls = statistics.null_count_opt() == Some(group.num_rows() as u64);
                    assert!(
                        nulls || statistics.min_bytes_opt().is_some(),
                        "{}",
                        column.column_path()
                    );
                }
            }
        }
    }
}

#[test]
fn shards_of_any_number_merge_to_the_same_bytes() {
    let text = scenario(29, 31);
    for refine in [false, true] {
        let plan = plan(&text, 120, refine);
        let base = scratch(if refine { "merged-refined" } else { "merged" });
        let whole = base.join("whole");
        shard(&plan, Shard::WHOLE, &whole).unwrap();
        let whole = contents(&whole);
        assert_eq!(whole.len(), 2 * plan.blocks() + 1);
        for n in [1, 3, 7, 20] {
            let mut dirs = Vec::new();
            // the last ones first: who computes what when does not matter
            for s in Shard::all(n).collect::<Vec<_>>().into_iter().rev() {
                let dir = base.join(format!("{}-of-{n}", s.index()));
                let (done, notes) = resume(&plan, s, &dir);
                assert!(done.unwrap().kept == 0 && notes.is_empty());
                dirs.push(dir);
            }
            let out = base.join(format!("all-{n}"));
            let merged = sweep::merge(&dirs, &out, false, &mut |note| panic!("{note}")).unwrap();
            assert!(merged.manifest.complete);
            assert!(contents(&out) == whole, "{n} shards");
        }
        // all shards in one directory, one after the other
        let one = base.join("one");
        for s in Shard::all(3) {
            resume(&plan, s, &one).0.unwrap();
        }
        assert!(contents(&one) == whole);
    }
}

#[test]
fn refinement_finds_the_winners_of_the_full_grid() {
    let text = scenario(121, 90);
    let case = at_once(&text).cases.remove(0);
    let models = case.upsilon.len() / case.winner.len();
    let dir = scratch("refined").join("out");
    let done = shard(&plan(&text, 4000, true), Shard::WHOLE, &dir).unwrap();
    let summary = &done.manifest.summary[0];
    assert_eq!(summary.plants, 121 * 90);
    assert!(2 * summary.computed_pairs < summary.pairs, "{summary:?}");
    assert_eq!(summary.computed_pairs, summary.computed * models);
    for row in rows(&dir, "upsilon") {
        let (k, i) = (number(&row, "plant").unwrap(), number(&row, "model").unwrap());
        let wanted = case.upsilon[k as usize * models + i as usize];
        assert!(same(number(&row, "upsilon"), wanted));
    }
    let mut inferred = 0;
    for (k, row) in rows(&dir, "plants").iter().enumerate() {
        assert_eq!(number(row, "winner"), case.winner[k].map(|w| w as f64), "plant {k}");
        let guessed = field(row, "status") == &Field::Str("inferred".into());
        inferred += usize::from(guessed);
        assert!(
            guessed && number(row, "margin").is_none()
                || same(number(row, "margin"), case.margin[k])
        );
    }
    assert_eq!(inferred, summary.plants - summary.computed);
}

/// Six parameters, and a study whose grid alone is far over its memory limit.
#[test]
fn six_parameters_run_in_blocks() {
    let axes = |n: usize| {
        let names = ["k", "c", "m", "q", "r", "g"];
        let axis = |name: &&str| format!("{name} = {{ from = 1.0, to = 1.5, points = {n} }}");
        names.iter().map(axis).collect::<Vec<_>>().join(", ")
    };
    let text = scenario(2, 2)
        .replace("G = [0, \"1/m\"]", "G = [0, \"g/m\"]")
        .replace("Q = 1 ", "Q = \"q\" ")
        .replace("C = [1, 0]", "C = [\"r\", 0]")
        .replace("m = 1.0 # kg", "m = 1.0\nq = 1.0\nr = 1.0\ng = 1.0");
    let at = text.find("grid = ").unwrap();
    let end = at + text[at..].find('\n').unwrap();
    let with = |n| {
        format!("{}grid = {{ {} }}\nmemory_limit = \"8 MiB\"{}", &text[..at], axes(n), &text[end..])
    };
    let large = Scenario::parse("six.toml", &with(12)).unwrap().study().unwrap();
    assert!(matches!(large.cost(), Err(mmae::Error::Limit { .. })));
    assert_eq!(large.grid.len(), 2_985_984);
    let setup = large.prepare_blocks(2000).unwrap();
    let mut blocks = setup.blocks(2000, false).unwrap();
    let last = blocks.len() - 1;
    let block = blocks.run(last, &RunControl::default()).unwrap();
    assert_eq!(block.plants.end, large.grid.len());
    assert!(block.cases[0].winner.iter().all(Option::is_some));
    // small enough to be compared with the study at once
    let text = with(3);
    let sets = at_once(&text);
    let dir = scratch("six").join("out");
    shard(&plan(&text, 50, false), Shard::WHOLE, &dir).unwrap();
    let winners: Vec<Option<f64>> =
        rows(&dir, "plants").iter().map(|r| number(r, "winner")).collect();
    let wanted: Vec<_> = sets.cases[0].winner.iter().map(|w| w.map(|w| w as f64)).collect();
    assert_eq!(winners, wanted);
}

/// What a run holds at most is that of a block.
#[test]
fn memory_does_not_grow_with_the_grid() {
    let peak = |k: usize, name: &str| {
        let plan = plan(&scenario(k, 50), 1000, false);
        let dir = scratch(name).join("out");
        measure(|| {
            shard(&plan, Shard::WHOLE, &dir).unwrap();
        })
        .bytes_max
    };
    let (small, large) = (peak(40, "memory-small"), peak(400, "memory-large"));
    assert!(large as f64 <= 1.1 * small as f64, "{small} bytes, then {large}");
}
