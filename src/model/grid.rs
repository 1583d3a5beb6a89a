//! Grids of parameter values: an index maps to a parameter vector exactly.

use crate::error::{Error, Result};

/// The values of one parameter.
#[derive(Debug, Clone, PartialEq)]
pub enum Axis {
    /// `points` values from `from` to `to`, both included, equally spaced.
    Linear {
        /// First value.
        from: f64,
        /// Last value, met exactly.
        to: f64,
        /// How many.
        points: usize,
    },
    /// `points` values from `from` to `to`, both included, equally spaced in
    /// the logarithm.
    Logarithmic {
        /// First value, positive.
        from: f64,
        /// Last value, met exactly.
        to: f64,
        /// How many.
        points: usize,
    },
    /// The values as listed.
    Explicit(Vec<f64>),
}

impl Axis {
    /// Number of values.
    pub fn len(&self) -> usize {
        match self {
            Axis::Linear { points, .. } | Axis::Logarithmic { points, .. } => *points,
            Axis::Explicit(values) => values.len(),
        }
    }

    /// True without values.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Value `i`, computed from the index alone (no accumulated steps); the
    /// end points are exact.
    ///
    /// # Panics
    /// If `i >= len()`.
    pub fn value(&self, i: usize) -> f64 {
        assert!(i < self.len(), "index {i} is past the {} values of the axis", self.len());
        match self {
            Axis::Linear { from, to, points } => between(*from, *to, i, *points, |a, b, s| {
                // symmetric form: equal to the end points at s = 0 and s = 1
                a * (1.0 - s) + b * s
            }),
            Axis::Logarithmic { from, to, points } => between(*from, *to, i, *points, |a, b, s| {
                libm::exp(libm::log(a) * (1.0 - s) + libm::log(b) * s)
            }),
            Axis::Explicit(values) => values[i],
        }
    }

    /// All values in order.
    pub fn values(&self) -> Vec<f64> {
        (0..self.len()).map(|i| self.value(i)).collect()
    }

    fn check(&self, name: &str) -> Result<()> {
        let range = |value: f64, remedy: &str| {
            Err(Error::Range { what: format!("grid of {name}"), value, remedy: remedy.into() })
        };
        if self.is_empty() {
            return Err(Error::Empty { what: format!("grid of {name}") });
        }
        match self {
            Axis::Linear { from, to, points } | Axis::Logarithmic { from, to, points } => {
                for &v in [from, to] {
                    if !v.is_finite() {
                        return range(v, "both ends must be finite");
                    }
                }
                if *points > 1 && from >= to {
                    return range(*from, "'from' must be below 'to'");
                }
                if matches!(self, Axis::Logarithmic { .. }) && *from <= 0.0 {
                    return range(*from, "a logarithmic grid needs positive ends");
                }
                Ok(())
            }
            Axis::Explicit(values) => {
                if let Some(&v) = values.iter().find(|v| !v.is_finite()) {
                    return range(v, "every value must be finite");
                }
                match values.windows(2).find(|w| w[0] >= w[1]) {
                    Some(w) => range(w[1], "values must increase"),
                    None => Ok(()),
                }
            }
        }
    }
}

fn between(from: f64, to: f64, i: usize, points: usize, f: impl Fn(f64, f64, f64) -> f64) -> f64 {
    if i == 0 {
        from
    } else if i + 1 == points {
        to
    } else {
        f(from, to, i as f64 / (points - 1) as f64)
    }
}

/// A product of axes, one a parameter; the last axis varies fastest.
///
/// ```
/// use mmae::model::{Axis, Grid};
/// let grid = Grid::new(vec![
///     ("L".into(), Axis::Linear { from: 0.9, to: 1.9, points: 11 }),
///     ("m".into(), Axis::Explicit(vec![0.5, 0.75])),
/// ])?;
/// assert_eq!(grid.len(), 22);
/// assert_eq!(grid.point(21), [1.9, 0.75]);
/// assert_eq!(grid.point(1), [0.9, 0.75]);
/// # Ok::<(), mmae::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    axes: Vec<(String, Axis)>,
}

impl Grid {
    /// A grid over named axes.
    ///
    /// # Errors
    /// `Empty` without axes or values, `Range` for ends or values that are not
    /// finite or do not increase, `Conflict` for a name given twice, `Limit`
    /// when the number of points does not fit an index.
    pub fn new(axes: Vec<(String, Axis)>) -> Result<Self> {
        if axes.is_empty() {
            return Err(Error::Empty { what: "grid".into() });
        }
        for (k, (name, axis)) in axes.iter().enumerate() {
            axis.check(name)?;
            if axes[..k].iter().any(|(other, _)| other == name) {
                return Err(Error::Conflict {
                    problem: format!("parameter '{name}' has two grid axes"),
                    remedy: "keep one".into(),
                });
            }
        }
        let points: u128 = axes.iter().map(|(_, a)| a.len() as u128).fold(1, u128::saturating_mul);
        if points > u128::from(u32::MAX) {
            return Err(Error::Limit {
                what: "the parameter grid".into(),
                bytes: points.saturating_mul(8),
                limit: u128::from(u32::MAX) * 8,
                remedy: "use fewer points (an index has 32 bits)",
            });
        }
        Ok(Self { axes })
    }

    /// A grid of one parameter, equally spaced.
    ///
    /// # Errors
    /// As [`Grid::new`].
    pub fn linear(name: &str, from: f64, to: f64, points: usize) -> Result<Self> {
        Self::new(vec![(name.into(), Axis::Linear { from, to, points })])
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.axes.iter().map(|(_, a)| a.len()).product()
    }

    /// Never true: an empty grid cannot be built.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// The axes with their names.
    pub fn axes(&self) -> &[(String, Axis)] {
        &self.axes
    }

    /// Parameter values at point `index`, in the order of the axes.
    ///
    /// # Panics
    /// If `index >= len()`.
    pub fn point(&self, index: usize) -> Vec<f64> {
        assert!(index < self.len(), "point {index} is past the {} points", self.len());
        let mut rest = index;
        let mut point = vec![0.0; self.axes.len()];
        for (value, (_, axis)) in point.iter_mut().zip(&self.axes).rev() {
            *value = axis.value(rest % axis.len());
            rest /= axis.len();
        }
        point
    }
}
