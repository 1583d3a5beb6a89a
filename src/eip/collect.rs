//! What a result says of each plant.

use crate::eip::engine::Flaw;
use crate::eip::judge::{Judge, Judged, Judgement};
use crate::eip::sets::{self, Verdict};
use crate::eip::{Case, Doubt, Failed, Undecided, Unstable};
use crate::error::Result;
use crate::par::{RunControl, map_chunks};

/// Plants of one chunk: about a millisecond of comparisons with many models.
const CHUNK: usize = 1024;

/// A plant of a grid.
pub(crate) enum Seen {
    /// Computed.
    Judged(Judged),
    /// The model of this index wins, as its neighbours say.
    Inferred(usize),
}

/// A run of plants of the grid; Upsilon plants by models, NaN where there is none.
pub(crate) struct All {
    pub(crate) upsilon: Vec<f64>,
    pub(crate) seen: Vec<Seen>,
}

impl From<Judgement> for All {
    fn from(judgement: Judgement) -> Self {
        let Judgement { upsilon, plants } = judgement;
        All { upsilon, seen: plants.into_iter().map(Seen::Judged).collect() }
    }
}

/// What is known of a run of plants of the grid.
pub(crate) struct Plants {
    models: usize,
    pub(crate) verdict: Vec<Verdict>,
    /// Plants whose Upsilon is the frequency integral's.
    pub(crate) by_frequency: Vec<bool>,
    /// Plants by models.
    pub(crate) upsilon: Vec<f64>,
    /// The same, or nothing where no error is known.
    pub(crate) error: Vec<f64>,
}

impl Plants {
    /// Upsilon of every model at plant `k`.
    pub(crate) fn row(&self, k: usize) -> &[f64] {
        &self.upsilon[k * self.models..(k + 1) * self.models]
    }
}

/// Gives the verdicts on the plants from plant `first` of the grid on. Upsilon and errors
/// are in the second value, not in the case.
///
/// # Errors
/// `Cancelled`.
pub(crate) fn collect(
    judge: &Judge<'_>,
    first: usize,
    all: All,
    control: &RunControl<'_>,
) -> Result<(Case, Plants)> {
    let (engine, same) = (&judge.engine, &judge.same);
    let (models, count) = (same.len(), all.seen.len());
    let rows = |k: usize| &all.upsilon[k * models..][..models];
    let one = |k: usize| match &all.seen[k] {
        Seen::Judged(Ok(facts)) => {
            let winner = sets::decide(rows(k), &facts.error, &engine.designed, same);
            let margin = winner.as_ref().map_or(f64::NAN, |&w| sets::margin(rows(k), w, same));
            Some((winner, margin))
        }
        _ => None,
    };
    let decided = map_chunks(control, count, CHUNK, |range| range.map(one).collect::<Vec<_>>())?;

    let mut case = Case::empty(engine.delay, count, models);
    let (mut verdicts, mut by_frequency) = (Vec::with_capacity(count), Vec::with_capacity(count));
    let mut error = Vec::new();
    for (k, (seen, decided)) in all.seen.into_iter().zip(decided.into_iter().flatten()).enumerate()
    {
        let plant = first + k;
        let values = || judge.point(plant);
        let mut replaced = 0;
        let (verdict, margin) = match (seen, decided) {
            (Seen::Inferred(winner), _) => (Verdict::Winner(winner), f64::NAN),
            (Seen::Judged(Ok(facts)), decided) => {
                if !facts.error.is_empty() {
                    error.resize(count * models, f64::NAN);
                    error[k * models..][..models].copy_from_slice(&facts.error);
                }
                case.route_difference = case.route_difference.max(facts.kept);
                case.checked_pairs += facts.compared;
                replaced = facts.replaced;
                match decided {
                    Some((Ok(winner), margin)) => (Verdict::Winner(winner), margin),
                    Some((Err(doubt), _)) => {
                        case.undecided.push(Undecided { plant, values: values(), doubt });
                        (Verdict::Undecided, f64::NAN)
                    }
                    None => (Verdict::Undecided, f64::NAN),
                }
            }
            (Seen::Judged(Err(flaw)), _) => (flawed(&mut case, judge, plant, flaw), f64::NAN),
        };
        case.replaced += replaced;
        case.margin.push(margin);
        case.winner.push(verdict.winner());
        verdicts.push(verdict);
        by_frequency.push(replaced > 0);
    }
    Ok((case, Plants { models, verdict: verdicts, by_frequency, upsilon: all.upsilon, error }))
}

/// Notes a plant without Upsilon.
fn flawed(case: &mut Case, judge: &Judge<'_>, plant: usize, flaw: Flaw) -> Verdict {
    let values = judge.point(plant);
    match flaw {
        Flaw::Unstable(mode) => {
            let states = mode.states(Some(&judge.engine.states));
            case.unstable.push(Unstable { plant, values, mode: mode.eigenvalue, states });
            Verdict::Unstable
        }
        Flaw::Unbuilt(error) => {
            case.failed.push(Failed { plant, values, error });
            Verdict::Failed
        }
        Flaw::Unknown => {
            let doubt = Doubt::NoNumber { models: judge.engine.designed.clone() };
            case.undecided.push(Undecided { plant, values, doubt });
            Verdict::Undecided
        }
    }
}
