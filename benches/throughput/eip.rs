//! EIP pairs end to end: observers, Upsilon (one route), sets and refined boundaries.

use crate::{Any, Pass, Run};
use mmae::eip::{Method, Study, Verify};
use mmae::mat;
use mmae::model::{FnFamily, Grid, Names, Plant, Time, systems};
use mmae::observer::{ModelSet, ObserverKind};
use mmae::{Mat, par::RunControl};
use std::sync::Arc;

/// Models of the cases with many.
const MODELS: usize = 256;

/// The cases: their names, and what runs them once.
pub(crate) fn cases(test: bool) -> Any<Vec<(String, Run)>> {
    let spacing = if test { 2 } else { 100 };
    Ok(vec![
        ("eip_pendulum".into(), Box::new(eip_pendulum)),
        ("eip_pendulum_N256".into(), many(pendulums, [0.9, 1.9], spacing)?),
        ("eip_n4_q1_N256".into(), many(masses, [0.5, 2.0], spacing)?),
    ])
}

/// Kalman-Bucy observers at some values of a parameter.
fn observers(parameter: &str, values: Vec<f64>, shaping: bool) -> ModelSet {
    ModelSet {
        observer: ObserverKind::KalmanBucy,
        parameters: vec![parameter.into()],
        models: values.into_iter().map(|v| vec![v]).collect(),
        labels: Vec::new(),
        shaping,
        Q: None,
        R: None,
    }
}

/// So many pendulums of 0.9 to 1.9 m, in their loop.
fn pendulums(lengths: Vec<f64>, plants: usize) -> Any<Study> {
    let grid = Grid::linear("L", 0.9, 1.9, plants)?;
    Ok(Study {
        surroundings: systems::pendulum_surroundings(),
        verify: Verify::None,
        ..Study::new(Arc::new(systems::pendulum()), observers("L", lengths, true), grid)
    })
}

/// Two masses of 1 kg, each on a spring of 0.5 N/m and damped, and a spring `k` between
/// them, of 0.5 to 2 N/m: noise drives the first, the place of the second is measured.
fn masses(springs: Vec<f64>, plants: usize) -> Any<Study> {
    let names = |names: &[&str]| names.iter().map(|&n| n.into()).collect();
    let names = Names {
        states: names(&["x1", "x2", "v1", "v2"]),
        inputs: Vec::new(),
        disturbances: names(&["d"]),
        outputs: names(&["x2"]),
    };
    let family = FnFamily::new(&[("k", 1.0)], names, Time::Continuous, |p| {
        let (k, both) = (p[0], p[0] + 0.5);
        Ok(Plant {
            time: Time::Continuous,
            A: mat![
                [0.0, 0.0, 1.0, 0.0],
                [0.0, 0.0, 0.0, 1.0],
                [-both, k, -0.2, 0.1],
                [k, -both, 0.1, -0.2]
            ],
            B: Mat::zeros(4, 0),
            G: mat![[0.0], [0.0], [1.0], [0.0]],
            C: mat![[0.0, 1.0, 0.0, 0.0]],
            Q: mat![[1.0]],
            R: mat![[0.01]],
        })
    });
    let grid = Grid::linear("k", 0.5, 2.0, plants)?;
    let bank = observers("k", springs, false);
    Ok(Study { verify: Verify::None, ..Study::new(Arc::new(family), bank, grid) })
}

/// Mean of ln Upsilon.
fn mean_ln(upsilon: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = upsilon.len() as f64;
    upsilon.map(f64::ln).sum::<f64>() / count
}

/// 401 pendulums by 4 models. The checksum is the mean of ln Upsilon.
fn eip_pendulum(control: &RunControl<'_>) -> Any<Pass> {
    let study = pendulums(vec![1.025, 1.287, 1.526, 1.778], 401)?;
    let upsilon = &study.run(control)?.cases[0].upsilon;
    let checksum = mean_ln(upsilon.iter().copied());
    // The value of SciPy's Lyapunov solver on the same 1604 pairs.
    let wanted = 4.825_117_768_92;
    if (checksum / wanted - 1.0).abs() < 1e-9 {
        Ok(Pass { items: upsilon.len(), checksum })
    } else {
        Err(format!("mean ln Upsilon is {checksum}, wanted {wanted}").into())
    }
}

/// 256 models and forty times `spacing` plants over a range. Every `spacing`-th is done by
/// the doubling, too: the checksum is the mean of ln Upsilon over these.
fn many(
    study: fn(Vec<f64>, usize) -> Any<Study>,
    [from, to]: [f64; 2],
    spacing: usize,
) -> Any<Run> {
    let last = (MODELS - 1) as f64;
    let values: Vec<f64> = (0..MODELS).map(|k| from + (to - from) * (k as f64 / last)).collect();
    let all = study(values.clone(), 40 * spacing + 1)?;
    let few = Study { method: Some(Method::Doubling), ..study(values, 41)? };
    let wanted = std::cell::OnceCell::new();
    Ok(Box::new(move |control| {
        let upsilon = &all.run(control)?.cases[0].upsilon;
        if wanted.get().is_none() {
            let by_doubling = &few.run(control)?.cases[0].upsilon;
            let _ = wanted.set(mean_ln(by_doubling.iter().copied()));
        }
        let wanted = wanted.get().copied().unwrap_or(f64::NAN);
        let few: Vec<f64> =
            upsilon.chunks(MODELS).step_by(spacing).flat_map(|row| row.iter().copied()).collect();
        let checksum = mean_ln(few.into_iter());
        if (checksum / wanted - 1.0).abs() < 1e-9 {
            Ok(Pass { items: upsilon.len(), checksum })
        } else {
            Err(format!("mean ln Upsilon is {checksum}, by doubling {wanted}").into())
        }
    }))
}
