//! The covariance recursion of all models, run once for all trials.

use super::gains::{GainMode, Gains};
use crate::error::{Error, Result};
use crate::simd::Panel;

/// Longest cycle of covariances that is looked for: in finite arithmetic a
/// recursion that converges ends in one number or goes round a few.
const CYCLE: usize = 8;
/// Most bytes of coefficients.
const LIMIT: usize = 1 << 30;

/// What each step needs of each model, plain numbers row by row.
#[derive(Debug, Clone)]
pub(crate) struct Schedule {
    pub(crate) n: usize,
    pub(crate) m: usize,
    pub(crate) q: usize,
    models: usize,
    /// `A`, `C`, `B`, the whitener of the steady `S` (of `R` in continuous time)
    /// and the bias of each model; nothing if they change.
    fixed: Vec<f64>,
    /// `K`, `W`, `log_norm` of each model, step after step, preceded by what is
    /// not fixed: continuous observers whose gain changes.
    steps: Vec<f64>,
    /// Covariances that go with them, shape (step, model, state, state).
    covariances: Vec<f64>,
    /// Steps that are kept.
    kept: usize,
    /// The last so many of them repeat for ever.
    cycle: usize,
}

/// One model at one step.
#[derive(Clone, Copy)]
pub(crate) struct OfModel<'a> {
    pub(crate) a: &'a [f64],
    pub(crate) b: &'a [f64],
    pub(crate) c: &'a [f64],
    pub(crate) white: &'a [f64],
    pub(crate) bias: f64,
    pub(crate) k: &'a [f64],
    pub(crate) w: &'a [f64],
    pub(crate) log_norm: f64,
}

impl Schedule {
    /// Runs the recursion of `gains` for `steps` steps, or until it repeats
    /// itself by bits; `moves_first` if the first step predicts.
    ///
    /// # Errors
    /// `Limit` for a recursion that does neither within the memory.
    pub(crate) fn new(
        gains: &mut Gains,
        [n, m, q]: [usize; 3],
        models: usize,
        steps: u64,
        moves_first: bool,
    ) -> Result<Self> {
        let present = vec![true; q];
        let mut made = Self {
            n,
            m,
            q,
            models,
            fixed: Vec::new(),
            steps: Vec::new(),
            covariances: Vec::new(),
            kept: 0,
            cycle: 1,
        };
        let moving = gains.is_continuous() && gains.mode() == GainMode::Recursive;
        if !moving {
            let c = gains.coefficients();
            for i in 0..models {
                for panel in [&c.a, &c.c, &c.b, &c.white, &c.bias] {
                    item(panel, i, &mut made.fixed);
                }
            }
        }
        let mut past: Vec<Vec<u64>> = Vec::new();
        let mut done = 0;
        while done < steps {
            if done > 0 || moves_first {
                gains.predict();
            }
            gains.update(&present);
            let c = gains.coefficients();
            for i in 0..models {
                let changes = [&c.a, &c.c, &c.b, &c.white, &c.bias];
                for panel in changes.into_iter().filter(|_| moving) {
                    item(panel, i, &mut made.steps);
                }
                for panel in [&c.k, &c.w, &c.log_norm] {
                    item(panel, i, &mut made.steps);
                }
                item(gains.covariances(), i, &mut made.covariances);
            }
            done += 1;
            if gains.mode() == GainMode::Steady {
                break;
            }
            let bits: Vec<u64> =
                gains.covariances().as_slice().iter().map(|v| v.to_bits()).collect();
            if let Some(back) = past.iter().rev().position(|p| *p == bits) {
                made.cycle = back + 1;
                break;
            }
            if past.len() == CYCLE {
                past.remove(0);
            }
            past.push(bits);
            let bytes = (made.steps.len() + made.covariances.len()) * 8;
            if bytes > LIMIT {
                let each = bytes as u128 / u128::from(done);
                return Err(Error::Limit {
                    what: format!("the gains of {steps} steps"),
                    bytes: each.saturating_mul(u128::from(steps)),
                    limit: LIMIT as u128,
                    remedy: "use steady gains, or simulate fewer steps",
                });
            }
        }
        made.kept = done as usize;
        Ok(made)
    }

    /// Numbers of a model: those that may be fixed, those of every step.
    #[inline(always)]
    fn numbers(&self) -> [usize; 2] {
        let Self { n, m, q, .. } = *self;
        [n * n + n * m + q * n + q * q + 1, n * q + q * q + 1]
    }

    /// Model `i` at a place of [`Schedule::place`].
    #[inline(always)]
    pub(crate) fn at(&self, i: usize, place: usize) -> OfModel<'_> {
        let Self { n, m, q, .. } = *self;
        let [may, each] = self.numbers();
        let (fixed, moving) = if self.fixed.is_empty() {
            let all = &self.steps[(place * self.models + i) * (may + each)..][..may + each];
            all.split_at(may)
        } else {
            let moving = &self.steps[(place * self.models + i) * each..][..each];
            (&self.fixed[i * may..][..may], moving)
        };
        let (a, fixed) = fixed.split_at(n * n);
        let (c, fixed) = fixed.split_at(q * n);
        let (b, fixed) = fixed.split_at(n * m);
        let (k, moving) = moving.split_at(n * q);
        OfModel {
            a,
            b,
            c,
            white: &fixed[..q * q],
            bias: fixed[q * q],
            k,
            w: &moving[..q * q],
            log_norm: moving[q * q],
        }
    }

    /// The numbers of all models at a place, those that are fixed and those of the
    /// step; `None` if none are fixed.
    #[inline(always)]
    pub(crate) fn of_all(&self, place: usize) -> Option<[&[f64]; 2]> {
        let each = self.numbers()[1] * self.models;
        (!self.fixed.is_empty()).then(|| [&self.fixed[..], &self.steps[place * each..][..each]])
    }

    /// How many of the fixed numbers of [`Schedule::of_all`] are those of a model.
    #[inline(always)]
    pub(crate) fn fixed_numbers(&self) -> usize {
        self.numbers()[0]
    }

    /// Covariances of all models after the measurement of a step, shape (model,
    /// state, state).
    pub(crate) fn covariances(&self, step: usize) -> &[f64] {
        let each = self.models * self.n * self.n;
        &self.covariances[step * each..][..each]
    }

    /// Steps that are kept, those of the cycle included.
    pub(crate) fn kept(&self) -> usize {
        self.kept
    }

    /// Where the coefficients of step `k`, from 1, are kept. (Asked at every step: no
    /// division unless they go round.)
    #[inline(always)]
    pub(crate) fn place(&self, k: u64) -> usize {
        let (step, kept) = (k - 1, self.kept as u64);
        if step < kept {
            step as usize
        } else if self.cycle == 1 {
            self.kept - 1
        } else {
            self.kept - self.cycle + ((step - kept) % self.cycle as u64) as usize
        }
    }
}

/// Appends matrix `i` of a panel.
fn item(panel: &Panel, i: usize, out: &mut Vec<f64>) {
    let at = out.len();
    out.resize(at + panel.item_len(), 0.0);
    panel.read_item(i, &mut out[at..]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::{Initial, Members, Settings};
    use crate::model::{Family, systems};
    use crate::observer::ObserverKind;

    #[test]
    fn steps_that_are_not_kept_are_those_of_the_recursion() {
        let family = systems::tracker();
        let plants = [0.96, 1.0].map(|rho| {
            let theta = family.theta_with(&[("rho", rho)]).unwrap();
            family.plant(&theta).unwrap()
        });
        let mut members = Members::new(ObserverKind::Kalman, plants.to_vec());
        let p = crate::Mat::zeros(4, 4);
        members.initial = vec![Initial { x_hat: vec![0.0; 4], P: Some(p) }];
        let settings = Settings { gains: GainMode::Recursive, ..Settings::default() };
        let (mut gains, _) = Gains::new(&members, &settings).unwrap();
        let kept = Schedule::new(&mut gains.clone(), [4, 0, 2], 2, 100_000, true).unwrap();
        assert!(kept.steps.len() < 2 * 13 * 1000, "{}", kept.steps.len());
        for k in 1..=2000 {
            gains.predict();
            gains.update(&[true, true]);
            for i in 0..2 {
                let mut want = Vec::new();
                item(&gains.coefficients().k, i, &mut want);
                assert_eq!(kept.at(i, kept.place(k)).k, want, "step {k}");
            }
        }
    }
}
