//! Where the numbers of eight observers lie: one block an entry.

use std::ops::Range;

use super::plant::{Reading, Settings, Structure, Tuning};
use super::regressor::Column;

/// How the regressor of a parameter is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Kind {
    /// `E_row` times output `output`, which is state `col` but for a factor.
    Measured { row: usize, col: usize, output: usize },
    /// `E_row x_hat_col`.
    Estimated { row: usize, col: usize },
    /// A given column.
    Given(usize),
}

impl Kind {
    /// Numbers of the sample before that are kept of the regressor: that of an estimated
    /// state is in `x_hat`.
    pub(super) fn kept(self, n: usize) -> usize {
        match self {
            Kind::Measured { .. } => 1,
            Kind::Estimated { .. } => 0,
            Kind::Given(_) => n,
        }
    }
}

/// Sizes and offsets, in blocks.
#[derive(Debug, Clone)]
pub(super) struct Layout {
    pub(super) n: usize,
    pub(super) m: usize,
    pub(super) q: usize,
    /// Parameters, and before them in all arrays those of `x(0)`.
    pub(super) p: usize,
    pub(super) x0: usize,
    pub(super) given: usize,
    pub(super) kinds: Vec<Kind>,
    pub(super) reading: Reading,
    // what stays
    pub(super) phi: Range<usize>,
    pub(super) g0: Range<usize>,
    pub(super) g1: Range<usize>,
    pub(super) c: Range<usize>,
    pub(super) k: Range<usize>,
    /// Factor from the output to the state, a parameter.
    pub(super) factor: Range<usize>,
    /// `R_j / w`.
    pub(super) r: Range<usize>,
    /// `mu`, `sqrt(mu)` and the cap of the trace.
    pub(super) rates: Range<usize>,
    pub(super) low: Range<usize>,
    pub(super) high: Range<usize>,
    pub(super) fixed: usize,
    // what moves
    pub(super) psi: Range<usize>,
    pub(super) psi_0: Range<usize>,
    pub(super) x_hat: Range<usize>,
    /// Regressors of the sample before, see [`Kind::kept`].
    pub(super) g: Range<usize>,
    /// Input of `psi_0` of the sample before.
    pub(super) known: Range<usize>,
    pub(super) theta: Range<usize>,
    pub(super) ud: Range<usize>,
    /// Sum of `phi' phi` over the window, over the parameters.
    pub(super) gram: Range<usize>,
    /// Sum of `e_j^2 / R_j` and number of outputs over the window.
    pub(super) sums: Range<usize>,
    /// A priori residuals of the last sample.
    pub(super) e: Range<usize>,
    pub(super) state: usize,
    // what comes with a sample
    pub(super) gamma: Range<usize>,
    pub(super) term: Range<usize>,
    pub(super) y: Range<usize>,
    /// 1 for an output that is present, else 0.
    pub(super) present: Range<usize>,
    pub(super) sample: usize,
    pub(super) scratch: usize,
}

/// Cuts lengths off one after the other.
struct Cut(usize);

impl Cut {
    fn next(&mut self, len: usize) -> Range<usize> {
        let from = self.0;
        self.0 += len;
        from..self.0
    }
}

impl Layout {
    pub(super) fn new(structure: &Structure, settings: &Settings, kinds: Vec<Kind>) -> Self {
        let [n, m, q, p] = structure.sizes();
        let x0 = if settings.initial_state { n } else { 0 };
        let all = x0 + p;
        let given = structure.regressor.columns();
        let (mut fixed, mut state, mut sample) = (Cut(0), Cut(0), Cut(0));
        let before = kinds.iter().map(|kind| kind.kept(n)).sum();
        let mut layout = Self {
            n,
            m,
            q,
            p,
            x0,
            given,
            kinds,
            reading: settings.reading,
            phi: fixed.next(n * n),
            g0: fixed.next(n * n),
            g1: fixed.next(n * n),
            c: fixed.next(q * n),
            k: fixed.next(n * q),
            factor: fixed.next(p),
            r: fixed.next(q),
            rates: fixed.next(3),
            low: fixed.next(p),
            high: fixed.next(p),
            fixed: 0,
            psi: state.next(all * n),
            psi_0: state.next(n),
            x_hat: state.next(n),
            g: state.next(before),
            known: state.next(n),
            theta: state.next(all),
            ud: state.next(all * all),
            gram: state.next(p * p),
            sums: state.next(2),
            e: state.next(q),
            state: 0,
            gamma: sample.next(given * n),
            term: sample.next(n),
            y: sample.next(q),
            present: sample.next(q),
            sample: 0,
            scratch: all * (super::ud::SCRATCH + 2) + 4 * n,
        };
        (layout.fixed, layout.state, layout.sample) = (fixed.0, state.0, sample.0);
        layout
    }

    /// All parameters, those of `x(0)` included.
    pub(super) fn all(&self) -> usize {
        self.x0 + self.p
    }
}

/// How each regressor is made: entries of `A` take a measured state where an output
/// is a multiple of that state alone.
pub(super) fn kinds(structure: &Structure, tuning: &Tuning) -> Vec<Kind> {
    let [n, _, q, _] = structure.sizes();
    let alone = |j: usize, col: usize| (0..n).all(|i| (i == col) == (tuning.C[(j, i)] != 0.0));
    let mut given = 0;
    let mut kind = |column: Column| match column {
        Column::Entry { row, col } => match (0..q).find(|&j| alone(j, col)) {
            Some(output) => Kind::Measured { row, col, output },
            None => Kind::Estimated { row, col },
        },
        Column::Given => {
            given += 1;
            Kind::Given(given - 1)
        }
    };
    structure.unknown.iter().map(|u| kind(u.column)).collect()
}
