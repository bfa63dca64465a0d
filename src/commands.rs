//! One file a subcommand of `tpf`: parse, call, render.
