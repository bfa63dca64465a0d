//! Writes the results as lines for the parameter file.

use std::fmt::Write as _;

use super::RegionResult;
use crate::characterize::OWN_LAG_MS;
use crate::config::Config;

/// The lines, below `ros__parameters`. `sources`: index of the source of each joint in the reports.
pub(super) fn parameters(regions: &[RegionResult], cfg: &Config, sources: &[usize], synthetic: bool) -> String {
    let mut text = String::from("# Suggested by tpf characterize");
    text.push_str(if synthetic { ", from SYNTHETIC data\n" } else { "\n" });
    text.push_str("region:\n");
    for RegionResult { region, report, .. } in regions {
        let joints: Vec<&str> = report.selection.chosen.iter().map(|step| step.joint.as_str()).collect();
        let _ = writeln!(text, "  {region}:");
        if joints.is_empty() {
            let _ = writeln!(text, "    # No joint tells enough of what its taxels read in the air.");
        } else {
            let _ = writeln!(
                text,
                "    # For models that are trained from now on; one that is trained already needs its own joints."
            );
            let _ = writeln!(text, "    joints: [{}]", joints.join(", "));
        }
        for range in &report.pose_range {
            let [low, high] = report.pose_range_quantiles.map(|share| 100.0 * share);
            let _ = writeln!(
                text,
                "    # {}: {:.2} to {:.2} rad ({low} to {high} % of all frames); a trained model keeps it as tpf.pose_range",
                range.joint, range.min, range.max
            );
        }
    }
    offsets(&mut text, regions, cfg, sources);
    text
}

/// Clock offset of the joint source of each region's first joint.
fn offsets(text: &mut String, regions: &[RegionResult], cfg: &Config, sources: &[usize]) {
    let mut told = Vec::new();
    for RegionResult { region, report, .. } in regions {
        let source_idx = report.selection.chosen.first().and_then(|step| sources.get(step.joint_idx)).copied();
        let Some(source) = source_idx.and_then(|idx| cfg.fusion().joint_sources().get(idx)) else { continue };
        if told.contains(&source.name.as_str()) {
            continue;
        }
        told.push(&source.name);
        if told.len() == 1 {
            text.push_str("joint:\n");
        }
        let now_ms = source.stamp_offset_ns as f64 * 1e-6;
        let _ = writeln!(text, "  {}:", source.name);
        let _ = match (report.offset.lag_ms, report.offset.interval_ms, report.offset.clock_offset_ms) {
            (Some(lag), Some([low, high]), Some([clock_low, clock_high])) => {
                let lag = lag.median;
                // A lag that the sensor's own filter, creep and friction can cause is no reason to change a clock
                // offset.
                if clock_low <= 0.0 && clock_high >= 0.0 || lag.abs() < OWN_LAG_MS[1] {
                    writeln!(
                        text,
                        "    stamp_offset_ms: {now_ms:?} # unchanged: taxels lag by {lag:.0} ms ({low:.0} to {high:.0}), which their own filter can make"
                    )
                } else {
                    writeln!(
                        text,
                        "    stamp_offset_ms: {:.1} # taxels of {region} lag by {lag:.0} ms ({low:.0} to {high:.0}), their own lag of some 10 ms included",
                        now_ms + lag,
                    )
                }
            }
            _ => writeln!(text, "    stamp_offset_ms: {now_ms:?} # unchanged: nothing tells how far its clock is off"),
        };
    }
}
