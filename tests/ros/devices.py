"""Publishes what the devices' own drivers would: the messages of bags, with the stamps of now.

devices.py NAME... plays NAME/glove.mcap, each topic that isn't a device's own in the namespace /NAME. Types that rclpy has
(std_msgs, sensor_msgs, geometry_msgs) go through rclpy; the others through Cyclone DDS, in Python types that are made here from
the definitions in the bag, because they have no build. It prints how many messages each topic was given."""
import dataclasses
import importlib
import json
import sys
import time
import types

import rclpy
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl import types as idl
from cyclonedds.pub import DataWriter, Publisher
from cyclonedds.topic import Topic
from mcap.reader import make_reader
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

BEST_EFFORT = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
CYCLONE = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(100))
FROM_S = 3.0  # of each bag: a part with a press is enough
SCALARS = {"bool": bool, "string": str, "byte": idl.uint8, "char": idl.uint8}
SCALARS |= {name: getattr(idl, name) for name in ("int8 uint8 int16 uint16 int32 uint32 int64 uint64 float32 float64".split())}


def rclpy_type(name):
    package, _, short = name.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), short)
    except ImportError:
        return None


def cyclone_type(name, schema, made):
    """The class of a message type, from the text of its definition and those of the types in it."""
    texts = {name: []}
    current = name
    for line in schema.splitlines():
        line = line.split("#")[0].strip()
        if line.startswith("MSG: "):
            package, short = line[5:].split("/")[0], line.split("/")[-1]
            current = f"{package}/msg/{short}"
            texts[current] = []
        elif line and not line.startswith("==="):
            texts[current].append(line.split()[:2])

    def of(full):
        if full not in made:
            fields = {field: of_field(ty, full.split("/")[0]) for ty, field in texts[full]}
            package, _, short = full.split("/")
            body = {"__annotations__": fields, "__module__": __name__}
            typename = f"{package}.msg.dds_.{short}_"
            made[full] = dataclasses.dataclass(types.new_class(short, (IdlStruct,), {"typename": typename}, lambda ns: ns.update(body)))
        return made[full]

    def of_field(ty, package):
        base, _, count = ty.rstrip("]").partition("[")
        if base in SCALARS:
            inner = SCALARS[base]
        elif "/" in base:
            inner = of("{}/msg/{}".format(base.split("/")[0], base.split("/")[-1]))
        else:
            inner = of(f"{package}/msg/{base}")
        if "[" not in ty:
            return inner
        return idl.array[inner, int(count)] if count else idl.sequence[inner]

    return of(name)


rclpy.init()
node = rclpy.create_node("devices")
participant = DomainParticipant(0)
publisher = Publisher(participant)
made, speakers, planned = {}, {}, []
for name in sys.argv[1:]:
    with open(f"{name}/glove.mcap", "rb") as file:
        first = None
        for schema, channel, message in make_reader(file).iter_messages():
            first = message.log_time if first is None else first
            if message.log_time - first < FROM_S * 1e9:
                continue
            topic = f"/{name}{channel.topic}" if channel.topic == "/glove/taxels" else channel.topic
            if topic not in speakers:
                cls = rclpy_type(schema.name)
                if cls is not None:
                    speakers[topic] = cls, node.create_publisher(cls, topic, BEST_EFFORT)
                else:
                    cls = cyclone_type(schema.name, schema.data.decode(), made)
                    speakers[topic] = cls, DataWriter(publisher, Topic(participant, f"rt{topic}", cls), qos=CYCLONE)
            cls, speaker = speakers[topic]
            is_cyclone = isinstance(speaker, DataWriter)
            decoded = cls.deserialize(message.data) if is_cyclone else deserialize_message(message.data, cls)
            planned.append((message.log_time, topic, decoded))
planned.sort(key=lambda one: one[0])


def is_heard(speaker):
    if isinstance(speaker, DataWriter):
        return speaker.get_matched_subscriptions()
    return speaker.get_subscription_count()


deadline = time.monotonic() + 30
while not all(is_heard(speaker) for _, speaker in speakers.values()):
    missing = [topic for topic, (_, speaker) in speakers.items() if not is_heard(speaker)]
    assert time.monotonic() < deadline, f"no node hears {missing}"
    rclpy.spin_once(node, timeout_sec=0.05)
time.sleep(3.0)  # the nodes' half of discovery has no event here; on a busy machine it takes a while

begin, started = planned[0][0], time.monotonic()
counts = dict.fromkeys(speakers, 0)
for log_time, topic, message in planned:
    time.sleep(max(0.0, started + (log_time - begin) * 1e-9 - time.monotonic()))
    if hasattr(message, "header"):
        stamp = time.time_ns()  # as a driver does it, also where this process is late
        message.header.stamp.sec, message.header.stamp.nanosec = stamp // 10**9, stamp % 10**9
    _, speaker = speakers[topic]
    speaker.write(message) if isinstance(speaker, DataWriter) else speaker.publish(message)
    counts[topic] += 1
time.sleep(0.5)  # so that the last messages are there before this participant leaves
print(json.dumps(counts))
rclpy.shutdown()
