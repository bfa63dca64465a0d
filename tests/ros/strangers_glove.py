"""Publishes a fingertip that bends and presses a load cell, as drivers of no one we know would: pressures without a stamp,
joint states of a motion capture, a wrench. Stamps are those of now. Ends when it is killed, or after SECONDS.

strangers_glove.py SECONDS"""
import math
import sys
import time

import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float32MultiArray

RATE = 100.0
JOINTS = ["index_mcp", "index_pip", "index_dip"]

rclpy.init()
node = rclpy.create_node("strangers_glove")
best_effort = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
pressure = node.create_publisher(Float32MultiArray, "/fingertip/pressure", best_effort)
joints = node.create_publisher(JointState, "/mocap/joint_states", 10)
wrench = node.create_publisher(WrenchStamped, "/ft_sensor/wrench", 10)
start = time.monotonic()
n = 0
while time.monotonic() - start < float(sys.argv[1]):
    t = n / RATE
    bend = 0.6 + 0.5 * math.sin(1.3 * t)
    force = max(0.0, 3.0 * math.sin(2.0 * t)) if t % 5.0 > 3.0 else 0.0
    now = node.get_clock().now().to_msg()
    noise = 0.2 * math.sin(37.0 * t)
    taxels = [100.0 + 40.0 * force * (1.0 + 0.3 * k) + 8.0 * bend + noise * (k + 1) for k in range(6)]
    pressure.publish(Float32MultiArray(data=taxels))
    angles = JointState(name=JOINTS, position=[bend, 0.9 * bend + 0.1, 0.6 * bend])
    angles.header.stamp = now
    joints.publish(angles)
    pressed = WrenchStamped()
    pressed.header.stamp, pressed.header.frame_id, pressed.wrench.force.z = now, "cell", 4.2 + force + 0.01 * noise
    wrench.publish(pressed)
    n += 1
    time.sleep(max(0.0, start + n / RATE - time.monotonic()))
rclpy.shutdown()
