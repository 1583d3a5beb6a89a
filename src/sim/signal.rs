//! Known signals that drive a simulated plant.

use crate::error::{Error, Result};

/// Share of a step by which a moment may miss an edge and still be on it: the
/// times of steps are rounded products.
const EDGE: f64 = 1e-9;

/// The shape of a term.
#[derive(Debug, Clone, PartialEq)]
pub enum Wave {
    /// One value for ever.
    Constant {
        /// The value.
        value: f64,
    },
    /// `+amplitude` on `[0, T/2)`, `-amplitude` on `[T/2, T)`, and so on.
    Square {
        /// Height.
        amplitude: f64,
        /// `T` in seconds.
        period: f64,
    },
    /// `amplitude sin(omega t + phase)`.
    Sine {
        /// Height.
        amplitude: f64,
        /// Frequency in rad/s.
        omega: f64,
        /// Phase in rad.
        phase: f64,
    },
    /// `value[i]` from `t[i]` to `t[i+1]`, the last for ever, 0 before the first.
    Table {
        /// Times in seconds, rising.
        t: Vec<f64>,
        /// A value a time.
        value: Vec<f64>,
    },
    /// White noise: of this intensity in continuous time, this covariance in
    /// discrete time. It is held over a step of `dt` with variance
    /// `intensity / dt`.
    White {
        /// Units squared per hertz, or units squared.
        intensity: f64,
    },
}

/// `e^{-decay t} wave(t)`.
#[derive(Debug, Clone, PartialEq)]
pub struct Term {
    /// The shape.
    pub wave: Wave,
    /// Rate of decay in 1/s; 0 for none.
    pub decay: f64,
}

/// A sum of terms; without one it is zero.
///
/// ```
/// use mmae::sim::{Signal, Term, Wave};
/// let square = Wave::Square { amplitude: 2.0, period: 1.0 };
/// let signal = Signal { terms: vec![Term { wave: square, decay: 0.1 }] };
/// assert_eq!(signal.at(0.0), 2.0);
/// assert!((signal.at(0.5) + 2.0 * (-0.05_f64).exp()).abs() < 1e-15); // right-continuous
/// assert_eq!(signal.next_switch(0.2), Some(0.5));
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Signal {
    /// The terms.
    pub terms: Vec<Term>,
}

impl Term {
    /// The value at `t` of everything but white noise, the decay left out.
    fn plain(&self, t: f64) -> f64 {
        match &self.wave {
            Wave::Constant { value } => *value,
            Wave::Square { amplitude, period } => {
                let even = halves(t, *period).rem_euclid(2.0) == 0.0;
                if even { *amplitude } else { -amplitude }
            }
            Wave::Sine { amplitude, omega, phase } => amplitude * libm::sin(omega * t + phase),
            Wave::Table { t: times, value } => {
                let later = times.partition_point(|&at| at <= t);
                if later == 0 { 0.0 } else { value[later - 1] }
            }
            Wave::White { .. } => 0.0,
        }
    }

    /// States of the term at the start of a stretch that begins at `t`: its value,
    /// and for a sine the cosine beside it.
    ///
    /// ```text
    /// e' = -decay e,   or   e' = [-decay omega; -omega -decay] e
    /// ```
    pub(super) fn states(&self, t: f64, dt: f64) -> [f64; 2] {
        let fade = fade(self.decay, t);
        match self.wave {
            Wave::Sine { amplitude, omega, phase } => {
                let angle = omega * t + phase;
                [fade * amplitude * libm::sin(angle), fade * amplitude * libm::cos(angle)]
            }
            Wave::Square { .. } | Wave::Table { .. } => [fade * self.plain(t + EDGE * dt), 0.0],
            Wave::Constant { .. } | Wave::White { .. } => [fade * self.plain(t), 0.0],
        }
    }

    fn next_switch(&self, t: f64) -> Option<f64> {
        match &self.wave {
            Wave::Square { period, .. } => Some((halves(t, *period) + 1.0) * (0.5 * period)),
            Wave::Table { t: times, .. } => times.iter().copied().find(|&at| at > t),
            Wave::Constant { .. } | Wave::Sine { .. } | Wave::White { .. } => None,
        }
    }

    fn check(&self, what: &str) -> Result<()> {
        let range = |name: &str, value: f64, remedy: &str| {
            Err(Error::Range { what: format!("{name} of {what}"), value, remedy: remedy.into() })
        };
        if !(self.decay >= 0.0 && self.decay.is_finite()) {
            return range("decay", self.decay, "give a rate in 1/s, zero or more");
        }
        let finite = "give a finite number";
        match &self.wave {
            Wave::Constant { value } if !value.is_finite() => range("value", *value, finite),
            Wave::Square { amplitude, .. } | Wave::Sine { amplitude, .. }
                if !amplitude.is_finite() =>
            {
                range("amplitude", *amplitude, finite)
            }
            Wave::Square { period, .. } if !(*period > 0.0 && period.is_finite()) => {
                range("period", *period, "give positive seconds")
            }
            Wave::Sine { omega, .. } if !omega.is_finite() => range("omega", *omega, finite),
            Wave::Sine { phase, .. } if !phase.is_finite() => range("phase", *phase, finite),
            Wave::White { intensity } if !(*intensity >= 0.0 && intensity.is_finite()) => {
                range("intensity", *intensity, "give zero or more")
            }
            Wave::Table { t, value } => {
                if t.is_empty() || t.len() != value.len() {
                    let (want, got) = ([t.len().max(1), 1], [value.len(), 1]);
                    return Err(Error::Shape { what: format!("values of {what}"), want, got });
                }
                if let Some(row) = t.iter().zip(value).position(|(t, v)| !(t + v).is_finite()) {
                    let what = format!("table of {what}");
                    return Err(Error::NonFinite { what, row, col: 0 });
                }
                match t.windows(2).find(|w| w[0] >= w[1]) {
                    Some(w) => range("time", w[1], "let the times of the table rise"),
                    None => Ok(()),
                }
            }
            _ => Ok(()),
        }
    }
}

impl Signal {
    /// A constant.
    pub fn constant(value: f64) -> Self {
        Self { terms: vec![Term { wave: Wave::Constant { value }, decay: 0.0 }] }
    }

    /// Values of steps of `dt` seconds, one after the other, the last for ever.
    pub fn steps(dt: f64, values: &[f64]) -> Self {
        let t = (0..values.len()).map(|k| k as f64 * dt).collect();
        let wave = Wave::Table { t, value: values.to_vec() };
        Self { terms: vec![Term { wave, decay: 0.0 }] }
    }

    /// The value at `t`, white noise left out.
    pub fn at(&self, t: f64) -> f64 {
        self.terms.iter().fold(0.0, |sum, term| sum + fade(term.decay, t) * term.plain(t))
    }

    /// The value that is held over a step from `t` to `t + dt`: that at its start,
    /// where an edge that rounding puts just after `t` has passed. White noise is
    /// left out.
    pub fn held(&self, t: f64, dt: f64) -> f64 {
        self.terms.iter().fold(0.0, |sum, term| {
            let at = match term.wave {
                Wave::Square { .. } | Wave::Table { .. } => t + EDGE * dt,
                _ => t,
            };
            sum + fade(term.decay, t) * term.plain(at)
        })
    }

    /// Intensity of the white noise in it; it must not decay.
    pub fn intensity(&self) -> f64 {
        self.terms.iter().fold(0.0, |sum, term| match term.wave {
            Wave::White { intensity } => sum + intensity,
            _ => sum,
        })
    }

    /// The first jump after `t`, if there is one.
    pub fn next_switch(&self, t: f64) -> Option<f64> {
        self.terms.iter().filter_map(|term| term.next_switch(t)).min_by(f64::total_cmp)
    }

    /// Checks every term; `what` names the signal in errors.
    ///
    /// # Errors
    /// `Range`, `Shape`, `NonFinite`; `Conflict` for white noise that decays.
    pub fn check(&self, what: &str) -> Result<()> {
        for term in &self.terms {
            term.check(what)?;
            if term.decay > 0.0 && matches!(term.wave, Wave::White { .. }) {
                return Err(Error::Conflict {
                    problem: format!("white noise with a decay in {what}"),
                    remedy: "leave the decay out, or use another wave".into(),
                });
            }
        }
        Ok(())
    }
}

/// The largest `k` with `k T/2 <= t` in floating-point numbers, so that the
/// product that is a switch counts as past it.
fn halves(t: f64, period: f64) -> f64 {
    let half = 0.5 * period;
    let k = (t / half).floor();
    if (k + 1.0) * half <= t {
        k + 1.0
    } else if k * half > t {
        k - 1.0
    } else {
        k
    }
}

/// `e^{-decay t}`.
fn fade(decay: f64, t: f64) -> f64 {
    if decay == 0.0 { 1.0 } else { libm::exp(-decay * t) }
}

/// Known signals of a truth, channel by channel.
///
/// ```text
/// u = inputs + feedback + filtered noise,   w_j = disturbances_j or white,
/// v_j = noise_j or white
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Signals {
    /// One an input, or none at all for zero; plant and observers know them.
    pub inputs: Vec<Signal>,
    /// One a disturbance, or none at all; `None` leaves the channel to its own
    /// white noise of intensity `Q`.
    pub disturbances: Vec<Option<Signal>>,
    /// One an output, or none at all; `None` leaves the channel to its own
    /// measurement noise of intensity `R`.
    pub noise: Vec<Option<Signal>>,
}

impl Signals {
    /// Checks the signals against a plant with `m` inputs, `w` disturbances and
    /// `q` outputs.
    ///
    /// # Errors
    /// `Shape` for another number of signals; those of [`Signal::check`].
    pub fn check(&self, m: usize, w: usize, q: usize) -> Result<()> {
        let counts = [
            ("inputs", self.inputs.len(), m),
            ("disturbances", self.disturbances.len(), w),
            ("noise", self.noise.len(), q),
        ];
        for (what, got, want) in counts {
            if got != 0 && got != want {
                let what = format!("signals of the {what}");
                return Err(Error::Shape { what, want: [want, 1], got: [got, 1] });
            }
        }
        for (j, signal) in self.inputs.iter().enumerate() {
            signal.check(&format!("input {j}"))?;
        }
        for (what, list) in [("disturbance", &self.disturbances), ("noise", &self.noise)] {
            for (j, signal) in list.iter().enumerate() {
                if let Some(signal) = signal {
                    signal.check(&format!("{what} {j}"))?;
                }
            }
        }
        Ok(())
    }

    /// Jumps of all of them within `duration` seconds, at most.
    pub(super) fn switches(&self, duration: f64) -> f64 {
        let optional = self.disturbances.iter().chain(&self.noise).flatten();
        let terms = self.inputs.iter().chain(optional).flat_map(|signal| &signal.terms);
        terms.fold(0.0, |sum, term| {
            sum + match &term.wave {
                Wave::Square { period, .. } => 2.0 * duration / period + 1.0,
                Wave::Table { t, .. } => t.len() as f64,
                Wave::Constant { .. } | Wave::Sine { .. } | Wave::White { .. } => 0.0,
            }
        })
    }

    /// The first jump of any of them after `t`, if there is one.
    pub fn next_switch(&self, t: f64) -> Option<f64> {
        let optional = self.disturbances.iter().chain(&self.noise).flatten();
        self.inputs
            .iter()
            .chain(optional)
            .filter_map(|signal| signal.next_switch(t))
            .min_by(f64::total_cmp)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(wave: Wave, decay: f64) -> Signal {
        Signal { terms: vec![Term { wave, decay }] }
    }

    #[test]
    fn a_square_wave_changes_sign_at_every_half_period_of_its_steps() {
        let signal = one(Wave::Square { amplitude: 1.0, period: 0.6 }, 0.0);
        for k in 0..100_000_u32 {
            // 30 steps of 10 ms are half a period
            let want = if (k / 30) % 2 == 0 { 1.0 } else { -1.0 };
            assert_eq!(signal.held(f64::from(k) * 0.01, 0.01), want, "step {k}");
        }
    }

    #[test]
    fn switches_are_met_one_by_one() {
        let signal = one(Wave::Square { amplitude: 1.0, period: 0.2 }, 0.0);
        let mut t = 0.0;
        for k in 1..10_000 {
            let next = signal.next_switch(t).unwrap();
            assert!((next - 0.1 * f64::from(k)).abs() < 1e-9, "{k}: {next}");
            assert_eq!(signal.at(next), if k % 2 == 0 { 1.0 } else { -1.0 }, "{k}");
            t = next;
        }
        let table = one(Wave::Table { t: vec![1.0, 2.0], value: vec![3.0, 4.0] }, 0.0);
        assert_eq!((table.at(0.5), table.at(1.0), table.at(9.0)), (0.0, 3.0, 4.0));
        assert_eq!((table.next_switch(1.0), table.next_switch(2.0)), (Some(2.0), None));
    }

    #[test]
    fn terms_add_up_and_fade() {
        let sine = Wave::Sine { amplitude: 2.0, omega: 3.0, phase: 0.5 };
        let signal = Signal {
            terms: vec![
                Term { wave: sine, decay: 0.1 },
                Term { wave: Wave::White { intensity: 4.0 }, decay: 0.0 },
                Term { wave: Wave::Constant { value: 1.0 }, decay: 0.0 },
            ],
        };
        let want = 1.0 + 2.0 * (-0.2_f64).exp() * (6.5_f64).sin();
        assert!((signal.at(2.0) - want).abs() < 1e-15);
        assert_eq!(signal.intensity(), 4.0);
        assert_eq!(Signal::steps(0.5, &[1.0, 2.0]).at(0.5), 2.0);
    }

    #[test]
    fn what_is_wrong_is_named() {
        let wrong = [
            one(Wave::Square { amplitude: 1.0, period: 0.0 }, 0.0),
            one(Wave::Sine { amplitude: f64::NAN, omega: 1.0, phase: 0.0 }, 0.0),
            one(Wave::Constant { value: 1.0 }, -1.0),
            one(Wave::White { intensity: 1.0 }, 1.0),
            one(Wave::Table { t: vec![0.0, 0.0], value: vec![1.0, 1.0] }, 0.0),
            one(Wave::Table { t: vec![0.0], value: vec![] }, 0.0),
        ];
        for signal in wrong {
            let said = signal.check("input 0").unwrap_err().to_string();
            assert!(said.contains("input 0"), "{said}");
        }
        let two = Signals { inputs: vec![Signal::default(); 2], ..Signals::default() };
        assert!(two.check(1, 0, 1).is_err());
    }
}
