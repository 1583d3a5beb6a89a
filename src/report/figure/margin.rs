//! The margin to the runner-up, below the curves.

use svg::node::element::Group;

use super::canvas::{self, Area};
use super::palette::{Color, INK};
use super::panel::Panel;
use super::scale::Scale;
use super::trace::{cut, thinned};
use crate::eip::Case;

/// Range of the margin panel.
pub(super) struct MarginRange {
    low: f64,
    high: f64,
    log: bool,
}

impl MarginRange {
    /// `None` if there is no margin to show.
    pub(super) fn new(case: &Case) -> Option<Self> {
        let mut margins: Vec<f64> =
            case.margin.iter().copied().filter(|m| m.is_finite() && *m > 0.0).collect();
        margins.sort_by(f64::total_cmp);
        let high = *margins.last()?;
        let quantile = |q: f64| margins[((margins.len() - 1) as f64 * q) as usize];
        if case.margin.len() < 2 {
            return None;
        }
        if quantile(0.5) > 0.06 * high {
            return Some(Self { low: 0.0, high: 1.08 * high, log: false });
        }
        // half of the plants would hug the axis; the dips to zero are cut
        let low = (0.3 * quantile(0.1)).max(1e-6 * high);
        Some(Self { low, high: 1.5 * high, log: true })
    }

    pub(super) fn scale(&self, start: f64, end: f64) -> Scale {
        Scale::new(self.low, self.high, self.log, start, end)
    }
}

impl Panel<'_> {
    /// The margin to the runner-up, in the colour of the winner.
    pub(super) fn margin(&self, area: Area, range: &MarginRange) -> Group {
        let y = range.scale(area.bottom(), area.y);
        let mut group = Group::new().add(canvas::y_axis(area, &y, 27.0, true));
        let points: Vec<(f64, f64)> = (self.values.iter().zip(&self.case.margin))
            .map(|(v, m)| (self.x.at(*v), y.at(m.clamp(range.low, f64::INFINITY))))
            .collect();
        for (i, set) in self.case.sets.iter().enumerate() {
            for interval in set {
                let ends = [interval.from, interval.to].map(|v| {
                    let boundary = self.case.boundaries.iter().any(|b| b.value == v);
                    (self.x.at(v), boundary)
                });
                let mut inside = cut(&points, ends[0].0, ends[1].0);
                inside.retain(|p| p.1.is_finite());
                let (Some(&first), Some(&last)) = (inside.first(), inside.last()) else { continue };
                // the margin is zero at a boundary, which is no grid point
                let start = if ends[0].1 { (ends[0].0, area.bottom()) } else { first };
                let stop = if ends[1].1 { (ends[1].0, area.bottom()) } else { last };
                if ends[0].1 {
                    inside.insert(0, start);
                }
                if ends[1].1 {
                    inside.push(stop);
                }
                let inside = thinned(&inside, area.x);
                let color = Color::of(i);
                let outline = [(start.0, area.bottom())].into_iter().chain(inside.iter().copied());
                if let Some(path) = canvas::polyline(outline.chain([(stop.0, area.bottom())])) {
                    group = group.add(path.set("fill", color.pale(0.6)));
                }
                if let Some(path) = canvas::polyline(inside) {
                    group = group.add(path.set("stroke", color).set("stroke-width", 1.8));
                }
            }
        }
        if let Some(robust) = &self.sets.robust {
            // the lead that is left for the worst Delta
            let y = |lead: f64| y.at(lead.max(range.low));
            let at = |(v, lead): (&f64, &f64)| {
                (self.x.at(*v), if *lead > 0.0 { y(*lead) } else { f64::NAN })
            };
            let lead: Vec<(f64, f64)> = self.values.iter().zip(&robust.lead).map(at).collect();
            if let Some(path) = canvas::polyline(thinned(&lead, area.x)) {
                let path = path.set("stroke", INK).set("stroke-width", 1.4);
                group = group.add(path.set("stroke-dasharray", "5 3"));
            }
        }
        group = group.add(self.unstable(area)).add(area.frame());
        group.add(canvas::y_label(24.0, area, "margin"))
    }
}
