//! Hashes of the types that the node uses independent of its inputs.

/// Types without a compiled-in definition.
///
/// # Source
/// `type_hashes` in `share/<package>/{msg,srv}/<Name>.json` of ROS 2 Kilted; of our action, the output of
/// `rosidl_generator_type_description` for `action/Calibrate.action`. `tests/live/node_zenoh.rs` compares them.
const HASHES: [(&str, &str); 21] = [
    ("action_msgs/msg/GoalStatusArray", "RIHS01_6c1684b00f177d37438febe6e709fc4e2b0d4248dca4854946f9ed8b30cda83e"),
    ("action_msgs/srv/CancelGoal", "RIHS01_573d8b0a534451d7bc2ac8c5ffde8ac14b8593b7001175d0cd6516dcbeb8689a"),
    ("diagnostic_msgs/msg/DiagnosticArray", "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e"),
    ("lifecycle_msgs/msg/TransitionEvent", "RIHS01_d5f8873a2f0146498f812d7885c7327ce27e463d36811d8792f35ee38c0d6c38"),
    ("lifecycle_msgs/srv/ChangeState", "RIHS01_356fe34f0475a43acf54542013af4167b0e729f77ea22ffb045c6ad8e20668e5"),
    (
        "lifecycle_msgs/srv/GetAvailableStates",
        "RIHS01_00a07d79d2207d71e81a8cbc1880e5d924cc16d4688ea8e8e06e443dc8f8aa1d",
    ),
    (
        "lifecycle_msgs/srv/GetAvailableTransitions",
        "RIHS01_59b7ecefce0982a8a844b9f2c4f14764c1c4543cc55e72924e2aa4adad83e9bc",
    ),
    ("lifecycle_msgs/srv/GetState", "RIHS01_800a0a5aae599782b02932de0caf563f6dc4e7e94b794eadde075ba2cbef9795"),
    ("rcl_interfaces/msg/Log", "RIHS01_e28ce254ca8abc06abf92773b74602cdbf116ed34fbaf294fb9f81da9f318eac"),
    ("rcl_interfaces/msg/ParameterEvent", "RIHS01_043e627780fcad87a22d225bc2a037361dba713fca6a6b9f4b869a5aa0393204"),
    (
        "rcl_interfaces/srv/DescribeParameters",
        "RIHS01_845b484d71eb0673dae682f2e3ba3c4851a65a3dcfb97bddd82c5b57e91e4cff",
    ),
    ("rcl_interfaces/srv/GetParameterTypes", "RIHS01_da199c878688b3e530bdfe3ca8f74cb9fa0c303101e980a9e8f260e25e1c80ca"),
    ("rcl_interfaces/srv/GetParameters", "RIHS01_bf9803d5c74cf989a5de3e0c2e99444599a627c7ff75f97b8c05b01003675cbc"),
    ("rcl_interfaces/srv/ListParameters", "RIHS01_3e6062bfbb27bfb8730d4cef2558221f51a11646d78e7bb30a1e83afac3aad9d"),
    ("rcl_interfaces/srv/SetParameters", "RIHS01_56eed9a67e169f9cb6c1f987bc88f868c14a8fc9f743a263bc734c154015d7e0"),
    (
        "rcl_interfaces/srv/SetParametersAtomically",
        "RIHS01_0e192ef259c07fc3c07a13191d27002222e65e00ccec653ca05e856f79285fcd",
    ),
    ("rosgraph_msgs/msg/Clock", "RIHS01_692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564"),
    ("std_srvs/srv/Trigger", "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f"),
    (
        "tactile_pose_fusion/action/Calibrate_FeedbackMessage",
        "RIHS01_18e88e555d21580a49e8901dfaebcc773724da7dc21275966451529bcefc0ca4",
    ),
    (
        "tactile_pose_fusion/action/Calibrate_GetResult",
        "RIHS01_6a6c33b97806c03f3c6fe298e9b22e79a8de177f0fd4482ebca21493cc126241",
    ),
    (
        "tactile_pose_fusion/action/Calibrate_SendGoal",
        "RIHS01_e2d0f8c5e7d14dd5bfce5c505cb65bb850755d8cfe4ad3e2e6a652011477d689",
    ),
];

/// The hash of a message, service or part of an action that the node uses, by canonical name.
pub(super) fn of(type_name: &str) -> Option<String> {
    let known = HASHES.iter().find(|(name, _)| *name == type_name).map(|(_, hash)| (*hash).to_owned());
    known.or_else(|| crate::msg::rihs01(type_name))
}
