//! A truth made ready: sampled, checked, in plain arrays.

use faer::Mat;

use super::Truth;
use crate::error::{Error, Result};
use crate::model::{
    Controller, Plant, Shaping, Taps, Time, check_covariance, check_finite, check_shape,
    psd_factor, sample_taps, van_loan,
};
use crate::par::{RunControl, try_map_chunks};
use crate::sim::signal::{Signal, Signals};

/// Most bytes of phases.
const LIMIT: u128 = 1 << 30;
/// Phases sampled at a time, a millisecond or so.
const CHUNK: usize = 64;

/// When the plant moves and when it is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::sim) enum Timing {
    /// Every step moves, then measures.
    MoveFirst,
    /// The same, but the first step only measures.
    MeasureAtStart,
    /// Every step measures, then moves: signals held over an interval.
    Hold,
}

/// Matrices of a phase, row by row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Phase<'a> {
    pub(super) a: &'a [f64],
    /// Of the command so many samples ago, and of the one before it (nothing for
    /// a delay of whole samples).
    pub(super) b: [&'a [f64]; 2],
    /// Of the known disturbances.
    pub(super) s: &'a [f64],
    /// `G L` with `L L' = Q`.
    pub(super) g: &'a [f64],
    pub(super) c: &'a [f64],
    /// Factor of `R`.
    pub(super) r: &'a [f64],
}

/// A linear system, row by row: the controller, or the input filter.
#[derive(Debug, Clone)]
pub(super) struct Block {
    pub(super) n: usize,
    pub(super) a: Vec<f64>,
    /// From its input: the measurement, or normal numbers.
    pub(super) b: Vec<f64>,
    pub(super) c: Vec<f64>,
    pub(super) d: Vec<f64>,
}

/// A truth ready to be simulated.
#[derive(Debug, Clone)]
pub(in crate::sim) struct Source {
    pub(in crate::sim) n: usize,
    pub(in crate::sim) q: usize,
    pub(in crate::sim) m: usize,
    /// Normal numbers a step: of disturbance, measurement, input filter and white
    /// inputs.
    pub(super) drive: [usize; 4],
    pub(super) timing: Timing,
    /// First step of each phase.
    pub(super) from: Vec<u64>,
    /// Matrices of the phases, one after the other.
    matrices: Vec<f64>,
    pub(super) x0: Vec<f64>,
    /// Factor of `P(0)`, or nothing.
    pub(super) spread: Vec<f64>,
    pub(super) controller: Option<Block>,
    pub(super) filter: Option<Block>,
    /// Samples of delay, and whether a part of a sample comes to them.
    pub(super) delay: usize,
    pub(super) split: bool,
    pub(super) known: Known,
}

/// Known signals, held over every step.
#[derive(Debug, Clone)]
pub(super) struct Known {
    pub(super) dt: f64,
    /// One an input, or none.
    pub(super) inputs: Vec<Signal>,
    /// Inputs with white noise, and its standard deviation.
    pub(super) white: Vec<(usize, f64)>,
    /// Disturbances with a signal.
    pub(super) disturbances: Vec<(usize, Signal)>,
    /// Outputs with a signal for noise.
    pub(super) noise: Vec<(usize, Signal)>,
}

impl Known {
    fn new(signals: &Signals, time: Time, dt: f64) -> Self {
        let held = if time.is_continuous() { dt } else { 1.0 };
        let white = signals.inputs.iter().map(|s| (s.intensity() / held).sqrt()).enumerate();
        let listed = |list: &[Option<Signal>]| -> Vec<(usize, Signal)> {
            let known = list.iter().enumerate();
            known.filter_map(|(j, s)| s.clone().map(|s| (j, s))).collect()
        };
        Self {
            dt,
            white: white.filter(|(_, std)| *std > 0.0).collect(),
            inputs: signals.inputs.clone(),
            disturbances: listed(&signals.disturbances),
            noise: listed(&signals.noise),
        }
    }
}

/// Puts the white part of known signals in place of a channel's own.
fn replace(cov: &mut Mat<f64>, known: &[(usize, Signal)]) {
    for (channel, signal) in known {
        for j in 0..cov.nrows() {
            cov[(*channel, j)] = 0.0;
            cov[(j, *channel)] = 0.0;
        }
        cov[(*channel, *channel)] = signal.intensity();
    }
}

fn rows(m: &Mat<f64>) -> Vec<f64> {
    (0..m.nrows()).flat_map(|i| (0..m.ncols()).map(move |j| m[(i, j)])).collect()
}

/// A factor without its zero columns at the end.
fn trimmed(factor: &Mat<f64>) -> usize {
    let used = |j: &usize| (0..factor.nrows()).any(|i| factor[(i, *j)] != 0.0);
    (0..factor.ncols()).rev().find(used).map_or(0, |j| j + 1)
}

fn product(a: &Mat<f64>, b: &Mat<f64>) -> Mat<f64> {
    Mat::from_fn(a.nrows(), b.ncols(), |i, j| {
        (0..a.ncols()).fold(0.0, |s, k| f64::mul_add(a[(i, k)], b[(k, j)], s))
    })
}

/// The first columns of `f`, zeros beyond its own, row by row.
fn cut(f: &Mat<f64>, cols: usize, out: &mut Vec<f64>) {
    for i in 0..f.nrows() {
        out.extend((0..cols).map(|j| if j < f.ncols() { f[(i, j)] } else { 0.0 }));
    }
}

/// A plant sampled, its noise factored.
struct Made {
    plant: Plant,
    taps: Taps,
    s: Mat<f64>,
    g: Mat<f64>,
    r: Mat<f64>,
}

impl Made {
    fn new(plant: &Plant, [n, m, w, q]: [usize; 4], known: &Known, delay: f64) -> Result<Self> {
        check_shape("A of the truth", plant.A.as_ref(), [n, n])?;
        check_shape("B of the truth", plant.B.as_ref(), [n, m])?;
        check_shape("C of the truth", plant.C.as_ref(), [q, n])?;
        plant.check()?;
        let listed = &known.disturbances;
        let mut plant = plant.clone();
        if !(listed.is_empty() && known.noise.is_empty()) {
            check_shape("G of the truth", plant.G.as_ref(), [n, w])?;
            replace(&mut plant.Q, listed);
            replace(&mut plant.R, &known.noise);
        }
        let mut s = Mat::from_fn(n, listed.len(), |i, j| plant.G[(i, listed[j].0)]);
        let (plant, taps) = match plant.time {
            Time::Continuous => {
                if !listed.is_empty() {
                    let none = Mat::zeros(n, n);
                    s = van_loan(plant.A.as_ref(), s.as_ref(), none.as_ref(), known.dt)?.B;
                }
                sample_taps(&plant, known.dt, delay)?
            }
            Time::Discrete { dt } => {
                let taps = Taps::whole_samples(&plant, delay, dt)?;
                (plant, taps)
            }
        };
        let g = product(&plant.G, &psd_factor(plant.Q.as_ref()));
        let r = psd_factor(plant.R.as_ref());
        Ok(Self { plant, taps, s, g, r })
    }
}

impl Source {
    /// Checks sizes, samples, and factors the covariances; `dt` is the interval of
    /// the measurements.
    ///
    /// # Errors
    /// `Empty` without a plant, `Shape`, `NonFinite`, `NotPsd`; those of the signals;
    /// `Range` for the delay and phases out of order; `Conflict` for an input
    /// filter that does not decay; `Limit`, `Cancelled`.
    pub(in crate::sim) fn new(
        truth: &Truth,
        timing: Timing,
        dt: f64,
        control: &RunControl<'_>,
    ) -> Result<Self> {
        let Some((_, first)) = truth.phases.first() else {
            return Err(Error::Empty { what: "phases of the truth".into() });
        };
        let sizes @ [n, m, w, q] = [first.nx(), first.nu(), first.nw(), first.ny()];
        truth.signals.check(m, w, q)?;
        let known = Known::new(&truth.signals, first.time, dt);
        let from: Vec<u64> = truth.phases.iter().map(|p| p.0).collect();
        if let Some(i) = (1..from.len()).find(|&i| from[i] <= from[i - 1]) {
            return Err(Error::Range {
                what: "first step of a phase of the truth".into(),
                value: from[i] as f64,
                remedy: "list the phases in the order of time".into(),
            });
        }
        let each = n * (2 * n + 2 * m + w + q) + q * q;
        let bytes = from.len() as u128 * each as u128 * 16;
        if bytes > LIMIT {
            return Err(Error::Limit {
                what: format!("a truth of {} phases", from.len()),
                bytes,
                limit: LIMIT,
                remedy: "let the plant change less often",
            });
        }
        let quiet = RunControl { progress: None, ..*control };
        let made: Vec<Made> = try_map_chunks(&quiet, truth.phases.len(), CHUNK, |chunk| {
            let plants = truth.phases[chunk].iter();
            plants.map(|(_, plant)| Made::new(plant, sizes, &known, truth.delay)).collect()
        })?
        .into_iter()
        .flat_map(|chunk: Vec<Made>| chunk)
        .collect();
        let filter = match &truth.input {
            None => None,
            Some(f) => Some(input_filter(f, m, first.time, dt)?),
        };
        let drive = [
            made.iter().map(|p| trimmed(&p.g)).max().unwrap_or(0),
            made.iter().map(|p| trimmed(&p.r)).max().unwrap_or(0),
            filter.as_ref().map_or(0, |f: &Block| f.b.len() / f.n),
            known.white.len(),
        ];
        let mut matrices = Vec::new();
        for made in &made {
            matrices.extend(rows(&made.plant.A));
            matrices.extend(rows(&made.taps.B0));
            matrices.extend(made.taps.B1.iter().flat_map(rows));
            matrices.extend(rows(&made.s));
            cut(&made.g, drive[0], &mut matrices);
            matrices.extend(rows(&made.plant.C));
            cut(&made.r, drive[1], &mut matrices);
        }
        let controller = match &truth.controller {
            None => None,
            Some(k) => Some(feedback(k, [m, q], first.time, dt)?),
        };
        Ok(Self {
            n,
            q,
            m,
            drive,
            timing,
            from,
            matrices,
            x0: start(&truth.x0, n)?,
            spread: spread(truth.P0.as_ref(), n)?,
            controller,
            filter,
            delay: made.first().map_or(0, |p| p.taps.steps),
            split: made.first().is_some_and(|p| p.taps.B1.is_some()),
            known,
        })
    }

    /// Phase `i`.
    #[inline(always)]
    pub(super) fn phase(&self, i: usize) -> Phase<'_> {
        let Self { n, m, q, .. } = *self;
        let late = if self.split { n * m } else { 0 };
        let known = self.known.disturbances.len() * n;
        let each = n * (n + m + self.drive[0] + q) + late + known + q * self.drive[1];
        let (a, rest) = self.matrices[i * each..][..each].split_at(n * n);
        let (b0, rest) = rest.split_at(n * m);
        let (b1, rest) = rest.split_at(late);
        let (s, rest) = rest.split_at(known);
        let (g, rest) = rest.split_at(n * self.drive[0]);
        let (c, r) = rest.split_at(q * n);
        Phase { a, b: [b0, b1], s, g, c, r }
    }

    /// True if nothing but noise drives one plant that stays the same.
    pub(super) fn is_plain(&self) -> bool {
        let Self { known, from, timing, filter, controller, .. } = self;
        from.len() < 2
            && *timing != Timing::Hold
            && filter.is_none()
            && controller.is_none()
            && known.disturbances.is_empty()
            && known.noise.is_empty()
            && known.white.is_empty()
            && !self.is_driven()
    }

    /// True if the first step moves before it measures.
    pub(super) fn moves_first(&self) -> bool {
        self.timing == Timing::MoveFirst
    }

    /// True if there is anything in the inputs.
    pub(super) fn is_driven(&self) -> bool {
        let known = !self.known.inputs.is_empty();
        self.m > 0 && (self.controller.is_some() || self.filter.is_some() || known)
    }
}

/// The controller, sampled.
fn feedback(k: &Controller, [m, q]: [usize; 2], time: Time, dt: f64) -> Result<Block> {
    k.check(m, q)?;
    let held = match time {
        Time::Continuous => k.sample(dt)?,
        Time::Discrete { .. } => k.clone(),
    };
    let n = k.A.nrows();
    Ok(Block { n, a: rows(&held.A), b: rows(&held.B), c: rows(&held.C), d: rows(&held.D) })
}

/// The input filter, sampled and driven by normal numbers.
fn input_filter(f: &Shaping, m: usize, time: Time, dt: f64) -> Result<Block> {
    f.check("input", m)?;
    f.check_stable("input", time)?;
    let f = match time {
        Time::Continuous => &f.sample(dt)?,
        Time::Discrete { .. } => f,
    };
    let root = product(&f.B, &psd_factor(f.Q.as_ref()));
    let mut b = Vec::new();
    cut(&root, trimmed(&root), &mut b);
    Ok(Block { n: f.nf(), a: rows(&f.A), b, c: rows(&f.C), d: Vec::new() })
}

/// `x(0)`, checked.
pub(in crate::sim) fn start(x0: &[f64], n: usize) -> Result<Vec<f64>> {
    if x0.len() != n {
        let got = [x0.len(), 1];
        return Err(Error::Shape { what: "x(0) of the truth".into(), want: [n, 1], got });
    }
    if let Some(row) = x0.iter().position(|v| !v.is_finite()) {
        return Err(Error::NonFinite { what: "x(0) of the truth".into(), row, col: 0 });
    }
    Ok(x0.to_vec())
}

/// A factor of `P(0)`, row by row, or nothing.
pub(in crate::sim) fn spread(p: Option<&Mat<f64>>, n: usize) -> Result<Vec<f64>> {
    let Some(p) = p else { return Ok(Vec::new()) };
    check_shape("P(0) of the truth", p.as_ref(), [n, n])?;
    check_finite("P(0) of the truth", p.as_ref())?;
    check_covariance("P(0) of the truth", p.as_ref(), false)?;
    Ok(rows(&psd_factor(p.as_ref())))
}
