//! Small algebra against naive loops, closed forms and faer.

use faer::linalg::solvers::Solve;
use faer::{Mat, MatRef};
use mmae::small::{self, Const, Cx, Dyn};
use proptest::prelude::*;

fn naive(m: usize, k: usize, n: usize, a: &[f64], b: &[f64]) -> Vec<f64> {
    let mut c = vec![0.0; m * n];
    for i in 0..m {
        for j in 0..n {
            for p in 0..k {
                c[i * n + j] += a[i * k + p] * b[p * n + j];
            }
        }
    }
    c
}

fn transposed(m: usize, n: usize, a: &[f64]) -> Vec<f64> {
    let mut b = vec![f64::NAN; m * n];
    small::transpose(Dyn(m), Dyn(n), a, &mut b);
    b
}

fn view(m: usize, n: usize, a: &[f64]) -> MatRef<'_, f64> {
    MatRef::from_row_major_slice(a, m, n)
}

#[track_caller]
fn close(x: &[f64], y: &[f64], bound: f64) {
    assert_eq!(x.len(), y.len());
    let scale = y.iter().fold(1.0_f64, |s, v| s.max(v.abs()));
    for (x, y) in x.iter().zip(y) {
        assert!((x - y).abs() <= bound * scale, "{x} != {y} within {bound:e} of {scale}");
    }
}

fn numbers(n: usize) -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(-1.0..1.0_f64, n)
}

/// Sizes `m`, `k`, `n` with matrices m x k, k x n and m x n.
fn factors() -> impl Strategy<Value = (usize, usize, usize, Vec<f64>, Vec<f64>, Vec<f64>)> {
    (0..18_usize, 0..18_usize, 0..18_usize).prop_flat_map(|(m, k, n)| {
        (Just(m), Just(k), Just(n), numbers(m * k), numbers(k * n), numbers(m * n))
    })
}

/// An order with two square matrices and a right-hand side of `r` columns.
fn system() -> impl Strategy<Value = (usize, usize, Vec<f64>, Vec<f64>, Vec<f64>)> {
    (1..18_usize, 0..6_usize)
        .prop_flat_map(|(n, r)| (Just(n), Just(r), numbers(n * n), numbers(n * n), numbers(n * r)))
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn products((m, k, n, a, b, c) in factors()) {
        let (dm, dk, dn) = (Dyn(m), Dyn(k), Dyn(n));
        let (a_t, b_t) = (transposed(m, k, &a), transposed(k, n, &b));
        let exact = naive(m, k, n, &a, &b);
        let sum: Vec<f64> = c.iter().zip(&exact).map(|(c, p)| c + p).collect();
        let difference: Vec<f64> = c.iter().zip(&exact).map(|(c, p)| c - p).collect();
        let mut out = vec![f64::NAN; m * n];
        small::mul(dm, dk, dn, &a, &b, &mut out);
        close(&out, &exact, 1e-14);
        let first = out.clone();
        small::mul_nt(dm, dk, dn, &a, &b_t, &mut out);
        prop_assert_eq!(&out, &first);
        small::mul_tn(dm, dk, dn, &a_t, &b, &mut out);
        prop_assert_eq!(&out, &first);
        out.copy_from_slice(&c);
        small::mul_add(dm, dk, dn, &a, &b, &mut out);
        close(&out, &sum, 1e-14);
        out.copy_from_slice(&c);
        small::mul_sub_nt(dm, dk, dn, &a, &b_t, &mut out);
        close(&out, &difference, 1e-14);
        out.copy_from_slice(&c);
        small::mul_sub_tn(dm, dk, dn, &a_t, &b, &mut out);
        close(&out, &difference, 1e-14);
    }

    #[test]
    fn symmetric_products_are_the_plain_ones_made_symmetric((n, _r, a, b, _x) in system()) {
        let dn = Dyn(n);
        let mut p = naive(n, n, n, &b, &transposed(n, n, &b));
        small::symmetrize(dn, &mut p);
        let mut whole = vec![f64::NAN; n * n];
        let (mut half, mut work) = (whole.clone(), whole.clone());
        small::mul(dn, dn, dn, &a, &p, &mut work);
        small::mul_nt(dn, dn, dn, &work, &a, &mut whole);
        for (x, q) in whole.iter_mut().zip(&p) {
            *x += q;
        }
        small::sym_update(dn, dn, &a, &p, &p, &mut half, &mut work);
        close(&half, &whole, 1e-14);
        prop_assert_eq!(transposed(n, n, &half), half);
    }

    #[test]
    fn linear_systems_match_faer((n, r, a, _b, x) in system()) {
        let rhs = naive(n, n, r, &a, &x);
        let (mut lu, mut solution) = (a.clone(), rhs.clone());
        let info = small::solve(Dyn(n), Dyn(r), &mut lu, &mut solution, &mut vec![f64::NAN; n]);
        prop_assert!(info.ok);
        // Backward error: the residual is small however ill-conditioned A is.
        let scale = small::norm_max(&solution).max(1.0) * n as f64;
        let residual = naive(n, n, r, &a, &solution);
        close(&residual, &rhs, 1e-14 * scale);
        let full = view(n, n, &a).partial_piv_lu();
        let reference = full.solve(view(n, r, &rhs));
        let backward = view(n, n, &a) * &reference - view(n, r, &rhs);
        // Threshold pivoting loses at most two digits on partial pivoting here.
        let worst = residual.iter().zip(&rhs).fold(0.0_f64, |s, (x, y)| s.max((x - y).abs()));
        prop_assert!(worst <= 100.0 * backward.norm_max() + 1e-15 * scale);
    }

    #[test]
    fn inverse_times_matrix_is_identity((n, _r, a, _b, _x) in system()) {
        let mut a = a;
        for i in 0..n {
            a[i * n + i] += 3.0;
        }
        let mut inverse = vec![f64::NAN; n * n];
        let info = small::inverse(Dyn(n), &mut a.clone(), &mut inverse, &mut vec![f64::NAN; n]);
        prop_assert!(info.ok && info.pivot_ratio > 1e-6);
        let mut identity = vec![f64::NAN; n * n];
        small::identity(Dyn(n), &mut identity);
        close(&naive(n, n, n, &a, &inverse), &identity, 1e-11);
    }

    #[test]
    fn cholesky_of_a_covariance((n, r, a, _b, x) in system()) {
        let mut p = naive(n, n, n, &a, &transposed(n, n, &a));
        for i in 0..n {
            p[i * n + i] += 0.1;
        }
        let mut l = p.clone();
        prop_assert!(small::cholesky(Dyn(n), &mut l));
        let reference = view(n, n, &p).llt(faer::Side::Lower).unwrap();
        for i in 0..n {
            for j in 0..=i {
                prop_assert!((l[i * n + j] - reference.L()[(i, j)]).abs() < 1e-12);
            }
        }
        let mut solution = naive(n, n, r, &p, &x);
        small::cholesky_solve(Dyn(n), Dyn(r), &l, &mut solution);
        close(&solution, &x, 1e-10);
    }

    #[test]
    fn norms((m, _k, n, _a, _b, c) in factors()) {
        let matrix: Mat<f64> = view(m, n, &c).to_owned();
        prop_assert!((small::norm_frobenius(&c) - matrix.norm_l2()).abs() < 1e-13);
        prop_assert_eq!(small::norm_max(&c), matrix.norm_max());
        let columns = (0..n).map(|j| matrix.col(j).norm_l1()).fold(0.0_f64, f64::max);
        prop_assert!((small::norm_1(Dyn(m), Dyn(n), &c) - columns).abs() < 1e-13);
    }
}

#[test]
fn a_norm_tells_of_nan() {
    let mut a = [1.0; 9];
    for at in 0..9 {
        a[at] = f64::NAN;
        assert!(small::norm_max(&a).is_nan());
        assert!(small::norm_1(Dyn(3), Dyn(3), &a).is_nan());
        assert!(small::norm_frobenius(&a).is_nan());
        a[at] = 1.0;
    }
}

#[test]
fn singular_matrices_are_told_apart() {
    let perm = &mut [0.0; 2];
    let mut x = [1.0, 1.0];
    let info = small::solve(Const::<2>, Const::<1>, &mut [1.0, 2.0, 2.0, 4.0], &mut x, perm);
    assert!(!info.ok && info.pivot_ratio == 0.0);
    assert!(x.iter().all(|v| v.is_finite()));
    for bad in [f64::NAN, f64::INFINITY] {
        let info = small::lu_factor(Const::<2>, &mut [bad, 2.0, 2.0, 4.0], perm);
        assert!(!info.ok);
        let info = small::lu_factor(Const::<2>, &mut [1.0, 2.0, 2.0, bad], perm);
        assert!(!info.ok);
    }
}

#[test]
fn matrices_without_a_cholesky_factor_are_told_apart() {
    for bad in [[1.0, 2.0, 2.0, 4.0], [-1.0, 0.0, 0.0, 1.0], [1.0, 0.0, f64::NAN, 1.0]] {
        let mut l = bad;
        assert!(!small::cholesky(Const::<2>, &mut l));
    }
    let mut l = [f64::INFINITY, 0.0, 1.0, 1.0];
    assert!(!small::cholesky(Const::<2>, &mut l));
}

#[test]
#[should_panic(expected = "product: slices do not fit 2x2 times 2x2")]
fn wrong_sizes_panic_with_the_sizes() {
    small::mul(Dyn(2), Dyn(2), Dyn(2), &[1.0; 4], &[1.0; 3], &mut [0.0; 4]);
}

/// A table of `exp(A)` computed with 100 digits and more. The error of scaling
/// and squaring grows with the norm, up to where powers say otherwise.
#[test]
fn matrix_exponentials_match_a_table() {
    let table: serde_json::Value = serde_json::from_str(include_str!("data/expm.json")).unwrap();
    let numbers = |v: &serde_json::Value| -> Vec<f64> {
        v.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
    };
    for row in table.as_array().unwrap() {
        let (a, e) = (numbers(&row["a"]), numbers(&row["e"]));
        let n = row["n"].as_u64().unwrap() as usize;
        let mut out = vec![f64::NAN; n * n];
        let mut work = vec![f64::NAN; small::expm_work(n)];
        assert!(small::expm(Dyn(n), &a, &mut out, &mut work), "{}", row["name"]);
        let difference: Vec<f64> = out.iter().zip(&e).map(|(x, y)| x - y).collect();
        let error = small::norm_frobenius(&difference) / small::norm_frobenius(&e);
        let norm = small::norm_1(Dyn(n), Dyn(n), &a);
        let bound = (1e-15 * (1.0 + norm)).min(1e-13);
        assert!(error <= bound, "{}: {error:e} > {bound:e}", row["name"]);
    }
}

#[test]
fn the_exponential_of_zero_is_exactly_one() {
    let mut e = [f64::NAN; 9];
    let mut work = vec![f64::NAN; small::expm_work(3)];
    assert!(small::expm(Const::<3>, &[0.0; 9], &mut e, &mut work));
    assert_eq!(e, [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
}

#[test]
fn an_exponential_that_overflows_is_told() {
    let mut work = vec![0.0; small::expm_work(2)];
    let mut e = [0.0; 4];
    assert!(!small::expm(Const::<2>, &[800.0, 0.0, 0.0, 1.0], &mut e, &mut work));
    for bad in [f64::NAN, f64::INFINITY] {
        assert!(!small::expm(Const::<2>, &[1.0, bad, 0.0, 1.0], &mut e, &mut work));
        assert_eq!(e, [1.0, 0.0, 0.0, 1.0]);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn complex_systems((n, r, a, b, x) in system()) {
        let zip = |re: &[f64], im: &[f64]| -> Vec<Cx<f64>> {
            re.iter().zip(im).map(|(&re, &im)| Cx::new(re, im)).collect()
        };
        let matrix = zip(&a, &b);
        let wanted = zip(&x, &x.iter().rev().copied().collect::<Vec<_>>());
        let mut rhs = vec![Cx::zero(); n * r];
        for i in 0..n {
            for p in 0..n {
                for j in 0..r {
                    rhs[i * r + j] = matrix[i * n + p].mul_add(wanted[p * r + j], rhs[i * r + j]);
                }
            }
        }
        let mut solution = rhs.clone();
        prop_assert!(small::cx_solve(Dyn(n), Dyn(r), &mut matrix.clone(), &mut solution));
        let size = solution.iter().fold(1.0_f64, |s, z| s.max(z.abs1()));
        for i in 0..n {
            for j in 0..r {
                let residual = (0..n).fold(rhs[i * r + j], |sum, p| {
                    matrix[i * n + p].neg_mul_add(solution[p * r + j], sum)
                });
                prop_assert!(residual.abs1() < 1e-14 * n as f64 * size);
            }
        }
    }

    #[test]
    fn complex_arithmetic(a in -9.0..9.0_f64, b in -9.0..9.0_f64, c in -9.0..9.0_f64, e in -900..900_i32) {
        let (x, y) = (Cx::new(a, b), Cx::new(c, a - b));
        let tiny = |z: Cx<f64>| z.abs1() < 1e-13;
        prop_assert!(tiny(x.mul_add(y, x) - (x * y + x)));
        prop_assert!(tiny(x.neg_mul_add(y, x) - (x - x * y)));
        prop_assert!((x.norm_sqr() - (x * x.conj()).re).abs() < 1e-13);
        // Scaling by powers of two far outside the range of squares is exact.
        let far = x.scale(2_f64.powi(e));
        let one = far * far.recip() - Cx::real(1.0);
        prop_assert!(x.abs1() == 0.0 || tiny(one), "{one:?}");
        prop_assert!(x.abs1() == 0.0 || tiny(far / far - Cx::real(1.0)));
    }
}
