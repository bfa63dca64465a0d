"""Tasks on a Ray cluster: a bounded number at a time, each begun again a bounded number of times, and no wait without end."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from . import many
from ._watch import Progress, Watcher
from .many import TaskFailed

#: How often to look whether a task can still end, s.
_LOOK_EVERY_S = 5.0

#: Within this time a cluster has to have a machine on which a task fits, s. An autoscaler adds one in minutes.
_MACHINE_WITHIN_S = 600.0

#: What Ray may take beside the work of a task, s: to begin a worker, to notice that a machine is lost, to hand over a result.
_RAY_TAKES_S = 120.0


@dataclass(frozen=True)
class Batch:
    """Bags of a task."""

    #: Which of all bags the first one is.
    first: int
    bags: list[str]
    #: How often it was begun before.
    attempt: int = 0

    def again(self) -> list[Batch]:
        """What is left to do after it was lost: each bag by itself, so that one takes no other along."""
        return [Batch(self.first + idx, [bag], self.attempt + 1) for idx, bag in enumerate(self.bags)]


def batches(bags: list[str], per_task: int) -> list[Batch]:
    """Bags as they are shared out, in their order."""
    return [Batch(first, bags[first : first + per_task]) for first in range(0, len(bags), per_task)]


@dataclass(frozen=True)
class Tasks:
    """How much a task takes, and how many there are."""

    bags_per_task: int
    max_in_flight: int | None
    max_retries: int
    cpus: float
    memory: int | None
    #: The most time of one bag, s.
    timeout_s: float

    def __post_init__(self) -> None:
        least = {"bags_per_task": self.bags_per_task, "max_in_flight": self.max_in_flight, "memory_per_task": self.memory}
        for name, value in least.items():
            if value is not None and value < 1:
                raise ValueError(f"{name} is at least 1, got {value}")
        if self.max_retries < 0 or self.cpus < 0:
            raise ValueError("max_retries and cpus_per_task are at least 0")
        if not 0 < self.timeout_s < 1e9:
            raise ValueError(f"timeout_s is above 0 and below 1e9, got {self.timeout_s}")

    @property
    def threads(self) -> int:
        """Threads of a task."""
        return max(1, int(self.cpus))

    def n_slots(self) -> int:
        """Tasks that the cluster runs at the same time."""
        return max(1, int(engine().cluster_resources().get("CPU", 1) / max(self.cpus, 0.1)))

    def misfit(self, ray: Any) -> str | None:
        """Why no machine of the cluster can run a task, if it is so."""
        machines = [node["Resources"] for node in ray.nodes() if node["Alive"]]
        wanted = {"CPU": self.cpus, "memory": self.memory or 0}
        if any(all(machine.get(name, 0) >= amount for name, amount in wanted.items()) for machine in machines):
            return None
        memory = f" and {self.memory / 1e6:.0f} MB" if self.memory else ""
        there = ", ".join(f"{one.get('CPU', 0):g} CPUs and {one.get('memory', 0) / 1e6:.0f} MB" for one in machines[:4])
        more = f", and {len(machines) - 4} more" if len(machines) > 4 else ""
        return f"no machine of the Ray cluster has the {self.cpus:g} CPUs{memory} of a task; there are: {there or 'none'}{more}"


def engine() -> Any:
    """Ray, connected. The package works without it."""
    import ray as engine  # type: ignore[import-not-found,import-untyped,unused-ignore]

    ray: Any = engine
    if not ray.is_initialized():
        ray.init()
    return ray


def drive(
    what: str,
    work: Callable[[list[str], int], Any],
    of: list[Batch],
    tasks: Tasks,
    take: Callable[[Batch, Any], None],
    progress: Progress,
) -> dict[str, str]:
    """Runs `work` on every batch, a bounded number of them at a time, and gives each result to `take`.

    Returns:
        Bags that were lost at every attempt, with the reason of the last one.

    Raises:
        TaskFailed: Another attempt would fail in the same way, or the cluster does nothing.
    """
    ray = engine()
    # Ray would begin a task again by itself, and without end where memory is too little. Here every loss is counted.
    options: dict[str, Any] = {"num_cpus": tasks.cpus, "max_retries": 0}
    if tasks.memory is not None:
        options["memory"] = tasks.memory
    task = ray.remote(**options)(work)
    limit = tasks.max_in_flight or max(2, 2 * tasks.n_slots())
    waiting = deque(of)
    running: dict[Any, Batch] = {}
    lost: dict[str, str] = {}
    n_done, total = 0, sum(len(batch.bags) for batch in of)
    with Watcher(what, progress, unit="bag") as watcher:
        patience = _Patience(ray, tasks, watcher)

        def lose(batch: Batch, reason: str) -> int:
            """Puts it back, or gives it up; how many of its bags are done with."""
            if batch.attempt < tasks.max_retries:
                waiting.extendleft(reversed(batch.again()))
                return 0
            times = "once" if batch.attempt == 0 else f"{batch.attempt + 1} times, the last time"
            lost.update({bag: f"lost {times}: {reason}" for bag in batch.bags})
            return len(batch.bags)

        try:
            while waiting or running:
                while waiting and len(running) < limit:
                    batch = waiting.popleft()
                    running[task.remote(batch.bags, batch.attempt)] = batch
                done, _ = ray.wait(list(running), num_returns=1, timeout=_LOOK_EVERY_S)
                if not done:
                    if reason := patience.over(max(len(batch.bags) for batch in running.values())):
                        cancelled = list(running.values())
                        _cancel(ray, running)
                        n_done += sum(lose(batch, reason) for batch in reversed(cancelled))
                        watcher.progress(n_done, total)
                    continue
                patience.anew()
                batch = running.pop(done[0])
                try:
                    result = ray.get(done[0], timeout=_RAY_TAKES_S)
                except ray.exceptions.RayError as error:
                    n_done += lose(batch, _loss(ray, error, batch))
                else:
                    take(batch, result)
                    n_done += len(batch.bags)
                watcher.progress(n_done, total)
        finally:
            _cancel(ray, running)
    return lost


class _Patience:
    """How long to wait for a cluster in which no task ends.

    A worker bounds the time of its `tpf` by itself. So if none ends for longer, workers hang, or there are none.
    """

    def __init__(self, ray: Any, tasks: Tasks, watcher: Watcher) -> None:
        self._ray, self._tasks, self._watcher = ray, tasks, watcher
        self._n_over = 0
        self._since = time.monotonic()
        self._no_machine_since: float | None = None

    def anew(self) -> None:
        """A task has ended, however."""
        self._n_over, self._since, self._no_machine_since = 0, time.monotonic(), None

    def over(self, n_bags: int) -> str | None:
        """Why all tasks that run, of at most so many bags, count as lost, if they do.

        Raises:
            TaskFailed: There is no machine for a task, or tasks were lost in this way at every attempt.
        """
        now = time.monotonic()
        misfit = self._tasks.misfit(self._ray)
        if misfit is None:
            self._no_machine_since = None
        elif self._no_machine_since is None:
            self._no_machine_since = now
            self._watcher.note(f"{misfit}; waiting {_MACHINE_WITHIN_S:.0f} s for one")
        elif now - self._no_machine_since >= _MACHINE_WITHIN_S:
            raise TaskFailed(f"{misfit}, and none came within {_MACHINE_WITHIN_S:.0f} s")
        if misfit is not None:
            self._since = now  # what has no machine yet does not hang
        most_s = self._tasks.timeout_s * n_bags + _RAY_TAKES_S
        if now - self._since < most_s:
            return None
        self._n_over, self._since = self._n_over + 1, now
        reason = f"no task ended within {most_s:.0f} s"
        if self._n_over > self._tasks.max_retries:
            raise TaskFailed(f"{reason}, {self._n_over} times in a row: the workers of the Ray cluster hang, or do other work")
        return reason


def _cancel(ray: Any, running: dict[Any, Batch]) -> None:
    """Ends tasks. Their workers are not waited for: they may be gone."""
    for reference in running:
        ray.cancel(reference, force=True)
    running.clear()


def _loss(ray: Any, error: Exception, batch: Batch) -> str:
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
    names |= {"GetTimeoutError": f"its result did not come within {_RAY_TAKES_S:.0f} s"}
    kind = type(error).__name__
    return names.get(kind) or f"{kind}: {str(error).strip().splitlines()[0] if str(error).strip() else kind}"


def _last_line(error: BaseException) -> str:
    lines = str(error).strip().splitlines()
    return lines[-1] if lines else repr(error)
