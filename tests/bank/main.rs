//! The bank engine against published and independently computed numbers.

#[path = "../common/json.rs"]
mod json;

mod arrays;
mod change;
mod discrete;
mod filters;
mod laws;
mod likelihood;
mod oscillator;
mod pipeline;
mod properties;
mod statics;
