//! Regions of a plane and the lines between them, from values at the nodes of a
//! mesh.
//!
//! Along an edge whose ends have different winners the line crosses where the
//! two curves are equal, taken as straight between the nodes. A cell with two
//! crossings is cut in two; one with more is cut at a point inside, or, where
//! one winner has two opposite corners, at the other two.

/// A point of the picture.
pub(super) type Point = (f64, f64);
/// A point with the margin of its winner there.
pub(super) type Vertex = (Point, f64);

/// Values at the nodes of a rectangular mesh.
pub(super) struct Mesh<'a> {
    /// Pixels of the columns and rows of nodes.
    pub(super) xs: &'a [f64],
    pub(super) ys: &'a [f64],
    /// Winner at a node (column, row).
    pub(super) winner: &'a dyn Fn(usize, usize) -> Option<usize>,
    /// `value(column, row, i)`: of which the winner has the smallest.
    pub(super) value: &'a dyn Fn(usize, usize, usize) -> f64,
    /// By how much the winner leads at a node.
    pub(super) margin: &'a dyn Fn(usize, usize) -> f64,
}

/// The parts of a face between increasing `levels` of its values: the index of
/// each from the bottom, and its outline.
pub(super) fn bands(face: &[Vertex], levels: &[f64]) -> Vec<(usize, Vec<Point>)> {
    let mut found = Vec::new();
    for band in 0..=levels.len() {
        let mut part = face.to_vec();
        if band > 0 {
            part = clipped(&part, |v| v - levels[band - 1]);
        }
        if let Some(&top) = levels.get(band) {
            part = clipped(&part, |v| top - v);
        }
        if part.len() > 2 {
            found.push((band, part.into_iter().map(|(p, _)| p).collect()));
        }
    }
    found
}

/// The part of a polygon where `above` of the value is not negative (Sutherland
/// and Hodgman 1974).
fn clipped(polygon: &[Vertex], above: impl Fn(f64) -> f64) -> Vec<Vertex> {
    let mut part = Vec::new();
    let next = polygon.iter().cycle().skip(1);
    for (&(p, v), &(q, w)) in polygon.iter().zip(next) {
        let (here, there) = (above(v), above(w));
        if here >= 0.0 {
            part.push((p, v));
        }
        if (here >= 0.0) != (there >= 0.0) {
            let share = here / (here - there);
            // an end without a finite value
            let share = if share.is_finite() { share } else { 0.5 };
            let between = |a: f64, b: f64| a + share * (b - a);
            part.push(((between(p.0, q.0), between(p.1, q.1)), between(v, w)));
        }
    }
    part
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
    pub(super) winner: Option<usize>,
    pub(super) outline: Vec<Vertex>,
}

impl Face {
    /// Margins that are not known, next to a plant without winner, are those of
    /// the corners.
    fn new(winner: Option<usize>, mut outline: Vec<Vertex>) -> Self {
        let known: Vec<f64> = outline.iter().map(|v| v.1).filter(|m| !m.is_nan()).collect();
        let mean = known.iter().sum::<f64>() / known.len().max(1) as f64;
        for vertex in outline.iter_mut().filter(|v| v.1.is_nan()) {
            vertex.1 = mean;
        }
        Self { winner, outline }
    }
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
        let crossings: [Option<Vertex>; 4] = std::array::from_fn(|i| {
            let next = (i + 1) % 4;
            (winners[i] != winners[next]).then(|| self.crossing(nodes[i], nodes[next]))
        });
        let cuts: Vec<Vertex> = crossings.iter().flatten().copied().collect();
        let node = |i: usize| {
            let (c, r) = nodes[i % 4];
            ((self.xs[c], self.ys[r]), (self.margin)(c, r))
        };
        if cuts.is_empty() {
            let outline = (0..4).map(node).collect();
            return Cell { faces: vec![Face::new(winners[0], outline)], lines: Vec::new() };
        }
        if let Some(through) = self.saddle(&winners, nodes) {
            return saddle(through, &winners, node, &crossings);
        }
        let junction = (cuts.len() > 2).then(|| mean(&cuts));
        let mut cell = Cell::default();
        for first in (0..4).filter(|first| crossings[(first + 3) % 4].is_some()) {
            // corners of one winner, from one crossing to the next
            let count = (1..=4).find(|n| crossings[(first + n - 1) % 4].is_some()).unwrap_or(4);
            let mut outline: Vec<Vertex> = crossings[(first + 3) % 4].into_iter().collect();
            outline.extend((first..first + count).map(node));
            outline.extend(crossings[(first + count - 1) % 4]);
            outline.extend(junction);
            cell.faces.push(Face::new(winners[first], outline));
        }
        match junction {
            Some((junction, _)) => cell.lines.extend(cuts.iter().map(|cut| [cut.0, junction])),
            None => cell.lines.push([cuts[0].0, cuts[1].0]),
        }
        cell
    }

    /// Where the line between two neighbours with different winners crosses: a
    /// vertex without margin.
    fn crossing(&self, from: (usize, usize), to: (usize, usize)) -> Vertex {
        let (a, b) = ((self.winner)(from.0, from.1), (self.winner)(to.0, to.1));
        let mut share = f64::NAN;
        if let (Some(a), Some(b)) = (a, b) {
            let lead =
                |at: (usize, usize)| (self.value)(at.0, at.1, b) - (self.value)(at.0, at.1, a);
            share = lead(from) / (lead(from) - lead(to));
        }
        let margin = if a.is_some() && b.is_some() { 0.0 } else { f64::NAN };
        // one of the two has no winner, or neither leads
        let share = if (0.0..=1.0).contains(&share) { share } else { 0.5 };
        let between = |p: f64, q: f64| p + share * (q - p);
        let x = between(self.xs[from.0], self.xs[to.0]);
        ((x, between(self.ys[from.1], self.ys[to.1])), margin)
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
fn saddle(
    through: usize,
    winners: &[Option<usize>; 4],
    node: impl Fn(usize) -> Vertex,
    crossings: &[Option<Vertex>; 4],
) -> Cell {
    let mut cell = Cell::default();
    let mut middle = Vec::new();
    for i in [through, through + 2] {
        let cut = |k: usize| crossings[k % 4].unwrap_or_else(|| node(k));
        middle.extend([cut(i + 3), node(i), cut(i)]);
        let outline = vec![cut(i), node(i + 1), cut(i + 1)];
        cell.lines.push([outline[0].0, outline[2].0]);
        cell.faces.push(Face::new(winners[(i + 1) % 4], outline));
    }
    cell.faces.push(Face::new(winners[through], middle));
    cell
}

fn mean(vertices: &[Vertex]) -> Vertex {
    let n = vertices.len() as f64;
    let add = |sum: Vertex, v: &Vertex| ((sum.0.0 + v.0.0, sum.0.1 + v.0.1), sum.1 + v.1);
    let ((x, y), margin) = vertices.iter().fold(((0.0, 0.0), 0.0), add);
    ((x / n, y / n), margin / n)
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
        let (xs, ys, margin) = (&[0.0, 1.0], &[0.0, 1.0], &|_: usize, _: usize| 1.0);
        Mesh { xs, ys, winner: &winner, value: &value, margin }.cell(0, 0)
    }

    #[test]
    fn bands_part_a_face_where_the_value_passes_a_level() {
        let square = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
        let face = |values: [f64; 4]| -> Vec<Vertex> { square.into_iter().zip(values).collect() };
        let found = bands(&face([0.0, 2.0, 2.0, 0.0]), &[0.5, 1.0, 3.0]);
        let areas: Vec<(usize, f64)> = found.iter().map(|(k, part)| (*k, area(part))).collect();
        assert_eq!(areas, [(0, 0.25), (1, 0.25), (2, 0.5)]);
        let whole = bands(&face([f64::INFINITY; 4]), &[0.5]);
        assert_eq!(whole, [(1, square.to_vec())]);
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
            let points = |f: &Face| f.outline.iter().map(|v| v.0).collect::<Vec<Point>>();
            let areas: Vec<f64> = found.faces.iter().map(|face| area(&points(face))).collect();
            assert!((areas.iter().sum::<f64>() - 1.0).abs() < 1e-15, "{areas:?}");
            assert!(areas.iter().all(|area| *area > 0.0));
            assert!(found.faces.iter().flat_map(|f| &f.outline).all(|v| !v.1.is_nan()));
        }
    }
}
