//! Matrix entries as expressions of named parameters.
//!
//! The expression crate evaluates; this module stands in front of it. It finds
//! what is wrong with a text and at which character, bounds length and nesting,
//! and writes the text in the one spelling that the crate cannot misread: the
//! crate binds a sign tighter than a power (`-x^2` would be `(-x)^2`), knows no
//! `1e-3`, and sorts variables by name.

mod speller;

use std::sync::Arc;

use exmex::{Express, FlatEx};

use super::operators::Operators;
use speller::{Spelled, Speller};

/// Longest expression, in bytes.
const LENGTH: usize = 2000;
/// Variables gathered on the stack when an expression is evaluated.
const VARIABLES: usize = 16;

/// An entry, compiled.
#[derive(Debug, Clone)]
pub(super) enum Entry {
    /// A number, or an expression of numbers alone.
    Constant(f64),
    /// One parameter as it is.
    Parameter(usize),
    /// Everything else.
    Formula(Arc<Formula>),
}

/// A compiled expression and the values it wants, in the crate's order.
#[derive(Debug, Clone)]
pub(super) struct Formula {
    flat: FlatEx<f64, Operators>,
    variables: Vec<usize>,
}

/// What is wrong with an expression, and at which byte of it.
#[derive(Debug, PartialEq)]
pub(super) struct Fault {
    pub(super) at: usize,
    pub(super) message: String,
    pub(super) remedy: String,
    /// A name that is like no known one: the caller knows what to do about it.
    pub(super) unknown: bool,
}

fn fault<T>(at: usize, message: impl Into<String>, remedy: impl Into<String>) -> Result<T, Fault> {
    Err(Fault { at, message: message.into(), remedy: remedy.into(), unknown: false })
}

impl Entry {
    /// Compiles `text` over the parameters `names`.
    pub(super) fn compile(text: &str, names: &[&str]) -> Result<Self, Fault> {
        let Spelled { text: spelled, variables } = Speller::new(text, names).run()?;
        if let (&[only], true) = (&variables[..], names.contains(&text.trim())) {
            return Ok(Entry::Parameter(only));
        }
        let flat = match FlatEx::<f64, Operators>::parse(&spelled) {
            Ok(flat) => flat,
            Err(e) => return fault(0, e.msg(), "write it with fewer operators"),
        };
        let formula = Formula { flat, variables };
        if formula.variables.is_empty() {
            return Ok(Entry::Constant(formula.value(&[])));
        }
        Ok(Entry::Formula(Arc::new(formula)))
    }

    /// The value at the parameter values `values`; NaN or infinite where the
    /// expression has none.
    pub(super) fn value(&self, values: &[f64]) -> f64 {
        match self {
            Entry::Constant(value) => *value,
            Entry::Parameter(index) => values[*index],
            Entry::Formula(formula) => formula.value(values),
        }
    }

    /// Indices of the parameters it mentions.
    pub(super) fn variables(&self) -> &[usize] {
        match self {
            Entry::Constant(_) => &[],
            Entry::Parameter(index) => std::slice::from_ref(index),
            Entry::Formula(formula) => &formula.variables,
        }
    }
}

impl Formula {
    fn value(&self, values: &[f64]) -> f64 {
        let mut few = [0.0; VARIABLES];
        let result = if self.variables.len() <= VARIABLES {
            for (slot, &v) in few.iter_mut().zip(&self.variables) {
                *slot = values[v];
            }
            self.flat.eval(&few[..self.variables.len()])
        } else {
            let many: Vec<f64> = self.variables.iter().map(|&v| values[v]).collect();
            self.flat.eval(&many)
        };
        // the only failure is a wrong number of values, which cannot be
        result.unwrap_or(f64::NAN)
    }
}

#[cfg(test)]
mod tests;
