//! Regions of a plane and the lines between them, from values at the nodes of a
//! mesh.
//!
//! Along an edge whose ends have different winners the line crosses where the
//! two curves are equal, taken as straight between the nodes. A cell with two
//! crossings is cut in two; one with more is cut at a point inside, or, where
//! one winner has two opposite corners, at the other two.

/// A point of the picture.
pub(super) type Point = (f64, f64);

/// Values at the nodes of a rectangular mesh.
pub(super) struct Mesh<'a> {
    /// Pixels of the columns and rows of nodes.
    pub(super) xs: &'a [f64],
    pub(super) ys: &'a [f64],
    /// Winner at a node (column, row).
    pub(super) winner: &'a dyn Fn(usize, usize) -> Option<usize>,
    /// `value(column, row, i)`: of which the winner has the smallest.
    pub(super) value: &'a dyn Fn(usize, usize, usize) -> f64,
}

/// What a cell consists of.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Cell {
    pub(super) faces: Vec<Face>,
    pub(super) lines: Vec<[Point; 2]>,
}

/// A part of a cell.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Face {
    /// The corner (of four) that it begins with, and how many it has.
    pub(super) corners: (usize, usize),
    pub(super) outline: Vec<Point>,
}

/// Columns and rows of the corners of cell (`c`, `r`), around it.
pub(super) fn corners(c: usize, r: usize) -> [(usize, usize); 4] {
    [(c, r), (c + 1, r), (c + 1, r + 1), (c, r + 1)]
}

impl Mesh<'_> {
    /// The faces of the cell whose first corner is node (`c`, `r`).
    pub(super) fn cell(&self, c: usize, r: usize) -> Cell {
        let nodes = corners(c, r);
        let winners = nodes.map(|(c, r)| (self.winner)(c, r));
        // crossing on the edge from corner i to the next
        let crossings: [Option<Point>; 4] = std::array::from_fn(|i| {
            let next = (i + 1) % 4;
            (winners[i] != winners[next]).then(|| self.crossing(nodes[i], nodes[next]))
        });
        let cuts: Vec<Point> = crossings.iter().flatten().copied().collect();
        let node = |i: usize| (self.xs[nodes[i % 4].0], self.ys[nodes[i % 4].1]);
        if cuts.is_empty() {
            let outline = (0..4).map(node).collect();
            return Cell { faces: vec![Face { corners: (0, 4), outline }], lines: Vec::new() };
        }
        if let Some(through) = self.saddle(&winners, nodes) {
            return saddle(through, node, &crossings);
        }
        let junction = (cuts.len() > 2).then(|| mean(&cuts));
        let mut cell = Cell::default();
        for first in (0..4).filter(|first| crossings[(first + 3) % 4].is_some()) {
            // corners of one winner, from one crossing to the next
            let count = (1..=4).find(|n| crossings[(first + n - 1) % 4].is_some()).unwrap_or(4);
            let mut outline: Vec<Point> = crossings[(first + 3) % 4].into_iter().collect();
            outline.extend((first..first + count).map(node));
            outline.extend(crossings[(first + count - 1) % 4]);
            outline.extend(junction);
            cell.faces.push(Face { corners: (first, count), outline });
        }
        match junction {
            Some(junction) => cell.lines.extend(cuts.iter().map(|&cut| [cut, junction])),
            None => cell.lines.push([cuts[0], cuts[1]]),
        }
        cell
    }

    /// Where the line between two neighbours with different winners crosses.
    fn crossing(&self, from: (usize, usize), to: (usize, usize)) -> Point {
        let lead = |at: (usize, usize), own: Option<usize>, rival: Option<usize>| match (own, rival)
        {
            (Some(own), Some(rival)) => {
                (self.value)(at.0, at.1, rival) - (self.value)(at.0, at.1, own)
            }
            _ => f64::NAN,
        };
        let (a, b) = ((self.winner)(from.0, from.1), (self.winner)(to.0, to.1));
        let (start, end) = (lead(from, a, b).abs(), lead(to, b, a).abs());
        let share = start / (start + end);
        // one of the two has no winner, or neither leads
        let share = if share.is_finite() { share } else { 0.5 };
        let between = |p: f64, q: f64| p + share * (q - p);
        (between(self.xs[from.0], self.xs[to.0]), between(self.ys[from.1], self.ys[to.1]))
    }

    /// The first of two opposite corners whose winner goes through the cell,
    /// where all edges are crossed and opposite corners have one winner.
    fn saddle(&self, winners: &[Option<usize>; 4], nodes: [(usize, usize); 4]) -> Option<usize> {
        let all = (0..4).all(|i| winners[i] != winners[(i + 1) % 4]);
        let pairs = [winners[0] == winners[2], winners[1] == winners[3]];
        match (all, pairs) {
            (true, [true, false]) => Some(0),
            (true, [false, true]) => Some(1),
            (true, [true, true]) => {
                let (Some(a), Some(b)) = (winners[0], winners[1]) else {
                    return Some(usize::from(winners[0].is_none()));
                };
                let lead: f64 =
                    nodes.iter().map(|&(c, r)| (self.value)(c, r, b) - (self.value)(c, r, a)).sum();
                Some(usize::from(lead < 0.0))
            }
            _ => None,
        }
    }
}

/// A cell whose corner `through` is joined with the opposite one.
fn saddle(through: usize, node: impl Fn(usize) -> Point, crossings: &[Option<Point>; 4]) -> Cell {
    let mut cell = Cell::default();
    let mut middle = Vec::new();
    for i in [through, through + 2] {
        let cut = |k: usize| crossings[k % 4].unwrap_or_else(|| node(k));
        middle.extend([cut(i + 3), node(i), cut(i)]);
        let corner = (i + 1) % 4;
        let outline = vec![cut(i), node(corner), cut(i + 1)];
        cell.lines.push([outline[0], outline[2]]);
        cell.faces.push(Face { corners: (corner, 1), outline });
    }
    cell.faces.push(Face { corners: (through, 1), outline: middle });
    cell
}

fn mean(points: &[Point]) -> Point {
    let n = points.len() as f64;
    let (x, y) = points.iter().fold((0.0, 0.0), |sum, p| (sum.0 + p.0, sum.1 + p.1));
    (x / n, y / n)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Area of a polygon.
    fn area(outline: &[Point]) -> f64 {
        let next = outline.iter().cycle().skip(1);
        0.5 * outline.iter().zip(next).map(|(p, q)| p.0 * q.1 - q.0 * p.1).sum::<f64>()
    }

    fn cell(values: [[f64; 3]; 4], lost: Option<usize>) -> Cell {
        let at = |c: usize, r: usize| match (c, r) {
            (0, 0) => 0,
            (1, 0) => 1,
            (1, 1) => 2,
            _ => 3,
        };
        let winner = |c: usize, r: usize| {
            let row = values[at(c, r)];
            let least = (0..3).min_by(|&i, &j| row[i].total_cmp(&row[j]));
            least.filter(|_| lost != Some(at(c, r)))
        };
        let value = |c: usize, r: usize, i: usize| values[at(c, r)][i];
        Mesh { xs: &[0.0, 1.0], ys: &[0.0, 1.0], winner: &winner, value: &value }.cell(0, 0)
    }

    #[test]
    fn faces_fill_a_cell_and_lines_lie_where_values_are_equal() {
        let far = 9.0;
        // equal at x = 1/4
        let two = cell([[0.0, 1.0, far], [3.0, 0.0, far], [3.0, 0.0, far], [0.0, 1.0, far]], None);
        assert_eq!(two.lines, [[(0.25, 0.0), (0.25, 1.0)]]);
        assert_eq!(two.faces.len(), 2);
        let three =
            cell([[0.0, 1.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 0.0], [0.0, 1.0, 1.0]], None);
        assert_eq!((three.faces.len(), three.lines.len()), (3, 3));
        let saddles =
            cell([[0.0, 2.0, far], [1.0, 0.0, far], [0.0, 2.0, far], [1.0, 0.0, far]], None);
        assert_eq!((saddles.faces.len(), saddles.lines.len()), (3, 2));
        let lost = cell([[0.0, 1.0, far]; 4], Some(2));
        assert_eq!(lost.lines, [[(1.0, 0.5), (0.5, 1.0)]]);
        let whole = cell([[0.0, 1.0, far]; 4], None);
        for found in [two, three, saddles, lost, whole] {
            let sum: f64 = found.faces.iter().map(|face| area(&face.outline)).sum();
            assert!((sum - 1.0).abs() < 1e-15, "{sum}");
            assert!(found.faces.iter().all(|face| area(&face.outline) > 0.0));
        }
    }
}
