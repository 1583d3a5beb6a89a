//! One shell per tier, and the choice between them.

use super::array::Array8;
#[cfg(target_arch = "x86_64")]
use super::{avx2::Pair256, avx512::Lane512};
use crate::real::{LaneKernel, Real, Tier, Twice};

/// Work written once for every lane type.
///
/// Mark `run`, and every function between it and the arithmetic,
/// `#[inline(always)]`, or put it behind [`Real::outline`]: a call that is
/// neither would run without the tier's instructions. Closures and function
/// items are not inlined by force: pass types with trait methods.
///
/// # Examples
/// ```
/// use mmae::real::Real;
/// use mmae::simd::{Kernel, dispatch};
/// struct Sum<'a>(&'a [f64; 8]);
/// impl Kernel for Sum<'_> {
///     type Out = f64;
///     #[inline(always)]
///     fn run<T: Real>(self) -> f64 {
///         let mut total = 0.0;
///         for chunk in self.0.chunks_exact(T::LANES) {
///             let doubled = T::load(chunk) * T::splat(2.0);
///             total += (0..T::LANES).map(|i| doubled.lane(i)).sum::<f64>();
///         }
///         total
///     }
/// }
/// assert_eq!(dispatch(Sum(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0])), 72.0);
/// ```
pub trait Kernel {
    /// What the kernel returns.
    type Out;
    /// Does the work on lanes of type `T`.
    fn run<T: Real>(self) -> Self::Out;
}

/// The feature-enabled functions of one tier: `$run` for a kernel of any lane
/// type, `$outline` for one that is already typed.
macro_rules! shells {
    ($run:ident, $outline:ident, $lane:ty, $features:literal) => {
        #[target_feature(enable = $features)]
        fn $run<K: Kernel>(k: K) -> K::Out {
            k.run::<$lane>()
        }

        #[target_feature(enable = $features)]
        #[inline(never)]
        pub(super) fn $outline<K: LaneKernel<$lane>>(k: K) -> K::Out {
            k.run()
        }
    };
}

#[cfg(target_arch = "x86_64")]
shells!(run_avx512, outline_avx512, Lane512, "avx512f,avx512dq,avx512vl,avx2,fma");
#[cfg(target_arch = "x86_64")]
shells!(run_avx2, outline_avx2, Pair256, "avx2,fma");
// The oracle compiled with the fused instruction: the same bits as the call
// into the mathematics library that it otherwise becomes, without the call.
#[cfg(target_arch = "x86_64")]
shells!(run_scalar, outline_scalar_fma, f64, "avx2,fma");
#[cfg(target_arch = "x86_64")]
shells!(run_twice_fma, outline_twice_fma, Twice, "avx2,fma");

#[inline(never)]
fn run_baseline<K: Kernel>(k: K) -> K::Out {
    k.run::<Array8>()
}

/// What is left where the CPU has neither tier. On an x86-64 without AVX2 each lane of a
/// fused multiply-add is a call, as for one number at a time, whose copies of the kernels
/// are half as large as those of arrays (all kernels together: 3.2 MB, not 3.8).
#[cfg(target_arch = "x86_64")]
#[inline(never)]
fn run_last<K: Kernel>(k: K) -> K::Out {
    k.run::<f64>()
}
#[cfg(not(target_arch = "x86_64"))]
use run_baseline as run_last;

/// [`Real::outline`] of `f64`.
#[inline(never)]
pub(crate) fn outline_scalar<K: LaneKernel<f64>>(k: K) -> K::Out {
    #[cfg(target_arch = "x86_64")]
    if Tier::Scalar.available() {
        // SAFETY: avx2 and fma were detected just above.
        return unsafe { outline_scalar_fma(k) };
    }
    k.run()
}

/// [`Real::outline`] of numbers in twice the precision.
#[inline(never)]
pub(crate) fn outline_twice<K: LaneKernel<Twice>>(k: K) -> K::Out {
    #[cfg(target_arch = "x86_64")]
    if Tier::Scalar.available() {
        // SAFETY: avx2 and fma were detected just above.
        return unsafe { outline_twice_fma(k) };
    }
    k.run()
}

/// Runs `k` on one number in twice the precision: for what eight lanes could
/// not do.
pub(crate) fn dispatch_twice<K: Kernel>(k: K) -> K::Out {
    #[cfg(target_arch = "x86_64")]
    if Tier::Scalar.available() {
        // SAFETY: avx2 and fma were detected just above.
        return unsafe { run_twice_fma(k) };
    }
    k.run::<Twice>()
}

/// The oracle where the target itself has a fused instruction.
#[cfg(not(target_arch = "x86_64"))]
fn run_scalar<K: Kernel>(k: K) -> K::Out {
    k.run::<f64>()
}

/// Runs `k` on the fastest tier of this CPU, see [`Tier::best`].
pub fn dispatch<K: Kernel>(k: K) -> K::Out {
    match Tier::best() {
        // SAFETY: `best` returns a tier only if it is available: avx2 and fma
        // were detected, and for the second arm avx512f, avx512dq, avx512vl.
        #[cfg(target_arch = "x86_64")]
        Tier::Avx2 => unsafe { run_avx2(k) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        Tier::Avx512 => unsafe { run_avx512(k) },
        _ => run_last(k),
    }
}

/// Runs `k` on the given tier, or returns `None` if this CPU lacks it: for
/// tests and measurements.
pub fn dispatch_on<K: Kernel>(tier: Tier, k: K) -> Option<K::Out> {
    if !tier.available() {
        return None;
    }
    Some(match tier {
        // SAFETY: available, so avx2 and fma were detected.
        #[cfg(target_arch = "x86_64")]
        Tier::Scalar => unsafe { run_scalar(k) },
        #[cfg(not(target_arch = "x86_64"))]
        Tier::Scalar => run_scalar(k),
        Tier::Baseline => run_baseline(k),
        // SAFETY: available, so avx2 and fma were detected.
        #[cfg(target_arch = "x86_64")]
        Tier::Avx2 => unsafe { run_avx2(k) },
        // SAFETY: available, so avx512f, avx512dq, avx512vl, avx2 and fma were
        // detected.
        #[cfg(target_arch = "x86_64")]
        Tier::Avx512 => unsafe { run_avx512(k) },
        #[cfg(not(target_arch = "x86_64"))]
        Tier::Avx2 | Tier::Avx512 => return None,
    })
}
