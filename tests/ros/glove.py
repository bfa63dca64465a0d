"""A glove in the air, its stamps those of now, as messages of rclpy."""
import math
import time

from sensor_msgs.msg import JointState, LaserScan


def sample(n, rate, how="moving", offset=0):
    """Joint angles and taxels of sample n: `moving`, `still` or `loaded`, their stamps `offset` ns from now."""
    now = time.time_ns() + offset
    bend = 0.0 if how == "still" else math.sin(n * 2.0 / rate)
    wiggle = (n * 7919 % 13) * 0.01
    load = 400.0 if how == "loaded" and n > rate * 1.5 and (n // int(rate / 2)) % 2 else 0.0
    joints = JointState(name=["pip", "dip"], position=[2.0 * bend, bend])
    taxels = LaserScan(ranges=[10.0 + 5.0 * bend + load + wiggle, 5.0 + load - wiggle])
    for message in (joints, taxels):
        message.header.stamp.sec, message.header.stamp.nanosec = now // 10**9, now % 10**9
    return joints, taxels
