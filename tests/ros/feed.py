"""Publishes a glove in the air, its stamps those of now: taxels, joints or both, for a while. Ends when it is killed.

feed.py WHAT SECONDS [RATE_HZ] [moving|still|loaded] [OFFSET_S of the stamps]"""
import math
import sys
import time

import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState, LaserScan

what, seconds = sys.argv[1], float(sys.argv[2])
rate = float(sys.argv[3]) if len(sys.argv) > 3 else 100.0
how = sys.argv[4] if len(sys.argv) > 4 else "moving"
offset = int(float(sys.argv[5]) * 1e9) if len(sys.argv) > 5 else 0
qos = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)

rclpy.init()
node = rclpy.create_node("feeder_" + what)
taxels = node.create_publisher(LaserScan, "/taxels", qos) if what in ("both", "taxels") else None
joints = node.create_publisher(JointState, "/joints", qos) if what in ("both", "joints") else None
start = time.monotonic()
n = 0
while time.monotonic() - start < seconds:
    now = time.time_ns() + offset
    bend = 0.0 if how == "still" else math.sin(n * 2.0 / rate)
    if joints:
        message = JointState(name=["pip", "dip"], position=[2.0 * bend, bend])
        message.header.stamp.sec, message.header.stamp.nanosec = now // 10**9, now % 10**9
        joints.publish(message)
    if taxels:
        wiggle = (n * 7919 % 13) * 0.01
        load = 400.0 if how == "loaded" and n > rate * 1.5 and (n // int(rate / 2)) % 2 else 0.0
        message = LaserScan(ranges=[10.0 + 5.0 * bend + load + wiggle, 5.0 + load - wiggle])
        message.header.stamp.sec, message.header.stamp.nanosec = now // 10**9, now % 10**9
        taxels.publish(message)
    n += 1
    time.sleep(max(0.0, start + n / rate - time.monotonic()))
rclpy.shutdown()
