//! What a part is a part of.

use serde::{Deserialize, Serialize};

/// The study of a part, as each part tells it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Identity {
    /// Version of the program.
    pub version: String,
    /// SHA-256 of the scenario's bytes, in hexadecimal.
    pub scenario: String,
    /// Seed of the scenario's random numbers, if it has one.
    pub seed: Option<u64>,
    /// Parameters of the grid, and how many values each has.
    pub grid: Vec<(String, usize)>,
    /// Models in the bank.
    pub models: usize,
    /// Actuator delays in seconds.
    pub delays: Vec<f64>,
    /// Plants of a block, at most.
    pub block: usize,
    /// Blocks of the grid.
    pub blocks: usize,
    /// Whether only plants near boundaries were computed.
    pub refine: bool,
}

impl Identity {
    /// In what `other` differs from this one; `None` if they are the same.
    pub fn difference(&self, other: &Self) -> Option<String> {
        let mut found = Vec::new();
        let mut compare = |what: &str, wanted: String, got: String| {
            if wanted != got {
                found.push(format!("its {what} is {got}, not {wanted}"));
            }
        };
        let seed = |i: &Self| i.seed.map_or("none".into(), |seed| seed.to_string());
        let scenario = |i: &Self| i.scenario.chars().take(12).collect::<String>();
        let grid = |i: &Self| {
            let axes: Vec<String> = i.grid.iter().map(|(n, len)| format!("{n} x {len}")).collect();
            axes.join(", ")
        };
        compare("version", self.version.clone(), other.version.clone());
        compare("scenario (SHA-256)", scenario(self), scenario(other));
        compare("seed", seed(self), seed(other));
        compare("grid", grid(self), grid(other));
        compare("number of models", self.models.to_string(), other.models.to_string());
        compare("delays", format!("{:?}", self.delays), format!("{:?}", other.delays));
        compare("block size", self.block.to_string(), other.block.to_string());
        compare("number of blocks", self.blocks.to_string(), other.blocks.to_string());
        compare("refinement", self.refine.to_string(), other.refine.to_string());
        if found.is_empty() && self != other {
            found.push("its description is another".into());
        }
        (!found.is_empty()).then(|| found.join("; "))
    }
}
