//! Elementary functions against a table computed with 60 and more digits.
//!
//! A row of the table is the argument and, for each function, the nearest `f64`
//! and the rest of the exact value in 1/10000 of its last place; numbers are
//! stored as bits, which no reader rounds.

use mmae::real::{exp, ln, sin_cos};
use proptest::prelude::*;

fn table(name: &str) -> Vec<Vec<f64>> {
    let all: serde_json::Value =
        serde_json::from_str(include_str!("data/elementary.json")).unwrap();
    let rows: Vec<Vec<i64>> = serde_json::from_value(all[name].clone()).unwrap();
    let number = |(i, &v): (usize, &i64)| match i {
        0 | 1 | 3 => f64::from_bits(v as u64),
        _ => v as f64 * 1e-4,
    };
    rows.iter().map(|row| row.iter().enumerate().map(number).collect()).collect()
}

/// Size of the last place of `x`.
fn last_place(x: f64) -> f64 {
    x.abs().next_up() - x.abs()
}

/// Error of `x` in units in the last place of the exact value `near + rest`.
fn error(x: f64, near: f64, rest: f64) -> f64 {
    if x == near {
        return rest.abs();
    }
    ((x - near) / last_place(near) - rest).abs()
}

#[test]
fn exponential() {
    let worst = table("exp").iter().map(|r| error(exp(r[0]), r[1], r[2])).fold(0.0, f64::max);
    assert!(worst <= 1.0, "{worst} units in the last place");
    assert_eq!(exp(709.7827128933841), f64::INFINITY);
    assert_eq!(exp(f64::MAX), f64::INFINITY);
    assert_eq!(exp(f64::INFINITY), f64::INFINITY);
    assert_eq!(exp(f64::NEG_INFINITY), 0.0);
    assert_eq!(exp(f64::MIN), 0.0);
    assert!(exp(f64::NAN).is_nan());
}

#[test]
fn logarithm() {
    let worst = table("ln").iter().map(|r| error(ln(r[0]), r[1], r[2])).fold(0.0, f64::max);
    assert!(worst <= 1.0, "{worst} units in the last place");
    assert_eq!(ln(0.0), f64::NEG_INFINITY);
    assert_eq!(ln(-0.0), f64::NEG_INFINITY);
    assert_eq!(ln(f64::INFINITY), f64::INFINITY);
    for x in [-1.0, -5e-324, f64::NEG_INFINITY, f64::NAN] {
        assert!(ln(x).is_nan(), "{x}");
    }
}

#[test]
fn sine_and_cosine() {
    let mut worst = [0.0_f64; 2];
    for row in table("sin_cos") {
        let (s, c) = sin_cos(row[0]);
        worst[0] = worst[0].max(error(s, row[1], row[2]));
        worst[1] = worst[1].max(error(c, row[3], row[4]));
    }
    assert!(worst[0] <= 1.0 && worst[1] <= 1.0, "{worst:?} units in the last place");
    assert!(sin_cos(-0.0).0.is_sign_negative());
    for x in [f64::INFINITY, f64::NEG_INFINITY, f64::NAN] {
        assert!(sin_cos(x).0.is_nan() && sin_cos(x).1.is_nan());
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(4096) })]

    #[test]
    fn exponential_near_the_standard_library(x in -746.0..710.0_f64) {
        let reference = x.exp();
        prop_assert!(error(exp(x), reference, 0.0) <= 1.0 || exp(x) == reference);
    }

    #[test]
    fn logarithm_near_the_standard_library(bits in 0..0x7ff0_0000_0000_0000_u64) {
        let x = f64::from_bits(bits);
        let reference = x.ln();
        prop_assert!(error(ln(x), reference, 0.0) <= 1.0 || ln(x) == reference);
    }

    #[test]
    fn sine_and_cosine_near_the_standard_library(x in -2e6..2e6_f64) {
        let ((s, c), (sine, cosine)) = (sin_cos(x), x.sin_cos());
        prop_assert!(error(s, sine, 0.0) <= 1.0 && error(c, cosine, 0.0) <= 1.0);
    }

    #[test]
    fn symmetries(x in -1e6..1e6_f64) {
        let ((s, c), (minus_s, minus_c)) = (sin_cos(x), sin_cos(-x));
        prop_assert!(s == -minus_s && c == minus_c);
        prop_assert!((s.mul_add(s, c * c) - 1.0).abs() < 4e-16);
    }
}
