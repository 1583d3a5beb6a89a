//! `mmae bench` from the outside: the kernels that it promises.
#![cfg(feature = "cli")]

use std::process::{Command, Stdio};

use serde_json::Value;

#[test]
fn a_quick_run_has_every_kernel() {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mmae"));
    let out = command.args(["bench", "--json", "--quick"]).stdin(Stdio::null()).output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let got: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert!(got["fma_gflops"].as_f64().unwrap() > 0.0);
    let kernels = got["kernels"].as_array().unwrap();
    for name in [
        "bank_n3_q1_N4",
        "bank_n4_q2_N16",
        "dare_n8",
        "lyap_n8",
        "simulate_n3_q1_N4",
        "eip_pendulum",
    ] {
        let kernel = kernels.iter().find(|k| k["name"] == name).expect(name);
        assert!(kernel["rate"].as_f64().unwrap() > 0.0, "{name}");
        let share = kernel["share_of_peak"].as_f64().unwrap();
        assert!(share > 0.0 && share < 1.5, "{name}: {share}");
    }
    for latency in got["latency"].as_array().unwrap() {
        assert!(latency["median_us"].as_f64().unwrap() <= latency["p999_us"].as_f64().unwrap());
    }
}
