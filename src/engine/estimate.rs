//! What the bank says after a measurement.

/// Weights and fused estimate.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Estimate {
    /// Measurements taken in.
    pub step: u64,
    /// Weights, of sum one; zero for a member that failed.
    pub p: Vec<f64>,
    /// Their logarithms.
    pub log_p: Vec<f64>,
    /// `x_hat = sum p_i x_i`.
    pub x_hat: Vec<f64>,
    /// The model of largest weight, the first of equals.
    pub best: Option<usize>,
    /// Effective number of models, `1 / sum p_i^2`.
    pub n_eff: f64,
    /// `ln sum p_i N(y; ..)` with the weights before this measurement, for laws
    /// that work with likelihoods; NaN for the others.
    pub log_lik: f64,
    /// Log-likelihood of the record so far, one a model.
    pub log_lik_models: Vec<f64>,
    /// Normalised innovation squared of each member.
    pub nis: Vec<f64>,
    /// Innovation of each member, shape (model, output).
    pub r: Vec<f64>,
    /// Members that cannot be used any more: not designed, or diverged.
    pub failed: Vec<bool>,
    /// False if no model could explain the last measurement, which then left the
    /// weights as they were.
    pub explained: bool,
}

impl Estimate {
    pub(super) fn new(models: usize, n: usize, q: usize) -> Self {
        Self {
            step: 0,
            p: vec![0.0; models],
            log_p: vec![f64::NEG_INFINITY; models],
            x_hat: vec![0.0; n],
            best: None,
            n_eff: f64::NAN,
            log_lik: f64::NAN,
            log_lik_models: vec![0.0; models],
            nis: vec![f64::NAN; models],
            r: vec![f64::NAN; models * q],
            failed: vec![false; models],
            explained: true,
        }
    }

    /// `sum p_i values_i`, for parameter values of the models.
    ///
    /// ```text
    /// theta_hat = sum p_i theta_i
    /// ```
    /// # Source
    /// Aguiar et al. (2007), (12).
    ///
    /// # Panics
    /// Unless there is a value a model.
    pub fn mean(&self, values: &[f64]) -> f64 {
        assert_eq!(values.len(), self.p.len(), "one value a model");
        self.p.iter().zip(values).filter(|(p, _)| **p > 0.0).map(|(p, v)| p * v).sum()
    }
}
