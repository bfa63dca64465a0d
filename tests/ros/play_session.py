"""Plays a bag's taxels and joint angles to the node and writes down what the node answers.

rclpy (Fast DDS) publishes the joint angles and, as sensor_msgs/LaserScan, the taxels, and receives the wrench. Cyclone
DDS receives the contacts, for which rclpy has no type. With `cyclone` it publishes everything, taxels as TaxelArray."""
import json
import sys
import time

import rclpy
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter, Publisher
from cyclonedds.sub import DataReader, Subscriber
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from geometry_msgs.msg import WrenchStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState, LaserScan

import bag
import messages

bag_path, speed, who, node_name, taxels, joints = sys.argv[1], float(sys.argv[2]), *sys.argv[3:7]
RELIABLE = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
CYCLONE = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(1000))

rclpy.init()
node = rclpy.create_node("session")
wrenches, contacts = [], []


def numbers(*values):
    return [repr(value) for value in values]  # as text, which is read back to the last bit


def on_wrench(message):
    force, torque = message.wrench.force, message.wrench.torque
    stamp = messages.nanos(message.header.stamp)
    values = numbers(force.x, force.y, force.z, torque.x, torque.y, torque.z)
    wrenches.append([stamp, message.header.frame_id, values])


node.create_subscription(WrenchStamped, f"{node_name}/index/wrench", on_wrench, RELIABLE)
participant = DomainParticipant(0)
reader = DataReader(
    Subscriber(participant), Topic(participant, f"rt{node_name}/contacts", messages.ContactArray), qos=CYCLONE
)

if who == "cyclone":
    publisher = Publisher(participant)
    taxel_writer = DataWriter(publisher, Topic(participant, f"rt{taxels}", messages.TaxelArray), qos=CYCLONE)
    joint_writer = DataWriter(publisher, Topic(participant, f"rt{joints}", messages.JointState), qos=CYCLONE)
else:
    taxel_publisher = node.create_publisher(LaserScan, taxels, RELIABLE)
    joint_publisher = node.create_publisher(JointState, joints, RELIABLE)


def matched():
    if who == "cyclone":
        found = all(w.get_matched_subscriptions() for w in (taxel_writer, joint_writer))
    else:
        found = all(p.get_subscription_count() for p in (taxel_publisher, joint_publisher))
    return found and node.count_publishers(f"{node_name}/index/wrench") and reader.get_matched_publications()


def receive():
    while True:
        before = len(wrenches)
        rclpy.spin_once(node, timeout_sec=0)
        if len(wrenches) == before:
            break
    for array in reader.take(1000):
        states = [
            [c.region, c.contact_raw, c.contact, c.event, c.flags, numbers(c.force, c.force_base, c.pose_age)]
            for c in array.contacts
        ]
        contacts.append([messages.nanos(array.header.stamp), *states])


deadline = time.monotonic() + 20
while not matched():
    assert time.monotonic() < deadline, "the node was not found"
    rclpy.spin_once(node, timeout_sec=0.05)
time.sleep(3.0)  # the node's half of discovery has no event here; on a busy machine it takes a while

# The most frames on their way at once: on a busy machine, more than a history holds would be lost.
AHEAD = 300
unanswered = 0  # frames that nobody answers, as those before the window is full: no answer came for a second


def wait_for_answers(n_frames):
    global unanswered
    came, n_answers = time.monotonic(), len(wrenches)
    while n_frames - len(wrenches) - unanswered > AHEAD:
        receive()
        if n_answers != len(wrenches):
            came, n_answers = time.monotonic(), len(wrenches)
        elif time.monotonic() - came > 1.0:
            unanswered = n_frames - len(wrenches)
        time.sleep(0.0005)


first, n_frames = None, 0
started = time.monotonic()
for topic, log_time, message in bag.samples(bag_path, taxels, joints):
    first = log_time if first is None else first
    receive()  # also when this process is late: what is not taken in time is lost
    while time.monotonic() - started < (log_time - first) * 1e-9 / speed:
        receive()
        time.sleep(0.0005)
    wait_for_answers(n_frames)
    n_frames += topic == taxels
    stamp = message.header.stamp
    if who == "cyclone":
        header = messages.Header(messages.Time(stamp.sec, stamp.nanosec), "")
        if topic == taxels:
            period = messages.Duration(0, 0)
            taxel_writer.write(messages.TaxelArray(header, message.sequence, 1, period, list(message.values)))
        else:
            joint_writer.write(messages.JointState(header, list(message.name), list(message.position), [], []))
    elif topic == taxels:
        out = LaserScan(ranges=list(message.values))
        out.header.stamp.sec, out.header.stamp.nanosec = stamp.sec, stamp.nanosec
        taxel_publisher.publish(out)
    else:
        out = JointState(name=list(message.name), position=list(message.position))
        out.header.stamp.sec, out.header.stamp.nanosec = stamp.sec, stamp.nanosec
        joint_publisher.publish(out)
ended = time.monotonic()
quiet, n_answers = ended + 1.0, len(wrenches)
while time.monotonic() < min(quiet, ended + 60):
    receive()
    if n_answers != len(wrenches):  # contacts come all the time, also of a glove that is silent
        quiet, n_answers = time.monotonic() + 1.0, len(wrenches)
    time.sleep(0.002)
print(json.dumps({"wrenches": wrenches, "contacts": contacts}))
rclpy.shutdown()
