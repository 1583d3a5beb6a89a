//! Comparisons: by bits, and by relative error.

use super::matrix::{M, frob, sub};

/// Panics unless both slices hold the same bits (NaN payloads and signs of zero included).
#[track_caller]
pub fn assert_bits(what: &str, got: &[f64], want: &[f64]) {
    assert_eq!(got.len(), want.len(), "{what}: lengths differ");
    for (k, (g, w)) in got.iter().zip(want).enumerate() {
        assert!(
            g.to_bits() == w.to_bits(),
            "{what}[{k}]: got {g:e} ({:#018x}), want {w:e} ({:#018x})",
            g.to_bits(),
            w.to_bits()
        );
    }
}

/// Relative error of a number; absolute where the wanted value is 0.
pub fn rel(got: f64, want: f64) -> f64 {
    let scale = if want == 0.0 { 1.0 } else { want.abs() };
    (got - want).abs() / scale
}

/// Relative error of a matrix in the Frobenius norm; absolute where the wanted value is 0.
pub fn rel_matrix(got: &M, want: &M) -> f64 {
    let scale = frob(want);
    frob(&sub(got, want)) / if scale == 0.0 { 1.0 } else { scale }
}

/// Panics unless `got` is within `tol` (relative) of `want`; NaN panics.
#[track_caller]
pub fn assert_close(what: &str, got: f64, want: f64, tol: f64) {
    let error = rel(got, want);
    assert!(
        error <= tol,
        "{what}: got {got:.17e}, want {want:.17e}, relative error {error:.2e} > {tol:.0e}"
    );
}

/// Panics unless the matrix `got` is within `tol` (relative, Frobenius) of `want`.
#[track_caller]
pub fn assert_close_matrix(what: &str, got: &M, want: &M, tol: f64) {
    let error = rel_matrix(got, want);
    assert!(
        error <= tol,
        "{what}: relative error {error:.2e} > {tol:.0e}\n got {got:?}\nwant {want:?}"
    );
}
