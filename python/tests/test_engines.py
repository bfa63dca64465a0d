"""The examples of the book for Dask and Spark run as they are written, and give what one process gives."""

from __future__ import annotations

import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT, TIMEOUT_S, run_tpf

import tactile_pose_fusion as tpf
from tactile_pose_fusion import many

#: What each engine needs beside it.
ENGINES = {"dask": ["dask", "toolz"], "spark": ["pyspark", "pandas", "pyarrow"]}


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as the book has it: parameters, models, two bags and one that is damaged."""
    top = tmp_path_factory.mktemp("engines")
    (top / "work/bags").mkdir(parents=True)
    shutil.copytree(ROOT / "models", top / "models")
    shutil.copy(ROOT / "params/glove3.yaml", top / "work/glove.yaml")
    for user in (1, 2):
        tpf.simulate(top / f"work/bags/user{user}", glove=3, seed=user, session=1, minutes=1.7)
    (top / "work/bags/broken.mcap").write_bytes(b"no bag at all, by far")
    return top / "work"


@pytest.mark.parametrize("engine", ENGINES)
def test_the_example_of_the_book_gives_what_one_process_gives(engine: str, work: Path) -> None:
    if missing := [name for name in ENGINES[engine] if importlib.util.find_spec(name) is None]:
        pytest.skip(f"{', '.join(missing)} not installed")
    if engine == "spark" and os.environ.get("TPF_ISOLATED") != "1":
        pytest.skip("not inside tests/ros/isolated")
    if engine == "spark" and shutil.which("java") is None:
        pytest.skip("java is not here")
    page = (ROOT / "docs/src/how-to/many-bags.md").read_text()
    [block] = re.findall(rf"^```python {engine}\n(.*?)^```", page, re.S | re.M)
    assert len(block.strip().splitlines()) <= 14
    bags = sorted(f"bags/{path.name}" for path in (work / "bags").iterdir())
    program = f"bags = {bags!r}\n{block}\nimport json\nprint('RESULT', json.dumps(scores))\n"
    # Workers of Spark import functions of a program by its file or by value, not from standard input.
    (work / f"{engine}_program.py").write_text(program)
    run = subprocess.run(
        [sys.executable, f"{engine}_program.py"],
        cwd=work,
        env={**os.environ, "SPARK_LOCAL_IP": "127.0.0.1", "PYSPARK_PYTHON": sys.executable},
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )
    assert run.returncode == 0, run.stderr[-3000:]
    [line] = [line for line in run.stdout.splitlines() if line.startswith("RESULT ")]
    one = subprocess.run(
        [str(Path(sys.executable).parent / "tpf"), "eval", *bags, "--params-file", "glove.yaml", "--whole", "--json"],
        cwd=work,
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )
    assert one.returncode == 3, one
    assert json.loads(line.removeprefix("RESULT ")) == json.loads(one.stdout)


def test_shards_and_replays_of_tasks_are_those_of_one_process(work: Path, tmp_path: Path) -> None:
    bags, params = sorted(str(path) for path in (work / "bags").iterdir()), work / "glove.yaml"
    found = [one for bag in bags for one in many.replay([bag], tmp_path / "forces", params)]
    assert [Path(one["output"]).name if "output" in one else "broken.mcap" in one["error"] for one in found] == [
        True,
        "user1.mcap",
        "user2.mcap",
    ]
    assert [one.get("kept") for one in many.replay(bags[1:], tmp_path / "forces", params, resume=True)] == [True, True]
    assert run_tpf("replay", *bags, "--each", "--params-file", params, "-o", tmp_path / "one").returncode == 3
    assert _contents(tmp_path / "forces") == _contents(tmp_path / "one")
    shards = [tmp_path / f"shard{index}" for index in range(2)]
    for index, shard in enumerate(shards):
        many.export_shard(bags, shard, params, (index, 2))
    joined = many.join(tmp_path / "joined", shards[::-1])
    assert joined["bags"] == bags[1:] and [one["bag"] for one in joined["failed"]] == bags[:1]
    assert run_tpf("export", *bags, "--params-file", params, "--lerobot", tmp_path / "whole").returncode == 3
    assert _contents(tmp_path / "joined") == _contents(tmp_path / "whole")


def test_a_task_that_fails_says_why_in_one_line(work: Path, tmp_path: Path) -> None:
    bag, params = str(work / "bags/user1"), work / "glove.yaml"
    with pytest.raises(many.TaskFailed, match="absent.onnx") as failed:
        many.partial([bag], params, model=tmp_path / "absent.onnx")
    assert "\n" not in str(failed.value)
    with pytest.raises(many.ProcessDied, match="out of memory with the 24 MB that it may have"):
        many.partial([bag], params, options=["--whole"], memory_limit=24_000_000)
    with pytest.raises(many.TaskFailed, match="1 of 2 bags are in no partial"):
        many.merge([many.partial([bag], params, options=["--whole"])], [bag, str(work / "bags/user2")])
    with pytest.raises(ValueError, match="no partials"):
        many.merge([], [bag])


def test_too_little_memory_ends_a_task_whatever_fails_first(work: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # With a little less than is enough, threads can't begin; Rust's backtraces then need memory, too.
    monkeypatch.setenv("RUST_BACKTRACE", "1")
    model, n_died = ROOT / "models/glove3_tactile_only.onnx", 0
    for megabytes in range(40, 1000, 3):
        limits: dict[str, Any] = {"memory_limit": megabytes * 1_000_000, "timeout_s": 120}
        try:
            many.partial([work / "bags/user1"], work / "glove.yaml", model=model, options=["--whole"], **limits)
        except many.ProcessDied as died:
            assert str(died).startswith(f"out of memory with the {megabytes} MB that it may have: ") and "\n" not in str(died)
            n_died += 1
        else:
            break
    assert n_died > 0
    with pytest.raises(many.ProcessDied, match=r"^tpf was not done after 0\.01 s, and was ended$"):
        many.partial([work / "bags/user1"], work / "glove.yaml", timeout_s=0.01)


def test_parameters_go_along_to_a_machine_that_has_other_ones(tmp_path: Path) -> None:
    own = tmp_path / "glove.yaml"
    own.write_text("a: 1\n")
    sent = many.ParamsFile.read(own)
    assert sent.on_this_machine(str(tmp_path / "x")) == str(own)
    own.write_text("a: 2\n")
    (tmp_path / "task").mkdir()
    assert Path(sent.on_this_machine(str(tmp_path / "task"))).read_text() == "a: 1\n"


def _contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
