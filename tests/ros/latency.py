"""Latency of the node beside a bare echo on ros2-client and a node in rclpy, as a table. Run it by `just latency MODEL`.

latency.py BINARIES MODEL [SECONDS]: a model of 6 taxels and 4 joints, as those of the synthetic gloves are."""
import glob
import json
import os
import subprocess
import sys
import tempfile
import time

assert os.environ.get("TPF_ISOLATED") == "1", "run it by tests/ros/isolated"
binaries, model = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
seconds = float(sys.argv[3]) if len(sys.argv) > 3 else 10.0
here = os.path.dirname(os.path.abspath(__file__))
scratch = tempfile.TemporaryDirectory()
folder = scratch.name
venv = sys.prefix
library = glob.glob(f"{venv}/lib/python*/site-packages/onnxruntime/capi/libonnxruntime.so.*")
env = dict(os.environ, AMENT_PREFIX_PATH=venv, ROS_LOG_DIR=folder, ORT_DYLIB_PATH=library[0] if library else "")
peer = [f"{binaries}/examples/ros2_latency"]


def parameters(n_regions, backend):
    regions = [f"r{k}" for k in range(1, n_regions + 1)]
    lines = [
        "/**:", "  ros__parameters:", f"    regions: [{', '.join(regions)}]", "    tactile_sources: [glove]",
        "    joint_sources: [hand]",
        "    tactile.glove: {topic: /taxels, type: sensor_msgs/msg/JointState, field: position, n_taxels: 6}",
        "    joint.hand: {topic: /joints}", f"    model.tip: {{path: {model}, backend: {backend}}}",
    ]
    lines += [f"    region.{r}: {{model: tip, joints: [index_dip, index_pip, index_mcp_flex, index_mcp_abd], frame_id: tip}}" for r in regions]
    path = f"{folder}/{n_regions}_{backend}.yaml"
    open(path, "w").write("\n".join(lines) + "\n")
    return path


def tpf(n_regions, backend):
    calibration = f"{folder}/calibration.yaml"
    open(calibration, "w").write(
        "format: tactile_pose_fusion/calibration/1\nglove: ''\nuser: ''\nmodels: {}\nrecorded: none\nsources:\n  glove:\n"
        "    median: [11.0, 11.0, 11.0, 11.0, 11.0, 11.0]\n    noise: [1.0, 1.0, 1.0, 1.0, 1.0, 1.0]\n"
        "    faulty: [false, false, false, false, false, false]\n"
    )
    return [f"{binaries}/tpf", "run", "--params-file", parameters(n_regions, backend), "--calibration", calibration]


runs = [
    ("ros2-client, bare echo", [f"{binaries}/examples/ros2_echo"], "/ros2_echo/index/wrench"),
    ("tpf run, 1 region", tpf(1, "builtin"), "/tactile_pose_fusion/r1/wrench"),
    ("tpf run, 5 regions", tpf(5, "builtin"), "/tactile_pose_fusion/r5/wrench"),
    ("tpf run, 1 region, ONNX Runtime", tpf(1, "onnxruntime"), "/tactile_pose_fusion/r1/wrench"),
    ("tpf run, 5 regions, ONNX Runtime", tpf(5, "onnxruntime"), "/tactile_pose_fusion/r5/wrench"),
    ("rclpy and onnxruntime, 1 region", [sys.executable, f"{here}/rclpy_node.py", model], "/rclpy_node/index/wrench"),
]
print("| what | rate | answers | p50 us | p99 us | max us |\n|---|---|---|---|---|---|", flush=True)
for rate in (100, 1000):
    for name, command, topic in runs:
        with open(f"{folder}/log", "w") as log:
            node = subprocess.Popen(command, env=env, stderr=log, stdout=log)
            try:
                time.sleep(6)  # Python takes its time to import
                receiver = subprocess.Popen([*peer, "receive", topic, str(seconds + 6)], env=env, stdout=subprocess.PIPE, text=True)
                time.sleep(1.5)
                subprocess.run([*peer, "send", str(rate), str(seconds)], env=env, check=True)
                got = json.loads(receiver.communicate(timeout=seconds + 10)[0].splitlines()[-1])
            finally:
                node.terminate()
                try:
                    node.wait(5)
                except subprocess.TimeoutExpired:
                    node.kill()
        if not got["n"]:
            print(open(f"{folder}/log").read(), file=sys.stderr)
        row = [name, f"{rate} Hz", f"{got['n']} of {int(rate * seconds)}", got["p50"], got["p99"], got["max"]]
        print("| " + " | ".join(str(cell) for cell in row) + " |", flush=True)
