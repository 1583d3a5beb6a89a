//! Scenario files: every key, every error with its place, hostile input.
#![cfg(feature = "scenario")]

use mmae::model::Family;
use mmae::scenario::{Scenario, Template, template};

#[test]
fn the_pendulum_parses() -> Result<(), Box<dyn std::error::Error>> {
    let scenario = Scenario::parse("pendulum.toml", template(Template::Pendulum))?;
    assert!(scenario.warnings().is_empty(), "{:?}", scenario.warnings());
    let family = scenario.family();
    let plant = family.plant(&family.theta_with(&[("L", 0.9)])?)?;
    assert_eq!(plant.A[(3, 1)], 1.75 * 9.8 / 0.9);
    assert_eq!(plant.B[(3, 0)], -1.0 / 0.9);
    let study = scenario.study()?;
    assert_eq!(study.bank.models, [[1.025], [1.287], [1.526], [1.778]]);
    Ok(())
}

#[test]
fn the_examples_parse() -> Result<(), Box<dyn std::error::Error>> {
    let mut count = 0;
    for entry in std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/examples"))? {
        let path = entry?.path();
        if path.extension().is_some_and(|e| e == "toml") {
            let scenario = Scenario::from_file(&path)?;
            assert_eq!(scenario.warnings(), [], "{}", path.display());
            scenario.study()?;
            count += 1;
        }
    }
    assert!(count >= 6);
    Ok(())
}
