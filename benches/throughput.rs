//! Rates of the batched solvers, of EIP pairs, of banks and of recursive least squares, on
//! problems made by formula.
//!
//! `cargo bench --bench throughput` prints a table, `-- --json` one object
//! (`{"care_n4": {"rate": .., "checksum": ..}}`, problems or pairs per second),
//! `-- --test` runs every case once, small, `--passes K` so many times, for
//! `benches/instructions/run.sh`. `--case NAME`, `--seconds S`, `--rounds K` (the best
//! counts), `--threads N` narrow it; `--list` names the cases. Every result is checked
//! before it is timed. `benches/peers/run.sh` compares these rates with other
//! libraries' on the same problems, whose formula is in
//! `benches/peers/problems.py`.
#![allow(clippy::print_stdout, reason = "a program that reports on stdout")]

use mmae::Mat;
use mmae::adaptive::LeastSquares;
use mmae::bank::{Members, Settings};
use mmae::engine::{Arrays, Mmae, Weighting};
use mmae::model::{Plant, Time};
use mmae::observer::ObserverKind;
use mmae::par::RunControl;
use mmae::sim::{Measurement, MonteCarlo, Truth};
use mmae::simd::Panel;
use mmae::solve::{self, Checks, Lyapunov, Riccati, Solutions};
use mmae::weight::posterior;
use std::time::Instant;

#[path = "throughput/eip.rs"]
mod eip;

type Any<T> = Result<T, Box<dyn std::error::Error>>;

/// Items whose trace enters the checksum.
const CHECKED: usize = 64;
/// Riccati residuals and Lyapunov residuals, relative, never exceed this.
const RESIDUAL: f64 = 1e-11;

/// Entry after entry of the stream of `seed`, in [-1, 1).
struct Stream {
    state: u64,
}

impl Stream {
    fn next(&mut self) -> f64 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^= z >> 31;
        (z >> 11) as f64 * 2f64.powi(-53) * 2.0 - 1.0
    }

    fn take(&mut self, count: usize) -> Vec<f64> {
        (0..count).map(|_| self.next()).collect()
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Equation {
    Care,
    Dare,
    LyapunovContinuous,
    LyapunovDiscrete,
}

/// A batch of one equation: `A`, `B`, `Q` in C order (`R = I`).
struct Batch {
    equation: Equation,
    checks: Checks,
    n: usize,
    m: usize,
    len: usize,
    a: Vec<f64>,
    b: Vec<f64>,
    q: Vec<f64>,
    r: Vec<f64>,
}

impl Batch {
    fn new(equation: Equation, checks: Checks, n: usize, len: usize) -> Batch {
        let riccati = matches!(equation, Equation::Care | Equation::Dare);
        let m = if riccati { n / 2 } else { 0 };
        let seed = n as u64 + 100 * equation as u64;
        let mut stream = Stream { state: seed };
        let (mut a, mut b, mut q) = (Vec::new(), Vec::new(), Vec::new());
        let root = (n as f64).sqrt();
        for _ in 0..len {
            for (k, u) in stream.take(n * n).into_iter().enumerate() {
                let diagonal = k % (n + 1) == 0;
                a.push(match equation {
                    Equation::Care => u / 2.0,
                    Equation::Dare => 0.7 * u,
                    Equation::LyapunovContinuous if diagonal => u - (1.0 + root),
                    Equation::LyapunovContinuous => u,
                    Equation::LyapunovDiscrete => u / (1.5 * root),
                });
            }
            b.extend(stream.take(n * m));
            let v = stream.take(n * n);
            for i in 0..n {
                for j in 0..n {
                    let one = if i == j { 1.0 } else { 0.0 };
                    q.push(one + (v[i * n + j] + v[j * n + i]) / 20.0);
                }
            }
        }
        let r = (0..m * m).map(|k| if k % (m + 1) == 0 { 1.0 } else { 0.0 });
        Batch { equation, checks, n, m, len, a, b, q, r: r.collect() }
    }

    fn solve(&self, control: &RunControl<'_>) -> mmae::Result<Solutions> {
        let (n, m, len) = (self.n, self.m, self.len);
        let riccati =
            Riccati { n, m, len, A: &self.a, B: &self.b, Q: &self.q, R: &self.r, S: None };
        let lyapunov = Lyapunov { n, len, A: &self.a, Q: &self.q };
        match self.equation {
            Equation::Care => solve::care_with(&riccati, self.checks, control),
            Equation::Dare => solve::dare_with(&riccati, self.checks, control),
            Equation::LyapunovContinuous => {
                solve::lyapunov_continuous_with(&lyapunov, self.checks, control)
            }
            Equation::LyapunovDiscrete => {
                solve::lyapunov_discrete_with(&lyapunov, self.checks, control)
            }
        }
    }

    /// Solves the batch; every item must be solved, verified and exact.
    fn pass(&self, control: &RunControl<'_>) -> Any<Pass> {
        let solutions = self.solve(control)?;
        for (k, item) in solutions.items.iter().enumerate() {
            if let Err(error) = &item.status {
                return Err(format!("item {k}: {error}").into());
            }
            // Written so that NaN fails.
            if !(item.residual <= RESIDUAL && item.margin > 0.0) {
                let (residual, margin) = (item.residual, item.margin);
                return Err(format!("item {k}: residual {residual:e}, margin {margin:e}").into());
            }
        }
        let checked = CHECKED.min(self.len);
        let trace = |k: usize| -> f64 {
            (0..self.n).map(|i| solutions.x[(k * self.n + i) * self.n + i]).sum()
        };
        let checksum = (0..checked).map(trace).sum::<f64>() / checked as f64;
        Ok(Pass { items: self.len, checksum })
    }
}

/// One run of a case: how many items, and a number to compare.
struct Pass {
    items: usize,
    checksum: f64,
}

/// A bank of `benches/peers/problems.py`: n, q and the number of models.
const BANKS: [(&str, [usize; 3]); 2] = [("n3_q1_N4", [3, 1, 4]), ("n4_q2_N16", [4, 2, 16])];
const RECORDS: usize = 1024;
const STEPS: usize = 250;
const CHECKED_RECORDS: usize = 4;

/// Models and records of a bank.
fn bank_problem([n, q, models]: [usize; 3]) -> (Vec<Plant>, Vec<f64>) {
    let mut stream = Stream { state: 400 + n as u64 };
    let root = 1.5 * (n as f64).sqrt();
    let mut plants = Vec::new();
    for _ in 0..models {
        let (a, c) = (stream.take(n * n), stream.take(q * n));
        plants.push(Plant {
            time: Time::Discrete { dt: 1.0 },
            A: Mat::from_fn(n, n, |i, j| a[i * n + j] / root),
            B: Mat::zeros(n, 0),
            G: Mat::identity(n, n),
            C: Mat::from_fn(q, n, |i, j| c[i * n + j]),
            Q: Mat::identity(n, n),
            R: Mat::identity(q, q),
        });
    }
    let y = stream.take(RECORDS * STEPS * q).into_iter().map(|u| 3.0 * u).collect();
    (plants, y)
}

/// Steady filters on given records and the posterior at their end; the checksum is
/// the mean log-likelihood a step of the first records.
fn bank(sizes: [usize; 3]) -> Any<Run> {
    let (plants, y) = bank_problem(sizes);
    let members = Members::new(ObserverKind::Kalman, plants);
    let prior = vec![1.0; sizes[2]];
    let mmae = Mmae::new(&members, &Settings::default(), &Weighting::default(), &prior)?;
    Ok(Box::new(move |control| {
        let arrays = Arrays { records: RECORDS, steps: STEPS, y: &y, ..Arrays::default() };
        let log_lik = mmae.log_likelihoods(&arrays, control)?;
        std::hint::black_box(posterior(&prior, &log_lik)?);
        let first = &log_lik[..CHECKED_RECORDS * sizes[2]];
        let checksum = first.iter().sum::<f64>() / (first.len() * STEPS) as f64;
        Ok(Pass { items: RECORDS * STEPS * sizes[2], checksum })
    }))
}

/// The same with noise and truth; the checksum is the mean NIS of the right model
/// over the number of outputs.
fn simulate(sizes: [usize; 3]) -> Run {
    let (plants, _) = bank_problem(sizes);
    let experiment = MonteCarlo {
        truth: Truth::new(plants[0].clone()),
        members: Members::new(ObserverKind::Kalman, plants),
        settings: Settings::default(),
        weighting: Weighting::default(),
        prior: vec![1.0; sizes[2]],
        steps: STEPS as u64,
        trials: RECORDS as u64,
        measurement: Measurement::Sampled,
        seed: 1,
        every: 0,
        keep: Vec::new(),
        values: Vec::new(),
    };
    Box::new(move |control| {
        let summary = experiment.run(control)?;
        let checksum = summary.last().nis[0] / sizes[1] as f64;
        Ok(Pass { items: RECORDS * STEPS * sizes[2], checksum })
    })
}

/// Regressors and measurements of recursive least squares, step by step.
fn rls_problem(p: usize) -> (Vec<f64>, Vec<f64>) {
    let mut stream = Stream { state: 500 + p as u64 };
    let phi = stream.take(STEPS * RECORDS * p);
    (phi, stream.take(STEPS * RECORDS))
}

/// Forgetting, and `P(0)`.
const MU: f64 = 0.99;
const P0: f64 = 1e4;

/// Mean of the parameters of the first records.
fn rls_checksum(p: usize, theta: impl Fn(usize) -> Vec<f64>) -> f64 {
    (0..CHECKED_RECORDS).flat_map(theta).sum::<f64>() / (CHECKED_RECORDS * p) as f64
}

/// Recursive least squares in lanes, as U D U'.
fn rls(p: usize) -> Run {
    let made = std::cell::OnceCell::new();
    Box::new(move |_| {
        let steps: &Vec<(Panel, Panel)> = made.get_or_init(|| {
            let (phi, y) = rls_problem(p);
            let step = |k: usize| {
                let at = k * RECORDS;
                let row = Panel::from_fn(1, p, RECORDS, |i, _, j| phi[(at + i) * p + j]);
                (row, Panel::from_fn(1, 1, RECORDS, |i, _, _| y[at + i]))
            };
            (0..STEPS).map(step).collect()
        });
        let mut fit = LeastSquares::new(p, RECORDS, P0)?;
        for (phi, y) in steps {
            fit.update(phi, y, MU, 1.0)?;
        }
        let checksum = rls_checksum(p, |i| fit.theta(i));
        Ok(Pass { items: RECORDS * STEPS, checksum })
    })
}

/// The same as a plain loop, one record after the other, with P itself.
fn rls_loop(p: usize) -> Run {
    let made = std::cell::OnceCell::new();
    Box::new(move |_| {
        let (phi, y) = made.get_or_init(|| rls_problem(p));
        let mut all = Vec::with_capacity(RECORDS);
        let mut gain = vec![0.0; p];
        for i in 0..RECORDS {
            let mut theta = vec![0.0; p];
            let mut cov: Vec<f64> =
                (0..p * p).map(|e| if e % (p + 1) == 0 { P0 } else { 0.0 }).collect();
            for k in 0..STEPS {
                let row = &phi[(k * RECORDS + i) * p..][..p];
                let (mut total, mut e) = (MU, y[k * RECORDS + i]);
                for a in 0..p {
                    gain[a] = (0..p).map(|b| cov[a * p + b] * row[b]).sum();
                    total += row[a] * gain[a];
                    e -= row[a] * theta[a];
                }
                for a in 0..p {
                    theta[a] += gain[a] / total * e;
                    for b in 0..p {
                        cov[a * p + b] = (cov[a * p + b] - gain[a] * gain[b] / total) / MU;
                    }
                }
            }
            all.push(theta);
        }
        let checksum = rls_checksum(p, |i| all[i].clone());
        Ok(Pass { items: RECORDS * STEPS, checksum })
    })
}

type Run = Box<dyn Fn(&RunControl<'_>) -> Any<Pass>>;

/// Every case: its name, and what runs it once.
fn cases(test: bool) -> Any<Vec<(String, Run)>> {
    let kinds = [
        ("care", Equation::Care),
        ("dare", Equation::Dare),
        ("clyap", Equation::LyapunovContinuous),
        ("dlyap", Equation::LyapunovDiscrete),
    ];
    let mut out: Vec<(String, Run)> = Vec::new();
    // `_nobound`: verified and corrected, but without error bounds.
    for (suffix, checks) in [("", Checks::All), ("_nobound", Checks::Stability)] {
        for (name, equation) in kinds {
            for n in [4, 8, 12] {
                let len = if test { CHECKED } else { 16_384 / n };
                // Made on first use: a run of one case does not wait for the others.
                let batch = std::cell::OnceCell::new();
                let run = move |control: &RunControl<'_>| {
                    batch.get_or_init(|| Batch::new(equation, checks, n, len)).pass(control)
                };
                out.push((format!("{name}_n{n}{suffix}"), Box::new(run)));
            }
        }
    }
    out.extend(eip::cases(test)?);
    for (name, sizes) in BANKS {
        out.push((format!("bank_{name}"), bank(sizes)?));
        out.push((format!("simulate_{name}"), simulate(sizes)));
    }
    for p in [4, 8] {
        out.push((format!("rls_p{p}"), rls(p)));
        out.push((format!("rls_p{p}_loop"), rls_loop(p)));
    }
    Ok(out)
}

/// What the arguments ask for.
struct Arguments {
    json: bool,
    test: bool,
    list: bool,
    only: Vec<String>,
    seconds: f64,
    rounds: usize,
    threads: usize,
    /// Only so many passes over the sizes of a test, for counting instructions.
    passes: usize,
}

fn arguments() -> Any<Arguments> {
    let mut out = Arguments {
        json: false,
        test: false,
        list: false,
        only: vec![],
        seconds: 1.0,
        rounds: 5,
        threads: 1,
        passes: 0,
    };
    let mut bench = false;
    let mut rest = std::env::args().skip(1);
    while let Some(argument) = rest.next() {
        let mut value = || rest.next().ok_or(format!("{argument} needs a value"));
        match argument.as_str() {
            "--json" => out.json = true,
            "--test" => out.test = true,
            "--list" => out.list = true,
            "--case" => out.only.push(value()?),
            "--seconds" => out.seconds = value()?.parse()?,
            "--rounds" => out.rounds = value()?.parse()?,
            "--threads" => out.threads = value()?.parse()?,
            "--passes" => out.passes = value()?.parse()?,
            "--bench" => bench = true,
            other => return Err(format!("{other} is not known; see the top of the file").into()),
        }
    }
    // `cargo bench` says --bench, `cargo test` says nothing.
    out.test |= out.passes > 0 || !(bench || out.json || out.list);
    Ok(out)
}

/// Items per second of the best round; and the checksum. The rounds share the seconds.
fn measure(run: &Run, control: &RunControl<'_>, asked: &Arguments) -> Any<(f64, f64)> {
    let checksum = run(control)?.checksum;
    let slice = asked.seconds / asked.rounds as f64;
    let mut best = 0.0_f64;
    for _ in 0..asked.rounds {
        let (mut items, start) = (0, Instant::now());
        loop {
            let pass = run(control)?;
            if pass.checksum.to_bits() != checksum.to_bits() {
                return Err("two passes over the same problems differ".into());
            }
            items += pass.items;
            let spent = start.elapsed().as_secs_f64();
            if spent >= slice {
                best = best.max(items as f64 / spent);
                break;
            }
        }
    }
    Ok((best, checksum))
}

fn main() -> Any<()> {
    let asked = arguments()?;
    let control = RunControl::default().threads(asked.threads);
    let mut lines = Vec::new();
    for (name, run) in cases(asked.test)? {
        if !asked.only.is_empty() && !asked.only.contains(&name) {
            continue;
        }
        if asked.list {
            println!("{name}");
            continue;
        }
        let outcome = if asked.test {
            for _ in 1..asked.passes {
                run(&control)?;
            }
            run(&control).map(|pass| (0.0, pass.checksum))
        } else {
            measure(&run, &control, &asked)
        };
        let (rate, checksum) = outcome.map_err(|e| format!("{name}: {e}"))?;
        match (asked.json, asked.test) {
            (true, _) => {
                lines.push(format!(
                    "\"{name}\": {{\"rate\": {rate:e}, \"checksum\": {checksum:e}}}"
                ));
            }
            (false, true) => println!("{name}: ok"),
            (false, false) => println!("{name:<14} {rate:10.3e} /s   checksum {checksum:.15e}"),
        }
    }
    if asked.json {
        println!("{{{}}}", lines.join(", "));
    }
    Ok(())
}
