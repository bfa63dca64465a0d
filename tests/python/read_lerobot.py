"""Checks a LeRobotDataset v3 against its documented layout and tells its frames as JSON.

The layout is that of lerobot 0.4.4 (src/lerobot/datasets/utils.py), which is too large to be installed for a test.

usage: read_lerobot.py DATASET
"""

import json
import math
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

root = Path(sys.argv[1])
info = json.loads((root / "meta/info.json").read_text())
stats = json.loads((root / "meta/stats.json").read_text())
features = info["features"]

assert info["codebase_version"] == "v3.0", info
assert info["splits"] == {"train": f"0:{info['total_episodes']}"}, info
assert not any("/" in name for name in features), features
for name in ["timestamp", "frame_index", "episode_index", "index", "task_index"]:
    assert features[name]["shape"] == [1], features[name]
assert features["timestamp"]["dtype"] == "float32"

# Tasks: a data frame whose index is the task.
tasks = pq.read_table(root / "meta/tasks.parquet")
pandas = json.loads(tasks.schema.metadata[b"pandas"])
[index] = pandas["index_columns"]
tasks = dict(zip(tasks["task_index"].to_pylist(), tasks[index].to_pylist()))
assert len(tasks) == info["total_tasks"]

# Frames: scalars, lists of fixed length, lists of lists of fixed shape.
scalars = {"float32": pa.float32(), "int64": pa.int64(), "bool": pa.bool_()}
episodes = pq.read_table(root / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
files = sorted({(row["data/chunk_index"], row["data/file_index"]) for row in episodes})
paths = [root / info["data_path"].format(chunk_index=chunk, file_index=file) for chunk, file in files]
assert paths == sorted(root.glob("data/*/*.parquet")), paths
table = pa.concat_tables([pq.read_table(path) for path in paths])
assert set(table.column_names) == set(features), table.column_names
for name, feature in features.items():
    expected, kind = table.schema.field(name).type, scalars[feature["dtype"]]
    for _ in range(0 if feature["shape"] == [1] else len(feature["shape"])):
        assert pa.types.is_list(expected), (name, expected)
        expected = expected.value_type
    assert expected == kind, (name, expected, feature)
    assert table[name].null_count == 0, name
columns = {name: table[name].to_pylist() for name in table.column_names}
for name, feature in features.items():
    shape = feature["shape"]
    if shape != [1]:
        assert all(len(cell) == shape[0] for cell in columns[name]), name
    if len(shape) == 2:
        assert all(len(row) == shape[1] for cell in columns[name] for row in cell), name
    if feature["names"]:
        assert len(feature["names"]) == shape[0], feature

n = info["total_frames"]
assert table.num_rows == n == sum(row["length"] for row in episodes)
assert columns["index"] == list(range(n))
assert [row["episode_index"] for row in episodes] == list(range(info["total_episodes"]))
for row in episodes:
    frames = range(row["dataset_from_index"], row["dataset_to_index"])
    assert row["tasks"] == [tasks[0]] and len(frames) == row["length"]
    assert {columns["episode_index"][idx] for idx in frames} == {row["episode_index"]}
    assert [columns["frame_index"][idx] for idx in frames] == list(range(row["length"]))
    for k, idx in enumerate(frames):
        # As LeRobot checks it: within 0.1 ms of frame / fps.
        assert abs(columns["timestamp"][idx] - k / info["fps"]) < 1e-4
        first = columns["stamp_ns"][frames[0]]
        assert columns["stamp_ns"][idx] == first + k * 1_000_000_000 // info["fps"]


def flat(cell):
    return [value for one in cell for value in flat(one)] if isinstance(cell, list) else [float(cell)]


# Statistics: those of all finite values, one a last dimension.
for name, feature in features.items():
    values = [flat(cell) for cell in columns[name]]
    width = feature["shape"][-1]
    for part in range(width):
        finite = [value for frame in values for value in frame[part::width] if math.isfinite(value)]
        if not finite:
            assert name not in stats, name
            continue
        told = stats[name]
        mean = sum(finite) / len(finite)
        assert told["min"][part] == min(finite) and told["max"][part] == max(finite), name
        assert math.isclose(told["mean"][part], mean, rel_tol=1e-6, abs_tol=1e-9) or len(episodes) > 1, name
        assert len(told["count"]) == 1 and all(len(told[key]) == width for key in told if key != "count"), name

# JSON has no NaN.
def without_nan(cell):
    if isinstance(cell, list):
        return [without_nan(one) for one in cell]
    return None if isinstance(cell, float) and not math.isfinite(cell) else cell


columns = {name: without_nan(cells) for name, cells in columns.items()}
json.dump({"info": info, "tasks": tasks, "stats": stats, "columns": columns}, sys.stdout, allow_nan=False)
