"""One arm: the node and, if wanted, RViz and a bag of tensions played to it."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction
from launch.substitutions import LaunchConfiguration

from octo_arm_model.ros.launch_parts import arm_node, declare, rviz, value_of


def start(context):
    """Everything to start, once the arguments have values."""
    actions = [arm_node(context), rviz('octo_arm.rviz', LaunchConfiguration('namespace'))]
    bag = value_of('bag', context)
    if bag:
        # The bag comes first: --clock takes what follows it for its frequency.
        command = ['ros2', 'bag', 'play', bag, '--clock']
        actions.append(ExecuteProcess(cmd=command, output='screen'))
    return actions


def generate_launch_description():
    """Declare the arguments; what they say decides what is started."""
    return LaunchDescription(
        [
            *declare('params_file', 'namespace', 'use_sim_time', 'rviz', 'model', 'frame_prefix'),
            DeclareLaunchArgument(
                'bag',
                default_value='',
                description='bag to play with its clock, best with use_sim_time; empty for none',
            ),
            OpaqueFunction(function=start),
        ]
    )
