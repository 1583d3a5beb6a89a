#![allow(missing_docs, clippy::all, clippy::print_stdout)]
use mmae::real::*;
use mmae::simd::*;
use mmae::small::*;
use std::hint::black_box;
use std::time::Instant;

#[derive(Clone, Copy, PartialEq)]
enum Op {
    Copy,
    SymNt,
    SymAdd,
    Add,
    Mul,
    Nt,
    Sym,
    Solve,
    Fact,
    Chol,
    CholSolve,
    Expm,
}

struct Bench<'a, N> {
    n: N,
    op: Op,
    count: usize,
    a: &'a [Block],
    b: &'a [Block],
    c: &'a mut [Block],
}
impl<N: Dim> Kernel for Bench<'_, N> {
    type Out = ();
    #[inline(always)]
    fn run<T: Real>(self) {
        let n = self.n;
        let s = n.get() * n.get();
        let (a, b, c) =
            (T::view(self.a).unwrap(), T::view(self.b).unwrap(), T::view_mut(self.c).unwrap());
        let mut w = [T::zero(); 256];
        let mut perm = [T::zero(); 32];
        for _ in 0..20 {
            for i in 0..self.count {
                let (a, b, c) = (&a[i * s..][..s], &b[i * s..][..s], &mut c[i * s..][..s]);
                match self.op {
                    Op::Mul => mul(n, n, n, a, b, c),
                    Op::Nt => mul_nt(n, n, n, a, b, c),
                    Op::Sym => sym_update(n, n, a, b, b, c, &mut w[..s]),
                    Op::Solve => {
                        w[..s].copy_from_slice(a);
                        c.copy_from_slice(b);
                        solve(n, n, &mut w[..s], c, &mut perm[..n.get()]);
                    }
                    Op::Fact => {
                        c.copy_from_slice(a);
                        let _ = lu_factor(n, c, &mut perm[..n.get()]);
                    }
                    Op::Chol => {
                        c.copy_from_slice(b);
                        let _ = cholesky(n, c);
                    }
                    Op::CholSolve => {
                        w[..s].copy_from_slice(b);
                        let _ = cholesky(n, &mut w[..s]);
                        c.copy_from_slice(a);
                        cholesky_solve(n, n, &w[..s], c);
                    }
                    Op::Copy => c.copy_from_slice(b),
                    Op::SymNt => sym_mul_nt(n, n, a, b, c),
                    Op::SymAdd => sym_mul_add_nt(n, n, a, b, c),
                    Op::Add => mul_add(n, n, n, a, b, c),
                    Op::Expm => {}
                }
            }
        }
    }
}
struct Peak<const C: usize>(usize);
impl<const C: usize> Kernel for Peak<C> {
    type Out = f64;
    #[inline(always)]
    fn run<T: Real>(self) -> f64 {
        let mut s = [T::zero(); C];
        for (i, x) in s.iter_mut().enumerate() {
            *x = T::from_fn(|l| black_box((i * 8 + l) as f64));
        }
        let m = black_box(T::splat(0.999));
        let b = black_box(T::splat(0.001));
        for _ in 0..self.0 {
            for x in &mut s {
                *x = x.mul_add(m, b);
            }
        }
        let mut t = s[0];
        for x in &s[1..] {
            t = t + *x;
        }
        (0..8).map(|i| t.lane(i)).sum()
    }
}
struct Rng(u64);
impl Rng {
    fn f(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 53) as f64 * 2.0 - 1.0
    }
}

fn best(mut f: impl FnMut()) -> f64 {
    let mut best = f64::MAX;
    let start = Instant::now();
    while start.elapsed().as_millis() < 120 {
        let t = Instant::now();
        for _ in 0..10 {
            f();
        }
        best = best.min(t.elapsed().as_secs_f64() / 10.0);
    }
    best
}
fn case<N: Dim>(tier: Tier, n: N, peak: f64) {
    let nn = n.get();
    let s = nn * nn;
    let count = (128 / s).max(1);
    let mut r = Rng(88172645463325252);
    let dom: f64 = std::env::args().nth(2).map_or(0.0, |x| x.parse().unwrap());
    let mut a = vec![Block::default(); count * s];
    let mut b = a.clone();
    let mut c = a.clone();
    for i in 0..count {
        for l in 0..8 {
            let g: Vec<f64> = (0..s).map(|_| r.f()).collect();
            for e in 0..s {
                a[i * s + e].0[l] = r.f() + if e % (nn + 1) == 0 { dom } else { 0.0 };
            }
            for x in 0..nn {
                for y in 0..nn {
                    b[i * s + x * nn + y].0[l] =
                        (0..nn).map(|k| g[x * nn + k] * g[y * nn + k]).sum::<f64>()
                            + if x == y { 1.0 } else { 0.0 };
                }
            }
        }
    }
    let n3 = (s * nn) as f64;
    print!("{tier:9} n={nn:2} {} ", if N::FIXED.is_some() { "const" } else { "dyn  " });
    for (name, op, fma) in [
        ("copy", Op::Copy, 0.0),
        ("symnt", Op::SymNt, 0.5 * n3),
        ("symadd", Op::SymAdd, 0.5 * n3),
        ("add", Op::Add, n3),
        ("mul", Op::Mul, n3),
        ("nt", Op::Nt, n3),
        ("sym", Op::Sym, 1.5 * n3),
        ("fact", Op::Fact, n3 / 3.0),
        ("solve", Op::Solve, n3 * 4.0 / 3.0),
        ("chol", Op::Chol, n3 / 6.0),
        ("cholsolve", Op::CholSolve, n3 * 7.0 / 6.0),
    ] {
        let t = best(|| {
            dispatch_on(tier, Bench { n, op, count, a: black_box(&a), b: &b, c: &mut c });
        });
        let ns = t / count as f64 * 1e9 / 20.0;
        print!(" {name} {ns:6.0}ns {:4.1}%", 100.0 * fma * 8.0 * 2.0 / ns / peak);
    }
    println!();
}
fn main() {
    let tiers = match std::env::args().nth(1).as_deref() {
        Some(t) if t != "all" => vec![Tier::from_name(t).unwrap()],
        _ => vec![Tier::Avx512, Tier::Avx2],
    };
    for tier in tiers {
        let (t, c) = if tier == Tier::Avx512 {
            (
                best(|| {
                    black_box(dispatch_on(tier, Peak::<12>(1000)));
                }),
                12.0,
            )
        } else {
            (
                best(|| {
                    black_box(dispatch_on(tier, Peak::<6>(1000)));
                }),
                6.0,
            )
        };
        let peak = c * 1000.0 * 16.0 / t / 1e9;
        println!("{tier} peak {peak:.1} GFLOP/s");
        if std::env::args().len() > 3 {
            return;
        }
        case(tier, Const::<2>, peak);
        case(tier, Dyn(2), peak);
        case(tier, Const::<3>, peak);
        case(tier, Dyn(3), peak);
        case(tier, Const::<4>, peak);
        case(tier, Dyn(4), peak);
        case(tier, Const::<5>, peak);
        case(tier, Dyn(5), peak);
        case(tier, Const::<6>, peak);
        case(tier, Dyn(6), peak);
        case(tier, Const::<8>, peak);
        case(tier, Dyn(8), peak);
        case(tier, Dyn(12), peak);
        case(tier, Dyn(16), peak);
    }
}
