"""The node on Zenoh as a peer of rmw_zenoh meets it. Each check says what it found wrong.

zenoh_peer.py CHECK, one of those at the end. CDR is written and read by rclpy, and by Cyclone DDS where rclpy has no
type; neither of them is on the network here."""
import json
import os
import signal
import sys
import threading
import time
import uuid

# Zenoh logs to stdout, also while a session closes: what this peer answers has a stdout of its own.
sys.stdout = os.fdopen(os.dup(1), "w", buffering=1)
os.dup2(2, 1)

from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.msg import Log, Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState, LaserScan
from std_srvs.srv import Trigger

import bag
import glove
import messages as m
from rmw_zenoh import Node, canonical, gid, wait
from type_hashes import type_hash

NODE = "/tactile_pose_fusion"
node = Node("peer")


def numbers(*values):
    return [repr(value) for value in values]  # as text, which is read back to the last bit


def service(name, kind, type_name, **fields):
    return deserialize_message(node.call(f"{NODE}/{name}", type_name, serialize_message(kind.Request(**fields))), kind.Response)


def own(kind, name):
    """A token of the node under test."""
    return node.tokens(lambda token: (token.kind, token.name) == (kind, name))


def session(bag_path, speed, taxels, joints, who="peer"):
    """Plays a bag to the node, unless another process does, and prints what the node answers."""
    wrenches = node.listen(f"{NODE}/index/wrench", "geometry_msgs/msg/WrenchStamped")
    contacts = node.listen(f"{NODE}/contacts", "tactile_pose_fusion/msg/ContactArray")
    if who == "peer":
        publish_taxels = node.publisher(taxels, "sensor_msgs/msg/LaserScan")
        publish_joints = node.publisher(joints, "sensor_msgs/msg/JointState")
    wait(lambda: own("MS", taxels) and own("MP", f"{NODE}/contacts"), "the node")
    time.sleep(2.0)  # tokens come before routes do
    if who == "peer":
        play(bag_path, float(speed), taxels, publish_taxels, publish_joints)
    else:
        print("ready", flush=True)
        sys.stdin.readline()
    time.sleep(1.0)
    answers = {"wrenches": [], "contacts": []}
    for cdr, sequence, sender in wrenches:
        message = deserialize_message(cdr, WrenchStamped)
        force, torque = message.wrench.force, message.wrench.torque
        values = numbers(force.x, force.y, force.z, torque.x, torque.y, torque.z)
        answers["wrenches"].append([m.nanos(message.header.stamp), message.header.frame_id, values])
    for cdr, _, _ in contacts:
        array = m.ContactArray.deserialize(cdr)
        states = [
            [c.region, c.contact_raw, c.contact, c.event, c.flags, numbers(c.force, c.force_base, c.pose_age)]
            for c in array.contacts
        ]
        answers["contacts"].append([m.nanos(array.header.stamp), *states])
    sequences = [sequence for _, sequence, _ in wrenches]
    assert sequences == list(range(sequences[0], sequences[0] + len(sequences))), "messages are numbered one by one"
    # Under load an answer may hold nothing of the graph.
    (token,) = wait(lambda: own("MP", f"{NODE}/index/wrench"), "the token of its publisher")
    assert {sender for _, _, sender in wrenches} == {gid(token.key)}, "messages name their publisher"
    return json.dumps(answers)


def play(bag_path, speed, taxels, publish_taxels, publish_joints):
    first = None
    started = time.monotonic()
    for topic, log_time, message in bag.samples(bag_path, taxels, "/joints"):
        first = log_time if first is None else first
        time.sleep(max(0.0, (log_time - first) * 1e-9 / speed - (time.monotonic() - started)))
        is_taxels = topic == taxels
        out = LaserScan(ranges=list(message.values)) if is_taxels else JointState(name=list(message.name), position=list(message.position))
        out.header.stamp.sec, out.header.stamp.nanosec = message.header.stamp.sec, message.header.stamp.nanosec
        (publish_taxels if is_taxels else publish_joints)(serialize_message(out))


done, feeders = threading.Event(), []


def feed(rate=100.0):
    """Publishes a moving glove until this process is done."""
    publish_taxels = node.publisher("/taxels", "sensor_msgs/msg/LaserScan")
    publish_joints = node.publisher("/joints", "sensor_msgs/msg/JointState")

    def run():
        start = time.monotonic()
        for n in range(int(60 * rate)):
            if done.is_set():
                return
            joints, taxels = glove.sample(n, rate)
            publish_joints(serialize_message(joints))
            publish_taxels(serialize_message(taxels))
            time.sleep(max(0.0, start + (n + 1) / rate - time.monotonic()))

    feeders.append(threading.Thread(target=run, daemon=True))
    feeders[-1].start()


def graph():

    def whole():
        # Under load an answer may hold a part of the graph, or nothing of it.
        tokens = node.tokens()
        return tokens if sum(token.kind == "SS" for token in tokens) == 15 else None

    wait(lambda: own("SS", f"{NODE}/calibrate/_action/get_result"), "the last of its services")
    tokens = wait(whole, "the whole graph in one answer")
    assert {(token.enclave, token.namespace, token.node) for token in tokens} == {("/", "/", NODE[1:])}, tokens
    assert sum(token.kind == "NN" for token in tokens) == 1
    entities = {(token.kind, token.name): token for token in tokens if token.kind != "NN"}
    expected = {
        ("MP", f"{NODE}/index/wrench"): "geometry_msgs/msg/WrenchStamped",
        ("MP", f"{NODE}/contacts"): "tactile_pose_fusion/msg/ContactArray",
        ("MP", f"{NODE}/markers"): "visualization_msgs/msg/MarkerArray",
        ("MP", f"{NODE}/index/taxels_image"): "sensor_msgs/msg/Image",
        ("MP", f"{NODE}/transition_event"): "lifecycle_msgs/msg/TransitionEvent",
        ("MP", f"{NODE}/calibrate/_action/feedback"): "tactile_pose_fusion/action/Calibrate_FeedbackMessage",
        ("MP", f"{NODE}/calibrate/_action/status"): "action_msgs/msg/GoalStatusArray",
        ("MP", "/diagnostics"): "diagnostic_msgs/msg/DiagnosticArray",
        ("MP", "/rosout"): "rcl_interfaces/msg/Log",
        ("MP", "/parameter_events"): "rcl_interfaces/msg/ParameterEvent",
        ("MS", "/taxels"): "sensor_msgs/msg/LaserScan",
        ("MS", "/joints"): "sensor_msgs/msg/JointState",
        ("MS", "/clock"): "rosgraph_msgs/msg/Clock",
        ("SS", f"{NODE}/tare"): "std_srvs/srv/Trigger",
        ("SS", f"{NODE}/calibrate/_action/send_goal"): "tactile_pose_fusion/action/Calibrate_SendGoal",
    }
    for entity, type_name in expected.items():
        assert entity in entities and canonical(entities[entity].type_name) == type_name, (entity, entities)
    for token in entities.values():
        assert token.type_hash == type_hash(canonical(token.type_name)), f"{token}: ROS 2 has another hash"
    assert entities["MS", "/joints"].qos == "::,1000:,:,:,,", entities["MS", "/joints"]
    assert entities["MP", "/rosout"].qos == ":1:,1000:,:10,0:,,", entities["MP", "/rosout"]


def services():
    feed()
    values = service("get_parameters", GetParameters, "rcl_interfaces/srv/GetParameters", names=["contact.force_on", "regions"]).values
    assert (values[0].type, round(values[0].double_value, 6)) == (ParameterType.PARAMETER_DOUBLE, 0.024517), values
    assert values[1].string_array_value == ["index"], values
    value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=1e9)
    change = Parameter(name="contact.force_on", value=value)
    (result,) = service("set_parameters", SetParameters, "rcl_interfaces/srv/SetParameters", parameters=[change]).results
    assert not result.successful and "contact.force_on" in result.reason, result
    result = service("tare", Trigger, "std_srvs/srv/Trigger")
    assert result.success and result.message.startswith("tared live from "), result
    # This subscription is later than those lines.
    lines = node.listen("/rosout", "rcl_interfaces/msg/Log", late=True)
    said = lambda: [deserialize_message(cdr, Log).msg for cdr, _, _ in lines]
    wait(lambda: any(line.startswith("tared live from ") for line in said()), "what was logged before")
    assert any(line.startswith("parameter refused: ") for line in said()), said()


def calibrate():
    feed()
    base = f"{NODE}/calibrate/_action"
    feedbacks = node.listen(f"{base}/feedback", "tactile_pose_fusion/action/Calibrate_FeedbackMessage")
    wait(lambda: own("MP", f"{base}/feedback"), "the action")
    time.sleep(1.0)
    goal = list(uuid.uuid4().bytes)
    kind = "tactile_pose_fusion/action/Calibrate"
    request = m.SendGoalRequest(goal, m.Duration(2, 500_000_000)).serialize()
    accepted = m.SendGoalResponse.deserialize(node.call(f"{base}/send_goal", f"{kind}_SendGoal", request))
    assert accepted.accepted, accepted
    request = m.GetResultRequest(goal).serialize()
    result = m.GetResultResponse.deserialize(node.call(f"{base}/get_result", f"{kind}_GetResult", request, 30.0))
    assert result.success and result.status == 4 and result.frames > 100, result
    given = [m.FeedbackMessage.deserialize(cdr) for cdr, _, _ in feedbacks]
    assert len(given) >= 3 and list(given[0].goal_id) == goal, given
    assert given[-1].sources == ["glove"] and given[-1].source_taxels == [2], given[-1]


def leaves(pid):
    wait(lambda: own("MP", f"{NODE}/contacts"), "its publisher")
    os.kill(int(pid), signal.SIGTERM)
    wait(lambda: not node.tokens(), "its leaving", seconds=3.0)


checks = [session, graph, services, calibrate, leaves]
print({check.__name__: check for check in checks}[sys.argv[1]](*sys.argv[2:]) or "ok")
done.set()
for feeder in feeders:
    feeder.join()  # one that publishes into a closed session ends this process with an error
node.close()
