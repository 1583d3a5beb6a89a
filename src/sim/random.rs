//! Normal random numbers, one stream a trial, eight trials at once.

use crate::real::{Real, minus_two_ln, sin_cos_octant};
use crate::simd::{Block, LANES, groups};

/// The increment of [`SplitMix64`]: `2^64 / golden ratio`, odd.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// The generator that seeds the others.
///
/// # Source
/// Steele, Lea, Flood (2014), OOPSLA, with the constants of Vigna's splitmix64.c.
#[derive(Debug, Clone)]
pub struct SplitMix64(pub u64);

impl SplitMix64 {
    /// The next word.
    pub fn word(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(GOLDEN);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
}

/// Eight streams of random numbers, for eight trials that follow each other.
///
/// The words are those of xoshiro256++. A stream depends on the seed and the
/// number of its trial alone, so that a trial is the same in whatever company it
/// is run.
///
/// ```
/// use mmae::sim::Streams;
/// let mut all = Streams::new(7, 0);
/// let mut late = Streams::new(7, 3);
/// assert_eq!(all.words()[3..], late.words()[..5]);
/// ```
///
/// # Source
/// Blackman, Vigna (2021), ACM Transactions on Mathematical Software 47, 36.
#[derive(Debug, Clone)]
pub struct Streams {
    state: [[u64; LANES]; 4],
}

impl Streams {
    /// The streams of trials `first` to `first + 7`.
    pub fn new(seed: u64, first: u64) -> Self {
        let base = SplitMix64(seed).word();
        let mut state = [[0; LANES]; 4];
        for l in 0..LANES {
            // scrambled, or neighbours would share words of their states
            let trial = SplitMix64(base ^ first.wrapping_add(l as u64)).word();
            let mut seeder = SplitMix64(trial);
            for word in &mut state {
                word[l] = seeder.word();
            }
        }
        Self { state }
    }

    /// Streams in the given states, word by word; none of them all zero.
    pub fn from_state(state: [[u64; LANES]; 4]) -> Self {
        Self { state }
    }

    /// The next word of each stream.
    #[inline(always)]
    pub fn words(&mut self) -> [u64; LANES] {
        let [a, _, _, d] = &self.state;
        let mut out = [0; LANES];
        for l in 0..LANES {
            out[l] = a[l].wrapping_add(d[l]).rotate_left(23).wrapping_add(a[l]);
        }
        self.uniforms();
        out
    }

    /// Uniform numbers in (0, 1): odd multiples of `2^-53`.
    #[inline(always)]
    pub fn uniforms(&mut self) -> [f64; LANES] {
        let mut out = [0.0; LANES];
        for l in 0..LANES {
            out[l] = f64::uniform(&mut self.state, l);
        }
        out
    }

    /// Standard normal numbers, two a turn (an odd last block takes a turn of its
    /// own); the same bits for every `T`.
    ///
    /// ```text
    /// rho = sqrt(-2 ln u_1),   z_1 = rho cos(2 pi u_2),   z_2 = rho sin(2 pi u_2)
    /// ```
    ///
    /// # Source
    /// Box, Muller (1958), Annals of Mathematical Statistics 29, 610-611.
    #[inline(always)]
    pub fn normals<T: Real>(&mut self, out: &mut [Block]) {
        // Step by step over all of them: one number takes more instructions than the
        // processor looks ahead, and would wait for its own.
        for group in 0..groups::<T>() {
            let lanes = group * T::LANES;
            // a copy of its own stays in registers
            let mut state = self.state;
            for block in &mut *out {
                T::uniform(&mut state, lanes).store(&mut block.0[lanes..]);
            }
            self.state = state;
            let (pairs, rest) = out.as_chunks_mut::<2>();
            for [first, _] in &mut *pairs {
                radius(T::load(&first.0[lanes..])).store(&mut first.0[lanes..]);
            }
            for [first, second] in pairs {
                let rho = T::load(&first.0[lanes..]);
                let (c, s) = direction(T::load(&second.0[lanes..]));
                (rho * c).store(&mut first.0[lanes..]);
                (rho * s).store(&mut second.0[lanes..]);
            }
            for last in rest {
                let rho = radius(T::load(&last.0[lanes..]));
                let (c, _) = direction(T::uniform(&mut self.state, lanes));
                (rho * c).store(&mut last.0[lanes..]);
            }
        }
    }
}

/// `sqrt(-2 ln u)`.
#[inline(always)]
fn radius<T: Real>(u: T) -> T {
    minus_two_ln(u).sqrt()
}

/// `cos 2 pi t` and `sin 2 pi t` for a uniform number `t`, by the octant: every difference
/// is exact.
///
/// ```text
/// a = 1/2 - t,  b = |a| - 1/4:   cos 2 pi t = sin 2 pi b,  sin 2 pi t = sign(a) cos 2 pi b
/// |b| or 1/4 - |b|, whichever is smaller, and sine and cosine exchanged for the latter
/// ```
#[inline(always)]
fn direction<T: Real>(t: T) -> (T, T) {
    let a = T::splat(0.5) - t;
    let b = a.abs() - T::splat(0.25);
    let size = b.abs();
    let octant = size.min(T::splat(0.25) - size);
    let (sine, cosine) = sin_cos_octant(octant * T::splat(std::f64::consts::TAU));
    let exchanged = size.gt(T::splat(0.125));
    let (s, c) = (T::select(exchanged, cosine, sine), T::select(exchanged, sine, cosine));
    (s.copysign(b), c.copysign(a))
}

#[cfg(test)]
mod tests {
    use super::direction;

    #[test]
    fn turns_are_angles() {
        for k in 0..100_000_u64 {
            let t = (k.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 11) as f64 * 2f64.powi(-53);
            let (c, s) = direction::<f64>(t);
            let angle = std::f64::consts::TAU * t;
            // the rounding of the angle, and of the result
            assert!((s - libm::sin(angle)).abs() < 1e-15, "{t}");
            assert!((c - libm::cos(angle)).abs() < 1e-15, "{t}");
            assert!((s.mul_add(s, c * c) - 1.0).abs() < 5e-16, "{t}");
        }
    }
}
