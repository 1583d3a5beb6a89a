//! What a result says of each plant, one after the other.

use crate::eip::engine::Flaw;
use crate::eip::judge::{Checked, Judge, Judged};
use crate::eip::sets::{self, Verdict};
use crate::eip::{Case, Doubt, Failed, Undecided, Unstable};

/// What is known of a run of plants of the grid.
pub(crate) struct Plants {
    models: usize,
    pub(crate) verdict: Vec<Verdict>,
    /// Plants whose Upsilon is the frequency integral's.
    pub(crate) by_frequency: Vec<bool>,
    /// Plants by models.
    pub(crate) upsilon: Vec<f64>,
    pub(crate) error: Vec<f64>,
}

impl Plants {
    /// Upsilon of every model at plant `k`.
    pub(crate) fn row(&self, k: usize) -> &[f64] {
        &self.upsilon[k * self.models..(k + 1) * self.models]
    }
}

/// Takes plants in their order, gives verdicts.
pub(crate) struct Collector<'b, 'a> {
    judge: &'b Judge<'a>,
    /// Index of the next plant on the grid.
    next: usize,
    case: Case,
    plants: Plants,
}

impl<'b, 'a> Collector<'b, 'a> {
    /// For `count` plants from plant `first` of the grid on.
    pub(crate) fn new(judge: &'b Judge<'a>, first: usize, count: usize) -> Self {
        let models = judge.same.len();
        let plants = Plants {
            models,
            verdict: Vec::with_capacity(count),
            by_frequency: Vec::with_capacity(count),
            upsilon: Vec::with_capacity(count * models),
            error: Vec::with_capacity(count * models),
        };
        Self { judge, next: first, case: Case::empty(judge.engine.delay, count, models), plants }
    }

    /// Takes the next plant.
    pub(crate) fn push(&mut self, judged: Judged) {
        let (case, plant) = (&mut self.case, self.next);
        let (engine, same) = (&self.judge.engine, &self.judge.same);
        let values = || self.judge.point(plant);
        let undecided = |doubt| Undecided { plant, values: values(), doubt };
        let (checked, verdict) = match judged {
            Ok(checked) => {
                let decided = sets::decide(&checked.row, &checked.error, &engine.designed, same);
                let verdict = decided.map_or_else(
                    |doubt| {
                        case.undecided.push(undecided(doubt));
                        Verdict::Undecided
                    },
                    Verdict::Winner,
                );
                (checked, verdict)
            }
            Err(flaw) => {
                let verdict = match flaw {
                    Flaw::Unstable(mode) => {
                        let states = mode.states(Some(&engine.states));
                        let mode = mode.eigenvalue;
                        case.unstable.push(Unstable { plant, values: values(), mode, states });
                        Verdict::Unstable
                    }
                    Flaw::Unbuilt(error) => {
                        case.failed.push(Failed { plant, values: values(), error });
                        Verdict::Failed
                    }
                    Flaw::Unknown => {
                        let models = engine.designed.clone();
                        case.undecided.push(undecided(Doubt::NoNumber { models }));
                        Verdict::Undecided
                    }
                };
                (Checked::unchecked(vec![f64::NAN; same.len()]), verdict)
            }
        };
        let winner = verdict.winner();
        case.margin.push(winner.map_or(f64::NAN, |w| sets::margin(&checked.row, w, same)));
        case.route_difference = case.route_difference.max(checked.kept);
        case.checked_pairs += checked.compared;
        case.replaced += checked.replaced;
        self.add(checked, verdict);
    }

    /// Takes the next plant as one that `winner` wins, without numbers.
    pub(crate) fn infer(&mut self, winner: usize) {
        self.case.margin.push(f64::NAN);
        let row = vec![f64::NAN; self.judge.same.len()];
        self.add(Checked::unchecked(row), Verdict::Winner(winner));
    }

    fn add(&mut self, checked: Checked, verdict: Verdict) {
        self.case.winner.push(verdict.winner());
        self.plants.verdict.push(verdict);
        self.plants.by_frequency.push(checked.replaced > 0);
        self.plants.upsilon.extend_from_slice(&checked.row);
        self.plants.error.extend_from_slice(&checked.error);
        // where none are known
        self.plants.error.resize(self.plants.upsilon.len(), f64::NAN);
        self.next += 1;
    }

    /// The case, Upsilon and errors still in the second value.
    pub(crate) fn finish(self) -> (Case, Plants) {
        (self.case, self.plants)
    }
}
