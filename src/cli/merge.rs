//! `mmae merge`: the parts of all shards joined.

use super::arguments::MergeArguments;
use super::failure::{Failure, say};
use super::output;
use super::shard;
use crate::report::summary::count;
use crate::sweep::{self, Manifest};

/// What `--json` prints.
#[derive(serde::Serialize)]
struct Document<'a> {
    complete: bool,
    problems: Vec<String>,
    missing: Vec<usize>,
    /// Digest of the manifest.
    sha256: Option<&'a str>,
    manifest: Option<&'a Manifest>,
}

pub(super) fn run(args: &MergeArguments) -> Result<(), Failure> {
    let Some(out) = &args.out else { return check(args) };
    let result = sweep::merge(&args.dirs, out, args.force, &mut |note| say("warning", note));
    if let (true, Err(sweep::Error::Incomplete { .. })) = (args.json, &result) {
        return check(args);
    }
    let merged = result?;
    let files = count(merged.manifest.files.len(), "part");
    say("note", &format!("{} holds {files} and manifest.json", out.display()));
    output::print(None, |out| {
        if args.json {
            let document = Document {
                complete: true,
                problems: Vec::new(),
                missing: Vec::new(),
                sha256: Some(&merged.written.sha256),
                manifest: Some(&merged.manifest),
            };
            shard::json(out, &document)
        } else {
            writeln!(out, "Merged {}", count(merged.manifest.study.blocks, "block"))?;
            shard::counts(out, &merged.manifest, |_| String::new())
        }
    })
}

/// Says what is missing, and fails if something is.
fn check(args: &MergeArguments) -> Result<(), Failure> {
    let found = sweep::look(&args.dirs)?;
    let problems = found.problems();
    output::print(None, |out| {
        if args.json {
            let document = Document {
                complete: problems.is_empty(),
                problems: problems.clone(),
                missing: found.missing.clone(),
                sha256: None,
                manifest: None,
            };
            shard::json(out, &document)
        } else if problems.is_empty() {
            writeln!(out, "all blocks are there")
        } else {
            Ok(())
        }
    })?;
    if problems.is_empty() { Ok(()) } else { Err(Failure::Parts(problems)) }
}
