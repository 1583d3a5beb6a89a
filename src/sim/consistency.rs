//! Whether errors and residuals are as large as the filters believe.

use statrs::distribution::{ChiSquared, ContinuousCDF};

use crate::bank::Schedule;
use crate::small::{Dyn, cholesky, solve_lower};

/// Probability of a band.
pub(super) const LEVEL: f64 = 0.95;
/// A pivot smaller than this part of its diagonal entry is rounding.
pub(super) const SINGULAR: f64 = 1e-13;

/// The band that holds the mean of `count` independent chi-square numbers with
/// probability 95 %, half of the rest on either side; each of `freedom` degrees
/// of freedom.
///
/// ```text
/// [chi2_inv(0.025; T d), chi2_inv(0.975; T d)] / T
/// ```
/// The normalised innovation squared of a filter whose model is right has as many
/// degrees of freedom as there are outputs, the normalised estimation error
/// squared as there are states. NaN if there is nothing to count.
///
/// # Source
/// Bar-Shalom, Li, Kirubarajan (2001), Estimation with Applications to Tracking
/// and Navigation, section 5.4.
///
/// ```
/// // the mean of 50 numbers of 2 degrees of freedom
/// let [low, high] = mmae::sim::chi_square_band(2.0, 50.0);
/// assert!((low - 1.4844).abs() < 1e-4 && (high - 2.5912).abs() < 1e-4);
/// ```
pub fn chi_square_band(freedom: f64, count: f64) -> [f64; 2] {
    let total = freedom * count;
    if !(total > 0.0 && count > 0.0 && total.is_finite()) {
        return [f64::NAN; 2];
    }
    let side = 0.5 * (1.0 - LEVEL);
    [side, 1.0 - side].map(|level| chi_square_quantile(level, total) / count)
}

/// The number below which a chi-square number falls with probability `level`.
fn chi_square_quantile(level: f64, freedom: f64) -> f64 {
    match ChiSquared::new(freedom) {
        Ok(law) => law.inverse_cdf(level),
        Err(_) => f64::NAN,
    }
}

/// Writes the lower triangular `V` with `V' V = P^-1`, both c by c and row-major;
/// NaN where `P` is singular.
pub(super) fn whitener(c: usize, p: &[f64], v: &mut [f64]) {
    let mut l = p.to_vec();
    let definite = cholesky(Dyn(c), &mut l)
        && (0..c).all(|j| l[j * c + j] * l[j * c + j] > SINGULAR * p[j * c + j]);
    for (e, v) in v.iter_mut().enumerate() {
        *v = if e / c == e % c { 1.0 } else { 0.0 };
    }
    solve_lower(Dyn(c), Dyn(c), &l, v);
    if !definite {
        v.fill(f64::NAN);
    }
}

/// Covariances of the states that plant and observers have in common, with their
/// whiteners.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spread<'a> {
    /// Shape (model, state, state).
    pub(super) p: &'a [f64],
    /// As many, see [`whitener`].
    pub(super) white: &'a [f64],
}

/// The covariances of a schedule, ready to judge errors by.
#[derive(Debug, Clone)]
pub(super) struct Spreads {
    each: usize,
    p: Vec<f64>,
    white: Vec<f64>,
}

impl Spreads {
    /// Of the first `c` states of every model; NaN unless they are covariances
    /// (`known`).
    pub(super) fn new(schedule: &Schedule, models: usize, c: usize, known: bool) -> Self {
        let (n, each) = (schedule.n, models * c * c);
        let mut made = Self { each, p: Vec::new(), white: Vec::new() };
        for step in 0..schedule.kept() {
            let of_step = schedule.covariances(step);
            for i in 0..models {
                let p = &of_step[i * n * n..][..n * n];
                leading(n, c, p, known, &mut made.p, &mut made.white);
            }
        }
        made
    }

    /// Those of the place `step` of the schedule.
    #[inline(always)]
    pub(super) fn at(&self, step: usize) -> Spread<'_> {
        let range = step * self.each..(step + 1) * self.each;
        Spread { p: &self.p[range.clone()], white: &self.white[range] }
    }
}

/// Appends the leading c by c block of `P`, n by n, and its whitener.
pub(super) fn leading(
    n: usize,
    c: usize,
    p: &[f64],
    known: bool,
    out: &mut Vec<f64>,
    white: &mut Vec<f64>,
) {
    let (at, end) = (out.len(), white.len());
    for r in 0..c {
        let row = &p[r * n..][..c];
        out.extend(row.iter().map(|v| if known { *v } else { f64::NAN }));
    }
    white.resize(end + c * c, 0.0);
    whitener(c, &out[at..], &mut white[end..]);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Quantiles of tables and of an independent library.
    #[test]
    fn quantiles_of_the_chi_square_law() {
        for (freedom, low, high) in [
            (1.0, 9.820_691_171_752_583e-4, 5.023_886_187_314_888),
            (2.0, 0.050_635_615_968_579_795, 7.377_758_908_227_871),
            (8.0, 2.179_730_747_252_650_6, 17.534_546_139_484_647),
            (100.0, 74.221_927_474_923_73, 129.561_197_185_836_6),
            (8000.0, 7_753.981_696_544_98, 8_249.806_847_110_303),
            (4.0e6, 3_994_458.279_251_604, 4_005_545.509_360_021),
        ] {
            let [a, b] = chi_square_band(freedom, 1.0);
            assert!((a / low - 1.0).abs() < 1e-8, "{freedom}: {a} for {low}");
            assert!((b / high - 1.0).abs() < 1e-8, "{freedom}: {b} for {high}");
        }
        assert!(chi_square_band(0.0, 5.0)[0].is_nan());
    }

    #[test]
    fn a_whitener_makes_the_inverse() {
        let p = [4.0, 1.0, 0.5, 1.0, 3.0, 0.2, 0.5, 0.2, 2.0];
        let mut v = [0.0; 9];
        whitener(3, &p, &mut v);
        for (i, j) in (0..9).map(|e| (e / 3, e % 3)) {
            // (V' V P)_ij
            let mut sum = 0.0;
            for k in 0..3 {
                let vp: f64 = (0..3).map(|l| v[k * 3 + l] * p[l * 3 + j]).sum();
                sum += v[k * 3 + i] * vp;
            }
            assert!((sum - f64::from(u8::from(i == j))).abs() < 1e-14, "{i} {j}: {sum}");
        }
        let mut v = [0.0; 4];
        whitener(2, &[1.0, 1.0, 1.0, 1.0], &mut v);
        assert!(v.iter().all(|v| v.is_nan()));
    }
}
