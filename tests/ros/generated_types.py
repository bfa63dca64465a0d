"""Our messages and our action by the types that rosidl generates from them, in rclpy: the node must be running.

generated_types.py, in an environment that sourced what colcon installed (tests/ros/colcon does that)."""
import time

import rclpy
from rclpy.action import ActionClient
from rclpy.duration import Duration
from rclpy.qos import qos_profile_sensor_data
from tactile_pose_fusion.action import Calibrate
from tactile_pose_fusion.msg import ContactArray

NODE = "/tactile_pose_fusion"

rclpy.init()
node = rclpy.create_node("checker")


def wait(future, what):
    rclpy.spin_until_future_complete(node, future, timeout_sec=15.0)
    assert future.done(), f"never came: {what}"
    return future.result()


def begin(client, seconds, feedback):
    goal = Calibrate.Goal(duration=Duration(seconds=seconds).to_msg())
    handle = wait(client.send_goal_async(goal, feedback_callback=feedback), "acceptance")
    assert handle.accepted
    return handle


contacts = []
node.create_subscription(ContactArray, f"{NODE}/contacts", contacts.append, qos_profile_sensor_data)
client = ActionClient(node, Calibrate, f"{NODE}/calibrate")
assert client.wait_for_server(15.0), "the action is not there"

feedback = []
handle = begin(client, 2.5, lambda message: feedback.append(message.feedback))
result = wait(handle.get_result_async(), "a result")
print(result.result.message)
assert result.status in (4, 6) and result.result.success == (result.status == 4), result
left = [given.time_left.sec + given.time_left.nanosec * 1e-9 for given in feedback]
assert len(left) >= 3 and left == sorted(left, reverse=True), left
assert feedback[-1].sources and len(feedback[-1].noise) == sum(feedback[-1].source_taxels), feedback[-1]

handle = begin(client, 60.0, None)
time.sleep(0.5)
assert wait(handle.cancel_goal_async(), "an answer to the cancelling").return_code == 0
result = wait(handle.get_result_async(), "a result")
assert result.status == 5 and "cancelled" in result.result.message, result

assert len(contacts) > 100, len(contacts)
state = contacts[-1].contacts[0]
assert state.region == "index" and state.on_threshold > state.off_threshold > 0.0, state
print("ok")
