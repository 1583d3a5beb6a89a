//! Studies in parts: the same bytes however they are cut, dealt out, interrupted.
#![cfg(feature = "cli")]

mod command;
mod faults;
mod parts;
mod setup;
