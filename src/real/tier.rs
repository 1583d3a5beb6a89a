//! The instruction sets a lane can stand on.

use std::sync::OnceLock;

/// An instruction set that kernels are compiled for.
///
/// Ordered from the slowest to the fastest. Results do not depend on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Tier {
    /// Plain `f64`, one number at a time: the oracle of all others, compiled
    /// with the fused instruction (on x86-64 it needs AVX2 and FMA).
    Scalar,
    /// Whatever the target guarantees: arrays of eight `f64`. ([`dispatch`] takes one number
    /// at a time instead on x86-64, where each lane of a fused multiply-add is a call.)
    ///
    /// [`dispatch`]: crate::simd::dispatch
    Baseline,
    /// A pair of 256-bit registers (AVX2 and FMA).
    Avx2,
    /// One 512-bit register (AVX-512 F, DQ and VL).
    Avx512,
}

impl Tier {
    /// Every tier, slowest first.
    pub const ALL: [Tier; 4] = [Tier::Scalar, Tier::Baseline, Tier::Avx2, Tier::Avx512];

    /// The name, as `MMAE_TIER` and reports spell it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Tier::Scalar => "scalar",
            Tier::Baseline => "baseline",
            Tier::Avx2 => "avx2",
            Tier::Avx512 => "avx512",
        }
    }

    /// The tier called `name`.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Tier> {
        Tier::ALL.into_iter().find(|t| t.name() == name)
    }

    /// True if this CPU (and operating system) runs the tier.
    #[must_use]
    pub fn available(self) -> bool {
        match self {
            Tier::Baseline => true,
            #[cfg(target_arch = "x86_64")]
            Tier::Scalar | Tier::Avx2 => {
                is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")
            }
            #[cfg(target_arch = "x86_64")]
            Tier::Avx512 => {
                Tier::Avx2.available()
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512vl")
            }
            #[cfg(not(target_arch = "x86_64"))]
            Tier::Scalar => true,
            #[cfg(not(target_arch = "x86_64"))]
            Tier::Avx2 | Tier::Avx512 => false,
        }
    }

    /// The fastest tier of this CPU, found once.
    ///
    /// The environment variable `MMAE_TIER` (`avx512`, `avx2` or `baseline`),
    /// read at the first call, lowers it: for measuring, and for running on one
    /// machine what another one would. Any other value, or a tier that this CPU
    /// lacks, is ignored. [`Tier::Scalar`] is never the best.
    #[must_use]
    pub fn best() -> Tier {
        static BEST: OnceLock<Tier> = OnceLock::new();
        *BEST.get_or_init(|| {
            let wanted = std::env::var("MMAE_TIER").ok();
            let wanted = wanted.and_then(|name| Tier::from_name(name.trim()));
            let ceiling = match wanted {
                None | Some(Tier::Scalar) => Tier::Avx512,
                Some(tier) if !tier.available() => Tier::Avx512,
                Some(tier) => tier,
            };
            let mut fastest_first = Tier::ALL.into_iter().rev();
            let best = fastest_first.find(|&t| t <= ceiling && t.available());
            best.unwrap_or(Tier::Baseline)
        })
    }
}

impl std::fmt::Display for Tier {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}
