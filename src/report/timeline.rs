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
    /// Weights, one curve a model: of a record, or medians over trials.
    pub p: Vec<Vec<f64>>,
    /// Quantiles of each weight over trials; empty for one record.
    pub bands: Vec<Bands>,
    /// Parameters in which the models differ.
    pub parameters: Vec<Track>,
}

/// A parameter along the record.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Track {
    /// Its name.
    pub name: String,
    /// Mean over the weights at each time; of trials the median.
    pub mean: Vec<f64>,
    /// Its quantiles over trials, or nothing.
    pub bands: Bands,
    /// Value of each model.
    pub models: Vec<f64>,
    /// Values where another model begins to win (equivalently identified plants),
    /// where they are known.
    pub boundaries: Vec<f64>,
    /// The true value at each time, where it is known.
    pub truth: Option<Vec<f64>>,
}

/// Quantiles over trials along time: 5, 25, 75 and 95 %.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Bands(pub [Vec<f64>; 4]);

impl Bands {
    /// From quantiles at 5, 25, 50, 75 and 95 % for each time.
    pub fn of<'a>(quantiles: impl IntoIterator<Item = &'a [f64; 5]>) -> Self {
        let mut bands = Self::default();
        for row in quantiles {
            for (band, k) in bands.0.iter_mut().zip([0, 1, 3, 4]) {
                band.push(row[k]);
            }
        }
        bands
    }
}

/// Panels below each other over one time axis.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Stack {
    /// Title of the scenario, or of the run.
    pub title: String,
    /// What is shown, in a line.
    pub subtitle: String,
    /// Name of the time axis.
    pub time: String,
    /// Times, increasing.
    pub t: Vec<f64>,
    /// What the marks mean, once for all panels.
    pub key: Vec<(Layer, String)>,
    /// The panels from above.
    pub panels: Vec<Panel>,
}

/// A quantity along time.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Panel {
    /// Name of the vertical axis.
    pub name: String,
    /// What is drawn, the first at the back.
    pub layers: Vec<Layer>,
}

/// A mark along time; numbers that are not finite leave a gap. In a key the
/// numbers do not matter.
#[derive(Debug, Clone, PartialEq)]
pub enum Layer {
    /// A pale band between two curves.
    Wide(Vec<f64>, Vec<f64>),
    /// A stronger band.
    Narrow(Vec<f64>, Vec<f64>),
    /// What is really there.
    Truth(Vec<f64>),
    /// What is estimated.
    Estimate(Vec<f64>),
    /// What is measured, as dots.
    Dots(Vec<f64>),
    /// A dashed line at a value.
    Level(f64),
}
