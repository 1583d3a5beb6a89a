//! The plant family of a scenario.

use std::sync::Arc;

use faer::Mat;

use super::expression::Entry;
use super::matrix::Written;
use crate::error::{Error, Result};
use crate::model::{Family, Names, Parameter, Plant, Time};

/// A plant family whose matrix entries are expressions of named parameters,
/// as a scenario file gives it; or a built-in family with nominal values of the
/// file's own.
///
/// Expressions are compiled and constant entries folded once; a plant is then
/// a copy of the constant part and an evaluation of the entries that vary. The
/// functions in expressions come from `libm`: a plant has the same bits on
/// every machine.
///
/// ```
/// use mmae::model::Family;
/// use mmae::scenario::Scenario;
/// let text = r#"
///     format = 1
///     [plant]
///     time = "continuous"
///     states = ["x", "v"]
///     outputs = ["x"]
///     disturbances = ["force"]
///     A = [[0, 1], ["-k/m", "-c/m"]]
///     G = [0, "1/m"]
///     C = [1, 0]
///     Q = 1
///     R = 0.01
///     [plant.parameters]
///     m = 2.0
///     k = 1.5
///     c = "0.1*sqrt(k*m)"
/// "#;
/// let scenario = Scenario::parse("spring.toml", text)?;
/// let family = scenario.family();
/// let stiff = family.plant(&family.theta_with(&[("k", 8.0)])?)?;
/// assert_eq!(stiff.A[(1, 0)], -4.0);
/// assert_eq!(stiff.A[(1, 1)], -0.2); // c follows k
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct ExpressionFamily {
    pub(super) parameters: Vec<Parameter>,
    /// What entries can mention, in the order of their indices.
    pub(super) quantities: Vec<Quantity>,
    pub(super) names: Names,
    pub(super) time: Time,
    pub(super) plants: Plants,
}

/// Where the matrices come from.
pub(super) enum Plants {
    /// A, B, G, C, Q, R as written.
    Written(Box<[Pattern; 6]>),
    /// A family that comes with the crate.
    BuiltIn(Arc<dyn Family>),
}

/// A named quantity of `[plant.parameters]`.
pub(super) struct Quantity {
    pub(super) name: String,
    pub(super) value: Origin,
}

/// Where a quantity has its value from.
pub(super) enum Origin {
    /// A parameter, by its index in `theta`.
    Free(usize),
    /// An expression of quantities before it, which it follows.
    Derived(Entry),
}

/// A matrix with the entries that vary kept apart.
pub(super) struct Pattern {
    letter: &'static str,
    constant: Mat<f64>,
    varying: Vec<(usize, usize, Entry)>,
}

impl Pattern {
    /// The matrix as written.
    pub(super) fn new(letter: &'static str, written: &Written) -> Self {
        let cols = written.cols;
        let constant =
            Mat::from_fn(written.rows, cols, |i, j| match &written.entries[i * cols + j] {
                Entry::Constant(value) => *value,
                _ => 0.0,
            });
        let varying = (written.entries.iter().enumerate())
            .filter(|(_, entry)| !matches!(entry, Entry::Constant(_)))
            .map(|(k, entry)| (k / cols, k % cols, entry.clone()))
            .collect();
        Self { letter, constant, varying }
    }

    /// A matrix without expressions.
    pub(super) fn constant(letter: &'static str, constant: Mat<f64>) -> Self {
        Self { letter, constant, varying: Vec::new() }
    }

    fn at(&self, values: &[f64]) -> Result<Mat<f64>> {
        let mut matrix = self.constant.clone();
        self.update(&mut matrix, values, |_| true)?;
        Ok(matrix)
    }

    /// Evaluates the entries that mention a quantity which `changed`.
    fn update(
        &self,
        matrix: &mut Mat<f64>,
        values: &[f64],
        changed: impl Fn(usize) -> bool,
    ) -> Result<()> {
        for (row, col, entry) in &self.varying {
            if !entry.variables().iter().any(|&v| changed(v)) {
                continue;
            }
            let value = entry.value(values);
            if !value.is_finite() {
                let what = self.letter.into();
                return Err(Error::NonFinite { what, row: *row, col: *col });
            }
            matrix[(*row, *col)] = value;
        }
        Ok(())
    }
}

/// Every quantity at `theta`, in the order of the indices in entries.
pub(super) fn values(quantities: &[Quantity], theta: &[f64]) -> Vec<f64> {
    let mut values = Vec::with_capacity(quantities.len());
    for quantity in quantities {
        values.push(match &quantity.value {
            Origin::Free(index) => theta[*index],
            Origin::Derived(entry) => entry.value(&values),
        });
    }
    values
}

impl ExpressionFamily {
    fn check_length(&self, theta: &[f64]) -> Result<()> {
        if theta.len() == self.parameters.len() {
            return Ok(());
        }
        Err(Error::Shape {
            what: "theta".into(),
            want: [self.parameters.len(), 1],
            got: [theta.len(), 1],
        })
    }

    /// Which quantities some matrix depends on, directly or through others.
    pub(super) fn used(&self) -> Vec<bool> {
        let Plants::Written(patterns) = &self.plants else {
            return vec![true; self.quantities.len()];
        };
        let mut used = vec![false; self.quantities.len()];
        for (_, _, entry) in patterns.iter().flat_map(|p| &p.varying) {
            entry.variables().iter().for_each(|&v| used[v] = true);
        }
        // a quantity uses only those before it
        for (index, quantity) in self.quantities.iter().enumerate().rev() {
            if let (true, Origin::Derived(entry)) = (used[index], &quantity.value) {
                entry.variables().iter().for_each(|&v| used[v] = true);
            }
        }
        used
    }
}

impl Family for ExpressionFamily {
    fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    fn names(&self) -> &Names {
        &self.names
    }

    fn time(&self) -> Time {
        self.time
    }

    /// The plant at `theta`.
    ///
    /// # Errors
    /// `Shape` for a `theta` of the wrong length, `NonFinite` naming the first
    /// entry that has no finite value there.
    #[expect(non_snake_case, reason = "capital letters are matrices")]
    fn plant(&self, theta: &[f64]) -> Result<Plant> {
        self.check_length(theta)?;
        let patterns = match &self.plants {
            Plants::Written(patterns) => patterns,
            Plants::BuiltIn(family) => return family.plant(theta),
        };
        let [A, B, G, C, Q, R] = &**patterns;
        let values = values(&self.quantities, theta);
        Ok(Plant {
            time: self.time,
            A: A.at(&values)?,
            B: B.at(&values)?,
            G: G.at(&values)?,
            C: C.at(&values)?,
            Q: Q.at(&values)?,
            R: R.at(&values)?,
        })
    }

    /// Evaluates only the entries that follow a parameter which changed.
    fn update(&self, plant: &mut Plant, from: &[f64], to: &[f64]) -> Result<()> {
        self.check_length(from)?;
        self.check_length(to)?;
        let patterns = match &self.plants {
            Plants::Written(patterns) => patterns,
            Plants::BuiltIn(family) => return family.update(plant, from, to),
        };
        let values = values(&self.quantities, to);
        let mut changed: Vec<bool> = Vec::with_capacity(values.len());
        for quantity in &self.quantities {
            changed.push(match &quantity.value {
                Origin::Free(index) => from[*index].to_bits() != to[*index].to_bits(),
                Origin::Derived(entry) => entry.variables().iter().any(|&v| changed[v]),
            });
        }
        let matrices =
            [&mut plant.A, &mut plant.B, &mut plant.G, &mut plant.C, &mut plant.Q, &mut plant.R];
        for (pattern, matrix) in patterns.iter().zip(matrices) {
            pattern.update(matrix, &values, |v| changed[v])?;
        }
        Ok(())
    }
}
