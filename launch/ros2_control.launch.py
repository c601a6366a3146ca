"""Start a simulated arm that moves, and controllers of ros2_control that drive its tendons."""

from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from octo_arm_model.config.config import load_config
from octo_arm_model.ros import launch_parts as parts
from octo_arm_model.simulation.simulator import INTERFACES, PLUGIN, in_water, robot_description

CONTROLLER = {'effort': 'tendon_effort_controller', 'position': 'tendon_position_controller'}


def start(context):
    """Return all actions, for the values of the arguments in ``context``."""
    plugin = PLUGIN.partition('/')[0]
    parts.require('robot_state_publisher', 'controller_manager', 'joint_state_broadcaster', plugin)
    namespace, file = LaunchConfiguration('namespace'), parts.params_file(context)
    interface = parts.value_of('interface', context)
    config = load_config(file)
    prefix = parts.value_of('frame_prefix', context) or config.frame_prefix
    urdf = robot_description(config, interface, parts.value_of('namespace', context))
    of_simulator = parts.sim_time() | parts.overrides(context, 'base_frame') | in_water(config)
    return [
        parts.arm_node(context),
        parts.node('octo_arm_sim', 'octo_arm_sim', namespace, file, of_simulator),
        Node(
            package='robot_state_publisher',
            executable='robot_state_publisher',
            namespace=namespace,
            parameters=[{'robot_description': urdf, 'frame_prefix': prefix}, parts.sim_time()],
        ),
        Node(
            package='controller_manager',
            executable='ros2_control_node',
            namespace=namespace,
            parameters=[LaunchConfiguration('controllers_file'), parts.sim_time()],
            remappings=[('~/robot_description', 'robot_description')],
            output='screen',
        ),
        Node(
            package='controller_manager',
            executable='spawner',
            namespace=namespace,
            arguments=['joint_state_broadcaster', CONTROLLER[interface]],
            output='screen',
        ),
        parts.rviz('octo_arm.rviz', parts.base_frame(context), namespace),
    ]


def generate_launch_description():
    """Return the arguments and the function that starts everything by their values."""
    file = PathJoinSubstitution(
        [FindPackageShare(parts.PACKAGE), 'config/ros2_control/controllers.yaml']
    )
    return parts.described(
        start,
        interface={
            'default_value': 'effort',
            'choices': INTERFACES,
            'description': 'what controllers command: tensions as effort [N], or lengths that '
            'winches reel in as position [m]',
        },
        controllers_file={
            'default_value': file,
            'description': 'parameter file of the controllers; the default is for the arm '
            'renda2012_table4',
        },
    )
