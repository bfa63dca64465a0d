"""Waits for /clock with the time of the test's recording, twice from its beginning, and for the remapped topic."""
import time

import rclpy
from rosgraph_msgs.msg import Clock

rclpy.init()
node = rclpy.create_node("clock_listener")
times = []
node.create_subscription(Clock, "/clock", lambda m: times.append(m.clock.sec + m.clock.nanosec * 1e-9), 100)
deadline = time.monotonic() + 15
jumps = 0
while jumps < 2:
    assert time.monotonic() < deadline, f"{jumps} new beginnings in {len(times)} times"
    rclpy.spin_once(node, timeout_sec=0.1)
    jumps = sum(b < a for a, b in zip(times, times[1:]))
assert all(1.7e9 <= t <= 1.7e9 + 1.1 for t in times), times
steps = sorted(b - a for a, b in zip(times, times[1:]) if b > a)
assert abs(steps[len(steps) // 2] - 0.02) < 0.005, steps
assert "/glove/taxels" in dict(node.get_topic_names_and_types()), node.get_topic_names_and_types()
rclpy.shutdown()
