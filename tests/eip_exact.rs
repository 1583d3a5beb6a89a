//! Upsilon, boundaries and conventions against numbers made in ball arithmetic.

use std::sync::Arc;

use faer::Mat;
use mmae::eip::{Bank, Convention, EipSets, Method, Study, Verify};
use mmae::model::{
    Axis, Family, FnFamily, Grid, Names, Plant, Shaping, Surroundings, Time, systems,
};
use mmae::observer::ObserverKind;
use mmae::par::RunControl;
use serde_json::Value;

fn load(text: &str) -> Value {
    serde_json::from_str(text).unwrap()
}

fn numbers(v: &Value) -> Vec<f64> {
    v.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

fn matrix(v: &Value) -> Mat<f64> {
    let rows: Vec<Vec<f64>> = v.as_array().unwrap().iter().map(numbers).collect();
    Mat::from_fn(rows.len(), rows[0].len(), |i, j| rows[i][j])
}

fn table(v: &Value) -> Vec<f64> {
    v.as_array().unwrap().iter().flat_map(numbers).collect()
}

fn explicit(name: &str, v: &Value) -> Grid {
    Grid::new(vec![(name.into(), Axis::Explicit(numbers(v)))]).unwrap()
}

fn run(study: &Study) -> EipSets {
    study.run(&RunControl::default()).unwrap()
}

#[track_caller]
fn close(what: &str, got: &[f64], want: &[f64], tolerance: f64) {
    assert_eq!(got.len(), want.len(), "{what}");
    for (k, (g, w)) in got.iter().zip(want).enumerate() {
        assert!(((g - w) / w).abs() <= tolerance, "{what}[{k}]: {g} for {w}");
    }
}

fn filter(v: &Value) -> Option<Shaping> {
    let v = v.as_object()?;
    let (a, b) = (matrix(&v["A"]), matrix(&v["B"]));
    let states = (0..a.nrows()).map(|i| format!("f{i}")).collect();
    Some(Shaping { Q: Mat::identity(b.ncols(), b.ncols()), C: matrix(&v["C"]), A: a, B: b, states })
}

/// `A(k)` of a case.
fn state_matrix(name: &str, k: f64) -> Mat<f64> {
    let rows: Vec<Vec<f64>> = match name {
        "mass_spring_siso" => vec![vec![0.0, 1.0], vec![-k, -0.4]],
        "two_mass_mimo_shaped" | "two_mass_mimo_white" => vec![
            vec![0.0, 0.0, 1.0, 0.0],
            vec![0.0, 0.0, 0.0, 1.0],
            vec![-(1.0 + k), k, -0.4, 0.1],
            vec![k / 2.0, -(k + 0.5) / 2.0, 0.05, -0.15],
        ],
        "discrete_three_state" => {
            vec![vec![0.8, 0.25, 0.0], vec![-k, 0.75, 0.1], vec![0.0, -0.1, 0.6]]
        }
        other => panic!("unknown case {other}"),
    };
    Mat::from_fn(rows.len(), rows.len(), |i, j| rows[i][j])
}

fn study_of(case: &Value, grid: Grid) -> Study {
    let name = case["name"].as_str().unwrap().to_owned();
    let (b, g, c) = (matrix(&case["B"]), matrix(&case["G"]), matrix(&case["C"]));
    let (time, r) = match case["time"].as_str().unwrap() {
        "continuous" => (Time::Continuous, matrix(&case["Theta"])),
        _ => (Time::Discrete { dt: 1.0 }, matrix(&case["R"])),
    };
    let q = matrix(case.get("Xi_design").unwrap_or(&case["Xi"]));
    let mut disturbance = case.get("disturbance_filter").and_then(filter);
    if let Some(f) = &mut disturbance {
        f.Q = matrix(&case["Xi"]);
    }
    let names = Names::numbered(c.ncols(), b.ncols(), g.ncols(), c.nrows());
    let family = FnFamily::new(&[("k", 1.0)], names, time, move |theta| {
        Ok(Plant {
            time,
            A: state_matrix(&name, theta[0]),
            B: b.clone(),
            G: g.clone(),
            C: c.clone(),
            Q: q.clone(),
            R: r.clone(),
        })
    });
    let kind = if time.is_continuous() { ObserverKind::KalmanBucy } else { ObserverKind::Kalman };
    let mut bank = Bank::along(kind, "k", &numbers(&case["nominals"]));
    bank.shaping = case.get("Xi_design").is_none();
    let mut study = Study::new(Arc::new(family), bank, grid);
    study.surroundings = Surroundings {
        disturbance,
        input: case.get("input_filter").and_then(filter),
        ..Default::default()
    };
    study.verify = Verify::All;
    study
}

#[test]
fn open_loop_cases_in_every_convention_by_every_method() {
    let file = load(include_str!("data/eip_open_loop.json"));
    for case in file["cases"].as_array().unwrap() {
        let mut study = study_of(case, explicit("k", &case["grid"]));
        let dt = case["dt"].as_f64().unwrap();
        for convention in [Convention::Ito, Convention::Identity, Convention::Baram { dt }] {
            let key = convention.name();
            study.convention = convention;
            let want = table(&case["upsilon"][key]);
            for method in [Method::Doubling, Method::Modal] {
                study.method = Some(method);
                let what = format!("{} {key} {method:?}", case["name"]);
                let sets = run(&study);
                assert_eq!(sets.method, method, "{what}");
                close(&what, &sets.cases[0].upsilon, &want, 1e-9);
                assert!(sets.cases[0].route_difference < 1e-9, "{what}");
                let boundaries: Vec<f64> =
                    sets.cases[0].boundaries.iter().map(|b| b.value).collect();
                close(&what, &boundaries, &numbers(&case["boundaries"][key]), 1e-9);
            }
        }
    }
}

#[test]
fn exact_delay_of_an_exogenous_input() {
    let file = load(include_str!("data/eip_open_loop.json"));
    let case = file["cases"].as_array().unwrap().iter().find(|c| c.get("delay").is_some()).unwrap();
    let mut study = study_of(case, explicit("k", &case["grid"]));
    study.delays = vec![case["delay"]["tau"].as_f64().unwrap()];
    study.surroundings.pade_order = 8;
    let sets = run(&study);
    let want = table(&case["delay"]["ito_exact"]);
    close("delay", &sets.cases[0].upsilon, &want, 1e-8);
    assert!(sets.cases[0].route_difference < 1e-8);
}

#[test]
fn discrete_plant_with_filters() {
    let file = load(include_str!("data/eip_discrete.json"));
    let case = &file["cases"][0];
    let mut study = study_of(case, explicit("k", &case["grid"]));
    let ln_det = numbers(&case["half_logdet_S"]);
    let traces = table(&case["half_tr_Sinv_gamma"]);
    let want: Vec<f64> =
        traces.iter().enumerate().map(|(k, t)| t + ln_det[k % ln_det.len()]).collect();
    for method in [Method::Doubling, Method::Modal] {
        study.method = Some(method);
        let sets = run(&study);
        close("baram", &sets.cases[0].upsilon, &want, 1e-11);
        let boundaries: Vec<f64> = sets.cases[0].boundaries.iter().map(|b| b.value).collect();
        close("boundaries", &boundaries, &numbers(&case["boundaries"]["baram"]), 1e-10);
    }
    study.convention = Convention::Identity;
    close("identity", &run(&study).cases[0].upsilon, &table(&case["upsilon"]["identity"]), 1e-10);
}

#[test]
fn tracker_below_the_stability_limit() {
    let file = load(include_str!("data/eip_discrete.json"));
    let case = &file["cases"][1];
    let bank = Bank::along(ObserverKind::Kalman, "rho", &numbers(&case["nominals"]));
    let study = Study::new(Arc::new(systems::tracker()), bank, explicit("rho", &case["grid"]));
    let sets = run(&study);
    let ln_det = numbers(&case["half_logdet_S"]);
    let traces = table(&case["half_tr_Sinv_gamma"]);
    let want: Vec<f64> =
        traces.iter().enumerate().map(|(k, t)| t + ln_det[k % ln_det.len()]).collect();
    close("tracker", &sets.cases[0].upsilon, &want, 1e-10);
}

#[test]
fn pendulum_to_the_last_digits() {
    let file = load(include_str!("data/pendulum_exact.json"));
    let bank = Bank::along(ObserverKind::KalmanBucy, "L", &numbers(&file["nominals"]));
    let mut study = Study::new(Arc::new(systems::pendulum()), bank, explicit("L", &file["L"]));
    study.surroundings = systems::pendulum_surroundings();
    for (convention, key, tolerance) in [
        (Convention::Ito, "ito", 1e-11),
        (Convention::Identity, "identity", 1e-11),
        (Convention::Baram { dt: 1e-3 }, "baram_dt1ms", 1e-10),
    ] {
        study.convention = convention;
        let sets = run(&study);
        close(key, &sets.cases[0].upsilon, &table(&file[key]), tolerance);
        let boundaries: Vec<f64> = sets.cases[0].boundaries.iter().map(|b| b.value).collect();
        close(key, &boundaries, &numbers(&file["boundaries"][key]), 1e-12);
    }
    study.convention = Convention::Ito;
    study.delays = vec![0.02];
    let sets = run(&study);
    close("delay", &sets.cases[0].upsilon, &table(&file["ito_exact_delay_20ms"]), 1e-10);
}

#[test]
fn duplicates_failed_models_and_ties() {
    // model 1 stands twice, model 3 cannot be built
    let family =
        FnFamily::new(&[("k", 1.0)], Names::numbered(3, 1, 1, 1), Time::Continuous, |theta| {
            let base = systems::by_name("oscillator").unwrap();
            let mut plant = base.plant(&[1.0, 0.1])?;
            plant.A[(2, 1)] = -theta[0];
            plant.A[(2, 0)] = theta[0];
            plant.R[(0, 0)] = 0.1;
            if theta[0] == 9.0 {
                plant.A[(0, 0)] = f64::NAN;
            }
            Ok(plant)
        });
    let models = [1.0, 1.0, 2.0, 9.0];
    let bank = Bank::along(ObserverKind::KalmanBucy, "k", &models);
    let grid = Grid::linear("k", 0.8, 2.4, 9).unwrap();
    let sets = run(&Study::new(Arc::new(family), bank, grid));
    let case = &sets.cases[0];
    assert_eq!(sets.models[1].duplicate_of, Some(0));
    let failure = sets.models[3].failure.as_ref().unwrap().to_string();
    assert!(failure.contains("model 3 (k = 9)") && failure.contains("A[0][0]"), "{failure}");
    assert!(case.sets[1].is_empty() && case.sets[3].is_empty());
    assert_eq!(case.boundaries.len(), 1);
    assert_eq!((case.boundaries[0].left, case.boundaries[0].right), (0, 2));
    for (k, row) in case.upsilon.chunks(4).enumerate() {
        assert_eq!(row[0].to_bits(), row[1].to_bits());
        assert!(row[3].is_nan());
        assert!(case.margin[k] > 0.0, "the duplicate is no runner-up");
    }
}

#[test]
fn the_same_bits_for_any_number_of_threads_and_any_part_of_the_grid() {
    let bank = Bank::along(ObserverKind::KalmanBucy, "L", &[1.025, 1.287, 1.526]);
    let study = |grid| {
        let mut s = Study::new(Arc::new(systems::pendulum()), bank.clone(), grid);
        s.surroundings = systems::pendulum_surroundings();
        s.verify = Verify::None;
        s
    };
    let values: Vec<f64> = (0..203).map(|i| 0.9 + 0.004 * f64::from(i)).collect();
    let grid = |v: &[f64]| Grid::new(vec![("L".into(), Axis::Explicit(v.to_vec()))]).unwrap();
    let bits = |sets: &EipSets| -> Vec<u64> {
        sets.cases[0].upsilon.iter().map(|u| u.to_bits()).collect()
    };
    for method in [Method::Doubling, Method::Modal] {
        let mut whole = study(grid(&values));
        whole.method = Some(method);
        let one = bits(&whole.run(&RunControl::default().threads(1)).unwrap());
        for threads in [2, 3, 8] {
            assert_eq!(one, bits(&whole.run(&RunControl::default().threads(threads)).unwrap()));
        }
        // a plant has the same bits in any company: the frequency scale is
        // taken from the ends and the middle of the grid, so keep those
        let mut some = vec![
            values[0],
            values[7],
            values[50],
            values[101],
            values[150],
            values[155],
            values[202],
        ];
        some.sort_by(f64::total_cmp);
        let mut part = study(grid(&some));
        part.method = Some(method);
        let part = bits(&run(&part));
        for (k, v) in some.iter().enumerate() {
            let at = values.iter().position(|x| x == v).unwrap();
            assert_eq!(part[k * 3..k * 3 + 3], one[at * 3..at * 3 + 3], "{v}");
        }
    }
}

#[test]
fn bad_studies_say_what_to_change() {
    let bank = || Bank::along(ObserverKind::KalmanBucy, "L", &[1.0, 1.5]);
    let grid = |n: &str| Grid::linear(n, 0.9, 1.9, 5).unwrap();
    let pendulum = || {
        let mut s = Study::new(Arc::new(systems::pendulum()), bank(), grid("L"));
        s.surroundings = systems::pendulum_surroundings();
        s
    };
    let fails = |s: &Study| s.run(&RunControl::default()).unwrap_err().to_string();

    let mut s = pendulum();
    s.grid = grid("Lenght");
    assert!(fails(&s).contains("no parameter is called 'Lenght'"));
    let mut s = pendulum();
    s.bank.parameters = vec!["x".into()];
    assert!(fails(&s).contains("no parameter is called 'x'"));
    let mut s = pendulum();
    s.bank.models.clear();
    assert!(fails(&s).contains("is empty"));
    let mut s = pendulum();
    s.bank.observer = ObserverKind::Kalman;
    assert!(fails(&s).contains("kalman-bucy"));
    let mut s = pendulum();
    s.convention = Convention::Baram { dt: f64::NAN };
    assert!(fails(&s).contains("sampling interval"));
    let mut s = pendulum();
    s.delays = vec![-0.1];
    assert!(fails(&s).contains("actuator delay"));
    let mut s = pendulum();
    s.memory_limit = 100;
    assert!(fails(&s).contains("bytes"));
    let mut s = pendulum();
    s.surroundings.controller.as_mut().unwrap().B = Mat::zeros(4, 3);
    assert!(fails(&s).contains("controller.B"));
    let mut s = Study::new(
        Arc::new(systems::tracker()),
        Bank::along(ObserverKind::Kalman, "rho", &[0.9]),
        grid("rho"),
    );
    s.convention = Convention::Ito;
    assert!(fails(&s).contains("continuous"));
    assert_eq!(systems::tracker().parameters().len(), 4);
}
