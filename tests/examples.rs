//! The examples hold what they claim.
#![cfg(feature = "cli")]

use std::path::Path;
use std::process::{Command, Stdio};

/// `cargo test` builds the examples beside the program; a test that is asked for
/// by name may come without them.
#[test]
fn examples_run() {
    let folder = Path::new(env!("CARGO_BIN_EXE_mmae")).with_file_name("examples");
    for name in ["real_time", "record", "monte_carlo", "arrays"] {
        let program = folder.join(format!("{name}{}", std::env::consts::EXE_SUFFIX));
        if !program.exists() {
            continue;
        }
        let out = Command::new(program).stdin(Stdio::null()).output().unwrap();
        let told = String::from_utf8_lossy(&out.stderr);
        assert!(out.status.success(), "{name}: {told}");
        assert!(!out.stdout.is_empty(), "{name}");
    }
}
