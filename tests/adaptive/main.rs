//! Adaptive observers against an oracle and published numbers.

#[allow(dead_code, reason = "every test binary uses a part")]
#[path = "../common/json.rs"]
mod json;

mod batch;
mod checks;
mod example;
mod oracle;
mod reference;
mod vehicle;
