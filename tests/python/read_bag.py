"""Reads a bag folder with three independent readers and prints every message as one JSON line.

usage: read_bag.py FOLDER FILE.mcap
Each line: [reader, topic, log time, fields]. A number is told by its bits, so that NaN and every last digit survive.
"""

import json
import struct
import sys
from dataclasses import fields, is_dataclass
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader


def told(value):
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, bool):
        return value
    if isinstance(value, float):
        return struct.pack(">d", value).hex()
    if isinstance(value, int):
        return value
    if isinstance(value, str):
        return value
    if isinstance(value, (list, tuple)):
        return [told(item) for item in value]
    names = [field.name for field in fields(value)] if is_dataclass(value) else value.__slots__
    return {name: told(getattr(value, name)) for name in names if name.islower() and name[0] != "_"}


def line(reader, topic, log_time, message):
    print(json.dumps([reader, topic, log_time, told(message)], sort_keys=True))


folder, file = Path(sys.argv[1]), Path(sys.argv[2])

with file.open("rb") as stream:
    reader = make_reader(stream, decoder_factories=[DecoderFactory()], validate_crcs=True)
    summary = reader.get_summary()
    assert summary.statistics.message_count > 0, "no statistics"
    for _schema, channel, message, decoded in reader.iter_decoded_messages():
        line("mcap_ros2", channel.topic, message.log_time, decoded)

with Reader(folder) as bag:
    n_messages = sum(1 for _ in bag.messages())
    assert bag.message_count == n_messages == summary.statistics.message_count, "metadata.yaml counts wrong"
    digests = {connection.topic: connection.digest for connection in bag.connections}
    print(json.dumps(["digests", digests]))

with AnyReader([folder]) as bag:
    for connection, log_time, raw in bag.messages():
        line("rosbags", connection.topic, log_time, bag.deserialize(raw, connection.msgtype))
