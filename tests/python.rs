//! The Python package, from the checkout to its own tests: wheel, environment,
//! pytest, in a folder below the build's own.
//!
//! Without Python, or without a network for the first run, it says so and passes;
//! not where `CI` is set.

#![expect(clippy::print_stdout, clippy::print_stderr, reason = "what pytest says, and why not")]

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread;

const REQUIREMENTS: &str = "python/requirements-test.txt";

/// Runs a command, its output in the error.
fn run(command: &mut Command) -> Result<String, String> {
    let output = command.output().map_err(|e| format!("{command:?}: {e}"))?;
    let text = [&output.stdout[..], &output.stderr[..]].map(String::from_utf8_lossy).concat();
    if output.status.success() { Ok(text) } else { Err(format!("{command:?}:\n{text}")) }
}

/// A hash that is the same in every run (FNV-1a).
fn hash(bytes: &[u8], seed: u64) -> u64 {
    bytes.iter().fold(seed, |h, b| (h ^ u64::from(*b)).wrapping_mul(0x0100_0000_01b3))
}

/// Of the names and contents of all files below `path`, in order.
fn digest(path: &Path, seed: u64) -> u64 {
    let seed = hash(path.as_os_str().as_encoded_bytes(), seed);
    if path.is_file() {
        return hash(&fs::read(path).unwrap_or_default(), seed);
    }
    let Ok(entries) = fs::read_dir(path) else { return seed };
    let mut inside: Vec<PathBuf> = entries.flatten().map(|e| e.path()).collect();
    inside.retain(|p| !p.ends_with("__pycache__") && p.extension().is_none_or(|e| e != "so"));
    inside.sort();
    inside.iter().fold(seed, |seed, path| digest(path, seed))
}

struct Place {
    root: PathBuf,
    dir: PathBuf,
}

impl Place {
    fn python(&self) -> PathBuf {
        self.dir.join("venv/bin/python")
    }

    fn pip(&self, arguments: &[&str]) -> Result<String, String> {
        let quiet = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check"];
        run(Command::new(self.python()).args(quiet).args(arguments).current_dir(&self.root))
    }

    /// True if `name` was done for `what` before; else `work` does it.
    fn once(
        &self,
        name: &str,
        what: u64,
        work: impl FnOnce() -> Result<(), String>,
    ) -> Result<(), String> {
        let stamp = self.dir.join(name);
        let wanted = format!("{what:016x}");
        if fs::read_to_string(&stamp).is_ok_and(|done| done == wanted) {
            return Ok(());
        }
        let _ = fs::remove_file(&stamp);
        work()?;
        fs::write(&stamp, wanted).map_err(|e| e.to_string())
    }

    /// The environment with everything but the package itself; the wheel is built
    /// meanwhile.
    fn install(&self, system: &str) -> Result<(), String> {
        let requirements = digest(&self.root.join(REQUIREMENTS), hash(system.as_bytes(), 0));
        let sources = ["src", "python/src", "python/pymmae", "Cargo.lock", "python/pyproject.toml"]
            .iter()
            .fold(requirements, |seed, path| digest(&self.root.join(path), seed));
        self.once("tools.stamp", requirements, || {
            let _ = fs::remove_dir_all(self.dir.join("venv"));
            run(Command::new("python3").args(["-m", "venv"]).arg(self.dir.join("venv")))?;
            self.pip(&["--no-deps", "--only-binary", ":all:", &self.pinned("maturin")?]).map(|_| ())
        })?;
        let wheels = self.dir.join("wheels");
        thread::scope(|scope| {
            let others = scope.spawn(|| {
                self.once("packages.stamp", requirements, || {
                    self.pip(&["--only-binary", ":all:", "-r", REQUIREMENTS]).map(|_| ())
                })
            });
            let wheel = self.once("wheel.stamp", sources, || {
                let _ = fs::remove_dir_all(&wheels);
                // the profile of this test, whose results are there already
                let profile = if cfg!(debug_assertions) { "dev" } else { "release" };
                let mut build = Command::new(self.python());
                build.args(["-m", "maturin", "build", "--profile", profile, "--locked", "--quiet"]);
                build.args(["--auditwheel", "skip", "--manifest-path", "python/Cargo.toml"]);
                build.arg("--interpreter").arg(self.python());
                run(build.arg("--out").arg(&wheels).current_dir(&self.root)).map(|_| ())
            });
            others.join().map_err(|_| "the installation panicked".to_string())??;
            wheel
        })?;
        self.once("install.stamp", sources, || {
            let entries = fs::read_dir(&wheels).map_err(|e| e.to_string())?;
            let paths: Vec<PathBuf> = entries.flatten().map(|e| e.path()).collect();
            let [wheel] = &paths[..] else { return Err(format!("one wheel, not {paths:?}")) };
            let wheel = wheel.to_string_lossy();
            self.pip(&["--no-deps", "--force-reinstall", &wheel]).map(|_| ())
        })
    }

    /// `name==version` as pinned.
    fn pinned(&self, name: &str) -> Result<String, String> {
        let list = fs::read_to_string(self.root.join(REQUIREMENTS)).map_err(|e| e.to_string())?;
        let line = list.lines().find(|l| l.split("==").next() == Some(name));
        line.map(String::from).ok_or_else(|| format!("{REQUIREMENTS} does not pin {name}"))
    }
}

#[test]
fn the_python_package_passes_its_own_tests() {
    let strict = std::env::var_os("CI").is_some();
    let skip = |why: &str| {
        assert!(!strict, "{why}");
        eprintln!("the Python package was not tested: {why}");
    };
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    if !root.join(REQUIREMENTS).is_file() {
        return skip("it is not part of this checkout");
    }
    let probe =
        "import sys, venv, ensurepip; assert sys.version_info >= (3, 11); print(sys.version)";
    let Ok(system) = run(Command::new("python3").args(["-c", probe])) else {
        return skip("it needs python3 of version 3.11 or later, with venv: install it");
    };
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("pymmae");
    fs::create_dir_all(&dir).expect("the target folder can be written to");
    // two runs at once would build into each other
    let lock = File::create(dir.join("lock")).expect("the target folder can be written to");
    lock.lock().expect("the lock is free at last");
    let place = Place { root, dir };
    if let Err(error) = place.install(&system) {
        let offline = !strict && error.contains("No matching distribution");
        assert!(offline, "the package could not be installed: {error}");
        return skip("its packages cannot be downloaded");
    }
    let tests = Command::new(place.python())
        .args(["-m", "pytest", "-q", "-p", "no:cacheprovider", "python/tests"])
        .env("MMAE_COMMAND", env!("CARGO_BIN_EXE_mmae"))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .env("MPLCONFIGDIR", place.dir.join("matplotlib"))
        .env("HYPOTHESIS_STORAGE_DIRECTORY", place.dir.join("hypothesis"))
        .current_dir(&place.root)
        .output();
    let tests = tests.expect("the environment has Python");
    println!("{}", String::from_utf8_lossy(&tests.stdout));
    assert!(tests.status.success(), "{}", String::from_utf8_lossy(&tests.stderr));
}
