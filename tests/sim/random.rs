//! Words against published vectors, moments of the normal numbers.

use mmae::real::{Real, Tier};
use mmae::sim::{SplitMix64, Streams};
use mmae::simd::{Block, Kernel, dispatch_on};

/// The vectors that the reference implementations in C print.
#[test]
fn words_are_those_of_the_references() {
    let mut seeder = SplitMix64(1_477_776_061_723_855_037);
    for want in [
        1_985_237_415_132_408_290,
        2_979_275_885_539_914_483,
        13_511_426_838_097_143_398,
        8_488_337_342_461_049_707,
        15_141_737_807_933_549_159,
    ] {
        assert_eq!(seeder.word(), want);
    }
    let mut streams = Streams::from_state([1, 2, 3, 4].map(|w| [w; 8]));
    for want in [
        41_943_041,
        58_720_359,
        3_588_806_011_781_223,
        3_591_011_842_654_386,
        9_228_616_714_210_784_205,
        9_973_669_472_204_895_162,
        14_011_001_112_246_962_877,
        12_406_186_145_184_390_807,
        15_849_039_046_786_891_736,
        10_450_023_813_501_588_000,
    ] {
        assert_eq!(streams.words(), [want; 8]);
    }
}

struct Normals<'a> {
    streams: Streams,
    out: &'a mut [Block],
}

impl Kernel for Normals<'_> {
    type Out = ();

    #[inline(always)]
    fn run<T: Real>(mut self) {
        self.streams.normals::<T>(self.out);
    }
}

fn normals(tier: Tier, seed: u64, first: u64, len: usize) -> Option<Vec<Block>> {
    let mut out = vec![Block::default(); len];
    dispatch_on(tier, Normals { streams: Streams::new(seed, first), out: &mut out })?;
    Some(out)
}

#[test]
fn every_tier_makes_the_same_numbers() {
    for len in [1, 2, 101] {
        let want = normals(Tier::Baseline, 3, 40, len).unwrap();
        for tier in Tier::ALL {
            if let Some(got) = normals(tier, 3, 40, len) {
                let bits = |b: &[Block]| -> Vec<u64> {
                    b.iter().flat_map(|b| b.0.map(f64::to_bits)).collect()
                };
                assert_eq!(bits(&got), bits(&want), "{tier}");
            }
        }
    }
}

/// Mean 0, variance 1, skewness 0, kurtosis 3, tails, no correlation in time,
/// between streams and between seeds: within five standard deviations.
#[test]
fn moments_are_those_of_the_normal_distribution() {
    let len = 1 << 16;
    let (a, b) =
        (normals(Tier::best(), 1, 0, len).unwrap(), normals(Tier::best(), 2, 0, len).unwrap());
    let count = (len * 8) as f64;
    let mean = |f: &dyn Fn(usize, usize) -> f64| -> f64 {
        let sum: f64 = (0..len).map(|k| (0..8).map(|l| f(k, l)).sum::<f64>()).sum();
        sum / count
    };
    let z = |k: usize, l: usize| a[k].0[l];
    let checks: [(&str, f64, f64, f64); 10] = [
        ("mean", mean(&z), 0.0, 1.0),
        ("variance", mean(&|k, l| z(k, l).powi(2)), 1.0, 2.0),
        ("skewness", mean(&|k, l| z(k, l).powi(3)), 0.0, 15.0),
        ("kurtosis", mean(&|k, l| z(k, l).powi(4)), 3.0, 96.0),
        ("sixth", mean(&|k, l| z(k, l).powi(6)), 15.0, 10_395.0 - 225.0),
        ("tail", mean(&|k, l| f64::from(u8::from(z(k, l) > 3.0))), 1.349_898e-3, 1.35e-3),
        ("next", mean(&|k, l| z(k, l) * z((k + 1) % len, l)), 0.0, 1.0),
        ("squares", mean(&|k, l| (z(k, l).powi(2) - 1.0) * (z(k ^ 1, l).powi(2) - 1.0)), 0.0, 8.0),
        ("neighbour", mean(&|k, l| z(k, l) * z(k, (l + 1) % 8)), 0.0, 1.0),
        ("seed", mean(&|k, l| z(k, l) * b[k].0[l]), 0.0, 1.0),
    ];
    for (name, got, want, variance) in checks {
        let off = (got - want) / (variance / count).sqrt();
        assert!(off.abs() < 5.0, "{name}: {got}, {off} standard deviations off");
    }
    let largest = (0..len).flat_map(|k| a[k].0).fold(0.0_f64, |m, v| m.max(v.abs()));
    assert!(largest > 4.5 && largest < 6.5, "{largest}");
}
