//! A page as headless Chromium shows it.
#![allow(dead_code, unreachable_pub)]

use std::path::Path;
use std::process::Command;

use serde_json::Value;

use super::skip::{python, skipped};

/// What a browser shows of a page: wide, and as on a phone. Where there is no browser the test is skipped, or fails when
/// `TPF_REQUIRE_BROWSER` is set.
pub fn look(page: &Path) -> Option<Value> {
    let python = python()?;
    let chromium = std::env::var("CHROMIUM").unwrap_or_else(|_| "/usr/bin/chromium".to_owned());
    if !Path::new(&chromium).exists() {
        let missing = format!("{chromium} is not here; install Debian's chromium, or set CHROMIUM");
        assert!(std::env::var_os("TPF_REQUIRE_BROWSER").is_none(), "{missing}");
        skipped(&missing);
        return None;
    }
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/python/look_at_page.py");
    let output = Command::new(python).arg(script).arg(page).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let seen: Value = serde_json::from_slice(&output.stdout).unwrap();
    for size in ["wide", "phone"] {
        let seen = &seen[size];
        assert_eq!(seen["complaints"], Value::Array(Vec::new()), "{size}: the console is silent");
        assert_eq!(seen["requests"], Value::Array(Vec::new()), "{size}: nothing is fetched");
        let width = if size == "wide" { 1200.0 } else { 390.0 };
        assert!(seen["page_width"].as_f64().unwrap() <= width, "{size}: {}", seen["page_width"]);
        for plot in seen["plots"].as_array().unwrap() {
            assert!(plot["traces"].as_u64().unwrap() > 0 && plot["drawn"].as_u64().unwrap() > 0, "{size}: {plot}");
            assert_eq!(plot["traces"], plot["with_points"], "{size}: {plot}");
            assert!(plot["width"].as_f64().unwrap() <= width, "{size}: {plot}");
        }
    }
    Some(seen)
}
