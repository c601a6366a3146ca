"""Parts that the launch files share: their arguments, and launch actions for nodes and RViz."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from ament_index_python.packages import get_packages_with_prefixes
from launch import LaunchContext, LaunchDescription
from launch.action import Action
from launch.actions import DeclareLaunchArgument, LogInfo, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.config.config import load_config
from octo_arm_model.config.parameter_files import find_path

PACKAGE = 'octo_arm_model'
# Default value and description.
ARGUMENTS: dict[str, tuple[str, str]] = {
    'params_file': ('renda2012_table4', 'ROS parameter file of the arm, or the name of a preset'),
    'namespace': ('', 'namespace of all topics and services'),
    'use_sim_time': ('false', 'whether time comes from /clock, as with a bag or a simulation'),
    'rviz': ('false', 'whether to start RViz'),
    'model': ('', 'name of a model; empty for that of params_file'),
    'base_frame': ('', 'frame that the arm is expressed in; empty for that of params_file'),
    'frame_prefix': ('', 'prefix of the names of TF frames; empty for that of params_file'),
}


def described(
    start: Callable[[LaunchContext], list[Action]],
    names: Iterable[str] = ARGUMENTS,
    **own: Mapping[str, Any],
) -> LaunchDescription:
    """Return arguments, and the actions that ``start`` returns for their values.

    The arguments are ``names`` of `ARGUMENTS` and those of one launch file, ``own``.
    """
    shared = {name: dict(zip(('default_value', 'description'), ARGUMENTS[name])) for name in names}
    arguments = [DeclareLaunchArgument(name, **how) for name, how in (shared | own).items()]
    return LaunchDescription([*arguments, OpaqueFunction(function=start)])


def require(*packages: str) -> None:
    """Raise ConfigError unless ``packages`` are installed: launch leaves started nodes behind."""
    if missing := sorted(set(packages) - get_packages_with_prefixes().keys()):
        raise ConfigError(f'needs {", ".join(missing)}, expected ROS packages that are installed')


def value_of(name: str, context: LaunchContext) -> str:
    """Return the value of the launch argument ``name``."""
    return str(LaunchConfiguration(name).perform(context))


def is_true(name: str, context: LaunchContext) -> bool:
    """Whether the argument ``name`` is true or 1; launch fails unless it is false or 0."""
    return bool(IfCondition(LaunchConfiguration(name)).evaluate(context))


def params_file(context: LaunchContext) -> str:
    """Return the path of params_file, which may be a preset; ConfigError if there is none."""
    return str(find_path(value_of('params_file', context)))


def base_frame(context: LaunchContext) -> str:
    """Return the frame that the arm is expressed in, or '' if no RViz is to show it.

    The node alone can read files of several nodes, whose frame is not known here.
    """
    if (frame := value_of('base_frame', context)) or not is_true('rviz', context):
        return frame
    return load_config(params_file(context)).base_frame


def text(name: str) -> ParameterValue:
    """Return the argument ``name`` as a string parameter, even if YAML reads it as a number."""
    return ParameterValue(LaunchConfiguration(name), value_type=str)


def sim_time() -> dict[str, ParameterValue]:
    """Return the parameter use_sim_time with the value of the argument of that name."""
    return {'use_sim_time': ParameterValue(LaunchConfiguration('use_sim_time'), value_type=bool)}


def overrides(context: LaunchContext, *names: str) -> dict[str, ParameterValue]:
    """Return a parameter for each of the arguments ``names`` that is not empty."""
    return {name: text(name) for name in names if value_of(name, context)}


def arm_node(context: LaunchContext, program: str = 'octo_arm_node', **parameters: Any) -> Node:
    """Return the node of an arm; the launch arguments give its namespace and overrides."""
    return node(
        program,
        program.removesuffix('_node'),
        LaunchConfiguration('namespace'),
        params_file(context),
        sim_time() | overrides(context, 'model', 'base_frame', 'frame_prefix') | parameters,
    )


def node(executable: str, name: str, namespace: Any, *parameters: Any) -> Node:
    """Return a node of this package; later ``parameters`` override earlier ones."""
    return Node(
        package=PACKAGE,
        executable=executable,
        name=name,
        namespace=namespace,
        parameters=list(parameters),
        output='screen',
    )


def rviz(view: str, frame: Any, namespace: Any = '') -> Action:
    """Return an action that starts RViz with the configuration ``view`` if ``rviz`` is true.

    It shows what is in ``frame``, of topics relative to ``namespace``. If RViz is not installed,
    the action logs that: a failure would end the launch and leave its started nodes behind.
    """
    condition = IfCondition(LaunchConfiguration('rviz'))
    if 'rviz2' not in get_packages_with_prefixes():
        return LogInfo(msg='no RViz: the package rviz2 is not installed', condition=condition)
    path = PathJoinSubstitution([FindPackageShare(PACKAGE), 'rviz', view])
    return Node(
        package='rviz2',
        executable='rviz2',
        name='rviz',
        namespace=namespace,
        arguments=['-d', path, '-f', frame],
        parameters=[sim_time()],
        condition=condition,
    )
