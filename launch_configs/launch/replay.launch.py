"""Plays a recorded bag to the live node: `tpf play` with /clock, and the node with the time of /clock.

ros2 launch tactile_pose_fusion replay.launch.py bag:=recording.mcap params_file:=glove.yaml [rate:=1.0]

To write files, and for regression tests, use `tpf replay` instead: it runs as fast as the machine allows, and its output is always the same."""
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, ExecuteProcess, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import LifecycleNode
from launch_ros.substitutions import FindPackagePrefix


def generate_launch_description():
    arguments = [
        DeclareLaunchArgument("bag", description="MCAP file or bag folder"),
        DeclareLaunchArgument("params_file", description="ROS 2 parameter file: topics, taxels, joints, models"),
        DeclareLaunchArgument("rate", default_value="1.0", description="how many times faster than recorded"),
    ]
    node = LifecycleNode(
        package="tactile_pose_fusion",
        executable="tactile_pose_fusion_node",
        name="tactile_pose_fusion",
        namespace="",
        parameters=[LaunchConfiguration("params_file"), {"use_sim_time": True}],
        output="screen",
    )
    tpf = PathJoinSubstitution([FindPackagePrefix("tactile_pose_fusion"), "lib", "tactile_pose_fusion", "tpf"])
    bag, rate = LaunchConfiguration("bag"), LaunchConfiguration("rate")
    play = ExecuteProcess(cmd=[tpf, "play", bag, "--rate", rate, "--clock", "--delay", "3"], output="screen")
    over = RegisterEventHandler(OnProcessExit(target_action=play, on_exit=[EmitEvent(event=Shutdown())]))
    return LaunchDescription([*arguments, node, play, over])
