//! Kalman-Bucy banks on the oscillator's record of increments.

use mmae::Mat;
use mmae::bank::{GainMode, Initial, Members, Settings};
use mmae::engine::{Mmae, Weighting};
use mmae::model::{Family, Plant, Time, sample, systems};
use mmae::observer::ObserverKind;
use mmae::weight::Law;
use serde_json::Value;

use crate::json::{close, list, number, read, vector};

fn plants(data: &Value) -> Vec<Plant> {
    let params = &data["params"];
    vector(&params["theta"])
        .iter()
        .map(|wn| {
            let xi = number(&params["xi"]);
            let b = vector(&params["B"]);
            Plant {
                time: Time::Continuous,
                A: mmae::mat![
                    [-5.0, 0.0, 0.0],
                    [0.0, 0.0, 1.0],
                    [wn * wn, -wn * wn, -2.0 * xi * wn]
                ],
                B: Mat::zeros(3, 0),
                G: Mat::from_fn(3, 1, |i, _| b[i]),
                C: mmae::mat![[0.0, 1.0, 0.0]],
                Q: mmae::mat![[number(&params["Q"])]],
                R: mmae::mat![[number(&params["R"])]],
            }
        })
        .collect()
}

#[test]
fn the_built_in_family_is_this_one() {
    let data = read("oscillator_bank.json");
    let family = systems::oscillator();
    for (wn, plant) in vector(&data["params"]["theta"]).iter().zip(plants(&data)) {
        let built = family.plant(&family.theta_with(&[("wn", *wn)]).unwrap()).unwrap();
        assert_eq!(built.A, plant.A);
        assert_eq!(built.Q[(0, 0)] * built.G[(0, 0)].powi(2), 2500.0);
    }
}

fn run(law: Law, discrete: bool, result: &str) {
    let data = read("oscillator_bank.json");
    let record = &data["record"];
    let dt = number(&record["dt"]);
    let (plants, kind) = if discrete {
        let sampled = plants(&data).iter().map(|p| sample(p, dt, 0.0).unwrap().0).collect();
        (sampled, ObserverKind::Kalman)
    } else {
        (plants(&data), ObserverKind::KalmanBucy)
    };
    let mut members = Members::new(kind, plants);
    members.start = mmae::bank::StartTime::FirstMeasurement;
    let settings = Settings { dt: Some(dt), ..Settings::default() };
    let weighting = Weighting { law, ..Weighting::default() };
    let mut mmae = Mmae::new(&members, &settings, &weighting, &[1.0; 4]).unwrap();
    let theta = vector(&data["params"]["theta"]);
    let mut expected = list(&record["results"][result]).iter().peekable();
    for (k, dy) in vector(&record["dy"]).iter().enumerate() {
        let e = mmae.step(&[], &[dy / dt]).unwrap();
        let Some(want) = expected.next_if(|w| w["k"] == (k + 1) as u64) else { continue };
        let at = format!("{result} k = {}", k + 1);
        close(&at, &e.p, &vector(&want["p"]), 0.0, 1e-10);
        if let Some(mean) = want["omega_hat"].as_f64() {
            assert!((e.mean(&theta) - mean).abs() < 1e-9, "{at}");
        }
        if !want["xhat_i"].is_null() {
            for i in 0..4 {
                let mut x = [0.0; 3];
                mmae.bank().x_hat_into(i, &mut x);
                close(&at, &x, &vector(&want["xhat_i"][i]), 1e-10, 0.0);
            }
        }
    }
    assert!(expected.next().is_none());
}

#[test]
fn likelihood_law_by_the_trapezoid() {
    run(Law::Likelihood, false, "ito_trap");
}

#[test]
fn differential_equation_by_runge_kutta() {
    run(Law::Ode { substeps: 4 }, false, "ode_rk4_m4");
}

#[test]
fn sampled_filters_with_bayes() {
    run(Law::Bayes, true, "discrete_kf");
}

/// The covariance of the differential equation from P(0) = I, whatever the step.
#[test]
fn covariances_follow_the_riccati_equation() {
    let data = read("oscillator_bank.json");
    let theta = vector(&data["params"]["theta"]);
    for dt in [0.05, 0.025] {
        let mut members = Members::new(ObserverKind::KalmanBucy, plants(&data));
        members.initial = vec![Initial { x_hat: vec![0.0; 3], P: Some(Mat::identity(3, 3)) }];
        let settings = Settings { dt: Some(dt), gains: GainMode::Recursive, ..Settings::default() };
        let weighting = Weighting { law: Law::Likelihood, ..Weighting::default() };
        let mut mmae = Mmae::new(&members, &settings, &weighting, &[1.0; 4]).unwrap();
        let items = list(&data["riccati_ode"]["items"]);
        let (mut t, mut seen) = (0.0, 0);
        for k in 1..=4000 {
            mmae.step(&[], &[(0.1 * f64::from(k)).sin()]).unwrap();
            t += dt;
            for item in items.iter().filter(|i| (number(&i["t"]) - t).abs() < 1e-9) {
                let Some(model) = theta.iter().position(|w| *w == number(&item["wn"])) else {
                    continue;
                };
                let p = mmae.bank().covariance(model);
                let flat: Vec<f64> = (0..9).map(|e| p[(e / 3, e % 3)]).collect();
                close(&format!("P({t})"), &flat, &vector(&item["P"]), 1e-8, 0.0);
                seen += 1;
            }
        }
        assert!(seen >= 3, "{seen} items");
        // at the end the filters are the steady ones
        let steady = mmae::observer::design(ObserverKind::KalmanBucy, &plants(&data));
        for (i, o) in steady.into_iter().enumerate() {
            let (p, o) = (mmae.bank().covariance(i), o.unwrap());
            assert!((&p - &o.P).norm_l2() < 1e-9 * o.P.norm_l2());
        }
    }
}
