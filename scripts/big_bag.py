"""Writes a large bag, replays it under a limit of memory, and prints what it took. Run by scripts/big-bag.

usage: big_bag.py TPF GB MEMORY_MIB
"""

import os
import resource
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from mcap.writer import CompressionType, Writer

MS = 1_000_000
T0 = 1_700_000_000_000_000_000
IMAGE = 1 << 20
IMAGES_PER_FRAME = 1
PARAMS = """/**:
  ros__parameters:
    regions: [index]
    tactile_sources: [glove]
    joint_sources: [hand]
    tactile.glove: {topic: /taxels, n_taxels: 6}
    joint.hand: {topic: /joints}
    model.tip: {path: %s}
    calibration.max_force: 1000.0
    region.index: {model: tip, joints: [index_dip, index_pip, index_mcp_flex, index_mcp_abd], frame_id: index_tip}
"""
JOINTS = ["index_dip", "index_pip", "index_mcp_flex", "index_mcp_abd"]
HEADER = "std_msgs/Header header\n"
DEFINED = (
    "=" * 80
    + "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    + "=" * 80
    + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
)
TAXELS = HEADER + "uint32 sequence\nuint32 rows\nbuiltin_interfaces/Duration row_period\nfloat32[] values\n" + DEFINED
TAXELS += "=" * 80 + "\nMSG: builtin_interfaces/Duration\nint32 sec\nuint32 nanosec\n"
STATE = HEADER + "string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n" + DEFINED


def header(at):
    """A `std_msgs/Header` without a frame."""
    return struct.pack("<iiI", at // 10**9, at % 10**9, 1) + b"\0"


def padded(cdr, alignment):
    return cdr + bytes(-len(cdr) % alignment)


def taxels(at, k):
    cdr = padded(header(at), 4) + struct.pack("<IIiI", k, 1, 0, 0)
    return b"\0\1\0\0" + cdr + struct.pack("<I6f", 6, *[float(k % 3 + idx) for idx in range(6)])


def joints(at):
    cdr = padded(header(at), 4) + struct.pack("<I", len(JOINTS))
    for name in JOINTS:
        cdr = padded(cdr, 4) + struct.pack("<I", len(name) + 1) + name.encode() + b"\0"
    cdr = padded(padded(cdr, 4) + struct.pack("<I", len(JOINTS)), 8) + struct.pack("<4d", 0.1, 0.2, 0.3, 0.0)
    return b"\0\1\0\0" + cdr + struct.pack("<II", 0, 0)


def write(path, size):
    noise = [os.urandom(IMAGE) for _ in range(8)]
    with open(path, "wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD, chunk_size=4 << 20)
        writer.start(profile="ros2", library="big_bag")
        schema = lambda name, text: writer.register_schema(name, "ros2msg", text.encode())
        channel = lambda topic, schema: writer.register_channel(topic, "cdr", schema)
        camera = channel("/camera", schema("std_msgs/msg/UInt8MultiArray", "uint8[] data\n"))
        glove = channel("/taxels", schema("tactile_pose_fusion/msg/TaxelArray", TAXELS))
        hand = channel("/joints", schema("sensor_msgs/msg/JointState", STATE))
        k = 0
        while file.tell() < size or k < 1000:
            at = T0 + 10 * MS * k
            writer.add_message(hand, at, joints(at), at)
            writer.add_message(glove, at + MS, taxels(at + MS, k), at + MS)
            for idx in range(IMAGES_PER_FRAME):
                writer.add_message(camera, at + 2 * MS, b"\0\1\0\0" + noise[(k + idx) % 8], at + 2 * MS)
            k += 1
        writer.finish()
    return k


tpf, gb, memory_mib = sys.argv[1], float(sys.argv[2]), int(sys.argv[3])
root = Path(__file__).resolve().parent.parent
with tempfile.TemporaryDirectory(dir=root / "target") as folder:
    bag, params = Path(folder) / "big.mcap", Path(folder) / "params.yaml"
    params.write_text(PARAMS % (root / "models/glove1_pose_aware.onnx"))
    n_frames = write(bag, gb * 1e9)
    print(f"{bag.stat().st_size / 1e9:.2f} GB, {n_frames} frames", flush=True)
    limit = lambda: resource.setrlimit(resource.RLIMIT_AS, (memory_mib << 20, memory_mib << 20))
    command = [tpf, "replay", bag, "--params-file", params, "-o", Path(folder) / "out.mcap", "--calibrate-first", "3"]
    for more in [[], ["--merge", "--overwrite"]]:
        started = time.monotonic()
        subprocess.run([*command, "--backend", "rten", *more], check=True, preexec_fn=limit, stdout=subprocess.DEVNULL)
        peak_mib = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
        words = " ".join(more) or "estimates alone"
        print(f"{words}: {time.monotonic() - started:.0f} s, peak {peak_mib:.0f} MiB resident, limit {memory_mib} MiB", flush=True)
