"""Writes a recording in every form of rosbag2's sqlite3 storage, and prints what rosbags reads of each as JSON lines.

usage: sqlite_bags.py FILE.mcap FOLDER
Each line: [name of the bag, [[topic, type, time, SHA-256 of the data], ...]] in the order of rosbags' reader.
"""

import hashlib
import json
import sys
from pathlib import Path

from mcap.reader import make_reader
from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore, get_types_from_msg


def write(source, path, version, mode, plugin=StoragePlugin.SQLITE3):
    writer = Writer(path, version=version, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections = {}
        with source.open("rb") as stream:
            for schema, channel, message in make_reader(stream).iter_messages():
                if channel.topic not in connections:
                    store = get_typestore(Stores.EMPTY)
                    store.register(get_types_from_msg(schema.data.decode(), schema.name))
                    connections[channel.topic] = writer.add_connection(channel.topic, schema.name, typestore=store)
                writer.write(connections[channel.topic], message.log_time, message.data)


def main():
    source, folder = Path(sys.argv[1]), Path(sys.argv[2])
    modes = {"plain": CompressionMode.NONE, "file": CompressionMode.FILE, "message": CompressionMode.MESSAGE}
    for version in (8, 9):
        for name, mode in modes.items():
            write(source, folder / f"{name}{version}", version, mode)
    write(source, folder / "mcap_file", 9, CompressionMode.FILE, StoragePlugin.MCAP)
    write(source, folder / "mcap_message", 9, CompressionMode.MESSAGE, StoragePlugin.MCAP)
    for path in sorted(path for path in folder.iterdir() if (path / "metadata.yaml").is_file()):
        with Reader(path) as reader:
            messages = [
                [connection.topic, connection.msgtype, time, hashlib.sha256(data).hexdigest()]
                for connection, time, data in reader.messages()
            ]
        print(json.dumps([path.name, messages]))


main()
