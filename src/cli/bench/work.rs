//! What is timed: the kernels that users ask about, through the public interface.

use std::hint::black_box;
use std::sync::Arc;

use crate::bank::{Members, Settings};
use crate::eip::{Study, Verify};
use crate::engine::{Arrays, Mmae, Weighting};
use crate::error::{Error, Result};
use crate::model::{Family, Grid, Plant, sample, systems};
use crate::observer::{ModelSet, ObserverKind};
use crate::par::RunControl;
use crate::sim::{Measurement, MonteCarlo, Streams, Truth};
use crate::simd::{Block, LANES};
use crate::solve::{Checks, Lyapunov, Riccati, dare_with, lyapunov_discrete_with};
use crate::weight::posterior;

/// Items done, and the floating-point operations that they take at least.
pub(super) struct Done {
    pub(super) items: f64,
    pub(super) flops: f64,
}

/// Does it once.
type Run = Box<dyn Fn(&RunControl<'_>) -> Result<Done>>;

/// A kernel under test.
pub(super) struct Work {
    pub(super) name: &'static str,
    /// What the rate counts.
    pub(super) unit: &'static str,
    run: Run,
}

impl Work {
    /// Once.
    pub(super) fn run(&self, control: &RunControl<'_>) -> Result<Done> {
        (self.run)(control)
    }
}

/// Every kernel, ready to run.
///
/// # Errors
/// None that a user could cause.
pub(super) fn all() -> Result<Vec<Work>> {
    let steps = "model-trial-steps/s";
    Ok(vec![
        Work { name: "bank_n3_q1_N4", unit: steps, run: bank(oscillators()?)? },
        Work { name: "bank_n4_q2_N16", unit: steps, run: bank(trackers()?)? },
        Work { name: "dare_n8", unit: "equations/s", run: dare(8, 1024) },
        Work { name: "lyap_n8", unit: "equations/s", run: lyapunov(8, 1024) },
        Work { name: "simulate_n3_q1_N4", unit: steps, run: simulate(oscillators()?) },
        Work { name: "eip_pendulum", unit: "pairs/s", run: pendulum()? },
    ])
}

/// Four oscillators of three states, sampled.
fn oscillators() -> Result<Vec<Plant>> {
    let family = systems::oscillator();
    let model = |wn: f64| {
        let plant = family.plant(&family.theta_with(&[("wn", wn)])?)?;
        Ok(sample(&plant, 0.05, 0.0)?.0)
    };
    [0.7, 1.0, 2.0, 4.0].into_iter().map(model).collect()
}

/// Sixteen trackers of four states and two outputs.
fn trackers() -> Result<Vec<Plant>> {
    let family = systems::tracker();
    let model = |i: i32| family.plant(&family.theta_with(&[("rho", 0.9 + 0.006 * f64::from(i))])?);
    (0..16).map(model).collect()
}

/// Operations of one model on one measurement: `A x`, `C x`, `K r`, the whitened
/// residual and its square.
fn step_flops(n: usize, q: usize) -> f64 {
    2.0 * (n * n + 2 * n * q + q * (q + 1) / 2 + q) as f64
}

/// Steady filters on records that are given, and the posterior at their end.
fn bank(plants: Vec<Plant>) -> Result<Run> {
    let (records, steps) = (256, 250);
    let (models, n, q) = (plants.len(), plants[0].nx(), plants[0].ny());
    let members = Members::new(ObserverKind::Kalman, plants);
    let prior = vec![1.0; models];
    let mmae = Mmae::new(&members, &Settings::default(), &Weighting::default(), &prior)?;
    let mut blocks = vec![Block::default(); records * steps * q / LANES];
    Streams::new(1, 0).normals::<f64>(&mut blocks);
    let y: Vec<f64> = blocks.iter().flat_map(|b| b.0).collect();
    Ok(Box::new(move |control| {
        let arrays = Arrays { records, steps, y: &y, ..Arrays::default() };
        let log_lik = mmae.log_likelihoods(&arrays, control)?;
        black_box(posterior(&prior, &log_lik)?);
        let items = (records * steps * models) as f64;
        Ok(Done { items, flops: items * step_flops(n, q) })
    }))
}

/// Truth, noise, steady filters, Bayes's weights and statistics at the end; the
/// operations of the filters alone are counted.
fn simulate(plants: Vec<Plant>) -> Run {
    let (models, n, q) = (plants.len(), plants[0].nx(), plants[0].ny());
    let (trials, steps) = (512, 500);
    let experiment = MonteCarlo {
        truth: Truth::new(plants[1].clone()),
        members: Members::new(ObserverKind::Kalman, plants),
        settings: Settings::default(),
        weighting: Weighting::default(),
        prior: vec![1.0; models],
        steps,
        trials,
        measurement: Measurement::Sampled,
        seed: 1,
        every: 0,
        keep: Vec::new(),
        values: Vec::new(),
    };
    Box::new(move |control| {
        experiment.run(control)?;
        let items = (trials * steps) as f64 * models as f64;
        Ok(Done { items, flops: items * step_flops(n, q) })
    })
}

/// Entries in [-1, 1), by formula.
fn uniform(count: usize) -> Vec<f64> {
    let mut blocks = vec![Block::default(); count.div_ceil(LANES)];
    let mut streams = Streams::new(7, 0);
    for block in &mut blocks {
        *block = Block(streams.uniforms());
    }
    blocks.iter().flat_map(|b| b.0).take(count).map(|u| 2.0 * u - 1.0).collect()
}

/// `I` plus a small symmetric matrix, `len` of them.
fn weights(n: usize, len: usize) -> Vec<f64> {
    let v = uniform(n * n * len);
    let entry = |k: usize| {
        let (item, i, j) = (k / (n * n), k / n % n, k % n);
        let at = |i: usize, j: usize| v[item * n * n + i * n + j];
        f64::from(u8::from(i == j)) + (at(i, j) + at(j, i)) / 20.0
    };
    (0..n * n * len).map(entry).collect()
}

/// The first error of a batch, or the mean number of iterations.
fn iterations(items: &[crate::solve::ItemReport]) -> Result<f64> {
    let mut sum = 0.0;
    for item in items {
        item.status.clone()?;
        sum += f64::from(item.iterations);
    }
    Ok(sum / items.len() as f64)
}

/// Doubling steps that the Riccati equations here take; the iterations of a report
/// also count the squarings of the proof of stability, which cost much less.
const DOUBLINGS: f64 = 7.0;

/// Discrete Riccati equations, every one verified, with a bound on its error. The
/// operations of the doublings alone are counted, 13.6 n^3 each.
fn dare(n: usize, len: usize) -> Run {
    let m = n / 2;
    let a: Vec<f64> = uniform(n * n * len).iter().map(|u| 0.7 * u).collect();
    let (b, q) = (uniform(n * m * len), weights(n, len));
    let r: Vec<f64> = (0..m * m).map(|k| if k % (m + 1) == 0 { 1.0 } else { 0.0 }).collect();
    let r = r.repeat(len);
    Box::new(move |control| {
        let batch = Riccati { n, m, len, A: &a, B: &b, Q: &q, R: &r, S: None };
        let solved = dare_with(&batch, Checks::All, control)?;
        iterations(&solved.items)?;
        let each = 13.6 * (n * n * n) as f64 * DOUBLINGS;
        Ok(Done { items: len as f64, flops: len as f64 * each })
    })
}

/// Discrete Lyapunov equations, likewise; 5 n^3 a doubling.
fn lyapunov(n: usize, len: usize) -> Run {
    let scale = 1.0 / (1.5 * (n as f64).sqrt());
    let a: Vec<f64> = uniform(n * n * len).iter().map(|u| u * scale).collect();
    let q = weights(n, len);
    Box::new(move |control| {
        let batch = Lyapunov { n, len, A: &a, Q: &q };
        let solved = lyapunov_discrete_with(&batch, Checks::All, control)?;
        let each = 5.0 * (n * n * n) as f64 * iterations(&solved.items)?;
        Ok(Done { items: len as f64, flops: len as f64 * each })
    })
}

/// Pendulums by four models, from the parameters to the sets; some 20,000
/// operations a pair.
fn pendulum() -> Result<Run> {
    let bank = ModelSet {
        observer: ObserverKind::KalmanBucy,
        parameters: vec!["L".into()],
        models: [1.025, 1.287, 1.526, 1.778].map(|l| vec![l]).to_vec(),
        labels: Vec::new(),
        shaping: true,
        Q: None,
        R: None,
    };
    let study = Study {
        surroundings: systems::pendulum_surroundings(),
        verify: Verify::None,
        ..Study::new(Arc::new(systems::pendulum()), bank, Grid::linear("L", 0.9, 1.9, 10_001)?)
    };
    Ok(Box::new(move |control| {
        let sets = study.run(control)?;
        let Some(case) = sets.cases.first() else {
            return Err(Error::Empty { what: "cases of the study".into() });
        };
        let pairs = case.upsilon.len() as f64;
        Ok(Done { items: pairs, flops: 2e4 * pairs })
    }))
}
