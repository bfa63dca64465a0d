//! The live node under the name that `ros2 run` users expect.

use std::io::Write;
use std::process::ExitCode;

fn main() -> ExitCode {
    let text = "tactile_pose_fusion_node: the live node is not in this release; run recorded bags with `tpf replay`";
    let _ = writeln!(std::io::stderr(), "{text}");
    ExitCode::from(1)
}
