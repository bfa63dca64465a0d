//! Bags and outputs by URI, with a real S3 server behind a proxy that makes faults. They run inside of `tests/ros/isolated` only.

mod azure;
#[path = "../tpf_common/mod.rs"]
mod common;
mod doors;
mod faults;
mod lines;
mod order;
mod proxy;
mod same;
mod server;
mod web;
