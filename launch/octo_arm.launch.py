"""Start the node of one arm, and on request RViz and a bag of tensions that is played."""

from launch.actions import ExecuteProcess
from launch.substitutions import LaunchConfiguration

from octo_arm_model.ros import launch_parts as parts


def start(context):
    """Return all actions, for the values of the arguments in ``context``."""
    namespace = LaunchConfiguration('namespace')
    actions = [
        parts.arm_node(context),
        parts.rviz('octo_arm.rviz', parts.base_frame(context), namespace),
    ]
    bag = parts.value_of('bag', context)
    if bag:
        parts.require('ros2bag')
        # The bag comes first, as --clock would take it for its frequency.
        command = ['ros2', 'bag', 'play', bag, '--clock']
        actions.append(ExecuteProcess(cmd=command, output='screen'))
    return actions


def generate_launch_description():
    """Return the arguments and the function that starts everything by their values."""
    bag = 'bag to play with its clock, best with use_sim_time; empty for none'
    return parts.described(start, bag={'default_value': '', 'description': bag})
