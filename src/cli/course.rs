//! A record or a trial along time, as pictures need it.

use crate::engine::Mmae;
use crate::model::Names;
use crate::par::RunControl;
use crate::report::timeline::{Layer, Panel, Stack};
use crate::scenario::Scenario;

/// Outputs and states that are drawn.
const OUTPUTS: usize = 3;
const STATES: usize = 6;
/// Floating-point operations that boundaries may cost, about a second.
const CHEAP: f64 = 3e9;

/// What happened, one list a quantity.
#[derive(Debug, Default)]
pub(super) struct Course {
    t: Vec<f64>,
    y: Vec<Vec<f64>>,
    /// Innovation of the leading model and its expected standard deviation.
    r: Vec<Vec<f64>>,
    sigma: Vec<Vec<f64>>,
    x: Vec<Vec<f64>>,
    x_hat: Vec<Vec<f64>>,
}

/// Appends each value to its list.
fn append(lists: &mut Vec<Vec<f64>>, values: &[f64]) {
    lists.resize(values.len(), Vec::new());
    for (list, value) in lists.iter_mut().zip(values) {
        list.push(*value);
    }
}

impl Course {
    /// A measurement and the fused estimate after it; the state of the plant where
    /// it is known.
    pub(super) fn push(&mut self, t: f64, y: &[f64], x_hat: &[f64], x: &[f64]) {
        self.t.push(t);
        append(&mut self.y, y);
        append(&mut self.x_hat, x_hat);
        append(&mut self.x, &x[..x.len().min(x_hat.len())]);
    }

    /// What the model of largest weight expected of the last measurement.
    pub(super) fn judge(&mut self, engine: &Mmae) {
        let e = engine.estimate();
        let q = engine.bank().sizes()[2];
        let (mut r, mut sigma) = (vec![f64::NAN; q], vec![f64::NAN; q]);
        if let Some(best) = e.best {
            sigma = engine.bank().sigma(best);
            r.copy_from_slice(&e.r[best * q..][..q]);
        }
        // an output that is missing has no residual
        for (r, sigma) in r.iter_mut().zip(&sigma) {
            *r = if sigma.is_nan() { f64::NAN } else { *r };
        }
        append(&mut self.r, &r);
        append(&mut self.sigma, &sigma);
    }

    /// The picture.
    pub(super) fn stack(self, title: &str, subtitle: String, time: &str, names: &Names) -> Stack {
        let mut key: Vec<(Layer, String)> = Vec::new();
        let mut panels = Vec::new();
        let judged = self.r.first().is_some_and(|r| r.len() == self.t.len());
        let named = |list: &[String], j: usize| list.get(j).cloned().unwrap_or_default();
        for (j, y) in self.y.iter().enumerate().take(OUTPUTS) {
            let mut layers = Vec::new();
            if judged {
                let expected: Vec<f64> = y.iter().zip(&self.r[j]).map(|(y, r)| y - r).collect();
                let edge = |sign: f64| -> Vec<f64> {
                    let pairs = expected.iter().zip(&self.sigma[j]);
                    pairs.map(|(y, s)| y + sign * 2.0 * s).collect()
                };
                layers.extend([Layer::Wide(edge(-1.0), edge(1.0)), Layer::Estimate(expected)]);
            }
            layers.push(Layer::Dots(y.clone()));
            panels.push(Panel { name: named(&names.outputs, j), layers });
        }
        key.push((Layer::Dots(Vec::new()), "measured".into()));
        if judged {
            for (j, (r, sigma)) in self.r.iter().zip(&self.sigma).enumerate().take(OUTPUTS) {
                let edge = |sign: f64| sigma.iter().map(|s| sign * 2.0 * s).collect();
                panels.push(Panel {
                    name: format!("{} residual", named(&names.outputs, j)),
                    layers: vec![
                        Layer::Wide(edge(-1.0), edge(1.0)),
                        Layer::Level(0.0),
                        Layer::Dots(r.clone()),
                    ],
                });
            }
            let text = "two standard deviations that the leading model expects";
            key.push((Layer::Wide(Vec::new(), Vec::new()), text.into()));
        }
        for (j, x_hat) in self.x_hat.iter().enumerate().take(STATES) {
            let truth = self.x.get(j).map(|x| Layer::Truth(x.clone()));
            let layers = truth.into_iter().chain([Layer::Estimate(x_hat.clone())]).collect();
            panels.push(Panel { name: named(&names.states, j), layers });
        }
        if !self.x.is_empty() {
            key.push((Layer::Truth(Vec::new()), "plant".into()));
        }
        key.push((Layer::Estimate(Vec::new()), "estimate".into()));
        Stack { title: title.into(), subtitle, time: time.into(), t: self.t, key, panels }
    }
}

/// What the lines of a panel of parameters mean.
pub(super) fn legend(parameters: &[String], truth: bool, boundaries: &[f64]) -> String {
    if parameters.is_empty() {
        return String::new();
    }
    let truth = if truth { "plant grey, " } else { "" };
    let dashed = if boundaries.is_empty() { "" } else { ", boundaries of their sets dashed" };
    format!("; parameters: {truth}models dotted{dashed}")
}

/// Boundaries of the sets of equivalently identified plants where the scenario
/// asks for them in the one parameter of the models, and they are cheap.
pub(super) fn boundaries(
    scenario: &Scenario,
    parameters: &[String],
    control: &RunControl<'_>,
) -> Vec<f64> {
    let [parameter] = parameters else { return Vec::new() };
    if !scenario.has_study() {
        return Vec::new();
    }
    let Ok(study) = scenario.study() else { return Vec::new() };
    let study = study.bare();
    let one = matches!(study.grid.axes(), [(name, _)] if name == parameter);
    if !one || study.cost().map_or(true, |cost| cost.flops > CHEAP) {
        return Vec::new();
    }
    let quiet = RunControl { progress: None, ..*control };
    let Ok(sets) = study.run(&quiet) else { return Vec::new() };
    let first = sets.cases.first();
    first.map_or(Vec::new(), |case| case.boundaries.iter().map(|b| b.value).collect())
}
