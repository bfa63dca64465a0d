//! Where the repository is.
#![allow(dead_code, unreachable_pub)]

const PACKAGE: &str = env!("CARGO_MANIFEST_DIR");

/// The folder of the repository: of the library's tests that of their package, of the programs' tests two folders up.
pub const ROOT: &str = match option_env!("CARGO_BIN_EXE_tpf") {
    Some(_) => PACKAGE.split_at(PACKAGE.len() - "/crates/commands".len()).0,
    None => PACKAGE,
};
