"""ONNX Runtime by itself on windows that lie ready in memory, in batches of several sizes: what a replay could at best
reach that hands it one window after the other.

ready_made.py MODEL [SECONDS a size]. Prints JSON: windows a second by batch size."""
import json
import sys
import time

import numpy as np

from peer import open_model

SIZES = (1, 8, 16, 32, 64, 128, 256)

session, _, _ = open_model(sys.argv[1])
seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 2.0
shapes = {tensor.name: tensor.shape[1:] for tensor in session.get_inputs()}
random = np.random.default_rng(1)
rates = {}
for size in SIZES:
    batch = {name: random.standard_normal([size, *shape], np.float32) for name, shape in shapes.items()}
    session.run(["force", "force_base"], batch)
    n, start = 0, time.perf_counter()
    while time.perf_counter() - start < seconds:
        session.run(["force", "force_base"], batch)
        n += size
    rates[size] = round(n / (time.perf_counter() - start), 1)
print(json.dumps(rates))
