"""What RViz would get of the node: markers and images, read by rclpy, and frames as tf2 listens to them, read by Cyclone DDS.

pictures.py MESSAGES: prints JSON of the last markers and images after so many of each, and of the frames if some come."""
import json
import sys
import time

import messages
import rclpy
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Image
from visualization_msgs.msg import MarkerArray

NODE, wanted = "/tactile_pose_fusion", int(sys.argv[1])
participant = DomainParticipant(0)
latched = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.Durability.TransientLocal, Policy.History.KeepLast(1))
frames = DataReader(participant, Topic(participant, "rt/tf_static", messages.TFMessage), qos=latched)
reliable = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(100))
moving = DataReader(participant, Topic(participant, "rt/tf", messages.TFMessage), qos=reliable)

rclpy.init()
node = rclpy.create_node("viewer")
markers, images, times = [], [], []
# As RViz subscribes: reliable.
node.create_subscription(MarkerArray, f"{NODE}/markers", lambda array: (markers.append(array), times.append(time.monotonic())), QoSProfile(depth=10))
node.create_subscription(Image, f"{NODE}/index/taxels_image", images.append, QoSProfile(depth=10))
deadline = time.monotonic() + 15
while (len(markers) < wanted or len(images) < wanted) and time.monotonic() < deadline:
    rclpy.spin_once(node, timeout_sec=0.05)
of_reader = lambda reader: [transform for message in reader.take(100) for transform in getattr(message, "transforms", [])]
transforms = of_reader(frames)


def seen(marker):
    return {
        "ns": marker.ns, "id": marker.id, "type": marker.type, "action": marker.action, "frame": marker.header.frame_id,
        "points": [[point.x, point.y, point.z] for point in marker.points], "colors": len(marker.colors), "text": marker.text,
        "stamp": messages.nanos(marker.header.stamp),
    }


print(json.dumps({
    "markers": [seen(marker) for array in markers[-1:] for marker in array.markers],
    "rate_hz": (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 else None,
    "images": [{"size": [image.width, image.height], "encoding": image.encoding, "bytes": len(image.data)} for image in images[-1:]],
    "frames": [[transform.header.frame_id, transform.child_frame_id] for transform in transforms],
    "moving": sorted({transform.child_frame_id for transform in of_reader(moving)}),
}))
