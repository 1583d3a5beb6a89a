//! The operators and functions of expressions, as the expression crate wants
//! them.
//!
//! The crate's own table reads `a*b/c` as `a*(b/c)` and takes its functions
//! from the platform. Here `*` and `/` have one rank, evaluated from left to
//! right, nothing is reordered, and the functions come from `libm`, so that a
//! matrix has the same bits on every machine.

use exmex::{BinOp, MakeOperators, Operator};

/// A function of one or two arguments.
pub(super) struct Function {
    pub(super) name: &'static str,
    pub(super) apply: Apply,
}

#[derive(Clone, Copy)]
pub(super) enum Apply {
    One(fn(f64) -> f64),
    Two(fn(f64, f64) -> f64),
}

/// Every function of the language.
pub(super) const FUNCTIONS: [Function; 20] = [
    one("sqrt", libm::sqrt),
    one("cbrt", libm::cbrt),
    one("abs", libm::fabs),
    one("exp", libm::exp),
    one("ln", libm::log),
    one("log2", libm::log2),
    one("log10", libm::log10),
    one("sin", libm::sin),
    one("cos", libm::cos),
    one("tan", libm::tan),
    one("asin", libm::asin),
    one("acos", libm::acos),
    one("atan", libm::atan),
    one("sinh", libm::sinh),
    one("cosh", libm::cosh),
    one("tanh", libm::tanh),
    two("atan2", libm::atan2),
    two("hypot", libm::hypot),
    two("min", |a, b| if a.is_nan() || b.is_nan() { f64::NAN } else { a.min(b) }),
    two("max", |a, b| if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) }),
];

/// Every constant of the language.
pub(super) const CONSTANTS: [(&str, f64); 2] =
    [("pi", std::f64::consts::PI), ("e", std::f64::consts::E)];

const fn one(name: &'static str, f: fn(f64) -> f64) -> Function {
    Function { name, apply: Apply::One(f) }
}

const fn two(name: &'static str, f: fn(f64, f64) -> f64) -> Function {
    Function { name, apply: Apply::Two(f) }
}

/// The operator table.
#[derive(Clone, Debug)]
pub(super) struct Operators;

impl MakeOperators<f64> for Operators {
    fn make<'a>() -> Vec<Operator<'a, f64>> {
        // `is_commutative` lets the crate fold constants out of turn, which
        // would change roundings: it stays off
        let binary =
            |apply: fn(f64, f64) -> f64, prio| BinOp { apply, prio, is_commutative: false };
        let mut table = vec![
            Operator::make_bin("^", binary(power, 2)),
            Operator::make_bin("*", binary(|a, b| a * b, 1)),
            Operator::make_bin("/", binary(|a, b| a / b, 1)),
            Operator::make_bin("+", binary(|a, b| a + b, 0)),
            Operator::make_bin_unary("-", binary(|a, b| a - b, 0), |a| -a),
        ];
        table.extend(FUNCTIONS.iter().map(|f| match f.apply {
            Apply::One(g) => Operator::make_unary(f.name, g),
            Apply::Two(g) => Operator::make_bin(f.name, binary(g, 3)),
        }));
        table
    }
}

/// `a^b`; a square is the product, exact to the last bit.
pub(super) fn power(a: f64, b: f64) -> f64 {
    if b == 2.0 { a * a } else { libm::pow(a, b) }
}
