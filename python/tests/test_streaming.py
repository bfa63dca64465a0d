"""Samples that are given to a core become the estimates of their replay."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap_ros2.reader import read_ros2_messages

import tactile_pose_fusion as tpf

pytestmark = pytest.mark.filterwarnings("ignore::tactile_pose_fusion.TactilePoseFusionWarning")


class Recorded:
    """What a bag holds, read by another reader."""

    def __init__(self, bag: Path) -> None:
        [file] = bag.glob("*.mcap")
        taxel_stamps, taxels, joint_stamps, positions = [], [], [], []
        self.names: list[str] = []
        #: Whether the next sample of the bag is one of joint angles, in the order of the bag.
        self.are_joints: list[bool] = []
        for message in read_ros2_messages(str(file), topics=["/glove/taxels", "/hand/joint_states"]):
            ros = message.ros_msg
            stamp = ros.header.stamp.sec * 1_000_000_000 + ros.header.stamp.nanosec
            self.are_joints.append(message.channel.topic == "/hand/joint_states")
            if self.are_joints[-1]:
                self.names = self.names or list(ros.name)
                assert list(ros.name) == self.names
                joint_stamps.append(stamp)
                positions.append(list(ros.position))
            else:
                assert ros.rows == 1
                taxel_stamps.append(stamp)
                taxels.append(np.asarray(ros.values, dtype=np.float32))
        self.taxel_stamps, self.taxels = np.array(taxel_stamps), np.array(taxels)
        self.joint_stamps, self.positions = np.array(joint_stamps), np.array(positions)


@pytest.fixture(scope="module")
def recorded(bag: Path) -> Recorded:
    return Recorded(bag)


@pytest.fixture(scope="module")
def calibration(bag: Path, params: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("calibration") / "glove3.yaml"
    tpf.calibrate(bag, path, params)
    return path


@pytest.fixture(scope="module")
def expected(bag: Path, params: Path, calibration: Path) -> tpf.RegionEstimates:
    return tpf.replay(bag, params, calibration=calibration)["index"]


NAMES = (
    "stamp_ns force_n tangential_x_n tangential_y_n tangential_z_n base_n artifact_n touch contact contact_raw event since_ns "
    "pose_age_ms adaptation artifact_change flags"
).split()


def same(parts: list[tpf.Estimates], expected: tpf.RegionEstimates) -> None:
    for name in NAMES:
        got = np.concatenate([getattr(part["index"], name) for part in parts])
        want: Any = getattr(expected, name)
        assert len(got) == len(want) > 10_000, name
        assert np.array_equal(got, want, equal_nan=got.dtype.kind == "f"), name


def test_samples_in_the_order_of_the_bag_become_the_estimates_of_its_replay(
    recorded: Recorded, params: Path, calibration: Path, expected: tpf.RegionEstimates
) -> None:
    core = tpf.Glove.load(params).core()
    core.load_calibration(calibration)
    parts, taxel_idx, joint_idx = [], 0, 0
    for is_joints in recorded.are_joints:
        if is_joints:
            stamp, angles = int(recorded.joint_stamps[joint_idx]), recorded.positions[joint_idx]
            parts.append(core.joints(stamp, angles, recorded.names))
            joint_idx += 1
        else:
            parts.append(core.taxels(int(recorded.taxel_stamps[taxel_idx]), recorded.taxels[taxel_idx]))
            taxel_idx += 1
    parts.append(core.finish())
    same(parts, expected)


@pytest.mark.parametrize(("n_blocks", "batch"), [(1, 1), (20, 64)])
def test_blocks_become_the_estimates_of_a_replay_that_waits_for_every_joint_angle(
    n_blocks: int, batch: int, recorded: Recorded, bag: Path, params: Path, calibration: Path
) -> None:
    # The tracker is late by more than the 10 ms of the default in one frame of twenty.
    patient = tpf.Parameters(params, set={"timing.joint_slack_ms": 200.0})
    expected = tpf.replay(bag, patient, calibration=calibration)["index"]
    core = tpf.Glove.load(patient).core(batch=batch)
    core.load_calibration(calibration)
    begin = int(min(recorded.taxel_stamps[0], recorded.joint_stamps[0]))
    end = int(max(recorded.taxel_stamps[-1], recorded.joint_stamps[-1])) + 1
    edges = [begin + (end - begin) * block // n_blocks for block in range(n_blocks + 1)]
    parts = []
    for from_ns, to_ns in zip(edges, edges[1:]):
        of_taxels = (recorded.taxel_stamps >= from_ns) & (recorded.taxel_stamps < to_ns)
        of_joints = (recorded.joint_stamps >= from_ns) & (recorded.joint_stamps < to_ns)
        parts.append(
            core.feed(
                recorded.taxel_stamps[of_taxels],
                recorded.taxels[of_taxels],
                recorded.joint_stamps[of_joints],
                recorded.positions[of_joints],
                recorded.names,
            )
        )
    parts.append(core.finish())
    same(parts, expected)


def test_a_baseline_of_ones_own_gives_forces(recorded: Recorded, params: Path) -> None:
    glove = tpf.Glove.load(params)
    assert glove.tactile_sources == {"glove": 6} and glove.joint_sources == ("hand",)
    assert glove.regions == {"index": ("index_dip", "index_pip", "index_mcp_flex", "index_mcp_abd")}
    core = glove.core()
    uncalibrated = core.feed(
        recorded.taxel_stamps[:200], recorded.taxels[:200], recorded.joint_stamps[:200], recorded.positions[:200], recorded.names
    )["index"]
    assert (uncalibrated.flags & tpf.Flags.UNCALIBRATED).all() and np.isnan(uncalibrated.force_n).all()
    core = glove.core()
    core.set_baseline(np.median(recorded.taxels[:200], axis=0))
    index = core.feed(
        recorded.taxel_stamps[:400], recorded.taxels[:400], recorded.joint_stamps[:400], recorded.positions[:400], recorded.names
    )["index"]
    assert np.isfinite(index.force_n[-100:]).all()


def test_wrong_shapes_and_sources_are_refused(params: Path) -> None:
    core = tpf.Glove.load(params).core()
    with pytest.raises(tpf.ParameterError, match=r"taxels: got the shape \[1, 5\], expected \[1, 6\]"):
        core.taxels(0, [0.0] * 5)
    with pytest.raises(tpf.ParameterError, match="joint angles: got the shape"):
        core.joints(0, [0.0, 0.0], ["index_dip"])
    with pytest.raises(tpf.ParameterError, match="there is no tactile source thumb, expected one of: glove"):
        core.taxels(0, [0.0] * 6, source="thumb")
    with pytest.raises(tpf.ParameterError):
        core.set_baseline([0.0] * 5)
