//! README of a LeRobot dataset.

/// Text of the dataset's README, which the Hub shows, too.
pub(super) fn card(fps: u32, task: &str, is_synthetic: bool) -> String {
    let synthetic = if is_synthetic {
        "**The data is synthetic**: a physical model of a glove on a hand, not a recording.\n\n"
    } else {
        ""
    };
    let tags = if is_synthetic { "[LeRobot, tactile, synthetic]" } else { "[LeRobot, tactile]" };
    format!(
        "---
tags: {tags}
task_categories: [robotics]
configs:
- config_name: default
  data_files: data/*/*.parquet
---

# {task}

{synthetic}A LeRobotDataset v3 with {fps} frames a second, written by `tpf export` of tactile_pose_fusion {version}.
Each frame holds the newest of everything at its time, and nothing from after it. REGION is a patch of the hand.

| feature | unit | |
|---|---|---|
| `observation.force.REGION` | N | normal force, corrected for the pose of the hand |
| `observation.contact.REGION` | | 1 touching, 0 not |
| `observation.artifact.REGION` | N | what the correction removed; NaN where there was none, as in flag STALE_POSE |
| `observation.tactile.REGION` | as sent | `[samples, taxels]`: raw readings at their own rate up to the frame, the newest last |
| `observation.state` | rad | joint angles, named in `meta/info.json` |
| `valid.REGION` | | whether there is an estimate |
| `flags.REGION` | | bits of `ContactState.msg`; -1 where there is no estimate of any kind |
| `stamp_ns` | ns | exact time of the frame |
| `stamp_ns.REGION`, `tactile_stamp_ns.REGION` | ns | exact stamps of the estimate and of the newest sample; -1 where there is none |

What is missing is NaN, never zero and never the last value: choose frames by `valid.REGION` where a policy can't take
NaN. Statistics are of the values that are there.
",
        version = env!("CARGO_PKG_VERSION")
    )
}
