//! The report of `mmae run`.

use crate::report::html::{Figure, Table};
use crate::report::significant;
use crate::scenario::Simulation;
use crate::sim::Summary;

/// The pictures with what they show.
pub(super) fn figures(pictures: [String; 3]) -> Vec<Figure> {
    let captions =
        ["Weights and parameters over the trials", "Errors of the fused state", "The first trial"];
    let figures = captions.into_iter().zip(pictures);
    figures.map(|(caption, svg)| Figure { caption: caption.into(), svg }).collect()
}

/// The end of the trials as tables.
pub(super) fn tables(simulation: &Simulation, summary: &Summary) -> Vec<Table> {
    let estimator = &simulation.estimator;
    let end = summary.last();
    let number = |v: f64| if v.is_finite() { significant(v, 4) } else { "none".into() };
    let texts = |list: &[&str]| list.iter().map(|text| (*text).to_string()).collect();
    let rows = estimator.labels.iter().enumerate().map(|(i, label)| {
        let shares = [end.identified[i], end.failed[i]].map(|v| format!("{} %", number(100.0 * v)));
        let [identified, failed] = shares;
        let numbers = [end.p[i], end.p_std[i], end.nis[i], end.nees[i]].map(number);
        let [p, spread, nis, nees] = numbers;
        vec![(i + 1).to_string(), label.clone(), identified, p, spread, nis, nees, failed]
    });
    let band = |[low, high]: [f64; 2]| format!("{} to {}", number(low), number(high));
    let models = Table {
        caption: format!("Models after {} steps, {} trials", summary.steps, summary.trials),
        head: texts(&[
            "model",
            "label",
            "identified",
            "mean weight",
            "its spread",
            "NIS",
            "NEES",
            "ran away",
        ]),
        rows: rows.collect(),
        notes: vec![format!(
            "A model that is right has NIS in {} and NEES in {} (95 %).",
            band(summary.nis_band),
            band(summary.nees_band),
        )],
    };
    let rows = estimator.names.states.iter().enumerate().filter_map(|(j, state)| {
        let pair = [end.x_error_mean.get(j)?, end.x_error_std.get(j)?].map(|v| number(*v));
        let [bias, spread] = pair;
        Some(vec![state.clone(), bias, spread])
    });
    let errors = Table {
        caption: "Error of the fused state".into(),
        head: texts(&["state", "mean", "standard deviation"]),
        rows: rows.collect(),
        notes: vec![format!("Root mean square of the whole: {}.", number(end.x_error_rms))],
    };
    vec![models, errors]
}
