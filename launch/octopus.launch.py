"""Eight arms around a body, each a node in a namespace of its own: arm_1 to arm_8."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from octo_arm_model.analysis.octopus_layout import ARMS, RADIUS, base_pose

PACKAGE = 'octo_arm_model'


def start(context):
    """The eight nodes, once the arguments have values."""
    radius = float(LaunchConfiguration('radius').perform(context))
    common = {
        'use_sim_time': ParameterValue(LaunchConfiguration('use_sim_time'), value_type=bool),
        'base_frame': ParameterValue(LaunchConfiguration('base_frame'), value_type=str),
    }
    # Empty, the parameter file has its way.
    if LaunchConfiguration('model').perform(context):
        common['model'] = ParameterValue(LaunchConfiguration('model'), value_type=str)
    nodes = []
    for number in range(1, ARMS + 1):
        position, quaternion = base_pose(number, radius)
        own = {
            'base.position': position,
            'base.quaternion': quaternion,
            'frame_prefix': f'arm_{number}_',
        }
        nodes.append(
            Node(
                package=PACKAGE,
                executable='octo_arm_node',
                name='octo_arm',
                namespace=f'arm_{number}',
                parameters=[LaunchConfiguration('params_file'), common, own],
                output='screen',
            )
        )
    return nodes


def generate_launch_description():
    """Declare the arguments; what they say decides what is started."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'params_file',
                default_value=PathJoinSubstitution(
                    [
                        FindPackageShare(PACKAGE),
                        'config',
                        'renda2012_table4.yaml',
                    ]
                ),
                description='ROS parameter file of every arm; its base and frame are not used',
            ),
            DeclareLaunchArgument(
                'radius',
                default_value=str(RADIUS),
                description='radius of the circle of the bases [m]',
            ),
            DeclareLaunchArgument(
                'base_frame',
                default_value='octopus',
                description='frame of the body, at its centre, that all arms are expressed in',
            ),
            DeclareLaunchArgument(
                'use_sim_time',
                default_value='false',
                description='whether time comes from /clock, as with a bag or a simulation',
            ),
            DeclareLaunchArgument(
                'model',
                default_value='',
                description='name of a model; empty for that of params_file',
            ),
            OpaqueFunction(function=start),
        ]
    )
