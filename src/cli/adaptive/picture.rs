//! Parameters and states along time, with bands.

use super::answer::{Answer, Row};
use crate::report::timeline::{Bands, Layer, Panel, Stack};

/// Panels at most.
const PANELS: usize = 8;
/// Room above and below estimate and truth for a band, as a share of their range: at
/// the start it is as wide as the prior.
const ROOM: f64 = 0.6;

/// A curve; NaN leaves a gap.
fn curve(rows: &[Row], pick: impl Fn(&Row) -> Option<f64>) -> Vec<f64> {
    rows.iter().map(|row| pick(row).unwrap_or(f64::NAN)).collect()
}

/// Bands around a curve: quantiles of the trials, or two standard deviations of one.
fn bands(
    rows: &[Row],
    middle: &[f64],
    truth: Option<&[f64]>,
    std: &[f64],
    quantiles: impl Fn(&Row) -> Option<&[f64; 5]>,
) -> Vec<Layer> {
    let finite = middle.iter().chain(truth.into_iter().flatten()).filter(|v| v.is_finite());
    let (low, high) =
        finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
    let room = ROOM * (high - low).max(1e-12 * high.abs());
    let cut = |v: f64| if v.is_nan() { v } else { v.clamp(low - room, high + room) };
    if low > high {
        return Vec::new();
    }
    let own: Option<Vec<&[f64; 5]>> = rows.iter().map(&quantiles).collect();
    if let Some(own) = own.filter(|own| !own.is_empty()) {
        let Bands(edges) = Bands::of(own);
        let [a, b, c, d] = edges.map(|edge| edge.into_iter().map(cut).collect());
        return vec![Layer::Wide(a, d), Layer::Narrow(b, c)];
    }
    let edge = |sign: f64| -> Vec<f64> {
        middle.iter().zip(std).map(|(m, s)| cut(m + sign * 2.0 * s)).collect()
    };
    vec![Layer::Wide(edge(-1.0), edge(1.0))]
}

fn stack(answer: &Answer, title: &str, time: &str, what: &str, panels: Vec<Panel>) -> Stack {
    let mut key = vec![];
    let mark = |layer: Layer, text: &str| (layer, text.to_string());
    if answer.trials > 1 {
        key.push(mark(Layer::Wide(vec![], vec![]), "90 % of the trials"));
        key.push(mark(Layer::Narrow(vec![], vec![]), "50 %"));
    } else {
        key.push(mark(Layer::Wide(vec![], vec![]), "two standard deviations of the estimate"));
    }
    if answer.case.is_some() {
        key.push(mark(Layer::Truth(vec![]), "plant"));
    }
    let trials = match answer.trials {
        1 => String::new(),
        n => format!(", {n} trials"),
    };
    let middle = if answer.trials > 1 && what == "parameters" { "mean" } else { "estimate" };
    key.push(mark(Layer::Estimate(vec![]), middle));
    let case = answer.case.as_ref().map_or(String::new(), |case| format!("{case}, "));
    Stack {
        title: title.into(),
        subtitle: format!(
            "{case}observer {}, reading {}: {what}{trials}",
            answer.observer, answer.reading
        ),
        time: time.into(),
        t: answer.record.iter().map(|row| row.t).collect(),
        key,
        panels,
    }
}

/// Estimates of the parameters.
pub(super) fn parameters(answer: &Answer, title: &str, time: &str) -> Stack {
    let rows = &answer.record;
    let panel = |i: usize| {
        let middle = curve(rows, |r| r.theta_hat[i]);
        let std = curve(rows, |r| r.theta_std[i]);
        let truth = answer.theta.as_ref().map(|theta| vec![theta[i]; rows.len()]);
        let mut layers = bands(rows, &middle, truth.as_deref(), &std, |r| r.theta_quantiles.get(i));
        layers.extend(truth.map(Layer::Truth));
        layers.push(Layer::Estimate(middle));
        Panel { name: answer.parameters[i].clone(), layers }
    };
    let panels = (0..answer.parameters.len().min(PANELS)).map(panel).collect();
    stack(answer, title, time, "parameters", panels)
}

/// Estimates of the states; the plant's where it has a state of that name.
pub(super) fn states(answer: &Answer, title: &str, time: &str) -> Stack {
    let rows = &answer.record;
    let panel = |i: usize| {
        let name = &answer.states[i];
        let middle = curve(rows, |r| r.x_hat[i]);
        let std = curve(rows, |r| r.x_std[i]);
        let own = answer.plant_states.iter().position(|s| s == name);
        let truth = own.map(|j| curve(rows, |r| r.x.get(j).copied()));
        let mut layers = bands(rows, &middle, truth.as_deref(), &std, |r| r.x_quantiles.get(i));
        layers.extend(truth.map(Layer::Truth));
        layers.push(Layer::Estimate(middle));
        Panel { name: name.clone(), layers }
    };
    let mut panels: Vec<Panel> = (0..answer.states.len().min(PANELS)).map(panel).collect();
    if answer.case.is_none() {
        for (j, name) in answer.outputs.iter().enumerate() {
            let measured = Layer::Dots(curve(rows, |r| r.y.get(j).copied()));
            match panels.iter_mut().find(|p| p.name == *name) {
                Some(panel) => panel.layers.push(measured),
                None => panels.push(Panel { name: name.clone(), layers: vec![measured] }),
            }
        }
    }
    stack(answer, title, time, "states", panels)
}
