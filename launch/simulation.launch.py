"""One arm without hardware: the node and the simulator; where wanted, the shape it really has."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

PACKAGE = 'octo_arm_model'
# Passed on to the launch file of the node.
SHARED = ('params_file', 'namespace', 'use_sim_time', 'rviz', 'model')


def start(context):
    """Everything to start, once the arguments have values."""
    params_file = LaunchConfiguration('params_file')
    sim_time = {
        'use_sim_time': ParameterValue(LaunchConfiguration('use_sim_time'), value_type=bool)
    }
    # Of type string: a file may be called 1.
    profile = {
        'profile.name': ParameterValue(LaunchConfiguration('profile'), value_type=str),
        'profile.loop': True,
    }
    of_simulator = [params_file]
    if LaunchConfiguration('simulator_file').perform(context):
        of_simulator.append(LaunchConfiguration('simulator_file'))
    of_simulator.append(sim_time)
    if LaunchConfiguration('profile').perform(context):
        of_simulator.append(profile)
    path = PathJoinSubstitution([FindPackageShare(PACKAGE), 'launch', 'octo_arm.launch.py'])
    actions = [
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(path),
            launch_arguments=[(name, LaunchConfiguration(name)) for name in SHARED],
        ),
        Node(
            package=PACKAGE,
            executable='octo_arm_sim',
            name='octo_arm_sim',
            namespace=LaunchConfiguration('namespace'),
            parameters=of_simulator,
            output='screen',
        ),
    ]
    if LaunchConfiguration('ground_truth').perform(context).lower() in ('true', '1'):
        actions.append(
            Node(
                package=PACKAGE,
                executable='octo_arm_node',
                name='octo_arm',
                namespace=[LaunchConfiguration('namespace'), '/ground_truth'],
                parameters=[params_file, sim_time | {'frame_prefix': 'ground_truth_'}],
                output='screen',
            )
        )
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
                description='ROS parameter file of the arm, for both nodes',
            ),
            DeclareLaunchArgument(
                'simulator_file',
                default_value='',
                description='ROS parameter file of the simulator, such as config/simulator.yaml; '
                'empty for perfect winches and load cells',
            ),
            DeclareLaunchArgument(
                'profile',
                default_value='',
                description='movement or file to play over and over; empty to wait for commands',
            ),
            DeclareLaunchArgument(
                'ground_truth',
                default_value='false',
                description='whether another node publishes the shape that the simulated arm '
                'really has, in the namespace ground_truth',
            ),
            DeclareLaunchArgument(
                'namespace', default_value='', description='namespace of all topics and services'
            ),
            DeclareLaunchArgument(
                'use_sim_time', default_value='false', description='whether time is that of /clock'
            ),
            DeclareLaunchArgument(
                'rviz', default_value='false', description='whether to start RViz'
            ),
            DeclareLaunchArgument(
                'model',
                default_value='',
                description='name of a model; empty for that of params_file',
            ),
            OpaqueFunction(function=start),
        ]
    )
