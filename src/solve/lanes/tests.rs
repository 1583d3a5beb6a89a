use super::*;
use crate::real::{Mask, Real};
use crate::simd::{Kernel, LANES, Tier, dispatch_on};
use crate::small::{Dyn, mul_add, mul_add_nt, mul_nt};

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
}

/// Eight random matrices; all stable but those whose bit is set in `unstable`.
fn coefficients(seed: u64, n: usize, unstable: u8) -> Vec<Vec<f64>> {
    let mut random = Sequence(seed);
    (0..LANES)
        .map(|l| {
            let mut a = random.take(n * n);
            let shift = if unstable >> l & 1 == 1 { -0.5 } else { 1.1 * n as f64 };
            (0..n).for_each(|i| a[i * n + i] -= shift);
            a
        })
        .collect()
}

struct Equations<'a> {
    n: usize,
    m: usize,
    a: &'a [Vec<f64>],
    b: &'a [Vec<f64>],
    q: &'a [f64],
    c: &'a [f64],
}

impl Kernel for Equations<'_> {
    type Out = Vec<f64>;
    #[inline(always)]
    fn run<T: Real>(self) -> Vec<f64> {
        let (n, m) = (self.n, self.m);
        let mut out = vec![0.0; LANES * (2 * n * n + 2 * n * m + 4)];
        let each = out.len() / LANES;
        let mut work = vec![T::zero(); 2 * n.max(m) * n.max(m)];
        let mut perm = vec![T::zero(); n];
        for group in 0..LANES / T::LANES {
            let at = |x: &[Vec<f64>], e: usize| T::from_fn(|l| x[group * T::LANES + l][e]);
            let a: Vec<T> = (0..n * n).map(|e| at(self.a, e)).collect();
            let b: Vec<T> = (0..m * m).map(|e| at(self.b, e)).collect();
            let gamma = gamma_of(n, &a, &mut work[..n * n], &mut perm);
            let (mut ca, mut cb) = (Cayley::new(n), Cayley::new(m));
            ca.set(&a, gamma);
            cb.set(&b, gamma);
            let splat = |x: &[f64]| x.iter().map(|&v| T::splat(v)).collect::<Vec<T>>();
            let (mut x, mut y) = (splat(self.q), splat(self.q));
            lyapunov(&ca, &mut x, &mut work);
            lyapunov_dual(&ca, &mut y, &mut work);
            let (mut z, mut w) = (splat(self.c), splat(self.c));
            sylvester(&ca, &cb, &mut z, &mut work);
            sylvester_nt(&ca, &cb, &mut w, &mut work);
            for l in 0..T::LANES {
                let item = &mut out[(group * T::LANES + l) * each..][..each];
                let all = x.iter().chain(&y).chain(&z).chain(&w);
                for (o, v) in item.iter_mut().zip(all) {
                    *o = v.lane(l);
                }
                let stable = |c: &Cayley<T>| f64::from(u8::from(c.powers.stable.lane(l)));
                let margins = [stable(&ca), ca.margin().lane(l), stable(&cb), cb.margin().lane(l)];
                item[each - 4..].copy_from_slice(&margins);
            }
        }
        out
    }
}

#[test]
fn equations_hold_and_tiers_agree_by_bits() {
    for (n, m) in [(1, 1), (2, 3), (4, 4), (5, 3), (9, 5)] {
        let a = coefficients(1, n, 0b0010_0100);
        let b = coefficients(2, m, 0);
        let mut random = Sequence(3);
        let root = random.take(n * n);
        let mut q = vec![0.0; n * n];
        mul_nt(Dyn(n), Dyn(n), Dyn(n), &root, &root, &mut q);
        let c = random.take(n * m);
        let run = |tier| dispatch_on(tier, Equations { n, m, a: &a, b: &b, q: &q, c: &c });
        let oracle = run(Tier::Scalar).unwrap();
        for tier in Tier::ALL {
            if let Some(out) = run(tier) {
                let bits = |x: &[f64]| x.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
                assert_eq!(bits(&out), bits(&oracle), "{tier} n={n} m={m}");
            }
        }
        let each = oracle.len() / LANES;
        for (l, item) in oracle.chunks_exact(each).enumerate() {
            let (x, rest) = item.split_at(n * n);
            let (y, rest) = rest.split_at(n * n);
            let (z, rest) = rest.split_at(n * m);
            let (w, flags) = rest.split_at(n * m);
            let unstable = [2, 5].contains(&l);
            assert_eq!(flags[0] == 0.0, unstable, "lane {l} of n={n}");
            assert_eq!(flags[1] <= 0.0 || flags[1].is_nan(), unstable, "{flags:?}");
            assert!(flags[2] == 1.0 && flags[3] > 0.0);
            if unstable {
                continue;
            }
            let (n, m, a, b) = (Dyn(n), Dyn(m), &a[l], &b[l]);
            let mut r = q.clone();
            mul_add(n, n, n, a, x, &mut r);
            mul_add_nt(n, n, n, x, a, &mut r);
            assert!(r.iter().all(|v| v.abs() < 1e-12), "AX + XA' + Q: {r:?}");
            let mut r = q.clone();
            crate::small::mul_add_tn(n, n, n, a, y, &mut r);
            mul_add(n, n, n, y, a, &mut r);
            assert!(r.iter().all(|v| v.abs() < 1e-12), "A'Y + YA + Q: {r:?}");
            let mut r = c.clone();
            mul_add(n, n, m, a, z, &mut r);
            mul_add(n, m, m, z, b, &mut r);
            assert!(r.iter().all(|v| v.abs() < 1e-12), "AZ + ZB + C: {r:?}");
            let mut r = c.clone();
            mul_add(n, n, m, a, w, &mut r);
            mul_add_nt(n, m, m, w, b, &mut r);
            assert!(r.iter().all(|v| v.abs() < 1e-12), "AW + WB' + C: {r:?}");
        }
    }
}

#[test]
fn margins_are_lower_bounds_and_tight_after_many_squarings() {
    // Triangular: the eigenvalues are on the diagonal, far from normal.
    let a = [-0.5, 3.0, -7.0, 0.0, -0.01, 2.0, 0.0, 0.0, -4.0];
    let mut cayley = Cayley::<f64>::new(3);
    let gamma = gamma_of(3, &a, &mut [0.0; 9], &mut [0.0; 3]);
    cayley.set(&a, gamma);
    assert!(cayley.powers.stable);
    let margin = cayley.margin();
    assert!(margin > 0.006 && margin <= 0.01, "{margin}");
    let mut powers = Powers::<f64>::new(1);
    powers.set(&[-0.999]);
    assert!(powers.stable && (powers.margin() - 0.001).abs() < 1e-12);
    for f in [1.0, -1.0, 1.5, f64::NAN, f64::INFINITY] {
        powers.set(&[f]);
        let margin = powers.margin();
        assert!(!powers.stable && (margin <= 0.0 || margin.is_nan()), "{f}");
    }
    powers.set(&[0.0]);
    assert!(powers.stable && powers.margin() == 1.0 && powers.count() == 0);
}

#[test]
fn twice_the_precision_proves_what_one_number_cannot() {
    use crate::real::Twice;
    // A Jordan block whose powers grow to 1e8 before they decay.
    let n = 10;
    let entry = |e: usize| match e % (n + 1) {
        0 => 0.9,
        1 if e < n * n - 1 => 1.0,
        _ => 0.0,
    };
    let block: Vec<f64> = (0..n * n).map(entry).collect();
    let mut powers = Powers::<f64>::new(n);
    powers.set(&block);
    assert!(!powers.stable);
    let block: Vec<Twice> = block.into_iter().map(Twice::splat).collect();
    let mut powers = Powers::<Twice>::new(n);
    powers.set(&block);
    assert!(powers.stable && powers.margin().lane(0) > 0.0);
}

#[test]
fn norms_of_powers_bound_a_sum() {
    let mut random = Sequence(77);
    for case in 0..200 {
        let n = 1 + case % 9;
        let reach = [0.3, 0.7, 0.95, 1.2][case % 4];
        let f: Vec<f64> = random.take(n * n).iter().map(|x| x * reach).collect();
        let mut powers = Powers::new(n);
        powers.set(&f);
        if !powers.stable {
            continue;
        }
        let v = random.take(n * n);
        let q: Vec<f64> = (0..n * n).map(|e| v[e] + v[e % n * n + e / n]).collect();
        let mut x = q.clone();
        stein(&powers, &mut x, &mut vec![0.0; 2 * n * n]);
        let norm = |x: &[f64]| x.iter().map(|v| v * v).sum::<f64>().sqrt();
        let (sum, most) = (norm(&x), norm(&q) * powers.sum_at_most());
        assert!(sum <= most * (1.0 + 1e-12), "order {n}: {sum} above {most}");
    }
}
