"""The definitions of the messages that are written, each with those that it depends on, as bags hold them."""
import os

_ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "msg")
_FILES = {
    "geometry_msgs/WrenchStamped": "standard/WrenchStamped.msg",
    "geometry_msgs/Wrench": "standard/Wrench.msg",
    "geometry_msgs/Vector3": "standard/Vector3.msg",
    "std_msgs/Header": "standard/Header.msg",
    "builtin_interfaces/Time": "standard/Time.msg",
    "tactile_pose_fusion/ContactArray": "ContactArray.msg",
    "tactile_pose_fusion/ContactState": "ContactState.msg",
}


def _text(first, *others):
    read = lambda name: open(os.path.join(_ROOT, _FILES[name])).read()
    return read(first) + "".join(f"\n{'=' * 80}\nMSG: {name}\n{read(name)}" for name in others)


WRENCH_STAMPED = _text("geometry_msgs/WrenchStamped", "std_msgs/Header", "builtin_interfaces/Time", "geometry_msgs/Wrench",
                       "geometry_msgs/Vector3")
CONTACT_ARRAY = _text("tactile_pose_fusion/ContactArray", "std_msgs/Header", "builtin_interfaces/Time",
                      "tactile_pose_fusion/ContactState")
