//! Adaptive quadrature of several functions at once.
//!
//! 15-point Gauss-Kronrod rules, bisected where the error estimate asks for it.
//! The path of the bisection leaves no trace in the sums.
//!
//! # Source
//! Rule and error estimate as in QUADPACK (Piessens et al. 1983).

/// Nodes of the 15-point Kronrod rule on [0, 1) of [-1, 1], largest first.
const NODES: [f64; 8] = [
    0.991_455_371_120_812_6,
    0.949_107_912_342_758_5,
    0.864_864_423_359_769_1,
    0.741_531_185_599_394_4,
    0.586_087_235_467_691_1,
    0.405_845_151_377_397_2,
    0.207_784_955_007_898_47,
    0.0,
];
/// Weights of the 15-point Kronrod rule.
const KRONROD: [f64; 8] = [
    0.022_935_322_010_529_224,
    0.063_092_092_629_978_56,
    0.104_790_010_322_250_18,
    0.140_653_259_715_525_92,
    0.169_004_726_639_267_9,
    0.190_350_578_064_785_4,
    0.204_432_940_075_298_9,
    0.209_482_141_084_727_82,
];
/// Weights of the 7-point Gauss rule at every other node.
const GAUSS: [f64; 4] = [
    0.129_484_966_168_869_7,
    0.279_705_391_489_276_64,
    0.381_830_050_505_118_9,
    0.417_959_183_673_469_4,
];
/// Points of the rule.
pub(crate) const POINTS: usize = 15;
/// Intervals at the start.
const FIRST: usize = 8;
/// Bisections of one interval at most.
const DEPTH: u32 = 40;
/// Intervals at most.
const MAX_INTERVALS: usize = 4096;

/// An integral and its error estimate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Integral {
    pub(crate) value: f64,
    pub(crate) error: f64,
    /// Integral of the modulus: `value` where the function is not negative.
    pub(crate) size: f64,
}

/// An interval of [0, 1], and how often it was halved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Interval {
    from: f64,
    to: f64,
    depth: u32,
}

impl Interval {
    /// Node `k` of the rule, increasing.
    pub(crate) fn node(&self, k: usize) -> f64 {
        let (middle, half) = (0.5 * (self.from + self.to), 0.5 * (self.to - self.from));
        let at = k.min(POINTS - 1 - k);
        if k == at { middle - half * NODES[at] } else { middle + half * NODES[at] }
    }

    /// Weight of node `k`.
    pub(crate) fn weight(&self, k: usize) -> f64 {
        0.5 * (self.to - self.from) * KRONROD[k.min(POINTS - 1 - k)]
    }
}

/// Intervals to start from when nothing is known.
pub(crate) fn even_mesh() -> Vec<Interval> {
    let at = |k: usize| k as f64 / FIRST as f64;
    (0..FIRST).map(|k| Interval { from: at(k), to: at(k + 1), depth: 0 }).collect()
}

/// Integrals of `width` functions over `mesh`, each to about `tolerance` of the
/// integral of its modulus, and the mesh that it took.
///
/// `evaluate(intervals, values)` appends the values at their nodes: intervals by
/// nodes by functions. It is called for the whole mesh first.
pub(crate) fn integrate(
    mesh: &[Interval],
    width: usize,
    tolerance: f64,
    mut evaluate: impl FnMut(&[Interval], &mut Vec<f64>),
) -> (Vec<Integral>, Vec<Interval>) {
    let mut done: Vec<Panel> = Vec::new();
    let mut pending = mesh.to_vec();
    let mut values = Vec::new();
    loop {
        values.clear();
        evaluate(&pending, &mut values);
        for (&interval, values) in pending.iter().zip(values.chunks_exact(POINTS * width)) {
            done.push(Panel::new(interval, values, width));
        }
        done.sort_by(|p, q| p.interval.from.total_cmp(&q.interval.from));
        let total = totals(&done, width);
        let enough = total.iter().all(|t| t.error <= tolerance * t.size);
        let share = 0.5 * tolerance / done.len() as f64;
        let splits = |p: &Panel| {
            p.interval.depth < DEPTH
                && p.integrals.iter().zip(&total).any(|(i, t)| i.error > share * t.size)
        };
        if enough || done.len() >= MAX_INTERVALS || !done.iter().any(splits) {
            return (total, done.iter().map(|p| p.interval).collect());
        }
        pending.clear();
        done.retain(|p| {
            let split = splits(p);
            if split {
                let Interval { from, to, depth } = p.interval;
                let (middle, depth) = (0.5 * (from + to), depth + 1);
                pending.push(Interval { from, to: middle, depth });
                pending.push(Interval { from: middle, to, depth });
            }
            !split
        });
    }
}

/// The integrals over one interval.
struct Panel {
    interval: Interval,
    integrals: Vec<Integral>,
}

impl Panel {
    fn new(interval: Interval, values: &[f64], width: usize) -> Self {
        let half = 0.5 * (interval.to - interval.from);
        let integrals = (0..width)
            .map(|i| {
                let f = |k: usize| values[k * width + i];
                let (mut kronrod, mut gauss, mut size) = (0.0, 0.0, 0.0);
                for k in 0..POINTS {
                    let at = k.min(POINTS - 1 - k);
                    kronrod += KRONROD[at] * f(k);
                    size += KRONROD[at] * f(k).abs();
                    if at % 2 == 1 {
                        gauss += GAUSS[at / 2] * f(k);
                    }
                }
                let mean = 0.5 * kronrod;
                let spread: f64 =
                    (0..POINTS).map(|k| KRONROD[k.min(POINTS - 1 - k)] * (f(k) - mean).abs()).sum();
                let difference = (kronrod - gauss).abs();
                let error = if spread > 0.0 {
                    spread * (200.0 * difference / spread).powf(1.5).min(1.0)
                } else {
                    difference
                };
                Integral { value: kronrod * half, error: error * half, size: size * half }
            })
            .collect();
        Self { interval, integrals }
    }
}

fn totals(panels: &[Panel], width: usize) -> Vec<Integral> {
    (0..width)
        .map(|i| {
            let zero = Integral { value: 0.0, error: 0.0, size: 0.0 };
            panels.iter().fold(zero, |t, p| Integral {
                value: t.value + p.integrals[i].value,
                error: t.error + p.integrals[i].error,
                size: t.size + p.integrals[i].size,
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rule_is_exact_for_polynomials() {
        let interval = Interval { from: -1.0, to: 1.0, depth: 0 };
        for degree in (0..=22).step_by(2) {
            let values: Vec<f64> = (0..POINTS)
                .map(|k| {
                    let at = k.min(POINTS - 1 - k);
                    let x = if k == at { -NODES[at] } else { NODES[at] };
                    x.powi(degree)
                })
                .collect();
            let panel = Panel::new(interval, &values, 1);
            let exact = 2.0 / f64::from(degree + 1);
            assert!((panel.integrals[0].value - exact).abs() < 4e-16 * 4.0, "degree {degree}");
        }
    }
}
