//! Whatever bytes, texts or samples come: no panic, no hang, no memory that they don't hold, and what is refused is
//! refused in one line.
//!
//! Every target is one function of bytes. `cargo test` runs each for a thousand inputs or more, the same ones every time;
//! `just fuzz [MINUTES]` runs them for longer, with other inputs every time.

#![allow(clippy::duplicate_mod)] // both folders of what tests share tell how to skip

#[path = "../common/mod.rs"]
mod common;
#[path = "../msg_common/mod.rs"]
mod msg_common;

mod bag;
mod calibration;
mod cdr;
mod core;
mod definition;
mod driver;
mod hand;
mod idl;
mod metadata;
mod model;
mod mutate;
mod params;
#[cfg(feature = "ros")]
mod rtps;
mod sqlite;

use driver::Answer;

#[test]
fn bag() {
    driver::run(&bag::TARGET, 1500);
}

#[test]
fn sqlite() {
    driver::run(&sqlite::TARGET, 1000);
}

#[test]
fn idl() {
    driver::run(&idl::TARGET, 4000);
}

#[test]
fn hand() {
    driver::run(&hand::TARGET, 4000);
}

#[test]
fn metadata() {
    driver::run(&metadata::TARGET, 2000);
}

#[test]
fn cdr() {
    driver::run(&cdr::TARGET, 8000);
}

#[test]
fn definition() {
    driver::run(&definition::TARGET, 4000);
}

#[test]
fn params() {
    driver::run(&params::TARGET, 1500);
}

#[test]
fn calibration() {
    driver::run(&calibration::TARGET, 4000);
}

#[test]
fn model() {
    driver::run(&model::TARGET, 500);
}

#[test]
fn model_second_half() {
    driver::run_part(&model::TARGET, 500, 1);
}

#[test]
fn core() {
    driver::run(&core::TARGET, 4000);
}

#[cfg(feature = "ros")]
#[test]
fn rtps() {
    driver::run(&rtps::TARGET, 8000);
}

/// An error as a person must see it.
fn one_line(error: &dyn std::fmt::Display) -> Answer {
    let text = error.to_string();
    assert!(!text.is_empty() && !text.chars().any(char::is_control), "not one clear line: {text:?}");
    assert!(text.len() < 4096, "{} bytes of error: {text}", text.len());
    Answer::refused(&text)
}
