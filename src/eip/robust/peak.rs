//! Robust stability: the largest `|W(jw) T(jw)|`.

use crate::eip::frequency::Frequency;
use crate::eip::robust::parts::Opened;
use crate::model::ActuatorBound;

/// Frequencies of the first look, even in the mapped frequency.
const NODES: usize = 256;
/// Local maxima that are refined, the largest first.
const REFINED: usize = 4;
/// Sections of a local maximum at most.
const ROUNDS: usize = 24;
/// Points of a section.
const POINTS: usize = 8;

/// The largest `|W T|` and where it is, in rad/s.
///
/// Sampled over the whole axis, where the scale of the frequencies is that of
/// loop and observers, and refined around the largest samples.
pub(super) fn peak(route: &Frequency<'_>, opened: &Opened, bound: &ActuatorBound) -> (f64, f64) {
    let at = |s: f64| route.gamma * s / (1.0 - s);
    let sizes = |nodes: &[f64]| -> Vec<f64> {
        let omega: Vec<f64> = nodes.iter().map(|s| at(*s)).collect();
        let gains = route.loop_gain(opened, &omega);
        omega.iter().zip(gains).map(|(w, t)| t * bound.size(*w)).collect()
    };
    let nodes: Vec<f64> = (0..NODES).map(|k| k as f64 / NODES as f64).collect();
    let values = sizes(&nodes);
    let value = |k: usize| values.get(k).copied().unwrap_or(0.0);
    let mut tops: Vec<usize> = (0..NODES)
        .filter(|&k| (k == 0 || values[k] >= value(k - 1)) && values[k] >= value(k + 1))
        .collect();
    tops.sort_by(|a, b| values[*b].total_cmp(&values[*a]));
    let mut best = (f64::NEG_INFINITY, 0.0);
    if values.iter().any(|v| v.is_nan()) {
        return (f64::INFINITY, 0.0); // a pole on the axis
    }
    for &k in tops.iter().take(REFINED) {
        let step = 1.0 / NODES as f64;
        let (mut low, mut high) = ((nodes[k] - step).max(0.0), (nodes[k] + step).min(1.0));
        let (mut top, mut middle) = (values[k], nodes[k]);
        for _ in 0..ROUNDS {
            let width = (high - low) / (POINTS + 1) as f64;
            let inner: Vec<f64> = (1..=POINTS).map(|i| low + width * i as f64).collect();
            for (&s, v) in inner.iter().zip(sizes(&inner)) {
                if v > top {
                    (top, middle) = (v, s);
                }
            }
            (low, high) = ((middle - width).max(low), (middle + width).min(high));
            if high - low < 1e-9 {
                break;
            }
        }
        if top > best.0 {
            best = (top, at(middle));
        }
    }
    best
}
