//! `mmae place`: nominal values whose EIP sets are the cells wanted.

use std::io::{self, Write};

use serde::Serialize;

use super::arguments::PlaceArguments;
use super::failure::{Failure, say};
use super::output;
use super::signals::Signals;
use crate::eip::{Cells, Placement, Study};
use crate::error::Error;
use crate::par::RunControl;
use crate::report::{layout, significant, write};
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
    let placed = study.place(&cells(args, &study), args.anchor, &control).map_err(|e| match e {
        Error::Cancelled => Failure::Cancelled,
        e => Failure::from(scenario.explain(e)),
    })?;
    let width = placed.domain[1] - placed.domain[0];
    let met = |(edge, want): (&f64, &f64)| (edge - want).abs() <= MISS * width;
    if placed.edges.len() != placed.wanted.len()
        || !placed.edges.iter().zip(&placed.wanted).all(met)
    {
        let what = "the sets of these nominal values are not the cells: other models win in parts";
        say("warning", &format!("{what} of them; look at the study with mmae eip"));
    }
    if let Some(path) = &args.out {
        let text = with_models(&args.file, &placed.parameter, &placed.nominals)?;
        write::file(path, text.as_bytes(), args.force)?;
        say("note", &format!("wrote {}", path.display()));
    }
    output::print(Some(signals), |out| {
        if args.json { json(out, args, &placed) } else { text(out, &placed) }
    })
}

/// What was asked for.
fn cells(args: &PlaceArguments, study: &Study) -> Cells {
    if let Some(bound) = args.excess {
        return Cells::Within(bound);
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
            significant(placed.sensitivity[i], 5),
        ]
    });
    let head = ["model", name, "cell", "excess left", "right", "d / d first"];
    out.write_all(layout::grid(&head, rows).as_bytes())?;
    let [low, high] = placed.feasible;
    writeln!(
        out,
        "\nThe first may lie in [{}, {}]: each nominal value is then in its own cell.",
        significant(low, 7),
        significant(high, 7)
    )
}
