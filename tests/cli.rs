//! The command from the outside: exit codes, streams, files, signals.
#![cfg(feature = "cli")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use serde_json::Value;

fn mmae() -> Command {
    Command::new(env!("CARGO_BIN_EXE_mmae"))
}

fn run(args: &[&str]) -> Output {
    mmae().args(args).stdin(Stdio::null()).output().unwrap()
}

fn scratch(name: &str) -> PathBuf {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("cli").join(name);
    let _ = fs::remove_dir_all(&dir);
    fs::create_dir_all(&dir).unwrap();
    dir
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// Asserts the exit code; returns the standard error.
#[track_caller]
fn fails(args: &[&str], code: i32) -> String {
    let out = run(args);
    let err = text(&out.stderr);
    assert_eq!(out.status.code(), Some(code), "{args:?}: {err}");
    assert!(err.starts_with("error: ") || err.contains("\nerror: "), "{err}");
    err
}

fn names(dir: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(dir).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn example(name: &str) -> String {
    format!("{}/examples/{name}.toml", env!("CARGO_MANIFEST_DIR"))
}

/// The pendulum with some text replaced, as a file in `dir`.
fn changed(dir: &Path, edits: &[(&str, &str)]) -> String {
    let mut scenario = fs::read_to_string(example("pendulum")).unwrap();
    for (from, to) in edits {
        assert!(scenario.contains(from), "the example no longer says {from}");
        scenario = scenario.replace(from, to);
    }
    let path = dir.join("changed.toml");
    fs::write(&path, scenario).unwrap();
    path.display().to_string()
}

#[test]
fn usage_errors_exit_2() {
    let file = example("pendulum");
    for args in [
        vec![],
        vec!["epi"],
        vec!["eip"],
        vec!["eip", &file, "--frobnicate"],
        vec!["new", "helicopter"],
    ] {
        assert_eq!(run(&args).status.code(), Some(2), "{args:?}");
    }
    for threads in ["-1", "1025", "1e6", "", "two", "1.5"] {
        let err = fails(&["eip", &file, "--threads", threads], 2);
        assert!(err.contains("--threads"), "{err}");
    }
}

#[test]
fn help_documents_the_exit_codes() {
    for args in [vec!["--help"], vec!["eip", "--help"]] {
        let out = run(&args);
        assert_eq!(out.status.code(), Some(0));
        let help = text(&out.stdout);
        for code in ["\n  2 ", "\n  3 ", "\n  4 ", "\n  6 ", "\n  7 ", "\n  130 ", "143"] {
            assert!(help.contains(code), "{code}: {help}");
        }
    }
    assert!(text(&run(&["--version"]).stdout).starts_with("mmae "));
}

#[test]
fn new_writes_scenarios_that_pass_the_check() {
    let dir = scratch("new");
    for kind in ["pendulum", "oscillator", "blank"] {
        let shown = run(&["new", kind]);
        assert_eq!(shown.status.code(), Some(0));
        let path = dir.join(format!("{kind}.toml"));
        let name = path.to_str().unwrap();
        assert_eq!(run(&["new", kind, "--out", name]).status.code(), Some(0));
        assert_eq!(fs::read(&path).unwrap(), shown.stdout);
        let check = run(&["check", name]);
        assert_eq!(check.status.code(), Some(0), "{}", text(&check.stderr));
    }
    let path = dir.join("pendulum.toml");
    fs::write(&path, "mine").unwrap();
    let err = fails(&["new", "--out", path.to_str().unwrap()], 6);
    assert!(err.contains("--force"), "{err}");
    assert_eq!(fs::read_to_string(&path).unwrap(), "mine");
    assert_eq!(run(&["new", "--force", "--out", path.to_str().unwrap()]).status.code(), Some(0));
    assert_ne!(fs::read_to_string(&path).unwrap(), "mine");
    fails(&["new", "--out", dir.join("no/such/dir.toml").to_str().unwrap()], 6);
    assert_eq!(names(&dir).len(), 3, "no temporary file stays");
}

#[test]
fn check_prints_sizes_as_text_and_json() {
    let out = run(&["check", &example("pendulum")]);
    assert_eq!(out.status.code(), Some(0), "{}", text(&out.stderr));
    let shown = text(&out.stdout);
    for part in
        ["theta_dot", "401 values", "plants        401", "models        4", "memory", "work"]
    {
        assert!(shown.contains(part), "{part}: {shown}");
    }
    assert!(shown.lines().all(|l| l.chars().count() <= 80), "{shown}");
    let out = run(&["check", "--json", &example("pendulum")]);
    let v: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!((&v["valid"], &v["size"]["plants"]), (&true.into(), &401.into()));
}

#[test]
fn wrong_scenarios_exit_3_with_the_place() {
    let dir = scratch("wrong");
    let file = changed(&dir, &[("[bank]", "[bnak]")]);
    let err = fails(&["eip", &file], 3);
    let line = 1 + fs::read_to_string(&file).unwrap().lines().position(|l| l == "[bnak]").unwrap();
    assert!(err.contains(&format!("{file}:{line}:")), "{err}");
    assert!(err.contains("bnak") && err.contains("bank"), "{err}");
    assert!(err.lines().all(|l| l.starts_with("error: ") || l.starts_with("warning: ")), "{err}");
    // the same for `check`, and for programs
    let out = run(&["check", "--json", &file]);
    assert_eq!(out.status.code(), Some(3));
    let v: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(v["valid"], false);
    assert_eq!(v["errors"][0]["line"], line);
    // nothing was made on the way
    let out = dir.join("out");
    fails(&["eip", &file, "--out", out.to_str().unwrap()], 3);
    assert!(!out.exists());
}

#[test]
fn unreadable_scenarios_exit_6_and_large_ones_7() {
    let dir = scratch("unreadable");
    let none = dir.join("none.toml").display().to_string();
    let folder = dir.display().to_string();
    for file in [none.as_str(), &folder, "/dev/zero"] {
        if file.starts_with("/dev") && !cfg!(unix) {
            continue;
        }
        for command in ["eip", "check"] {
            let err = fails(&[command, file], 6);
            assert!(err.contains(file), "{err}");
        }
    }
    let large = dir.join("large.toml");
    fs::File::create(&large).unwrap().set_len(200 << 20).unwrap();
    let err = fails(&["eip", large.to_str().unwrap()], 7);
    assert!(err.contains("209715200"), "{err}");
}

#[test]
fn studies_that_cannot_fit_exit_7_with_the_bytes() {
    let dir = scratch("limits");
    let file = changed(&dir, &[("points = 401", "points = 4000000000")]);
    for command in ["eip", "check"] {
        let err = fails(&[command, &file], 7);
        assert!(err.contains("bytes"), "{err}");
    }
    let out = dir.join("out");
    fails(&["eip", &file, "--out", out.to_str().unwrap()], 7);
    assert!(!out.exists());
}

#[test]
fn the_pendulum_end_to_end() {
    let dir = scratch("pendulum");
    let (a, b) = (dir.join("a"), dir.join("new/b"));
    let file = example("pendulum");
    let out = run(&["eip", &file, "--out", a.to_str().unwrap()]);
    assert_eq!(out.status.code(), Some(0), "{}", text(&out.stderr));
    let shown = text(&out.stdout);
    assert!(shown.contains("EIP set") && shown.contains("1.153616"), "{shown}");
    assert!(shown.lines().all(|l| l.chars().count() <= 80), "{shown}");
    let files = ["eip.json", "eip.svg", "manifest.json", "report.html", "upsilon.parquet"];
    assert_eq!(names(&a), files);

    let json = run(&["eip", &file, "--json", "--threads", "3", "--out", b.to_str().unwrap()]);
    assert_eq!(json.status.code(), Some(0), "{}", text(&json.stderr));
    assert_eq!(json.stdout, fs::read(a.join("eip.json")).unwrap(), "same bytes on any threads");
    for name in ["eip.json", "eip.svg", "upsilon.parquet"] {
        assert_eq!(fs::read(a.join(name)).unwrap(), fs::read(b.join(name)).unwrap(), "{name}");
    }
    let v: Value = serde_json::from_slice(&json.stdout).unwrap();
    assert_eq!(v["parameter"], "L");
    let wanted = [1.153616065, 1.404518669, 1.649832352];
    let boundaries = v["boundaries"].as_array().unwrap();
    assert_eq!(boundaries.len(), 3);
    for (i, (b, w)) in boundaries.iter().zip(wanted).enumerate() {
        assert!((b["value"].as_f64().unwrap() - w).abs() < 2e-9, "{b}");
        assert_eq!((&b["left"], &b["right"]), (&i.into(), &(i + 1).into()));
    }
    assert!((v["upsilon"][0][0].as_f64().unwrap() / 43.679226 - 1.0).abs() < 1e-7);

    let manifest: Value =
        serde_json::from_slice(&fs::read(b.join("manifest.json")).unwrap()).unwrap();
    assert_eq!(manifest["threads"], 3);
    assert_eq!(
        manifest["scenario"]["sha256"],
        mmae::report::write::sha256(&fs::read(&file).unwrap())
    );
    let listed = manifest["files"].as_array().unwrap();
    assert_eq!(listed.len(), 4);
    for entry in listed {
        let bytes = fs::read(b.join(entry["name"].as_str().unwrap())).unwrap();
        assert_eq!(entry["sha256"], mmae::report::write::sha256(&bytes));
        assert_eq!(entry["bytes"], bytes.len());
    }
}

/// Everything is inside: title and scenario as text, the picture, the tables.
#[test]
fn the_report_needs_nothing_else() {
    let dir = scratch("report");
    let title = "title = \"<script>alert('1')</script> & more\"";
    let old = "title = \"Inverted pendulum, length unknown\"";
    let file = changed(&dir, &[(old, title), ("points = 401", "points = 41")]);
    let out = dir.join("out");
    let done = run(&["eip", &file, "--out", out.to_str().unwrap()]);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let report = fs::read_to_string(out.join("report.html")).unwrap();
    for word in ["<script", " src=", " href=", "@import", "<?xml"] {
        assert!(!report.contains(word), "{word}");
    }
    let svg = fs::read_to_string(out.join("eip.svg")).unwrap();
    let curves = svg.matches("<path").count();
    assert!(curves > 4 && report.matches("<path").count() == curves);
    let sha = mmae::report::write::sha256(&fs::read(out.join("eip.json")).unwrap());
    for word in ["&lt;script&gt;alert(", "1.153616", "Upsilon at the nominal values", &sha] {
        assert!(report.contains(word), "{word}");
    }
}

#[test]
fn results_are_not_replaced_without_force() {
    let dir = scratch("force");
    let out = dir.join("out");
    let file = example("pendulum");
    let args = ["eip", &file, "--out", out.to_str().unwrap()];
    assert_eq!(run(&args).status.code(), Some(0));
    fs::write(out.join("eip.svg"), "touched by hand").unwrap();
    let before: Vec<_> = names(&out).iter().map(|n| fs::read(out.join(n)).unwrap()).collect();
    let err = fails(&args, 6);
    assert!(err.contains("--force"), "{err}");
    let after: Vec<_> = names(&out).iter().map(|n| fs::read(out.join(n)).unwrap()).collect();
    assert_eq!(before, after);
    assert_eq!(run(&[&args[..], &["--force"]].concat()).status.code(), Some(0));
    assert!(fs::read_to_string(out.join("eip.svg")).unwrap().starts_with("<?xml"));
    // a file, or a name that nobody means, is no directory
    fails(&["eip", &file, "--out", out.join("eip.svg").to_str().unwrap()], 6);
    fails(&["eip", &file, "--out", &dir.join("a\nb").display().to_string()], 6);
    fails(&["eip", &file, "--out", ""], 2);
    assert_eq!(names(&dir), ["out"]);
}

#[test]
fn a_locked_directory_exits_6_and_names_the_process() {
    let out = scratch("lock").join("out");
    fs::create_dir(&out).unwrap();
    let lock = mmae::report::lock::Lock::acquire(&out).unwrap();
    let err = fails(&["eip", &example("pendulum"), "--out", out.to_str().unwrap()], 6);
    assert!(err.contains(&std::process::id().to_string()), "{err}");
    drop(lock);
    assert!(names(&out).is_empty());
}

/// An unstable stretch is a partial result: exit 0, and told everywhere. No
/// stable plant at all is a numerical failure.
#[test]
fn partial_results_exit_0_and_empty_ones_4() {
    let dir = scratch("partial");
    // the controller, designed at L = 1.3, loses very short pendula
    let file = changed(&dir, &[("from = 0.9", "from = 0.05")]);
    let out = run(&["eip", &file]);
    assert_eq!(out.status.code(), Some(0), "{}", text(&out.stderr));
    assert!(text(&out.stderr).contains("warning: the loop of"), "{}", text(&out.stderr));
    assert!(text(&out.stdout).contains("unstable"));
    let v: Value = serde_json::from_slice(&run(&["eip", &file, "--json"]).stdout).unwrap();
    let unstable = v["unstable"].as_array().unwrap();
    assert!(!unstable.is_empty() && unstable.len() < 401);
    let plant = unstable[0]["plant"].as_u64().unwrap() as usize;
    assert!(v["winner"][plant].is_null() && v["upsilon"][plant][0].is_null());

    let file = changed(&dir, &[("from = 0.9", "from = 5"), ("to = 1.9", "to = 6")]);
    let target = dir.join("out");
    let err = fails(&["eip", &file, "--out", target.to_str().unwrap()], 4);
    assert!(err.contains("L = 5") && err.contains("mode"), "{err}");
    assert!(!target.exists());
}

/// Plants that cannot be built are flagged; a bank or a grid without any that
/// can is a failure.
#[test]
fn failed_plants_and_models_are_told_apart_from_unstable_ones() {
    let dir = scratch("failed");
    let damping =
        |from: &str| changed(&dir, &[("\"-b/M\"", &format!("\"-b/M + 0*sqrt({from})\""))]);
    let file = damping("L - 1.02");
    let out = run(&["eip", &file]);
    assert_eq!(out.status.code(), Some(0), "{}", text(&out.stderr));
    let (shown, err) = (text(&out.stdout), text(&out.stderr));
    assert!(err.contains("48 of 401 plants cannot be built, the first at L = 0.9"), "{err}");
    assert!(shown.contains("cannot be built") && !shown.contains("unstable"), "{shown}");
    assert!(shown.lines().all(|l| l.chars().count() <= 80), "{shown}");
    let v: Value = serde_json::from_slice(&run(&["eip", &file, "--json"]).stdout).unwrap();
    assert_eq!(v["failed"].as_array().unwrap().len(), 48);
    assert_eq!(v["unstable"], serde_json::json!([]));
    assert!(v["winner"][0].is_null() && v["upsilon"][0][0].is_null());
    assert!((v["failed_intervals"][0][1].as_f64().unwrap() - 1.02).abs() < 1e-9);

    // no model: only the nominal length, 1.4, is fine
    let file = damping("0.0001 - (L - 1.4)^2");
    let err = fails(&["eip", &file], 4);
    assert!(err.contains("none of the 4 models can be used"), "{err}");
}

#[test]
fn numbers_ignore_the_locale() {
    let file = example("pendulum");
    let plain = run(&["eip", &file]);
    let german = mmae()
        .args(["eip", &file])
        .env("LC_ALL", "de_DE.UTF-8")
        .env("LANG", "de_DE.UTF-8")
        .env("TZ", "Asia/Kathmandu")
        .output()
        .unwrap();
    assert_eq!(plain.stdout, german.stdout);
}

#[cfg(unix)]
mod unix {
    use super::*;
    use std::os::unix::process::ExitStatusExt;
    use std::process::Child;
    use std::time::{Duration, Instant};

    #[test]
    fn a_closed_output_is_no_failure() {
        let file = example("pendulum");
        for args in [["eip", &file, "--json"], ["new", "pendulum", "--force"]] {
            let mut child =
                mmae().args(args).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
            drop(child.stdout.take());
            let out = child.wait_with_output().unwrap();
            assert_eq!(out.status.code(), Some(0), "{}", text(&out.stderr));
            assert!(!text(&out.stderr).contains("error"), "{}", text(&out.stderr));
        }
    }

    #[test]
    fn a_full_output_exits_6() {
        let Ok(full) = fs::OpenOptions::new().write(true).open("/dev/full") else { return };
        let out = mmae()
            .args(["eip", &example("pendulum")])
            .stdout(full)
            .stderr(Stdio::piped())
            .output()
            .unwrap();
        assert_eq!(out.status.code(), Some(6));
        assert!(text(&out.stderr).contains("standard output"));
    }

    /// As on a full disk: the second file does not fit.
    #[test]
    fn a_file_size_limit_exits_6_and_leaves_nothing() {
        let dir = scratch("fsize");
        let out = dir.join("out");
        let script = format!(
            "ulimit -f 16; exec '{}' eip '{}' --out '{}'",
            env!("CARGO_BIN_EXE_mmae"),
            example("pendulum"),
            out.display()
        );
        let done = Command::new("bash").args(["-c", &script]).output().unwrap();
        assert_eq!(done.status.code(), Some(6), "{}", text(&done.stderr));
        assert!(names(&dir).is_empty(), "{:?}", names(&dir));
    }

    #[test]
    fn a_place_where_nothing_can_be_written_exits_6() {
        if !Path::new("/proc/self").exists() {
            return;
        }
        fails(&["eip", &example("pendulum"), "--out", "/proc/no/such"], 6);
    }

    /// A run of several seconds, even in release builds.
    fn long(dir: &Path) -> Child {
        let file = changed(dir, &[("points = 401", "points = 3000000")]);
        mmae()
            .args(["eip", &file, "--out", dir.join("deep/out").to_str().unwrap()])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap()
    }

    #[test]
    fn signals_stop_a_run_without_a_trace() {
        for (signal, code) in [("-INT", 130), ("-TERM", 143)] {
            let dir = scratch(&format!("signal{signal}"));
            let child = long(&dir);
            // once the directory is there the handlers are, too
            let start = Instant::now();
            while !dir.join("deep/out").exists() && start.elapsed() < Duration::from_secs(60) {
                std::thread::sleep(Duration::from_millis(5));
            }
            std::thread::sleep(Duration::from_millis(100));
            let sent = Instant::now();
            let kill = Command::new("kill").args([signal, &child.id().to_string()]).status();
            assert!(kill.unwrap().success());
            let out = child.wait_with_output().unwrap();
            assert_eq!(out.status.code(), Some(code), "{}", text(&out.stderr));
            assert!(sent.elapsed() < Duration::from_secs(5), "{:?}", sent.elapsed());
            assert!(out.stdout.is_empty());
            assert_eq!(names(&dir), ["changed.toml"]);
        }
    }

    /// A killed run leaves no result file, and the next one cleans up.
    #[test]
    fn a_killed_run_does_not_stand_in_the_way() {
        let dir = scratch("killed");
        let mut child = long(&dir);
        let out = dir.join("deep/out");
        let start = Instant::now();
        while !out.join(".mmae.lock").exists() && start.elapsed() < Duration::from_secs(60) {
            std::thread::sleep(Duration::from_millis(5));
        }
        child.kill().unwrap();
        assert_eq!(child.wait().unwrap().signal(), Some(9));
        assert!(names(&out).iter().all(|n| n.starts_with(".mmae")), "{:?}", names(&out));
        let again = run(&["eip", &example("pendulum"), "--out", out.to_str().unwrap()]);
        assert_eq!(again.status.code(), Some(0), "{}", text(&again.stderr));
        assert_eq!(
            names(&out),
            ["eip.json", "eip.svg", "manifest.json", "report.html", "upsilon.parquet"]
        );
    }
}
