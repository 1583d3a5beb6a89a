//! Every tier gives the bits of the scalar oracle, whatever the numbers: zeros,
//! subnormals, infinities and NaN included (payloads and signs of NaN excepted).

use mmae::real::{Mask, Real, Tier, exp, ln, sin_cos};
use mmae::simd::{Block, Kernel, LANES, dispatch_on, groups, load_group, store_group};
use mmae::small::{self, Const, Cx, Dim, Dyn};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

/// A function of `T` numbers under test.
trait Case {
    /// Numbers it returns.
    fn n_out(&self) -> usize;
    /// Computes them; `out` holds leftovers of other work.
    fn call<T: Real>(&self, input: &[T], out: &mut [T]);
}

/// Runs a case on blocks, all lanes at once or one item at a time.
struct OnBlocks<'a, C>(&'a C, &'a [Block]);

impl<C: Case> Kernel for OnBlocks<'_, C> {
    type Out = Vec<Block>;
    #[inline(always)]
    fn run<T: Real>(self) -> Vec<Block> {
        let OnBlocks(case, input) = self;
        let mut result = vec![Block::default(); case.n_out()];
        let mut numbers = vec![T::splat(f64::NAN); input.len()];
        for group in 0..groups::<T>() {
            load_group(input, group, &mut numbers);
            // Dirty scratch: a NaN that leaks shows.
            let mut out = vec![T::splat(f64::NAN); case.n_out()];
            case.call(&numbers, &mut out);
            store_group(&out, group, &mut result);
        }
        result
    }
}

fn same(a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan())
}

/// Compares every available tier with the oracle; returns the oracle's results.
#[track_caller]
fn check<C: Case>(name: &str, case: &C, input: &[Block]) -> Vec<Block> {
    let oracle = dispatch_on(Tier::Scalar, OnBlocks(case, input)).unwrap();
    for tier in [Tier::Baseline, Tier::Avx2, Tier::Avx512] {
        let Some(lanes) = dispatch_on(tier, OnBlocks(case, input)) else { continue };
        for (e, (x, y)) in oracle.iter().zip(&lanes).enumerate() {
            for l in 0..LANES {
                let (x, y) = (x.0[l], y.0[l]);
                assert!(same(x, y), "{name}, {tier}, output {e}, lane {l}: {x:e} != {y:e}");
            }
        }
    }
    oracle
}

/// Numbers that arithmetic trips over.
const SPECIAL: [f64; 24] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    1.5,
    2.5,
    -2.5,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::NAN,
    f64::MIN_POSITIVE,
    -f64::MIN_POSITIVE,
    5e-324,
    -5e-324,
    1.1e-310,
    f64::MAX,
    f64::MIN,
    1e154,
    4503599627370495.5,
    -4503599627370497.0,
    709.78,
    -745.13,
    1e22,
];

fn random(rng: &mut StdRng) -> f64 {
    rng.random_range(-1.0..1.0)
}

/// Blocks of ordinary numbers, with trouble in some lanes: NaN in lane 2,
/// infinity in 3, zeros in 4, subnormals in 5, huge numbers in 6.
fn troubled(rng: &mut StdRng, n: usize) -> Vec<Block> {
    let mut blocks: Vec<Block> =
        (0..n).map(|_| Block(std::array::from_fn(|_| random(rng)))).collect();
    if n > 0 {
        blocks[rng.random_range(0..n)].0[2] = f64::NAN;
        blocks[rng.random_range(0..n)].0[3] = f64::INFINITY;
    }
    for block in &mut blocks {
        block.0[4] = 0.0;
        block.0[5] *= 1e-308;
        block.0[6] *= 1e160;
    }
    blocks
}

/// A truth value as a number.
fn flag<T: Real>(mask: T::Mask) -> T {
    T::select(mask, T::one(), T::zero())
}

struct Arithmetic;
impl Case for Arithmetic {
    fn n_out(&self) -> usize {
        34
    }
    #[inline(always)]
    fn call<T: Real>(&self, input: &[T], out: &mut [T]) {
        let (x, y, z) = (input[0], input[1], input[2]);
        let integer = (y * T::splat(1000.0)).round_ties_even();
        let inside = integer.abs().le(T::splat(1022.0));
        let integer = T::select(inside, integer, T::zero());
        let (significand, exponent) = x.split();
        let normal = x.is_finite() & x.abs().ge(T::splat(f64::MIN_POSITIVE));
        let (near_one, power) = T::select(normal, x.abs(), T::one()).split_near_one();
        let both = x.lt(y) & y.le(z);
        let either = x.lt(y) | y.le(z);
        let all = [
            x + y,
            x - y,
            x * y,
            x / y,
            -x,
            x.mul_add(y, z),
            x.neg_mul_add(y, z),
            x.mul_sub(y, z),
            x.sqrt(),
            x.abs(),
            x.copysign(y),
            x.max(y),
            x.min(y),
            x.round_ties_even(),
            x.recip(),
            T::pow2i(integer),
            significand,
            exponent,
            near_one,
            power,
            flag(x.lt(y)),
            flag(x.le(y)),
            flag(x.gt(y)),
            flag(x.ge(y)),
            flag(x.eq(y)),
            flag(both),
            flag(either),
            flag(!both),
            flag(x.is_finite()),
            T::select(x.lt(y), z, x),
            T::from_fn(|i| x.lane(i)),
            T::from_fn(|i| f64::from(u8::from(both.lane(i)))),
            flag(<T::Mask as Mask>::splat(true)),
            x.map_lanes(|v| v * 3.0),
        ];
        out.copy_from_slice(&all);
    }
}

#[test]
fn arithmetic() {
    let mut rng = StdRng::seed_from_u64(1);
    let mut pairs = Vec::new();
    for &x in &SPECIAL {
        for &y in &SPECIAL {
            for &z in &SPECIAL {
                pairs.push([x, y, z]);
            }
        }
    }
    for _ in 0..4000 {
        pairs.push(std::array::from_fn(|_| {
            let scale: i32 = rng.random_range(-1074..1023);
            random(&mut rng) * 2_f64.powi(scale)
        }));
    }
    for eight in pairs.chunks_exact(LANES) {
        let input: Vec<Block> =
            (0..3).map(|e| Block(std::array::from_fn(|l| eight[l][e]))).collect();
        check("arithmetic", &Arithmetic, &input);
    }
}

#[test]
fn masks_see_every_lane() {
    struct AnyAll;
    impl Kernel for AnyAll {
        type Out = ();
        #[inline(always)]
        fn run<T: Real>(self) {
            for l in 0..T::LANES {
                let one = T::from_fn(|i| f64::from(u8::from(i == l))).eq(T::one());
                assert!(one.any() && one.lane(l));
                assert_eq!(one.all(), T::LANES == 1);
                assert!((!one).any() != (T::LANES == 1) && !(!one).all());
                assert!((one | !one).all() && !(one & !one).any());
            }
        }
    }
    for tier in Tier::ALL {
        dispatch_on(tier, AnyAll);
    }
}

struct Elementary;
impl Case for Elementary {
    fn n_out(&self) -> usize {
        4
    }
    #[inline(always)]
    fn call<T: Real>(&self, input: &[T], out: &mut [T]) {
        let x = input[0];
        let (s, c) = sin_cos(x);
        out.copy_from_slice(&[exp(x), ln(x), s, c]);
    }
}

#[test]
fn elementary_functions() {
    let mut rng = StdRng::seed_from_u64(4);
    let mut points = SPECIAL.to_vec();
    for _ in 0..20_000 {
        let scale: i32 = rng.random_range(-1074..1023);
        points.push(random(&mut rng) * 2_f64.powi(scale));
        points.push(random(&mut rng) * 2_f64.powi(scale % 24));
    }
    for eight in points.chunks_exact(LANES) {
        check("elementary", &Elementary, &[Block(std::array::from_fn(|l| eight[l]))]);
    }
}

/// Matrix exponential and complex systems of order `n`.
struct Larger(usize);
impl Case for Larger {
    fn n_out(&self) -> usize {
        3 * self.0 * self.0 + 2
    }
    #[inline(always)]
    fn call<T: Real>(&self, input: &[T], out: &mut [T]) {
        let n = self.0;
        let (a, b) = input.split_at(n * n);
        let nan = T::splat(f64::NAN);
        let mut work = vec![nan; small::expm_work(n)];
        let (e, rest) = out.split_at_mut(n * n);
        let finite = small::expm(Dyn(n), a, e, &mut work);
        let mut matrix: Vec<_> = a.iter().zip(b).map(|(&re, &im)| Cx::new(re, im)).collect();
        let mut x: Vec<_> = b.iter().zip(a).map(|(&re, &im)| Cx::new(re, im)).collect();
        let ok = small::cx_solve(Dyn(n), Dyn(n), &mut matrix, &mut x);
        for (two, z) in rest.chunks_exact_mut(2).zip(&x) {
            two.copy_from_slice(&[z.re, z.im]);
        }
        rest[2 * n * n..].copy_from_slice(&[flag(finite), flag(ok)]);
    }
}

#[test]
fn exponentials_and_complex_systems() {
    let mut rng = StdRng::seed_from_u64(5);
    for n in 1..=17 {
        let mut input = troubled(&mut rng, 2 * n * n);
        for block in &mut input {
            // Scalings that differ between lanes.
            block.0[0] *= 40.0;
            block.0[7] *= 1e-3;
        }
        let out = check(&format!("order {n}"), &Larger(n), &input);
        let finite = out[3 * n * n].0;
        assert!(finite[0] == 1.0 && finite[4] == 1.0, "{finite:?}");
    }
}

/// All of `small` on square and rectangular matrices of order `n`.
struct Algebra {
    n: Dyn,
    m: Dyn,
}

impl Case for Algebra {
    fn n_out(&self) -> usize {
        let (n, m) = (self.n.get(), self.m.get());
        12 * n * n + 11 * n * m + n + 10
    }
    #[inline(always)]
    fn call<T: Real>(&self, input: &[T], out: &mut [T]) {
        let (dn, dm) = (self.n, self.m);
        let (n, m) = (dn.get(), dm.get());
        let (a, rest) = input.split_at(n * n);
        let (b, rest) = rest.split_at(n * n);
        let (f, _) = rest.split_at(n * m);
        let nan = T::splat(f64::NAN);
        let (mut square, mut thin, mut perm) = (vec![nan; n * n], vec![nan; n * m], vec![nan; n]);
        let mut at = 0;
        let mut emit = |numbers: &[T]| {
            out[at..at + numbers.len()].copy_from_slice(numbers);
            at += numbers.len();
        };

        small::mul(dn, dn, dn, a, b, &mut square);
        emit(&square);
        small::mul_add_nt(dn, dn, dn, a, b, &mut square);
        emit(&square);
        small::mul_sub_tn(dn, dn, dn, a, b, &mut square);
        emit(&square);
        small::mul(dn, dn, dm, a, f, &mut thin);
        emit(&thin);
        small::mul_add_tn(dn, dn, dm, b, f, &mut thin);
        emit(&thin);
        small::mul_sub(dn, dn, dm, b, f, &mut thin);
        emit(&thin);
        small::mul_tn(dm, dn, dn, f, a, &mut thin);
        emit(&thin);
        small::mul_add(dm, dn, dn, &thin.clone(), a, &mut thin);
        emit(&thin);
        small::sym_mul_nt(dn, dm, f, f, &mut square);
        emit(&square);
        let mut work = vec![nan; n * n];
        small::sym_update(dn, dn, a, &square.clone(), b, &mut square, &mut work);
        emit(&square);
        small::sym_mul_sub_tn(dn, dn, a, a, &mut square);
        emit(&square);
        small::sym_mul_add(dn, dn, b, a, &mut square);
        emit(&square);
        small::symmetrize(dn, &mut square);
        emit(&square);
        small::transpose(dn, dm, f, &mut thin);
        emit(&thin);
        emit(&[
            small::norm_1(dn, dm, f),
            small::norm_max(a),
            small::norm_frobenius(b),
            small::trace(dn, a),
            small::dot(a, b),
        ]);

        square.copy_from_slice(a);
        thin.copy_from_slice(f);
        let info = small::solve(dn, dm, &mut square, &mut thin, &mut perm);
        emit(&square);
        emit(&thin);
        emit(&perm);
        emit(&[flag(info.ok), info.pivot_ratio]);
        square.copy_from_slice(b);
        let info = small::inverse(dn, &mut square, &mut work, &mut perm);
        emit(&work);
        emit(&[flag(info.ok), info.pivot_ratio]);

        small::sym_mul_nt(dn, dn, a, a, &mut square);
        let ok = small::cholesky(dn, &mut square);
        emit(&square);
        emit(&[flag(ok)]);
        thin.copy_from_slice(f);
        small::cholesky_solve(dn, dm, &square, &mut thin);
        emit(&thin);
        small::solve_lower_t(dn, dm, a, &mut thin);
        emit(&thin);
        small::solve_upper(dn, dm, a, &mut thin);
        emit(&thin);
        small::solve_lower_unit(dn, dm, a, &mut thin);
        emit(&thin);
        square.copy_from_slice(a);
        emit(&square);
        assert_eq!(at, self.n_out());
    }
}

#[test]
fn algebra_of_every_size() {
    let mut rng = StdRng::seed_from_u64(2);
    for n in 1..=17 {
        for m in [1, 2, 3, n, n + 1] {
            let input = troubled(&mut rng, 2 * n * n + n * m);
            check(&format!("algebra {n} {m}"), &Algebra { n: Dyn(n), m: Dyn(m) }, &input);
        }
    }
}

/// The functions that unroll when sizes are fixed.
struct Unrolled<N, M> {
    n: N,
    m: M,
}

impl<N: Dim, M: Dim> Case for Unrolled<N, M> {
    fn n_out(&self) -> usize {
        let (n, m) = (self.n.get(), self.m.get());
        2 * n * n + 3 * n * m
    }
    #[inline(always)]
    fn call<T: Real>(&self, input: &[T], out: &mut [T]) {
        let (dn, dm) = (self.n, self.m);
        let (n, m) = (dn.get(), dm.get());
        let (a, f) = input.split_at(n * n);
        let (symmetric, rest) = out.split_at_mut(n * n);
        let (lu, rest) = rest.split_at_mut(n * n);
        let (product, rest) = rest.split_at_mut(n * m);
        let (solution, other) = rest.split_at_mut(n * m);
        let nan = T::splat(f64::NAN);
        small::mul(dn, dn, dm, a, f, product);
        solution.copy_from_slice(f);
        lu.copy_from_slice(a);
        let _ = small::solve(dn, dm, lu, solution, &mut vec![nan; n]);
        small::sym_update(dn, dn, a, a, a, symmetric, &mut vec![nan; n * n]);
        let mut l = symmetric.to_vec();
        let _ = small::cholesky(dn, &mut l);
        other.copy_from_slice(f);
        small::cholesky_solve(dn, dm, &l, other);
    }
}

/// Fixed sizes on every tier against the oracle with run-time sizes.
#[track_caller]
fn unrolled<N: Dim, M: Dim>(rng: &mut StdRng, n: N, m: M) {
    let (dn, dm) = (Dyn(n.get()), Dyn(m.get()));
    let input = troubled(rng, dn.get() * (dn.get() + dm.get()));
    let name = format!("unrolled {n:?} {m:?}");
    let fixed = check(&name, &Unrolled { n, m }, &input);
    let dynamic = dispatch_on(Tier::Scalar, OnBlocks(&Unrolled { n: dn, m: dm }, &input)).unwrap();
    for (x, y) in fixed.iter().zip(&dynamic) {
        assert!(x.0.iter().zip(&y.0).all(|(&x, &y)| same(x, y)), "{name}: Const and Dyn differ");
    }
}

#[test]
fn fixed_and_run_time_sizes_agree() {
    let rng = &mut StdRng::seed_from_u64(3);
    unrolled(rng, Const::<1>, Const::<1>);
    unrolled(rng, Const::<3>, Const::<2>);
    unrolled(rng, Const::<4>, Const::<4>);
    unrolled(rng, Const::<5>, Const::<6>);
}

#[test]
fn significands_near_one() {
    let (low, high) = (std::f64::consts::FRAC_1_SQRT_2, std::f64::consts::SQRT_2);
    let edges = [low, high, low.next_up(), high.next_up(), 1.0, 2.0, f64::MIN_POSITIVE, f64::MAX];
    for x in edges.into_iter().flat_map(|x| [x, 0.25 * x.max(1e-300), x.next_down().max(1e-300)]) {
        let (m, e) = x.split_near_one();
        assert!(m > low && m <= high, "{x:e}: {m}");
        // in two factors: 2^1024 is out of range
        let half = (0.5 * e).floor();
        assert_eq!(m * f64::pow2i(half) * f64::pow2i(e - half), x, "{x:e}");
        assert_eq!(e.fract(), 0.0);
    }
}
