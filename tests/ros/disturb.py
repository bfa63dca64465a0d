"""Peers that misbehave. disturb.py HOW, one of those at the end."""
import sys
import time

import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState, LaserScan
from std_msgs.msg import String

RELIABLE = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)


def wrong_type():
    """Another type on the topic of the taxels."""
    rclpy.init()
    node = rclpy.create_node("wrong")
    publisher = node.create_publisher(String, "/taxels", RELIABLE)
    for _ in range(100):
        publisher.publish(String(data="not taxels"))
        time.sleep(0.01)


def malformed():
    """Bytes that are no message of the type that they claim to be."""
    rclpy.init()
    node = rclpy.create_node("malformed")
    publisher = node.create_publisher(LaserScan, "/taxels", RELIABLE)
    while not publisher.get_subscription_count():
        time.sleep(0.05)
    good = serialize_message(LaserScan(ranges=[1.0, 2.0]))
    huge = bytearray(good)
    huge[-16:-12] = b"\xff\xff\xff\xff"
    for n in range(200):
        publisher.publish(bytes(good[: 4 + n % (len(good) - 4)]))
        publisher.publish(bytes(huge))
        time.sleep(0.005)


def restarts():
    """200 peers, one after the other, each with readers and writers of the node's topics."""
    from cyclonedds.core import Policy, Qos
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.pub import DataWriter
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic
    from cyclonedds.util import duration

    import messages

    qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(10))
    for n in range(int(sys.argv[2])):
        participant = DomainParticipant(0)
        reader = DataReader(participant, Topic(participant, "rt/tactile_pose_fusion/contacts", messages.ContactArray), qos=qos)
        writer = DataWriter(participant, Topic(participant, "rt/joints", messages.JointState), qos=qos)
        deadline = time.monotonic() + 5
        while not (writer.get_matched_subscriptions() and reader.get_matched_publications()) and time.monotonic() < deadline:
            time.sleep(0.005)
        del reader, writer, participant


def frozen():
    """A reliable subscriber of the wrench, to be stopped from outside."""
    from geometry_msgs.msg import WrenchStamped

    rclpy.init()
    node = rclpy.create_node("frozen")
    node.create_subscription(WrenchStamped, "/tactile_pose_fusion/index/wrench", lambda _: None, RELIABLE)
    end = time.monotonic() + 60
    print("ready", flush=True)
    while time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)


hows = [wrong_type, malformed, restarts, frozen]
{how.__name__: how for how in hows}[sys.argv[1]]()
