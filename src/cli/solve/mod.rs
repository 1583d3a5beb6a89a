//! `mmae solve`: a file of Riccati and Lyapunov equations.

mod answer;
mod file;
mod group;

use std::collections::BTreeMap;
use std::io::{self, Write};

use serde::Serialize;

use self::answer::Answer;
use self::group::Flat;
use super::arguments::SolveArguments;
use super::failure::{Failure, say};
use super::output;
use super::progress::Progress;
use super::signals::Signals;
use crate::error::{Error, Result};
use crate::par::RunControl;
use crate::report::layout;

pub(super) fn run(args: &SolveArguments, signals: &Signals) -> Result<(), Failure> {
    let problems = file::read(&args.file)?;
    if problems.cases.is_empty() {
        say("warning", "the file has no cases");
    }
    let progress = Progress::new();
    let report = |done, total| progress.update(done, total);
    let control = RunControl::default()
        .threads(args.threads.into())
        .cancel(signals.cancel())
        .progress(&report);
    let answers = answers(&problems.cases, &control);
    progress.finish();
    let answers = answers.map_err(|e| match e {
        Error::Cancelled => Failure::Cancelled,
        e => Failure::Numerical(vec![e.to_string()]),
    })?;
    let failed: Vec<&Answer> = answers.iter().filter(|a| a.X.is_none()).collect();
    output::print(Some(signals), |out| {
        if args.json { print_json(out, &answers) } else { print_text(out, &answers) }
    })?;
    if failed.is_empty() {
        return Ok(());
    }
    if failed.len() == answers.len() {
        return Err(Failure::Numerical(vec!["no equation has a solution".into()]));
    }
    say("warning", &format!("{} of {} equations have no solution", failed.len(), answers.len()));
    Ok(())
}

/// Solves all cases, those of one size together, in the order of the file.
fn answers(cases: &[file::Case], control: &RunControl<'_>) -> Result<Vec<Answer>> {
    let flat: Vec<Result<Flat>> = cases.iter().map(Flat::new).collect();
    let mut groups: BTreeMap<_, Vec<usize>> = BTreeMap::new();
    for (k, problem) in flat.iter().enumerate() {
        if let Ok(problem) = problem {
            groups.entry(problem.key()).or_default().push(k);
        }
    }
    let mut answers: Vec<Option<Answer>> = flat
        .iter()
        .zip(cases)
        .map(|(f, c)| f.as_ref().err().map(|e| Answer::failed(&c.id, c.eq, e)))
        .collect();
    for members in groups.values() {
        let problems: Vec<&Flat> = members.iter().filter_map(|&k| flat[k].as_ref().ok()).collect();
        let solutions = group::solve(&problems, control)?;
        for (i, (&k, problem)) in members.iter().zip(&problems).enumerate() {
            let id = &cases[k].id;
            let answer = match solutions.item(i) {
                Ok(x) => Answer::solved(id, problem, x, &solutions.items[i]),
                // alone, so that the message does not count items of a batch
                // that the user never saw; the bits are the same
                Err(e) => Err(group::solve(&[problem], control)?.item(0).err().unwrap_or(e)),
            };
            answers[k] = Some(answer.unwrap_or_else(|e| Answer::failed(id, problem.kind, &e)));
        }
    }
    Ok(answers.into_iter().flatten().collect())
}

#[derive(Serialize)]
struct Document<'a> {
    schema: &'static str,
    version: &'static str,
    cases: &'a [Answer],
}

fn print_json(out: &mut dyn Write, answers: &[Answer]) -> io::Result<()> {
    let document =
        Document { schema: "mmae.solve/1", version: env!("CARGO_PKG_VERSION"), cases: answers };
    serde_json::to_writer(&mut *out, &document)?;
    out.write_all(b"\n")
}

/// One line a problem: what was reached, or why not.
fn print_text(out: &mut dyn Write, answers: &[Answer]) -> io::Result<()> {
    let number = |v: Option<f64>, digits| match v {
        Some(0.0) => "0".into(),
        Some(v) => format!("{v:.digits$e}"),
        None => "-".into(),
    };
    let rows = answers.iter().map(|a| {
        let order = a.X.as_ref().map_or_else(|| "-".into(), |x| x.len().to_string());
        let margin = a.cl_abscissa.map(|v| -v).or(a.cl_radius.map(|v| 1.0 - v));
        [
            a.id.clone(),
            a.eq.into(),
            order,
            number(a.residual, 1),
            number(a.error_bound, 1),
            number(margin, 1),
            a.iterations.map_or_else(|| "-".into(), |v| v.to_string()),
            if a.reliable == Some(false) { "not reliable".into() } else { String::new() },
        ]
    });
    let head = ["id", "eq", "n", "residual", "error bound", "margin", "steps", ""];
    out.write_all(layout::grid(&head, rows).as_bytes())?;
    for a in answers {
        if let (Some(code), Some(message)) = (a.code, &a.message) {
            let id: String = a.id.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
            writeln!(out, "{id}: {code}: {message}")?;
        }
    }
    Ok(())
}
