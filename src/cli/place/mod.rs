//! `mmae place`: nominal values whose EIP sets are the cells wanted.

mod scatter;

use std::io::{self, Write};
use std::path::Path;

use serde::Serialize;

use super::arguments::PlaceArguments;
use super::failure::{Failure, say};
use super::output;
use super::signals::Signals;
use crate::eip::{Cells, Placement, Study};
use crate::error::Error;
use crate::par::RunControl;
use crate::report::{figure, layout, significant, write};
use crate::scenario::{Scenario, with_models};

/// Share of the domain by which a boundary may miss its edge unmentioned.
const MISS: f64 = 1e-9;

#[derive(Serialize)]
struct Document<'a> {
    schema: &'static str,
    version: &'static str,
    parameter: &'a str,
    domain: [f64; 2],
    nominals: &'a [f64],
    edges: &'a [f64],
    excess: &'a [f64],
    penalty: &'a [f64],
    sensitivity: Vec<Option<f64>>,
    anchored: bool,
    feasible: [f64; 2],
}

pub(super) fn run(args: &PlaceArguments, signals: &Signals) -> Result<(), Failure> {
    let scenario = Scenario::from_file(&args.file)?;
    for warning in scenario.warnings() {
        say("warning", &warning.to_string());
    }
    let study = scenario.study()?;
    let control = RunControl::default().cancel(signals.cancel());
    let failed = |e: Error| match e {
        Error::Cancelled => Failure::Cancelled,
        e => Failure::from(scenario.explain(e)),
    };
    if study.grid.axes().len() > 1 {
        one_parameter_only(args).map_err(failed)?;
        let placed = study.scatter(args.cells.map(usize::from), &control).map_err(failed)?;
        return scatter::report(args, &placed, signals);
    }
    let placed = study.place(&cells(args, &study), args.anchor, &control).map_err(failed)?;
    let width = placed.domain[1] - placed.domain[0];
    let met = |(edge, want): (&f64, &f64)| (edge - want).abs() <= MISS * width;
    if placed.edges.len() != placed.wanted.len()
        || !placed.edges.iter().zip(&placed.wanted).all(met)
    {
        let what = "the sets of these nominal values are not the cells: other models win in parts";
        say("warning", &format!("{what} of them; look at the study with mmae eip"));
    }
    if let Some(path) = &args.out {
        let values: Vec<Vec<f64>> = placed.nominals.iter().map(|v| vec![*v]).collect();
        let text = with_models(&args.file, std::slice::from_ref(&placed.parameter), &values)?;
        save(path, text.as_bytes(), args.force)?;
    }
    if let Some(path) = &args.picture {
        let picture = picture(&study, &placed, &control).map_err(failed)?;
        save(path, &picture, args.force)?;
    }
    output::print(Some(signals), |out| {
        if args.json { json(out, args, &placed) } else { text(out, &placed) }
    })
}

fn save(path: &Path, bytes: &[u8], force: bool) -> Result<(), Failure> {
    write::file(path, bytes, force)?;
    say("note", &format!("wrote {}", path.display()));
    Ok(())
}

/// Fails where an option asks for what several parameters do not have.
fn one_parameter_only(args: &PlaceArguments) -> Result<(), Error> {
    let given = [
        ("--edges", !args.edges.is_empty()),
        ("--anchor", args.anchor.is_some()),
        ("--excess", args.excess.is_some()),
        ("--penalty", args.penalty.is_some()),
        ("--picture", args.picture.is_some()),
    ];
    match given.iter().find(|(_, given)| *given) {
        None => Ok(()),
        Some((option, _)) => Err(Error::Conflict {
            problem: format!("{option} with a grid of several parameters"),
            remedy: "give --cells alone, or vary one parameter".into(),
        }),
    }
}

/// The sets with the bank's own models, and with those placed.
fn picture(study: &Study, placed: &Placement, control: &RunControl<'_>) -> Result<Vec<u8>, Error> {
    let mut plain = study.bare();
    let before = plain.run(control)?;
    plain.bank.models = placed.nominals.iter().map(|v| vec![*v]).collect();
    plain.bank.labels = Vec::new();
    let after = plain.run(control)?;
    let mut bytes = Vec::new();
    // writing to memory does not fail
    let _ = figure::write_placement(&before, &after, &mut bytes);
    Ok(bytes)
}

/// What was asked for.
fn cells(args: &PlaceArguments, study: &Study) -> Cells {
    if let Some(bound) = args.excess {
        return Cells::Within(bound);
    }
    if let Some(bound) = args.penalty {
        return Cells::Penalty(bound);
    }
    if !args.edges.is_empty() {
        let axis = study.grid.axes().first().map(|a| &a.1);
        let ends = axis.map(|a| [a.value(0), a.value(a.len() - 1)]);
        let inner = args.edges.iter().filter(|e| !ends.is_some_and(|ends| ends.contains(e)));
        return Cells::Edges(inner.copied().collect());
    }
    Cells::Count(args.cells.map_or(study.bank.models.len(), usize::from))
}

fn json(out: &mut dyn Write, args: &PlaceArguments, placed: &Placement) -> io::Result<()> {
    let document = Document {
        schema: "mmae.place/1",
        version: env!("CARGO_PKG_VERSION"),
        parameter: &placed.parameter,
        domain: placed.domain,
        nominals: &placed.nominals,
        edges: &placed.edges,
        excess: &placed.excess,
        penalty: &placed.penalty,
        sensitivity: placed.sensitivity.iter().map(|s| s.is_finite().then_some(*s)).collect(),
        anchored: args.anchor.is_some(),
        feasible: placed.feasible,
    };
    serde_json::to_writer(&mut *out, &document)?;
    out.write_all(b"\n")
}

fn text(out: &mut dyn Write, placed: &Placement) -> io::Result<()> {
    let name = &placed.parameter;
    let [from, to] = placed.domain;
    writeln!(
        out,
        "{} models on {name} in [{}, {}].\n",
        placed.nominals.len(),
        significant(from, 9),
        significant(to, 9)
    )?;
    let mut edges = vec![from];
    edges.extend(&placed.wanted);
    edges.push(to);
    let rows = placed.nominals.iter().enumerate().map(|(i, nominal)| {
        [
            (i + 1).to_string(),
            significant(*nominal, 10),
            format!("[{}, {}]", significant(edges[i], 9), significant(edges[i + 1], 9)),
            significant(placed.excess[i], 6),
            significant(placed.excess[i + 1], 6),
            significant(placed.penalty[i].max(placed.penalty[i + 1]), 4),
            significant(placed.sensitivity[i], 5),
        ]
    });
    let head = ["model", name, "cell", "excess left", "right", "penalty", "d / d first"];
    out.write_all(layout::grid(&head, rows).as_bytes())?;
    let [low, high] = placed.feasible;
    writeln!(
        out,
        "\nThe first may lie in [{}, {}]: each nominal value is then in its own cell.",
        significant(low, 7),
        significant(high, 7)
    )
}
