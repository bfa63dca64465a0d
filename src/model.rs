//! The tensor contract, and the two runtimes that keep it.
