#!/usr/bin/env python3
"""Tables over training seeds and left-out users, in Markdown, from what `scripts/adaptive-results FOLDER` wrote.

    adaptive_tables.py FOLDER
"""
import json
import re
import statistics
import sys
from collections import defaultdict
from pathlib import Path

ROWS = (
    ("Held-out frames", "tactile-only", r"tactile"),
    ("Held-out frames", "adaptive", r"follow-\d"),
    ("Held-out frames", "adaptive, calibration alone", r"frozen-\d"),
    ("Users that no model knows", "adaptive", r"unknown-\d"),
    ("Free manipulation, users that no model knows", "tactile-only", r"manipulation-tactile"),
    ("Free manipulation, users that no model knows", "adaptive", r"manipulation-follow-\d"),
    ("Free manipulation, users that no model knows", "adaptive, calibration alone", r"manipulation-frozen-\d"),
)


def measures(scores):
    """BA %, F1 %, MDF gF, MAE gF, false touches a minute in the air; None where there is none."""
    cell = scores["table"]["rows"][0]["cells"][0]
    mdf = cell["mdf"]
    in_air = next((of["in_air"] for of in scores["models"][0]["contacts"].values() if of.get("in_air")), None)
    return (
        100 * cell["ba"],
        100 * cell["f1"],
        mdf["force_gf"] if mdf.get("mdf") == "crossed" else None,
        cell["mae_gf"],
        in_air["per_minute"] if in_air else None,
    )


def spread(values):
    known = [value for value in values if value is not None]
    if not known:
        return "none"
    text = f"{statistics.mean(known):.2f}"
    if len(known) > 1:
        text += f" ± {statistics.stdev(known):.2f}"
    return text if len(known) == len(values) else f"{text} ({len(known)} of {len(values)})"


found = defaultdict(list)
for path in sorted(Path(sys.argv[1]).glob("[0-9]-*.json")):
    glove, name = path.stem.split("-", 1)
    for title, shown, pattern in ROWS:
        if re.fullmatch(pattern, name):
            found[title, glove, shown].append(measures(json.loads(path.read_text())))
print("SYNTHETIC data. Mean ± standard deviation over training seeds, or over the users that were left out.")
for title in dict.fromkeys(title for title, _, _ in ROWS):
    print(f"\n### {title}\n\n| glove | model | BA % | F1 % | MDF gF | MAE gF | false touches/min in the air |")
    print("|---|---|---|---|---|---|---|")
    for glove in sorted({glove for of, glove, _ in found if of == title}):
        for of, shown, _ in ROWS:
            rows = found.get((title, glove, shown)) if of == title else None
            if rows:
                print(f"| {glove} | {shown} | " + " | ".join(spread(column) for column in zip(*rows, strict=True)) + " |")
