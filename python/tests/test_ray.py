"""Evaluation on Ray: the result is that of one process. Runs where Ray is installed, inside `tests/ros/isolated` alone."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import run_tpf

import tactile_pose_fusion as tpf
from tactile_pose_fusion import ray as tpf_ray

ray = pytest.importorskip("ray")

pytestmark = pytest.mark.skipif(os.environ.get("TPF_ISOLATED") != "1", reason="not inside tests/ros/isolated")

MINUTES = 1.7


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Three sessions, and a bag that is damaged."""
    folder = tmp_path_factory.mktemp("many")
    names = [f"glove3_user0{user}_session1" for user in (1, 2, 3)]
    for user, name in enumerate(names, start=1):
        tpf.simulate(folder / name, glove=3, seed=user, session=1, minutes=MINUTES)
    broken = folder / "broken.mcap"
    broken.write_bytes(b"no bag at all, by far")
    return [str(folder / name) for name in names] + [str(broken)]


@pytest.fixture(scope="module", autouse=True)
def cluster() -> Iterator[None]:
    ray.init(num_cpus=2, include_dashboard=False, _node_ip_address="127.0.0.1", log_to_driver=False)
    yield
    ray.shutdown()


def test_tasks_of_any_size_give_what_one_process_gives(bags: list[str], params: Path) -> None:
    one = run_tpf("eval", *bags, "--params-file", params, "--whole", "--json")
    assert one.returncode == 3, one
    for bags_per_task in (1, 3):
        seen: list[tuple[int, int]] = []
        scores = tpf_ray.evaluate(
            bags,
            params,
            options=["--whole"],
            bags_per_task=bags_per_task,
            max_in_flight=2,
            progress=lambda done, total, seen=seen: seen.append((done, total)),  # type: ignore[misc]
        )
        assert scores == json.loads(one.stdout)
        assert seen[-1] == (len(bags), len(bags)) and len(seen) == -(-len(bags) // bags_per_task)
        assert [failed["bag"] for failed in scores["failed"]] == bags[-1:]


def test_what_is_no_bags_fault_is_said_in_one_line(bags: list[str], params: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no bags"):
        tpf_ray.evaluate([], params)
    with pytest.raises(tpf_ray.PartialFailed, match="absent.onnx") as failed:
        tpf_ray.evaluate(bags[:1], params, model=tmp_path / "absent.onnx", options=["--whole"])
    assert "\n" not in str(failed.value)
    with pytest.raises(tpf_ray.PartialFailed, match="broken.mcap"):
        tpf_ray.evaluate(bags[-1:], params)
