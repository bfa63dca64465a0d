//! What a node answered, held against replay of the same data.

use std::path::Path;

use tactile_pose_fusion::msg::{ContactArray, WrenchStamped};
use tactile_pose_fusion::units::Stamp;

use super::PARAMS;
use crate::common::bags::decoded;
use crate::common::tpf::tpf;

/// Frames that may wait for joint angles when the data ends.
const WAITING: usize = 10;

/// Writes what replay makes of a bag of the test's own.
pub fn replay(folder: &Path, bag: &str, out: &str) {
    let args = ["--params-file", PARAMS, "--calibration", "calibration.yaml", "--batch", "1", "--backend", "rten"];
    tpf(folder, &[&["replay", bag, "-o", out], &args[..]].concat()).ok();
}

/// Holds what was received against the bag that replay wrote. The last frames, which replay settles because its input
/// ends, are still waiting for joint angles in the node.
pub fn assert_equals_replay(received: &serde_json::Value, bag: &Path) {
    let wrenches: Vec<WrenchStamped> = decoded(bag, "/tactile_pose_fusion/index/wrench");
    let got = received["wrenches"].as_array().unwrap();
    assert!(got.len() + WAITING >= wrenches.len() && got.len() > 400, "{} of {}", got.len(), wrenches.len());
    for (got, expected) in got.iter().zip(&wrenches) {
        assert_eq!(got[0].as_i64(), Some(Stamp::from(expected.header.stamp).0));
        assert_eq!(got[1], expected.header.frame_id.as_str());
        let wrench = &expected.wrench;
        let numbers =
            [wrench.force.x, wrench.force.y, wrench.force.z, wrench.torque.x, wrench.torque.y, wrench.torque.z];
        assert_same(&got[2], &numbers);
    }
    let contacts: Vec<ContactArray> = decoded(bag, "/tactile_pose_fusion/contacts");
    let stale = 8;
    let live = received["contacts"].as_array().unwrap().iter().filter(|array| array[1][4] != stale);
    let live: Vec<_> = live.collect();
    assert!(live.len() + WAITING >= contacts.len(), "{} of {}", live.len(), contacts.len());
    for (got, expected) in live.iter().zip(&contacts) {
        let state = &expected.contacts[0];
        assert_eq!(got[0].as_i64(), Some(Stamp::from(expected.header.stamp).0));
        assert_eq!(got[1][0], state.region.as_str());
        assert_eq!((got[1][1].as_bool(), got[1][2].as_bool()), (Some(state.contact_raw), Some(state.contact)));
        assert_eq!(got[1][3], state.event);
        assert_eq!(got[1][4], state.flags);
        assert_same(&got[1][5], &[state.force, state.force_base, state.pose_age]);
    }
}

/// Holds numbers, which the peer wrote as text, against others, to the last bit but for the kind of a NaN.
fn assert_same(got: &serde_json::Value, expected: &[f64]) {
    let got: Vec<f64> = got.as_array().unwrap().iter().map(|text| text.as_str().unwrap().parse().unwrap()).collect();
    let same = |(got, expected): (&f64, &f64)| got == expected || (got.is_nan() && expected.is_nan());
    assert!(got.len() == expected.len() && got.iter().zip(expected).all(same), "{got:?} is not {expected:?}");
}
