//! What the tests of the programs share: what all tests share, and the program `tpf`.
#![allow(dead_code, unreachable_pub, unused_imports)]

#[path = "../common/mod.rs"]
mod all;

pub mod doors;
pub mod scored;
pub mod tpf;
pub mod view;

pub use all::*;
