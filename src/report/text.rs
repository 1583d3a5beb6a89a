//! The study as a text that reads well in 80 columns.

use crate::eip::{Case, EipSets, Interval, Method};
use crate::report::layout::{Table, WIDTH, left, line, right, shorten};
use crate::report::summary::{self, count, numbers};
use crate::report::{identify, plain, robust, significant};

/// Routes that differ by more, relative, are told apart in the text.
const ALIKE: f64 = 1e-6;
/// Lines of a list of examples.
const LONG: usize = 6;
/// Lines of a table; what is longer is for programs.
const TABLE: usize = 400;

/// The study as text: who wins where, boundaries, what could not be computed
/// and how well two independent routes agree.
///
/// Models are numbered from 1, in the order of the bank. Ends in a newline.
pub fn render(sets: &EipSets) -> String {
    let mut out = String::new();
    heading(&mut out, sets);
    let several = sets.cases.len() > 1;
    for case in &sets.cases {
        if several {
            line(&mut out, &format!("\nActuator delay {}", summary::delay(case.delay)));
        } else if case.delay != 0.0 {
            line(&mut out, &format!("Actuator delay {}.", summary::delay(case.delay)));
        }
        out.push('\n');
        models(&mut out, sets, case);
        boundaries(&mut out, sets, case);
        closest(&mut out, sets, case);
        unstable(&mut out, sets, case);
        failed(&mut out, sets, case);
        undecided(&mut out, sets, case);
        if summary::no_margin(sets, case) {
            line(&mut out, "\nNo plant tells the models apart: every margin is zero.");
        }
    }
    undecidable(&mut out, sets);
    robust::text(&mut out, sets);
    identify::text(&mut out, sets);
    bad_models(&mut out, sets);
    pseudo_norm(&mut out, sets);
    routes(&mut out, sets);
    out
}

fn heading(out: &mut String, sets: &EipSets) {
    if let Some(title) = &sets.title {
        line(out, &shorten(title, 3 * WIDTH));
    }
    line(out, &summary::scope(sets));
}

fn models(out: &mut String, sets: &EipSets, case: &Case) {
    let n = sets.models.len();
    let one = sets.grid.axes().len() == 1;
    let labelled = (0..n).any(|i| summary::own_label(sets, i).is_some());
    let shares = summary::shares(case, n);
    let ranges = summary::winning_range(case, n);
    let mut table = Table::default();
    let mut head = vec![right("model")];
    // more columns of values than fit are left to the JSON file
    let shown = sets.parameters.len().min(if one { 2 } else { 4 });
    head.extend(sets.parameters[..shown].iter().map(|name| left(&shorten(name, 16))));
    if labelled {
        head.push(left("label"));
    }
    if one {
        head.push(left("EIP set"));
    }
    head.push(right("share"));
    head.push(left("its Upsilon there"));
    table.row(head);
    for (i, model) in sets.models.iter().enumerate().take(TABLE) {
        let mut row = vec![right(&(i + 1).to_string())];
        row.extend(model.values[..shown].iter().map(|v| left(&plain(*v))));
        if labelled {
            row.push(left(&shorten(summary::own_label(sets, i).unwrap_or(""), 20)));
        }
        let lead = row.len();
        let mut set = case.sets.get(i).map(Vec::as_slice).unwrap_or_default().iter().map(|s| {
            let end = |v| summary::end_point(v, &case.boundaries);
            format!("[{}, {}]", end(s.from), end(s.to))
        });
        if one {
            let none = if model.failure.is_some() { "unusable" } else { "none" };
            row.push(left(&set.next().unwrap_or_else(|| none.into())));
        }
        row.push(right(&format!("{:.1} %", 100.0 * shares[i])));
        row.push(left(&match ranges[i] {
            Some((low, high)) => format!("{} .. {}", significant(low, 4), significant(high, 4)),
            None => String::new(),
        }));
        table.row(row);
        for interval in set {
            let mut more = vec![left(""); lead];
            more.push(left(&interval));
            table.row(more);
        }
    }
    if table.width() > WIDTH {
        table.drop_last(table.columns() - 1);
    }
    table.print(out);
    cut(out, n, TABLE);
}

fn boundaries(out: &mut String, sets: &EipSets, case: &Case) {
    if case.boundaries.is_empty() {
        return;
    }
    out.push('\n');
    let mut table = Table::default();
    let name = &sets.grid.axes()[0].0;
    table.row(vec![left("boundary"), left(name), left("uncertainty"), left("models")]);
    for (k, b) in case.boundaries.iter().enumerate().take(TABLE) {
        table.row(vec![
            right(&(k + 1).to_string()),
            left(&summary::boundary_value(b)),
            left(&significant(b.uncertainty, 2)),
            left(&format!("{} | {}", b.left + 1, b.right + 1)),
        ]);
    }
    table.print(out);
    cut(out, case.boundaries.len(), TABLE);
}

fn closest(out: &mut String, sets: &EipSets, case: &Case) {
    if sets.grid.axes().len() == 1 {
        return; // boundaries say more
    }
    if let Some(c) = summary::closest(case, sets.models.len()) {
        out.push('\n');
        line(
            out,
            &format!(
                "Smallest margin: {} at {} (model {} ahead of {}).",
                significant(c.margin, 4),
                summary::plant_name(sets, c.plant),
                c.winner + 1,
                c.runner_up + 1,
            ),
        );
    }
}

fn unstable(out: &mut String, sets: &EipSets, case: &Case) {
    if case.unstable.is_empty() {
        return;
    }
    out.push('\n');
    line(
        out,
        &format!(
            "The loop is unstable for {} of {}; they have no Upsilon and no winner.",
            count(case.unstable.len(), "plant"),
            case.winner.len(),
        ),
    );
    stretches(out, sets, &case.unstable_intervals);
    let mut table = Table::default();
    table.row(vec![right("plant"), left("at"), left("mode"), left("states")]);
    let runs = case.unstable.chunk_by(|a, b| b.plant == a.plant + 1 && a.states == b.states);
    for run in runs.clone().take(LONG) {
        let (first, last) = (&run[0], &run[run.len() - 1]);
        table.row(vec![
            right(&indices(first.plant, last.plant)),
            left(&shorten(&summary::plants_name(sets, first.plant, last.plant), 28)),
            left(&first.mode.to_string()),
            left(&shorten(&first.states, 20)),
        ]);
    }
    table.print(out);
    cut(out, runs.count(), LONG);
}

fn failed(out: &mut String, sets: &EipSets, case: &Case) {
    if case.failed.is_empty() {
        return;
    }
    out.push('\n');
    let (n, all) = (count(case.failed.len(), "plant"), case.winner.len());
    line(out, &format!("{n} of {all} cannot be built; they have no Upsilon and no winner."));
    stretches(out, sets, &case.failed_intervals);
    let runs = case.failed.chunk_by(|a, b| b.plant == a.plant + 1);
    for run in runs.clone().take(LONG) {
        let (first, last) = (&run[0], &run[run.len() - 1]);
        let at = summary::plants_name(sets, first.plant, last.plant);
        let (which, cause) = (indices(first.plant, last.plant), summary::plant_cause(&first.error));
        line(out, &format!("Plant {which} ({at}): {cause}."));
    }
    cut(out, runs.count(), LONG);
}

fn undecided(out: &mut String, sets: &EipSets, case: &Case) {
    if case.undecided.is_empty() {
        return;
    }
    out.push('\n');
    let (n, all) = (count(case.undecided.len(), "plant"), case.winner.len());
    line(out, &format!("Not decided: {n} of {all}; neither route vouches for a winner."));
    stretches(out, sets, &case.undecided_intervals);
    let runs = case
        .undecided
        .chunk_by(|a, b| b.plant == a.plant + 1 && a.doubt.models() == b.doubt.models());
    for run in runs.clone().take(LONG) {
        let (first, last) = (&run[0], &run[run.len() - 1]);
        let at = summary::plants_name(sets, first.plant, last.plant);
        let which = indices(first.plant, last.plant);
        line(out, &format!("Plant {which} ({at}): {}.", summary::doubt(&first.doubt)));
    }
    cut(out, runs.count(), LONG);
}

fn stretches(out: &mut String, sets: &EipSets, intervals: &[Interval]) {
    if intervals.is_empty() {
        return;
    }
    let name = &sets.grid.axes()[0].0;
    let stretches: Vec<String> = intervals
        .iter()
        .map(|s| format!("[{}, {}]", significant(s.from, 10), significant(s.to, 10)))
        .collect();
    line(out, &format!("Stretches of {name}: {}.", stretches.join(", ")));
}

/// `5`, or `5 .. 7`.
fn indices(first: usize, last: usize) -> String {
    if first == last { first.to_string() } else { format!("{first} .. {last}") }
}

fn undecidable(out: &mut String, sets: &EipSets) {
    if sets.cases.len() < 2 {
        return;
    }
    if sets.grid.axes().len() > 1 {
        let plants = sets.grid.len();
        let n = (0..plants).filter(|&plant| summary::undecided(sets, plant)).count();
        out.push('\n');
        line(
            out,
            &format!(
                "Undecidable: {} of {plants}; their winner depends on the delay.",
                count(n, "plant"),
            ),
        );
        return;
    }
    let name = &sets.grid.axes()[0].0;
    out.push('\n');
    if sets.undecidable.is_empty() {
        line(
            out,
            &format!(
                "Undecidable sets: none; the winner at every {name} is the same for all delays that have one."
            ),
        );
        return;
    }
    line(out, "Undecidable sets (the winner depends on the delay):");
    let mut table = Table::default();
    table.row(vec![right("set"), left(name), left("width"), left("models")]);
    for (k, u) in sets.undecidable.iter().enumerate().take(TABLE) {
        let all: Vec<_> = sets.cases.iter().flat_map(|c| c.boundaries.iter().copied()).collect();
        let end = |v| summary::end_point(v, &all);
        let (from, to) = (u.interval.from, u.interval.to);
        table.row(vec![
            right(&(k + 1).to_string()),
            left(&format!("[{}, {}]", end(from), end(to))),
            left(&significant(to - from, 3)),
            left(&numbers(&u.models, ", ")),
        ]);
    }
    table.print(out);
    cut(out, sets.undecidable.len(), TABLE);
}

fn bad_models(out: &mut String, sets: &EipSets) {
    for (i, model) in sets.models.iter().enumerate() {
        let name = summary::model_name(sets, i);
        if let Some(failure) = &model.failure {
            let cause = summary::cause(failure);
            line(out, &format!("\nModel {} ({name}) is unusable: {cause}.", i + 1));
        }
        if let Some(first) = model.duplicate_of {
            line(
                out,
                &format!(
                    "\nModel {} ({name}) has the same observer as model {}, which wins their ties.",
                    i + 1,
                    first + 1,
                ),
            );
        }
    }
}

fn pseudo_norm(out: &mut String, sets: &EipSets) {
    let n = sets.models.len();
    if !(2..=7).contains(&n) {
        return;
    }
    let norms = sets.pseudo_norms();
    if norms.iter().all(|d| !d.is_finite()) {
        return;
    }
    out.push('\n');
    line(
        out,
        "Pseudo-norm |Upsilon_i - Upsilon_j|, the plant at the nominal values of model j (row):",
    );
    let mut table = Table::default();
    let mut head = vec![right("j \\ i")];
    head.extend((1..=n).map(|i| right(&i.to_string())));
    table.row(head);
    for (j, row) in norms.chunks(n).enumerate() {
        let mut cells = vec![right(&(j + 1).to_string())];
        cells.extend(row.iter().map(|d| right(&significant(*d, 4))));
        table.row(cells);
    }
    table.print(out);
}

fn routes(out: &mut String, sets: &EipSets) {
    let checked: usize = sets.cases.iter().map(|c| c.checked_pairs).sum();
    let pairs: usize = sets.cases.iter().map(|c| c.upsilon.len()).sum();
    let largest = sets.cases.iter().map(|c| c.route_difference).fold(0.0, f64::max);
    let replaced: usize = sets.cases.iter().map(|c| c.replaced).sum();
    let method = method_name(sets.method);
    out.push('\n');
    if replaced > 0 {
        line(
            out,
            &format!(
                "{replaced} of {pairs} pairs take the frequency integral: the Lyapunov route has lost digits there, or cannot decide."
            ),
        );
    }
    if checked == replaced && replaced > 0 {
        return;
    }
    if checked == 0 {
        line(
            out,
            &format!(
                "Lyapunov route by {method}; no pair was computed a second way, so there is no error estimate."
            ),
        );
    } else {
        let agree = largest <= ALIKE;
        line(
            out,
            &format!(
                "{}Lyapunov route ({method}) and frequency integral {} {} (relative) over {checked} of {pairs} pairs.",
                if replaced > 0 { "Elsewhere " } else { "" },
                if agree { "agree to" } else { "DIFFER by up to" },
                significant(largest, 2),
            ),
        );
        if !agree {
            line(
                out,
                "Take Upsilon with that error. With an actuator delay raise actuator.pade; otherwise look for modes that hardly decay.",
            );
        }
    }
}

/// `doubling` or `modal form`.
pub(crate) fn method_name(method: Method) -> &'static str {
    match method {
        Method::Doubling => "doubling",
        Method::Modal => "modal form",
    }
}

fn cut(out: &mut String, total: usize, shown: usize) {
    if total > shown {
        out.push_str(&format!("  ... and {} more\n", total - shown));
    }
}
