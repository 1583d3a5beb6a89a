//! What a bank said along a record, for pictures.

/// Weights and parameter estimates at reported times.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Timeline {
    /// Title of the scenario, or of the run.
    pub title: String,
    /// What was run, in a line.
    pub subtitle: String,
    /// Name of the time axis.
    pub time: String,
    /// Reported times, increasing.
    pub t: Vec<f64>,
    /// One label a model.
    pub labels: Vec<String>,
    /// Weights, one curve a model.
    pub p: Vec<Vec<f64>>,
    /// Standard deviation of each weight over trials; empty for one record.
    pub spread: Vec<Vec<f64>>,
    /// Parameters in which the models differ.
    pub parameters: Vec<Track>,
}

/// A parameter along the record.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Track {
    /// Its name.
    pub name: String,
    /// Mean over the weights at each time.
    pub mean: Vec<f64>,
    /// Value of each model.
    pub models: Vec<f64>,
    /// The true value at each time, where it is known.
    pub truth: Option<Vec<f64>>,
}
