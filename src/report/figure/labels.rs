//! Labels of curves, right of the panel, and of boundaries, above it.

use svg::node::element::Group;

use super::canvas::{self, NOTE, TICK};
use super::palette::{Color, INK};
use super::panel::Panel;
use super::place::spread;
use super::scale::Scale;
use crate::eip::{Case, EipSets};
use crate::report::number::to_uncertainty;
use crate::report::summary;

/// The label of a curve and the last plant where it can be seen.
pub(super) struct CurveLabel {
    pub(super) model: usize,
    pub(super) text: String,
    pub(super) plant: usize,
}

/// A label for every curve with a point not above `high`, as far as they fit.
pub(super) fn curve_labels(sets: &EipSets, case: &Case, high: f64, height: f64) -> Vec<CurveLabel> {
    let n = sets.models.len();
    let all = (0..n).filter(|&i| sets.models[i].failure.is_none()).filter_map(|i| {
        let plant = (0..case.winner.len()).rev().find(|p| case.upsilon[p * n + i] <= high)?;
        let text = canvas::fitted(&summary::short_name(sets, i), TICK, 196.0);
        Some(CurveLabel { model: i, text, plant })
    });
    let mut labels: Vec<CurveLabel> = all.collect();
    let room = (height / (TICK + 2.0)) as usize;
    if labels.len() > room {
        labels.retain(|l| case.sets.get(l.model).is_some_and(|s| !s.is_empty()));
    }
    if labels.len() > room {
        let every = labels.len().div_ceil(room);
        let mut k = 0;
        labels.retain(|_| {
            k += 1;
            (k - 1) % every == 0
        });
    }
    labels
}

/// Values of the boundaries above the panel.
pub(super) struct BoundaryLabels {
    /// Pixel of the boundary, centre of its label, text.
    pub(super) labels: Vec<(f64, f64, String)>,
    pub(super) turned: bool,
}

impl BoundaryLabels {
    pub(super) fn new(case: &Case, x: &Scale) -> Self {
        let digits = (x.to - x.from).abs() * 1e-4;
        let wanted: Vec<f64> = case.boundaries.iter().map(|b| x.at(b.value)).collect();
        let texts: Vec<String> =
            case.boundaries.iter().map(|b| to_uncertainty(b.value, digits)).collect();
        let place = |sizes: Vec<f64>| spread(&wanted, &sizes, x.start - 30.0, x.end + 30.0);
        let flat = place(texts.iter().map(|t| canvas::width(t, NOTE) + 8.0).collect());
        let (centers, turned) = match flat {
            Some(centers) => (Some(centers), false),
            None => (place(vec![NOTE + 2.0; texts.len()]), true),
        };
        let labels = match centers {
            Some(c) => wanted.iter().copied().zip(c).zip(texts).map(|((w, c), t)| (w, c, t)),
            None => return Self { labels: Vec::new(), turned: false },
        };
        Self { labels: labels.collect(), turned }
    }

    pub(super) fn height(&self) -> f64 {
        if self.labels.is_empty() {
            0.0
        } else if self.turned {
            16.0 + self.longest()
        } else {
            34.0
        }
    }

    pub(super) fn longest(&self) -> f64 {
        self.labels.iter().map(|l| canvas::width(&l.2, NOTE)).fold(0.0, f64::max)
    }

    /// Labels above pixel row `top`, each tied to its boundary.
    pub(super) fn draw(&self, top: f64) -> Group {
        let mut group = Group::new();
        for (wanted, center, text) in &self.labels {
            let tie =
                canvas::polyline([(*wanted, top), (*wanted, top - 4.0), (*center, top - 12.0)]);
            if let Some(tie) = tie {
                group = group.add(tie.set("stroke", INK).set("stroke-width", 1));
            }
            group = group.add(if self.turned {
                let x = center + 0.35 * NOTE;
                canvas::text(x, top - 15.0, NOTE, text).set(
                    "transform",
                    format!("rotate(-90 {} {})", canvas::px(x), canvas::px(top - 15.0)),
                )
            } else {
                canvas::centered(*center, top - 16.0, NOTE, text)
            });
        }
        group
    }
}

impl Panel<'_> {
    /// A label at the right end of each curve.
    pub(super) fn direct_labels(&self, labels: &[CurveLabel], number: f64) -> Group {
        let n = self.sets.models.len();
        let end = |l: &CurveLabel| {
            let u = self.case.upsilon[l.plant * n + l.model];
            // a curve that goes on above the panel leaves it at the top
            let next = self.case.upsilon.get((l.plant + 1) * n + l.model);
            let above = next.is_some_and(|next| next.is_finite());
            let y = if above { self.main.y } else { self.y.at(u) };
            (self.x.at(self.values[l.plant]), y.clamp(self.main.y, self.main.bottom()))
        };
        let mut order: Vec<&CurveLabel> = labels.iter().collect();
        // from the top; of those that left it there the first one stands highest
        order.sort_by(|a, b| {
            let (ends, models) = ((end(a), end(b)), (a.model, b.model));
            let by_y = ends.0.1.total_cmp(&ends.1.1);
            by_y.then(ends.0.0.total_cmp(&ends.1.0)).then(models.0.cmp(&models.1))
        });
        let wanted: Vec<f64> = order.iter().map(|l| end(l).1).collect();
        let sizes = vec![TICK + 2.0; wanted.len()];
        let Some(centers) = spread(&wanted, &sizes, self.main.y - 8.0, self.main.bottom() + 8.0)
        else {
            return Group::new();
        };
        let mut group = Group::new();
        for (label, y) in order.iter().zip(centers) {
            let color = Color::of(label.model);
            let (x, from) = end(label);
            let right = self.main.right();
            if let Some(tie) = canvas::polyline([(x, from), (right + 4.0, from), (right + 14.0, y)])
            {
                let tie = tie.set("stroke", color).set("stroke-width", 1.2);
                group = group.add(if x < right - 2.0 {
                    tie.set("stroke-dasharray", "2 4")
                } else {
                    tie
                });
            }
            let base = y + 0.35 * TICK;
            let text =
                |x, content: &str| canvas::text(x, base, TICK, content).set("fill", color.ink());
            let index = (label.model + 1).to_string();
            group = group
                .add(text(right + 18.0, &index).set("font-weight", "bold"))
                .add(text(right + 18.0 + number, &label.text));
        }
        group
    }
}
