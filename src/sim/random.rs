//! Normal random numbers, one stream a trial, eight trials at once.

use crate::real::{Real, ln_of_normal, sin_cos_turns};
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
        let mut at = 0;
        while at < out.len() {
            for group in 0..groups::<T>() {
                let lanes = group * T::LANES;
                let u = T::uniform(&mut self.state, lanes);
                let turn = T::uniform(&mut self.state, lanes);
                let rho = (T::splat(-2.0) * ln_of_normal(u)).sqrt();
                let (s, c) = sin_cos_turns(turn);
                (rho * c).store(&mut out[at].0[lanes..]);
                if at + 1 < out.len() {
                    (rho * s).store(&mut out[at + 1].0[lanes..]);
                }
            }
            at += 2;
        }
    }
}
