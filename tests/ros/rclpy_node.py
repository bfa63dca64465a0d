"""The node as one would write it in an afternoon: rclpy and onnxruntime, one region, no pose interpolation, no checks.

rclpy_node.py MODEL"""
import sys

import numpy
import onnxruntime
import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

options = onnxruntime.SessionOptions()
options.intra_op_num_threads = 1
session = onnxruntime.InferenceSession(sys.argv[1], options, providers=["CPUExecutionProvider"])
n_taxels, n_joints = (session.get_inputs()[idx].shape[2] for idx in (0, 1))
names = [i.name for i in session.get_inputs()]
tactile = numpy.zeros((1, 64, n_taxels), numpy.float32)
pose = numpy.zeros((1, 64, n_joints), numpy.float32)
angles = numpy.zeros(n_joints, numpy.float32)
qos = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)

rclpy.init()
node = rclpy.create_node("rclpy_node")
publisher = node.create_publisher(WrenchStamped, "/rclpy_node/index/wrench", qos)


def on_joints(message):
    angles[:] = message.position


def on_taxels(message):
    tactile[0, :-1], pose[0, :-1] = tactile[0, 1:].copy(), pose[0, 1:].copy()
    tactile[0, -1], pose[0, -1] = message.position, angles
    out = WrenchStamped(header=message.header)
    out.wrench.force.z = float(session.run(None, dict(zip(names, (tactile, pose))))[0].reshape(-1)[0])
    publisher.publish(out)


node.create_subscription(JointState, "/joints", on_joints, qos)
node.create_subscription(JointState, "/taxels", on_taxels, qos)
rclpy.spin(node)
