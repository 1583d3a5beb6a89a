//! Upsilon by the oracle of `tests/common`: on paper, and against numbers from elsewhere.

mod common;

use common::assert_close;
use common::check::assert_close_matrix;
use common::data::{self, matrix, vector};
use common::equations::Time;
use common::matrix::*;
use common::upsilon::*;
use serde_json::Value;

/// `x' = -a x + w`, `y = x + v` seen by a model with `a_i` and gain `h`, on paper.
#[test]
fn upsilon_of_a_scalar_pair_on_paper() {
    let (a, ai, h, q, r) = (0.8, 1.7, 0.6, 0.5, 0.09);
    let observer = |ai: f64| Observer { a: diag(&[ai]), b: zeros(1, 1), c: eye(1), h: diag(&[h]) };
    let quiet = Signal { a: diag(&[-0.5]), c: eye(1), q: zeros(1, 1) };
    let plant =
        |a: f64| Plant { a: diag(&[a]), b: zeros(1, 1), c: eye(1), q: diag(&[q]), r: diag(&[r]) };
    let got = error_covariance(&plant(-a).open(&quiet), &observer(-ai), Time::Continuous);
    let (f, d) = (ai + h, ai - a);
    let xx = q / (2.0 * a);
    let xe = (d * xx + q) / (a + f);
    let ee = (2.0 * d * xe + q + h * h * r) / (2.0 * f);
    assert_close("continuous", got[0][0], ee, 1e-14);
    let (a, ai) = (0.8, 0.3);
    let got = error_covariance(&plant(a).open(&quiet), &observer(ai), Time::Discrete);
    let (f, d) = (ai - h, a - ai);
    let xx = q / (1.0 - a * a);
    let xe = (a * d * xx + q) / (1.0 - a * f);
    let ee = (d * d * xx + 2.0 * f * d * xe + q + h * h * r) / (1.0 - f * f);
    assert_close("discrete", got[0][0], ee + r, 1e-14);
}

/// The bank's own plant: the error covariance is the filter's `C P C'` (and `S`).
#[test]
fn a_matched_model_has_the_covariance_of_its_filter() {
    let file = data::load("pendulum_exact.json");
    let k = pendulum::controller();
    for (length, want) in vector(&file["nominals"]).iter().zip(vector(&file["matched_ito"])) {
        let plant = pendulum::plant(*length);
        let gamma = error_covariance(&plant.closed(&k), &plant.kalman_bucy(), Time::Continuous);
        assert_close("matched", weighted(&gamma, &inverse(&plant.r)), want, 1e-10);
        let sampled = plant.sampled(1e-3);
        let (observer, s) = sampled.kalman();
        let block = sampled.closed(&k.sampled(1e-3));
        let gamma = error_covariance(&block, &observer, Time::Discrete);
        assert_close_matrix("Gamma = S", &gamma, &s, 1e-9);
    }
}

mod pendulum {
    use super::*;

    pub(crate) fn plant(length: f64) -> Plant {
        let (m, g, b, k) = (0.75, 9.8, 0.1, 0.15);
        let l = length;
        Plant {
            a: vec![
                vec![0.0, 0.0, 1.0, 0.0, 0.0],
                vec![0.0, 0.0, 0.0, 1.0, 0.0],
                vec![-k, -m * g, -b, 0.0, -1.0],
                vec![k / l, (m + 1.0) * g / l, b / l, 0.0, 1.0 / l],
                vec![0.0, 0.0, 0.0, 0.0, -1.0],
            ],
            b: [0.0, 0.0, 1.0, -1.0 / l, 0.0].map(|v| vec![v]).to_vec(),
            c: part(&eye(5), 0, 2, 0, 5),
            q: diag(&[0.0, 0.0, 0.0, 0.0, 1.0]),
            r: diag(&[1e-7, 1e-8]),
        }
    }

    pub(crate) fn controller() -> Controller {
        let k = &data::load("pendulum.json")["controller"];
        let [a, b, c] = ["A", "B", "C"].map(|name| matrix(&k[name]));
        Controller { a, b, c }
    }
}

#[test]
fn upsilon_of_the_pendulum() {
    let file = data::load("pendulum_exact.json");
    let (nominals, k) = (vector(&file["nominals"]), pendulum::controller());
    let dt = 1e-3;
    let models: Vec<Plant> = nominals.iter().map(|l| pendulum::plant(*l)).collect();
    let continuous: Vec<Observer> = models.iter().map(Plant::kalman_bucy).collect();
    let discrete: Vec<_> = models.iter().map(|m| m.sampled(dt).kalman()).collect();
    for (row, l) in vector(&file["L"]).iter().enumerate() {
        let plant = pendulum::plant(*l);
        let (block, w) = (plant.closed(&k), inverse(&plant.r));
        let sampled = plant.sampled(dt);
        let block_d = sampled.closed(&k.sampled(dt));
        for i in 0..nominals.len() {
            let want = |key: &str| data::number(&file[key][row][i]);
            let gamma = error_covariance(&block, &continuous[i], Time::Continuous);
            assert_close("ito", weighted(&gamma, &w), want("ito"), 1e-9);
            assert_close("identity", weighted(&gamma, &eye(2)), want("identity"), 1e-9);
            let (observer, s) = &discrete[i];
            let gamma = error_covariance(&block_d, observer, Time::Discrete);
            let got = likelihood(&gamma, s, &sampled.r) / dt;
            assert_close("baram", got, want("baram_dt1ms"), 1e-8);
        }
    }
}

fn signal(filter: &Value, xi: &M) -> Signal {
    let [a, b, c] = ["A", "B", "C"].map(|name| matrix(&filter[name]));
    Signal::filter(&a, &b, &c, xi)
}

/// The entries of `A` written with the parameter `k`; the files have only these forms.
fn entry(text: &str, k: f64) -> f64 {
    match text {
        "-k" => -k,
        "-(1+k)" => -(1.0 + k),
        "k" => k,
        "k/2" => k / 2.0,
        "-(k+0.5)/2" => -(k + 0.5) / 2.0,
        number => number.parse().expect("a number"),
    }
}

fn plant_of(case: &Value, k: f64) -> Plant {
    let rows = case["A"].as_array().expect("A by rows of expressions");
    let row = |r: &Value| -> Vec<f64> {
        let texts = r.as_array().expect("a row").iter();
        texts.map(|e| entry(e.as_str().expect("text"), k)).collect()
    };
    let a: M = rows.iter().map(row).collect();
    let g = matrix(&case["G"]);
    let xi = matrix(&case["Xi"]);
    let r = if case["R"].is_null() { &case["Theta"] } else { &case["R"] };
    let colour = &case["disturbance_filter"];
    let white = prod(&[&g, &xi, &t(&g)]);
    let plant = Plant {
        q: if colour.is_null() { white } else { zeros(a.len(), a.len()) },
        a,
        b: matrix(&case["B"]),
        c: matrix(&case["C"]),
        r: matrix(r),
    };
    if colour.is_null() { plant } else { plant.with_disturbance(&g, &signal(colour, &xi)) }
}

fn input_of(case: &Value) -> Signal {
    let filter = &case["input_filter"];
    signal(filter, &eye(matrix(&filter["B"])[0].len()))
}

/// The design model of a case: with the disturbance's state, or white.
fn model_of(case: &Value, k: f64) -> Plant {
    let mut model = plant_of(case, k);
    if !case["Xi_design"].is_null() {
        let (n, g) = (case["A"].as_array().unwrap().len(), matrix(&case["G"]));
        model.a = part(&model.a, 0, n, 0, n);
        model.b = part(&model.b, 0, n, 0, shape(&model.b).1);
        model.c = part(&model.c, 0, model.c.len(), 0, n);
        model.q = prod(&[&g, &matrix(&case["Xi_design"]), &t(&g)]);
    }
    model
}

#[test]
fn upsilon_of_open_loops() {
    let file = data::load("eip_open_loop.json");
    for case in data::cases(&file) {
        let dt = data::number(&case["dt"]);
        let (nominals, u) = (vector(&case["nominals"]), input_of(case));
        let models: Vec<Plant> = nominals.iter().map(|k| model_of(case, *k)).collect();
        let observers: Vec<_> = models.iter().map(Plant::kalman_bucy).collect();
        let sampled: Vec<_> = models.iter().map(|m| m.sampled(dt).kalman()).collect();
        for (row, k) in vector(&case["grid"]).iter().enumerate() {
            let plant = plant_of(case, *k);
            let (w, plant_d) = (inverse(&plant.r), plant.sampled(dt));
            for i in 0..nominals.len() {
                let want = |key: &str| data::number(&case["upsilon"][key][row][i]);
                let gamma = error_covariance(&plant.open(&u), &observers[i], Time::Continuous);
                assert_close("ito", weighted(&gamma, &w), want("ito"), 1e-11);
                let one = eye(w.len());
                assert_close("identity", weighted(&gamma, &one), want("identity"), 1e-11);
                let (observer, s) = &sampled[i];
                let block = plant_d.open(&u.sampled(dt));
                let gamma = error_covariance(&block, observer, Time::Discrete);
                let got = likelihood(&gamma, s, &plant_d.r) / dt;
                assert_close("baram", got, want("baram"), 1e-9);
            }
        }
    }
}

#[test]
fn upsilon_of_discrete_plants() {
    let file = data::load("eip_discrete.json");
    let case = data::find(&file, "name", "discrete_three_state");
    compare_discrete(case, &input_of(case), |k| plant_of(case, k));
    let case = data::find(&file, "name", "two_axis_tracker");
    let still = Signal { a: zeros(1, 1), c: eye(1), q: zeros(1, 1) };
    compare_discrete(case, &still, |c| Plant {
        a: scale(c, &matrix(&case["A0"])),
        b: zeros(4, 1),
        c: matrix(&case["C"]),
        q: matrix(&case["Q"]),
        r: matrix(&case["R"]),
    });
}

fn compare_discrete(case: &Value, u: &Signal, plant: impl Fn(f64) -> Plant) {
    let nominals = vector(&case["nominals"]);
    let models: Vec<_> = nominals.iter().map(|k| plant(*k).kalman()).collect();
    for (row, k) in vector(&case["grid"]).iter().enumerate() {
        let plant = plant(*k);
        for (i, (observer, s)) in models.iter().enumerate() {
            let gamma = error_covariance(&plant.open(u), observer, Time::Discrete);
            assert_close_matrix("Gamma", &gamma, &matrix(&case["gamma"][row][i]), 1e-11);
            let want = data::number(&case["upsilon"]["baram"][row][i]);
            assert_close("baram", likelihood(&gamma, s, &plant.r), want, 1e-11);
        }
    }
}
