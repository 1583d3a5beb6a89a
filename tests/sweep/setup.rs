//! A small study of two parameters, and directories.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use mmae::par::RunControl;
use mmae::scenario::Scenario;
use mmae::sweep::{self, Done, Error, Mode, Options, Plan, Shard};

pub(crate) fn scratch(name: &str) -> PathBuf {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("sweep").join(name);
    let _ = fs::remove_dir_all(&dir);
    fs::create_dir_all(&dir).unwrap();
    dir
}

/// The example of two parameters on a grid of `k` times `c` plants, some of
/// them unstable.
pub(crate) fn scenario(k: usize, c: usize) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/two_parameters.toml");
    let text = fs::read_to_string(path).unwrap();
    let text = text.replace("points = 61", &format!("points = {k}"));
    text.replace(
        "from = 0.1, to = 1.2, points = 41",
        &format!("from = -0.1, to = 1.2, points = {c}"),
    )
}

pub(crate) fn plan(text: &str, block: usize, refine: bool) -> Plan {
    let scenario = Scenario::parse("study.toml", text).unwrap();
    let options = Options { block: Some(block), refine };
    Plan::new(scenario.study().unwrap(), text.as_bytes(), scenario.seed(), options).unwrap()
}

/// Runs a shard where nothing is, on one thread.
pub(crate) fn shard(plan: &Plan, shard: Shard, dir: &Path) -> Result<Done, Error> {
    let control = RunControl::default().threads(1);
    sweep::run(plan, shard, dir, Mode::New, &control, &mut |note| panic!("{note}"))
}

/// Resumes a shard; returns what was noted as well.
pub(crate) fn resume(plan: &Plan, shard: Shard, dir: &Path) -> (Result<Done, Error>, Vec<String>) {
    let mut notes = Vec::new();
    let control = RunControl::default().threads(2);
    let done =
        sweep::run(plan, shard, dir, Mode::Resume, &control, &mut |note| notes.push(note.into()));
    (done, notes)
}

/// Every file below `dir` with its bytes.
pub(crate) fn contents(dir: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut all = BTreeMap::new();
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_string();
        if path.is_dir() {
            let inside = contents(&path).into_iter();
            all.extend(inside.map(|(inner, bytes)| (format!("{name}/{inner}"), bytes)));
        } else {
            all.insert(name, fs::read(path).unwrap());
        }
    }
    all
}

/// Blocks of which both files are there.
pub(crate) fn whole_blocks(dir: &Path) -> usize {
    let blocks = |table: &str| -> Vec<String> {
        let entries = fs::read_dir(dir.join(table)).into_iter().flatten();
        let names = entries.map(|e| e.unwrap().file_name().into_string().unwrap());
        names.filter(|n| n.ends_with(".parquet")).map(|n| n[..6].to_string()).collect()
    };
    let upsilon = blocks("upsilon");
    blocks("plants").iter().filter(|block| upsilon.contains(block)).count()
}
