//! Parts that are damaged, lost or of another study; directories in use.

use std::fs;
use std::path::{Path, PathBuf};

use mmae::report::lock::Lock;
use mmae::report::write::{self, sha256};
use mmae::sweep::{self, Error, Shard};

use crate::setup::{contents, plan, resume, scenario, scratch, shard};

fn parts(dir: &Path, table: &str) -> Vec<PathBuf> {
    let mut paths: Vec<_> =
        fs::read_dir(dir.join(table)).unwrap().map(|e| e.unwrap().path()).collect();
    paths.sort();
    paths
}

/// A stream of numbers that look random.
fn stream(mut state: u64) -> impl FnMut(usize) -> usize {
    move |below| {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    }
}

#[test]
fn every_truncation_and_bit_flip_is_found() {
    let dir = scratch("flips").join("out");
    shard(&plan(&scenario(4, 4), 16, false), Shard::WHOLE, &dir).unwrap();
    let mut next = stream(7);
    for table in ["plants", "upsilon"] {
        let path = parts(&dir, table).remove(0);
        let good = fs::read(&path).unwrap();
        let found = |bytes: &[u8]| {
            fs::write(&path, bytes).unwrap();
            let found = sweep::look(&[&dir]).unwrap();
            found.missing == [0] && found.damaged.iter().any(|(p, _)| *p == path)
        };
        for cut in 0..64 {
            let len = good.len() * cut / 64;
            assert!(found(&good[..len]), "{table} cut to {len} bytes");
        }
        for _ in 0..2000 {
            let (at, bit) = (next(good.len()), next(8));
            let mut bad = good.clone();
            bad[at] ^= 1 << bit;
            assert!(found(&bad), "{table}: bit {bit} of byte {at}");
        }
        fs::write(&path, &good).unwrap();
        assert!(sweep::look(&[&dir]).unwrap().problems().is_empty());
    }
}

#[test]
fn damaged_and_lost_parts_are_named_and_computed_again() {
    let plan = plan(&scenario(20, 20), 50, false);
    let base = scratch("damage");
    let dir = base.join("out");
    shard(&plan, Shard::WHOLE, &dir).unwrap();
    let before = contents(&dir);
    let (damaged, lost) = (parts(&dir, "upsilon").remove(3), parts(&dir, "plants").remove(5));
    let good = fs::read(&damaged).unwrap();
    fs::write(&damaged, &good[..good.len() / 2]).unwrap();
    fs::remove_file(&lost).unwrap();
    let out = base.join("merged");
    let Err(Error::Incomplete { problems }) = sweep::merge(&[&dir], &out, false, &mut |_| {})
    else {
        panic!("merged");
    };
    let all = problems.join("\n");
    for part in [&damaged, &lost] {
        assert!(all.contains(part.to_str().unwrap()), "{all}");
    }
    assert!(all.contains("2 of 10 blocks are missing: 3, 5"), "{all}");
    assert!(!out.exists());
    let (done, notes) = resume(&plan, Shard::WHOLE, &dir);
    let done = done.unwrap();
    assert_eq!((done.computed, done.kept), (2, 8));
    assert!(notes.len() == 1 && notes[0].contains(damaged.to_str().unwrap()), "{notes:?}");
    assert!(contents(&dir) == before);
    // a copy elsewhere makes up for a damaged one
    let copy = base.join("copy");
    shard(&plan, Shard::WHOLE, &copy).unwrap();
    fs::write(&damaged, b"").unwrap();
    let mut notes = Vec::new();
    sweep::merge(&[&dir, &copy], &out, false, &mut |note| notes.push(note.to_string())).unwrap();
    assert!(notes.len() == 1 && notes[0].contains("another copy"), "{notes:?}");
    assert!(contents(&out) == before);
    // a manifest that cannot be read is no loss
    for text in ["", "{\"schema\": \"mmae.par", "null"] {
        fs::write(copy.join("manifest.json"), text).unwrap();
        assert!(resume(&plan, Shard::WHOLE, &copy).0.unwrap().kept == 10);
        assert!(contents(&copy) == before);
    }
}

#[test]
fn parts_of_another_study_are_refused_by_name() {
    let text = format!("{}\n[run]\nsteps = 10\nseed = 1\n", scenario(12, 12));
    let text = text.replace("[bank]\n", "[bank]\ndt = 0.01\n");
    let base = scratch("foreign");
    let ours = plan(&text, 40, false);
    let dir = base.join("ours");
    shard(&ours, Shard::new(1, 2).unwrap(), &dir).unwrap();
    let others = [
        (plan(&text.replace("c = 0.4", "c = 0.5"), 40, false), "scenario"),
        (plan(&text.replace("seed = 1", "seed = 2"), 40, false), "its seed is 2, not 1"),
        (plan(&text, 30, false), "its block size is"),
        (plan(&text, 40, true), "its refinement is"),
    ];
    for (k, (other, what)) in others.iter().enumerate() {
        let theirs = base.join(format!("theirs-{k}"));
        shard(other, Shard::new(2, 2).unwrap(), &theirs).unwrap();
        let merged = sweep::merge(&[&dir, &theirs], &base.join("all"), false, &mut |_| {});
        let Err(Error::Incomplete { problems }) = merged else { panic!("merged") };
        assert!(problems[0].contains(what) && problems[0].contains("theirs"), "{problems:?}");
        let before = contents(&theirs);
        let (done, _) = resume(&ours, Shard::new(2, 2).unwrap(), &theirs);
        assert!(matches!(done, Err(Error::Foreign { .. })), "{done:?}");
        assert!(contents(&theirs) == before);
    }
    // a part of another version, sound in itself
    let path = parts(&dir, "plants").remove(0);
    let version = format!("\"version\":\"{}\"", env!("CARGO_PKG_VERSION"));
    let mut bytes = fs::read(&path).unwrap();
    let at = bytes.windows(version.len()).position(|w| w == version.as_bytes()).unwrap();
    bytes[at + version.len() - 2] = b'9';
    fs::remove_file(&path).unwrap();
    let name = format!("000000-{}.parquet", &sha256(&bytes)[..16]);
    fs::write(path.with_file_name(name), bytes).unwrap();
    let (done, _) = resume(&ours, Shard::new(1, 2).unwrap(), &dir);
    let message = done.unwrap_err().to_string();
    assert!(message.contains("its version is") && message.contains("000000-"), "{message}");
}

#[test]
fn a_directory_in_use_or_taken_is_refused() {
    let plan = plan(&scenario(12, 12), 40, false);
    let base = scratch("taken");
    let dir = base.join("out");
    fs::create_dir(&dir).unwrap();
    let lock = Lock::acquire(&dir).unwrap();
    let refused = shard(&plan, Shard::WHOLE, &dir);
    assert!(matches!(refused, Err(Error::Files(write::Error::Locked { .. }))), "{refused:?}");
    drop(lock);
    shard(&plan, Shard::WHOLE, &dir).unwrap();
    let before = contents(&dir);
    let refused = shard(&plan, Shard::WHOLE, &dir);
    assert!(matches!(refused, Err(Error::Present { .. })), "{refused:?}");
    assert!(contents(&dir) == before);
    // a result of another kind is not overwritten by --resume either
    let other = base.join("other");
    fs::create_dir(&other).unwrap();
    fs::write(other.join("manifest.json"), "{\"schema\": \"mmae.manifest/1\"}").unwrap();
    let refused = resume(&plan, Shard::WHOLE, &other).0;
    assert!(matches!(refused, Err(Error::Present { .. })), "{refused:?}");
    // a run that was asked to stop keeps what it has
    let stop = std::sync::atomic::AtomicBool::new(false);
    let report = |done, _| stop.store(done > 50, std::sync::atomic::Ordering::Relaxed);
    let control = mmae::par::RunControl::default().threads(1).cancel(&stop).progress(&report);
    let half = base.join("half");
    let stopped = sweep::run(&plan, Shard::WHOLE, &half, sweep::Mode::New, &control, &mut |_| {});
    assert!(matches!(stopped, Err(Error::Stopped { done: 2, of: 4 })), "{stopped:?}");
    assert_eq!(resume(&plan, Shard::WHOLE, &half).0.unwrap().kept, 2);
    assert!(contents(&half) == before);
}
