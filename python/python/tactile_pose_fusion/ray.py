"""Many bags on an existing Ray cluster: `evaluate`, `replay` and `export`.

Ray hands over the paths of bags and gets statistics, names or summaries in return; no message of a bag passes through
Python. Each task runs ``tpf`` on a few bags, and at the end the parts are put together. The result has the same bytes as
that of one process over all bags. ``ray`` is imported only when one of the functions is called::

    from tactile_pose_fusion import ray as tpf_ray

    scores = tpf_ray.evaluate(bags, "glove.yaml", model="model.onnx")

What is lost with a worker or a machine is done again, up to ``max_retries`` times. A bag that ends every worker is named
with the reason, and the others are done.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from . import _core, many
from ._watch import Progress, Watcher
from .many import AnyPath, ParamsFile, TaskFailed

__all__ = ["TaskFailed", "evaluate", "export", "replay"]


def evaluate(
    uris: Sequence[AnyPath],
    params_file: AnyPath,
    *,
    model: AnyPath | None = None,
    options: Sequence[str] = (),
    partials: AnyPath | None = None,
    bags_per_task: int = 1,
    max_in_flight: int | None = None,
    max_retries: int = 3,
    cpus_per_task: float = 1,
    memory_per_task: int | None = None,
    progress: Progress = True,
) -> dict[str, Any]:
    """Scores bags on the Ray cluster that this process is connected to; starts a local one if it is to none.

    Args:
        uris: Bags, one recording each, under paths that all machines of the cluster have, or URIs. The result has their
            order.
        params_file: The ROS 2 parameter file. Its content goes with each task; of a URI each task reads it.
        model: ONNX file to score, under a path that all machines have; without it as ``tpf eval``.
        options: More options of ``tpf eval``, such as ``["--whole", "--touch", "force"]``.
        partials: A new folder, in which the partials are kept for ``tpf merge --report``; without it they are temporary.
        bags_per_task: Bags that a task scores one after the other. After a loss they are tried one by one.
        max_in_flight: Tasks that are submitted and not done, at most; twice the CPUs of the cluster unless set.
        max_retries: How often a bag is begun again whose worker or machine was lost, or had too little memory.
        cpus_per_task: CPUs that a task takes, and threads (rounded down, at least 1).
        memory_per_task: Memory that Ray reserves for a task, and the most that its ``tpf`` may have, bytes.
        progress: Whether to show a bar, or a function of the bags done and of how many.

    Returns:
        What ``tpf eval --json`` prints. Bags that can't be scored are in ``failed`` with the reason, also those that ended
        every worker.

    Raises:
        ValueError: No bag, a URI as partials, or a number below its least.
        TaskFailed: Another reason than the bags, or no bag could be scored.
    """
    bags = _bags(uris)
    if partials is not None and _core.is_remote(os.fspath(partials)):
        raise ValueError(f"{partials}: the partials are kept on this machine: give a path, and copy them")
    tasks = _Tasks(bags_per_task, max_in_flight, max_retries, cpus_per_task, memory_per_task)
    params = ParamsFile.read(params_file)
    jobs, words = tasks.threads, list(options)

    def score(chunk: list[str], attempt: int) -> bytes:
        return many.partial(chunk, params, model=model, options=words, jobs=jobs, memory_limit=memory_per_task)

    with tempfile.TemporaryDirectory(prefix="tpf-partials-") as temporary:
        folder = Path(temporary)
        if partials is not None:
            folder = Path(_core.place(os.fspath(partials)))
            folder.mkdir(parents=True)  # one that is there may hold other partials

        def keep(batch: _Batch, partial: bytes) -> None:
            (folder / f"{batch.first:08}.parquet").write_bytes(partial)

        lost = _drive("evaluate", score, _batches(bags, bags_per_task), tasks, keep, progress)
        scored = [bag for bag in bags if bag not in lost]
        if not scored:
            raise TaskFailed(_named(lost))
        result = many.merge(sorted(folder.glob("*.parquet")), scored)
    failed = {one["bag"]: one for one in result["failed"]}
    failed |= {bag: {"bag": bag, "error": f"{bag}: {reason}"} for bag, reason in lost.items()}
    result["failed"] = [failed[bag] for bag in bags if bag in failed]
    return result


def replay(
    uris: Sequence[AnyPath],
    output: AnyPath,
    params_file: AnyPath,
    *,
    model: AnyPath | None = None,
    options: Sequence[str] = (),
    overwrite: bool = False,
    resume: bool = False,
    bags_per_task: int = 1,
    max_in_flight: int | None = None,
    max_retries: int = 3,
    cpus_per_task: float = 1,
    memory_per_task: int | None = None,
    progress: Progress = True,
) -> list[dict[str, Any]]:
    """Replays each bag to ``NAME.mcap`` in a folder, as ``tpf replay --each``.

    Args:
        uris: Bags, one recording each, under paths that all machines of the cluster have, or URIs.
        output: Folder of the outputs, which all machines have, or its URI.
        params_file: The ROS 2 parameter file. Its content goes with each task; of a URI each task reads it.
        model: Model instead of the only one of the parameters, under a path that all machines have.
        options: More options of ``tpf replay``, such as ``["--merge"]``.
        overwrite: Replace outputs that are already there.
        resume: Keep outputs that are already there and whole, and replay the other bags.
        bags_per_task: Bags that a task replays one after the other. After a loss they are tried one by one.
        max_in_flight: Tasks that are submitted and not done, at most; twice the CPUs of the cluster unless set.
        max_retries: How often a bag is begun again whose worker or machine was lost, or had too little memory.
        cpus_per_task: CPUs that a task takes, and threads (rounded down, at least 1).
        memory_per_task: Memory that Ray reserves for a task, and the most that its ``tpf`` may have, bytes.
        progress: Whether to show a bar, or a function of the bags done and of how many.

    Returns:
        For each bag, in their order: ``bag``, and either ``output`` with its ``summary`` or ``kept``, or ``error``.

    Raises:
        ValueError: No bag, two bags of the same name, or a number below its least.
        TaskFailed: Another reason than the bags.
    """
    bags = _bags(uris)
    named: dict[str, str] = {}
    for bag in bags:
        other = named.setdefault(Path(bag).stem, bag)
        if other is not bag:
            raise ValueError(f"{other} and {bag} would both become {Path(bag).stem}.mcap; replay them to two folders")
    if overwrite and resume:
        raise ValueError("overwrite and resume exclude each other")
    tasks = _Tasks(bags_per_task, max_in_flight, max_retries, cpus_per_task, memory_per_task)
    params, out, words, jobs = ParamsFile.read(params_file), os.fspath(output), list(options), tasks.threads

    def run(chunk: list[str], attempt: int) -> list[dict[str, Any]]:
        # An attempt that was lost may have written some of its outputs.
        keeps = not overwrite and (resume or attempt > 0)
        limits: dict[str, Any] = {"jobs": jobs, "memory_limit": memory_per_task}
        return many.replay(chunk, out, params, model=model, options=words, overwrite=overwrite, resume=keeps, **limits)

    found: dict[str, dict[str, Any]] = {}

    def keep(batch: _Batch, done: list[dict[str, Any]]) -> None:
        found.update(zip(batch.bags, done, strict=True))

    lost = _drive("replay", run, _batches(bags, bags_per_task), tasks, keep, progress)
    found |= {bag: {"bag": bag, "error": f"{bag}: {reason}"} for bag, reason in lost.items()}
    return [found[bag] for bag in bags]


def export(
    uris: Sequence[AnyPath],
    output: AnyPath,
    params_file: AnyPath,
    *,
    model: AnyPath | None = None,
    options: Sequence[str] = (),
    n_shards: int | None = None,
    max_in_flight: int | None = None,
    max_retries: int = 3,
    cpus_per_task: float = 1,
    memory_per_task: int | None = None,
    progress: Progress = True,
) -> dict[str, Any]:
    """Writes a LeRobot dataset: each task a shard, then all of them joined, as ``tpf export --lerobot``.

    Args:
        uris: Bags, one recording each, or folders of them, under paths that all machines of the cluster have. The episodes
            have their order. More than some ten thousand bags don't fit into a command line: name their folder.
        output: Folder of the dataset, which must not be there yet. The shards are written to a folder beside it, which all
            machines must have.
        params_file: The ROS 2 parameter file. Its content goes with each task.
        model: The model that makes estimates, under a path that all machines have.
        options: More options of ``tpf export``, such as ``["--fps", "20"]``.
        n_shards: How many tasks; four times the CPUs of the cluster unless set. Each also reads the first bag.
        max_in_flight: Tasks that are submitted and not done, at most; twice the CPUs of the cluster unless set.
        max_retries: How often a shard is begun again whose worker or machine was lost, or had too little memory.
        cpus_per_task: CPUs that a task takes.
        memory_per_task: Memory that Ray reserves for a task, and the most that its ``tpf`` may have, bytes.
        progress: Whether to show a bar, or a function of the shards done and of how many.

    Returns:
        ``output``, and the ``bags`` that are in the dataset; those that are not are in ``failed`` with the reason.

    Raises:
        ValueError: No bag, a URI as output, or a number below its least.
        FileExistsError: The output is there already.
        TaskFailed: Another reason than the bags, or a shard was lost at every attempt. No dataset is left.
    """
    if _core.is_remote(os.fspath(output)):
        raise ValueError(f"{output}: the shards lie beside the dataset, in a folder of all machines: give a path, and copy it")
    bags, out = _bags(uris), Path(_core.place(os.fspath(output))).absolute()
    if out.exists():
        raise FileExistsError(f"{out}: is there already, and a dataset is never replaced: remove it, or choose another name")
    if n_shards is not None and n_shards < 1:
        raise ValueError("n_shards is at least 1")
    tasks = _Tasks(1, max_in_flight, max_retries, cpus_per_task, memory_per_task)
    params, words = ParamsFile.read(params_file), list(options)
    of = n_shards or 4 * tasks.n_slots()
    folder = Path(tempfile.mkdtemp(prefix=f".{out.name}-shards-", dir=out.parent))
    place = str(folder)

    def write(chunk: list[str], attempt: int) -> str:
        # A shard of an attempt that was lost may be there: each attempt has a folder of its own.
        shard = os.path.join(place, f"{chunk[0]}-{attempt}")
        index = int(chunk[0])
        many.export_shard(bags, shard, params, (index, of), model=model, options=words, memory_limit=memory_per_task)
        return shard

    shards: list[str] = []
    try:
        batches = [_Batch(index, [str(index)]) for index in range(of)]
        lost = _drive("export", write, batches, tasks, lambda _, shard: shards.append(shard), progress)
        if lost:
            index, reason = next(iter(lost.items()))
            raise TaskFailed(f"shard {index}/{of}: {reason}")
        return many.join(out, shards)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@dataclass(frozen=True)
class _Batch:
    """Bags of a task."""

    #: Which of all bags the first one is.
    first: int
    bags: list[str]
    #: How often it was begun before.
    attempt: int = 0

    def again(self) -> list[_Batch]:
        """What is left to do after it was lost: each bag by itself, so that one takes no other along."""
        return [_Batch(self.first + idx, [bag], self.attempt + 1) for idx, bag in enumerate(self.bags)]


@dataclass(frozen=True)
class _Tasks:
    """How much a task takes, and how many there are."""

    bags_per_task: int
    max_in_flight: int | None
    max_retries: int
    cpus: float
    memory: int | None

    def __post_init__(self) -> None:
        least = {"bags_per_task": self.bags_per_task, "max_in_flight": self.max_in_flight, "memory_per_task": self.memory}
        for name, value in least.items():
            if value is not None and value < 1:
                raise ValueError(f"{name} is at least 1, got {value}")
        if self.max_retries < 0 or self.cpus < 0:
            raise ValueError("max_retries and cpus_per_task are at least 0")

    @property
    def threads(self) -> int:
        return max(1, int(self.cpus))

    def n_slots(self) -> int:
        """Tasks that the cluster runs at the same time."""
        return max(1, int(_engine().cluster_resources().get("CPU", 1) / max(self.cpus, 0.1)))


def _bags(uris: Sequence[AnyPath]) -> list[str]:
    if isinstance(uris, (str, os.PathLike)):
        uris = [uris]
    bags = [os.fspath(uri) for uri in uris]
    if not bags:
        raise ValueError("no bags; expected at least one")
    if len(set(bags)) < len(bags):
        twice = next(bag for idx, bag in enumerate(bags) if bag in bags[:idx])
        raise ValueError(f"{twice} is given twice")
    return bags


def _batches(bags: list[str], per_task: int) -> list[_Batch]:
    return [_Batch(first, bags[first : first + per_task]) for first in range(0, len(bags), per_task)]


def _named(lost: dict[str, str]) -> str:
    bag, reason = next(iter(lost.items()))
    more = f", and {len(lost) - 1} more" if len(lost) > 1 else ""
    return f"{bag}: {reason}{more}"


def _engine() -> Any:
    """Ray, connected. The package works without it."""
    import ray as engine  # type: ignore[import-not-found,import-untyped,unused-ignore]

    ray: Any = engine
    if not ray.is_initialized():
        ray.init()
    return ray


def _drive(
    what: str,
    work: Callable[[list[str], int], Any],
    batches: list[_Batch],
    tasks: _Tasks,
    take: Callable[[_Batch, Any], None],
    progress: Progress,
) -> dict[str, str]:
    """Runs `work` on every batch, a bounded number of them at a time, and gives each result to `take`.

    Returns:
        Bags that were lost at every attempt, with the reason of the last one.
    """
    ray = _engine()
    # Ray would begin a task again by itself, and without end where memory is too little. Here every loss is counted.
    options: dict[str, Any] = {"num_cpus": tasks.cpus, "max_retries": 0}
    if tasks.memory is not None:
        options["memory"] = tasks.memory
    task = ray.remote(**options)(work)
    limit = tasks.max_in_flight or max(2, 2 * tasks.n_slots())
    waiting = deque(batches)
    running: dict[Any, _Batch] = {}
    lost: dict[str, str] = {}
    n_done, total = 0, sum(len(batch.bags) for batch in batches)
    with Watcher(what, progress, unit="bag") as watcher:
        try:
            while waiting or running:
                while waiting and len(running) < limit:
                    batch = waiting.popleft()
                    running[task.remote(batch.bags, batch.attempt)] = batch
                done, _ = ray.wait(list(running), num_returns=1)
                batch = running.pop(done[0])
                try:
                    result = ray.get(done[0])
                except ray.exceptions.RayError as error:
                    reason = _loss(ray, error, batch)
                    if batch.attempt < tasks.max_retries:
                        waiting.extendleft(reversed(batch.again()))
                        continue
                    lost |= {bag: f"lost {batch.attempt + 1} times, the last time: {reason}" for bag in batch.bags}
                else:
                    take(batch, result)
                n_done += len(batch.bags)
                watcher.progress(n_done, total)
        finally:
            for reference in running:
                ray.cancel(reference, force=True)
    return lost


def _loss(ray: Any, error: Exception, batch: _Batch) -> str:
    """Why a batch was lost, in one line.

    Raises:
        TaskFailed: Another attempt would fail in the same way.
    """
    cause = getattr(error, "cause", None)
    if isinstance(error, ray.exceptions.RayTaskError) and not isinstance(cause, many.ProcessDied):
        raise TaskFailed(f"{batch.bags[0]}: {_last_line(cause or error)}") from error
    if isinstance(cause, many.ProcessDied):
        return _last_line(cause)
    names = {"WorkerCrashedError": "its worker ended", "NodeDiedError": "its machine was lost"}
    names |= {"LocalRayletDiedError": "its machine was lost", "OutOfMemoryError": "Ray ended it: out of memory"}
    kind = type(error).__name__
    return names.get(kind) or f"{kind}: {str(error).strip().splitlines()[0] if str(error).strip() else kind}"


def _last_line(error: BaseException) -> str:
    lines = str(error).strip().splitlines()
    return lines[-1] if lines else repr(error)
