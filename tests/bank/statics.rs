//! Banks on recorded data: log-posteriors to 400 bits, duplicates among
//! the models, long records.

use mmae::Mat;
use mmae::bank::{GainMode, Initial, Members, Settings, StartTime};
use mmae::engine::{Mmae, Weighting};
use mmae::model::{Plant, Time};
use mmae::observer::ObserverKind;
use serde_json::Value;

use crate::json::{close, list, matrix, read, vector};

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
    let mut seen = 0;
    for case in cases {
        let id = case["id"].as_str().unwrap();
        // the case of interacting models came without its models and data
        if case["models"].is_null() {
            assert_eq!(id, "crassidis_ex4.6_imm");
            continue;
        }
        seen += 1;
        let members = durbin_koopman(list(&case["models"]));
        let settings = Settings { gains: GainMode::Recursive, ..Settings::default() };
        let w = Weighting::default();
        let mut mmae = Mmae::new(&members, &settings, &w, &vector(&case["prior"])).unwrap();
        let mut expected = list(&case["expected"]).iter().peekable();
        for (k, y) in list(&case["y"]).iter().enumerate() {
            let e = mmae.step(&[], &vector(y)).unwrap();
            let Some(want) = expected.next_if(|w| w["t"] == (k + 1) as u64) else { continue };
            let at = format!("{id} t = {}", k + 1);
            let wanted = vector(&want["logpost"]);
            for (got, want) in e.log_p.iter().zip(&wanted) {
                assert!((got - want).abs() <= 1e-9 * want.abs().max(1.0), "{at}: {got} {want}");
            }
            close(&at, &e.p, &vector(&want["post"]), 0.0, 1e-10);
            close(&at, &e.log_lik_models, &vector(&want["loglik_models"]), 1e-10, 0.0);
            close(&at, &e.x_hat, &vector(&want["mixture_filtered_mean"]), 1e-10, 1e-12);
        }
        assert!(expected.next().is_none(), "{id}: not all times were reached");
    }
    assert_eq!(seen, 3);
}
