//! Kalman filters on published data, missing samples among them.

use mmae::bank::{Bank, GainMode, Settings};
use mmae::engine::{Mmae, Weighting};
use serde_json::Value;

use super::statics::durbin_koopman;
use crate::json::{close, list, matrix, number, read, vector};

fn settings() -> Settings {
    Settings { gains: GainMode::Recursive, ..Settings::default() }
}

#[test]
fn log_likelihoods_and_states_of_published_data() {
    let data = read("kf.json");
    for case in list(&data["cases"]) {
        let id = case["id"].as_str().unwrap();
        let want = &case["expected"];
        let dataset = case["dataset"].as_str().unwrap();
        let (name, missing) = match dataset.split_once(" with t=") {
            // "21..40 and 61..80 missing (1-based)"
            Some((name, _)) => (name, vec![20..40, 60..80]),
            None => (dataset, vec![]),
        };
        let y = &data["datasets"][name]["y"];
        let members = durbin_koopman(std::slice::from_ref(&case["model"]));
        let mut mmae = Mmae::new(&members, &settings(), &Weighting::default(), &[1.0]).unwrap();
        let times: Vec<usize> = vector(&want["t_index"]).into_iter().map(|t| t as usize).collect();
        let (mut total, burn) = (0.0, number(&case["burn"]) as usize);
        for (k, y) in list(y).iter().enumerate() {
            let mut before = mmae.estimate().log_lik_models[0];
            let mut y = vector(y);
            if missing.iter().any(|range: &std::ops::Range<usize>| range.contains(&k)) {
                y.fill(f64::NAN);
            }
            mmae.step(&[], &y).unwrap();
            before = mmae.estimate().log_lik_models[0] - before;
            if k >= burn {
                total += before;
            }
            for (row, _) in times.iter().enumerate().filter(|(_, t)| **t == k) {
                let mut x = vec![0.0; mmae.estimate().x_hat.len()];
                mmae.bank().x_hat_into(0, &mut x);
                close(id, &x, &vector(&want["filtered_mean"][row]), 1e-9, 1e-13);
                let p = mmae.bank().covariance(0);
                let p: Vec<f64> =
                    p.row_iter().flat_map(|r| r.iter().copied().collect::<Vec<_>>()).collect();
                close(id, &p, &vector(&want["filtered_cov"][row]), 1e-9, 0.0);
            }
        }
        let loglik = number(&want["loglik"]);
        assert!((total - loglik).abs() <= 1e-9 * loglik.abs(), "{id}: {total} for {loglik}");
    }
}

/// The published recursion starts at a matrix that is no covariance.
#[test]
fn an_indefinite_start_is_refused() {
    let data = read("kf.json");
    let case = &list(&data["one_step"])[0];
    let mut members = durbin_koopman(&[serde_json::json!({
        "T": case["A"], "Z": case["C"], "Q": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]],
        "H": case["R"], "a1": [0, 0, 0, 0], "P1": case["P"],
    })]);
    let refused = Bank::new(&members, &settings()).unwrap_err();
    assert!(refused.to_string().contains("P(0) is not positive semidefinite"), "{refused}");
    members.initial[0].P = Some(matrix(&Value::from(vec![
        vec![1.0, 0.0, 0.0, 0.0],
        vec![0.0; 4],
        vec![0.0; 4],
        vec![0.0; 4],
    ])));
    assert!(Bank::new(&members, &settings()).is_ok());
}
