//! The placement of several parameters, reported.

use std::collections::BTreeMap;
use std::io::{self, Write};

use serde::Serialize;

use super::save;
use crate::cli::arguments::PlaceArguments;
use crate::cli::failure::{Failure, say};
use crate::cli::output;
use crate::cli::signals::Signals;
use crate::eip::Scatter;
use crate::model::describe;
use crate::report::{layout, significant};
use crate::scenario::with_models;

#[derive(Serialize)]
struct Document<'a> {
    schema: &'static str,
    version: &'static str,
    parameters: &'a [String],
    nominals: Vec<BTreeMap<&'a str, f64>>,
    edges: [f64; 0],
    excess: &'a [f64],
    sensitivity: [f64; 0],
    plants: &'a [usize],
    cells: &'a [Option<usize>],
    descent: &'a [f64],
    converged: bool,
}

pub(super) fn report(
    args: &PlaceArguments,
    placed: &Scatter,
    signals: &Signals,
) -> Result<(), Failure> {
    if !placed.converged {
        say("warning", "the iteration ended before the nominal values came to rest");
    }
    if let Some(path) = &args.out {
        let text = with_models(&args.file, &placed.parameters, &placed.nominals)?;
        save(path, text.as_bytes(), args.force)?;
    }
    output::print(
        Some(signals),
        |out| {
            if args.json { json(out, placed) } else { text(out, placed) }
        },
    )
}

fn json(out: &mut dyn Write, placed: &Scatter) -> io::Result<()> {
    let names = || placed.parameters.iter().map(String::as_str);
    let document = Document {
        schema: "mmae.place/1",
        version: env!("CARGO_PKG_VERSION"),
        parameters: &placed.parameters,
        nominals: placed
            .nominals
            .iter()
            .map(|v| names().zip(v.iter().copied()).collect())
            .collect(),
        edges: [],
        excess: &placed.excess,
        sensitivity: [],
        plants: &placed.plants,
        cells: &placed.cells,
        descent: &placed.descent,
        converged: placed.converged,
    };
    serde_json::to_writer(&mut *out, &document)?;
    out.write_all(b"\n")
}

fn text(out: &mut dyn Write, placed: &Scatter) -> io::Result<()> {
    writeln!(out, "{} models on {}.\n", placed.nominals.len(), placed.parameters.join(", "))?;
    let head = ["model", "nominal value", "plants", "worst excess"];
    let rows = placed.nominals.iter().enumerate().map(|(i, point)| {
        let plants = placed.cells.iter().filter(|c| **c == Some(i)).count();
        [
            (i + 1).to_string(),
            describe(&placed.parameters, point),
            plants.to_string(),
            significant(placed.excess[i], 6),
        ]
    });
    out.write_all(layout::grid(&head, rows).as_bytes())?;
    let (first, last) = (placed.descent.first(), placed.descent.last());
    if let (Some(first), Some(last)) = (first, last) {
        writeln!(
            out,
            "\nMean excess {} at the start, {} after {} iterations; {}.",
            significant(*first, 6),
            significant(*last, 6),
            placed.descent.len(),
            if placed.converged { "no nominal value moves any more" } else { "not at rest" }
        )?;
    }
    Ok(())
}
