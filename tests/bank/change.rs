//! Models that change while the bank runs.

use mmae::bank::{GainMode, Initial, Members, Settings};
use mmae::engine::{Innovation, Mmae, Weighting};
use mmae::model::{Plant, Time};
use mmae::observer::ObserverKind;
use mmae::weight::Law;
use mmae::{Error, Mat, mat};

fn discrete(k: f64, scale: f64) -> Plant {
    let (s, c) = (0.1 * k).sin_cos();
    Plant {
        time: Time::Discrete { dt: 0.1 },
        A: mat![[0.9 * c, 0.3 * s], [-0.2, 0.8 + 0.1 * s]],
        B: mat![[0.5], [c]],
        G: mat![[1.0, 0.0], [0.2, 1.0]],
        C: mat![[1.0, 0.5 * s]],
        Q: mat![[0.3 * scale, 0.0], [0.0, 0.1 + 0.05 * c]],
        R: mat![[0.2 + 0.1 * s * s]],
    }
}

fn start(kind: ObserverKind, plants: Vec<Plant>, dt: Option<f64>) -> Mmae {
    let mut members = Members::new(kind, plants);
    let p = mat![[1.0, 0.1], [0.1, 2.0]];
    members.initial = vec![Initial { x_hat: vec![0.5, -0.5], P: Some(p) }];
    let settings = Settings { gains: GainMode::Recursive, dt, ..Settings::default() };
    Mmae::new(&members, &settings, &Weighting::default(), &[1.0, 1.0]).unwrap()
}

/// Matrices of every step against the textbook filter.
#[test]
fn a_filter_of_a_plant_that_varies_with_time() {
    let models = |k: f64| vec![discrete(k, 1.0), discrete(k, 3.0)];
    let mut mmae = start(ObserverKind::Kalman, models(0.0), None);
    let mut oracle: Vec<(Mat<f64>, Mat<f64>)> =
        vec![(mat![[0.5], [-0.5]], mat![[1.0, 0.1], [0.1, 2.0]]); 2];
    for k in 1..=60 {
        let t = f64::from(k);
        let (u, y) = ((0.3 * t).cos(), (0.7 * t).sin());
        mmae.set_models(&models(t)).unwrap();
        let e = mmae.step(&[u], &[y]).unwrap();
        for (i, (x, p)) in oracle.iter_mut().enumerate() {
            let plant = &models(t)[i];
            *x = &plant.A * &*x + &plant.B * mat![[u]];
            *p = &plant.A * &*p * plant.A.transpose() + &plant.G * &plant.Q * plant.G.transpose();
            let s = (&plant.C * &*p * plant.C.transpose() + &plant.R)[(0, 0)];
            let gain = &*p * plant.C.transpose() * faer::Scale(1.0 / s);
            let r = y - (&plant.C * &*x)[(0, 0)];
            *x = &*x + &gain * mat![[r]];
            *p = &*p - &gain * &plant.C * &*p;
            assert!((e.nis[i] - r * r / s).abs() < 1e-11 * (1.0 + e.nis[i]), "step {k}");
        }
    }
    for (i, (x, p)) in oracle.iter().enumerate() {
        let mut got = [0.0; 2];
        mmae.bank().x_hat_into(i, &mut got);
        for r in 0..2 {
            assert!((got[r] - x[(r, 0)]).abs() < 1e-12);
            for c in 0..2 {
                assert!((mmae.bank().covariance(i)[(r, c)] - p[(r, c)]).abs() < 1e-12);
            }
        }
    }
    // the first models are those of a new start
    let first =
        start(ObserverKind::Kalman, models(0.0), None).step(&[1.0], &[0.3]).unwrap().clone();
    mmae.reset();
    assert_eq!(mmae.step(&[1.0], &[0.3]).unwrap(), &first);
}

fn continuous(t: f64, scale: f64) -> Plant {
    Plant {
        time: Time::Continuous,
        A: mat![[0.0, 1.0], [-2.0 - t.sin(), -0.4]],
        B: mat![[0.0], [1.0]],
        G: mat![[0.0], [1.0]],
        C: mat![[1.0, 0.2 * t.cos()]],
        Q: mat![[scale]],
        R: mat![[0.1]],
    }
}

/// `A(t)` and `C(t)` against the differential equations of Kalman and Bucy: the
/// error falls with the square of the interval.
#[test]
fn a_continuous_observer_of_a_plant_that_varies_with_time() {
    let (y, u) = (|t: f64| (1.3 * t).sin(), |t: f64| (0.4 * t).cos());
    let end = 2.0;
    // classical Runge-Kutta steps on x and P, both models
    let rate = |t: f64, scale: f64, x: &Mat<f64>, p: &Mat<f64>| {
        let plant = continuous(t, scale);
        let gain = p * plant.C.transpose() * faer::Scale(10.0);
        let r = y(t) - (&plant.C * x)[(0, 0)];
        let dx = &plant.A * x + &plant.B * mat![[u(t)]] + &gain * mat![[r]];
        let ap = &plant.A * p;
        let noise = &plant.G * &plant.Q * plant.G.transpose();
        let dp = &ap + ap.transpose() + noise - &gain * &plant.C * p;
        (dx, dp)
    };
    let truth = |scale: f64| {
        let (mut x, mut p) = (mat![[0.5], [-0.5]], mat![[1.0, 0.1], [0.1, 2.0]]);
        let (steps, h) = (20_000, end / 20_000.0);
        for k in 0..steps {
            let t = f64::from(k) * h;
            let at = |x: &Mat<f64>, d: &Mat<f64>, w: f64| x + d * faer::Scale(w);
            let a = rate(t, scale, &x, &p);
            let b = rate(t + 0.5 * h, scale, &at(&x, &a.0, 0.5 * h), &at(&p, &a.1, 0.5 * h));
            let c = rate(t + 0.5 * h, scale, &at(&x, &b.0, 0.5 * h), &at(&p, &b.1, 0.5 * h));
            let d = rate(t + h, scale, &at(&x, &c.0, h), &at(&p, &c.1, h));
            let sum = |a: &Mat<f64>, b: &Mat<f64>, c: &Mat<f64>, d: &Mat<f64>| {
                (a + (b + c) * faer::Scale(2.0) + d) * faer::Scale(h / 6.0)
            };
            x = &x + sum(&a.0, &b.0, &c.0, &d.0);
            p = &p + sum(&a.1, &b.1, &c.1, &d.1);
        }
        (x, p)
    };
    let exact = [truth(1.0), truth(5.0)];
    let error = |dt: f64| {
        let models = |t: f64| vec![continuous(t, 1.0), continuous(t, 5.0)];
        let mut mmae = start(ObserverKind::KalmanBucy, models(0.0), Some(dt));
        let steps = (end / dt).round() as u32;
        for k in 0..steps {
            // what is held over the interval is the middle of it
            let t = (f64::from(k) + 0.5) * dt;
            mmae.set_models(&models(t)).unwrap();
            mmae.step(&[u(t)], &[y(t)]).unwrap();
        }
        let mut worst = [0.0_f64; 2];
        for (i, (x, p)) in exact.iter().enumerate() {
            let mut got = [0.0; 2];
            mmae.bank().x_hat_into(i, &mut got);
            for r in 0..2 {
                worst[0] = worst[0].max((got[r] - x[(r, 0)]).abs());
                for c in 0..2 {
                    let d = mmae.bank().covariance(i)[(r, c)] - p[(r, c)];
                    worst[1] = worst[1].max(d.abs());
                }
            }
        }
        worst
    };
    let (coarse, fine) = (error(0.02), error(0.01));
    for (coarse, fine) in coarse.iter().zip(fine) {
        assert!(fine < 2e-4 && *coarse < 1e-3, "{coarse} {fine}");
        assert!((3.0..5.0).contains(&(coarse / fine)), "{coarse} {fine}");
    }
}

#[test]
fn what_cannot_change_is_refused() {
    let models = vec![discrete(0.0, 1.0), discrete(0.0, 3.0)];
    let mut mmae = start(ObserverKind::Kalman, models.clone(), None);
    assert!(matches!(mmae.set_models(&models[..1]), Err(Error::Shape { .. })));
    let mut wrong = models.clone();
    wrong[1].R = mat![[-1.0]];
    assert!(mmae.set_models(&wrong).is_err());
    let held = vec![continuous(0.0, 1.0), continuous(0.0, 5.0)];
    assert!(matches!(mmae.set_models(&held), Err(Error::Conflict { .. })));
    // nothing has changed
    let same =
        start(ObserverKind::Kalman, models.clone(), None).step(&[0.0], &[1.0]).unwrap().clone();
    assert_eq!(mmae.step(&[0.0], &[1.0]).unwrap(), &same);
    let members = Members::new(ObserverKind::Kalman, models.clone());
    let steady = Settings::default();
    let mut mmae = Mmae::new(&members, &steady, &Weighting::default(), &[1.0, 1.0]).unwrap();
    assert!(mmae.set_models(&models).unwrap_err().to_string().contains("recursive"));
    let steady_norm =
        Weighting { law: Law::Bayes, innovation: Innovation::Steady, ..Weighting::default() };
    let recursive = Settings { gains: GainMode::Recursive, ..Settings::default() };
    let mut mmae = Mmae::new(&members, &recursive, &steady_norm, &[1.0, 1.0]).unwrap();
    assert!(mmae.set_models(&models).unwrap_err().to_string().contains("steady S"));
}
