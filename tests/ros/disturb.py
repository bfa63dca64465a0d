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


def requests():
    """Requests for parameters that are too large, of every service. Prints how long the slowest took to be answered, s."""
    from rcl_interfaces import srv
    from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue

    rclpy.init()
    node = rclpy.create_node("asker")
    number = ParameterValue(type=ParameterType.PARAMETER_INTEGER, integer_value=3)
    many = [Parameter(name="contact.on_frames", value=number)] * 60_000
    text = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value="x" * 1_000_000)
    long = [Parameter(name="contact.on_frames", value=text)]
    names = ["contact.on_frames"] * 60_000
    asked = [
        (srv.SetParameters, dict(parameters=many), lambda r: len(r.results) == 60_000 and "60000" in r.results[0].reason),
        (srv.SetParameters, dict(parameters=long), lambda r: "bytes" in r.results[0].reason),
        (srv.SetParametersAtomically, dict(parameters=many), lambda r: "60000" in r.result.reason),
        (srv.GetParameters, dict(names=names), lambda r: len(r.values) == 0),
        (srv.GetParameterTypes, dict(names=names), lambda r: len(r.types) == 0),
        (srv.DescribeParameters, dict(names=names), lambda r: len(r.descriptors) == 0),
        (srv.ListParameters, dict(prefixes=names), lambda r: len(r.result.names) == 0),
        (srv.ListParameters, dict(depth=2**64 - 1), lambda r: len(r.result.names) > 50),
    ]
    slowest = 0.0
    for kind, fields, refused in asked:
        name = "".join("_" + letter.lower() if letter.isupper() else letter for letter in kind.__name__).strip("_")
        client = node.create_client(kind, f"/tactile_pose_fusion/{name}")
        assert client.wait_for_service(10.0), name
        request = kind.Request(**fields)
        begun = time.monotonic()
        future = client.call_async(request)
        rclpy.spin_until_future_complete(node, future, timeout_sec=20.0)
        assert future.done(), f"{name} did not answer"
        slowest = max(slowest, time.monotonic() - begun)
        assert refused(future.result()), (name, str(future.result())[:300])
        node.destroy_client(client)
    print(slowest, flush=True)


def busy():
    """As many requests as are taken at once, for ever. Says `busy` when the first was answered."""
    from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
    from rcl_interfaces.srv import SetParameters

    rclpy.init()
    node = rclpy.create_node("busy")
    number = ParameterValue(type=ParameterType.PARAMETER_INTEGER, integer_value=3)
    client = node.create_client(SetParameters, "/tactile_pose_fusion/set_parameters")
    assert client.wait_for_service(10.0)
    request = SetParameters.Request(parameters=[Parameter(name="contact.on_frames", value=number)] * 1000)
    futures = [client.call_async(request) for _ in range(8)]
    rclpy.spin_until_future_complete(node, futures[0])
    print("busy", flush=True)
    while True:
        futures = [f for f in futures if not f.done()] + [client.call_async(request) for f in futures if f.done()]
        rclpy.spin_once(node, timeout_sec=0.05)


def flood():
    """Datagrams that are RTPS by their first bytes, to every socket of the first participant, as fast as they go."""
    import socket

    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    message = b"RTPS\x02\x03\x01\x0f" + bytes(12) + b"\x07\x01\x1c\x00" + bytes(28)
    end = time.monotonic() + float(sys.argv[2])
    print("ready", flush=True)
    while time.monotonic() < end:
        for port in (7400, 7401, 7410, 7411):
            for _ in range(100):
                sender.sendto(message, ("127.0.0.1", port))


hows = [wrong_type, malformed, restarts, frozen, requests, busy, flood]
{how.__name__: how for how in hows}[sys.argv[1]]()
