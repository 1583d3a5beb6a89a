//! Refinement: the plants of a slab that are worth computing.
//!
//! Cells of at most [`WIDEST`] steps a side are judged at their corners. Where
//! one model wins at all corners, by a lead that does not shrink fast, it is
//! taken to win inside; elsewhere the cell is halved along every side. A cell in
//! whose hull a neighbour finds another verdict is taken up again.

use crate::eip::collect::{All, Seen};
use crate::eip::judge::{Judge, Judged, Judgement};
use crate::eip::sets::{self, Verdict};
use crate::error::Result;
use crate::par::RunControl;

/// Steps of the grid along the side of the largest cells.
const WIDEST: usize = 8;
/// The lead at the corners must be above this share of its variation over them.
const SHARE: f64 = 0.25;

/// A box of the slab by its first and last index along each axis.
type Cell = Vec<(usize, usize)>;

/// What is known of a slab meanwhile.
struct Slab<'j, 'a> {
    judge: &'j mut Judge<'a>,
    first: usize,
    shape: &'j [usize],
    /// Upsilon, plants by models.
    upsilon: Vec<f64>,
    judged: Vec<Option<Judged>>,
}

/// Judges the plants of the slab of lengths `shape` from plant `first` of the
/// grid on, as many as it takes.
///
/// # Errors
/// A mistake in the study, `Cancelled`.
pub(crate) fn refine(
    judge: &mut Judge<'_>,
    first: usize,
    shape: &[usize],
    control: &RunControl<'_>,
) -> Result<All> {
    let count: usize = shape.iter().product();
    let upsilon = vec![f64::NAN; count * judge.same.len()];
    let judged = (0..count).map(|_| None).collect();
    let mut slab = Slab { judge, first, shape, upsilon, judged };
    let mut cells = coarse(shape);
    let mut settled: Vec<(Cell, usize)> = Vec::new();
    // those computed by both routes are computed in any case
    let mut wanted = slab.judge.checked(first..first + count);
    while !cells.is_empty() {
        wanted.extend(cells.iter().flat_map(corners).map(|at| first + slab.index(&at)));
        slab.compute(std::mem::take(&mut wanted), control)?;
        let mut next = Vec::new();
        for cell in cells {
            match slab.winner(&cell) {
                Some(winner) => settled.push((cell, winner)),
                None => next.extend(halves(&cell)),
            }
        }
        settled.retain(|(cell, winner)| {
            let sound = slab.agrees(cell, *winner);
            if !sound {
                next.extend(halves(cell));
            }
            sound
        });
        cells = next;
    }
    let mut inferred = vec![None; count];
    for (cell, winner) in &settled {
        for at in points(cell, |_| 1) {
            inferred[slab.index(&at)] = Some(*winner);
        }
    }
    // a plant in no settled cell is the corner of one that could not be halved
    let seen = slab
        .judged
        .into_iter()
        .zip(inferred)
        .filter_map(|(judged, winner)| judged.map(Seen::Judged).or(winner.map(Seen::Inferred)));
    Ok(All { upsilon: slab.upsilon, seen: seen.collect() })
}

impl Slab<'_, '_> {
    fn index(&self, at: &[usize]) -> usize {
        at.iter().zip(self.shape).fold(0, |k, (i, len)| k * len + i)
    }

    /// Judges those of `plants` (of the grid) that have not been yet.
    fn compute(&mut self, mut plants: Vec<usize>, control: &RunControl<'_>) -> Result<()> {
        plants.retain(|k| self.judged[k - self.first].is_none());
        plants.sort_unstable();
        plants.dedup();
        let Judgement { upsilon, plants: judged } = self.judge.judge(&plants, control)?;
        let models = self.judge.same.len();
        for ((k, judged), row) in plants.into_iter().zip(judged).zip(upsilon.chunks(models)) {
            let at = k - self.first;
            self.upsilon[at * models..][..models].copy_from_slice(row);
            self.judged[at] = Some(judged);
        }
        Ok(())
    }

    /// Upsilon of the plant of this index.
    fn row(&self, index: usize) -> &[f64] {
        let models = self.judge.same.len();
        &self.upsilon[index * models..][..models]
    }

    fn verdict(&self, at: &[usize]) -> Option<Verdict> {
        let index = self.index(at);
        let judged = self.judged[index].as_ref()?;
        Some(self.judge.verdict(self.row(index), judged))
    }

    /// The model that wins all over the cell, as far as its corners show.
    fn winner(&self, cell: &Cell) -> Option<usize> {
        let mut rows: Vec<&[f64]> = Vec::new();
        let mut winner = None;
        for at in corners(cell) {
            let index = self.index(&at);
            let Some(Ok(_)) = &self.judged[index] else { return None };
            let found = self.verdict(&at)?.winner()?;
            if *winner.get_or_insert(found) != found {
                return None;
            }
            rows.push(self.row(index));
        }
        let winner = winner?;
        let rivals = self.judge.engine.designed.iter();
        for &i in rivals.filter(|&&i| !sets::is_same(winner, i, &self.judge.same)) {
            let leads = rows.iter().map(|row| row[i] - row[winner]);
            let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
            for lead in leads {
                (least, most) = (least.min(lead), most.max(lead));
            }
            if least.is_nan() || least <= SHARE * (most - least) {
                return None;
            }
        }
        Some(winner)
    }

    /// Whether every plant of the cell that was judged has this winner.
    fn agrees(&self, cell: &Cell, winner: usize) -> bool {
        points(cell, |_| 1)
            .all(|at| self.verdict(&at).is_none_or(|verdict| verdict == Verdict::Winner(winner)))
    }
}

/// The largest cells of a slab.
fn coarse(shape: &[usize]) -> Vec<Cell> {
    let sides = shape.iter().map(|&len| -> Vec<(usize, usize)> {
        let last = len - 1;
        let pieces = last.div_ceil(WIDEST).max(1);
        (0..pieces).map(|p| (last * p / pieces, last * (p + 1) / pieces)).collect()
    });
    product(sides)
}

/// The cell halved along every side that is longer than one step; nothing for a
/// cell that is all corners.
fn halves(cell: &Cell) -> Vec<Cell> {
    if cell.iter().all(|(from, to)| to - from <= 1) {
        return Vec::new();
    }
    let sides = cell.iter().map(|&(from, to)| {
        let middle = from.midpoint(to);
        if to - from <= 1 { vec![(from, to)] } else { vec![(from, middle), (middle, to)] }
    });
    product(sides)
}

fn corners(cell: &Cell) -> impl Iterator<Item = Vec<usize>> {
    points(cell, |&(from, to)| (to - from).max(1))
}

/// Points of a cell, every `step` along each side.
fn points(
    cell: &Cell,
    step: impl Fn(&(usize, usize)) -> usize,
) -> impl Iterator<Item = Vec<usize>> {
    let sides: Vec<(usize, usize, usize)> =
        cell.iter().map(|side| (side.0, side.1, step(side))).collect();
    let counts: Vec<usize> = sides.iter().map(|(from, to, by)| (to - from) / by + 1).collect();
    (0..counts.iter().product()).map(move |mut k: usize| {
        let mut at = vec![0; sides.len()];
        for axis in (0..sides.len()).rev() {
            at[axis] = sides[axis].0 + k % counts[axis] * sides[axis].2;
            k /= counts[axis];
        }
        at
    })
}

fn product(sides: impl Iterator<Item = Vec<(usize, usize)>>) -> Vec<Cell> {
    sides.fold(vec![Cell::new()], |cells, pieces| {
        let longer = |cell: Cell| {
            let cell = &cell;
            let with = |&piece| cell.iter().copied().chain([piece]).collect();
            pieces.iter().map(with).collect::<Vec<Cell>>()
        };
        cells.into_iter().flat_map(longer).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_cover_a_slab_and_share_their_faces() {
        let cells = coarse(&[20, 1, 9]);
        assert_eq!(cells.len(), 3);
        assert_eq!(cells[0], [(0, 6), (0, 0), (0, 8)]);
        assert_eq!(cells[2], [(12, 19), (0, 0), (0, 8)]);
        assert_eq!(corners(&cells[0]).count(), 4);
        assert_eq!(points(&cells[0], |_| 1).count(), 63);
        let parts = halves(&cells[0]);
        assert_eq!(parts.len(), 4);
        assert_eq!(parts[3], [(3, 6), (0, 0), (4, 8)]);
        assert!(halves(&vec![(3, 4), (2, 2), (7, 8)]).is_empty());
    }
}
