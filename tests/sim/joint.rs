//! Continuous observers that see the plant without sampling.

use mmae::bank::{Members, Settings};
use mmae::engine::{Mixing, Weighting};
use mmae::model::{Plant, Time};
use mmae::observer::ObserverKind;
use mmae::par::RunControl;
use mmae::sim::{Measurement, MonteCarlo, Signal, Signals, Summary, Term, Truth, Wave};
use mmae::weight::{Law, Transition};
use mmae::{Error, Mat, mat};

use crate::json::{close, list, number, read, vector};

const DT: f64 = 0.01;

fn plant(wn: f64) -> Plant {
    Plant {
        time: Time::Continuous,
        A: mat![[-5.0, 0.0, 0.0], [0.0, 0.0, 1.0], [wn * wn, -wn * wn, -0.2 * wn]],
        B: mat![[5.0], [0.0], [0.0]],
        G: mat![[5.0], [0.0], [0.0]],
        C: mat![[0.0, 1.0, 0.0]],
        Q: mat![[100.0]],
        R: mat![[0.1]],
    }
}

fn square(period: f64, decay: f64) -> Signal {
    Signal { terms: vec![Term { wave: Wave::Square { amplitude: 1.0, period }, decay }] }
}

/// The experiment of Aguiar et al. (2007), section V.
fn experiment(wn: f64, law: Law, steps: u64) -> MonteCarlo {
    let members = Members::new(ObserverKind::KalmanBucy, [0.7, 1.0, 2.0, 4.0].map(plant).to_vec());
    let mut truth = Truth::new(plant(wn));
    let sine = Wave::Sine { amplitude: 1.0, omega: 50.0, phase: 0.0 };
    truth.signals = Signals {
        inputs: vec![square(10.0, 0.0)],
        disturbances: vec![Some(square(6.0, 0.01))],
        noise: vec![Some(Signal { terms: vec![Term { wave: sine, decay: 0.01 }] })],
    };
    MonteCarlo {
        members,
        settings: Settings { dt: Some(DT), ..Settings::default() },
        weighting: Weighting { law, ..Weighting::default() },
        prior: vec![1.0; 4],
        truth,
        steps,
        trials: 1,
        measurement: Measurement::Continuous,
        seed: 1,
        every: 100,
        keep: vec![0],
        values: [0.7, 1.0, 2.0, 4.0].map(|wn| vec![wn]).to_vec(),
    }
}

fn run(experiment: &MonteCarlo) -> Summary {
    experiment.run(&RunControl::default()).unwrap()
}

#[test]
fn deterministic_runs_meet_the_reference() {
    let data = read("oscillator_bank.json");
    for item in list(&data["deterministic"]["items"]) {
        let (law, tol) = match item["reading"].as_str() {
            Some("ode") => (Law::Ode { substeps: 8 }, 5e-9),
            _ => (Law::Likelihood, 1e-7),
        };
        let summary = run(&experiment(number(&item["wn"]), law, 20_000));
        for sample in list(&item["samples"]) {
            let t = number(&sample["t"]);
            let at = format!("wn = {}, {law:?}, t = {t}", item["wn"]);
            let k = (t / DT).round() as usize / 100 - 1;
            close(&at, &summary.record[k].p, &vector(&sample["p"]), 0.0, tol);
            let x = &summary.kept[0].x[3 * k..][..3];
            close(&at, x, &vector(&sample["x"]), 1e-8, 0.0);
            let error = number(&sample["err_norm"]);
            assert!((summary.record[k].x_error_rms - error).abs() < 1e-6, "{at}");
        }
    }
}

/// Jumps at times that are no multiples of the step are met exactly: the plant and
/// the observers are where a run with other steps has them.
#[test]
fn jumps_within_a_step_are_met() {
    let with = |dt: f64, steps: u64, every: u64| {
        let mut e = experiment(1.3, Law::Ode { substeps: 4 }, steps);
        e.settings.dt = Some(dt);
        e.every = every;
        e.truth.signals.inputs = vec![square(0.37, 0.2)];
        let times = vec![0.123, 0.4567, 1.0];
        let table = Wave::Table { t: times, value: vec![2.0, -1.0, 0.5] };
        e.truth.signals.disturbances =
            vec![Some(Signal { terms: vec![Term { wave: table, decay: 0.0 }] })];
        e.truth.signals.noise = vec![Some(square(0.0314, 0.0))];
        run(&e)
    };
    let (coarse, fine) = (with(0.01, 200, 20), with(0.001, 2000, 200));
    for (a, b) in coarse.record.iter().zip(&fine.record) {
        close("p", &a.p, &b.p, 0.0, 1e-8);
    }
    close("x", &coarse.kept[0].x, &fine.kept[0].x, 1e-11, 0.0);
    close("x_hat", &coarse.kept[0].x_hat, &fine.kept[0].x_hat, 1e-8, 0.0);
}

fn noisy(law: Law) -> MonteCarlo {
    let mut e = experiment(1.2, law, 500);
    e.truth.signals = Signals::default();
    e.truth.P0 = Some(Mat::identity(3, 3));
    (e.trials, e.keep) = (21, (0..21).collect());
    e
}

#[test]
fn bits_do_not_depend_on_threads_or_company() {
    for law in [Law::Likelihood, Law::Ode { substeps: 2 }] {
        let whole = run(&noisy(law));
        for threads in [1, 2, 3] {
            assert_eq!(noisy(law).run(&RunControl::default().threads(threads)).unwrap(), whole);
        }
        let few = run(&MonteCarlo { trials: 5, ..noisy(law) });
        assert_eq!(few.kept[..], whole.kept[..5]);
    }
}

/// With fine steps it makes no difference whether the measurement is held.
#[test]
fn fine_samples_come_to_the_same() {
    let mut joint = noisy(Law::Likelihood);
    joint.settings.dt = Some(0.002);
    (joint.steps, joint.every, joint.trials) = (5000, 0, 200);
    let sampled = MonteCarlo { measurement: Measurement::Sampled, ..joint.clone() };
    let (a, b) = (run(&joint), run(&sampled));
    let (a, b) = (a.last(), b.last());
    for i in 0..4 {
        assert!((a.identified[i] - b.identified[i]).abs() < 0.1, "{a:?} {b:?}");
        assert!((a.p[i] - b.p[i]).abs() < 0.1, "{a:?} {b:?}");
    }
    assert!((a.x_error_rms / b.x_error_rms - 1.0).abs() < 0.1, "{a:?} {b:?}");
}

/// The likelihood law picks the model nearest in information; the differential
/// equation goes to a mixture, that of Wong and Zakai.
#[test]
fn the_readings_differ_as_theory_says() {
    let data = read("oscillator_bank.json");
    for (wn, winner) in [(0.7, 0), (1.2, 1), (2.7, 3)] {
        let start = |law: Law| {
            let mut e = experiment(wn, law, 20_000);
            e.truth.signals = Signals::default();
            (e.trials, e.every, e.keep) = (16, 0, Vec::new());
            e
        };
        let likelihood = run(&start(Law::Likelihood));
        assert_eq!(likelihood.last().identified[winner], 1.0, "{wn}");
        let mut ode = start(Law::Ode { substeps: 2 });
        ode.settings.dt = Some(0.005);
        (ode.steps, ode.every) = (40_000, 400);
        let ode = run(&ode);
        let late = &ode.record[ode.record.len() / 4..];
        let theta = [0.7, 1.0, 2.0, 4.0];
        let mean = late.iter().map(|m| m.mean(&theta)).sum::<f64>() / late.len() as f64;
        // weights at rest would be where Wong and Zakai's correction puts them; these
        // move as fast as the observers, and stay away from the vertices
        let items = list(&data["stochastic_theory"]["items"]);
        if let Some(item) = items.iter().find(|i| number(&i["wn"]) == wn) {
            let rest = number(&item["wongzakai_omega"]);
            assert!((mean - rest).abs() < 0.45, "wn = {wn}: {mean} for {rest}");
        }
        let largest = |i: usize| late.iter().map(|m| m.p[i]).sum::<f64>() / late.len() as f64;
        assert!((0..4).all(|i| largest(i) < 0.95), "wn = {wn}");
    }
}

#[test]
fn what_does_not_fit_is_refused() {
    let refuse = |change: fn(&mut MonteCarlo), word: &str| {
        let mut e = experiment(1.2, Law::Likelihood, 10);
        change(&mut e);
        let said = e.run(&RunControl::default()).unwrap_err();
        assert!(matches!(said, Error::Conflict { .. }), "{said}");
        assert!(said.to_string().contains(word), "{said}");
    };
    refuse(|e| e.weighting.law = Law::Bayes, "Dunn");
    refuse(|e| e.settings.gains = mmae::bank::GainMode::Recursive, "steady gains");
    refuse(|e| e.weighting.mixing = Mixing::Reseed { threshold: 1e-3 }, "mixed");
    let mut e = experiment(1.2, Law::Likelihood, 10);
    e.weighting.mixing = Mixing::Markov(Transition::sticky(4, 0.99).unwrap());
    assert!(e.run(&RunControl::default()).is_ok());
    e.truth.signals.noise = vec![Some(square(0.0, 0.0))];
    assert!(e.run(&RunControl::default()).unwrap_err().to_string().contains("period"));
}
