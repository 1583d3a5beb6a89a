//! Steady-state design, many models at once.

use faer::Mat;

use crate::error::{Error, Result};
use crate::model::{Names, Plant};
use crate::observer::ObserverKind;
use crate::par::RunControl;
use crate::small::{Dyn, cholesky, cholesky_solve, solve as lu};
use crate::solve::{
    Checks, ItemReport, Region, Riccati, Solutions, care_with, dare_with, unseen_mode,
};

/// A steady-state observer for one design model.
#[derive(Debug, Clone, PartialEq)]
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub struct Observer {
    /// Which one.
    pub kind: ObserverKind,
    /// The model it was designed for.
    pub plant: Plant,
    /// Error covariance, nx by nx: of the prediction `xhat(k|k-1)` in discrete
    /// time. For a Krener observer the solution of the same equation.
    pub P: Mat<f64>,
    /// Gain of the observer's equation, nx by ny: `P C' R^-1`, or the predictor
    /// gain `A P C' S^-1` in discrete time.
    pub L: Mat<f64>,
    /// Gain of the measurement update, nx by ny: `P C' S^-1` in discrete time,
    /// equal to `L` in continuous time.
    pub K: Mat<f64>,
    /// Intensity (covariance) of the innovation, ny by ny: `R` in continuous
    /// time, `C P C' + R` in discrete time.
    pub S: Mat<f64>,
    /// How well the Riccati equation was solved; its margin is that of
    /// `A - L C`.
    pub report: ItemReport,
}

/// Designs the observer `kind` for every model.
///
/// ```text
/// continuous   A P + P A' - P C' R^-1 C P + G Q G' = 0
/// discrete     A P A' - P - A P C' (C P C' + R)^-1 C P A' + G Q G' = 0
/// ```
///
/// A model that fails leaves the others alone. Models of different sizes may be
/// mixed.
///
/// # Source
/// Kalman, Bucy (1961), J. Basic Eng. 83, 95-108; Krener (1980), J. Differential
/// Equations 35, 1-21; Kalman (1960), J. Basic Eng. 82, 35-45.
///
/// # Errors
/// One result a model: what [`Plant::check`] finds; `Conflict` for a model of the
/// other time; `Undetectable` for a mode that does not decay and that the output
/// does not see; `Unstabilizable` for a mode on the boundary of stability that
/// the disturbance does not reach; `NoStabilizingSolution` otherwise.
///
/// # Examples
/// ```
/// use mmae::{mat, Mat, model::{Plant, Time}, observer::{design, ObserverKind}};
/// // A random walk x' = w seen as y = x + v: P = sqrt(q r)
/// let walk = Plant {
///     time: Time::Continuous,
///     A: mat![[0.0]], B: Mat::zeros(1, 0), G: mat![[1.0]], C: mat![[1.0]],
///     Q: mat![[4.0]], R: mat![[9.0]],
/// };
/// let observers = design(ObserverKind::KalmanBucy, &[walk]);
/// let observer = observers[0].as_ref().map_err(Clone::clone)?;
/// assert!((observer.P[(0, 0)] - 6.0).abs() < 1e-14);
/// assert!((observer.L[(0, 0)] - 6.0 / 9.0).abs() < 1e-15);
/// # Ok::<(), mmae::Error>(())
/// ```
pub fn design(kind: ObserverKind, models: &[Plant]) -> Vec<Result<Observer>> {
    // Without a flag to cancel there is no error of the whole.
    design_with(kind, models, None, &RunControl::default())
        .unwrap_or_else(|error| models.iter().map(|_| Err(error.clone())).collect())
}

/// As [`design`], with the names of the states for messages, and with threads,
/// progress and cancelling.
///
/// # Errors
/// `Cancelled`; the results of the models as in [`design`].
pub fn design_with(
    kind: ObserverKind,
    models: &[Plant],
    names: Option<&Names>,
    control: &RunControl<'_>,
) -> Result<Vec<Result<Observer>>> {
    let mut results: Vec<Option<Result<Observer>>> =
        models.iter().map(|model| check(kind, model).err().map(Err)).collect();
    // Models of one size form one batch, in order of appearance.
    while let Some(first) = results.iter().position(Option::is_none) {
        let size = |k: usize| (models[k].nx(), models[k].ny());
        let group: Vec<usize> = (first..models.len())
            .filter(|&k| results[k].is_none() && size(k) == size(first))
            .collect();
        let solutions = solve(kind, models, &group, control)?;
        for (item, &k) in group.iter().enumerate() {
            results[k] = Some(finish(kind, &models[k], &solutions, item, names));
        }
    }
    Ok(results.into_iter().flatten().collect())
}

/// What can be said before solving.
fn check(kind: ObserverKind, model: &Plant) -> Result<()> {
    model.check()?;
    if model.time.is_continuous() == kind.is_continuous() {
        return Ok(());
    }
    let (is, wanted) =
        if kind.is_continuous() { ("discrete", "continuous") } else { ("continuous", "discrete") };
    Err(Error::Conflict {
        problem: format!("a {} was asked for a {is}-time model", kind.name()),
        remedy: format!("give a {wanted}-time model, or choose another observer"),
    })
}

/// `G Q G'`, exactly symmetric.
fn disturbance(model: &Plant) -> Mat<f64> {
    let product = product(&product(&model.G, &model.Q), &model.G.transpose().to_owned());
    symmetric(&product)
}

/// `(X + X')/2`.
fn symmetric(x: &Mat<f64>) -> Mat<f64> {
    Mat::from_fn(x.nrows(), x.ncols(), |i, j| 0.5 * x[(i, j)] + 0.5 * x[(j, i)])
}

/// `X Y`, one chain of fused multiply-adds an entry: the same bits on any CPU.
fn product(x: &Mat<f64>, y: &Mat<f64>) -> Mat<f64> {
    Mat::from_fn(x.nrows(), y.ncols(), |i, j| {
        (0..x.ncols()).fold(0.0, |sum, k| x[(i, k)].mul_add(y[(k, j)], sum))
    })
}

/// `X S^-1`, `S` symmetric: by Cholesky, or by LU for an `S` that is not quite
/// definite; `None` if it is singular.
fn right_divide(x: &Mat<f64>, s: &Mat<f64>) -> Option<Mat<f64>> {
    let (n, m) = (x.nrows(), s.nrows());
    let entries = || (0..m * m).map(|e| s[(e / m, e % m)]).collect::<Vec<_>>();
    let mut factor = entries();
    let mut k: Vec<f64> = (0..m * n).map(|e| x[(e % n, e / n)]).collect();
    if cholesky(Dyn(m), &mut factor) {
        cholesky_solve(Dyn(m), Dyn(n), &factor, &mut k);
    } else if !lu(Dyn(m), Dyn(n), &mut entries(), &mut k, &mut vec![0.0; m]).ok {
        return None;
    }
    k.iter().all(|v| v.is_finite()).then(|| Mat::from_fn(n, m, |i, j| k[j * n + i]))
}

/// Solves the Riccati equations of the models `group`, all of one size.
fn solve(
    kind: ObserverKind,
    models: &[Plant],
    group: &[usize],
    control: &RunControl<'_>,
) -> Result<Solutions> {
    let collect = |part: &dyn Fn(&Plant) -> Mat<f64>| -> Vec<f64> {
        let rows = |x: Mat<f64>| -> Vec<f64> {
            (0..x.nrows() * x.ncols()).map(|e| x[(e / x.ncols(), e % x.ncols())]).collect()
        };
        group.iter().flat_map(|&k| rows(part(&models[k]))).collect()
    };
    let [a, b, q, r] = [
        collect(&|model| model.A.transpose().to_owned()),
        collect(&|model| model.C.transpose().to_owned()),
        collect(&disturbance),
        collect(&|model| model.R.clone()),
    ];
    let model = &models[group[0]];
    let (n, m, len) = (model.nx(), model.ny(), group.len());
    let problem = Riccati { n, m, len, A: &a, B: &b, Q: &q, R: &r, S: None };
    if kind.is_continuous() {
        care_with(&problem, Checks::All, control)
    } else {
        dare_with(&problem, Checks::All, control)
    }
}

/// The observer of item `item`, or why there is none.
#[expect(non_snake_case, reason = "capital letters are matrices")]
fn finish(
    kind: ObserverKind,
    model: &Plant,
    solutions: &Solutions,
    item: usize,
    names: Option<&Names>,
) -> Result<Observer> {
    let P = match solutions.matrix(item) {
        Ok(p) => p,
        Err(error) => return Err(explain(kind, model, error, names)),
    };
    let PCt = product(&P, &model.C.transpose().to_owned());
    let S = match kind {
        ObserverKind::Kalman => symmetric(&(product(&model.C, &PCt) + &model.R)),
        ObserverKind::KalmanBucy | ObserverKind::Krener => symmetric(&model.R),
    };
    let K = right_divide(&PCt, &S).ok_or_else(|| Error::NotPositiveDefinite {
        what: if kind.is_continuous() { "R" } else { "S = C P C' + R" }.into(),
    })?;
    let L = if kind.is_continuous() { K.clone() } else { product(&model.A, &K) };
    let report = solutions.items[item].clone();
    Ok(Observer { kind, plant: model.clone(), P, L, K, S, report })
}

/// Names the mode that stands in the way of a stabilizing solution, if one does.
fn explain(kind: ObserverKind, model: &Plant, error: Error, names: Option<&Names>) -> Error {
    let (residual, iterations) = match error {
        Error::NoStabilizingSolution { residual, iterations, .. } => (residual, iterations),
        // The same reason in the words of a filter.
        Error::NotStabilizable { .. } | Error::NotDetectable { .. } => (f64::NAN, 0),
        _ => return error,
    };
    let continuous = kind.is_continuous();
    let names = names.map(|names| &names.states[..]);
    let unseen = unseen_mode(model.A.as_ref(), model.C.as_ref(), continuous, Region::Unstable);
    if let Ok(Some(mode)) = unseen {
        let states = mode.states(names);
        return Error::Undetectable { eigenvalue: mode.eigenvalue, states };
    }
    // Unstable modes without noise are stabilized all the same, unless they are
    // on the boundary.
    let noise = product(&model.G, &model.Q);
    let unreached =
        unseen_mode(model.A.transpose(), noise.transpose(), continuous, Region::Boundary);
    if let Ok(Some(mode)) = unreached {
        let states = mode.states(names);
        return Error::Unstabilizable { eigenvalue: mode.eigenvalue, states };
    }
    if !matches!(error, Error::NoStabilizingSolution { .. }) {
        return error;
    }
    let what = format!("{} (Riccati equation)", kind.name());
    Error::NoStabilizingSolution { what, residual, iterations }
}
