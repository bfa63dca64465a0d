"""The Python package beside the command `tpf`, beside the core's own tick, and beside pure Python, as tables with ratios.

package.py [--repetitions N] [--minutes M] [--tpf PROGRAM]: needs the wheel in this environment (`just bench-python`). Replay
of a session of synthetic glove 1 by the command, by `tactile_pose_fusion` and by `peer.py`; then samples of the same session
one by one through `tactile_pose_fusion.Core`, in blocks through the same core, and through NumPy and ONNX Runtime. Runs are
interleaved, so that another load on the machine meets all of them, and time of processor is shown beside that of the clock.
Leaves with 1 where results differ, because then it compares nothing; a goal that is missed is said and is no error."""
import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
import warnings
from importlib.metadata import version

import numpy as np

import peer
import tactile_pose_fusion

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.join(HERE, "..", "..")
# As in compare.py: each runtime and batch adds in an order of its own.
TOLERANCE_N = 1e-4
# The goals.
MOST_OVER_COMMAND, MOST_OVER_TICK_US = 0.03, 20.0
N_PER_BLOCK = 1000

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--repetitions", type=int, default=5)
parser.add_argument("--minutes", type=float, default=10.0, help="length of the simulated session")
parser.add_argument("--tpf", default=os.path.join(os.path.dirname(sys.executable), "tpf"), help="`tpf`; that of the wheel unless given")
parser.add_argument("--model", default=os.path.join(ROOT, "models", "glove1_pose_aware.onnx"))
args = parser.parse_args()
model, params = os.path.abspath(args.model), os.path.join(ROOT, "params", "glove1.yaml")
scratch = tempfile.TemporaryDirectory()
folder = scratch.name
session = os.path.join(folder, "session")
warnings.simplefilter("ignore", tactile_pose_fusion.TactilePoseFusionWarning)


def row(*cells):
    print("| " + " | ".join(str(cell) for cell in cells) + " |", flush=True)


def lines_of(*command):
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    return done.stdout.splitlines() if done.returncode == 0 else []


def machine():
    """What it was measured on."""
    known = dict(line.split(":", 1) for line in lines_of("lscpu") if ":" in line)
    flags = set(known.get("Flags", "").split())
    vectors = [name for name, flag in [("AVX2", "avx2"), ("FMA", "fma"), ("AVX-512", "avx512f")] if flag in flags]
    commit = (lines_of("git", "rev-parse", "--short=12", "HEAD") or ["unknown"])[0]
    commit += " with changes" if lines_of("git", "status", "--porcelain", "--untracked-files=no") else ""
    print(f"{known.get('Model name', platform.machine()).strip()}, {len(os.sched_getaffinity(0))} cores, {', '.join(vectors) or 'no AVX2'}; "
          f"load average {os.getloadavg()[0]:.1f} as it began; {platform.python_implementation()} {platform.python_version()}; "
          + ", ".join(f"{name} {version(name)}" for name in ["tactile-pose-fusion", "numpy", "onnxruntime", "mcap-ros2-support"])
          + f"; commit {commit}\n")


class Spent:
    """Seconds by the clock and of processor, of this process and of those that it waited for."""

    def __enter__(self):
        self._cpu, self._wall = sum(os.times()[:4]), time.perf_counter()
        return self

    def __exit__(self, *_):
        self.wall = time.perf_counter() - self._wall
        self.cpu = sum(os.times()[:4]) - self._cpu


def run(*command):
    """Runs a command; what it printed, and what it took."""
    with Spent() as spent:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{' '.join(command)}: left with {done.returncode}: {done.stderr.strip()}")
    return done.stdout, spent


def replays():
    """Replay of the session: whole processes, and the calls alone in a process that goes on."""
    bag = next(f"{session}/{name}" for name in sorted(os.listdir(session)) if name.endswith(".mcap"))
    out = {name: os.path.join(folder, f"{name}.mcap") for name in ["command", "package", "peer"]}
    given = f"{params!r}, model={model!r}, progress=False"
    to_bag = f"import tactile_pose_fusion as tpf; tpf.replay_to({session!r}, {out['package']!r}, {given}, overwrite=True)"
    to_arrays = f"import tactile_pose_fusion as tpf; tpf.replay({session!r}, {given})"
    command = [args.tpf, "replay", session, "--params-file", params, "--model", model, "--json", "--overwrite", "-o", out["command"]]
    python = [sys.executable, "-W", "ignore", "-c"]
    spent = {}

    def call(what, function, *more, **named):
        with Spent() as taken:
            function(session, *more, params, model=model, progress=False, **named)
        spent.setdefault(what, []).append(taken)

    for _ in range(args.repetitions):
        text, taken = run(*command)
        spent.setdefault("command", []).append(taken)
        spent.setdefault("to a bag", []).append(run(*python, to_bag)[1])
        spent.setdefault("to arrays", []).append(run(*python, to_arrays)[1])
        call("call to a bag", tactile_pose_fusion.replay_to, out["package"], overwrite=True)
        call("call to arrays", tactile_pose_fusion.replay)
        spent.setdefault("start", []).append(run(args.tpf, "--version")[1])
        spent.setdefault("peer", []).append(run(sys.executable, f"{HERE}/peer.py", bag, model, out["peer"], "16")[1])
    n_frames = json.loads(text)["tactile"][0]["frames"]
    with open(out["command"], "rb") as of_command, open(out["package"], "rb") as of_package:
        same = of_command.read() == of_package.read()
    diff = [args.tpf, "diff", out["command"], out["peer"], "--tolerance-n", str(TOLERANCE_N)]
    differs = subprocess.run(diff, capture_output=True, text=True, check=False)
    wall = {what: [one.wall for one in of] for what, of in spent.items()}
    cpu = {what: [one.cpu for one in of] for what, of in spent.items()}
    print(f"Replay of {n_frames} synthetic frames, {args.repetitions} interleaved runs of each; least of them, medians in brackets:\n")
    row("what", "s", "s of processor", "s, against the command", "of processor, against it", "times less processor than pure Python")
    row(*["---"] * 6)
    labels = {"command": "`tpf replay`, the whole process", "to a bag": "Python: a process that calls `replay_to`",
              "to arrays": "Python: a process that calls `replay`", "call to a bag": "the call of `replay_to` alone",
              "call to arrays": "the call of `replay` alone", "start": "`tpf --version`: what its start takes",
              "peer": "pure Python: mcap-ros2-support, NumPy, ONNX Runtime"}
    for what, label in labels.items():
        times = [f"{min(of[what]):.2f} ({statistics.median(of[what]):.2f})" for of in (wall, cpu)]
        ratios = [f"{min(of[what]) / min(of['command']):.3f}" for of in (wall, cpu)]
        row(label, *times, *ratios, f"{min(cpu['peer']) / min(cpu[what]):.1f}")
    over = [min(of["to a bag"]) / min(of["command"]) - 1 for of in (wall, cpu)]
    # The hardest reading: the command would begin in no time, and the package pays for the whole start of an interpreter.
    hardest = min(cpu["to a bag"]) / (min(cpu["command"]) - min(cpu["start"])) - 1
    print(f"\nThe package over the command, the same work as whole processes: {over[0]:+.1%} by the clock ({goal(over[0] <= MOST_OVER_COMMAND)}), "
          f"{over[1]:+.1%} of processor ({goal(over[1] <= MOST_OVER_COMMAND)}); the goal is at most {MOST_OVER_COMMAND:.0%}. Over a command that "
          f"starts in no time: {hardest:+.1%} of processor.")
    print(f"The bag of the package is that of the command, byte for byte: {'yes' if same else 'NO'}. Pure Python beside it, "
          f"tolerance {TOLERANCE_N} N: {'the same' if differs.returncode == 0 else differs.stdout.strip()}\n")
    return same and differs.returncode == 0


def goal(met):
    return "met" if met else "MISSED"


class Windows:
    """A sample at a time, as somebody would write it with NumPy and ONNX Runtime: the window moves on, the model runs on it."""

    def __init__(self, zero):
        self.session, notes, self.joints = peer.open_model(model)
        self.unit = peer.NEWTON_OF_GF if notes.get("unit", "gF") == "gF" else 1.0
        shapes = {tensor.name: tensor.shape[1:] for tensor in self.session.get_inputs()}
        self.window = shapes["tactile"][0]
        self.taxels = np.zeros([1, *shapes["tactile"]], np.float32)
        self.pose = np.zeros([1, *shapes["pose"]], np.float32)
        self.zero, self.n = zero, 0

    def sample(self, taxels, angles):
        for ring, values in [(self.taxels, taxels - self.zero), (self.pose, angles)]:
            ring[0, :-1] = ring[0, 1:]
            ring[0, -1] = values
        self.n += 1
        if self.n < self.window:
            return np.nan
        force, _ = self.session.run(["force", "force_base"], {"tactile": self.taxels, "pose": self.pose})
        return float(force.reshape(-1)[0]) * self.unit


def samples():
    """Samples of the session one by one: the same through each way."""
    bag = next(f"{session}/{name}" for name in sorted(os.listdir(session)) if name.endswith(".mcap"))
    _, _, joints = peer.open_model(model)
    stamps, _, taxels, _, at_rest, pose_ns, pose, _ = peer.read(bag, joints)
    zero = peer.median(taxels[at_rest])
    angles, _, _ = peer.poses_at(stamps, pose_ns, pose, np.full(len(stamps), len(pose_ns)))
    angles = angles.astype(np.float64)
    stamps = stamps[0] + 10_000_000 * np.arange(len(stamps))  # no frame is missing: what fills them in is not compared here
    glove = tactile_pose_fusion.Glove(tactile_pose_fusion.Parameters(params, set={"model.fingertip.path": model}))
    names = list(joints)
    one, block, pure = glove.core(), glove.core(), Windows(zero)
    for core in (one, block):
        core.set_baseline(zero)
    spent = {"block": [], "one": [], "read": [], "pure": []}
    forces = {"block": [], "one": [], "read": [], "pure": []}
    read = glove.core()
    read.set_baseline(zero)

    def in_a_block(span, some):
        return block.feed(stamps[span], taxels[span], stamps[span], angles[span], names)["index"].force_n

    def one_by_one(span, some):
        made = []
        for stamp_ns, values, positions in some:
            one.joints(stamp_ns, positions, names)
            made.append(one.taxels(stamp_ns, values))
        return made

    def with_forces(span, some):
        made = []
        for stamp_ns, values, positions in some:
            read.joints(stamp_ns, positions, names)
            made.append(read.taxels(stamp_ns, values)["index"].force_n[-1])
        return made

    def by_hand(span, some):
        return [pure.sample(values, positions) for _, values, positions in some]

    n_blocks = min(len(stamps) // N_PER_BLOCK, 10 * args.repetitions)
    for idx in range(n_blocks):
        span = slice(idx * N_PER_BLOCK, (idx + 1) * N_PER_BLOCK)
        some = list(zip(stamps[span].tolist(), taxels[span], angles[span]))
        for what, work in [("block", in_a_block), ("one", one_by_one), ("read", with_forces), ("pure", by_hand)]:
            began, cpu = time.perf_counter(), time.process_time()
            made = work(span, some)
            spent[what].append((time.perf_counter() - began, time.process_time() - cpu))
            forces[what].extend(made)
    # The first block is to warm up.
    wall, cpu = ({what: [1e6 * one[which] / N_PER_BLOCK for one in of[1:]] for what, of in spent.items()} for which in (0, 1))
    print(f"Samples of taxels and joint angles, {n_blocks - 1} interleaved blocks of {N_PER_BLOCK}, one region; us a sample, least of the blocks, "
          "medians in brackets:\n")
    row("what", "us", "us of processor", "of processor, over the core's own tick", "times less processor than pure Python")
    row(*["---"] * 5)
    labels = {"block": "the core's own tick: a block in one call", "one": "`core.joints` and `core.taxels`, sample by sample",
              "read": "the same, and the force read from the result", "pure": "pure Python: NumPy, ONNX Runtime, sample by sample"}
    for what, label in labels.items():
        times = [f"{min(of[what]):.1f} ({statistics.median(of[what]):.1f})" for of in (wall, cpu)]
        row(label, *times, f"{min(cpu[what]) - min(cpu['block']):+.1f}", f"{min(cpu['pure']) / min(cpu[what]):.2f}")
    over = [min(of["read"]) - min(of["block"]) for of in (wall, cpu)]
    print(f"\nA sample through Python, its force read, over the core's own tick: {over[0]:.1f} us by the clock ({goal(over[0] < MOST_OVER_TICK_US)}), "
          f"{over[1]:.1f} us of processor ({goal(over[1] < MOST_OVER_TICK_US)}); the goal is below {MOST_OVER_TICK_US:.0f} us.")
    forces["one"] = [made["index"].force_n[-1] for made in forces["one"]]
    one, block, pure = (np.array(forces[what]) for what in ("one", "block", "pure"))
    same = np.array_equal(one, block, equal_nan=True) and np.array_equal(one, np.array(forces["read"]), equal_nan=True)
    known = ~np.isnan(one) & ~np.isnan(pure)
    far = float(np.abs(one[known] - pure[known]).max())
    print(f"Sample by sample and in blocks: {'the same bits' if same else 'DIFFERENT'}. Pure Python beside it: {far:.1e} N at most over "
          f"{known.sum()} samples.")
    return same and far <= TOLERANCE_N and known.sum() > N_PER_BLOCK


machine()
tactile_pose_fusion.simulate(session, glove=1, seed=1, minutes=args.minutes)
replayed = replays()
sampled = samples()
print(f"\nLoad average as it ended: {os.getloadavg()[0]:.1f}")
sys.exit(0 if replayed and sampled else 1)
