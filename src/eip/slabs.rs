//! A grid cut into slabs: runs of consecutive plants that are boxes as well.

use std::ops::Range;

use crate::model::Grid;

/// Slabs of a grid.
///
/// The last axes lie in a slab whole, one axis in part, the first ones with one
/// value each. So a slab is consecutive on the grid, and has neighbours in it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Slabs {
    /// Values of the first axes, multiplied.
    lead: usize,
    /// Values of the axis that is cut, and how many of them a slab has at most.
    cut: usize,
    rows: usize,
    /// Lengths of the axes that a slab has whole.
    whole: Vec<usize>,
}

impl Slabs {
    /// Slabs of at most `plants` plants (at least one).
    pub(crate) fn new(grid: &Grid, plants: usize) -> Self {
        let lengths: Vec<usize> = grid.axes().iter().map(|(_, axis)| axis.len()).collect();
        let mut at = lengths.len() - 1;
        let mut inner = 1;
        while at > 0 && inner * lengths[at] <= plants {
            inner *= lengths[at];
            at -= 1;
        }
        let cut = lengths[at];
        // slabs of an axis are as equal as can be
        let pieces = cut.div_ceil((plants / inner).clamp(1, cut));
        Self {
            lead: lengths[..at].iter().product(),
            cut,
            rows: cut.div_ceil(pieces),
            whole: lengths[at + 1..].to_vec(),
        }
    }

    /// Number of slabs.
    pub(crate) fn len(&self) -> usize {
        self.lead * self.pieces()
    }

    fn pieces(&self) -> usize {
        self.cut.div_ceil(self.rows)
    }

    /// Plants of slab `k`.
    pub(crate) fn plants(&self, k: usize) -> Range<usize> {
        let inner: usize = self.whole.iter().product();
        let (lead, piece) = (k / self.pieces(), k % self.pieces());
        let from = piece * self.rows;
        let to = (from + self.rows).min(self.cut);
        (lead * self.cut + from) * inner..(lead * self.cut + to) * inner
    }

    /// Lengths of slab `k` along its axes, the last one fastest.
    pub(crate) fn shape(&self, k: usize) -> Vec<usize> {
        let inner: usize = self.whole.iter().product();
        let mut shape = vec![self.plants(k).len() / inner];
        shape.extend(&self.whole);
        shape
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Axis;

    fn grid(lengths: &[usize]) -> Grid {
        let axis = |(i, &points): (usize, &usize)| {
            (format!("p{i}"), Axis::Linear { from: 0.0, to: 1.0 + points as f64, points })
        };
        Grid::new(lengths.iter().enumerate().map(axis).collect()).unwrap()
    }

    #[test]
    fn slabs_hold_every_plant_once_in_order() {
        for (lengths, most) in [
            (vec![17], 5),
            (vec![3, 100], 40),
            (vec![100, 3], 40),
            (vec![7, 5, 4], 20),
            (vec![7, 5, 4], 19),
            (vec![2, 2, 2, 2, 2, 3], 1),
            (vec![2, 3], 1000),
        ] {
            let grid = grid(&lengths);
            let slabs = Slabs::new(&grid, most);
            let mut next = 0;
            for k in 0..slabs.len() {
                let plants = slabs.plants(k);
                assert!(plants.start == next && !plants.is_empty() && plants.len() <= most);
                assert_eq!(slabs.shape(k).iter().product::<usize>(), plants.len());
                next = plants.end;
            }
            assert_eq!(next, grid.len(), "{lengths:?}");
        }
        assert_eq!(Slabs::new(&grid(&[9, 100]), 40).shape(0), [34]);
        assert_eq!(Slabs::new(&grid(&[9, 10]), 40).shape(0), [3, 10]);
    }
}
