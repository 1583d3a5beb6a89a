//! Input that must be refused, or survived.

use mmae::Error;
use mmae::solve::{
    Lyapunov, Riccati, care, care_one, dare, lyapunov_continuous, lyapunov_discrete,
};
use mmae::{Mat, mat};

const EYE: [f64; 9] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];

fn base<'a>() -> Riccati<'a> {
    let (a, b) = (&[0.5, 0.2, 0.0, 0.0, 1.5, 0.3, 0.0, 0.0, -0.4], &[1.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
    Riccati { n: 3, m: 2, len: 1, A: a, B: b, Q: &EYE, R: &[2.0, 0.5, 0.5, 1.0], S: None }
}

#[test]
fn every_place_of_a_number_that_is_not_finite_is_named() {
    let p = base();
    let s = [0.0; 6];
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for (what, data, cols) in
            [("A", p.A, 3), ("B", p.B, 2), ("Q", p.Q, 3), ("R", p.R, 2), ("S", &s[..], 2)]
        {
            for at in 0..data.len() {
                let mut x = data.to_vec();
                x[at] = bad;
                let q = match what {
                    "A" => Riccati { A: &x, ..p },
                    "B" => Riccati { B: &x, ..p },
                    "Q" => Riccati { Q: &x, ..p },
                    "R" => Riccati { R: &x, ..p },
                    _ => Riccati { S: Some(&x), ..p },
                };
                let (row, col) = (at / cols, at % cols);
                let expected = Err(Error::NonFinite { what: what.into(), row, col });
                assert_eq!(care(&q).unwrap().items[0].status, expected);
                assert_eq!(dare(&q).unwrap().items[0].status, expected);
            }
        }
    }
}

#[test]
fn wrong_lengths_and_empty_batches_are_errors_of_the_whole() {
    let p = base();
    for q in [
        Riccati { A: &EYE[..8], ..p },
        Riccati { B: &EYE[..5], ..p },
        Riccati { Q: &EYE[..4], ..p },
        Riccati { R: &EYE[..3], ..p },
        Riccati { S: Some(&EYE[..5]), ..p },
        Riccati { len: 2, S: Some(&EYE[..5]), ..p },
    ] {
        assert!(matches!(care(&q), Err(Error::Shape { .. })));
    }
    assert!(matches!(care(&Riccati { len: 0, ..p }), Err(Error::Empty { .. })));
    let none = Riccati { n: 0, m: 0, len: 1, A: &[], B: &[], Q: &[], R: &[], S: None };
    assert!(matches!(dare(&none), Err(Error::Empty { .. })));
    let a = Mat::<f64>::zeros(2, 3);
    let one = mat![[1.0]];
    let refused = care_one(a.as_ref(), one.as_ref(), one.as_ref(), one.as_ref(), None);
    assert!(matches!(refused, Err(Error::Shape { .. })));
    // Too large to allocate: refused, not aborted.
    let huge = Lyapunov { n: 3, len: usize::MAX / 64, A: &EYE, Q: &EYE };
    assert!(matches!(lyapunov_continuous(&huge), Err(Error::Limit { .. })));
}

#[test]
fn asymmetry_is_averaged_or_refused() {
    let with = |difference: f64| {
        let mut q = EYE;
        q[1] = 0.5 + difference;
        q[3] = 0.5;
        care(&Riccati { Q: &q, ..base() }).unwrap().items.remove(0).status
    };
    assert_eq!(with(0.0), Ok(()));
    assert_eq!(with(1e-15), Ok(()));
    assert!(matches!(with(1e-6), Err(Error::NotSymmetric { what, .. }) if what == "Q"));
}

#[test]
fn weights_that_are_not_positive() {
    for r in [[0.0; 4], [1.0, 1.0, 1.0, 1.0]] {
        let status = care(&Riccati { R: &r, ..base() }).unwrap().items.remove(0).status;
        assert!(matches!(status, Err(Error::NotPositiveDefinite { .. })), "{r:?} {status:?}");
    }
    // A game: solved where a stabilizing solution exists, never without a flag.
    let item = care(&Riccati { R: &[1.0, 0.0, 0.0, -1.0], ..base() }).unwrap().items.remove(0);
    assert!(item.status.is_ok() && item.margin > 0.0 && !item.reliable, "{item:?}");
    // In discrete time R = 0 is solved where B'XB is regular: a deadbeat loop.
    let p = Riccati { n: 1, m: 1, len: 1, A: &[0.5], B: &[1.0], Q: &[2.0], R: &[0.0], S: None };
    let s = dare(&p).unwrap();
    assert!((s.item(0).unwrap()[0] - 2.0).abs() < 1e-15 && s.items[0].margin > 0.99);
    // Without input and weight there is nothing to invert.
    let status = dare(&Riccati { B: &[0.0], ..p }).unwrap().items.remove(0).status;
    assert!(status.is_err());
}

#[test]
fn awkward_spectra_end() {
    let mut jordan = vec![0.0; 100];
    for i in 0..10 {
        jordan[i * 11] = -1.0;
        if i < 9 {
            jordan[i * 11 + 1] = 1.0;
        }
    }
    let eye = |n: usize| (0..n * n).map(|e| f64::from(u8::from(e % (n + 1) == 0))).collect();
    let (i6, i10): (Vec<f64>, Vec<f64>) = (eye(6), eye(10));
    let zeros = vec![0.0; 36];
    for (n, a, q) in [(6, &zeros, &i6), (6, &i6, &i6), (10, &jordan, &i10), (6, &zeros, &zeros)] {
        let eye: Vec<f64> = eye(n);
        let p = Riccati { n, m: n, len: 1, A: a, B: &eye, Q: q, R: &eye, S: None };
        for s in [care(&p).unwrap(), dare(&p).unwrap()] {
            let item = &s.items[0];
            assert!(item.status.is_err() || item.margin > 0.0, "n={n} {item:?}");
            assert_eq!(item.status.is_ok(), s.x.iter().all(|x| x.is_finite()));
        }
        let p = Lyapunov { n, len: 1, A: a, Q: q };
        for s in [lyapunov_continuous(&p).unwrap(), lyapunov_discrete(&p).unwrap()] {
            let status = &s.items[0].status;
            assert!(
                matches!(status, Ok(()) | Err(Error::NoUniqueSolution { .. })),
                "n={n} {status:?}"
            );
        }
    }
}

#[test]
fn extreme_numbers_give_an_answer_or_an_error() {
    let a = [1e300, 0.0, 0.0, -1e300];
    let tiny = [5e-324, 0.0, 0.0, 5e-324];
    let eye = [1.0, 0.0, 0.0, 1.0];
    let mixed = [1e-300, 1e300, 0.0, -1.0];
    for a in [&a, &mixed, &eye] {
        for q in [&tiny, &eye, &[1e300, 0.0, 0.0, 1e-300]] {
            for r in [&eye, &[1e300, 0.0, 0.0, 1e-300]] {
                let p = Riccati { n: 2, m: 2, len: 1, A: a, B: &eye, Q: q, R: r, S: None };
                for s in [care(&p).unwrap(), dare(&p).unwrap()] {
                    let item = &s.items[0];
                    let finite = s.x.iter().all(|x| x.is_finite());
                    assert_eq!(item.status.is_ok(), finite, "{item:?} {p:?}");
                    assert!(!finite || item.margin > 0.0, "{item:?} {p:?}");
                }
            }
            let p = Lyapunov { n: 2, len: 1, A: a, Q: q };
            for s in [lyapunov_continuous(&p).unwrap(), lyapunov_discrete(&p).unwrap()] {
                assert_eq!(s.items[0].status.is_ok(), s.x.iter().all(|x| x.is_finite()));
            }
        }
    }
}

#[test]
fn no_input_leaves_a_lyapunov_equation() {
    let a = [-1.0, 3.0, 0.0, -2.0];
    let q = [1.0, 0.5, 0.5, 2.0];
    let p = Riccati { n: 2, m: 0, len: 1, A: &a, B: &[], Q: &q, R: &[], S: None };
    let x = care(&p).unwrap();
    let a_t = [-1.0, 0.0, 3.0, -2.0];
    let y = lyapunov_continuous(&Lyapunov { n: 2, len: 1, A: &a_t, Q: &q }).unwrap();
    for (x, y) in x.item(0).unwrap().iter().zip(y.item(0).unwrap()) {
        assert!((x - y).abs() < 1e-15);
    }
}
