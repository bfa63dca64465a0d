//! `tpf`: pose-aware tactile force from bags and, as a ROS 2 node, live.

use std::process::ExitCode;

fn main() -> ExitCode {
    tactile_pose_fusion_commands::main()
}
