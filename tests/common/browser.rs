//! A page as headless Chromium shows it.
#![allow(dead_code, unreachable_pub)]

use std::path::Path;
use std::process::Command;

use serde_json::Value;

use super::root::ROOT;
use super::skip::{python, skipped};

/// Width of a sheet of A4 or Letter without its margins, px.
const PAPER_PX: f64 = 680.0;

/// What a browser shows of a page: wide, as on a phone, dark, and on paper; none where there is no browser.
pub fn look(page: &Path) -> Option<Value> {
    let output = chromium("look_at_page.py")?.arg(page).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let seen: Value = serde_json::from_slice(&output.stdout).unwrap();
    for view in ["wide", "phone", "dark"] {
        let seen = &seen[view];
        assert_eq!(seen["complaints"], Value::Array(Vec::new()), "{view}: the console is silent");
        assert_eq!(seen["requests"], Value::Array(Vec::new()), "{view}: nothing is fetched");
        let width = if view == "phone" { 390.0 } else { 1200.0 };
        assert!(seen["page_width"].as_f64().unwrap() <= width, "{view}: {}", seen["page_width"]);
        assert!(seen["paper_width"].as_f64().unwrap() <= PAPER_PX, "{view}: {}", seen["paper_width"]);
        let is_dark = seen["background"] != "rgb(255, 255, 255)";
        assert_eq!(is_dark, view == "dark", "{view}: {}", seen["background"]);
        for plot in seen["plots"].as_array().unwrap() {
            assert!(plot["traces"].as_u64().unwrap() > 0 && plot["drawn"].as_u64().unwrap() > 0, "{view}: {plot}");
            assert_eq!(plot["traces"], plot["with_points"], "{view}: {plot}");
            assert!(plot["width"].as_f64().unwrap() <= width, "{view}: {plot}");
            assert_eq!(plot["background"], seen["background"], "{view}: a plot has the colours of its page: {plot}");
            assert_eq!(plot["toolbar_on_legend"], false, "{view}: {plot}");
        }
    }
    Some(seen)
}

/// A script of tests/python that drives Chromium. Where there is no browser the test is skipped, or fails when
/// `TPF_REQUIRE_BROWSER` is set.
pub fn chromium(script: &str) -> Option<Command> {
    let python = python()?;
    let chromium = std::env::var("CHROMIUM").unwrap_or_else(|_| "/usr/bin/chromium".to_owned());
    if !Path::new(&chromium).exists() {
        let missing = format!("{chromium} is not here; install Debian's chromium, or set CHROMIUM");
        assert!(std::env::var_os("TPF_REQUIRE_BROWSER").is_none(), "{missing}");
        skipped(&missing);
        return None;
    }
    let mut command = Command::new(python);
    command.arg(Path::new(ROOT).join("tests/python").join(script));
    Some(command)
}
