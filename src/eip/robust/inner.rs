//! Stable causal `Delta` within the bound.

use crate::small::Cx;

/// A `Delta` that the search for an inner estimate found.
#[derive(Debug, Clone, PartialEq)]
pub enum Found {
    /// The bound times stable all-pass factors.
    ///
    /// ```text
    /// Delta(s) = gain W(s) prod (a - s)/(a + s) prod (w^2 - 2 z w s + s^2)/(w^2 + 2 z w s + s^2)
    /// ```
    AllPass {
        /// Between -1 and 1.
        gain: f64,
        /// The `a`, positive, in rad/s.
        real: Vec<f64>,
        /// The `[w, z]`, positive, `w` in rad/s.
        pairs: Vec<[f64; 2]>,
    },
    /// `Delta(s) = e^{-s h} - 1`: the delay is this much longer (shorter if
    /// negative).
    Delay {
        /// Seconds.
        h: f64,
    },
}

impl Found {
    /// `Delta(jw)`, where the bound is `w`.
    pub(super) fn response(&self, omega: f64, w: Cx<f64>) -> Cx<f64> {
        match self {
            Found::AllPass { gain, real, pairs } => {
                let mut value = w.scale(*gain);
                for &a in real {
                    value = value * turn(Cx::new(a, omega));
                }
                for &[wn, z] in pairs {
                    let p = Cx::new(wn * wn - omega * omega, 2.0 * z * wn * omega);
                    value = value * turn(p);
                }
                value
            }
            Found::Delay { h } => {
                let angle = omega * h;
                Cx::new(libm::cos(angle) - 1.0, -libm::sin(angle))
            }
        }
    }

    /// `Delta` as a formula.
    pub fn formula(&self) -> String {
        let number = |v: f64| format!("{v:.4}");
        match self {
            Found::AllPass { gain, real, pairs } => {
                let mut text = match gain {
                    1.0 => "W".into(),
                    -1.0 => "-W".into(),
                    g => format!("{} W", number(*g)),
                };
                for &a in real {
                    text += &format!(" ({0} - s)/({0} + s)", number(a));
                }
                for &[w, z] in pairs {
                    let (square, slope) = (number(w * w), number(2.0 * z * w));
                    text += &format!(" (s^2 - {slope} s + {square})/(s^2 + {slope} s + {square})");
                }
                text
            }
            Found::Delay { h } => format!("e^(-{} s) - 1", number(*h)),
        }
    }
}

/// `conj(p) / p`.
fn turn(p: Cx<f64>) -> Cx<f64> {
    let size = p.norm_sqr();
    Cx::new((p.re * p.re - p.im * p.im) / size, -2.0 * p.re * p.im / size)
}
