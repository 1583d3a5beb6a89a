//! How cost grows: rates over trials, models, states, outputs, steps and threads.
//!
//! `cargo bench --bench scaling` prints a table, `-- --json` what
//! `benches/peers/scaling.py` draws, `-- --test` runs every point once, small.
//! `--seconds S` is the time a point takes. Rates are of processor time, all threads
//! together, of the best pass: a flat line is a cost that is linear, and two threads
//! beside one are the efficiency.
#![allow(clippy::print_stdout, reason = "a program that reports on stdout")]

use cpu_time::ProcessTime;
use mmae::Mat;
use mmae::bank::{Members, Settings};
use mmae::engine::{Arrays, Mmae, Weighting};
use mmae::model::{Plant, Time};
use mmae::observer::ObserverKind;
use mmae::par::RunControl;
use mmae::sim::{Measurement, MonteCarlo, Truth};
use std::time::Duration;

type Any<T> = Result<T, Box<dyn std::error::Error>>;

/// One measurement: a bank of `models` filters of `n` states and `q` outputs.
#[derive(Clone, Copy)]
struct Point {
    axis: &'static str,
    what: &'static str,
    n: usize,
    q: usize,
    models: usize,
    trials: usize,
    steps: usize,
    threads: usize,
}

/// The middle of all axes.
const BASE: Point =
    Point { axis: "", what: "bank", n: 4, q: 2, models: 16, trials: 1024, steps: 250, threads: 1 };

impl Point {
    /// Where it stands on its axis.
    fn at(&self) -> usize {
        match self.axis {
            "trials" => self.trials,
            "models" => self.models,
            "states" => self.n,
            "outputs" => self.q,
            "steps" => self.steps,
            _ => self.threads,
        }
    }

    /// Model-trial-steps of a pass.
    fn items(&self) -> f64 {
        (self.models * self.trials * self.steps) as f64
    }

    /// Multiply-adds of a model-trial-step.
    fn flops(&self) -> f64 {
        let Point { n, q, .. } = *self;
        2.0 * (n * n + 2 * n * q + q * (q + 1) / 2 + q) as f64
    }
}

/// All points; `test` makes them small.
fn points(test: bool) -> Vec<Point> {
    let mut out = Vec::new();
    for what in ["bank", "simulate"] {
        let base = Point { what, ..BASE };
        for trials in [1_000, 10_000, 100_000, 1_000_000] {
            out.push(Point { axis: "trials", trials, steps: 32, models: 4, ..base });
        }
        for models in [1, 2, 4, 8, 16, 32, 64, 128, 256, 1024] {
            let trials = (65_536 / models).clamp(64, 4096);
            out.push(Point { axis: "models", models, trials, steps: 64, ..base });
        }
        for n in 1..=13 {
            out.push(Point { axis: "states", n, q: 1, trials: 512, steps: 64, ..base });
        }
        for q in 1..=8 {
            out.push(Point { axis: "outputs", n: 8, q, trials: 512, steps: 64, ..base });
        }
        for steps in [50, 200, 800, 3200] {
            out.push(Point { axis: "steps", steps, trials: 256, ..base });
        }
        for threads in [1, 2] {
            out.push(Point { axis: "threads", threads, ..base });
        }
    }
    if test {
        for point in &mut out {
            point.trials = point.trials.min(20);
            point.steps = point.steps.min(4);
        }
    }
    out
}

/// Stable models of any size, all different.
fn models(point: Point) -> Vec<Plant> {
    let Point { n, q, models, .. } = point;
    let entry = |i: usize, j: usize, k: usize| ((7 * i + 3 * j + k) as f64).sin();
    let root = 1.5 * (n as f64).sqrt();
    (0..models)
        .map(|k| Plant {
            time: Time::Discrete { dt: 1.0 },
            A: Mat::from_fn(n, n, |i, j| entry(i, j, k) / root),
            B: Mat::zeros(n, 0),
            G: Mat::identity(n, n),
            C: Mat::from_fn(q, n, |i, j| entry(i, 2 * j, k + 1)),
            Q: Mat::identity(n, n),
            R: Mat::identity(q, q),
        })
        .collect()
}

/// What is run once a pass.
type Pass = Box<dyn Fn() -> Any<()>>;

fn pass(point: Point) -> Any<Pass> {
    let plants = models(point);
    let members = Members::new(ObserverKind::Kalman, plants.clone());
    let prior = vec![1.0; point.models];
    if point.what == "bank" {
        let mmae = Mmae::new(&members, &Settings::default(), &Weighting::default(), &prior)?;
        let len = point.trials * point.steps * point.q;
        let y: Vec<f64> = (0..len).map(|k| (k as f64 * 0.37).sin()).collect();
        return Ok(Box::new(move || {
            let control = RunControl::default().threads(point.threads);
            let (records, steps) = (point.trials, point.steps);
            let arrays = Arrays { records, steps, y: &y, ..Arrays::default() };
            std::hint::black_box(mmae.log_likelihoods(&arrays, &control)?);
            Ok(())
        }));
    }
    let experiment = MonteCarlo {
        truth: Truth::new(plants[0].clone()),
        members,
        settings: Settings::default(),
        weighting: Weighting::default(),
        prior,
        steps: point.steps as u64,
        trials: point.trials as u64,
        measurement: Measurement::Sampled,
        seed: 1,
        every: 0,
        keep: Vec::new(),
        values: Vec::new(),
    };
    Ok(Box::new(move || {
        let control = RunControl::default().threads(point.threads);
        std::hint::black_box(experiment.run(&control)?);
        Ok(())
    }))
}

/// Processor time of the best pass.
fn best(pass: &Pass, within: Duration) -> Any<Duration> {
    pass()?;
    let (start, mut best) = (ProcessTime::now(), Duration::MAX);
    loop {
        let one = ProcessTime::now();
        pass()?;
        best = best.min(one.elapsed());
        if start.elapsed() >= within {
            return Ok(best);
        }
    }
}

fn main() -> Any<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let json = arguments.iter().any(|a| a == "--json");
    let test = !(json || arguments.iter().any(|a| a == "--bench"))
        || arguments.iter().any(|a| a == "--test");
    let after = arguments.iter().position(|a| a == "--seconds").map(|i| i + 1);
    let seconds = after.and_then(|i| arguments.get(i)).map_or(Ok(0.5), |s| s.parse())?;
    let within = if test { Duration::ZERO } else { Duration::from_secs_f64(seconds) };
    let mut lines = Vec::new();
    for point in points(test) {
        let time = best(&pass(point)?, within)?.as_secs_f64();
        if test {
            continue;
        }
        let rate = point.items() / time;
        let gflops = rate * point.flops() * 1e-9;
        let Point { axis, what, n, q, models, trials, steps, threads } = point;
        if json {
            lines.push(format!(
                "{{\"axis\": \"{axis}\", \"what\": \"{what}\", \"n\": {n}, \"q\": {q}, \"models\": {models}, \
                 \"trials\": {trials}, \"steps\": {steps}, \"threads\": {threads}, \
                 \"rate\": {rate:e}, \"gflops\": {gflops:e}}}"
            ));
        } else {
            let at = point.at();
            println!("{what:<9} {axis:<8} {at:>8} {rate:10.3e} /s {gflops:8.2} GFLOP/s");
        }
    }
    if json {
        println!("[{}]", lines.join(",\n "));
    } else if test {
        println!("scaling: ok");
    }
    Ok(())
}
