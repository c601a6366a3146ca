"""Start eight arms around a body, each a node in its own namespace: arm_1 to arm_8."""

from launch.substitutions import LaunchConfiguration

from octo_arm_model.analysis.drawing import ARMS, RADIUS, base_pose
from octo_arm_model.ros import launch_parts as parts


def start(context):
    """Return the eight nodes, and on request RViz, for the values of the arguments."""
    radius = float(parts.value_of('radius', context))
    file = parts.params_file(context)
    common = (
        parts.sim_time()
        | parts.overrides(context, 'model')
        | {'base_frame': parts.text('base_frame')}
    )
    actions = [parts.rviz('octopus.rviz', LaunchConfiguration('base_frame'))]
    for number in range(1, ARMS + 1):
        position, quaternion = base_pose(number, radius)
        parameters = {
            'base.position': position,
            'base.quaternion': quaternion,
            'frame_prefix': f'arm_{number}_',
        }
        arm = parts.node('octo_arm_node', 'octo_arm', f'arm_{number}', file, common | parameters)
        actions.append(arm)
    return actions


def generate_launch_description():
    """Return the arguments and the function that starts everything by their values."""
    return parts.described(
        start,
        ('params_file', 'use_sim_time', 'rviz', 'model'),
        radius={
            'default_value': str(RADIUS),
            'description': 'radius of the circle of the bases [m]',
        },
        base_frame={
            'default_value': 'octopus',
            'description': 'frame of the body, at its centre, that all arms are expressed in; '
            'base and frame of params_file are not used',
        },
    )
