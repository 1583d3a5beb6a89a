//! The pendulum's bank, sampled at 1 ms, step by step on given signals.

use mmae::Mat;
use mmae::bank::{Members, Settings, StartTime};
use mmae::engine::{Mmae, Weighting};
use mmae::model::{Family, Plant, sample, systems};
use mmae::observer::ObserverKind;
use mmae::weight::{DwsgScheme, Law};
use serde_json::Value;

use crate::json::{close, list, matrix, number, read, vector};

const DT: f64 = 1e-3;

fn plants(data: &Value) -> Vec<Plant> {
    let family = systems::pendulum();
    let around = systems::pendulum_surroundings();
    let lengths = vector(&data["params"]["paper_nominals"]);
    let plant = |length: &f64| {
        let theta = family.theta_with(&[("L", *length)]).unwrap();
        family.plant(&theta).unwrap().with_disturbance(around.disturbance.as_ref())
    };
    lengths.iter().map(plant).collect()
}

fn signals(k: u32) -> (f64, [f64; 2]) {
    let t = f64::from(k) * DT;
    (0.5 * (3.0 * t).sin(), [0.01 * (2.0 * t).sin(), 0.002 * (5.0 * t).cos()])
}

/// Filters of the sampled plants, Bayes's law and the dynamic weighting signal
/// generator on 200 samples: `w = 1/2 r' S^-1 r`, `beta = (det S / det R)^-1/2`.
#[test]
fn the_pendulum_from_signals_to_weights() {
    let data = read("pendulum.json");
    let want = &data["pipeline"];
    let plants: Vec<Plant> =
        plants(&data).iter().map(|plant| sample(plant, DT, 0.0).unwrap().0).collect();
    // -1/2 ln det (2 pi R), R / dt of the continuous plant
    let r = [plants[0].R[(0, 0)], plants[0].R[(1, 1)]];
    let common = -0.5 * r.iter().map(|r| (std::f64::consts::TAU * r).ln()).sum::<f64>();
    let mut members = Members::new(ObserverKind::Kalman, plants);
    members.start = StartTime::FirstMeasurement;
    // 100 1/s
    let generator = Law::Dwsg { lambda: 100.0 * DT, tempering: 1.0, scheme: DwsgScheme::Left };
    for (law, name) in [(Law::Bayes, "bayes_lnp"), (generator, "dwsg_lnp_theta1_lambda100")] {
        let weighting = Weighting { law, ..Weighting::default() };
        let mut engine = Mmae::new(&members, &Settings::default(), &weighting, &[1.0; 4]).unwrap();
        let mut sum = [0.0; 4];
        for k in 0..200 {
            // the input since the last measurement
            let u = if k == 0 { 0.0 } else { signals(k - 1).0 };
            let e = engine.step(&[u], &signals(k).1).unwrap();
            let w: Vec<f64> = e.nis.iter().map(|nis| 0.5 * nis).collect();
            (0..4).for_each(|i| sum[i] += w[i]);
            if [0, 1, 50, 199].contains(&k) {
                close(&format!("w at {k}"), &w, &vector(&want[format!("w_k{k}")]), 1e-9, 0.0);
            }
            let last = engine.bank().last();
            let beta: Vec<f64> = (0..4).map(|i| last.log_lik[i] + w[i] - common).collect();
            close("ln beta", &beta, &vector(&want["ln_beta"]), 1e-9, 1e-12);
        }
        close("sum of w", &sum, &vector(&want["sum_w"]), 1e-9, 0.0);
        close(name, &engine.estimate().log_p, &vector(&want[name]), 1e-9, 0.0);
        for i in 0..4 {
            let mut x = [0.0; 5];
            engine.bank().x_hat_into(i, &mut x);
            // the reference goes on to the next sample
            let plant = &members.plants[i];
            let x = Mat::from_fn(5, 1, |j, _| x[j]);
            let next = &plant.A * &x + &plant.B * mmae::mat![[signals(199).0]];
            let next: Vec<f64> = (0..5).map(|j| next[(j, 0)]).collect();
            let end: Vec<f64> = (0..5).map(|j| number(&want["xhat_final"][i][j])).collect();
            close("x_hat", &next, &end, 1e-9, 1e-12);
        }
    }
}

/// The continuous observers of the same bank judge their first sample by
/// `S = C P C' + R / dt` with the `P` of the continuous equation.
#[test]
fn continuous_observers_judge_a_sample_by_their_own_covariance() {
    let data = read("pendulum.json");
    let members = Members::new(ObserverKind::KalmanBucy, plants(&data));
    let settings = Settings { dt: Some(DT), ..Settings::default() };
    let weighting = Weighting { law: Law::Bayes, ..Weighting::default() };
    let mut engine = Mmae::new(&members, &settings, &weighting, &[1.0; 4]).unwrap();
    let y = [0.001, 0.002];
    let nis = engine.step(&[0.0], &y).unwrap().nis.clone();
    for o in list(&data["observers5"]) {
        let i = vector(&data["params"]["paper_nominals"])
            .iter()
            .position(|length| *length == number(&o["L"]))
            .unwrap();
        let (p, r) = (matrix(&o["P"]), &members.plants[i].R);
        let s = |i: usize, j: usize| p[(i, j)] + r[(i, j)] / DT;
        let det = s(0, 0) * s(1, 1) - s(0, 1) * s(1, 0);
        let want =
            (y[0] * y[0] * s(1, 1) - 2.0 * y[0] * y[1] * s(0, 1) + y[1] * y[1] * s(0, 0)) / det;
        assert!((nis[i] / want - 1.0).abs() < 1e-9, "{} for {want}", nis[i]);
    }
}
