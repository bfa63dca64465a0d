#!/usr/bin/env python3
"""Tables over training seeds, in Markdown, from what `tpf eval --json` wrote.

    seed_tables.py SPLIT-gloveG-seedS.json...

What is compared with the pose-aware network may be in its file, or in further files of the same glove and seed.
"""
import json
import re
import statistics
import sys
from collections import defaultdict
from pathlib import Path

MEASURES = ("ba", "f1", "mdf", "mae_gf", "r2")
HEAD = "BA % | F1 % | MDF gF | MAE gF | R2"
SHOWN = {"ba": (100, 2), "f1": (100, 2), "mdf": (1, 2), "mae_gf": (1, 2), "r2": (1, 3)}
SERIES = (
    ("tactile-only", r"tactile-only"),
    ("early fusion", r"early-fusion"),
    ("pose-aware, base", r"pose-aware.*, base"),
    ("pose-aware, final", r"pose-aware"),
)


def number(measure, value):
    """A measure of a cell as a number; None where it has none."""
    if measure == "mdf":
        value = value.get("force_gf") if value.get("mdf") == "crossed" else None
    return value if isinstance(value, (int, float)) else None


def series_of(name):
    return next((shown for shown, pattern in SERIES if re.search(pattern, name)), None)


def spread(measure, values):
    scale, digits = SHOWN[measure]
    values = [scale * value for value in values if value is not None]
    if not values:
        return "none"
    deviation = f" ± {statistics.stdev(values):.{digits}f}" if len(values) > 1 else ""
    return f"{statistics.mean(values):.{digits}f}{deviation}"


def table(title, files, key):
    rows = defaultdict(lambda: defaultdict(list))
    for glove, _seed, scores in files:
        for row in scores[key]["rows"]:
            for measure in MEASURES:
                rows[glove, series_of(row["model"])][measure].append(number(measure, row["cells"][0][measure]))
    print(f"\n### {title}\n\n| glove | model | {HEAD} |\n|---|---|---|---|---|---|---|")
    for glove in sorted({glove for glove, _, _ in files}):
        for shown, _ in SERIES:
            cells = rows.get((glove, shown))
            if cells:
                print(f"| {glove} | {shown} | " + " | ".join(spread(m, cells[m]) for m in MEASURES) + " |")


def gains(title, files, key):
    print(f"\n### {title}\n\n| glove | from | to | MDF, each seed % | mean % | MAE, each seed % | 1 - BA, each seed % |")
    print("|---|---|---|---|---|---|---|")
    by_seed = {}
    for glove, seed, scores in files:
        cells = {series_of(row["model"]): row["cells"][0] for row in scores[key]["rows"]}
        by_seed.setdefault((glove, seed), {}).update(cells)
    for glove in sorted({glove for glove, _, _ in files}):
        for start in ("tactile-only", "early fusion", "pose-aware, base"):
            changes = defaultdict(list)
            for (of, _seed), cells in sorted(by_seed.items()):
                if of != glove or start not in cells:
                    continue
                for measure in ("mdf", "mae_gf", "ba"):
                    old, new = (number(measure, cells[name][measure]) for name in (start, "pose-aware, final"))
                    if old is not None and new is not None:
                        old, new = (1 - old, 1 - new) if measure == "ba" else (old, new)
                        changes[measure].append(100 * (new / old - 1))
            each = {m: ", ".join(f"{change:+.1f}" for change in changes[m]) for m in ("mdf", "mae_gf", "ba")}
            if changes["mdf"]:
                mean = f"{statistics.mean(changes['mdf']):+.1f}"
                print(f"| {glove} | {start} | pose-aware, final | {each['mdf']} | {mean} | {each['mae_gf']} | {each['ba']} |")


def paired(files):
    print("\n### Paired by user, one-sided exact Wilcoxon, each seed\n")
    print("| glove | from | to | measure | users better | p | d_z |\n|---|---|---|---|---|---|---|")
    found = defaultdict(list)
    for glove, _seed, scores in files:
        for pairing in scores["paired"]:
            names = series_of(pairing["from"]), series_of(pairing["to"])
            if names[1] != "pose-aware, final":
                continue
            for test in pairing["tests"]:
                found[(glove, *names, test["measure"])].append(test)
    for (glove, start, end, measure), tests in sorted(found.items()):
        better = ", ".join(f"{t['n_improved']}/{len(t['pairs'])}" for t in tests)
        p = ", ".join(f"{t['wilcoxon']['p']:.3f}" if t["wilcoxon"] else "none" for t in tests)
        effect = ", ".join(f"{t['d_z']:.2f}" if isinstance(t["d_z"], (int, float)) else "none" for t in tests)
        print(f"| {glove} | {start} | {end} | {measure} | {better} | {p} | {effect} |")


def main(paths):
    if not paths:
        sys.exit("seed_tables: expected the files of tpf eval --json, got none")
    files = []
    for path in map(Path, paths):
        match = re.search(r"glove(\w+)-seed(\d+)\.json$", path.name)
        if match is None:
            sys.exit(f"seed_tables: {path}: expected a name that ends in gloveG-seedS.json")
        files.append((match[1], match[2], json.loads(path.read_text())))
    seeds = sorted({seed for _, seed, _ in files})
    synthetic = "SYNTHETIC data. " if all(scores["synthetic"] for _, _, scores in files) else ""
    print(f"{synthetic}Mean ± standard deviation over training seeds {', '.join(seeds)}; all held-out frames.")
    table("Held-out frames", files, "table")
    table("Free movement alone", files, "free_movement_table")
    gains("What pose gains", files, "table")
    gains("What pose gains in free movement", files, "free_movement_table")
    paired(files)


main(sys.argv[1:])
