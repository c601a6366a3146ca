"""One arm: the node and, if wanted, RViz and a bag of tensions played to it."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

PACKAGE = 'octo_arm_model'
# Given, these override what the parameter file says; empty, the file has its way.
OVERRIDES = ('model', 'frame_prefix')


def start(context):
    """Everything to start, once the arguments have values."""
    sim_time = {
        'use_sim_time': ParameterValue(LaunchConfiguration('use_sim_time'), value_type=bool)
    }
    overrides = {
        # Of type string: a prefix such as 1_ would be read as a number.
        name: ParameterValue(LaunchConfiguration(name), value_type=str)
        for name in OVERRIDES
        if LaunchConfiguration(name).perform(context)
    }
    actions = [
        Node(
            package=PACKAGE,
            executable='octo_arm_node',
            name='octo_arm',
            namespace=LaunchConfiguration('namespace'),
            parameters=[LaunchConfiguration('params_file'), sim_time | overrides],
            output='screen',
        ),
        Node(
            package='rviz2',
            executable='rviz2',
            name='rviz',
            # The topics of the configuration are relative, so they follow.
            namespace=LaunchConfiguration('namespace'),
            arguments=[
                '-d',
                PathJoinSubstitution([FindPackageShare(PACKAGE), 'rviz', 'octo_arm.rviz']),
            ],
            parameters=[sim_time],
            condition=IfCondition(LaunchConfiguration('rviz')),
        ),
    ]
    bag = LaunchConfiguration('bag').perform(context)
    if bag:
        # The bag comes first: --clock takes what follows it for its frequency.
        command = ['ros2', 'bag', 'play', bag, '--clock']
        actions.append(ExecuteProcess(cmd=command, output='screen'))
    return actions


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
                description='ROS parameter file of the arm',
            ),
            DeclareLaunchArgument(
                'namespace', default_value='', description='namespace of all topics and services'
            ),
            DeclareLaunchArgument(
                'use_sim_time',
                default_value='false',
                description='whether time comes from /clock, as with a bag or a simulation',
            ),
            DeclareLaunchArgument(
                'rviz', default_value='false', description='whether to start RViz'
            ),
            DeclareLaunchArgument(
                'bag',
                default_value='',
                description='bag to play with its clock, best with use_sim_time; empty for none',
            ),
            DeclareLaunchArgument(
                'model',
                default_value='',
                description='name of a model; empty for that of params_file',
            ),
            DeclareLaunchArgument(
                'frame_prefix',
                default_value='',
                description='prefix of the names of TF frames; empty for that of params_file',
            ),
            OpaqueFunction(function=start),
        ]
    )
