"""Many bags, shared out by an engine that you have: Dask, Spark, a queue of your own. `tactile_pose_fusion.ray` is built
on it.

Each function here is the work of one task. It runs `tpf` in a process of its own, which ends with the task. No message of a
bag passes through Python: a task is given paths and gives statistics, names or summaries. `merge` and `join` put together
what tasks did; the result has the same bytes as that of one process over all bags::

    from tactile_pose_fusion import many

    partials = [many.partial([bag], "glove.yaml") for bag in bags]  # on as many machines as you like
    scores = many.merge(partials, bags)
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Union

from . import _core

__all__ = ["ParamsFile", "ProcessDied", "TaskFailed", "export_shard", "join", "merge", "partial", "replay"]

#: `tpf` exits with it when it is done and some input was lost: a bag that can't be used is named in the result.
_INPUT_LOST = 3

#: Other exit codes that `tpf` chooses by itself: an error, and a wrong command line.
_REFUSED = (1, 2)

#: What a line says where memory is too little, for a thread too: who is given a limit fails at whatever comes first.
_NO_MEMORY = (
    "memory allocation of",
    "MemoryError",
    "out of memory",
    "Cannot allocate memory",
    "Resource temporarily unavailable",
    "failed to spawn thread",
)

AnyPath = Union[str, "os.PathLike[str]"]


class TaskFailed(RuntimeError):
    """Work could not be done for another reason than its bags: the model or a parameter is wrong, an output is refused."""


class ProcessDied(RuntimeError):
    """The process of a task was ended: too little memory or time, or somebody killed it. Another attempt may succeed."""


@dataclass(frozen=True)
class ParamsFile:
    """A parameter file that goes with a task to another machine.

    Attributes:
        path: Where it is on the machine that read it, or a URI.
        content: Its bytes; `None` of a URI, which each task reads by itself.
    """

    path: str
    content: bytes | None

    @classmethod
    def read(cls, path: AnyPath) -> ParamsFile:
        """Reads it on this machine, unless it is a URI."""
        place = _core.place(os.fspath(path))
        if _core.is_remote(place):
            return cls(place, None)
        return cls(os.path.abspath(place), Path(place).read_bytes())

    def on_this_machine(self, folder: str) -> str:
        """Its path on the machine of a task: its own, where the same file is there, else a copy in `folder`.

        Paths in a parameter file are relative to it: name models by absolute paths, or have the same files everywhere.
        """
        if self.content is None:
            return self.path
        own = Path(self.path)
        if not own.is_file() or own.read_bytes() != self.content:
            own = Path(folder, own.name)
            own.write_bytes(self.content)
        return str(own)


def partial(
    bags: Sequence[AnyPath],
    params_file: AnyPath | ParamsFile,
    *,
    model: AnyPath | None = None,
    options: Sequence[str] = (),
    jobs: int = 1,
    memory_limit: int | None = None,
    timeout_s: float | None = None,
) -> bytes:
    """Statistics of some bags, as `tpf eval --partial` writes them: the work of one task of an evaluation.

    Args:
        bags: Bags, one recording each.
        params_file: The parameter file.
        model: ONNX file to score; without it as `tpf eval`.
        options: More options of `tpf eval`, such as `["--whole", "--touch", "force"]`.
        jobs: Threads.
        memory_limit: The most memory that `tpf` may have, bytes.
        timeout_s: The most time that `tpf` may take, s.

    Returns:
        A Parquet file. Bags that can't be scored are in it, with the reason.

    Raises:
        TaskFailed: Another reason than the bags.
        ProcessDied: `tpf` was killed, or had too little memory or time.
    """
    with tempfile.TemporaryDirectory(prefix="tpf-partial-") as folder:
        out = Path(folder, "out.parquet")
        words = ["eval", *_words(bags), "--partial", str(out), "--jobs", str(jobs), *options]
        _run([*words, *_common(params_file, model, folder)], memory_limit, timeout_s)
        return out.read_bytes()


def merge(partials: Iterable[bytes | AnyPath], bags: Sequence[AnyPath]) -> dict[str, Any]:
    """Scores of all bags from the partials of some each, as `tpf merge`.

    Args:
        partials: What `partial` returned, or files of it, as paths or URIs, in any order.
        bags: All bags that must be there. The result has their order.

    Returns:
        What `tpf eval --json` prints. If bags can't be scored, they are in `failed`.

    Raises:
        TaskFailed: A bag is missing or twice, or partials were not made alike.
    """
    with tempfile.TemporaryDirectory(prefix="tpf-merge-") as folder:
        files: list[Path] = []
        uris: list[str] = []
        for idx, one in enumerate(partials):
            path = Path(folder, f"{idx:08}.parquet")
            if isinstance(one, bytes):
                path.write_bytes(one)
            elif _core.is_remote(os.fspath(one)):
                uris.append(os.fspath(one))
                continue
            else:
                path.symlink_to(os.path.abspath(_core.place(os.fspath(one))))
            files.append(path)
        if not files and not uris:
            raise ValueError("no partials; expected at least one")
        expected = Path(folder, "bags.txt")
        expected.write_text("".join(f"{bag}\n" for bag in _words(bags)), encoding="utf-8")
        return _object(_run(["merge", *([folder] if files else []), *uris, "--expect", str(expected), "--json"]))


def replay(
    bags: Sequence[AnyPath],
    output: AnyPath,
    params_file: AnyPath | ParamsFile,
    *,
    model: AnyPath | None = None,
    options: Sequence[str] = (),
    overwrite: bool = False,
    resume: bool = False,
    jobs: int = 1,
    memory_limit: int | None = None,
    timeout_s: float | None = None,
) -> list[dict[str, Any]]:
    """Replays each bag to `NAME.mcap` in a folder, as `tpf replay --each`: the work of one task.

    Args:
        bags: Bags, one recording each.
        output: Folder of the outputs.
        params_file: The parameter file.
        model: Model instead of the only one of the parameters.
        options: More options of `tpf replay`, such as `["--merge"]`.
        overwrite: Replace outputs that are already there.
        resume: Keep outputs that are already there and whole.
        jobs: Threads.
        memory_limit: The most memory that `tpf` may have, bytes.
        timeout_s: The most time that `tpf` may take, s.

    Returns:
        For each bag: `bag`, and either `output` with its `summary` or `kept`, or `error`.

    Raises:
        TaskFailed: Another reason than the bags.
        ProcessDied: `tpf` was killed, or had too little memory or time.
    """
    with tempfile.TemporaryDirectory(prefix="tpf-replay-") as folder:
        words = ["replay", *_words(bags), "--each", "-o", os.fspath(output), "--json", "--jobs", str(jobs), *options]
        words += ["--overwrite"] * overwrite + ["--resume"] * resume
        found: list[dict[str, Any]] = json.loads(_run([*words, *_common(params_file, model, folder)], memory_limit, timeout_s))
        return found


def export_shard(
    bags: Sequence[AnyPath],
    output: AnyPath,
    params_file: AnyPath | ParamsFile,
    shard: tuple[int, int],
    *,
    model: AnyPath | None = None,
    options: Sequence[str] = (),
    memory_limit: int | None = None,
    timeout_s: float | None = None,
) -> dict[str, Any]:
    """Writes one shard of a LeRobot dataset, as `tpf export --lerobot --shard`: the work of one task of an export.

    Args:
        bags: All bags or a folder of them, the same for every shard.
        output: Folder of the shard, which must not be there yet.
        params_file: The parameter file.
        shard: `(index, of)`: which one it is, from 0 on, and of how many.
        model: The model that makes estimates.
        options: More options of `tpf export`, such as `["--fps", "20"]`.
        memory_limit: The most memory that `tpf` may have, bytes.
        timeout_s: The most time that `tpf` may take, s.

    Returns:
        What `tpf export --json` prints.

    Raises:
        TaskFailed: Another reason than the bags.
        ProcessDied: `tpf` was killed, or had too little memory or time.
    """
    with tempfile.TemporaryDirectory(prefix="tpf-export-") as folder:
        words = ["export", *_words(bags), "--lerobot", os.fspath(output), "--shard", f"{shard[0]}/{shard[1]}", "--json"]
        return _object(_run([*words, *options, *_common(params_file, model, folder)], memory_limit, timeout_s))


def join(output: AnyPath, shards: Sequence[AnyPath]) -> dict[str, Any]:
    """Joins all shards of a dataset, in any order, as `tpf merge --lerobot`.

    Args:
        output: Folder of the dataset, which must not be there yet.
        shards: What `export_shard` wrote.

    Returns:
        `output`, `bags` and `failed`.

    Raises:
        TaskFailed: A shard is missing, twice, damaged, or of another export.
    """
    return _object(_run(["merge", "--lerobot", os.fspath(output), *_words(shards), "--json"]))


def _words(paths: Sequence[AnyPath]) -> list[str]:
    return [_core.place(os.fspath(path)) for path in paths]


def _common(params_file: AnyPath | ParamsFile, model: AnyPath | None, folder: str) -> list[str]:
    path = params_file.on_this_machine(folder) if isinstance(params_file, ParamsFile) else os.fspath(params_file)
    return ["--params-file", path] + ([] if model is None else ["--model", os.fspath(model)])


def _object(text: str) -> dict[str, Any]:
    result: dict[str, Any] = json.loads(text)
    return result


def _run(words: Sequence[str], memory_limit: int | None = None, timeout_s: float | None = None) -> str:
    """What `tpf` prints, run in a process that ends with this one."""
    command = [sys.executable, "-m", "tactile_pose_fusion._child", str(os.getpid()), str(memory_limit or 0), *words]
    # The threads that NumPy would begin are of no use to `tpf`, and what they reserve counts as its memory.
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    try:
        run = subprocess.run(command, capture_output=True, text=True, check=False, timeout=timeout_s, env=environment)
    except subprocess.TimeoutExpired:
        raise ProcessDied(f"tpf was not done after {timeout_s:g} s, and was ended") from None
    if run.returncode in (0, _INPUT_LOST):
        return run.stdout
    lines = run.stderr.strip().splitlines()
    line = lines[-1] if lines else f"tpf ended with {run.returncode}"
    no_memory = next((line for line in reversed(lines) if any(words in line for words in _NO_MEMORY)), None)
    if no_memory is not None:
        limit = f" with the {memory_limit / 1e6:.0f} MB that it may have" if memory_limit else ""
        raise ProcessDied(f"out of memory{limit}: {no_memory}")
    if run.returncode in _REFUSED:
        raise TaskFailed(line)
    ended = signal.Signals(-run.returncode).name if run.returncode < 0 else f"exit code {run.returncode}"
    raise ProcessDied(f"tpf was ended by {ended}: {line}" if lines else f"tpf was ended by {ended}")
