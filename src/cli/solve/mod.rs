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
use crate::solve::Solutions;

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
    let answers = answers(&problems.cases, &control, group::solve);
    progress.finish();
    let Answers { answers, over_limit } = answers?;
    let failed: Vec<&Answer> = answers.iter().filter(|a| a.X.is_none()).collect();
    output::print(Some(signals), |out| {
        if args.json { print_json(out, &answers) } else { print_text(out, &answers) }
    })?;
    if failed.is_empty() {
        return Ok(());
    }
    if let Some(message) = over_limit {
        return Err(Failure::Limit(message));
    }
    if failed.len() == answers.len() {
        return Err(Failure::Numerical(vec!["no equation has a solution".into()]));
    }
    say("warning", &format!("{} of {} equations have no solution", failed.len(), answers.len()));
    Ok(())
}

/// What is known of every case, in the order of the file.
struct Answers {
    answers: Vec<Answer>,
    /// The first message of a batch that did not fit in memory.
    over_limit: Option<String>,
}

/// Solves problems of one size.
type Solver = fn(&[&Flat], &RunControl<'_>) -> Result<Solutions>;

/// Solves all cases, those of one size together. A batch that fails as a whole
/// fails its cases and no others.
fn answers(
    cases: &[file::Case],
    control: &RunControl<'_>,
    solve: Solver,
) -> Result<Answers, Failure> {
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
    let mut over_limit = None;
    for members in groups.values() {
        let problems: Vec<&Flat> = members.iter().filter_map(|&k| flat[k].as_ref().ok()).collect();
        let solutions = solve(&problems, control);
        if solutions == Err(Error::Cancelled) {
            return Err(Failure::Cancelled);
        }
        for (i, (&k, problem)) in members.iter().zip(&problems).enumerate() {
            let id = &cases[k].id;
            let answer = match &solutions {
                Ok(solutions) => match solutions.item(i) {
                    Ok(x) => Answer::solved(id, problem, x, &solutions.items[i]),
                    // alone, so that the message does not count items of a batch
                    // that the user never saw; the bits are the same
                    Err(e) => match solve(&[problem], control) {
                        Ok(alone) => Err(alone.item(0).err().unwrap_or(e)),
                        Err(Error::Cancelled) => return Err(Failure::Cancelled),
                        Err(_) => Err(e),
                    },
                },
                Err(e) => Err(e.clone()),
            };
            answers[k] = Some(answer.unwrap_or_else(|e| {
                if matches!(e, Error::Limit { .. }) && over_limit.is_none() {
                    over_limit = Some(e.to_string());
                }
                Answer::failed(id, problem.kind, &e)
            }));
        }
    }
    Ok(Answers { answers: answers.into_iter().flatten().collect(), over_limit })
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_batch_that_does_not_fit_fails_its_cases_alone() {
        let text = r#"{"cases": [
            {"id": "large", "eq": "clyap", "A": [[-1, 0], [0, -1]], "Q": [[1, 0], [0, 1]]},
            {"id": "small", "eq": "clyap", "A": [[-1]], "Q": [[2]]}
        ]}"#;
        let problems: file::Problems = serde_json::from_str(text).unwrap();
        let solver: Solver = |problems, control| {
            if problems[0].n == 1 {
                return group::solve(problems, control);
            }
            Err(Error::Limit { what: "X".into(), bytes: 2, limit: 1, remedy: "solve it in parts" })
        };
        let all = answers(&problems.cases, &RunControl::default(), solver).unwrap();
        assert_eq!(all.answers[0].code, Some("limit"));
        assert_eq!(all.answers[1].X, Some(vec![vec![1.0]]));
        assert!(all.over_limit.is_some_and(|message| message.contains("in parts")));
        let stopped =
            answers(&problems.cases, &RunControl::default(), |_, _| Err(Error::Cancelled));
        assert!(matches!(stopped, Err(Failure::Cancelled)));
    }
}
