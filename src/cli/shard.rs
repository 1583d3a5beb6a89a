//! `mmae eip --shard`: one part of a study, block by block.

use std::io::{self, Write};

use super::arguments::EipArguments;
use super::failure::{Failure, say};
use super::output;
use super::progress::Progress;
use super::signals::Signals;
use crate::par::RunControl;
use crate::report::summary::count;
use crate::report::{significant, summary};
use crate::scenario::{Scenario, source};
use crate::sweep::{self, Manifest, Mode, Options, Plan, Shard, Summary};

pub(super) fn run(args: &EipArguments, signals: &Signals) -> Result<(), Failure> {
    // the bytes that are read are those whose digest the parts hold
    let bytes = source::read(&args.file, source::LIMIT)?;
    let scenario = Scenario::from_bytes(&args.file.display().to_string(), &bytes)?;
    for warning in scenario.warnings() {
        say("warning", &warning.to_string());
    }
    let explain = |e: crate::Error| Failure::from(scenario.explain(e));
    let options = Options { block: args.block.map(Into::into), refine: args.refine };
    let study = scenario.study()?;
    if study.unmodelled.is_some() || study.delay_interval.is_some() || study.law.is_some() {
        say(
            "note",
            "parts hold the sets alone: actuator.W, eip.delay_interval and [weighting] need the study at once",
        );
    }
    let plan = Plan::new(study, &bytes, scenario.seed(), options).map_err(explain)?;
    let Some(dir) = &args.out else { return Err(Failure::Cancelled) };
    let mode = match (args.resume, args.force) {
        (true, _) => Mode::Resume,
        (false, true) => Mode::Replace,
        (false, false) => Mode::New,
    };
    let shard = args.shard.unwrap_or(Shard::WHOLE);
    let progress = Progress::in_lines("plants");
    let report = |done, total| progress.update(done, total);
    let control = RunControl::default()
        .threads(args.threads.into())
        .cancel(signals.cancel())
        .progress(&report);
    let result = sweep::run(&plan, shard, dir, mode, &control, &mut |note| say("warning", note));
    progress.finish();
    let done = result.map_err(|e| match e {
        sweep::Error::Engine(e) => explain(e),
        e => Failure::from(e),
    })?;
    let files = count(done.manifest.files.len(), "part");
    say("note", &format!("{} holds {files} and manifest.json", dir.display()));
    let head = Head {
        shard: shard.to_string(),
        sha256: &done.written.sha256,
        computed_blocks: done.computed,
        kept_blocks: done.kept,
        manifest: &done.manifest,
    };
    let label = |i| plan.study().bank.label(i);
    output::print(
        Some(signals),
        |out| {
            if args.json { json(out, &head) } else { text(out, &head, label) }
        },
    )
}

/// What is printed beside the counts.
#[derive(serde::Serialize)]
struct Head<'a> {
    shard: String,
    /// Digest of the manifest.
    sha256: &'a str,
    computed_blocks: usize,
    kept_blocks: usize,
    manifest: &'a Manifest,
}

pub(super) fn json(out: &mut dyn Write, document: &impl serde::Serialize) -> io::Result<()> {
    serde_json::to_writer_pretty(&mut *out, document)?;
    writeln!(out)
}

fn text(out: &mut dyn Write, head: &Head<'_>, label: impl Fn(usize) -> String) -> io::Result<()> {
    let of = head.manifest.study.blocks;
    let blocks = count(of, "block");
    writeln!(out, "Shard {} of {blocks}", head.shard)?;
    writeln!(out, "{} computed, {} there already", head.computed_blocks, head.kept_blocks)?;
    counts(out, head.manifest, label)
}

/// The counts of a directory of parts as a table.
pub(super) fn counts(
    out: &mut dyn Write,
    manifest: &Manifest,
    label: impl Fn(usize) -> String,
) -> io::Result<()> {
    for case in &manifest.summary {
        writeln!(out)?;
        if manifest.summary.len() > 1 {
            writeln!(out, "Delay {}", summary::delay(case.delay))?;
        }
        writeln!(out, "plants        {}", case.plants)?;
        writeln!(out, "pairs         {}{}", case.pairs, saved(case))?;
        for (i, n) in case.winners.iter().enumerate() {
            let share = 100.0 * *n as f64 / case.plants.max(1) as f64;
            let line =
                format!("model {:<7} {n} ({} %)  {}", i + 1, significant(share, 3), label(i));
            writeln!(out, "{}", line.trim_end())?;
        }
        let others = [
            ("unstable", case.unstable),
            ("not built", case.failed),
            ("not decided", case.undecided),
        ];
        for (what, n) in others.into_iter().filter(|(_, n)| *n > 0) {
            writeln!(out, "{what:<13} {n}")?;
        }
        writeln!(
            out,
            "both routes   {} pairs, largest difference {}",
            case.checked_pairs,
            significant(case.route_difference, 2)
        )?;
    }
    Ok(())
}

/// How many pairs refinement has saved.
fn saved(case: &Summary) -> String {
    if case.computed_pairs == case.pairs {
        return String::new();
    }
    let saved = case.pairs - case.computed_pairs;
    let share = 100.0 * saved as f64 / case.pairs.max(1) as f64;
    format!(", {} computed, {saved} saved ({} %)", case.computed_pairs, significant(share, 3))
}
