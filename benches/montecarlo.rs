//! Monte-Carlo trials from end to end: truth, noise, bank, weights.
//!
//! A model-trial-step is one step of one filter in one trial. `first` has three
//! states, one output and four models, `second` four, two and sixteen. Weights
//! are read at the end (`end`) or at every step (`each`), on one thread.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use mmae::Mat;
use mmae::bank::Members;
use mmae::engine::Weighting;
use mmae::model::{Plant, Time};
use mmae::observer::ObserverKind;
use mmae::par::RunControl;
use mmae::sim::{Measurement, MonteCarlo, Truth};
use mmae::weight::Law;

const STEPS: u64 = 200;
const TRIALS: u64 = 512;

/// A stable plant of `n` states and `q` outputs, one a model.
fn plant(n: usize, q: usize, model: usize) -> Plant {
    let decay = 0.7 + 0.2 * model as f64 / 16.0;
    Plant {
        time: Time::Discrete { dt: 1.0 },
        A: Mat::from_fn(n, n, |i, j| match (i, j) {
            (i, j) if i == j => decay,
            (i, j) if j == i + 1 => 0.3,
            _ => -0.05,
        }),
        B: Mat::zeros(n, 0),
        G: Mat::identity(n, n),
        C: Mat::from_fn(q, n, |i, j| if i == j { 1.0 } else { 0.1 }),
        Q: Mat::from_fn(n, n, |i, j| if i == j { 0.2 } else { 0.05 }),
        R: Mat::from_fn(q, q, |i, j| if i == j { 1.0 } else { 0.1 }),
    }
}

fn experiment(n: usize, q: usize, models: usize, law: Law, every: u64) -> MonteCarlo {
    MonteCarlo {
        members: Members::new(
            ObserverKind::Kalman,
            (0..models).map(|i| plant(n, q, i * 16 / models)).collect(),
        ),
        settings: Default::default(),
        weighting: Weighting { law, ..Weighting::default() },
        prior: vec![1.0; models],
        truth: Truth::new(plant(n, q, 0)),
        steps: STEPS,
        trials: TRIALS,
        measurement: Measurement::Sampled,
        seed: 1,
        every,
        keep: Vec::new(),
        values: Vec::new(),
    }
}

fn trials(c: &mut Criterion) {
    let mut group = c.benchmark_group("montecarlo");
    let control = RunControl::default().threads(1);
    for (name, n, q, models) in [("first", 3, 1, 4), ("second", 4, 2, 16)] {
        for (how, law, every) in [
            ("end", Law::Bayes, 0),
            ("each", Law::Bayes, 1),
            ("zhang1", Law::Zhang { n_max: 1.0 }, 0),
        ] {
            let experiment = experiment(n, q, models, law, every);
            let summary = experiment.run(&control).expect("the bank can be built");
            let last = summary.last();
            assert!((last.p.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            assert!((last.nis[0] - q as f64).abs() < 0.5, "{}", last.nis[0]);
            assert!(last.identified[0] > 1.0 / models as f64);
            group.throughput(Throughput::Elements(STEPS * TRIALS * models as u64));
            group.bench_function(format!("{name}/{how}"), |b| {
                b.iter(|| black_box(&experiment).run(&control));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, trials);
criterion_main!(benches);
