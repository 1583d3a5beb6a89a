//! Many observers along many records: for sweeps of gains and forgetting.

use super::course::{Courses, Plan};
use super::plant::{Settings, Structure, Tuning};
use crate::error::{Error, Result};
use crate::model::check_signals;
use crate::par::RunControl;

/// Recorded signals of one length, arrays in C order.
#[derive(Debug, Clone, Copy, Default)]
pub struct Records<'a> {
    /// How many records.
    pub records: usize,
    /// Samples of each, at least one.
    pub samples: usize,
    /// Outputs, shape (record, sample, output); NaN for what is missing.
    pub y: &'a [f64],
    /// Inputs, shape (record, sample, input), or (sample, input) if all records have the
    /// same.
    pub u: &'a [f64],
    /// Sampling intervals since the sample before, one a sample; empty for one each. What
    /// lies between is missing.
    pub intervals: &'a [u64],
    /// Samples, from 0 and rising, after which is reported.
    pub reports: &'a [usize],
}

/// Runs every tuning along every record, each from its start.
///
/// ```text
/// course (i, j) = Adaptive of tuning i alone, shown record j sample by sample
/// ```
/// A course has the same bits in any company and for any number of threads. `tolerance` is
/// the relative drift of a parameter up to which it counts as settled.
///
/// ```
/// use std::sync::Arc;
/// use mmae::adaptive::{FnRegressor, Prior, Records, Settings, Structure, Tuning, Unknown, run_records};
/// use mmae::{mat, par::RunControl};
/// // x' = -x + b u, b = 2 unknown, u = 1, x measured without noise
/// let structure = Structure {
///     states: vec!["x".into()],
///     outputs: vec!["x".into()],
///     inputs: 1,
///     unknown: vec![Unknown::given("b")],
///     regressor: Arc::new(FnRegressor::new(1, |_, u, _, gamma, _| gamma[0] = u[0])),
/// };
/// let tuning = |k: f64| {
///     Tuning::new(mat![[-1.0]], mat![[1.0]], mat![[k]], vec![0.0], Prior::uniform(1e6, 1))
/// };
/// let y: Vec<f64> = (0..500).map(|k| 2.0 - 2.0 * (-0.01 * f64::from(k)).exp()).collect();
/// let u = vec![1.0; 500];
/// let records =
///     Records { records: 1, samples: 500, y: &y, u: &u, intervals: &[], reports: &[99, 499] };
/// // three gains, of which the last makes the observer unstable
/// let gains = [tuning(1.0), tuning(4.0), tuning(-2.0)];
/// let all = run_records(&structure, &Settings::new(0.01), &gains, &records, 0.02, &RunControl::default())?;
/// assert!((all.theta[1] - 2.0).abs() < 1e-4 && (all.theta[3] - 2.0).abs() < 1e-4);
/// assert!(all.failures[2].is_some() && all.theta[4].is_nan());
/// # Ok::<(), mmae::Error>(())
/// ```
///
/// # Errors
/// `Shape`; `Empty` without samples; `NonFinite` for an infinite output or an input that
/// is no number; `Range` for reports that do not rise or are past the end; `Limit` for
/// courses of more than a gigabyte; as [`Adaptive::new`](super::Adaptive::new) where no
/// tuning can be used; `Cancelled`.
pub fn run_records(
    structure: &Structure,
    settings: &Settings,
    tunings: &[Tuning],
    records: &Records<'_>,
    tolerance: f64,
    control: &RunControl<'_>,
) -> Result<Courses> {
    let [_, m, q, _] = structure.sizes();
    records.check(m, q)?;
    let (samples, shared) = (records.samples, records.u.len() == records.samples * m);
    let plan = Plan {
        structure,
        settings,
        tunings,
        sources: records.records,
        samples,
        intervals: records.intervals,
        reports: records.reports,
        tolerance,
    };
    plan.run(control, |sources| {
        move |k: usize, u: &mut [f64], y: &mut [f64]| {
            for (l, record) in sources.clone().enumerate() {
                let row = record * samples + k;
                y[l * q..][..q].copy_from_slice(&records.y[row * q..][..q]);
                let row = if shared { k } else { row };
                u[l * m..][..m].copy_from_slice(&records.u[row * m..][..m]);
            }
        }
    })
}

impl Records<'_> {
    fn check(&self, m: usize, q: usize) -> Result<()> {
        if self.samples == 0 || self.records == 0 {
            return Err(Error::Empty { what: "the record".into() });
        }
        let rows = self.records * self.samples;
        let shape = |what: &str, want, got| Err(Error::Shape { what: what.into(), want, got });
        if self.y.len() != rows * q {
            return shape("y of the records", [rows, q], [1, self.y.len()]);
        }
        if self.u.len() != rows * m && self.u.len() != self.samples * m {
            return shape("u of the records", [rows, m], [1, self.u.len()]);
        }
        if !(self.intervals.is_empty() || self.intervals.len() == self.samples) {
            return shape("intervals", [self.samples, 1], [self.intervals.len(), 1]);
        }
        check_signals(self.y, self.u, self.samples, [m, q])
    }
}
