//! Where a rival may come below the winner between two grid points, judged by parabolas.

use crate::eip::root;
use crate::real::{Mask, Real};
use crate::simd::{self, Kernel};

/// A dip is looked for where a parabola takes a rival to this share of its lead.
const DIP: f64 = 0.25;
/// The parabola's minimum may lie this share of a cell outside of it.
const BESIDE: f64 = 0.2;

/// A grid point and Upsilon of every model there.
pub(crate) type Row<'a> = (f64, &'a [f64]);

/// A cell that one model wins at both ends, with the grid points around it.
#[derive(Clone, Copy)]
pub(crate) struct Dips<'a> {
    pub(crate) winner: usize,
    pub(crate) before: Option<Row<'a>>,
    pub(crate) left: Row<'a>,
    pub(crate) right: Row<'a>,
    pub(crate) after: Option<Row<'a>>,
}

impl Dips<'_> {
    /// Whether the lead of the winner over some model is curved enough in the cell to come
    /// down to [`DIP`] of itself, whatever its slope: seldom, so that [`Dips::of`] need not
    /// look.
    ///
    /// ```text
    /// p - y <= c (reach h)^2  for the lead p at an end, y <= DIP p the least, c the bend
    /// ```
    pub(crate) fn any(&self) -> bool {
        let Self { left, right, .. } = *self;
        let reach = (1.0 + BESIDE) * (right.0 - left.0);
        // of the divided differences over the cell and from its nearer end outward
        let thirds = [
            self.before.map(|u| (u, left, -reach * reach / (right.0 - u.0))),
            self.after.map(|u| (u, right, reach * reach / (u.0 - left.0))),
        ];
        thirds
            .into_iter()
            .flatten()
            .any(|(third, near, scale)| simd::dispatch(Curved { dips: self, third, near, scale }))
    }

    /// Whether the lead of the winner over model `j` may vanish inside the cell.
    pub(crate) fn of(&self, j: usize) -> bool {
        let lead = |row: Row<'_>| (row.0, row.1[j] - row.1[self.winner]);
        let (p, q) = (lead(self.left), lead(self.right));
        let beside = BESIDE * (q.0 - p.0);
        let low = |third: Row<'_>| {
            root::vertex(p, q, lead(third)).is_some_and(|(x, y)| {
                x >= p.0 - beside && x <= q.0 + beside && y <= DIP * p.1.min(q.1)
            })
        };
        self.before.is_some_and(low) || self.after.is_some_and(low)
    }
}

/// The bend by one more point, which is beside `near`, for all models.
struct Curved<'a> {
    dips: &'a Dips<'a>,
    third: Row<'a>,
    near: Row<'a>,
    scale: f64,
}

impl Kernel for Curved<'_> {
    type Out = bool;

    #[inline(always)]
    fn run<T: Real>(self) -> bool {
        let Curved { dips, third, near, scale } = self;
        let (left, right) = (dips.left.1, dips.right.1);
        let own = |row: &[f64]| T::splat(row[dips.winner]);
        let (own_left, own_right) = (own(left), own(right));
        let (own_near, own_third) = (own(near.1), own(third.1));
        let slope = T::splat(1.0 / (dips.right.0 - dips.left.0));
        let outward = T::splat(1.0 / (third.0 - near.0));
        let (scale, share) = (T::splat(scale), T::splat(0.99 * (1.0 - DIP)));
        let mut curved = T::Mask::splat(false);
        let last = left.len().saturating_sub(T::LANES);
        let mut first = 0;
        while left.len() >= T::LANES {
            let (p, q) = (T::load(&left[first..]) - own_left, T::load(&right[first..]) - own_right);
            let r = T::load(&third.1[first..]) - own_third;
            let n = T::load(&near.1[first..]) - own_near;
            let bend = (r - n) * outward - (q - p) * slope;
            // not for the winner itself and its duplicates, which are level with it
            curved = curved | (bend * scale).gt(share * p.min(q));
            if first == last {
                return curved.any();
            }
            // the last lane overlaps
            first = last.min(first + T::LANES);
        }
        // too few for a lane: they are looked at one by one
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Leads of rivals `a (x - c)^2 + d`, at most one of which comes down.
    #[test]
    fn no_dip_is_screened_out() {
        let lead = |k: usize, x: f64| {
            let (a, c, d) = [(0.5, -2.0, 0.1), (30.0, 0.4, 0.02), (-1.0, 0.5, 9.0)][k % 3];
            a * (x - c) * (x - c) + d
        };
        for models in [2, 5, 8, 9, 16, 21] {
            let row = |x: f64, steep: usize| -> Vec<f64> {
                let of = |j: usize| lead(if j == steep { 1 } else { 2 * (j % 2) }, x);
                (0..models).map(|j| if j == models / 2 { 7.0 } else { 7.0 + of(j) }).collect()
            };
            for steep in 0..=models {
                let rows: Vec<Vec<f64>> = (-1..=2).map(|k| row(f64::from(k), steep)).collect();
                let dips = Dips {
                    winner: models / 2,
                    before: Some((-1.0, &rows[0])),
                    left: (0.0, &rows[1]),
                    right: (1.0, &rows[2]),
                    after: Some((2.0, &rows[3])),
                };
                let found: Vec<usize> =
                    (0..models).filter(|&j| j != models / 2 && dips.of(j)).collect();
                let one = steep < models && steep != models / 2;
                assert_eq!(found, if one { vec![steep] } else { Vec::new() }, "{models}");
                assert!(!one || dips.any(), "{models} {steep}");
                assert!(one || models < 8 || !dips.any(), "{models} {steep}");
            }
        }
    }
}
