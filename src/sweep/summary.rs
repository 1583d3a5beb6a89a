//! What came of the plants of a part, in numbers that add up.

use serde::{Deserialize, Serialize};

use crate::eip::{Block, Case};

/// Counts of one case (delay), of a block or of many.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Summary {
    /// Actuator delay in seconds.
    pub delay: f64,
    /// Plants.
    pub plants: usize,
    /// Plants that were computed; the others were inferred from their
    /// neighbours.
    pub computed: usize,
    /// Pairs of plant and model, and those of them that were computed.
    pub pairs: usize,
    /// Pairs of plants that were computed.
    pub computed_pairs: usize,
    /// How many plants each model wins.
    pub winners: Vec<usize>,
    /// Plants whose loop is unstable.
    pub unstable: usize,
    /// Plants that cannot be built.
    pub failed: usize,
    /// Plants whose winner is withheld.
    pub undecided: usize,
    /// Pairs for which both routes gave a number.
    pub checked_pairs: usize,
    /// Pairs whose Upsilon is the frequency integral's.
    pub replaced: usize,
    /// Largest relative difference of the two routes.
    pub route_difference: f64,
}

impl Summary {
    /// Of the cases of `block`, with `models` models.
    pub(crate) fn of(block: &Block, models: usize) -> Vec<Self> {
        let one = |(case, computed): (&Case, &Vec<bool>)| {
            let mut winners = vec![0; models];
            for &w in case.winner.iter().flatten() {
                winners[w] += 1;
            }
            let (plants, computed) =
                (case.winner.len(), computed.iter().filter(|&&done| done).count());
            Self {
                delay: case.delay,
                plants,
                computed,
                pairs: plants * models,
                computed_pairs: computed * models,
                winners,
                unstable: case.unstable.len(),
                failed: case.failed.len(),
                undecided: case.undecided.len(),
                checked_pairs: case.checked_pairs,
                replaced: case.replaced,
                route_difference: case.route_difference,
            }
        };
        block.cases.iter().zip(&block.computed).map(one).collect()
    }

    /// Adds the counts of other plants.
    pub(crate) fn add(&mut self, other: &Self) {
        self.plants += other.plants;
        self.computed += other.computed;
        self.pairs += other.pairs;
        self.computed_pairs += other.computed_pairs;
        for (sum, n) in self.winners.iter_mut().zip(&other.winners) {
            *sum += n;
        }
        self.unstable += other.unstable;
        self.failed += other.failed;
        self.undecided += other.undecided;
        self.checked_pairs += other.checked_pairs;
        self.replaced += other.replaced;
        self.route_difference = self.route_difference.max(other.route_difference);
    }
}
