//! Bags and messages: what is read and written, and what others read of it.

#[path = "../common/mod.rs"]
mod common;
#[path = "../msg_common/mod.rs"]
mod msg_common;

mod bag_reader;
mod bag_recorded;
mod bag_sqlite;
mod bag_writer;
mod msg_binding;
mod msg_dynamic;
mod msg_hostile;
mod msg_recorded;
mod msg_type_hash;
mod msg_wire;
mod recording;
