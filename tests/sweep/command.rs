//! `mmae eip --shard` and `mmae merge` from the outside.

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use serde_json::Value;

use crate::setup::{contents, scenario, scratch, whole_blocks};

fn mmae(args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mmae"));
    command.args(args).stdin(Stdio::null());
    command
}

fn run(args: &[&str]) -> Output {
    mmae(args).output().unwrap()
}

#[track_caller]
fn ends(args: &[&str], code: i32) -> (String, String) {
    let out = run(args);
    let (stdout, stderr) = (out.stdout, String::from_utf8(out.stderr).unwrap());
    assert_eq!(out.status.code(), Some(code), "{args:?}: {stderr}");
    (String::from_utf8(stdout).unwrap(), stderr)
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn shards_run_and_merge() {
    let base = scratch("command");
    let (file, out) = (base.join("study.toml"), base.join("all"));
    fs::write(&file, scenario(20, 21)).unwrap();
    let dirs: Vec<_> = (1..=3).map(|i| base.join(format!("s{i}"))).collect();
    for (i, dir) in dirs.iter().enumerate() {
        let shard = format!("{}/3", i + 1);
        let args = ["eip", text(&file), "--out", text(dir), "--block", "50", "--shard", &shard];
        let (stdout, stderr) = ends(&args, 0);
        assert!(stdout.contains(&format!("Shard {shard} of 10 blocks")), "{stdout}");
        assert!(stderr.starts_with("note: "), "{stderr}");
        let (_, stderr) = ends(&args, 6);
        assert!(stderr.contains("--resume continues"), "{stderr}");
    }
    let all: Vec<&str> = dirs.iter().map(|d| text(d)).collect();
    let (_, stderr) = ends(&["merge", all[0], all[2], "--out", text(&out)], 5);
    assert!(stderr.contains("blocks are missing: 3 to 5"), "{stderr}");
    assert!(!out.exists());
    let (stdout, _) = ends(&["merge", all[0], all[2], "--check", "--json"], 5);
    let found: Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(found["missing"], serde_json::json!([3, 4, 5]));
    let (stdout, _) = ends(&["merge", all[0], all[1], all[2], "--out", text(&out), "--json"], 0);
    let merged: Value = serde_json::from_str(&stdout).unwrap();
    let manifest = fs::read(out.join("manifest.json")).unwrap();
    assert_eq!(merged["sha256"], mmae::report::write::sha256(&manifest));
    assert_eq!(merged["manifest"], serde_json::from_slice::<Value>(&manifest).unwrap());
    ends(&["merge", all[0], all[1], all[2], "--out", text(&out)], 6);
    for wrong in ["0/3", "4/3", "1", "a/b", "1/0"] {
        ends(&["eip", text(&file), "--out", "x", "--shard", wrong], 2);
    }
    ends(&["eip", text(&file), "--shard", "1/1"], 2);
    ends(&["merge", text(&base.join("none")), "--out", text(&out)], 6);
}

fn resuming<'a>(file: &'a Path, dir: &'a Path) -> [&'a str; 8] {
    ["eip", text(file), "--out", text(dir), "--block", "100", "--resume", "--json"]
}

/// Killed at 20 random moments and resumed each time: the bytes of a run that
/// was left alone, and whatever was whole is kept.
#[cfg(unix)]
#[test]
fn a_killed_run_resumes_to_the_same_bytes() {
    let base = scratch("killed");
    let file = base.join("study.toml");
    fs::write(&file, scenario(60, 100)).unwrap();
    let whole = base.join("whole");
    let start = std::time::Instant::now();
    ends(&resuming(&file, &whole), 0);
    let whole = contents(&whole);
    // moments from before the first block to after the last of a share of it
    let span = start.elapsed().as_millis() as u64;
    let (mut kills, mut round, mut state) = (0, 0, 2026_u64);
    while kills < 20 {
        let dir = base.join(format!("round-{round}"));
        let mut before = 0;
        loop {
            let mut child = mmae(&resuming(&file, &dir))
                .stdout(Stdio::piped())
                .stderr(Stdio::null())
                .spawn()
                .unwrap();
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            let wait = (state >> 40) % (span / 3).max(1);
            if kills < 20 {
                std::thread::sleep(std::time::Duration::from_millis(wait));
                if child.try_wait().unwrap().is_none() {
                    child.kill().unwrap();
                    child.wait().unwrap();
                    kills += 1;
                    let now = whole_blocks(&dir);
                    assert!(now >= before, "{before} blocks, then {now}");
                    before = now;
                    continue;
                }
            }
            let out = child.wait_with_output().unwrap();
            assert!(out.status.success());
            let told: Value = serde_json::from_slice(&out.stdout).unwrap();
            assert_eq!(told["kept_blocks"], before);
            break;
        }
        assert!(contents(&dir) == whole, "round {round}, {kills} kills");
        round += 1;
    }
}

/// Files of at most 2 KiB: the parts written before stay, and a
/// run with room continues.
#[cfg(unix)]
#[test]
fn a_full_disk_leaves_earlier_parts_intact() {
    let base = scratch("full");
    let (file, out) = (base.join("study.toml"), base.join("out"));
    fs::write(&file, scenario(20, 21)).unwrap();
    let args = ["eip", text(&file), "--out", text(&out), "--block", "30", "--shard", "1/5"];
    ends(&args, 0);
    let before = contents(&out);
    let script = format!(
        "ulimit -f 2; exec '{}' eip '{}' --out '{}' --block 30 --resume",
        env!("CARGO_BIN_EXE_mmae"),
        text(&file),
        text(&out)
    );
    let full = Command::new("bash").args(["-c", &script]).output().unwrap();
    let stderr = String::from_utf8(full.stderr).unwrap();
    assert_eq!(full.status.code(), Some(6), "{stderr}");
    assert!(stderr.contains("free space"), "{stderr}");
    assert!(contents(&out) == before);
    let (stdout, _) =
        ends(&["eip", text(&file), "--out", text(&out), "--block", "30", "--resume"], 0);
    assert!(stdout.contains("16 computed, 4 there already"), "{stdout}");
    if Path::new("/proc/self").exists() {
        ends(&["eip", text(&file), "--out", "/proc/no/such", "--shard", "1/1"], 6);
    }
    // another run holds the directory
    let lock = mmae::report::lock::Lock::acquire(&out).unwrap();
    let (_, stderr) =
        ends(&["eip", text(&file), "--out", text(&out), "--block", "30", "--resume"], 6);
    assert!(stderr.contains(&format!("locked by process {}", std::process::id())), "{stderr}");
    drop(lock);
}
