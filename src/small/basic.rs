//! Copies, sums and norms of small matrices.

use super::dim::Dim;
use crate::real::Real;

/// `A = I`, n x n.
#[inline(always)]
#[track_caller]
pub fn identity<T: Real, N: Dim>(n: N, a: &mut [T]) {
    let n = n.get();
    assert_eq!(a.len(), n * n, "identity: slice does not fit {n}x{n}");
    a.fill(T::zero());
    for i in 0..n {
        a[i * n + i] = T::one();
    }
}

/// `B = A'`, `A` m x n, `B` n x m.
#[inline(always)]
#[track_caller]
pub fn transpose<T: Real, M: Dim, N: Dim>(m: M, n: N, a: &[T], b: &mut [T]) {
    let (m, n) = (m.get(), n.get());
    assert!(a.len() == m * n && b.len() == m * n, "transpose: slices do not fit {m}x{n}");
    for i in 0..m {
        for j in 0..n {
            b[j * m + i] = a[i * n + j];
        }
    }
}

/// `A = (A + A') / 2`, n x n: exactly symmetric.
#[inline(always)]
#[track_caller]
pub fn symmetrize<T: Real, N: Dim>(n: N, a: &mut [T]) {
    let n = n.get();
    assert_eq!(a.len(), n * n, "symmetrize: slice does not fit {n}x{n}");
    for i in 0..n {
        for j in i + 1..n {
            let mean = (a[i * n + j] + a[j * n + i]) * T::splat(0.5);
            a[i * n + j] = mean;
            a[j * n + i] = mean;
        }
    }
}

/// `A += B`, entry by entry.
#[inline(always)]
#[track_caller]
pub fn add_assign<T: Real>(a: &mut [T], b: &[T]) {
    assert_eq!(a.len(), b.len(), "add_assign: sizes differ");
    for (x, &y) in a.iter_mut().zip(b) {
        *x = *x + y;
    }
}

/// `A -= B`, entry by entry.
#[inline(always)]
#[track_caller]
pub fn sub_assign<T: Real>(a: &mut [T], b: &[T]) {
    assert_eq!(a.len(), b.len(), "sub_assign: sizes differ");
    for (x, &y) in a.iter_mut().zip(b) {
        *x = *x - y;
    }
}

/// `A *= s`, entry by entry.
#[inline(always)]
pub fn scale<T: Real>(a: &mut [T], s: T) {
    for x in a {
        *x = *x * s;
    }
}

/// `A = if mask { B } else { A }`, entry by entry and lane by lane.
#[inline(always)]
#[track_caller]
pub fn select_assign<T: Real>(mask: T::Mask, a: &mut [T], b: &[T]) {
    assert_eq!(a.len(), b.len(), "select_assign: sizes differ");
    for (x, &y) in a.iter_mut().zip(b) {
        *x = T::select(mask, y, *x);
    }
}

/// Trace of `A`, n x n.
#[inline(always)]
#[track_caller]
pub fn trace<T: Real, N: Dim>(n: N, a: &[T]) -> T {
    let n = n.get();
    assert_eq!(a.len(), n * n, "trace: slice does not fit {n}x{n}");
    let mut sum = T::zero();
    for i in 0..n {
        sum = sum + a[i * n + i];
    }
    sum
}

/// Inner product `tr(A' B) = sum a_e b_e`, every fourth term in a chain.
#[inline(always)]
#[track_caller]
pub fn dot<T: Real>(a: &[T], b: &[T]) -> T {
    assert_eq!(a.len(), b.len(), "dot: sizes differ");
    // Four chains: one would wait for the latency of every addition.
    let mut sum = [T::zero(); 4];
    let ((a_fours, a_rest), (b_fours, b_rest)) = (a.as_chunks::<4>(), b.as_chunks::<4>());
    for (x, y) in a_fours.iter().zip(b_fours) {
        for l in 0..4 {
            sum[l] = x[l].mul_add(y[l], sum[l]);
        }
    }
    for (l, (&x, &y)) in a_rest.iter().zip(b_rest).enumerate() {
        sum[l] = x.mul_add(y, sum[l]);
    }
    (sum[0] + sum[1]) + (sum[2] + sum[3])
}

/// Frobenius norm, `sqrt(sum a^2)`; NaN if any entry is. Entries above 1e154
/// overflow to infinity.
#[inline(always)]
pub fn norm_frobenius<T: Real>(a: &[T]) -> T {
    dot(a, a).sqrt()
}

/// Largest column sum of magnitudes, `A` m x n; NaN if any entry is.
#[inline(always)]
#[track_caller]
pub fn norm_1<T: Real, M: Dim, N: Dim>(m: M, n: N, a: &[T]) -> T {
    let (m, n) = (m.get(), n.get());
    assert_eq!(a.len(), m * n, "norm_1: slice does not fit {m}x{n}");
    let mut largest = Largest::new();
    for j in 0..n {
        let mut sum = T::zero();
        for i in 0..m {
            sum = sum + a[i * n + j].abs();
        }
        largest.take(sum);
    }
    largest.value()
}

/// Largest magnitude of an entry; NaN if any entry is.
#[inline(always)]
pub fn norm_max<T: Real>(a: &[T]) -> T {
    // Four chains: one would wait for the latency of every comparison.
    let mut parts = [Largest::new(), Largest::new(), Largest::new(), Largest::new()];
    let (fours, rest) = a.as_chunks::<4>();
    for four in fours {
        for (part, x) in parts.iter_mut().zip(four) {
            part.take(x.abs());
        }
    }
    for (part, x) in parts.iter_mut().zip(rest) {
        part.take(x.abs());
    }
    let mut largest = Largest::new();
    for part in parts {
        largest.take(part.value());
    }
    largest.value()
}

/// Maximum of magnitudes that remembers a NaN, which `max` would drop.
struct Largest<T> {
    max: T,
    sum: T,
}

impl<T: Real> Largest<T> {
    #[inline(always)]
    fn new() -> Self {
        Largest { max: T::zero(), sum: T::zero() }
    }
    #[inline(always)]
    fn take(&mut self, x: T) {
        self.max = x.max(self.max);
        self.sum = self.sum + x;
    }
    #[inline(always)]
    fn value(self) -> T {
        T::select(self.sum.eq(self.sum), self.max, self.sum)
    }
}
