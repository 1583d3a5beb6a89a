//! Every tier against the oracle, by bits.

use super::lanes::Kind;
use super::{Checks, Lyapunov, Riccati, Solutions, Sylvester, linear, riccati};
use crate::par::RunControl;
use crate::simd::Tier;

/// Numbers in [-1, 1) from a fixed sequence.
pub(super) struct Sequence(pub(super) u64);

impl Sequence {
    pub(super) fn next(&mut self) -> f64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
    pub(super) fn take(&mut self, count: usize) -> Vec<f64> {
        (0..count).map(|_| self.next()).collect()
    }
    /// `len` positive definite matrices of order `n`.
    pub(super) fn covariances(&mut self, n: usize, len: usize) -> Vec<f64> {
        let mut out = Vec::new();
        for _ in 0..len {
            let root = self.take(n * n);
            for i in 0..n {
                for j in 0..n {
                    let (low, high) = (i.min(j), i.max(j));
                    let dot = |a: usize, b: usize| -> f64 {
                        (0..n).map(|k| root[a * n + k] * root[b * n + k]).sum()
                    };
                    out.push(dot(low, high) + if i == j { 0.1 } else { 0.0 });
                }
            }
        }
        out
    }
}

fn bits(s: &Solutions) -> Vec<u64> {
    let numbers = s
        .items
        .iter()
        .flat_map(|item| [item.residual, item.correction, item.margin, f64::from(item.iterations)]);
    s.x.iter().copied().chain(numbers).map(f64::to_bits).collect()
}

/// Runs `solve` on every tier of this CPU and returns the result of the oracle.
fn same_on_all_tiers(what: &str, solve: impl Fn(Tier) -> Solutions) -> Solutions {
    let oracle = solve(Tier::Scalar);
    for tier in Tier::ALL.into_iter().filter(|tier| tier.available()) {
        let other = solve(tier);
        assert_eq!(bits(&other), bits(&oracle), "{what} on {tier}");
        let statuses =
            |s: &Solutions| s.items.iter().map(|i| format!("{:?}", i.status)).collect::<Vec<_>>();
        assert_eq!(statuses(&other), statuses(&oracle), "{what} on {tier}");
    }
    oracle
}

#[test]
fn tiers_agree_with_the_oracle_by_bits() {
    let control = RunControl::default().threads(1);
    for (n, m) in [(1, 1), (2, 1), (3, 2), (4, 4), (7, 3)] {
        let len = 11;
        let mut random = Sequence(n as u64);
        // Wide units; item 5 cannot be stabilized, item 6 is marginal.
        let mut a = random.take(len * n * n);
        a.chunks_exact_mut(n * n).for_each(|a| a[0] *= 1e3);
        let mut b = random.take(len * n * m);
        b[5 * n * m..6 * n * m].fill(0.0);
        let q = random.covariances(n, len);
        let r = random.covariances(m, len);
        let s: Vec<f64> = random.take(len * n * m).iter().map(|x| 0.01 * x).collect();
        let p = Riccati { n, m, len, A: &a, B: &b, Q: &q, R: &r, S: Some(&s) };
        for kind in [Kind::Continuous, Kind::Discrete] {
            let what = format!("{kind:?} Riccati n={n} m={m}");
            let all = same_on_all_tiers(&what, |tier| {
                riccati::run(kind, &p, Checks::All, Some(tier), &control).unwrap()
            });
            assert!(all.items.iter().filter(|item| item.status.is_ok()).count() >= 9, "{all:?}");
        }
        let mut shifted = a.clone();
        for item in shifted.chunks_exact_mut(n * n) {
            (0..n).for_each(|i| item[i * n + i] -= 2.0 * n as f64);
        }
        let small: Vec<f64> = a.iter().map(|x| x * 0.5 / n as f64 / 1e3).collect();
        let other = random.take(len * m * m).iter().map(|x| x * 0.5 / m as f64).collect::<Vec<_>>();
        let c = random.take(len * n * m);
        for (kind, a) in [(Kind::Continuous, &shifted), (Kind::Discrete, &small)] {
            let what = format!("{kind:?} Lyapunov n={n}");
            let p = Lyapunov { n, len, A: a, Q: &q };
            same_on_all_tiers(&what, |tier| {
                let fields = p.fields().unwrap();
                linear::run(kind, fields, [n, n, len], (Checks::All, Some(tier)), &control).unwrap()
            });
            let b: Vec<f64> = match kind {
                Kind::Discrete => other.clone(),
                Kind::Continuous => {
                    let unit = |e: usize| f64::from(u8::from((e % (m * m)).is_multiple_of(m + 1)));
                    other.iter().enumerate().map(|(e, x)| x - unit(e)).collect()
                }
            };
            let what = format!("{kind:?} Sylvester n={n} m={m}");
            let p = Sylvester { n, m, len, A: a, B: &b, C: &c };
            let all = same_on_all_tiers(&what, |tier| {
                let fields = p.fields().unwrap();
                linear::run(kind, fields, [n, m, len], (Checks::All, Some(tier)), &control).unwrap()
            });
            assert!(all.items.iter().all(|item| item.status.is_ok()), "{all:?}");
        }
    }
}
