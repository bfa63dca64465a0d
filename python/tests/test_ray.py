"""Many bags on Ray: the result is that of one process. Runs where Ray is installed, inside `tests/ros/isolated` alone."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import ROOT, run_tpf, tpf_out

import tactile_pose_fusion as tpf
from tactile_pose_fusion import _ray_tasks, many
from tactile_pose_fusion import ray as tpf_ray

ray = pytest.importorskip("ray")

pytestmark = pytest.mark.skipif(os.environ.get("TPF_ISOLATED") != "1", reason="not inside tests/ros/isolated")

MINUTES = 1.7

#: The cheapest model: what is tested is how work is shared out.
MODEL = ROOT / "models/glove3_tactile_only.onnx"


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
    os.environ["RAY_worker_niceness"] = "0"  # beside other work on this machine they would hardly run
    ray.init(address="local", num_cpus=2, include_dashboard=False, _node_ip_address="127.0.0.1", log_to_driver=False)
    yield
    ray.shutdown()


def test_tasks_of_any_size_give_what_one_process_gives(bags: list[str], params: Path) -> None:
    one = run_tpf("eval", *bags, "--params-file", params, "--model", MODEL, "--whole", "--json")
    assert one.returncode == 3, one
    for bags_per_task in (1, 3):
        seen: list[tuple[int, int]] = []
        scores = tpf_ray.evaluate(
            bags,
            params,
            model=MODEL,
            options=["--whole"],
            bags_per_task=bags_per_task,
            max_in_flight=2,
            progress=lambda done, total, seen=seen: seen.append((done, total)),  # type: ignore[misc]
        )
        assert scores == json.loads(one.stdout)
        assert seen[-1] == (len(bags), len(bags)) and len(seen) == -(-len(bags) // bags_per_task)
        assert [failed["bag"] for failed in scores["failed"]] == bags[-1:]


def test_bags_are_replayed_and_exported_as_by_one_process(bags: list[str], params: Path, tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    found = tpf_ray.replay(
        bags, tmp_path / "many", params, model=MODEL, bags_per_task=2, progress=lambda done, total: seen.append((done, total))
    )
    assert seen[-1] == (len(bags), len(bags))
    assert [one["bag"] for one in found] == bags and ["error" in one for one in found] == [False] * 3 + [True]
    assert run_tpf("replay", *bags, "--each", "--params-file", params, "--model", MODEL, "-o", tmp_path / "one").returncode == 3
    assert _contents(tmp_path / "many") == _contents(tmp_path / "one")
    again = tpf_ray.replay(bags[:3], tmp_path / "many", params, model=MODEL, resume=True)
    assert all(one["kept"] for one in again)
    there = tpf_ray.replay(bags[:1], tmp_path / "many", params, model=MODEL)
    assert "is there already" in there[0]["error"]

    joined = tpf_ray.export(bags, tmp_path / "joined", params, model=MODEL, n_shards=3, options=["--fps", "20"])
    whole = run_tpf("export", *bags, "--params-file", params, "--model", MODEL, "--lerobot", tmp_path / "whole", "--fps", "20")
    assert whole.returncode == 3, whole
    assert _contents(tmp_path / "joined") == _contents(tmp_path / "whole")
    assert joined["bags"] == bags[:3] and [one["bag"] for one in joined["failed"]] == bags[3:]
    assert not list(tmp_path.glob(".joined-shards-*"))
    with pytest.raises(FileExistsError, match="is never replaced"):
        tpf_ray.export(bags, tmp_path / "joined", params)


def test_a_bag_that_ends_every_worker_is_named_and_the_others_are_scored(bags: list[str], params: Path, tmp_path: Path) -> None:
    # Its place in the list of a task decides nothing: after a loss bags are tried one by one.
    large = tmp_path / "large"
    tpf.simulate(large, glove=3, seed=9, session=1)
    limits: dict[str, int] = {}
    for megabytes in (32, 48, 64, 96, 128, 192, 256, 384, 512):
        try:
            many.partial(bags[:1], params, model=MODEL, options=["--whole"], memory_limit=megabytes * 1_000_000)
        except many.ProcessDied:
            continue
        limits["memory_per_task"] = megabytes * 1_000_000
        break
    some = [bags[0], str(large), *bags[1:]]
    scores = tpf_ray.evaluate(some, params, model=MODEL, options=["--whole"], bags_per_task=3, max_retries=1, **limits)  # type: ignore[arg-type]
    [named] = [one for one in scores["failed"] if one["bag"] == str(large)]
    assert "lost 2 times, the last time: out of memory with the" in named["error"] and "\n" not in named["error"]
    scores["failed"].remove(named)
    one = run_tpf("eval", *bags, "--params-file", params, "--model", MODEL, "--whole", "--json")
    assert scores == json.loads(one.stdout)


def test_no_wait_is_without_end(bags: list[str], params: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(tpf_ray.TaskFailed, match=r"lost 2 times, the last time: tpf was not done after 0\.01 s, and was ended$"):
        tpf_ray.evaluate(bags[:1], params, model=MODEL, options=["--whole"], max_retries=1, timeout_s=0.01)
    monkeypatch.setattr(_ray_tasks, "_LOOK_EVERY_S", 0.2)
    monkeypatch.setattr(_ray_tasks, "_MACHINE_WITHIN_S", 1.0)
    with pytest.warns(tpf.TactilePoseFusionWarning, match="waiting 1 s for one"):
        with pytest.raises(tpf_ray.TaskFailed, match=r"no machine of the Ray cluster has the 99 CPUs and 1 MB .*: 2 CPUs .*none came"):
            tpf_ray.evaluate(bags, params, model=MODEL, cpus_per_task=99, memory_per_task=1_000_000)

    def hang(chunk: list[str], attempt: int) -> None:
        time.sleep(3600)

    monkeypatch.setattr(_ray_tasks, "_RAY_TAKES_S", 2.0)
    tasks = _ray_tasks.Tasks(1, 2, 1, 1, None, timeout_s=0.5)
    taken: list[object] = []
    with pytest.raises(tpf_ray.TaskFailed, match=r"^no task ended within 2 s, 2 times in a row: the workers of the Ray cluster hang"):
        _ray_tasks.drive("hang", hang, _ray_tasks.batches(bags, 1), tasks, lambda _, result: taken.append(result), False)
    assert not taken
    # The cluster is as before.
    scores = tpf_ray.evaluate(bags[:1], params, model=MODEL, options=["--whole"])
    assert scores == json.loads(tpf_out("eval", bags[0], "--params-file", params, "--model", MODEL, "--whole", "--json"))


def test_partials_are_kept_where_they_are_asked_for(bags: list[str], params: Path, tmp_path: Path) -> None:
    kept = tmp_path / "partials"
    tpf_ray.evaluate(bags, params, model=MODEL, options=["--whole"], partials=kept)
    assert len(list(kept.glob("*.parquet"))) == len(bags)
    with pytest.raises(FileExistsError):
        tpf_ray.evaluate(bags, params, model=MODEL, options=["--whole"], partials=kept)


def test_what_is_no_bags_fault_is_said_in_one_line(bags: list[str], params: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no bags"):
        tpf_ray.evaluate([], params)
    with pytest.raises(tpf_ray.TaskFailed, match="absent.onnx") as failed:
        tpf_ray.evaluate(bags[:1], params, model=tmp_path / "absent.onnx", options=["--whole"])
    assert "\n" not in str(failed.value)
    with pytest.raises(tpf_ray.TaskFailed, match="broken.mcap"):
        tpf_ray.evaluate(bags[-1:], params, model=MODEL)
    for wrong, told in [
        ({"bags_per_task": 0}, "bags_per_task is at least 1, got 0"),
        ({"max_in_flight": 0}, "max_in_flight is at least 1, got 0"),
        ({"max_retries": -1}, "max_retries and cpus_per_task are at least 0"),
        ({"memory_per_task": 0}, "memory_per_task is at least 1, got 0"),
        ({"timeout_s": 0}, "timeout_s is above 0 and below 1e9, got 0"),
    ]:
        with pytest.raises(ValueError, match=told):
            tpf_ray.evaluate(bags, params, **wrong)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="is given twice"):
        tpf_ray.evaluate([bags[0], bags[0]], params)
    with pytest.raises(ValueError, match="would both become glove3_user01_session1.mcap"):
        tpf_ray.replay([bags[0], str(tmp_path / "glove3_user01_session1.mcap")], tmp_path / "x", params)
    with pytest.raises(tpf_ray.TaskFailed, match="shard 0/2|absent.onnx"):
        tpf_ray.export(bags, tmp_path / "x", params, model=tmp_path / "absent.onnx", n_shards=2)
    assert not (tmp_path / "x").exists()


def _contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
