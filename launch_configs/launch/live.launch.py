"""Starts the live node. Start the drivers of glove and hand tracker separately.

ros2 launch tactile_pose_fusion live.launch.py params_file:=glove.yaml [namespace:=left] [autostart:=false]"""
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description():
    arguments = [
        DeclareLaunchArgument("params_file", description="ROS 2 parameter file: topics, taxels, joints, models"),
        DeclareLaunchArgument("namespace", default_value="", description="namespace of the node, such as left"),
        DeclareLaunchArgument("autostart", default_value="true", description="false: wait for a lifecycle manager"),
        DeclareLaunchArgument("use_sim_time", default_value="false", description="true: use the time of /clock"),
        DeclareLaunchArgument("log_level", default_value="info"),
    ]
    flag = lambda name: ParameterValue(LaunchConfiguration(name), value_type=bool)
    node = LifecycleNode(
        package="tactile_pose_fusion",
        executable="tactile_pose_fusion_node",
        name="tactile_pose_fusion",
        namespace=LaunchConfiguration("namespace"),
        parameters=[
            LaunchConfiguration("params_file"),
            {"autostart": flag("autostart"), "use_sim_time": flag("use_sim_time")},
        ],
        ros_arguments=["--log-level", LaunchConfiguration("log_level")],
        output="screen",
    )
    return LaunchDescription([*arguments, node])
