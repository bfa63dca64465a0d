"""Many synthetic bags on a real Ray cluster of several raylets, and as processes of a shard each, with faults.

fleet.py [--bags N] [--workers 1,2] [--bags-per-task K] [--long-minutes M] [--model MODEL] [--keep FOLDER]: N short sessions of synthetic gloves,
three of which are damaged (cut off, garbage, empty), and a long one that needs more memory than a task may have. A raylet is
killed in the middle. Leaves with 1 where the merged result is not, byte for byte, that of one process over the same bags, or
where a bag that failed is not named. Then it prints what it took, as the tables of docs/validation. Runs only inside
tests/ros/isolated. `just fleet-test` runs it with few bags, `just fleet-test 1000` with a thousand."""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import ray
from ray.cluster_utils import Cluster

from tactile_pose_fusion import many
from tactile_pose_fusion import ray as tpf_ray

ROOT = Path(__file__).resolve().parents[2]
PARAMS = ROOT / "params/glove3.yaml"
#: The shortest session of the paper's protocol.
MINUTES = 1.7
#: A raylet is killed when this share of the bags is done.
KILLED_AT = 0.4
TPF = str(Path(sys.executable).parent / "tpf")
#: Runs a program, and adds the most memory that it had to what it says, kB.
PEAK = """
import resource, subprocess, sys
code = subprocess.run(sys.argv[1:]).returncode
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss, file=sys.stderr)
sys.exit(code)
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bags", type=int, default=12)
    parser.add_argument("--workers", default="2", help="numbers of workers whose throughput is measured, none if empty")
    parser.add_argument("--bags-per-task", type=int, default=1)
    parser.add_argument("--long-minutes", type=float, default=27.7)
    parser.add_argument("--model", type=Path, default=ROOT / "models/glove3_tactile_only.onnx")
    parser.add_argument("--memory-mb", type=int, help="what a task may have; measured unless given")
    parser.add_argument("--keep", type=Path, help="where the bags are kept, and taken from if they are there")
    args = parser.parse_args()
    if os.environ.get("TPF_ISOLATED") != "1":
        sys.exit("fleet.py: not inside tests/ros/isolated; a Ray cluster would listen on the network")
    os.environ.setdefault("RAY_BACKEND_LOG_LEVEL", "error")
    os.environ["RAY_worker_niceness"] = "0"  # beside other work on this machine, times would be of the scheduler's
    if args.bags < 6:
        sys.exit("fleet.py: --bags is at least 6")
    with contextlib.ExitStack() as stack:
        temporary = stack.enter_context(tempfile.TemporaryDirectory(prefix="tpf-fleet-"))
        work = Path(temporary)
        fleet = Fleet(args, args.keep or work / "fleet", work)
        fleet.run([int(word) for word in args.workers.split(",") if word])


class Fleet:
    """The bags, what one process makes of them, and what others do."""

    def __init__(self, args: argparse.Namespace, place: Path, work: Path) -> None:
        self.args, self.work = args, work
        self.options = ["--whole", "--touch", "force"]
        self.good, self.damaged, self.long = bags(place, args.bags, args.long_minutes)
        self.rows: list[tuple[str, str]] = []

    @property
    def all(self) -> list[str]:
        """Good and damaged ones, in the order of their paths."""
        return sorted([*self.good, *self.damaged])

    def words(self) -> list[str]:
        return ["--params-file", str(PARAMS), "--model", str(self.args.model), *self.options]

    def run(self, workers: list[int]) -> None:
        expected = self.single()
        limit = (self.args.memory_mb or self.memory_between_mb()) * 1_000_000
        self.tell("memory that a task may have", f"{limit / 1e6:.0f} MB")
        for n in workers:
            self.throughput(n, expected)
        self.with_faults(expected, limit)
        self.shards(expected)
        self.replay_and_export()
        print(f"\n{len(self.good)} good bags of {MINUTES} min of synthetic gloves, 3 damaged ones, 1 of {self.args.long_minutes} min; ", end="")
        print(f"{sum(size(bag) for bag in self.all) / 1e6:.0f} MB; {os.cpu_count()} cores, load average now {os.getloadavg()[0]:.1f}\n")
        print("| what | |\n| --- | --- |")
        for what, value in self.rows:
            print(f"| {what} | {value} |")

    def tell(self, what: str, value: str) -> None:
        self.rows.append((what, value))
        print(f"{what}: {value}", flush=True)

    def single(self) -> str:
        """What one process says of all bags but the long one."""
        run, seconds, peak_mb = measured("eval", *self.all, *self.words(), "--json", "--jobs", "1")
        check(run.returncode == 3, f"one process left with {run.returncode}: {run.stderr[-300:]}")
        failed = [one["bag"] for one in json.loads(run.stdout)["failed"]]
        check(set(failed) <= set(self.damaged) and len(failed) >= 2, f"one process named {failed}")
        self.tell("one process, one thread", f"{seconds:.1f} s, {len(self.all) / seconds:.2f} bags/s, {peak_mb:.0f} MB at most")
        return run.stdout

    def memory_between_mb(self) -> int:
        """Memory in which a short bag is scored, and the long one is not, with room to both sides: found by trying."""
        short, long = self.least_memory_mb(self.good[0], 16), self.least_memory_mb(self.long, 64)
        self.tell("least memory for a short bag, and for the long one", f"{short} MB, {long} MB")
        check(long >= 1.3 * short, f"{short} MB do for a short bag, and {long} MB for the long one: give more --long-minutes")
        return round(math.sqrt(short * long))

    def least_memory_mb(self, bag: str, first: int) -> int:
        """The least memory in which a bag is scored, to a twentieth."""

        def fits(megabytes: int) -> bool:
            try:
                self.partial([bag], megabytes * 1_000_000)
            except many.ProcessDied:
                return False
            return True

        low, high = first, first
        while not fits(high):
            low, high = high, 2 * high
            check(high < 1 << 14, f"{bag} does not fit into 16 GB")
        while high - low > max(4, high // 20):
            middle = (low + high) // 2
            low, high = (low, middle) if fits(middle) else (middle, high)
        return high

    def partial(self, some: list[str], limit: int | None = None) -> bytes:
        return many.partial(some, PARAMS, model=self.args.model, options=self.options, memory_limit=limit)

    def evaluate(self, some: list[str], **more: Any) -> dict[str, Any]:
        more = {"progress": False, "bags_per_task": self.args.bags_per_task, **more}
        return tpf_ray.evaluate(some, PARAMS, model=self.args.model, options=self.options, **more)

    def throughput(self, n: int, expected: str) -> None:
        """So many workers, nothing lost: what scheduling a bag costs."""
        with cluster([1] * n):
            empty = ray.remote(num_cpus=1)(nothing)
            ray.get([empty.remote() for _ in range(4 * n)])  # workers are there
            began = time.perf_counter()
            scores = self.evaluate(self.all)
            seconds = time.perf_counter() - began
            check(scores == json.loads(expected), f"the result of {n} workers is another")
            self.tell(f"Ray, {n} worker(s) of one core", f"{seconds:.1f} s, {len(self.all) / seconds:.2f} bags/s")
            times = []
            for _ in range(50):
                began = time.perf_counter()
                ray.get(empty.remote())
                times.append(time.perf_counter() - began)
            self.tell(f"an empty Ray task, {n} worker(s), median of 50", f"{1e3 * statistics.median(times):.1f} ms")
        began = time.perf_counter()
        for _ in range(5):
            tpf("--version")
        self.tell("beginning `tpf` of the wheel", f"{1e3 * (time.perf_counter() - began) / 5:.0f} ms")
        began = time.perf_counter()
        self.partial([self.good[0]])
        self.tell("a bag by `many.partial`, without Ray", f"{1e3 * (time.perf_counter() - began):.0f} ms")
        began = time.perf_counter()
        partials = [self.partial(self.all[:4])]
        self.tell("a bag of four in one task, without Ray", f"{1e3 * (time.perf_counter() - began) / 4:.0f} ms")
        self.tell("size of a partial of a bag", f"{len(partials[0]) / 4e3:.0f} kB")

    def with_faults(self, expected: str, limit: int) -> None:
        """A raylet killed in the middle, damaged bags, and one for which memory is too little."""
        partials = self.work / "partials"
        with cluster([1, 1]) as (nodes, kill, add):
            killed: list[float] = []
            seen: list[int] = []

            def progress(done: int, total: int) -> None:
                seen.append(done)
                if not killed and done >= KILLED_AT * total:
                    kill(nodes[-1])
                    killed.append(time.perf_counter())
                    add(1)

            began = time.perf_counter()
            everything = [*self.all[:2], self.long, *self.all[2:]]
            scores = self.evaluate(
                everything, memory_per_task=limit, partials=partials, max_retries=2, progress=progress, max_in_flight=4
            )
            seconds = time.perf_counter() - began
        check(len(killed) == 1 and seen[-1] == len(everything), f"no raylet was killed, or not all done: {seen[-3:]}")
        failed = {one["bag"]: one["error"] for one in scores["failed"]}
        reason = failed.pop(self.long, "")
        check("lost 3 times" in reason and "out of memory" in reason, f"the long bag: {reason!r}")
        scores["failed"] = [one for one in scores["failed"] if one["bag"] != self.long]
        check(scores == json.loads(expected), "the result of a cluster that lost a raylet is another")
        self.tell("Ray, 2 workers, a raylet killed, 1 bag out of memory", f"{seconds:.1f} s, same bytes, {len(failed) + 1} bags named")
        listed = self.work / "bags.txt"
        listed.write_text("".join(f"{bag}\n" for bag in self.all))
        run, seconds, peak_mb = measured("merge", str(partials), "--expect", str(listed), "--json")
        check(run.returncode == 3 and run.stdout == expected, f"tpf merge left with {run.returncode}")
        self.tell(f"`tpf merge` of {len(self.all)} partials", f"{seconds:.1f} s, {peak_mb:.0f} MB at most")
        files = sorted(map(str, partials.glob("*.parquet")))
        for some in (files[: len(files) // 4], files[: len(files) // 2]):
            run, seconds, peak_mb = measured("merge", *some, "--json")
            check(run.returncode in (0, 3), f"tpf merge of {len(some)} left with {run.returncode}: {run.stderr[-300:]}")
            self.tell(f"`tpf merge` of {len(some)} partials", f"{seconds:.1f} s, {peak_mb:.0f} MB at most")

    def shards(self, expected: str, n: int = 3) -> None:
        """The same as processes with `--shard I/N`, two at a time; one is killed and begun again."""
        outs = [str(self.work / f"shard{index}.parquet") for index in range(n)]
        command = [TPF, "eval", *self.all, *self.words(), "--jobs", "1", "--overwrite"]
        began = time.perf_counter()

        def start(index: int) -> subprocess.Popen[bytes]:
            more = ["--shard", f"{index}/{n}", "--partial", outs[index]]
            return subprocess.Popen([*command, *more], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

        first = start(0)
        with contextlib.suppress(subprocess.TimeoutExpired):
            first.wait(0.3)  # long enough that it is at work, and too short to be done
        was_killed = first.poll() is None
        first.kill()
        first.wait()
        check(was_killed and not Path(outs[0]).exists(), "a shard that was killed left a partial")
        codes = []
        for indexes in ([0, 1], [2]):
            codes += [child.wait() for child in [start(index) for index in indexes]]
        check(sorted(set(codes)) in ([0, 3], [3]), f"shards left with {codes}")
        run = tpf("merge", *reversed(outs), "--json")
        check(run.returncode == 3 and run.stdout == expected, f"tpf merge of shards left with {run.returncode}: {run.stderr[-300:]}")
        self.tell(f"{n} processes with --shard, two at a time, one killed and begun again", f"{time.perf_counter() - began:.1f} s, same bytes")

    def replay_and_export(self) -> None:
        """Some of the bags replayed and exported on Ray: files of one process."""
        some, work = sorted([*self.good[:4], *self.damaged]), self.work
        limits: dict[str, Any] = {"model": self.args.model, "progress": False}
        one = tpf("replay", *some, "--each", "-o", str(work / "one"), *self.words()[:4])
        check(one.returncode == 3, f"replay left with {one.returncode}")
        whole = tpf("export", *some, "--lerobot", str(work / "whole"), *self.words()[:4])
        check(whole.returncode == 3, f"export left with {whole.returncode}: {whole.stderr[-300:]}")
        with cluster([1, 1]) as (nodes, kill, add):
            done: list[int] = []

            def progress(n: int, _: int) -> None:
                done.append(n)
                if n == 2:
                    kill(nodes[-1])
                    add(1)

            found = tpf_ray.replay(some, work / "many", PARAMS, model=self.args.model, progress=progress)
            ours, theirs = contents(work / "one"), contents(work / "many")
            check(ours == theirs, f"bags that were replayed on Ray differ: {sorted(ours)}, {sorted(theirs)}")
            check([entry["bag"] for entry in found if "error" in entry] == failed_of(one.stderr, some), f"{found}")
            again = tpf_ray.replay(some, work / "many", PARAMS, resume=True, **limits)
            check(sum(entry.get("kept", False) for entry in again) == len(contents(work / "one")), "resume kept others")
            joined = tpf_ray.export(some, work / "joined", PARAMS, n_shards=3, **limits)
            check(contents(work / "whole") == contents(work / "joined"), "the dataset that was exported on Ray differs")
            check(len(joined["bags"]) + len(joined["failed"]) == len(some), f"{joined}")
            check(not list(work.glob(".joined-shards-*")), "shards were left")
        self.tell("replay and export on Ray, a raylet killed", f"{len(some)} bags, same bytes as one process")


def bags(place: Path, n: int, long_minutes: float) -> tuple[list[str], list[str], str]:
    """Good bags, damaged ones, and a long one."""
    made = place / f"{n}"
    if not (made / "done").exists():
        made.mkdir(parents=True, exist_ok=True)
        per_call = 500  # users of one call
        for seed, first in enumerate(range(0, n, per_call), start=1):
            users = str(min(per_call, n - first))
            words = ["simulate", "--glove", "3", "--sessions", "1", "--minutes", str(MINUTES), "--users", users]
            done = tpf(*words, "--seed", str(seed), "-o", str(made / f"seed{seed}"))
            check(done.returncode == 0, done.stderr)
        done = tpf("simulate", "--glove", "3", "--users", "1", "--sessions", "1", "--minutes", str(long_minutes), "--seed", "99", "-o", str(made / "long"))
        check(done.returncode == 0, done.stderr)
        (made / "damaged").mkdir(exist_ok=True)
        whole = next(sorted(made.glob("seed1/*"))[0].glob("*.mcap")).read_bytes()
        for name, content in [("cut_off", whole[: len(whole) // 2]), ("garbage", os.urandom(1 << 16)), ("empty", b"")]:
            (made / f"damaged/{name}.mcap").write_bytes(content)
        (made / "done").touch()
    good = sorted(str(path) for path in made.glob("seed*/*") if path.is_dir())
    check(len(good) == n, f"{len(good)} bags were simulated, expected {n}")
    return good, sorted(str(path) for path in made.glob("damaged/*")), str(next(iter((made / "long").iterdir())))


@contextlib.contextmanager
def cluster(cores: list[int]) -> Iterator[tuple[list[Any], Callable[[Any], None], Callable[[int], None]]]:
    """A head without cores and a raylet for each of `cores`, connected; how to kill a raylet, and how to add one.

    Each raylet has an address of its own in the loopback network, so that this process belongs to the head and not to one
    that is killed.
    """
    head = {"num_cpus": 0, "node_ip_address": "127.0.0.1", "include_dashboard": False, "object_store_memory": 200 << 20}
    of_all = Cluster(initialize_head=True, head_node_args=head)
    nodes: list[Any] = []

    def add(n_cores: int) -> None:
        more = {"num_cpus": n_cores, "object_store_memory": 200 << 20, "memory": 64 << 30}
        nodes.append(of_all.add_node(node_ip_address=f"127.0.0.{len(nodes) + 2}", **more))

    def kill(node: Any) -> None:
        of_all.remove_node(node, allow_graceful=False)

    try:
        for n_cores in cores:
            add(n_cores)
        ray.init(address=of_all.address, _node_ip_address="127.0.0.1", log_to_driver=False, logging_level="ERROR")
        yield nodes, kill, add
    finally:
        ray.shutdown()
        of_all.shutdown()


def nothing() -> None:
    """The work of an empty task."""


def tpf(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([TPF, *words], capture_output=True, text=True, check=False)


def measured(*words: str) -> tuple[subprocess.CompletedProcess[str], float, float]:
    """As `tpf`, with the seconds that it took and the most memory that it had, MB."""
    began = time.perf_counter()
    run = subprocess.run([sys.executable, "-c", PEAK, TPF, *words], capture_output=True, text=True, check=False)
    return run, time.perf_counter() - began, int(run.stderr.splitlines()[-1]) / 1e3


def failed_of(words: str, some: list[str]) -> list[str]:
    """Bags that a run names as failed, in their order."""
    lines = [line for line in words.splitlines() if "not replayed: " in line]
    return [bag for bag in some if any(f"not replayed: {bag}:" in line for line in lines)]


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def size(bag: str) -> int:
    path = Path(bag)
    return sum(one.stat().st_size for one in path.rglob("*")) if path.is_dir() else path.stat().st_size


def check(holds: bool, what: str) -> None:
    if not holds:
        sys.exit(f"fleet.py: {what}")


if __name__ == "__main__":
    main()
