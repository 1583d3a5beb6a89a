//! What drives plant and observers, as outputs of one autonomous system.

use faer::Mat;

use crate::model::{Plant, psd_factor};
use crate::sim::signal::{Signal, Signals, Term, Wave};

/// Columns of `u`, `w`, `v` from `[e; xi]`.
pub(super) struct Channels {
    pub(super) u: Mat<f64>,
    pub(super) w: Mat<f64>,
    pub(super) v: Mat<f64>,
    /// Generator of `e`.
    pub(super) e: Mat<f64>,
    pub(super) terms: Vec<Term>,
    /// Random numbers of a step.
    pub(super) xi: usize,
}

/// States that a term needs.
pub(super) fn order(term: &Term) -> usize {
    match term.wave {
        Wave::Sine { .. } => 2,
        Wave::White { .. } => 0,
        Wave::Constant { .. } | Wave::Square { .. } | Wave::Table { .. } => 1,
    }
}

/// Covariance of the white parts of `[u; w; v]`: block after block, of a held
/// signal's intensity or of the channel's own noise.
fn white_of(plant: &Plant, signals: &Signals) -> [Mat<f64>; 3] {
    let given = |list: &[Option<Signal>], j: usize| {
        list.get(j).map(|s| s.as_ref().map(Signal::intensity)).unwrap_or_default()
    };
    let own = |list: &[Option<Signal>], cov: &Mat<f64>| {
        Mat::from_fn(cov.nrows(), cov.nrows(), |i, j| match (given(list, i), given(list, j)) {
            (None, None) => cov[(i, j)],
            (Some(intensity), _) if i == j => intensity,
            _ => 0.0,
        })
    };
    let m = plant.nu();
    let input = |j: usize| signals.inputs.get(j).map_or(0.0, Signal::intensity);
    [
        Mat::from_fn(m, m, |i, j| if i == j { input(i) } else { 0.0 }),
        own(&signals.disturbances, &plant.Q),
        own(&signals.noise, &plant.R),
    ]
}

/// Columns that a factor needs.
fn used(factor: &Mat<f64>) -> usize {
    let used = |j: &usize| (0..factor.nrows()).any(|i| factor[(i, *j)] != 0.0);
    (0..factor.ncols()).rev().find(used).map_or(0, |j| j + 1)
}

impl Channels {
    /// Random numbers that the inputs, disturbances and outputs of all `plants`
    /// need a step.
    pub(super) fn columns<'p>(
        plants: impl Iterator<Item = &'p Plant>,
        signals: &Signals,
    ) -> [usize; 3] {
        plants.fold([0; 3], |most, plant| {
            let white = white_of(plant, signals);
            std::array::from_fn(|k| most[k].max(used(&psd_factor(white[k].as_ref()))))
        })
    }

    /// Of a plant whose noise is held over `dt` seconds.
    pub(super) fn new(plant: &Plant, signals: &Signals, columns: [usize; 3], dt: f64) -> Self {
        let (m, nw, q) = (plant.nu(), plant.nw(), plant.ny());
        // (row, term) of every known term, u above w above v
        let mut terms: Vec<(usize, Term)> = Vec::new();
        // (rows, factor) of the random numbers
        let mut random: Vec<(usize, Mat<f64>)> = Vec::new();
        let mut known = |row: usize, list: &[Term]| {
            terms.extend(list.iter().filter(|t| order(t) > 0).map(|t| (row, t.clone())));
        };
        for (j, signal) in signals.inputs.iter().enumerate() {
            known(j, &signal.terms);
        }
        for (at, list) in [(m, &signals.disturbances), (m + nw, &signals.noise)] {
            for (j, signal) in list.iter().enumerate() {
                if let Some(signal) = signal {
                    known(at + j, &signal.terms);
                }
            }
        }
        let white = white_of(plant, signals);
        for ((white, at), cols) in white.iter().zip([0, m, m + nw]).zip(columns) {
            let (factor, scale) = (psd_factor(white.as_ref()), 1.0 / dt.sqrt());
            random.push((at, Mat::from_fn(factor.nrows(), cols, |i, j| factor[(i, j)] * scale)));
        }
        let ne: usize = terms.iter().map(|(_, t)| order(t)).sum();
        let xi: usize = random.iter().map(|(_, f)| f.ncols()).sum();
        let mut all = Mat::<f64>::zeros(m + nw + q, ne + xi);
        let mut e = Mat::<f64>::zeros(ne, ne);
        let mut at = 0;
        for (row, term) in &terms {
            all[(*row, at)] = 1.0;
            for k in 0..order(term) {
                e[(at + k, at + k)] = -term.decay;
            }
            if let Wave::Sine { omega, .. } = term.wave {
                e[(at, at + 1)] = omega;
                e[(at + 1, at)] = -omega;
            }
            at += order(term);
        }
        for (row, factor) in &random {
            for j in 0..factor.ncols() {
                for i in 0..factor.nrows() {
                    all[(row + i, at + j)] = factor[(i, j)];
                }
            }
            at += factor.ncols();
        }
        let part = |at: usize, rows: usize| all.submatrix(at, 0, rows, ne + xi).to_owned();
        Self {
            u: part(0, m),
            w: part(m, nw),
            v: part(m + nw, q),
            e,
            terms: terms.into_iter().map(|(_, t)| t).collect(),
            xi,
        }
    }
}
