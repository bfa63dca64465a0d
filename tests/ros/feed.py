"""Publishes a glove in the air, its stamps those of now: taxels, joints or both, for a while. Ends when it is killed.

feed.py WHAT SECONDS [RATE_HZ] [moving|still|loaded] [OFFSET_S of the stamps] [HOLD_AT_S HOLD_S]

What is made in HOLD_S from HOLD_AT_S on is sent at its end, as by a link that stalls and then delivers."""
import sys
import time

import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState, LaserScan

import glove

what, seconds = sys.argv[1], float(sys.argv[2])
rate = float(sys.argv[3]) if len(sys.argv) > 3 else 100.0
how = sys.argv[4] if len(sys.argv) > 4 else "moving"
offset = int(float(sys.argv[5]) * 1e9) if len(sys.argv) > 5 else 0
hold = (float(sys.argv[6]), float(sys.argv[6]) + float(sys.argv[7])) if len(sys.argv) > 7 else (0.0, 0.0)
qos = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)

rclpy.init()
node = rclpy.create_node("feeder_" + what)
taxels = node.create_publisher(LaserScan, "/taxels", qos) if what in ("both", "taxels") else None
joints = node.create_publisher(JointState, "/joints", qos) if what in ("both", "joints") else None
start = time.monotonic()
n = 0
waiting = []
while time.monotonic() - start < seconds:
    joint_state, scan = glove.sample(n, rate, how, offset)
    waiting += [(joints, joint_state)] * bool(joints) + [(taxels, scan)] * bool(taxels)
    if not hold[0] <= time.monotonic() - start < hold[1]:
        for publisher, message in waiting:
            publisher.publish(message)
        waiting = []
    n += 1
    time.sleep(max(0.0, start + n / rate - time.monotonic()))
rclpy.shutdown()
