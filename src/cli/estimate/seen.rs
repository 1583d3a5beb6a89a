//! What is gathered along a record.

use super::super::course::Course;
use crate::engine::Mmae;
use crate::sim::chi_square_band;

/// Sums over the samples, and their course for a picture.
#[derive(Debug, Default)]
pub(super) struct Seen {
    pub(super) course: Option<Course>,
    /// Normalised innovations squared of each model.
    nis: Vec<f64>,
    /// Outputs that were measured, and samples with any.
    freedom: f64,
    samples: f64,
}

impl Seen {
    /// Nothing yet; the course is kept if it is drawn.
    pub(super) fn new(drawn: bool) -> Self {
        Self { course: drawn.then(Course::default), ..Self::default() }
    }

    /// Takes in sample `y` at `t`, after the step.
    pub(super) fn add(&mut self, t: f64, y: &[f64], mmae: &Mmae) {
        let e = mmae.estimate();
        if let Some(course) = &mut self.course {
            course.push(t, y, &e.x_hat, &[]);
            course.judge(mmae);
        }
        let present = y.iter().filter(|v| !v.is_nan()).count();
        if present == 0 {
            return;
        }
        self.freedom += present as f64;
        self.samples += 1.0;
        self.nis.resize(e.nis.len(), 0.0);
        for (sum, nis) in self.nis.iter_mut().zip(&e.nis) {
            *sum += nis;
        }
    }

    /// Mean over the samples of `r' S^-1 r` of each model.
    pub(super) fn nis_mean(&self) -> Vec<f64> {
        self.nis.iter().map(|sum| sum / self.samples).collect()
    }

    /// The band that holds it with probability 95 % where the model is right: the
    /// sum has as many degrees of freedom as outputs were measured.
    pub(super) fn nis_band(&self) -> [f64; 2] {
        chi_square_band(self.freedom / self.samples, self.samples)
    }
}
