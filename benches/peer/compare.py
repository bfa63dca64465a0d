"""`tpf replay` beside the same work in Python and beside ONNX Runtime's own batches, as tables. `just bench` runs it.

compare.py TPF [--repetitions N] [--minutes M] [--session BAG]: on a full session of synthetic glove 1 unless told
otherwise. Runs are interleaved, so that another load on the machine meets all of them; figures are medians. Leaves with 1
where the peer's forces are not ours, because then it is no peer."""
import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.join(HERE, "..", "..")
# Forces are about 1 N. Each runtime and batch adds in an order of its own, through 64 steps of an LSTM.
TOLERANCE_N = 1e-4

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("tpf")
parser.add_argument("--repetitions", type=int, default=3)
parser.add_argument("--minutes", type=float, help="length of the simulated session")
parser.add_argument("--session", help="a session of synthetic glove 1 that is there already")
parser.add_argument("--model", default=os.path.join(ROOT, "models", "glove1_pose_aware.onnx"))
args = parser.parse_args()
tpf, model = os.path.abspath(args.tpf), os.path.abspath(args.model)
cores = sorted(os.sched_getaffinity(0))
scratch = tempfile.TemporaryDirectory()
folder = scratch.name


def run(command, on):
    """Runs a command on these cores; what it printed, seconds by the clock, seconds of processor."""
    before, start = os.times(), time.perf_counter()
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                          preexec_fn=lambda: os.sched_setaffinity(0, on))
    wall, after = time.perf_counter() - start, os.times()
    if done.returncode:
        sys.exit(f"{' '.join(command)}: left with {done.returncode}: {done.stderr.strip()}")
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return done.stdout, wall, cpu


session = args.session
if session is None:
    length = ["--minutes", str(args.minutes)] if args.minutes else []
    command = [tpf, "simulate", "--glove", "1", "--users", "1", "--sessions", "1", "--seed", "1", *length, "-o", folder]
    run(command, set(cores))
    session = f"{folder}/glove1_user01_session1"
bag = next(f"{session}/{name}" for name in sorted(os.listdir(session)) if name.endswith(".mcap"))
params = os.path.join(ROOT, "params", "glove1.yaml")


def ours(backend, on, out):
    command = [tpf, "replay", session, "--params-file", params, "--model", model, "--backend", backend, "--json"]
    text, wall, cpu = run([*command, "--overwrite", "-o", f"{folder}/{out}.mcap"], on)
    summary = json.loads(text)
    return {"frames": summary["tactile"][0]["frames"], "wall_s": wall, "cpu_s": cpu, **summary["busy_s"]}


def peer(batch, on):
    text, wall, cpu = run([sys.executable, f"{HERE}/peer.py", bag, model, f"{folder}/peer.mcap", str(batch)], on)
    return {**json.loads(text), "wall_s": wall, "cpu_s": cpu}


def ready_made(on):
    rates = {int(size): rate for size, rate in json.loads(run([sys.executable, f"{HERE}/ready_made.py", model], on)[0]).items()}
    best = max(rates, key=rates.get)
    return {"rates": rates, "best": best, "rate": rates[best]}


def row(cells):
    print("| " + " | ".join(str(cell) for cell in cells) + " |", flush=True)


sets = [("one core", {cores[0]})] + ([(f"{len(cores)} cores", set(cores))] if len(cores) > 1 else [])
runs = {}
for repetition in range(args.repetitions):
    for name, on in sets:
        yardstick = ready_made(on)
        runs.setdefault((name, "ready-made"), []).append(yardstick)
        for backend in ("builtin", "onnxruntime", "rten"):
            runs.setdefault((name, backend), []).append(ours(backend, on, backend))
        runs.setdefault((name, "peer"), []).append(peer(yardstick["best"], on))

same = subprocess.run([tpf, "diff", f"{folder}/builtin.mcap", f"{folder}/peer.mcap", "--tolerance-n", str(TOLERANCE_N)],
                      stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
frames = runs[("one core", "builtin")][0]["frames"]
print(f"synthetic session of {frames} frames, {args.repetitions} interleaved runs of each, medians; load average now "
      f"{os.getloadavg()[0]:.1f}\n")
row(["what", "cores", "frames/s", "frames/s of processor", "against the Python pipeline", "against ready-made windows"])
row(["---"] * 6)
for name, _ in sets:
    median = lambda what, of: statistics.median(of(run) for run in runs[(name, what)])
    rate = lambda what: median(what, lambda run: frames / run["wall_s"])
    ready = median("ready-made", lambda run: run["rate"])
    best = statistics.mode(run["best"] for run in runs[(name, "ready-made")])
    labels = {"builtin": "`tpf replay`", "onnxruntime": "`tpf replay`, ONNX Runtime", "rten": "`tpf replay`, RTen",
              "peer": "Python pipeline"}
    for what, label in labels.items():
        of_processor = median(what, lambda run: frames / run["cpu_s"])
        ratios = [f"{rate(what) / rate('peer'):.1f}", f"{rate(what) / ready:.2f}"]
        row([label, name, f"{rate(what):,.0f}", f"{of_processor:,.0f}", *ratios])
    row([f"ONNX Runtime alone, ready-made windows, batches of {best}", name, f"{ready:,.0f}", "", "", "1.00"])
for what, title, stages in (("builtin", "`tpf replay`", ["read", "fuse", "infer", "write"]),
                            ("peer", "the Python pipeline", ["load_s", "decode_s", "align_s", "infer_s", "write_s"])):
    print(f"\nSeconds that each stage of {title} was at work, medians:\n")
    row(["cores", *[stage.removesuffix("_s") for stage in stages]])
    row(["---"] * (len(stages) + 1))
    for name, _ in sets:
        row([name, *[f"{statistics.median(run[stage] for run in runs[(name, what)]):.2f}" for stage in stages]])
print(f"\nForces of the Python pipeline beside ours, tolerance {TOLERANCE_N} N:\n\n```\n{same.stdout.strip()}\n```")
sys.exit(same.returncode)
