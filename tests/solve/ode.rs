//! Steps of the Riccati differential equation.

use super::batch::{covariances, random};
use super::common::data;
use super::common::matrix::M;
use super::reference::{error, flat};
use mmae::Error;
use mmae::solve::{ItemReport, Riccati, RiccatiOde, care, riccati_ode};

fn step(f: &M, h: &M, q: &M, r: &M, p: &[f64], dt: f64) -> (Vec<f64>, ItemReport) {
    let (n, m) = (f.len(), r.len());
    let (f, h, q, r) = (flat(f), flat(h), flat(q), flat(r));
    let problem = RiccatiOde { n, m, len: 1, F: &f, H: &h, Q: &q, R: &r, P: p, h: &[dt] };
    let mut s = riccati_ode(&problem).unwrap();
    (s.x, s.items.remove(0))
}

/// In one step, and in several of different lengths.
#[test]
fn reference_steps() {
    let mut worst = Vec::new();
    for c in data::cases(&data::load("rde.json")) {
        let [f, h, q, r, p0] = ["F", "H", "Q", "R", "P0"].map(|key| data::matrix(&c[key]));
        let mut walked = (0.0, flat(&p0));
        for at in c["times"].as_array().unwrap() {
            let (t, x) = (at["t"].as_f64().unwrap(), flat(&data::matrix(&at["P"])));
            let (direct, report) = step(&f, &h, &q, &r, &flat(&p0), t);
            assert_eq!(report.status, Ok(()));
            let (next, _) = step(&f, &h, &q, &r, &walked.1, t - walked.0);
            walked = (t, next);
            let (e, w) = (error(&direct, &x), error(&walked.1, &x));
            worst.push(e.max(w));
        }
    }
    assert!(worst.iter().all(|&e| e < 1e-13), "{worst:?}");
}

#[test]
fn long_steps_reach_the_algebraic_solution() {
    for (n, m) in [(1, 1), (2, 1), (4, 2), (7, 3)] {
        let len = 9;
        let f: Vec<f64> = random(n as u64, len * n * n).iter().map(|x| 3.0 * x).collect();
        let h = random(n as u64 + 1, len * m * n);
        let (q, r) = (covariances(3, n, len, 0.05), covariances(4, m, len, 0.1));
        let p = covariances(5, n, len, 0.0);
        let transposed = |x: &[f64], rows: usize, cols: usize| -> Vec<f64> {
            x.chunks_exact(rows * cols)
                .flat_map(|x| (0..rows * cols).map(|e| x[e % rows * cols + e / rows]))
                .collect()
        };
        let (a, b) = (transposed(&f, n, n), transposed(&h, m, n));
        let steady = care(&Riccati { n, m, len, A: &a, B: &b, Q: &q, R: &r, S: None }).unwrap();
        for t in [1e3, 1e12, 1e300] {
            let ode = RiccatiOde { n, m, len, F: &f, H: &h, Q: &q, R: &r, P: &p, h: &[t] };
            let late = riccati_ode(&ode).unwrap();
            for k in 0..len {
                let (x, y) = (late.item(k).unwrap(), steady.item(k).unwrap());
                let e = error(x, y);
                assert!(e < 1e-12, "n = {n}, item {k}, h = {t}: {e:e}");
            }
        }
    }
}

#[test]
fn closed_forms_of_the_scalar_equation() {
    let scalar = |f: f64, c: f64, q: f64, p: f64, h: f64| {
        let problem = RiccatiOde {
            n: 1,
            m: 1,
            len: 1,
            F: &[f],
            H: &[c],
            Q: &[q],
            R: &[1.0],
            P: &[p],
            h: &[h],
        };
        let s = riccati_ode(&problem).unwrap();
        s.item(0).map(|x| x[0])
    };
    // p' = -p^2: p = p0 / (1 + p0 t), from far above; and below zero it escapes at -1/p0
    assert!((scalar(0.0, 1.0, 0.0, 1e12, 1.0).unwrap() - 1e12 / (1.0 + 1e12)).abs() < 1e-15);
    assert!((scalar(0.0, 1.0, 0.0, -0.5, 1.0).unwrap() + 1.0).abs() < 1e-15);
    assert!(matches!(scalar(0.0, 1.0, 0.0, -0.5, 4.0), Err(Error::FiniteEscape { .. })));
    // p' = -1 - p^2: p = -tan(t), which leaves at pi/2, and again later
    assert!((scalar(0.0, 1.0, -1.0, 0.0, 1.5).unwrap() + 1.5_f64.tan()).abs() < 1e-13);
    for h in [1.6, 3.0, 4.0, 40.0, 1e9] {
        let result = scalar(0.0, 1.0, -1.0, 0.0, h);
        assert!(matches!(result, Err(Error::FiniteEscape { .. })), "h = {h}: {result:?}");
    }
    // p' = 2 p + 1 without a measurement: (e^2t - 1)/2, until it overflows
    let p = scalar(1.0, 0.0, 1.0, 0.0, 5.0).unwrap();
    assert!((p / (0.5 * 10.0_f64.exp_m1()) - 1.0).abs() < 1e-14);
    assert!(matches!(scalar(1.0, 0.0, 1.0, 0.0, 1e4), Err(Error::Range { .. })));
    // p' = 2 p - p^2: unstable without noise. Zero stays; anything else ends at 2.
    assert_eq!(scalar(1.0, 1.0, 0.0, 0.0, 1e5).unwrap(), 0.0);
    assert!((scalar(1.0, 1.0, 0.0, 1e-9, 1e5).unwrap() - 2.0).abs() < 1e-15);
    for h in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let result = scalar(0.0, 1.0, 1.0, 0.0, h);
        let expected = matches!(result, Err(Error::InvalidDt { .. } | Error::NonFinite { .. }));
        assert!(expected, "h = {h}: {result:?}");
    }
}

#[test]
fn an_item_of_a_batch_has_the_bits_it_has_alone() {
    let (n, m, len) = (3, 2, 13);
    let (f, h) = (random(1, len * n * n), random(2, len * m * n));
    let (q, r) = (covariances(3, n, len, 0.0), covariances(4, m, len, 0.1));
    let p = covariances(5, n, len, 0.0);
    let t: Vec<f64> = (0..len).map(|k| 10.0_f64.powi(k as i32 - 6)).collect();
    let all = RiccatiOde { n, m, len, F: &f, H: &h, Q: &q, R: &r, P: &p, h: &t };
    let whole = riccati_ode(&all).unwrap();
    for k in 0..len {
        let part = |x: &[f64]| x[k * x.len() / len..(k + 1) * x.len() / len].to_vec();
        let (f, h, q, r, p, t) = (part(&f), part(&h), part(&q), part(&r), part(&p), part(&t));
        let one = RiccatiOde { n, m, len: 1, F: &f, H: &h, Q: &q, R: &r, P: &p, h: &t };
        let one = riccati_ode(&one).unwrap();
        super::common::assert_bits("item", whole.item(k).unwrap(), &one.x);
        assert_eq!(whole.items[k].iterations, one.items[0].iterations);
    }
}
