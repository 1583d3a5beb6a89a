//! A function of many numbers of one problem.

use super::{Block, Kernel, LANES, dispatch, groups};
use crate::real::{Real, exp};

/// [`Real::exp_each`] of `f64`: eight at a time, which gives the bits of one at a time.
pub(crate) fn exp_each(numbers: &mut [f64]) {
    dispatch(ExpEach(numbers));
}

struct ExpEach<'a>(&'a mut [f64]);

impl Kernel for ExpEach<'_> {
    type Out = ();

    #[inline(always)]
    fn run<T: Real>(self) {
        let (blocks, rest) = self.0.as_chunks_mut::<LANES>();
        for block in blocks {
            exp_block::<T>(block);
        }
        if !rest.is_empty() {
            let mut block = Block::default();
            block.0[..rest.len()].copy_from_slice(rest);
            exp_block::<T>(&mut block.0);
            rest.copy_from_slice(&block.0[..rest.len()]);
        }
    }
}

#[inline(always)]
fn exp_block<T: Real>(block: &mut [f64; LANES]) {
    for group in 0..groups::<T>() {
        let lanes = &mut block[group * T::LANES..];
        exp(T::load(lanes)).store(lanes);
    }
}

#[cfg(test)]
mod tests {
    use super::exp_each;
    use crate::real::exp;

    #[test]
    fn the_bits_of_one_at_a_time() {
        for len in 0..40 {
            let x: Vec<f64> = (0..len).map(|k| 300.0 * f64::from(k * k).sin()).collect();
            let want: Vec<f64> = x.iter().map(|&x| exp(x)).collect();
            let mut got = x;
            exp_each(&mut got);
            assert_eq!(got, want);
        }
        let mut odd = [f64::NAN, f64::NEG_INFINITY, 0.0, f64::INFINITY, -745.0, 710.0];
        exp_each(&mut odd);
        assert!(odd[0].is_nan() && odd[1] == 0.0 && odd[2] == 1.0 && odd[3] == f64::INFINITY);
        assert!(odd[4] == exp(-745.0) && odd[5] == f64::INFINITY);
    }
}
