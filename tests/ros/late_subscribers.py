"""Joins a running node late: late_subscribers.py PID SECONDS SUBSCRIBERS. tests/ros/late_subscribers starts it."""
import sys
import time
from pathlib import Path

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from tactile_pose_fusion.msg import ContactArray

pid, wait_s, n_subscribers = int(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3])
TOPIC = "/tactile_pose_fusion/contacts"
RELIABLE = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
BEST_EFFORT = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)


def memory_mb():
    status = Path(f"/proc/{pid}/status").read_text()
    return int(status.split("VmRSS:")[1].split()[0]) / 1024


def spin(executor, seconds):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        executor.spin_once(timeout_sec=0.02)


def longest_ms(times):
    return 1000 * max(after - before for before, after in zip(times, times[1:]))


rclpy.init()
time.sleep(wait_s)
executor = SingleThreadedExecutor()
first, heard = rclpy.create_node("first"), []
first.create_subscription(ContactArray, TOPIC, lambda _: heard.append(time.monotonic()), BEST_EFFORT)
executor.add_node(first)
spin(executor, 5.0)
assert len(heard) > 100, f"{len(heard)} messages in 5 s"
rate_hz = len(heard) / (heard[-1] - heard[0])
print(f"about {rate_hz * (wait_s + 5):.0f} messages published before; {memory_mb():.1f} MB; longest pause {longest_ms(heard):.0f} ms")

n_before, began = len(heard), time.monotonic()
counts, firsts, late = [0] * n_subscribers, {}, []
for number in range(n_subscribers):
    def count(_, number=number):
        counts[number] += 1
        firsts.setdefault(number, time.monotonic() - began)

    late.append(rclpy.create_node(f"late_{number}"))
    late[-1].create_subscription(ContactArray, TOPIC, count, RELIABLE)
    executor.add_node(late[-1])
spin(executor, 15.0)
assert all(counts), counts
print(
    f"{n_subscribers} reliable subscribers joined: {memory_mb():.1f} MB; longest pause {longest_ms(heard[n_before:]):.0f} ms; "
    f"first message after at most {max(firsts.values()):.2f} s"
)
