//! Models that change while a bank runs: matrices that vary with time, samples at
//! uneven times.

use super::gains::{GainMode, Gains};
use super::matrices::Matrices;
use super::stream::Bank;
use crate::error::{Error, Result};
use crate::model::{Plant, check_shape};

impl Bank {
    /// Goes on with other models in the place of these, one a member, from the next
    /// step on; estimates and covariances stay.
    ///
    /// A discrete filter moves to its next measurement by the new `A`, `B`, `G`, `Q`
    /// and sees it through the new `C` and `R`. A continuous observer holds the new
    /// matrices over the next interval. Members that failed are left alone.
    ///
    /// [`Bank::reset`] goes back to the first models.
    ///
    /// # Errors
    /// `Shape` for another number or size of models; what [`Plant::check`] finds;
    /// `Conflict` for steady gains, which belong to one model, for discrete models
    /// in continuous time and the other way round, and for unequal `R` under
    /// Dunn's differential equation. The bank is then as before.
    pub fn set_models(&mut self, plants: &[Plant]) -> Result<()> {
        let [n, m, q] = self.sizes();
        if plants.len() != self.models() {
            let (want, got) = ([self.models(), 1], [plants.len(), 1]);
            return Err(Error::Shape { what: "models".into(), want, got });
        }
        if self.gains().mode() == GainMode::Steady {
            return Err(Error::Conflict {
                problem: "models that change under steady gains".into(),
                remedy: "use recursive gains, which follow the models".into(),
            });
        }
        let failed: Vec<bool> = self.failures().iter().map(Option::is_some).collect();
        let alive = || plants.iter().zip(&failed).filter(|(_, failed)| !**failed).map(|p| p.0);
        let Some(good) = alive().next() else { return Ok(()) };
        for plant in alive() {
            check_shape("A", plant.A.as_ref(), [n, n])?;
            check_shape("B", plant.B.as_ref(), [n, m])?;
            check_shape("C", plant.C.as_ref(), [q, n])?;
            plant.check()?;
            if plant.time.is_continuous() != self.is_continuous() {
                return Err(Error::Conflict {
                    problem: "models of the other time than the bank's".into(),
                    remedy: "sample continuous models for discrete filters".into(),
                });
            }
            if self.needs_one_norm() && plant.R != good.R {
                return Err(Error::Conflict {
                    problem: "models with different R under Dunn's differential equation".into(),
                    remedy: "give all models one R, or use another law".into(),
                });
            }
        }
        // a failed model runs as a copy of a good one
        let used = plants.iter().zip(&failed).map(|(p, failed)| if *failed { good } else { p });
        self.gains_mut().set_models(&used.collect::<Vec<_>>());
        Ok(())
    }
}

impl Gains {
    /// As [`Bank::set_models`], for models that were checked.
    fn set_models(&mut self, plants: &[&Plant]) {
        self.matrices = Matrices::new(plants);
        self.coefficients.c.clone_from(&self.matrices.c);
        if self.continuous {
            self.plants = plants.iter().map(|p| (*p).clone()).collect();
            self.settled = false;
            return;
        }
        let (c, m) = (&mut self.coefficients, &self.matrices);
        c.a.clone_from(&m.a);
        c.b.clone_from(&m.b);
        // no steady state belongs to them
        c.white.as_mut_slice().fill(f64::NAN);
        c.bias.as_mut_slice().fill(f64::NAN);
        self.steady = None;
    }
}
