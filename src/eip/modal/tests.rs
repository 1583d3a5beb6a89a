//! Eigenvalues in lanes against a library, lanes against one another.

use super::spectrum::Spectrum;
use crate::real::{Mask, Real, Tier};
use crate::simd::{Kernel, LANES, dispatch_on};
use crate::solve::backend;
use faer::Mat;

/// Diagonalises eight matrices of one order: for each whether that was good, then its
/// values, `V` and `V^-1`.
struct Eight<'a> {
    n: usize,
    matrices: &'a [Vec<f64>; LANES],
    start: &'a [(f64, f64)],
}

type Found = (bool, Vec<f64>);

impl Kernel for Eight<'_> {
    type Out = Vec<Found>;

    #[inline(always)]
    fn run<T: Real>(self) -> Vec<Found> {
        let n = self.n;
        let mut found = Vec::new();
        let mut spectrum = Spectrum::<T>::new(n);
        for first in (0..LANES).step_by(T::LANES) {
            let mut a = vec![T::zero(); n * n];
            for (e, x) in a.iter_mut().enumerate() {
                let mut lanes = [0.0; LANES];
                for l in 0..T::LANES {
                    lanes[l] = self.matrices[first + l][e];
                }
                *x = T::load(&lanes);
            }
            let good = spectrum.set(&a, self.start);
            for l in 0..T::LANES {
                let mut numbers = Vec::new();
                for part in [&spectrum.values, &spectrum.right, &spectrum.left] {
                    for z in part {
                        numbers.extend([z.re.lane(l), z.im.lane(l)]);
                    }
                }
                found.push((good.lane(l), numbers));
            }
        }
        found
    }
}

fn stream(state: &mut u64) -> f64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 11) as f64 * 2f64.powi(-52) - 1.0
}

/// Eight matrices, and points near the eigenvalues of the first.
fn problem(n: usize, seed: u64) -> ([Vec<f64>; LANES], Vec<(f64, f64)>) {
    let mut state = seed;
    let matrices: [Vec<f64>; LANES] = std::array::from_fn(|_| {
        let units: Vec<f64> = (0..n).map(|_| (4.0 * stream(&mut state)).exp2()).collect();
        (0..n * n).map(|e| stream(&mut state) * units[e / n] / units[e % n]).collect()
    });
    let first = Mat::from_fn(n, n, |i, j| matrices[0][i * n + j]);
    let start = super::beside(&backend::eigenvalues(first.as_ref()).unwrap());
    (matrices, start)
}

#[test]
fn values_and_vectors_give_the_matrix_again() {
    let mut refused = 0;
    for n in 1..=10 {
        let (mut matrices, start) = problem(n, n as u64);
        if n == 2 {
            // slow real values far from normal, whose rounding has an imaginary part, and
            // a slow pair
            for (k, slow) in [1e-4, 1e-6, 1e-8].into_iter().enumerate() {
                matrices[k + 1] = vec![
                    0.5 - 2.75 * slow,
                    0.5 + 1.75 * slow,
                    -0.5 + 1.75 * slow,
                    -0.5 - 2.75 * slow,
                ];
            }
            matrices[4] = vec![-1e-9, 1e-8, -1e-8, -1e-9];
        }
        let eight = Eight { n, matrices: &matrices, start: &start };
        let found = dispatch_on(Tier::best(), eight).unwrap();
        for (a, (good, numbers)) in matrices.iter().zip(found) {
            if !good {
                refused += 1;
                continue;
            }
            let z = |k: usize| (numbers[2 * k], numbers[2 * k + 1]);
            let largest = a.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
            for i in 0..n {
                for j in 0..n {
                    let (mut one, mut back) = (0.0, 0.0);
                    for k in 0..n {
                        let ((v, vi), (u, ui)) = (z(n + k * n + i), z(n + n * n + k * n + j));
                        // as it is used: of a pair the upper member for both
                        let weight = match z(k).1 {
                            im if im > 0.0 => 2.0,
                            im if im < 0.0 => 0.0,
                            _ => 1.0,
                        };
                        let (product, cross) = (v * u - vi * ui, v * ui + vi * u);
                        one += weight * product;
                        back += weight * (product * z(k).0 - cross * z(k).1);
                    }
                    assert!((one - f64::from(u8::from(i == j))).abs() < 1e-8, "{n} {one}");
                    assert!((back - a[i * n + j]).abs() < 1e-9 * largest, "{n} {back}");
                }
            }
            let a = Mat::from_fn(n, n, |i, j| a[i * n + j]);
            for v in backend::eigenvalues(a.as_ref()).unwrap() {
                let near = (0..n)
                    .map(|k| (z(k).0 - v.re).hypot(z(k).1.abs() - v.im.abs()))
                    .fold(f64::INFINITY, f64::min);
                assert!(near < 1e-9 * largest, "order {n}: {v:?} is {near:e} off");
            }
        }
    }
    assert!(refused <= 7, "{refused} of 80 random matrices were refused");
}

#[test]
fn a_lane_has_its_bits_in_any_company() {
    for n in [1, 2, 5, 9] {
        let (mut matrices, start) = problem(n, 70 + n as u64);
        // twice the same eigenvalue, without two vectors
        matrices[3] = (0..n * n)
            .map(|e| if e % (n + 1) == 0 { -1.0 } else { f64::from(u8::from(e % n == e / n + 1)) })
            .collect();
        let on = |tier: Tier| dispatch_on(tier, Eight { n, matrices: &matrices, start: &start });
        let alone = on(Tier::Scalar).unwrap_or_else(|| on(Tier::Baseline).unwrap());
        assert_eq!(alone[3].0, n == 1);
        for found in [Tier::Baseline, Tier::Avx2, Tier::Avx512].into_iter().filter_map(on) {
            for ((good, x), (good_alone, y)) in found.iter().zip(&alone) {
                assert_eq!(good, good_alone);
                // what is refused may be anything
                assert!(!good || x.iter().zip(y).all(|(x, y)| x.to_bits() == y.to_bits()));
            }
        }
    }
}
