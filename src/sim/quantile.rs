//! Quantiles of many trials in memory that does not grow with them.

/// The levels of every list of quantiles.
pub const LEVELS: [f64; 5] = [0.05, 0.25, 0.5, 0.75, 0.95];

/// Up to so many values are kept as they are.
const FEW: usize = 1024;
/// Bits of a number below those that choose its bin: 16 bins an octave.
const SHIFT: u32 = 48;
const PER_OCTAVE: usize = 16;

/// Bins of a range.
const PARTS: usize = 4096;

/// Where the bins of a quantity lie.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Axis {
    /// Weights in 0 .. 1, finer towards both ends, down to `2^-52` of either.
    Unit,
    /// Any number, finer towards zero, magnitudes of `2^-64` to `2^64`.
    Line,
    /// Numbers between two ends, in equal parts.
    Range(f64, f64),
}

impl Axis {
    /// Exponents of the smallest magnitude told from zero, and of the first that
    /// is not counted (the middle, for weights).
    fn octaves(self) -> (i32, i32) {
        match self {
            Axis::Unit => (-52, -1),
            Axis::Line | Axis::Range(..) => (-64, 64),
        }
    }

    /// Bins on one side of the middle of the line, or from an end of the unit
    /// interval to its middle.
    fn half(self) -> usize {
        let (low, high) = self.octaves();
        (high - low) as usize * PER_OCTAVE + 1
    }

    fn bins(self) -> usize {
        match self {
            Axis::Unit => 2 * self.half(),
            Axis::Line => 2 * (self.half() + 1),
            Axis::Range(..) => PARTS,
        }
    }

    /// Bins of magnitudes: 0 for what counts as zero, then 16 an octave.
    fn key(self, magnitude: f64) -> usize {
        let (low, high) = self.octaves();
        if magnitude >= power(high) {
            return self.half();
        }
        if magnitude < power(low) {
            return 0;
        }
        ((magnitude.to_bits() >> SHIFT) - (power(low).to_bits() >> SHIFT)) as usize + 1
    }

    /// Ends of such a bin.
    fn ends(self, key: usize) -> (f64, f64) {
        let (low, high) = self.octaves();
        if key == 0 {
            return (0.0, power(low));
        }
        if key >= self.half() {
            return (f64::INFINITY, f64::INFINITY);
        }
        let at = |k: usize| f64::from_bits(((power(low).to_bits() >> SHIFT) + k as u64) << SHIFT);
        (at(key - 1), at(key).min(power(high)))
    }

    fn bin(self, value: f64) -> usize {
        match self {
            Axis::Unit if value < 0.5 => self.key(value.max(0.0)),
            Axis::Unit => self.bins() - 1 - self.key((1.0 - value).max(0.0)).min(self.half() - 1),
            Axis::Line if value < 0.0 => self.half() - self.key(-value),
            Axis::Line => self.half() + 1 + self.key(value),
            // what is no number ends in the first
            Axis::Range(low, high) => ((value - low) / (high - low) * PARTS as f64)
                .clamp(0.0, PARTS as f64 - 1.0) as usize,
        }
    }

    fn range(self, bin: usize) -> (f64, f64) {
        let half = self.half();
        match self {
            Axis::Unit if bin < half => self.ends(bin),
            Axis::Unit => {
                let (low, high) = self.ends(self.bins() - 1 - bin);
                (1.0 - high, 1.0 - low)
            }
            Axis::Line if bin <= half => {
                let (low, high) = self.ends(half - bin);
                (-high, -low)
            }
            Axis::Line => self.ends(bin - half - 1),
            Axis::Range(low, high) => {
                let at = |k: usize| (high - low).mul_add(k as f64 / PARTS as f64, low);
                (at(bin), at(bin + 1))
            }
        }
    }
}

fn power(exponent: i32) -> f64 {
    f64::from_bits(((exponent + 1023) as u64) << 52)
}

/// The values of one quantity over the trials.
///
/// Up to 1024 values are kept, and their quantiles are exact. More are counted
/// in bins of a sixteenth of an octave: a quantile is then right to a sixteenth
/// of itself (of the smaller of `p` and `1 - p` for a weight), and as a rule much
/// nearer, since it is interpolated within the bin; one of a range to a part in
/// 4096 of it. Counts are integers: they do not depend on the order of the trials.
#[derive(Debug, Clone)]
pub(super) struct Sample {
    axis: Axis,
    few: Vec<f64>,
    counts: Vec<u64>,
}

impl Sample {
    pub(super) fn new(axis: Axis) -> Self {
        Self { axis, few: Vec::new(), counts: Vec::new() }
    }

    /// Most bytes that a sample of `trials` values takes.
    pub(super) fn bytes(trials: u64) -> u64 {
        if trials <= FEW as u64 { 8 * trials } else { 8 * Axis::Line.bins() as u64 }
    }

    /// Takes in values; what is no number counts as infinite.
    pub(super) fn extend(&mut self, values: &[f64]) {
        if self.counts.is_empty() && self.few.len() + values.len() <= FEW {
            let number = |v: &f64| if v.is_nan() { f64::INFINITY } else { *v };
            self.few.extend(values.iter().map(number));
            return;
        }
        if self.counts.is_empty() {
            self.counts = vec![0; self.axis.bins()];
            for value in std::mem::take(&mut self.few) {
                self.counts[self.axis.bin(value)] += 1;
            }
        }
        for value in values {
            self.counts[self.axis.bin(*value)] += 1;
        }
    }

    /// The quantiles of [`LEVELS`]; NaN of no values.
    ///
    /// ```text
    /// Q(s) = v_(1 + s (T - 1)),   v_(1) <= v_(2) <= ..
    /// ```
    /// with linear interpolation between the values next to a fraction.
    pub(super) fn quantiles(mut self) -> [f64; 5] {
        if self.counts.is_empty() {
            self.few.sort_by(f64::total_cmp);
            return LEVELS.map(|s| self.exact(s));
        }
        let total: u64 = self.counts.iter().sum();
        let mut out = [f64::NAN; 5];
        let (mut below, mut level) = (0, 0);
        for (bin, &count) in self.counts.iter().enumerate() {
            while level < LEVELS.len() {
                let at = LEVELS[level] * (total - 1) as f64;
                if at >= (below + count) as f64 {
                    break;
                }
                let (low, high) = self.axis.range(bin);
                // ranks stand in the middle of equal parts of their bin
                let part = ((at - below as f64 + 0.5) / count as f64).min(1.0);
                out[level] = if low == high { low } else { (high - low).mul_add(part, low) };
                level += 1;
            }
            below += count;
        }
        out
    }

    fn exact(&self, s: f64) -> f64 {
        let Some(last) = self.few.len().checked_sub(1) else { return f64::NAN };
        let at = s * last as f64;
        let (below, rest) = (at.floor() as usize, at.fract());
        let low = self.few[below];
        match self.few.get(below + 1) {
            Some(high) if rest > 0.0 && *high != low => (high - low).mul_add(rest, low),
            _ => low,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_hold_their_values() {
        for axis in [Axis::Unit, Axis::Line] {
            let mut edge = f64::NEG_INFINITY;
            for bin in 0..axis.bins() {
                let (low, high) = axis.range(bin);
                assert!(low <= high && low >= edge, "{axis:?} {bin}: {low} {high}");
                edge = high;
            }
        }
        let mut x = 1e-30_f64;
        while x < 1e19 {
            for v in [x, -x, 1.0 / (1.0 + x)] {
                let axis = if (0.0..=1.0).contains(&v) { Axis::Unit } else { Axis::Line };
                let (low, high) = axis.range(axis.bin(v));
                assert!(low <= v && v <= high, "{axis:?}: {v} in {low} .. {high}");
            }
            x *= 1.37;
        }
        for v in [0.0, 0.5, 1.0, 0.999_999_999_999_999_9] {
            let (low, high) = Axis::Unit.range(Axis::Unit.bin(v));
            assert!(low <= v && v <= high, "{v}");
        }
        let infinite = Axis::Line.range(Axis::Line.bin(f64::NAN));
        assert_eq!(infinite, (f64::INFINITY, f64::INFINITY));
        assert_eq!(Axis::Line.range(Axis::Line.bin(f64::NEG_INFINITY)).0, f64::NEG_INFINITY);
    }

    #[test]
    fn counted_quantiles_are_near_the_exact_ones() {
        // a weight whose odds are spread over many octaves, and a signed error
        let weight = |k: usize| 1.0 / (1.0 + (0.02 * (k as f64 - 3000.0)).exp());
        let error = |k: usize| ((k as f64 - 2500.0) * 1e-3).powi(3);
        let of = |axis, f: &dyn Fn(usize) -> f64| {
            let values: Vec<f64> = (0..6001).map(|i| f(i * 2777 % 6001)).collect();
            let mut sample = Sample::new(axis);
            for part in values.chunks(64) {
                sample.extend(part);
            }
            let exact = Sample { axis, few: values, counts: Vec::new() }.quantiles();
            (sample.quantiles(), exact)
        };
        let (got, want) = of(Axis::Unit, &weight);
        for (got, want) in got.iter().zip(want) {
            let room = want.min(1.0 - want) / 16.0 + f64::EPSILON;
            assert!((got - want).abs() < room, "{got} {want}");
        }
        let (got, want) = of(Axis::Line, &error);
        for (got, want) in got.iter().zip(want) {
            assert!((got - want).abs() < want.abs() / 16.0, "{got} {want}");
        }
    }

    #[test]
    fn a_range_is_cut_in_equal_parts() {
        let mut sample = Sample::new(Axis::Range(0.96, 1.01));
        sample.extend(&vec![1.0; 3000]);
        sample.extend(&[0.96, 1.01]);
        for q in sample.quantiles() {
            assert!((q - 1.0).abs() < 0.05 / 4096.0, "{q}");
        }
        let mut single = Sample::new(Axis::Range(2.0, 2.0));
        single.extend(&vec![2.0; 3000]);
        assert_eq!(single.quantiles(), [2.0; 5]);
    }

    #[test]
    fn few_values_are_exact() {
        let mut sample = Sample::new(Axis::Line);
        assert!(sample.clone().quantiles().iter().all(|q| q.is_nan()));
        sample.extend(&[3.0, -1.0, f64::NAN, 1.0, 2.0]);
        assert_eq!(sample.quantiles(), [-0.6, 1.0, 2.0, 3.0, f64::INFINITY]);
    }
}
