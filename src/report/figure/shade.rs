//! Shades of a colour that stand for margins.

use crate::report::number::decade;

/// Shades of a colour, from the smallest margin to the largest.
pub(super) const SHADES: [f64; 5] = [0.78, 0.6, 0.4, 0.2, 0.0];

/// Index into [`SHADES`] of margins below the first of increasing levels; those
/// above the last have the full colour.
pub(super) fn lightest(levels: &[f64]) -> usize {
    SHADES.len() - 1 - levels.len()
}

/// Up to four round numbers that part the sorted margins evenly.
pub(super) fn levels(sorted: &[f64]) -> Vec<f64> {
    let Some(&largest) = sorted.last() else { return Vec::new() };
    if largest <= 0.0 {
        return Vec::new();
    }
    let mut levels: Vec<f64> = [0.15, 0.4, 0.65, 0.88]
        .iter()
        .map(|q| sorted[((sorted.len() - 1) as f64 * q) as usize])
        .filter(|m| *m > 0.0)
        .map(round)
        .collect();
    levels.dedup();
    levels
}

/// The nearest of 1, 2, 5 times a power of ten.
fn round(v: f64) -> f64 {
    let exponent = decade(v);
    let mut best = f64::NAN;
    for text in ["1", "2", "5", "10"] {
        let candidate: f64 = format!("{text}e{exponent}").parse().unwrap_or(f64::NAN);
        if best.is_nan() || (candidate / v).ln().abs() < (best / v).ln().abs() {
            best = candidate;
        }
    }
    best
}
