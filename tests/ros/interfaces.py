"""Everything of the node but its estimates, as another ROS 2 node meets it. Each check says what it found wrong.

interfaces.py CHECK, one of those at the end."""
import sys
import time
import uuid

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetAvailableStates, GetAvailableTransitions, GetState
from rcl_interfaces.msg import Log, Parameter, ParameterEvent, ParameterType, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

NODE = "/tactile_pose_fusion"
RELIABLE = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
LATCHED = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)

rclpy.init()
node = rclpy.create_node("checker")


def wait(condition, what, seconds=15.0):
    deadline = time.monotonic() + seconds
    while True:
        found = condition()
        if found:
            return found
        assert time.monotonic() < deadline, f"never came: {what() if callable(what) else what}"
        rclpy.spin_once(node, timeout_sec=0.05)


def call(kind, name, seconds=15.0, **fields):
    client = node.create_client(kind, f"{NODE}/{name}")
    assert client.wait_for_service(seconds), f"{name} is not there"
    future = client.call_async(kind.Request(**fields))
    rclpy.spin_until_future_complete(node, future, timeout_sec=seconds)
    assert future.done(), f"{name} did not answer"
    node.destroy_client(client)
    return future.result()


def listen(kind, topic, qos=RELIABLE):
    heard = []
    node.create_subscription(kind, topic, heard.append, qos)
    return heard


def fed():
    """Waits until the node says that all of its inputs come, each for longer than a moment."""
    diagnostics = listen(DiagnosticArray, "/diagnostics")

    def comes():
        inputs = [s for array in diagnostics[-1:] for s in array.status if ": input " in s.name]
        counts = [value.value for status in inputs for value in status.values if value.key == "messages"]
        return counts and all(int(count) > 20 for count in counts)

    wait(comes, lambda: f"inputs: {diagnostics[-1:]}", 30.0)


def double(name, value):
    return Parameter(name=name, value=ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value))


def graph():
    wait(lambda: "tactile_pose_fusion" in node.get_node_names(), "the node's name")
    expected = {
        f"{NODE}/index/wrench": ["geometry_msgs/msg/WrenchStamped"],
        f"{NODE}/contacts": ["tactile_pose_fusion/msg/ContactArray"],
        f"{NODE}/markers": ["visualization_msgs/msg/MarkerArray"],
        f"{NODE}/index/taxels_image": ["sensor_msgs/msg/Image"],
        f"{NODE}/transition_event": ["lifecycle_msgs/msg/TransitionEvent"],
        "/diagnostics": ["diagnostic_msgs/msg/DiagnosticArray"],
        "/rosout": ["rcl_interfaces/msg/Log"],
        "/taxels": ["sensor_msgs/msg/LaserScan"],
        "/joints": ["sensor_msgs/msg/JointState"],
    }
    wait(lambda: expected.items() <= dict(node.get_topic_names_and_types()).items(), "its topics")
    # Endpoints and what node they belong to are told apart from each other: neither is whole at once.
    of_node = lambda kinds: dict(kinds("tactile_pose_fusion", "/"))
    publishers = lambda: of_node(node.get_publisher_names_and_types_by_node)
    wait(lambda: f"{NODE}/contacts" in publishers(), lambda: f"its publishers: {publishers()}")
    readers = lambda: of_node(node.get_subscriber_names_and_types_by_node)
    wait(lambda: {"/taxels", "/joints"} <= readers().keys(), lambda: f"its subscriptions: {readers()}")
    services = lambda: of_node(node.get_service_names_and_types_by_node)
    wait(lambda: services().get(f"{NODE}/tare") == ["std_srvs/srv/Trigger"], lambda: f"its services: {services()}")
    info = lambda: [(i.node_name, i.topic_type) for i in node.get_publishers_info_by_topic(f"{NODE}/index/wrench")]
    wait(lambda: info() == [("tactile_pose_fusion", "geometry_msgs/msg/WrenchStamped")], lambda: f"its wrench: {info()}")


def no_pictures():
    wait(lambda: "tactile_pose_fusion" in node.get_node_names(), "the node's name")
    publishers = lambda: dict(node.get_publisher_names_and_types_by_node("tactile_pose_fusion", "/"))
    wait(lambda: {f"{NODE}/contacts", "/diagnostics"} <= publishers().keys(), lambda: f"its publishers: {publishers()}")
    wrong = [name for name in publishers() if name.endswith(("markers", "taxels_image", "tf_static"))]
    assert not wrong, wrong


def parameters():
    events = listen(ParameterEvent, "/parameter_events")
    names = call(ListParameters, "list_parameters").result.names
    assert "contact.force_on" in names and "qos_overrides./taxels.subscription.reliability" in names, names
    values = call(GetParameters, "get_parameters", names=["contact.force_on", "regions", "autostart", "nothing"]).values
    assert (values[0].type, round(values[0].double_value, 6)) == (ParameterType.PARAMETER_DOUBLE, 0.024517), values
    assert list(values[1].string_array_value) == ["index"] and values[2].bool_value, values
    assert values[3].type == ParameterType.PARAMETER_NOT_SET, values
    types = call(GetParameterTypes, "get_parameter_types", names=["contact.on_frames", "glove"]).types
    assert list(types) == [ParameterType.PARAMETER_INTEGER, ParameterType.PARAMETER_STRING], types
    on, glove = call(DescribeParameters, "describe_parameters", names=["contact.force_on", "glove"]).descriptors
    assert not on.read_only and on.floating_point_range[0].to_value == 1000.0 and on.description.endswith("(N)"), on
    assert glove.read_only, glove
    result = call(SetParameters, "set_parameters", parameters=[double("contact.force_on", 0.3)]).results[0]
    assert result.successful, result
    refused = call(SetParameters, "set_parameters", parameters=[double("contact.force_on", 0.001)]).results[0]
    assert not refused.successful and "must be below contact.force_on = 0.001 N" in refused.reason, refused
    refused = call(SetParameters, "set_parameters", parameters=[double("timing.max_gap_ms", 1.0)]).results[0]
    assert not refused.successful and "is read at start" in refused.reason, refused
    both = [double("contact.force_on", 0.5), double("contact.force_off", 0.4)]
    assert call(SetParametersAtomically, "set_parameters_atomically", parameters=both).result.successful
    value = call(GetParameters, "get_parameters", names=["contact.force_off"]).values[0].double_value
    assert value == 0.4, value
    wait(lambda: any(e.node == NODE and len(e.changed_parameters) == 2 for e in events), "a parameter event")


def reports():
    diagnostics, logs = listen(DiagnosticArray, "/diagnostics"), listen(Log, "/rosout", LATCHED)
    call(SetParameters, "set_parameters", parameters=[double("contact.force_on", -1.0)])
    wait(lambda: any(log.name == "tactile_pose_fusion" and "parameter refused" in log.msg for log in logs), "a log line")

    def complete():
        by_name = {s.name: s for array in diagnostics[-1:] for s in array.status}
        taxels = by_name.get("tactile_pose_fusion: input tactile.glove")
        latency = by_name.get("tactile_pose_fusion: latency")
        estimates = by_name.get("tactile_pose_fusion: estimates")
        if not (taxels and latency and estimates):
            return None
        value = lambda status, key: next((v.value for v in status.values if v.key == key), None)
        rate = value(taxels, "rate_hz")
        good = rate not in (None, "unknown") and abs(float(rate) - 100.0) < 10.0
        good &= value(latency, "receive_to_publish_ms.p99") not in (None, "unknown")
        good &= (value(estimates, "regions.index.estimates") or "0") != "0"
        return good and "model.onnx" in value(estimates, "model.tip")

    wait(complete, lambda: f"diagnostics that tell rate, latency and model: {diagnostics[-1:]}")
    before, start = len(diagnostics), time.monotonic()
    wait(lambda: len(diagnostics) >= before + 3, "three reports")
    assert 2.0 < time.monotonic() - start < 4.0, "diagnostics come once a second"


def tare():
    fed()
    result = call(Trigger, "tare")
    assert result.success and result.message.startswith("tared live from "), result


def lifecycle():
    events = listen(TransitionEvent, f"{NODE}/transition_event")
    wait(lambda: node.count_publishers(f"{NODE}/transition_event"), "its transition events")
    time.sleep(0.5)
    state = lambda: call(GetState, "get_state").current_state.label

    def change(label):
        request = ChangeState.Request()
        request.transition.label = label
        return call(ChangeState, "change_state", transition=request.transition).success

    assert state() == "unconfigured"
    assert not change("activate"), "activate is not possible yet"
    assert change("configure") and state() == "inactive"
    transitions = call(GetAvailableTransitions, "get_available_transitions").available_transitions
    assert sorted(t.transition.label for t in transitions) == ["activate", "cleanup", "shutdown"], transitions
    assert len(call(GetAvailableTransitions, "get_transition_graph").available_transitions) == 25
    assert len(call(GetAvailableStates, "get_available_states").available_states) == 10
    from geometry_msgs.msg import WrenchStamped
    wrenches = listen(WrenchStamped, f"{NODE}/index/wrench")
    end = time.monotonic() + 1.5
    while time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.05)
    assert not wrenches, "an inactive node publishes nothing"
    assert change("activate") and state() == "active"
    wait(lambda: wrenches, "a wrench of the active node")
    assert change("deactivate") and change("cleanup") and state() == "unconfigured"
    assert change("shutdown") and state() == "finalized"
    wait(lambda: len(events) >= 10, "an event for each step")
    steps = [event.start_state.label for event in events]
    assert steps[:4] == ["unconfigured", "configuring", "inactive", "activating"], steps


def new_clients():
    for _ in range(10):
        call(GetState, "get_state", 5.0)
        call(ListParameters, "list_parameters", 5.0)


def sim_time():
    publisher = node.create_publisher(Clock, "/clock", RELIABLE)
    diagnostics = listen(DiagnosticArray, "/diagnostics")

    def told():
        message = Clock()
        message.clock.sec = 1234
        publisher.publish(message)
        return any(array.header.stamp.sec == 1234 for array in diagnostics)

    wait(told, "diagnostics stamped by /clock")


def renamed():
    wait(lambda: ("fusion", "/left") in node.get_node_names_and_namespaces(), "the node's other name")
    topics = {"/left/fusion/contacts", "/index/force", "/glove/raw", "/left/fusion/transition_event"}
    wait(lambda: topics <= set(dict(node.get_topic_names_and_types())), "its topics by their other names")
    client = node.create_client(Trigger, "/zero")
    assert client.wait_for_service(10.0), "tare by its other name"


def leaves(pid):
    import os
    import signal

    wait(lambda: "tactile_pose_fusion" in node.get_node_names(), "the node's name")
    wait(lambda: node.count_publishers(f"{NODE}/contacts"), "its publisher")
    os.kill(int(pid), signal.SIGTERM)
    # A node that only dies is there until its lease is over, after 20 s and more.
    gone = lambda: "tactile_pose_fusion" not in node.get_node_names() and not node.count_publishers(f"{NODE}/contacts")
    wait(gone, "its leaving", seconds=3.0)


class CalibrateAction:
    """The action's client as Cyclone DDS has it: rclpy has no generated type of it here."""

    def __init__(self):
        from cyclonedds.core import Policy, Qos
        from cyclonedds.domain import DomainParticipant
        from cyclonedds.pub import DataWriter
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic
        from cyclonedds.util import duration

        import messages as m

        participant = DomainParticipant(0)
        qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(100))
        base = f"{NODE}/calibrate/_action"
        topic = lambda name, kind: Topic(participant, name, kind)
        writer = lambda name, kind: DataWriter(participant, topic(f"rq{base}/{name}Request", kind), qos=qos)
        reader = lambda name, kind: DataReader(participant, topic(f"rr{base}/{name}Reply", kind), qos=qos)
        self.types = m
        self.goals, self.accepts = writer("send_goal", m.SendGoalRequest), reader("send_goal", m.SendGoalResponse)
        self.asks, self.results = writer("get_result", m.GetResultRequest), reader("get_result", m.GetResultResponse)
        self.cancels, self.cancelled = writer("cancel_goal", m.CancelRequest), reader("cancel_goal", m.CancelResponse)
        self.feedbacks = DataReader(participant, topic(f"rt{base}/feedback", m.FeedbackMessage), qos=qos)
        ready = lambda: all(
            w.get_matched_subscriptions() for w in (self.goals, self.asks, self.cancels)
        ) and all(
            r.get_matched_publications() for r in (self.accepts, self.results, self.cancelled, self.feedbacks)
        )
        wait(ready, "the action")
        time.sleep(0.5)

    def begin(self, seconds):
        """Sends a goal; its id."""
        m, goal, whole = self.types, list(uuid.uuid4().bytes), int(seconds)
        self.goals.write(m.SendGoalRequest(goal, m.Duration(whole, int((seconds - whole) * 1e9))))
        accepted = wait(lambda: self.accepts.take(1), "acceptance")[0]
        assert accepted.accepted, accepted
        return goal

    def result(self, goal):
        self.asks.write(self.types.GetResultRequest(goal))
        result = wait(lambda: self.results.take(1), "a result", seconds=20.0)[0]
        print(result)
        return result


def calibrate(seconds="2.5", expected="true"):
    fed()
    action = CalibrateAction()
    goal = action.begin(float(seconds))
    result = action.result(goal)
    given = action.feedbacks.take(100)
    assert len(given) >= 3 and list(given[0].goal_id) == goal, given
    left = [f.time_left.sec + f.time_left.nanosec * 1e-9 for f in given]
    assert left == sorted(left, reverse=True) and left[0] < float(seconds), left
    assert given[-1].sources == ["glove"] and given[-1].source_taxels == [2] and len(given[-1].noise) == 2, given[-1]
    if expected == "true":
        assert result.success and result.status == 4 and result.frames > 100, result
        assert result.joints == ["dip", "pip"] and result.joint_span[1] > 1.0, result
        assert result.file.endswith("kept.yaml"), result
    else:
        assert not result.success and result.status == 6 and expected in result.message, result


def cancel():
    action = CalibrateAction()
    m = action.types
    nobody = [7] * 16
    action.cancels.write(m.CancelRequest(nobody, m.Time(0, 0)))
    refused = wait(lambda: action.cancelled.take(1), "an answer")[0]
    assert refused.return_code == 2 and refused.goals == [], refused
    goal = action.begin(60.0)
    wait(lambda: action.feedbacks.take(1), "feedback")
    action.cancels.write(m.CancelRequest(goal, m.Time(0, 0)))
    granted = wait(lambda: action.cancelled.take(1), "an answer")[0]
    assert granted.return_code == 0 and [list(g.goal_id) for g in granted.goals] == [goal], granted
    result = action.result(goal)
    assert result.status == 5 and not result.success and "cancelled" in result.message, result
    fed()
    # The next one isn't in its way.
    result = action.result(action.begin(2.5))
    assert result.success, result


def value(name, expected):
    got = call(GetParameters, "get_parameters", names=[name]).values[0]
    assert str(got.integer_value) == expected, got


def text(name, value):
    value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=value)
    result = call(SetParameters, "set_parameters", parameters=[Parameter(name=name, value=value)]).results[0]
    assert result.successful, result


checks = [fed, value, text, graph, no_pictures, parameters, reports, tare, lifecycle, new_clients, sim_time, renamed, leaves, calibrate, cancel]
{check.__name__: check for check in checks}[sys.argv[1]](*sys.argv[2:])
print("ok")
rclpy.shutdown()
