"""Publishes a hand as frames, as tf2_ros does: those that don't move once on /tf_static, before anyone subscribes, the others on
/tf with stamps of now, and taxels beside them. The frames go through Cyclone DDS, because tf2_msgs has no build for rclpy here. It
says `told` when the frames that don't move are out, and ends when it is killed, or after SECONDS.

frames.py HANDS.json INDEX NAMES SECONDS: the hand with frames at INDEX of tests/data/hand_reference.json, whose points have these
names, separated by commas."""
import json
import sys
import time

import rclpy
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter, Publisher
from cyclonedds.topic import Topic
from messages import Header, Quaternion, TFMessage, Time, Transform, TransformStamped, Vector3
from std_msgs.msg import Float32MultiArray


hand = json.load(open(sys.argv[1]))[int(sys.argv[2])]
names, seconds = sys.argv[3].split(","), float(sys.argv[4])


def transform(child, frame):
    parent = "world" if frame["parent"] is None else names[frame["parent"]]
    placed = Transform(Vector3(*frame["translation"]), Quaternion(*frame["rotation"]))
    return TransformStamped(Header(Time(0, 0), parent), names[child], placed)


frames = [transform(child, frame) for child, frame in enumerate(hand["frames"])]
fixed = [frame for frame in frames if frame.header.frame_id in ("world", names[0])]
moving = [frame for frame in frames if frame.header.frame_id not in ("world", names[0])]
participant = DomainParticipant(0)
publisher = Publisher(participant)
reliable = Policy.Reliability.Reliable(100_000_000)
latched = Qos(reliable, Policy.Durability.TransientLocal, Policy.History.KeepLast(1))
tf_static = DataWriter(publisher, Topic(participant, "rt/tf_static", TFMessage), qos=latched)
tf_static.write(TFMessage(fixed))
tf = DataWriter(publisher, Topic(participant, "rt/tf", TFMessage), qos=Qos(reliable, Policy.History.KeepLast(100)))
rclpy.init()
node = rclpy.create_node("frames")
pressure = node.create_publisher(Float32MultiArray, "/fingertip/pressure", 10)
print("told", flush=True)
start, n = time.monotonic(), 0
while time.monotonic() - start < seconds:
    stamp = time.time_ns()
    for frame in moving:
        frame.header.stamp = Time(stamp // 10**9, stamp % 10**9)
    tf.write(TFMessage(moving))
    pressure.publish(Float32MultiArray(data=[100.0 + k for k in range(6)]))
    n += 1
    time.sleep(max(0.0, start + n / 100.0 - time.monotonic()))
rclpy.shutdown()
