//! The four cases of Zhang et al. (2018), section 5.

use mmae::Mat;
use mmae::bank::{GainMode, Initial, Members, Settings};
use mmae::engine::Weighting;
use mmae::model::{Family, Plant, systems};
use mmae::observer::ObserverKind;
use mmae::sim::{MonteCarlo, Truth};

/// Case 1 to 4: what varies, its values, the model that is right.
const CASES: [(&str, [f64; 4], usize); 4] = [
    ("rho", [0.96, 0.97, 1.0, 1.01], 2),
    ("c", [0.95, 0.9, 1.0, 1.05], 2),
    ("q", [2.0, 1.0, 1.2, 1.4], 0),
    ("r", [2.0, 2.4, 2.6, 2.8], 0),
];

pub(crate) fn plants(case: usize) -> (Vec<Plant>, usize) {
    let family = systems::tracker();
    let (name, values, truth) = CASES[case - 1];
    let plant = |v| family.plant(&family.theta_with(&[(name, v)]).unwrap()).unwrap();
    (values.map(plant).to_vec(), truth)
}

pub(crate) fn case(number: usize) -> MonteCarlo {
    let (plants, truth) = plants(number);
    let values = CASES[number - 1].1.map(|v| vec![v]).to_vec();
    let x0 = vec![-100.0, 2.0, 200.0, 20.0];
    let right = plants[truth].clone();
    let mut members = Members::new(ObserverKind::Kalman, plants);
    members.initial = vec![Initial { x_hat: x0.clone(), P: Some(Mat::zeros(4, 4)) }];
    MonteCarlo {
        members,
        settings: Settings { gains: GainMode::Recursive, ..Settings::default() },
        weighting: Weighting::default(),
        prior: vec![1.0; 4],
        truth: Truth { x0, ..Truth::new(right) },
        steps: 200,
        trials: 4000,
        measurement: mmae::sim::Measurement::Sampled,
        seed: 1,
        every: 10,
        keep: Vec::new(),
        values,
    }
}
