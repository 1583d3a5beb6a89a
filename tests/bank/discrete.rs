//! Every law on explicit records, against 60-digit arithmetic.

use mmae::Mat;
use mmae::bank::{GainMode, Initial, Members, Settings};
use mmae::engine::{Innovation, Mixing, Mmae, Weighting};
use mmae::model::{Plant, Time};
use mmae::observer::ObserverKind;
use mmae::weight::{DwsgScheme, Law, Modifiers, Transition};
use serde_json::Value;

use crate::json::{close, list, matrix, read, vector};

pub(crate) fn plant(model: &Value) -> Plant {
    let a = matrix(&model["A"]);
    let n = a.nrows();
    let b = if model["B"].is_null() { Mat::zeros(n, 0) } else { matrix(&model["B"]) };
    Plant {
        time: Time::Discrete { dt: 1.0 },
        A: a,
        B: b,
        G: Mat::identity(n, n),
        C: matrix(&model["C"]),
        Q: matrix(&model["Q"]),
        R: matrix(&model["R"]),
    }
}

fn members(case: &Value) -> Members {
    let plants = list(&case["models"]).iter().map(plant).collect();
    let mut members = Members::new(ObserverKind::Kalman, plants);
    let initial = Initial { x_hat: vector(&case["xhat0"]), P: Some(matrix(&case["P0"])) };
    members.initial = vec![initial];
    members
}

fn recursive() -> Settings {
    Settings { gains: GainMode::Recursive, ..Settings::default() }
}

fn inverse_of_first_noise(case: &Value) -> Mat<f64> {
    let r = matrix(&case["models"][0]["R"]);
    let det = r[(0, 0)] * r[(1, 1)] - r[(0, 1)] * r[(1, 0)];
    let (a, b, c, d) = (r[(1, 1)] / det, -r[(0, 1)] / det, -r[(1, 0)] / det, r[(0, 0)] / det);
    mmae::mat![[a, b], [c, d]]
}

/// The weighting behind each column of weights.
fn weighting(name: &str, case: &Value) -> Weighting {
    let models = list(&case["models"]).len();
    let bayes = Weighting::default();
    let law = |law| Weighting { law, ..Weighting::default() };
    match name {
        "p_bayes" => bayes,
        "p_bayes_ss" => Weighting { innovation: Innovation::Steady, ..bayes },
        "p_alg1" => law(Law::Zhang { n_max: 1.0 }),
        "p_alg2" => law(Law::Zhang { n_max: f64::INFINITY }),
        "p_alg2_cap" => law(Law::Zhang { n_max: 20.0 }),
        "p_dunn_R1" => {
            Weighting { innovation: Innovation::Common(inverse_of_first_noise(case)), ..bayes }
        }
        "p_dwsg" => law(Law::Dwsg { lambda: 0.1, tempering: 1.0, scheme: DwsgScheme::Mixture }),
        "p_hmm" => {
            let pi = match &case["Pi"] {
                Value::Null => Transition::sticky(models, 0.98).unwrap(),
                pi => Transition::new(&matrix(pi)).unwrap(),
            };
            Weighting { mixing: Mixing::Markov(pi), ..bayes }
        }
        "p_floor" => {
            Weighting { modifiers: Modifiers { floor: 1e-3, ..Modifiers::default() }, ..bayes }
        }
        _ => panic!("{name}"),
    }
}

const LAWS: [&str; 9] = [
    "p_bayes",
    "p_bayes_ss",
    "p_alg1",
    "p_alg2",
    "p_alg2_cap",
    "p_dunn_R1",
    "p_dwsg",
    "p_hmm",
    "p_floor",
];

#[test]
fn every_law_step_by_step() {
    let data = read("discrete.json");
    for (id, case) in data["cases"].as_object().unwrap() {
        for name in LAWS {
            let w = weighting(name, case);
            let p0 = vector(&case["p0"]);
            let mut mmae = Mmae::new(&members(case), &recursive(), &w, &p0).unwrap();
            for (k, (y, want)) in list(&case["y"]).iter().zip(list(&case["steps"])).enumerate() {
                let u = match &case["u"] {
                    Value::Null => Vec::new(),
                    u => vec![vector(u)[k]],
                };
                let e = mmae.step(&u, &vector(y)).unwrap().clone();
                let at = format!("{id} {name} step {}", k + 1);
                close(&at, &e.p, &vector(&want[name]), 0.0, 1e-9);
                assert!((e.p.iter().sum::<f64>() - 1.0).abs() < 1e-13);
                if name != "p_bayes" {
                    continue;
                }
                close(&at, &e.r, &vector(&want["r"]), 1e-10, 0.0);
                for i in 0..p0.len() {
                    let mut x = vec![0.0; e.x_hat.len()];
                    mmae.bank().x_hat_into(i, &mut x);
                    close(&at, &x, &vector(&want["xhat"][i]), 1e-10, 0.0);
                    let p = mmae.bank().covariance(i);
                    let flat: Vec<f64> =
                        p.row_iter().flat_map(|r| r.iter().copied().collect::<Vec<_>>()).collect();
                    close(&at, &flat, &vector(&want["P"][i]), 1e-10, 0.0);
                }
                close(&at, &e.x_hat, &vector(&want["xhat_bayes"]), 1e-10, 0.0);
                let fused = mmae.covariance();
                let flat: Vec<f64> =
                    fused.row_iter().flat_map(|r| r.iter().copied().collect::<Vec<_>>()).collect();
                close(&at, &flat, &vector(&want["P_bayes"]), 1e-9, 0.0);
            }
            // the log-likelihoods of the record add up
            if name == "p_bayes" {
                let steps = list(&case["steps"]);
                let mut total = vec![0.0; p0.len()];
                for s in steps {
                    for (t, l) in total.iter_mut().zip(vector(&s["loglik"])) {
                        *t += l;
                    }
                }
                close(id, &mmae.estimate().log_lik_models, &total, 1e-10, 0.0);
            }
        }
    }
}

#[test]
fn interacting_models_step_by_step() {
    let data = read("discrete.json");
    for id in ["case1", "case3"] {
        let case = &data["cases"][id];
        let imm = &case["imm"];
        let mut members = members(case);
        members.initial[0].P = Some(matrix(&imm["P0"]));
        let pi = Transition::new(&matrix(&imm["Pi"])).unwrap();
        let w = Weighting { mixing: Mixing::Imm(pi), ..Weighting::default() };
        let mut mmae = Mmae::new(&members, &recursive(), &w, &vector(&case["p0"])).unwrap();
        for (k, (y, want)) in list(&case["y"]).iter().zip(list(&imm["steps"])).enumerate() {
            let e = mmae.step(&[], &vector(y)).unwrap();
            let at = format!("{id} step {}", k + 1);
            close(&at, &e.p, &vector(&want["p"]), 0.0, 1e-9);
            close(&at, &e.x_hat, &vector(&want["xhat_fused"]), 1e-10, 0.0);
        }
    }
}
