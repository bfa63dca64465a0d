"""Evaluation of many bags on an existing Ray cluster.

Ray hands over the paths of bags and gets the statistics of each in return; no message of a bag passes through Python.
Every task runs ``tpf eval --partial`` on a few bags, and ``tpf merge`` puts the statistics together. The result has the
same bytes as ``tpf eval`` of all bags by one process. ``ray`` is imported only when :func:`evaluate` is called::

    from tactile_pose_fusion import ray as tpf_ray
    scores = tpf_ray.evaluate(bags, "glove.yaml", model="model.onnx")
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

__all__ = ["PartialFailed", "evaluate"]

#: ``tpf`` exits with it when it is done and some input was lost: a bag that can't be scored is in the partial.
_INPUT_LOST = 3


class PartialFailed(RuntimeError):
    """Bags could not be scored at all: the model or a parameter is wrong, or a worker was lost too often."""


def evaluate(
    uris: Sequence[str | os.PathLike[str]],
    params_file: str | os.PathLike[str],
    *,
    model: str | os.PathLike[str] | None = None,
    options: Sequence[str] = (),
    bags_per_task: int = 1,
    max_in_flight: int | None = None,
    max_retries: int = 3,
    cpus_per_task: float = 1,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Scores bags on the Ray cluster that this process is connected to; starts a local one if it is to none.

    Args:
        uris: bags, one recording each, under paths that all machines of the cluster have; with a ``tpf`` that reads
            them, URIs of a store. The result has their order.
        params_file: the ROS 2 parameter file. Its content goes with each task.
        model: ONNX file to score, under a path that all machines have; without it as ``tpf eval``.
        options: more options of ``tpf eval``, such as ``["--whole", "--touch", "force"]``.
        bags_per_task: bags that a task scores one after the other.
        max_in_flight: tasks that are submitted and not done, at most; twice the CPUs of the cluster unless set.
        max_retries: how often a task is begun again whose worker or machine was lost, or had too little memory.
        cpus_per_task: CPUs that a task takes, and threads (rounded down, at least 1).
        progress: called with the bags that are done, and all of them.

    Returns:
        What ``tpf eval --json`` prints. Bags that can't be scored are in ``failed`` with the reason.

    Raises:
        ValueError: no bag, or a number below 1.
        PartialFailed: a task failed for another reason than its bags, or no bag could be scored.
    """
    bags = [os.fspath(uri) for uri in uris]
    if not bags:
        raise ValueError("no bags; expected at least one")
    if bags_per_task < 1 or (max_in_flight is not None and max_in_flight < 1):
        raise ValueError("bags_per_task and max_in_flight are at least 1")
    # Only here: the package works without it.
    import ray as engine  # type: ignore[import-not-found,import-untyped,unused-ignore]

    ray: Any = engine

    if not ray.is_initialized():
        ray.init()
    words = list(options)
    if model is not None:
        words += ["--model", os.fspath(model)]
    params = (Path(params_file).name, os.path.abspath(params_file), Path(params_file).read_bytes())
    jobs = max(1, int(cpus_per_task))
    task = ray.remote(num_cpus=cpus_per_task, max_retries=max_retries, retry_exceptions=False)(_partial)
    limit = max_in_flight or max(2, 2 * int(ray.cluster_resources().get("CPU", 1) / max(cpus_per_task, 0.1)))
    chunks = [bags[at : at + bags_per_task] for at in range(0, len(bags), bags_per_task)]
    with tempfile.TemporaryDirectory(prefix="tpf-partials-") as folder:
        waiting = list(enumerate(chunks))[::-1]
        running: dict[Any, int] = {}
        n_done = 0
        try:
            while waiting or running:
                while waiting and len(running) < limit:
                    idx, chunk = waiting.pop()
                    running[task.remote(chunk, params, words, jobs)] = idx
                done, _ = ray.wait(list(running), num_returns=1)
                for reference in done:
                    idx = running.pop(reference)
                    try:
                        partial = ray.get(reference)
                    except ray.exceptions.RayError as error:
                        reason = str(getattr(error, "cause", None) or error).strip().splitlines()
                        raise PartialFailed(f"{chunks[idx][0]}: {reason[-1] if reason else error!r}") from error
                    Path(folder, f"{idx:08}.parquet").write_bytes(partial)
                    n_done += len(chunks[idx])
                    if progress is not None:
                        progress(n_done, len(bags))
        finally:
            for reference in running:
                ray.cancel(reference, force=True)
        return _merge(folder, bags)


def _tpf(*args: str) -> subprocess.CompletedProcess[str]:
    """Runs the ``tpf`` of this package in a process of its own."""
    words = [sys.executable, "-m", "tactile_pose_fusion", *args]
    return subprocess.run(words, capture_output=True, text=True, check=False)


def _line(run: subprocess.CompletedProcess[str]) -> str:
    lines = run.stderr.strip().splitlines()
    return lines[-1] if lines else f"tpf ended with {run.returncode}"


def _partial(bags: list[str], params: tuple[str, str, bytes], words: list[str], jobs: int) -> bytes:
    """What ``tpf eval --partial`` writes for some bags: runs on a worker."""
    name, path, content = params
    with tempfile.TemporaryDirectory(prefix="tpf-partial-") as folder:
        # Paths in the file are relative to it. Where a machine has the file itself, that one is taken.
        own = Path(path)
        if not own.is_file() or own.read_bytes() != content:
            own = Path(folder, name)
            own.write_bytes(content)
        out = Path(folder, "out.parquet")
        run = _tpf("eval", *bags, "--params-file", str(own), "--partial", str(out), "--jobs", str(jobs), *words)
        if run.returncode not in (0, _INPUT_LOST) or not out.is_file():
            raise PartialFailed(_line(run))
        return out.read_bytes()


def _merge(folder: str, bags: list[str]) -> dict[str, Any]:
    expected = Path(folder, "bags.txt")
    expected.write_text("".join(f"{bag}\n" for bag in bags), encoding="utf-8")
    run = _tpf("merge", folder, "--expect", str(expected), "--json")
    if run.returncode not in (0, _INPUT_LOST):
        raise PartialFailed(_line(run))
    result: dict[str, Any] = json.loads(run.stdout)
    return result
