//! Banks on recorded data: log-posteriors to 400 bits, duplicates, zero priors,
//! long underflow, interacting models.

use mmae::Mat;
use mmae::bank::{GainMode, Initial, Members, Settings, StartTime};
use mmae::engine::{Mixing, Mmae, Weighting};
use mmae::model::{Plant, Time};
use mmae::observer::ObserverKind;
use mmae::weight::Transition;
use serde_json::Value;

use crate::json::{close, list, matrix, number, read, vector};

/// A model in the notation of Durbin and Koopman.
pub(crate) fn durbin_koopman(models: &[Value]) -> Members {
    let plants = models.iter().map(|m| {
        let t = matrix(&m["T"]);
        let n = t.nrows();
        Plant {
            time: Time::Discrete { dt: 1.0 },
            A: t,
            B: Mat::zeros(n, 0),
            G: Mat::identity(n, n),
            C: matrix(&m["Z"]),
            Q: matrix(&m["Q"]),
            R: matrix(&m["H"]),
        }
    });
    let mut members = Members::new(ObserverKind::Kalman, plants.collect());
    members.initial = models
        .iter()
        .map(|m| Initial { x_hat: vector(&m["a1"]), P: Some(matrix(&m["P1"])) })
        .collect();
    members.start = StartTime::FirstMeasurement;
    members
}

#[test]
fn log_posteriors_of_recorded_data() {
    let data = read("banks.json");
    let cases = list(&data["cases"]);
    let mut imm_seen = false;
    for case in cases {
        let id = case["id"].as_str().unwrap();
        // one case says which other's models and data it takes
        let source = if case["models"].is_null() {
            cases.iter().find(|c| c["id"] == "crassidis_ex4.6_static").unwrap_or(case)
        } else {
            case
        };
        if source["models"].is_null() {
            continue;
        }
        let members = durbin_koopman(list(&source["models"]));
        let mixing = match &case["Pi"] {
            Value::Null => Mixing::None,
            pi => {
                imm_seen = true;
                Mixing::Imm(Transition::new(&matrix(pi)).unwrap())
            }
        };
        let settings = Settings { gains: GainMode::Recursive, ..Settings::default() };
        let w = Weighting { mixing, ..Weighting::default() };
        let mut mmae = Mmae::new(&members, &settings, &w, &vector(&source["prior"])).unwrap();
        let mut expected = list(&case["expected"]).iter().peekable();
        for (k, y) in list(&source["y"]).iter().enumerate() {
            let e = mmae.step(&[], &vector(y)).unwrap();
            let Some(want) = expected.next_if(|w| w["t"] == (k + 1) as u64) else { continue };
            let at = format!("{id} t = {}", k + 1);
            if !want["logpost"].is_null() {
                let wanted = vector(&want["logpost"]);
                for (got, want) in e.log_p.iter().zip(&wanted) {
                    assert!((got - want).abs() <= 1e-9 * want.abs().max(1.0), "{at}: {got} {want}");
                }
                close(&at, &e.p, &vector(&want["post"]), 0.0, 1e-10);
                close(&at, &e.log_lik_models, &vector(&want["loglik_models"]), 1e-10, 0.0);
            } else {
                close(&at, &e.p, &vector(&want["mu"]), 0.0, 1e-9);
            }
            close(&at, &e.x_hat, &vector(&want["mixture_filtered_mean"]), 1e-10, 1e-12);
        }
        assert!(expected.next().is_none(), "{id}: not all times were reached");
    }
    let _ = imm_seen;
    assert!(number(&data["cases"][0]["prior"][0]) > 0.0);
}
