//! The truth in a loop: against dense simulations, covariances, other company.

use mmae::bank::{Members, Settings};
use mmae::engine::{Mixing, Mmae, Weighting};
use mmae::model::{
    Controller, Family, LoopBlock, Plant, Shaping, Surroundings, Time, sample, systems,
};
use mmae::observer::ObserverKind;
use mmae::par::RunControl;
use mmae::sim::{Measurement, MonteCarlo, Signal, Signals, Summary, Term, Truth, Wave};
use mmae::weight::{DwsgScheme, Law, Modifiers};
use mmae::{Error, Mat, mat};

use crate::common::equations::expm;
use crate::common::matrix::{M, add, blocks, mul, scale, t, zeros};

fn rows(m: &Mat<f64>) -> M {
    (0..m.nrows()).map(|i| (0..m.ncols()).map(|j| m[(i, j)]).collect()).collect()
}

/// Pendulum of length `length` with the disturbance force among its states.
fn pendulum(length: f64) -> Plant {
    let family = systems::pendulum();
    let plant = family.plant(&family.theta_with(&[("L", length)]).unwrap()).unwrap();
    plant.with_disturbance(systems::pendulum_surroundings().disturbance.as_ref())
}

fn controller() -> Controller {
    let Surroundings { controller, .. } = systems::pendulum_surroundings();
    controller.unwrap()
}

fn experiment(truth: Truth, models: Vec<Plant>, dt: Option<f64>) -> MonteCarlo {
    let kind = if dt.is_some() { ObserverKind::KalmanBucy } else { ObserverKind::Kalman };
    MonteCarlo {
        prior: vec![1.0; models.len()],
        values: Vec::new(),
        members: Members::new(kind, models),
        settings: Settings { dt, ..Settings::default() },
        weighting: Weighting { law: Law::Bayes, ..Weighting::default() },
        truth,
        steps: 200,
        trials: 1,
        measurement: Measurement::Sampled,
        seed: 1,
        every: 1,
        keep: vec![0],
    }
}

/// A loop with everything in it.
fn pendulums(delay: f64) -> MonteCarlo {
    let truth = Truth {
        controller: Some(controller()),
        input: Some(Shaping {
            A: mat![[-2.0, 1.0], [0.0, -5.0]],
            B: mat![[0.0], [3.0]],
            C: mat![[1.0, 0.1]],
            Q: mat![[0.5]],
            states: vec!["r1".into(), "r2".into()],
        }),
        delay,
        ..Truth::new(pendulum(1.4))
    };
    experiment(truth, [1.025, 1.287, 1.526, 1.778].map(pendulum).to_vec(), Some(0.01))
}

fn run(experiment: &MonteCarlo, threads: usize) -> Summary {
    experiment.run(&RunControl::default().threads(threads)).unwrap()
}

/// `e^{A h}` and `int_0^h e^{A s} ds B`.
fn held(a: &M, b: &M, h: f64) -> [M; 2] {
    let (n, m) = (a.len(), b[0].len());
    let e = expm(&scale(h, &blocks(&[&[a, b], &[&zeros(m, n), &zeros(m, m)]])));
    let cut = |from: usize, to: usize| e[..n].iter().map(|r| r[from..to].to_vec()).collect();
    [cut(0, n), cut(n, n + m)]
}

fn known(input: Signal) -> Signals {
    Signals { inputs: vec![input], ..Signals::default() }
}

/// Without noise the loop is that of an integration from command to command.
#[test]
fn a_quiet_loop_is_that_of_a_dense_simulation() {
    let dt = 0.01;
    let sine = |amplitude, omega| {
        let wave = Wave::Sine { amplitude, omega, phase: 0.3 };
        Some(Signal { terms: vec![Term { wave, decay: 0.1 }] })
    };
    for delay in [0.0, 0.004, 0.01, 0.02, 0.027] {
        let plant = pendulum(1.4);
        let x0 = vec![0.1, 0.02, -0.1, 0.05, 0.3];
        let inputs: Vec<f64> = (0..120).map(|k| 0.2 * (f64::from(k) / 7.0).sin()).collect();
        let signals = Signals {
            disturbances: vec![sine(2.0, 3.0)],
            noise: vec![Some(Signal::default()), sine(1e-3, 20.0)],
            ..known(Signal::steps(dt, &inputs))
        };
        let truth = Truth {
            controller: Some(controller()),
            signals: signals.clone(),
            delay,
            x0: x0.clone(),
            ..Truth::new(plant.clone())
        };
        let kept = &run(&experiment(truth, vec![pendulum(1.3)], Some(dt)), 1).kept[0];
        let k = controller();
        let [ak, bk] = held(&rows(&k.A), &rows(&k.B), dt);
        let whole = (delay / dt + 1e-9).floor();
        let late = delay - whole * dt;
        let (a, b) = (rows(&plant.A), blocks(&[&[&rows(&plant.B), &rows(&plant.G)]]));
        let parts = [held(&a, &b, late.max(0.0)), held(&a, &b, dt - late.max(0.0))];
        let column = |x: &[f64]| -> M { x.iter().map(|v| vec![*v]).collect() };
        let mut x = column(&x0);
        let mut xk = zeros(4, 1);
        let mut sent: Vec<f64> = Vec::new();
        for step in 0..200 {
            let at = |signal: &Option<Signal>| signal.as_ref().unwrap().at(step as f64 * dt);
            let v = column(&[at(&signals.noise[0]), at(&signals.noise[1])]);
            let y = add(&mul(&rows(&plant.C), &x), &v);
            let u = mul(&rows(&k.C), &xk)[0][0] + inputs[step.min(119)];
            xk = add(&mul(&ak, &xk), &mul(&bk, &y));
            sent.push(u);
            let ago = |steps: usize| if steps > step { 0.0 } else { sent[step - steps] };
            let w = at(&signals.disturbances[0]);
            for (part, ago) in parts.iter().zip([ago(whole as usize + 1), ago(whole as usize)]) {
                x = add(&mul(&part[0], &x), &mul(&part[1], &column(&[ago, w])));
            }
            let near = |got: f64, want: f64| {
                assert!((got - want).abs() < 1e-11, "delay {delay} step {step}: {got} for {want}");
            };
            near(kept.u[step], u);
            (0..2).for_each(|i| near(kept.y[2 * step + i], y[i][0]));
            (0..5).for_each(|i| near(kept.x[5 * step + i], x[i][0]));
        }
        assert!(x.iter().all(|x| x[0].abs() < 3.0) && kept.x[999].abs() > 1e-4, "{x:?}");
    }
}

/// White noise among the signals is that of a plant of this intensity; as an
/// input it is held.
#[test]
fn white_signals_take_the_place_of_a_channels_own_noise() {
    let white =
        |intensity| Signal { terms: vec![Term { wave: Wave::White { intensity }, decay: 0.0 }] };
    let plant = pendulum(1.4);
    let other = Plant { Q: mat![[0.3]], R: mat![[2e-7, 0.0], [0.0, 1e-8]], ..plant.clone() };
    let looped = |plant: Plant, signals: Signals| {
        let truth = Truth { controller: Some(controller()), signals, ..Truth::new(plant) };
        run(&experiment(truth, vec![pendulum(1.3)], Some(0.01)), 1)
    };
    let signals = Signals {
        disturbances: vec![Some(white(0.3))],
        noise: vec![Some(white(2e-7)), None],
        ..Signals::default()
    };
    assert_eq!(looped(plant, signals), looped(other, Signals::default()));
    for (plant, dt, held) in [(pendulum(1.4), Some(0.01), 0.01), (cart(), None, 1.0)] {
        let truth = Truth { signals: known(white(0.3)), ..Truth::new(plant.clone()) };
        let base = MonteCarlo {
            trials: 20_000,
            steps: 1,
            keep: (0..20_000).collect(),
            ..experiment(truth, vec![plant], dt)
        };
        let mean = run(&base, 0).kept.iter().map(|t| t.u[0] * t.u[0]).sum::<f64>() / 20_000.0;
        let want = 0.3 / held;
        assert!((mean / want - 1.0).abs() < 5.0 * (2.0_f64 / 20_000.0).sqrt(), "{mean} {want}");
    }
}

/// A cart that is pushed, in discrete time.
fn cart() -> Plant {
    Plant {
        time: Time::Discrete { dt: 0.5 },
        A: mat![[0.95, 0.5], [0.0, 0.9]],
        B: mat![[0.1], [0.5]],
        G: mat![[0.0], [1.0]],
        C: mat![[1.0, 0.0]],
        Q: mat![[0.04]],
        R: mat![[0.01]],
    }
}

fn brake() -> Controller {
    Controller { A: mat![[0.2]], B: mat![[-0.1]], C: mat![[0.4]], D: mat![[-0.1]] }
}

/// A discrete loop by its equations: the command that follows from `y(k-1)`
/// moves the plant to `x(k)`.
#[test]
fn a_discrete_loop_is_that_of_its_equations() {
    for (late, delay) in [(0, 0.0), (1, 0.5), (3, 1.5)] {
        let quiet = Plant { Q: mat![[0.0]], R: mat![[0.0]], ..cart() };
        let truth = Truth {
            controller: Some(brake()),
            signals: known(Signal::steps(0.5, &[1.0, -0.5, 0.0])),
            delay,
            x0: vec![1.0, -0.5],
            ..Truth::new(quiet)
        };
        let kept = &run(&experiment(truth, vec![cart()], None), 1).kept[0];
        let (mut x, mut xk, mut f) = ([1.0, -0.5], 0.0, 0.0);
        let mut sent = vec![0.0; late];
        for step in 0..200 {
            let u = f + [1.0, -0.5, 0.0][step.min(2)];
            sent.push(u);
            let u_late = sent[step];
            x = [0.95 * x[0] + 0.5 * x[1] + 0.1 * u_late, 0.9 * x[1] + 0.5 * u_late];
            (f, xk) = (0.4 * xk - 0.1 * x[0], 0.2 * xk - 0.1 * x[0]);
            for (got, want) in
                [(kept.u[step], u), (kept.y[step], x[0]), (kept.x[2 * step + 1], x[1])]
            {
                assert!((got - want).abs() < 1e-12, "step {step}: {got} for {want}");
            }
        }
    }
}

/// Lanes and company do not matter, nor does the way through the engine.
#[test]
fn a_closed_loop_is_the_same_in_any_company() {
    let laws = [
        Law::Bayes,
        Law::Likelihood,
        Law::Dwsg { lambda: 100.0, tempering: 0.5, scheme: DwsgScheme::Left },
        Law::Zhang { n_max: 20.0 },
    ];
    for law in laws {
        let modifiers = Modifiers { floor: 1e-6, ..Modifiers::default() };
        let weighting = Weighting { law, modifiers, ..Weighting::default() };
        let base =
            MonteCarlo { weighting, trials: 13, keep: (0..13).collect(), ..pendulums(0.013) };
        let whole = run(&base, 1);
        for threads in [2, 3, 8] {
            assert_eq!(run(&base, threads), whole);
        }
        for trials in [1, 7, 9] {
            let part = run(&MonteCarlo { trials, ..base.clone() }, 1);
            assert_eq!(part.kept[..], whole.kept[..trials as usize]);
        }
        let reseeded =
            Weighting { mixing: Mixing::Reseed { threshold: 1e-300 }, ..base.weighting.clone() };
        let alone = run(&MonteCarlo { weighting: reseeded, ..base.clone() }, 2);
        for (a, b) in alone.kept.iter().zip(&whole.kept) {
            assert_eq!((&a.x, &a.y, &a.u), (&b.x, &b.y, &b.u));
            let mut engine =
                Mmae::new(&base.members, &base.settings, &base.weighting, &base.prior).unwrap();
            for k in 0..200 {
                let e = engine.step(&b.u[k..][..1], &b.y[2 * k..][..2]).unwrap();
                for i in 0..4 {
                    let (one, two) = (a.log_p[4 * k + i], b.log_p[4 * k + i]);
                    let near = |x: f64| (x - two).abs() < 1e-9 * two.abs().max(1.0);
                    assert!(near(one) && near(e.log_p[i]), "{law:?} {k}: {one} {two}");
                }
            }
        }
    }
}

/// `X = A X A' + B B'` by doubling.
fn stationary(a: &Mat<f64>, b: &Mat<f64>) -> M {
    let (mut a, b) = (rows(a), rows(b));
    let mut x = mul(&b, &t(&b));
    for _ in 0..60 {
        x = add(&x, &mul(&mul(&a, &x), &t(&a)));
        a = mul(&a, &a);
    }
    x
}

/// Second moments of state and command at the end, over trials, against those of
/// the sampled loop, within five standard deviations.
fn compare(experiment: &MonteCarlo, plant: &Plant, block: &LoopBlock) {
    let n = plant.nx();
    let x = stationary(&block.A, &block.B);
    let summary = run(experiment, 0);
    let count = experiment.trials as f64;
    for i in 0..n {
        for j in 0..=i {
            let got = summary.kept.iter().map(|t| t.x[i] * t.x[j]).sum::<f64>() / count;
            let spread = ((x[i][i] * x[j][j] + x[i][j] * x[i][j]) / count).sqrt();
            assert!((got - x[i][j]).abs() < 5.0 * spread, "{i} {j}: {got} for {}", x[i][j]);
        }
    }
    let (cu, du) = (rows(&block.Cu), rows(&block.Du));
    let want = add(&mul(&mul(&cu, &x), &t(&cu)), &mul(&du, &t(&du)))[0][0];
    let got = summary.kept.iter().map(|t| t.u[0] * t.u[0]).sum::<f64>() / count;
    assert!((got / want - 1.0).abs() < 5.0 * (2.0 / count).sqrt(), "u: {got} for {want}");
}

#[test]
fn a_long_run_has_the_covariance_of_the_sampled_loop() {
    for delay in [0.0, 0.013] {
        let base = MonteCarlo {
            steps: 3000,
            trials: 2000,
            every: 0,
            keep: (0..2000).collect(),
            ..pendulums(delay)
        };
        let base = MonteCarlo {
            members: Members::new(ObserverKind::KalmanBucy, vec![pendulum(1.4)]),
            prior: vec![1.0],
            ..base
        };
        let plant = pendulum(1.4);
        let (sampled, line) = sample(&plant, 0.01, delay).unwrap();
        let k = controller().sample(0.01).unwrap();
        let input = base.truth.input.as_ref().unwrap().sample(0.01).unwrap();
        let block = LoopBlock::sampled(&sampled, Some(&k), Some(&input), &line);
        compare(&base, &plant, &block);
    }
}

#[test]
fn a_long_discrete_run_has_the_covariance_of_its_loop() {
    let input = Shaping {
        A: mat![[0.8]],
        B: mat![[1.0]],
        C: mat![[0.5]],
        Q: mat![[0.02]],
        states: vec!["r".into()],
    };
    for delay in [0.0, 0.5] {
        let truth = Truth {
            controller: Some(brake()),
            input: Some(input.clone()),
            delay,
            ..Truth::new(cart())
        };
        let base = MonteCarlo {
            steps: 300,
            trials: 20_000,
            every: 0,
            keep: (0..20_000).collect(),
            ..experiment(truth, vec![cart()], None)
        };
        let form = mmae::model::DelayForm::Exact;
        let block = LoopBlock::new(&cart(), Some(&brake()), Some(&input), delay, form).unwrap();
        compare(&base, &cart(), &block);
    }
}

#[test]
fn a_loop_that_does_not_fit_is_named() {
    let base = pendulums(0.0);
    let with = |change: &dyn Fn(&mut Truth)| -> Error {
        let mut experiment = base.clone();
        change(&mut experiment.truth);
        experiment.run(&RunControl::default()).unwrap_err()
    };
    let short = with(&|t| t.controller.as_mut().unwrap().B = Mat::zeros(4, 1));
    assert!(matches!(&short, Error::Shape { what, .. } if what == "controller.B"), "{short}");
    let wide = with(&|t| t.input.as_mut().unwrap().C = Mat::zeros(2, 2));
    assert!(matches!(&wide, Error::Shape { what, .. } if what == "input.C"), "{wide}");
    let wild = with(&|t| t.input.as_mut().unwrap().A[(0, 0)] = 0.1);
    assert!(
        matches!(&wild, Error::Conflict { problem, .. } if problem.contains("input")),
        "{wild}"
    );
    for delay in [-0.01, f64::NAN, 1e3] {
        let late = with(&|t| t.delay = delay);
        assert!(matches!(&late, Error::Range { what, .. } if what == "actuator delay"), "{late}");
    }
}
