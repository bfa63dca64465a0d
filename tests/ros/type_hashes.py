"""Hashes of message, service and action types as ROS 2 itself has them: those of its packages as they are installed,
those of ours as its own generator makes them."""
import contextlib
import json
import os
import sys
import tempfile
from pathlib import Path

from rosidl_adapter.action import convert_action_to_idl
from rosidl_adapter.msg import convert_msg_to_idl
from rosidl_generator_type_description import generate_type_hash

SHARE = Path(os.environ["AMENT_PREFIX_PATH"]) / "share"
ROOT = Path(__file__).parents[2]
DEPENDENCIES = ["action_msgs", "builtin_interfaces", "service_msgs", "std_msgs", "unique_identifier_msgs"]


def _of(path):
    return {entry["type_name"]: entry["hash_string"] for entry in json.loads(path.read_text())["type_hashes"]}


def _ours():
    hashes = {}
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(sys.stderr):
        folder = Path(folder)
        sources = [*ROOT.glob("msg/*.msg"), *ROOT.glob("action/*.action")]
        idl = []
        for source in sources:
            kind = source.suffix[1:]
            (folder / kind).mkdir(exist_ok=True)
            (folder / kind / source.name).write_text(source.read_text())
            convert = {"msg": convert_msg_to_idl, "action": convert_action_to_idl}[kind]
            convert(folder, "tactile_pose_fusion", Path(kind) / source.name, folder / kind)
            idl.append(f"{folder}:{kind}/{source.stem}.idl")
        arguments = {
            "package_name": "tactile_pose_fusion",
            "output_dir": str(folder / "out"),
            "idl_tuples": idl,
            "include_paths": [f"{package}:{SHARE / package}" for package in DEPENDENCIES],
        }
        (folder / "arguments.json").write_text(json.dumps(arguments))
        generate_type_hash(str(folder / "arguments.json"))
        for path in (folder / "out").rglob("*.json"):
            hashes |= _of(path)
    return hashes


OURS = _ours()


def type_hash(type_name):
    """Of a name such as std_msgs/msg/Header."""
    if type_name.startswith("tactile_pose_fusion/"):
        return OURS[type_name]
    return _of(SHARE / f"{type_name}.json")[type_name]
