#!/usr/bin/env python3
"""A training step here and in PyTorch, one thread each, by turns on the same machine: medians over the rounds and their ratio.

    scripts/train_speed.py PYTHON [ROUNDS]

PYTHON is an interpreter that has torch; ROUNDS is 3 by default. Builds the benchmark first. Keep the machine quiet: both
sides take turns, so that a slow minute hits both, but a busy one still blurs the ratio.
"""
import re
import statistics
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SECONDS = {"s": 1.0, "ms": 1e-3, "µs": 1e-6, "us": 1e-6, "ns": 1e-9}


def output(*command):
    return subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout


def ours():
    """Median of each case as criterion tells it, in seconds a step."""
    text = output("cargo", "bench", "--locked", "--bench", "train", "--", "--noplot", "--warm-up-time", "1", "--measurement-time", "5")
    pattern = r"(train_step/\S+)\s+time:\s+\[\S+ \S+ (\S+) (\S+) "
    return {case: float(value) * SECONDS[unit] for case, value, unit in re.findall(pattern, text)}


def theirs(python):
    text = output(python, "tests/python/train_speed.py", "--seconds", "5")
    print(text.splitlines()[0], file=sys.stderr)
    return {case: float(value) for case, value in re.findall(r"(train_step/\S+): (\S+) s,", text)}


def main(python, rounds=3):
    subprocess.run(["cargo", "bench", "--locked", "--bench", "train", "--no-run"], cwd=ROOT, check=True)
    here, there = defaultdict(list), defaultdict(list)
    for _ in range(int(rounds)):
        for times, found in ((here, ours()), (there, theirs(python))):
            for case, seconds in found.items():
                times[case].append(seconds)
    if not here or here.keys() != there.keys():
        sys.exit(f"train_speed: the two sides timed other cases: {sorted(here)} and {sorted(there)}")
    print("| case | tpf ms a step | PyTorch ms a step | PyTorch / tpf |\n|---|---|---|---|")
    for case, seconds in here.items():
        mine, other = statistics.median(seconds), statistics.median(there[case])
        print(f"| {case} | {1e3 * mine:.1f} | {1e3 * other:.1f} | {other / mine:.2f} |")


if len(sys.argv) not in (2, 3):
    sys.exit("train_speed: expected PYTHON [ROUNDS]")
main(*sys.argv[1:])
