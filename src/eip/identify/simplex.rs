//! A convex quadratic over the probability simplex.

use faer::Mat;

use crate::solve::backend::Factors;

/// Relative size of a gradient that counts as zero.
const FLAT: f64 = 1e-12;

/// `argmin 1/2 p' G p - 1/2 s' p` over `p >= 0, sum p = 1`, for symmetric positive
/// semidefinite `G`, n by n, row by row; nothing if a number is not finite.
///
/// Active sets: from the best vertex, the coordinate with the steepest descent
/// joins the support, the equality-constrained minimum of the support is taken, and
/// coordinates that reach zero leave it. Where the minimum is not unique the one
/// found has the smaller support.
pub(super) fn minimise(g: &[f64], s: &[f64]) -> Option<Vec<f64>> {
    let n = s.len();
    if n == 0 || g.iter().chain(s).any(|v| !v.is_finite()) {
        return None;
    }
    let scale = g.iter().chain(s).fold(0.0_f64, |m, v| m.max(v.abs()));
    let vertex = |i: usize| 0.5 * (g[i * n + i] - s[i]);
    let best = (0..n).min_by(|&i, &j| vertex(i).total_cmp(&vertex(j)))?;
    let mut p = vec![0.0; n];
    p[best] = 1.0;
    let mut support = vec![best];
    for _ in 0..50 * n {
        let gradient: Vec<f64> =
            (0..n).map(|i| (0..n).map(|j| g[i * n + j] * p[j]).sum::<f64>() - 0.5 * s[i]).collect();
        let level: f64 = gradient.iter().zip(&p).map(|(g, p)| g * p).sum();
        let outside = (0..n).filter(|i| !support.contains(i));
        let steepest = outside.min_by(|&i, &j| gradient[i].total_cmp(&gradient[j]));
        let Some(enter) = steepest.filter(|&i| gradient[i] < level - FLAT * scale) else {
            break;
        };
        support.push(enter);
        support.sort_unstable();
        while let Some(q) = stationary(g, s, &support, n) {
            let negative = support.iter().zip(&q).filter(|(_, q)| **q <= 0.0);
            let step = negative
                .map(|(&i, q)| (p[i] / (p[i] - q).max(f64::MIN_POSITIVE), i))
                .min_by(|a, b| a.0.total_cmp(&b.0));
            let Some((share, leave)) = step else {
                for (&i, q) in support.iter().zip(&q) {
                    p[i] = *q;
                }
                break;
            };
            for (&i, q) in support.iter().zip(&q) {
                p[i] = (p[i] + share * (q - p[i])).max(0.0);
            }
            p[leave] = 0.0;
            support.retain(|&i| i != leave);
            if support.is_empty() {
                return None; // rounding took all of it
            }
        }
        support.retain(|&i| p[i] > 0.0);
    }
    let sum: f64 = p.iter().sum();
    p.iter_mut().for_each(|p| *p /= sum);
    Some(p)
}

/// The minimum on the plane `sum p = 1` of the coordinates in `support`; nothing
/// where it is not unique.
fn stationary(g: &[f64], s: &[f64], support: &[usize], n: usize) -> Option<Vec<f64>> {
    let m = support.len();
    let kkt = Mat::from_fn(m + 1, m + 1, |i, j| match (i < m, j < m) {
        (true, true) => g[support[i] * n + support[j]],
        (false, false) => 0.0,
        _ => 1.0,
    });
    let mut x = Mat::from_fn(m + 1, 1, |i, _| if i < m { 0.5 * s[support[i]] } else { 1.0 });
    Factors::new(kkt)?.solve(&mut x);
    let q: Vec<f64> = (0..m).map(|i| x[(i, 0)]).collect();
    q.iter().all(|v| v.is_finite()).then_some(q)
}

/// The least `v' G v` over the simplex.
pub(super) fn least_energy(g: &[f64], n: usize) -> Option<f64> {
    let p = minimise(g, &vec![0.0; n])?;
    let row = |i: usize| (0..n).map(|j| g[i * n + j] * p[j]).sum::<f64>();
    Some((0..n).map(|i| p[i] * row(i)).sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_minimum_satisfies_the_optimality_conditions() {
        let mut state = 7_u32;
        let mut draw = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state >> 8) / f64::from(1 << 23) - 1.0
        };
        for round in 0..300 {
            let n = 2 + round % 6;
            let a: Vec<f64> = (0..n * n).map(|_| draw()).collect();
            let dot = |i: usize, j: usize| (0..n).map(|k| a[i * n + k] * a[j * n + k]).sum::<f64>();
            let g: Vec<f64> = (0..n * n).map(|k| dot(k / n, k % n)).collect();
            let s: Vec<f64> = (0..n).map(|_| if round % 2 == 0 { 0.0 } else { draw() }).collect();
            let p = minimise(&g, &s).unwrap();
            assert!((p.iter().sum::<f64>() - 1.0).abs() < 1e-12 && p.iter().all(|v| *v >= 0.0));
            let gradient: Vec<f64> = (0..n)
                .map(|i| (0..n).map(|j| g[i * n + j] * p[j]).sum::<f64>() - 0.5 * s[i])
                .collect();
            let level: f64 = gradient.iter().zip(&p).map(|(g, p)| g * p).sum();
            for i in 0..n {
                assert!(gradient[i] > level - 1e-9, "{round}: {gradient:?} {p:?}");
                assert!(p[i] < 1e-9 || gradient[i] < level + 1e-9, "{round}: {gradient:?} {p:?}");
            }
        }
    }

    #[test]
    fn orthogonal_errors_share_by_their_energies() {
        // the counterexample to Lemma 2: energies eps and K times g
        let (eps, g, k) = (0.1, 2.0, 5);
        let n = k + 1;
        let gram = |i: usize, j: usize| match (i, j) {
            (i, j) if i != j => 0.0,
            (0, 0) => eps,
            _ => g,
        };
        let all: Vec<f64> = (0..n * n).map(|m| gram(m / n, m % n)).collect();
        let p = minimise(&all, &vec![0.0; n]).unwrap();
        assert!((p[0] - 1.0 / (1.0 + k as f64 * eps / g)).abs() < 1e-12);
        // and the corrected bound holds, with mu_1 = g/K
        let others: Vec<f64> = (0..k * k).map(|m| gram(1 + m / k, 1 + m % k)).collect();
        let mu = least_energy(&others, k).unwrap();
        assert!((mu - g / k as f64).abs() < 1e-12);
        assert!((1.0 - p[0]).powi(2) <= 2.0 * eps / mu);
    }

    #[test]
    fn equal_models_are_no_trap() {
        let p = minimise(&[1.0; 9], &[0.0; 3]).unwrap();
        assert_eq!(p.iter().filter(|v| **v > 0.0).count(), 1);
        assert!(minimise(&[f64::NAN], &[0.0]).is_none());
    }
}
