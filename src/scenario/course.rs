//! A quantity of the truth along time: values that hold, or ramps.

use toml::de::DeValue;

use super::keys;
use super::reader::{Reader, Value, all};
use super::table::Table;

/// Share of a step by which a moment may miss the middle of a step and still be
/// on it: the times of steps are rounded products.
const EDGE: f64 = 1e-9;

/// A value from each time on, or straight lines between them.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Course {
    /// Times, rising from 0, and values.
    points: Vec<(f64, f64)>,
    ramp: bool,
}

/// The steps of a simulation: step `k`, from 1, lasts from `(k-1) dt` to `k dt`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Clock {
    pub(super) dt: f64,
    pub(super) steps: u64,
}

impl Clock {
    /// The middle of a step.
    pub(super) fn middle(self, step: u64) -> f64 {
        (step as f64 - 0.5) * self.dt
    }

    /// The first step whose middle is at `t` or later, if the run is that long.
    fn first(self, t: f64) -> Option<u64> {
        let step = (t / self.dt + 0.5 - EDGE).ceil();
        // below 2^53: the steps of a run are
        (step <= self.steps as f64).then_some(step.max(1.0) as u64)
    }
}

impl Course {
    /// One value for ever.
    pub(super) fn constant(value: f64) -> Self {
        Self { points: vec![(0.0, value)], ramp: false }
    }

    /// The value of a step: that of its middle.
    pub(super) fn at(&self, clock: Clock, step: u64) -> f64 {
        let t = clock.middle(step);
        let edge = t + 2.0 * EDGE * clock.dt;
        let later = self.points.iter().position(|p| p.0 > edge).unwrap_or(self.points.len());
        let (before, after) = (self.points[later.max(1) - 1], self.points.get(later));
        match after {
            Some(after) if self.ramp => {
                let share = (t - before.0) / (after.0 - before.0);
                f64::mul_add(after.1 - before.1, share, before.1)
            }
            _ => before.1,
        }
    }

    /// Values in the order of time.
    pub(super) fn values(&self) -> impl Iterator<Item = f64> + '_ {
        self.points.iter().map(|p| p.1)
    }

    /// Runs of steps, first and last, each of which may have another value than
    /// the step before it.
    pub(super) fn changes(&self, clock: Clock) -> Vec<[u64; 2]> {
        let mut runs = Vec::new();
        for (i, point) in self.points.iter().enumerate() {
            let Some(first) = clock.first(point.0) else { break };
            let last = match self.points.get(i + 1) {
                Some(next) if self.ramp && next.1 != point.1 => {
                    clock.first(next.0).unwrap_or(clock.steps)
                }
                _ => first,
            };
            runs.push([first, last]);
        }
        runs
    }

    /// A number, a list of `[time, value]` of which each holds until the next, or
    /// such a list under `ramp`.
    pub(super) fn read<'a>(reader: &Reader<'a>, key: &str, value: &Value<'a>) -> Option<Self> {
        match value.get_ref() {
            DeValue::Array(_) => Some(Self { points: points(reader, key, value)?, ramp: false }),
            DeValue::Table(map) => {
                let table = Table::new(reader, key, value.span().start, map, keys::COURSE);
                let list = table.need("ramp", "give ramp = [[0, first], [time, value], ..]")?;
                Some(Self { points: points(reader, &table.key("ramp"), list)?, ramp: true })
            }
            _ => Some(Self::constant(reader.number(key, value)?)),
        }
    }
}

fn points<'a>(reader: &Reader<'a>, key: &str, value: &Value<'a>) -> Option<Vec<(f64, f64)>> {
    let remedy = "write [[0, first], [time, next], ..], times in seconds, rising from 0";
    let DeValue::Array(list) = value.get_ref() else {
        return reader.wrong_type(key, value, "a list of [time, value]");
    };
    let points = all(list.iter().enumerate().map(|(i, pair)| {
        let key = format!("{key}[{i}]");
        match reader.numbers(&key, pair)?[..] {
            [t, v] => Some((t, v)),
            _ => reader.error(pair.span().start, &key, "not a time and a value", remedy),
        }
    }))?;
    let rising = points.windows(2).all(|w| w[0].0 < w[1].0);
    if points.first().is_some_and(|c| c.0 == 0.0) && rising {
        return Some(points);
    }
    reader.error(value.span().start, key, "the times do not rise from 0", remedy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_hold_from_the_first_middle_on() {
        let clock = Clock { dt: 0.1, steps: 100 };
        let course = Course { points: vec![(0.0, 1.0), (0.3, 2.0), (0.44, 3.0)], ramp: false };
        // middles at 0.05, 0.15, 0.25, 0.35, 0.45
        let values: Vec<f64> = (1..=5).map(|k| course.at(clock, k)).collect();
        assert_eq!(values, [1.0, 1.0, 1.0, 2.0, 3.0]);
        assert_eq!(course.changes(clock), [[1, 1], [4, 4], [5, 5]]);
    }

    #[test]
    fn ramps_change_only_where_they_rise_or_fall() {
        let clock = Clock { dt: 0.1, steps: 8 };
        let points = vec![(0.0, 1.0), (0.2, 1.0), (0.4, 2.0), (0.6, 2.0), (2.0, 0.0)];
        let course = Course { points, ramp: true };
        let want = [1.0, 1.0, 1.25, 1.75, 2.0, 2.0, 2.0 - 0.05 / 0.7, 2.0 - 0.15 / 0.7];
        for (k, want) in (1..=8).zip(want) {
            assert!((course.at(clock, k) - want).abs() < 1e-14, "step {k}");
        }
        assert_eq!(course.changes(clock), [[1, 1], [3, 5], [5, 5], [7, 8]]);
    }
}
