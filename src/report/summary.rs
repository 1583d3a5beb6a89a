//! What every report says about a study, derived once from its numbers.

use crate::eip::{Boundary, Case, Convention, Doubt, EipSets};
use crate::model::{Axis, describe};

/// Share of the plants of the grid that each model wins, in the order of the
/// models; plants without a winner count for none.
pub fn shares(case: &Case, n_models: usize) -> Vec<f64> {
    let mut wins = vec![0_usize; n_models];
    for &winner in case.winner.iter().flatten() {
        wins[winner] += 1;
    }
    let plants = case.winner.len().max(1) as f64;
    wins.into_iter().map(|w| w as f64 / plants).collect()
}

/// Where the decision is hardest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Closest {
    /// Index of the plant on the grid.
    pub plant: usize,
    /// The model that wins there.
    pub winner: usize,
    /// The model that comes second.
    pub runner_up: usize,
    /// By how much, in units of Upsilon.
    pub margin: f64,
}

/// The plant with the smallest margin; `None` if no plant has two candidates.
pub fn closest(case: &Case, n_models: usize) -> Option<Closest> {
    let (plant, margin) = case
        .margin
        .iter()
        .copied()
        .enumerate()
        .filter(|(_, margin)| margin.is_finite())
        .min_by(|a, b| a.1.total_cmp(&b.1))?;
    let winner = case.winner[plant]?;
    let row = &case.upsilon[plant * n_models..][..n_models];
    let (runner_up, _) = row
        .iter()
        .copied()
        .enumerate()
        .filter(|&(i, u)| i != winner && u.is_finite())
        .min_by(|a, b| a.1.total_cmp(&b.1))?;
    Some(Closest { plant, winner, runner_up, margin })
}

/// Whether no plant with a winner tells two usable models apart: every margin
/// is zero, or there are only duplicates.
pub fn no_margin(sets: &EipSets, case: &Case) -> bool {
    let n = sets.models.len();
    let usable = sets.models.iter().filter(|m| m.failure.is_none()).count();
    let mut decided = false;
    for (plant, &winner) in case.winner.iter().enumerate() {
        let Some(w) = winner else { continue };
        let (margin, scale) = (case.margin[plant], case.upsilon[plant * n + w].abs());
        if margin.is_finite() && margin > 1e-12 * scale {
            return false;
        }
        decided = true;
    }
    usable > 1 && decided
}

/// Smallest and largest Upsilon of each model over the plants it wins.
pub fn winning_range(case: &Case, n_models: usize) -> Vec<Option<(f64, f64)>> {
    let mut ranges: Vec<Option<(f64, f64)>> = vec![None; n_models];
    for (plant, &winner) in case.winner.iter().enumerate() {
        if let Some(i) = winner {
            let u = case.upsilon[plant * n_models + i];
            let (low, high) = ranges[i].unwrap_or((u, u));
            ranges[i] = Some((low.min(u), high.max(u)));
        }
    }
    ranges
}

/// The label of a model where it says more than its values, else `None`.
pub fn own_label(sets: &EipSets, model: usize) -> Option<&str> {
    let model = &sets.models[model];
    let label = model.label.as_str();
    let numbered = |text: &str| text.chars().filter(|c| !c.is_whitespace()).collect::<String>();
    let values: Vec<String> = model.values.iter().map(|v| super::plain(*v)).collect();
    let said = [describe(&sets.parameters, &model.values), values.join(",")];
    let new = !label.is_empty() && said.iter().all(|s| numbered(s) != numbered(label));
    new.then_some(label)
}

/// `L = 1.025`, with the label in front where the model has one of its own.
pub fn model_name(sets: &EipSets, model: usize) -> String {
    let values = describe(&sets.parameters, &sets.models[model].values);
    match own_label(sets, model) {
        Some(label) if values.is_empty() => label.into(),
        Some(label) => format!("{label}, {values}"),
        None => values,
    }
}

/// The label of a model, or its values to six digits: for pictures.
pub(crate) fn short_name(sets: &EipSets, model: usize) -> String {
    match own_label(sets, model) {
        Some(label) => label.into(),
        None => rounded(&sets.parameters, &sets.models[model].values, 6),
    }
}

fn rounded(names: &[String], values: &[f64], digits: usize) -> String {
    let pairs = names.iter().zip(values);
    let pairs: Vec<String> =
        pairs.map(|(n, v)| format!("{n} = {}", super::significant(*v, digits))).collect();
    pairs.join(", ")
}

/// Whether the winner at a plant depends on the delay; delays without a winner
/// do not count.
pub fn undecided(sets: &EipSets, plant: usize) -> bool {
    let mut winners = sets.cases.iter().filter_map(|case| case.winner[plant]);
    winners.next().is_some_and(|first| winners.any(|other| other != first))
}

/// Parameter values of a plant as messages print them: `L = 1.1, m = 0.6`.
pub fn plant_name(sets: &EipSets, plant: usize) -> String {
    let names: Vec<String> = sets.grid.axes().iter().map(|(name, _)| name.clone()).collect();
    rounded(&names, &sets.grid.point(plant), 10)
}

/// Parameter values of the plants from `first` to `last` of a run of the grid,
/// to six digits: `L = 1.1 .. 1.3`, or those of the first.
pub(crate) fn plants_name(sets: &EipSets, first: usize, last: usize) -> String {
    let names: Vec<String> = sets.grid.axes().iter().map(|(name, _)| name.clone()).collect();
    let at = rounded(&names, &sets.grid.point(first), 6);
    match sets.grid.axes() {
        _ if last == first => at,
        [(_, axis)] => format!("{at} .. {}", super::significant(axis.value(last), 6)),
        _ => format!("{at} .."),
    }
}

/// Why a winner is withheld.
pub fn doubt(doubt: &Doubt) -> String {
    let number = |v: f64| super::significant(v, 2);
    match doubt {
        Doubt::NoNumber { models } => {
            format!("no route gives model {} a number", numbers(models, ", "))
        }
        Doubt::Margin { models, margin, error } => format!(
            "models {} differ by {}, with an error of {}",
            numbers(models, ", "),
            number(*margin),
            number(*error),
        ),
    }
}

/// What is wrong with a plant, without the values that the caller prints.
pub(crate) fn plant_cause(failure: &crate::Error) -> &crate::Error {
    match failure {
        crate::Error::Plant { source, .. } => source,
        other => other,
    }
}

/// `Ito convention`, `Baram convention, dt = 0.001 s`, and so on.
pub fn convention(convention: Convention) -> String {
    match convention {
        Convention::Ito => "Ito convention".into(),
        Convention::Baram { dt } => format!("Baram convention, dt = {dt} s"),
        Convention::Identity => "identity convention (S = I)".into(),
    }
}

/// `EIP sets for L in [0.9, 1.9]: 401 plants, 4 models, Ito convention.`
pub fn scope(sets: &EipSets) -> String {
    let axis = |(name, axis): &(String, Axis)| {
        let (from, to) = ends(axis);
        format!("{name} in [{}, {}]", super::plain(from), super::plain(to))
    };
    let axes: Vec<String> = sets.grid.axes().iter().map(axis).collect();
    format!(
        "EIP sets for {}: {}, {}, {}.",
        axes.join(", "),
        count(sets.grid.len(), "plant"),
        count(sets.models.len(), "model"),
        convention(sets.convention),
    )
}

/// `20 ms`: a delay in the unit that reads best.
pub fn delay(seconds: f64) -> String {
    let digits = |scale: f64| super::significant(seconds * scale, 12);
    match seconds.abs() {
        0.0 => "0".into(),
        s if s >= 1.0 => format!("{} s", digits(1.0)),
        s if s >= 1e-3 => format!("{} ms", digits(1e3)),
        _ => format!("{} us", digits(1e6)),
    }
}

/// First and last value of an axis.
pub(crate) fn ends(axis: &Axis) -> (f64, f64) {
    (axis.value(0), axis.value(axis.len() - 1))
}

/// `v` as a reader wants it: an end of the grid as given, a boundary to the
/// digits that its uncertainty leaves.
pub(crate) fn end_point(v: f64, boundaries: &[Boundary]) -> String {
    match boundaries.iter().find(|b| b.value == v) {
        Some(b) => boundary_value(b),
        None => super::significant(v, 10),
    }
}

/// A boundary to the digits its uncertainty leaves, nine decimals at most.
pub(crate) fn boundary_value(b: &Boundary) -> String {
    super::number::to_uncertainty(b.value, b.uncertainty.max(b.value.abs() * 1e-9))
}

/// `1 + 3`: indices as people count them.
pub(crate) fn numbers(models: &[usize], separator: &str) -> String {
    let one_based: Vec<String> = models.iter().map(|i| (i + 1).to_string()).collect();
    one_based.join(separator)
}

/// Plural with its count: `1 plant`, `401 plants`.
pub(crate) fn count(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

/// What is wrong with a model, without the number and values that the caller
/// prints.
pub(crate) fn cause(failure: &crate::Error) -> &crate::Error {
    match failure {
        crate::Error::Model { source, .. } => source,
        other => other,
    }
}
