//! What the machine can do: multiply-adds and memory.

use std::hint::black_box;
use std::time::Instant;

use crate::real::{Real, Tier};
use crate::simd::{Kernel, LANES, dispatch};

/// Steps of a chain.
const STEPS: usize = 500_000;
/// Numbers of the array that is read: 64 MiB, more than the caches of a core.
const NUMBERS: usize = 8 << 20;

/// Chains of multiply-adds that do not wait for each other.
struct Chains;

impl Chains {
    /// Enough chains to hide the latency, few enough for the registers.
    #[inline(always)]
    fn run<T: Real, const C: usize>() -> f64 {
        let mut x = [T::zero(); C];
        for i in 0..C {
            x[i] = T::from_fn(|l| black_box((LANES * i + l) as f64));
        }
        let (a, b) = (black_box(T::splat(0.999)), black_box(T::splat(0.001)));
        for _ in 0..STEPS {
            for i in 0..C {
                x[i] = x[i].mul_add(a, b);
            }
        }
        let mut sum = T::zero();
        for i in 0..C {
            sum = sum + x[i];
        }
        // every lane: half of a pair of registers that nobody asks for is not computed
        let mut total = 0.0;
        for l in 0..T::LANES {
            total += sum.lane(l);
        }
        total
    }
}

impl Kernel for Chains {
    /// A number that keeps the work alive, and the multiply-adds done.
    type Out = (f64, f64);

    #[inline(always)]
    fn run<T: Real>(self) -> (f64, f64) {
        let each = (STEPS * T::LANES) as f64;
        if T::TIER == Tier::Avx512 {
            (Self::run::<T, 12>(), 12.0 * each)
        } else {
            (Self::run::<T, 6>(), 6.0 * each)
        }
    }
}

/// Fused multiply-adds of one core, in GFLOP/s (two operations each).
pub(super) fn fma_gflops() -> f64 {
    let start = Instant::now();
    let (sum, done) = dispatch(Chains);
    let spent = start.elapsed().as_secs_f64();
    black_box(sum);
    2.0 * done / spent * 1e-9
}

/// An array for [`Memory::gbytes`].
pub(super) struct Memory {
    numbers: Vec<f64>,
}

impl Memory {
    pub(super) fn new() -> Self {
        Self { numbers: vec![1.0; NUMBERS] }
    }

    /// Rate at which one core reads memory, in GB/s.
    pub(super) fn gbytes(&self) -> f64 {
        let start = Instant::now();
        let mut sums = [0.0; 4 * LANES];
        for chunk in self.numbers.chunks_exact(4 * LANES) {
            for (sum, v) in sums.iter_mut().zip(chunk) {
                *sum += v;
            }
        }
        black_box(sums);
        8.0 * NUMBERS as f64 / start.elapsed().as_secs_f64() * 1e-9
    }
}
