//! What is tested when a batch is built.

use faer::Mat;

use super::identify::{self, Identifiability};
use super::layout::kinds;
use super::plant::{Settings, Structure, Tuning};
use super::scheme::closed;
use crate::error::{Error, Result};
use crate::solve::{Region, least_stable_mode, unseen_mode};

/// Why each item cannot be used.
pub(super) fn all(
    structure: &Structure,
    settings: &Settings,
    tunings: &[Tuning],
) -> Vec<Option<Error>> {
    let mut pattern = None;
    let mut failures: Vec<Option<Error>> = Vec::with_capacity(tunings.len());
    for (i, tuning) in tunings.iter().enumerate() {
        // trials share their plant: what is known of it is not asked again
        let known = i > 0 && alike(tuning, &tunings[i - 1]);
        let tested = tuning.check(structure, settings).and_then(|()| {
            let kinds = kinds(structure, tuning);
            if *pattern.get_or_insert_with(|| kinds.clone()) != kinds {
                return Err(Error::Conflict {
                    problem: "C measures other states than in the first item".into(),
                    remedy: "put plants that are measured differently into batches of their own"
                        .into(),
                });
            }
            match known {
                true => failures[i - 1].clone().map_or(Ok(()), Err),
                false if settings.rank_test => {
                    one(structure, tuning).and_then(|()| identifiable(structure, tuning))
                }
                false => one(structure, tuning),
            }
        });
        failures.push(tested.err());
    }
    failures
}

/// True if the same is known of both.
pub(super) fn alike(a: &Tuning, b: &Tuning) -> bool {
    a.A == b.A && a.C == b.C && a.K == b.K && a.theta == b.theta && a.x_hat == b.x_hat
}

/// Observability, and stability of the observer.
fn one(structure: &Structure, tuning: &Tuning) -> Result<()> {
    let unseen = unseen_mode(tuning.A.as_ref(), tuning.C.as_ref(), true, Region::Everywhere)?;
    if let Some(mode) = unseen {
        let states = mode.states(Some(&structure.states));
        return Err(Error::NotObservable { eigenvalue: mode.eigenvalue, states });
    }
    let n = tuning.A.nrows();
    let worst = |gain: f64| {
        let turned = Tuning {
            K: Mat::from_fn(n, tuning.K.ncols(), |i, j| gain * tuning.K[(i, j)]),
            ..tuning.clone()
        };
        let a = closed(&turned);
        least_stable_mode(Mat::from_fn(n, n, |i, j| a[i * n + j]).as_ref(), true)
    };
    let mode = worst(1.0)?;
    // false for NaN as well
    let decays = mode.eigenvalue.re < 0.0;
    if !decays {
        let opposite = worst(-1.0)?.eigenvalue.re < 0.0;
        return Err(Error::ObserverUnstable { eigenvalue: mode.eigenvalue, opposite });
    }
    Ok(())
}

fn identifiable(structure: &Structure, tuning: &Tuning) -> Result<()> {
    verdict(&identify::identifiability(structure, tuning)?).map_or(Ok(()), Err)
}

/// The error that a rank test means.
pub(super) fn verdict(found: &Identifiability) -> Option<Error> {
    (found.rank < found.parameters).then(|| Error::NotIdentifiable {
        rank: found.rank,
        parameters: found.parameters,
        directions: found.words.join("; "),
    })
}
