//! The live node under the name that `ros2 run` users expect: `tpf run`.

use std::process::ExitCode;

use tactile_pose_fusion_commands::node_main;

fn main() -> ExitCode {
    node_main()
}
