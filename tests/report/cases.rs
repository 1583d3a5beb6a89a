//! Studies made by hand: Upsilon as parabolas whose crossings are prescribed.
//!
//! `Upsilon_i(v) = base_i + curvature (v - nominal_i)^2`, the bases chosen so
//! that neighbours cross at the given boundaries; the pendulum's numbers then
//! look much like the real ones.

use mmae::Error;
use mmae::eip::{
    Boundary, Case, Convention, Doubt, EipSets, Failed, Interval, Method, Model, Undecidable,
    Undecided, Unstable,
};
use mmae::error::Eigenvalue;
use mmae::model::{Axis, Grid};

pub(crate) const NOMINALS: [f64; 4] = [1.025, 1.287, 1.526, 1.778];
pub(crate) const BOUNDARIES: [f64; 3] = [1.153616065, 1.404518669, 1.649832352];
const CURVATURE: f64 = 1100.0;

fn names(parameters: &[&str]) -> Vec<String> {
    parameters.iter().map(|p| p.to_string()).collect()
}

fn model(parameters: &[&str], values: &[f64]) -> Model {
    let pairs: Vec<String> =
        parameters.iter().zip(values).map(|(n, v)| format!("{n} = {v}")).collect();
    Model { label: pairs.join(", "), values: values.to_vec(), failure: None, duplicate_of: None }
}

/// Runner-up less winner, as the engine defines it.
fn decide(row: &[f64]) -> (Option<usize>, f64) {
    let mut order: Vec<usize> = (0..row.len()).filter(|&i| !row[i].is_nan()).collect();
    order.sort_by(|&a, &b| row[a].total_cmp(&row[b]).then(a.cmp(&b)));
    match order.as_slice() {
        [] => (None, f64::NAN),
        [only] => (Some(*only), f64::INFINITY),
        [first, second, ..] => (Some(*first), row[*second] - row[*first]),
    }
}

/// One case over one parameter; plants below `stable_from` are unstable.
pub(crate) fn line_case(
    axis: &Axis,
    nominals: &[f64],
    at: &[f64],
    delay: f64,
    stable_from: f64,
) -> Case {
    let n = nominals.len();
    let mut base = vec![22.8];
    for (i, b) in at.iter().enumerate() {
        let step = CURVATURE * ((b - nominals[i]).powi(2) - (b - nominals[i + 1]).powi(2));
        base.push(base[i] + step);
    }
    let values = axis.values();
    let (first, last) = (values[0], values[values.len() - 1]);
    let mut case = Case {
        delay,
        upsilon: vec![],
        error: vec![],
        winner: vec![],
        margin: vec![],
        boundaries: vec![],
        sets: vec![],
        unstable_intervals: vec![],
        failed_intervals: vec![],
        undecided_intervals: vec![],
        unstable: vec![],
        failed: vec![],
        undecided: vec![],
        route_difference: 4.1e-13,
        checked_pairs: values.len() * n,
        replaced: 0,
    };
    for (plant, &v) in values.iter().enumerate() {
        let row: Vec<f64> = (0..n)
            .map(|i| {
                if v < stable_from {
                    f64::NAN
                } else {
                    base[i] + CURVATURE * (v - nominals[i]).powi(2)
                }
            })
            .collect();
        let (winner, margin) = decide(&row);
        case.winner.push(winner);
        case.margin.push(margin);
        case.error.extend(row.iter().map(|u| u * 1e-13));
        case.upsilon.extend(row);
        if v < stable_from {
            case.unstable.push(Unstable {
                plant,
                values: vec![v],
                mode: Eigenvalue { re: 0.41, im: 1.93 },
                states: "theta, theta_dot".into(),
            });
        }
    }
    let start = first.max(stable_from.min(last));
    if start > first {
        case.unstable_intervals.push(Interval { from: first, to: start });
    }
    let boundaries = at.iter().enumerate().filter(|(_, b)| **b > start);
    case.boundaries = boundaries
        .map(|(i, &value)| Boundary { value, uncertainty: 4e-10, left: i, right: i + 1 })
        .collect();
    for i in 0..n {
        let from = if i == 0 { start } else { at[i - 1].max(start) };
        let to = if i == n - 1 { last } else { at[i] };
        case.sets.push(if from < to && stable_from <= last {
            vec![Interval { from, to }]
        } else {
            vec![]
        });
    }
    case
}

/// Upsilon at the nominal values, from the parabolas.
fn at_nominals(n: usize) -> Vec<f64> {
    let d = |i: usize, j: usize| (i as f64 - j as f64).powi(2) * 71.25 + 20.0;
    (0..n * n).map(|k| d(k % n, k / n)).collect()
}

fn line(parameter: &str, axis: Axis, nominals: &[f64], cases: Vec<Case>) -> EipSets {
    EipSets {
        title: None,
        parameters: names(&[parameter]),
        models: nominals.iter().map(|v| model(&[parameter], &[*v])).collect(),
        convention: Convention::Ito,
        grid: Grid::new(vec![(parameter.into(), axis)]).unwrap(),
        at_nominals: at_nominals(nominals.len()),
        cases,
        undecidable: vec![],
        method: Method::Doubling,
        robust: None,
        delay_sweep: None,
        identification: None,
    }
}

fn pendulum_axis() -> Axis {
    Axis::Linear { from: 0.9, to: 1.9, points: 401 }
}

/// The pendulum without a delay.
pub(crate) fn pendulum() -> EipSets {
    let axis = pendulum_axis();
    let case = line_case(&axis, &NOMINALS, &BOUNDARIES, 0.0, 0.0);
    line("L", axis, &NOMINALS, vec![case])
}

/// The pendulum with delays 0, 2 and 20 ms.
pub(crate) fn delays() -> EipSets {
    let axis = pendulum_axis();
    let at = [
        (0.0, BOUNDARIES),
        (0.002, [1.153664611, 1.404549549, 1.649852831]),
        (0.02, [1.154061902, 1.404798068, 1.650014975]),
    ];
    let cases: Vec<Case> =
        at.iter().map(|(delay, b)| line_case(&axis, &NOMINALS, b, *delay, 0.0)).collect();
    let mut sets = line("L", axis, &NOMINALS, cases);
    for k in 0..3 {
        sets.undecidable.push(Undecidable {
            interval: Interval { from: at[0].1[k], to: at[2].1[k] },
            models: vec![k, k + 1],
        });
    }
    sets
}

/// Two delays that matter: wide undecidable sets.
pub(crate) fn wide_delays() -> EipSets {
    let axis = pendulum_axis();
    let other = [1.21, 1.45, 1.72];
    let cases = vec![
        line_case(&axis, &NOMINALS, &BOUNDARIES, 0.0, 0.0),
        line_case(&axis, &NOMINALS, &other, 0.05, 0.97),
    ];
    let mut sets = line("L", axis, &NOMINALS, cases);
    for k in 0..3 {
        sets.undecidable.push(Undecidable {
            interval: Interval { from: BOUNDARIES[k], to: other[k] },
            models: vec![k, k + 1],
        });
    }
    sets
}

/// Twelve models on a logarithmic grid, a failed one, a duplicate, an unstable
/// stretch.
pub(crate) fn twelve() -> EipSets {
    let axis = Axis::Logarithmic { from: 0.1, to: 10.0, points: 301 };
    let nominals: Vec<f64> =
        (0..12).map(|i| (10f64.powf(-0.95 + 1.9 * i as f64 / 11.0) * 1e4).round() / 1e4).collect();
    // parabolas in the logarithm, so that every model has its stretch
    let log = |v: f64| v.ln();
    let logs: Vec<f64> = nominals.iter().map(|v| log(*v)).collect();
    let middle: Vec<f64> = logs.windows(2).map(|w| (w[0] + w[1]) / 2.0).collect();
    let log_axis = Axis::Explicit(axis.values().iter().map(|v| log(*v)).collect());
    let mut case = line_case(&log_axis, &logs, &middle, 0.0, log(0.13));
    for b in &mut case.boundaries {
        b.value = b.value.exp();
    }
    for i in case.sets.iter_mut().flatten().chain(&mut case.unstable_intervals) {
        *i = Interval { from: i.from.exp().max(0.1), to: i.to.exp().min(10.0) };
    }
    for u in &mut case.unstable {
        u.values[0] = u.values[0].exp();
    }
    let mut sets = line("stiffness", axis, &nominals, vec![case]);
    sets.models[6].label = "worn bearing <1 & more>".into();
    sets
}

/// Model 2 failed and model 4 repeats model 1.
pub(crate) fn troubled() -> EipSets {
    let mut sets = pendulum();
    sets.models[1].failure = Some(Error::Undetectable {
        eigenvalue: Eigenvalue { re: 0.3, im: 0.0 },
        states: "x_dot".into(),
    });
    sets.models[3].duplicate_of = Some(0);
    let n = sets.models.len();
    let case = &mut sets.cases[0];
    for plant in 0..case.winner.len() {
        case.upsilon[plant * n + 1] = f64::NAN;
        case.upsilon[plant * n + 3] = case.upsilon[plant * n];
        let row = &case.upsilon[plant * n..][..n];
        (case.winner[plant], case.margin[plant]) = decide(row);
        case.margin[plant] = case.margin[plant].max(0.0);
    }
    let b = 1.28122;
    case.boundaries = vec![Boundary { value: b, uncertainty: 2e-10, left: 0, right: 2 }];
    case.sets = vec![
        vec![Interval { from: 0.9, to: b }],
        vec![],
        vec![Interval { from: b, to: 1.9 }],
        vec![],
    ];
    sets
}

/// Plants that cannot be built, and some that neither route decides.
pub(crate) fn doubtful() -> EipSets {
    let mut sets = pendulum();
    let n = sets.models.len();
    let case = &mut sets.cases[0];
    for plant in (40..60).chain(200..203) {
        let values = vec![sets.grid.point(plant)[0]];
        if plant < 60 {
            let source = Error::NonFinite { what: "A".into(), row: 2, col: 1 };
            let parameters = format!("L = {}", values[0]);
            let error = Error::Plant { parameters, source: Box::new(source) };
            case.failed.push(Failed { plant, values, error });
            case.upsilon[plant * n..][..n].fill(f64::NAN);
            case.error[plant * n..][..n].fill(f64::NAN);
        } else {
            let doubt = Doubt::Margin { models: vec![1, 2], margin: 0.25, error: 1.5 };
            case.undecided.push(Undecided { plant, values, doubt });
        }
        case.winner[plant] = None;
        case.margin[plant] = f64::NAN;
    }
    case.failed_intervals = vec![Interval { from: 0.9987, to: 1.0488 }];
    case.undecided_intervals = vec![Interval { from: 1.3975, to: 1.4075 }];
    case.boundaries.remove(1);
    case.sets[0] =
        vec![Interval { from: 0.9, to: 0.9987 }, Interval { from: 1.0488, to: BOUNDARIES[0] }];
    case.sets[1][0].to = 1.3975;
    case.sets[2][0].from = 1.4075;
    case.replaced = 12;
    sets
}

/// One model alone.
pub(crate) fn single() -> EipSets {
    let axis = pendulum_axis();
    let case = line_case(&axis, &[1.4], &[], 0.0, 0.0);
    line("L", axis, &[1.4], vec![case])
}

/// Every plant unstable.
pub(crate) fn hopeless() -> EipSets {
    let axis = pendulum_axis();
    let case = line_case(&axis, &NOMINALS, &BOUNDARIES, 0.0, 5.0);
    line("L", axis, &NOMINALS, vec![case])
}

/// A grid of one plant.
pub(crate) fn lone_plant() -> EipSets {
    let axis = Axis::Explicit(vec![1.2]);
    let mut case = line_case(&axis, &NOMINALS, &BOUNDARIES, 0.0, 0.0);
    case.boundaries.clear();
    case.sets = vec![vec![], vec![Interval { from: 1.2, to: 1.2 }], vec![], vec![]];
    line("L", axis, &NOMINALS, vec![case])
}

/// `models` models, most of them needless, on a fine grid.
pub(crate) fn many(models: usize, points: usize) -> EipSets {
    let axis = Axis::Linear { from: 0.0, to: 1.0, points };
    let nominals: Vec<f64> = (0..models).map(|i| (i as f64 + 0.5) / models as f64).collect();
    let at: Vec<f64> = (1..models).map(|i| i as f64 / models as f64).collect();
    let case = line_case(&axis, &nominals, &at, 0.0, 0.0);
    line("alpha", axis, &nominals, vec![case])
}

/// Two parameters, six models, a corner that is unstable.
pub(crate) fn plane(points: [usize; 2]) -> EipSets {
    product(&[("L", 0.9, 1.9, points[0]), ("m", 0.4, 1.1, points[1])])
}

/// Two parameters and two delays.
pub(crate) fn plane_delays() -> EipSets {
    let mut sets = plane([61, 41]);
    let mut case = sets.cases[0].clone();
    case.delay = 0.02;
    let n = sets.models.len();
    for plant in 0..case.winner.len() {
        for (i, u) in case.upsilon[plant * n..][..n].iter_mut().enumerate() {
            *u += 6.0 * i as f64;
        }
        (case.winner[plant], case.margin[plant]) = decide(&case.upsilon[plant * n..][..n]);
    }
    sets.cases.push(case);
    sets
}

/// Three parameters.
pub(crate) fn space() -> EipSets {
    product(&[("L", 0.9, 1.9, 31), ("m", 0.4, 1.1, 21), ("friction coefficient", 0.0, 1.0, 5)])
}

fn product(axes: &[(&str, f64, f64, usize)]) -> EipSets {
    let parameters: Vec<&str> = axes.iter().map(|a| a.0).collect();
    let mut models = Vec::new();
    for l in [1.05, 1.4, 1.75] {
        for m in [0.55, 0.9] {
            let mut values = vec![l, m];
            values.resize(axes.len(), 0.5);
            models.push(model(&parameters, &values));
        }
    }
    let linear = |a: &(&str, f64, f64, usize)| {
        (a.0.to_string(), Axis::Linear { from: a.1, to: a.2, points: a.3 })
    };
    let grid = Grid::new(axes.iter().map(linear).collect()).unwrap();
    let mut case = line_case(&Axis::Explicit(vec![1.0]), &[1.0], &[], 0.0, 0.0);
    case.upsilon.clear();
    case.error.clear();
    case.winner.clear();
    case.margin.clear();
    case.sets.clear();
    for plant in 0..grid.len() {
        let p = grid.point(plant);
        let unstable = p[0] + p[1] < 1.45;
        let row: Vec<f64> = models
            .iter()
            .map(|model| {
                let d: Vec<f64> = p.iter().zip(&model.values).map(|(a, b)| a - b).collect();
                let far = d[0].powi(2) * 900.0 + d[1].powi(2) * 700.0 + d[0] * d[1] * 300.0;
                let bend = 60.0 * (p[0] * 3.0).sin() * d[1].powi(3);
                if unstable { f64::NAN } else { 20.0 + far + bend + 2.0 * model.values[0] }
            })
            .collect();
        let (winner, margin) = decide(&row);
        case.winner.push(winner);
        case.margin.push(margin);
        case.error.extend(row.iter().map(|u| u * 1e-13));
        case.upsilon.extend(row);
        if unstable {
            case.unstable.push(Unstable {
                plant,
                values: p,
                mode: Eigenvalue { re: 0.2, im: 0.0 },
                states: "theta".into(),
            });
        }
    }
    case.checked_pairs = 64;
    EipSets {
        title: None,
        parameters: names(&parameters),
        at_nominals: at_nominals(models.len()),
        models,
        convention: Convention::Baram { dt: 0.001 },
        grid,
        cases: vec![case],
        undecidable: vec![],
        method: Method::Modal,
        robust: None,
        delay_sweep: None,
        identification: None,
    }
}

/// Every study above by name.
pub(crate) fn all() -> Vec<(&'static str, EipSets)> {
    vec![
        ("pendulum", pendulum()),
        ("delays", delays()),
        ("wide_delays", wide_delays()),
        ("twelve", twelve()),
        ("troubled", troubled()),
        ("doubtful", doubtful()),
        ("single", single()),
        ("hopeless", hopeless()),
        ("lone_plant", lone_plant()),
        ("many", many(60, 20_001)),
        ("plane", plane([61, 41])),
        ("fine_plane", plane([700, 500])),
        ("plane_delays", plane_delays()),
        ("space", space()),
    ]
}
