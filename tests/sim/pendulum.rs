//! The pendulum whose length varies: who has the largest weight, and when.
#![cfg(feature = "scenario")]

use mmae::engine::Weighting;
use mmae::par::RunControl;
use mmae::scenario::{Scenario, Simulation};
use mmae::sim::Summary;
use mmae::weight::{DwsgScheme, Law, Modifiers};

/// Boundaries of the EIP sets with a delay of 2 ms.
const BOUNDARIES: [f64; 3] = [1.153664611, 1.404549549, 1.649852831];

fn simulation(name: &str) -> Simulation {
    let file = format!("{}/examples/pendulum_{name}.toml", env!("CARGO_MANIFEST_DIR"));
    Scenario::from_file(file).unwrap().simulation(&[]).unwrap()
}

fn cell(length: f64) -> usize {
    BOUNDARIES.iter().filter(|b| length > **b).count()
}

/// Share of the largest weight that is the EIP cell's, over the last 2 s of the
/// holds, which begin at the times of `holds`.
fn share(simulation: &Simulation, summary: &Summary, holds: &[f64]) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for moment in &summary.record {
        let t = moment.step as f64 * simulation.dt;
        if holds.iter().any(|hold| t > hold + 3.0005 && t < hold + 5.0005) {
            sum += moment.identified[cell(simulation.theta(moment.step)[0])];
            count += 1;
        }
    }
    assert_eq!(count, 200 * holds.len());
    sum / f64::from(u32::try_from(count).unwrap())
}

fn dwsg(lambda: f64, tempering: f64, floor: f64) -> Weighting {
    Weighting {
        law: Law::Dwsg { lambda, tempering, scheme: DwsgScheme::Left },
        modifiers: Modifiers { floor, ..Modifiers::default() },
        ..Weighting::default()
    }
}

/// The published means of 5 runs, against 24 runs here.
///
/// A mean of 5 runs of this engine has, over 24 seeds, the mean and the standard
/// deviation given last; those of the published shares lie within 1.8 of them.
#[test]
fn weights_follow_ramps_and_jumps() {
    let bayes = simulation("ramps").estimator.weighting;
    let ramps = [0.0, 10.0, 20.0, 30.0];
    let jumps = [0.0, 5.0, 10.0, 15.0, 20.0, 25.0];
    let cases = [
        ("ramps", bayes.clone(), &ramps[..], [0.9999, 0.9986, 0.0020]),
        ("ramps", dwsg(100.0, 1.0, 0.0), &ramps, [1.000, 0.9966, 0.0113]),
        ("ramps", dwsg(300.0, 0.5, 1e-3), &ramps, [1.000, 1.000, 1e-4]),
        ("jumps", bayes, &jumps, [0.973, 0.9739, 0.0116]),
        ("jumps", dwsg(100.0, 1.0, 0.0), &jumps, [0.817, 0.8901, 0.0433]),
        ("jumps", dwsg(300.0, 0.5, 1e-3), &jumps, [0.970, 0.9571, 0.0285]),
    ];
    for (name, weighting, holds, [published, mean, spread]) in cases {
        let published: f64 = published;
        assert!((published - mean).abs() < 1.8 * spread);
        let mut simulation = simulation(name);
        simulation.estimator.weighting = weighting;
        (simulation.trials, simulation.every) = (24, 10);
        let summary = simulation.experiment(Vec::new()).run(&RunControl::default()).unwrap();
        let got = share(&simulation, &summary, holds);
        let law = &simulation.estimator.weighting.law;
        // 24 runs in place of 5, three standard deviations
        let off = (got - mean) / (spread * (5.0_f64 / 24.0).sqrt());
        assert!(off.abs() < 3.0, "{name} {law:?}: {got} for {mean}, {off}");
    }
}

/// Without a floor the weights wind up.
#[test]
fn bayes_without_a_floor_loses_the_plant() {
    let mut simulation = simulation("ramps");
    simulation.estimator.weighting = Weighting::default();
    (simulation.trials, simulation.every) = (8, 10);
    let summary = simulation.experiment(Vec::new()).run(&RunControl::default()).unwrap();
    let got = share(&simulation, &summary, &[0.0, 10.0, 20.0, 30.0]);
    assert!(got < 0.5, "{got}");
}

/// The fraction identified is the largest weight of the courses, and the true
/// length goes along its ramps and jumps.
#[test]
fn the_record_tells_of_the_largest_weight_and_the_cell() {
    let mut simulation = simulation("jumps");
    (simulation.trials, simulation.every, simulation.steps) = (3, 100, 12_000);
    let summary = simulation.experiment(vec![0, 1, 2]).run(&RunControl::default()).unwrap();
    let mut hits = 0.0;
    for (r, moment) in summary.record.iter().enumerate() {
        let mut identified = [0.0; 4];
        for trial in &summary.kept {
            let p = &trial.log_p[4 * r..][..4];
            let best = (0..4).max_by(|&i, &j| p[i].total_cmp(&p[j]).then(j.cmp(&i))).unwrap();
            identified[best] += 1.0 / 3.0;
        }
        for i in 0..4 {
            assert!((identified[i] - moment.identified[i]).abs() < 1e-12, "step {}", moment.step);
        }
        let t = moment.step as f64 * simulation.dt;
        let length = simulation.theta(moment.step)[0];
        assert_eq!(
            length,
            if t < 5.0005 {
                1.0
            } else if t < 10.0005 {
                1.5
            } else {
                1.25
            }
        );
        hits += identified[cell(length)];
    }
    assert!(hits > 90.0, "{hits} of 120");
    let ramps = self::simulation("ramps");
    for (step, length) in [
        (1, 1.0),
        (5000, 1.0),
        (7500, 1.0 + 0.275 * 2.4995 / 5.0),
        (10_001, 1.275),
        (30_001, 1.8),
        (35_000, 1.8),
    ] {
        assert!((ramps.theta(step)[0] - length).abs() < 1e-12, "{step}: {:?}", ramps.theta(step));
    }
    // one plant a step of the ramps, one a hold
    assert_eq!(ramps.truth.phases.len(), 3 * 5000 + 4);
    for (from, plant) in ramps.truth.phases.iter().step_by(997) {
        let length = ramps.theta(*from)[0];
        assert!((plant.A[(3, 0)] - 0.15 / length).abs() < 1e-15, "step {from}");
    }
}

/// A ramp of more plants than fit in memory is refused before any is made.
#[test]
fn a_ramp_of_too_many_plants_is_refused() {
    let file = format!("{}/examples/pendulum_ramps.toml", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(file).unwrap();
    let long = text.replace("duration = 35", "duration = 1e6").replace("[30, 1.8  ]", "[1e5, 1.8]");
    let long = long.replace(", [35, 1.8  ]", "");
    let error = Scenario::parse("long.toml", &long).unwrap().simulation(&[]).unwrap_err();
    assert!(error.to_string().contains("phases needs"), "{error}");
}
