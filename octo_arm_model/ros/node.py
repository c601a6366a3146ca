"""The node ``octo_arm_node``: tendon tensions in, backbone and strains out."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import rclpy
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseArray
from nav_msgs.msg import Path
from octo_arm_msgs.msg import SectionStrains, TendonTensions
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from octo_arm_model.arm import Arm
from octo_arm_model.config import Config
from octo_arm_model.errors import ConfigError, OctoArmError
from octo_arm_model.hints import FloatArray
from octo_arm_model.parameters import PARAMETERS, Parameter
from octo_arm_model.ros.messages import (
    backbone_messages,
    tensions_from_array,
    tensions_from_joint_state,
    tensions_from_tendon_tensions,
)

# The newest tensions are the ones to answer; best effort hears reliable publishers as well.
INPUT_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
OUTPUT_QOS = QoSProfile(depth=5, reliability=ReliabilityPolicy.RELIABLE)
WARNING_PERIOD = 1.0  # [s] between warnings of refused messages
LONGEST_WAIT = 0.5  # [s] between looks at whether to go on

_ROS_TYPES = {
    'double': RosParameter.Type.DOUBLE,
    'double[]': RosParameter.Type.DOUBLE_ARRAY,
    'integer': RosParameter.Type.INTEGER,
    'string': RosParameter.Type.STRING,
    'string[]': RosParameter.Type.STRING_ARRAY,
}
# What every rclpy node declares for itself.
_RCLPY_PARAMETERS = ('start_type_description_service', 'use_sim_time')


class OctoArmNode(Node):
    """Publishes the shape of the arm for every valid tension message."""

    def __init__(self, **options: Any) -> None:
        """Read the parameters, prepare the arm and start listening.

        Raises:
            ConfigError: if a parameter is missing, unknown or of the wrong type.
            ArmDefinitionError: if the arm cannot exist.
        """
        super().__init__(
            'octo_arm', automatically_declare_parameters_from_overrides=True, **options
        )
        config = Config.from_parameters(read_parameters(self))
        self._solver = config.solver()
        self._frame = config.base_frame
        self._path = self.create_publisher(Path, 'backbone/path', OUTPUT_QOS)
        self._poses = self.create_publisher(PoseArray, 'backbone/poses', OUTPUT_QOS)
        self._strains = self.create_publisher(SectionStrains, 'strains', OUTPUT_QOS)
        for message_type, topic, read in (
            (TendonTensions, 'tendon_tensions', tensions_from_tendon_tensions),
            (Float64MultiArray, 'tendon_tensions/array', tensions_from_array),
            (JointState, 'tendon_tensions/joint_state', tensions_from_joint_state),
        ):
            self.create_subscription(message_type, topic, self._callback(topic, read), INPUT_QOS)
        self.get_logger().info(
            f'{config.model}, {len(config.arm.sections)} section(s), {config.arm.length} m, '
            f'{config.stations} stations in {config.base_frame}; tendons from the tip: '
            + ' '.join(config.arm.tendon_names)
        )

    def _callback(
        self, topic: str, read: Callable[[Any, Arm], FloatArray]
    ) -> Callable[[Any], None]:
        def answer(message: Any) -> None:
            try:
                tensions = read(message, self._solver.arm)
                backbone = self._solver.solve(tensions)
            except OctoArmError as error:
                self.get_logger().warning(
                    f'{topic} refused: {error}', throttle_duration_sec=WARNING_PERIOD
                )
                return
            path, poses, strains = backbone_messages(backbone, self._stamp(message), self._frame)
            self._path.publish(path)
            self._poses.publish(poses)
            self._strains.publish(strains)

        return answer

    def _stamp(self, message: Any) -> Time:
        """Stamp of ``message``; the time of receipt where it has none or an unset one."""
        header = getattr(message, 'header', None)
        if header is None or (header.stamp.sec == 0 and header.stamp.nanosec == 0):
            return self.get_clock().now().to_msg()
        return header.stamp


def read_parameters(node: Node) -> dict[str, Any]:
    """Declare every parameter of the table on ``node``; return what was given.

    Raises:
        ConfigError: if an integer is given where ROS needs a double.
    """
    given = {
        name: node.get_parameter(name).value
        for name in node.get_parameters_by_prefix('')
        if name not in _RCLPY_PARAMETERS and not name.startswith('qos_overrides.')
    }
    for parameter in PARAMETERS:
        descriptor = ParameterDescriptor(
            name=parameter.name,
            description=parameter.description,
            type=_ROS_TYPES[parameter.type_name].value,
            read_only=True,
        )
        if parameter.name in given:
            _explain_integers(parameter, given[parameter.name])
            node.set_descriptor(parameter.name, descriptor)
        elif parameter.default:
            value = parameter.default
            value = list(value) if parameter.is_array else value
            node.declare_parameter(parameter.name, value, descriptor)
        else:
            ros_type = _ROS_TYPES[parameter.type_name]
            node.declare_parameter(parameter.name, ros_type, descriptor)
    return {name: list(v) if hasattr(v, 'typecode') else v for name, v in given.items()}


def _explain_integers(parameter: Parameter, value: Any) -> None:
    """Say what to write where YAML makes integers of what are meant as doubles."""
    if parameter.kind is not float:
        return
    elements = value if hasattr(value, '__len__') and not isinstance(value, str) else [value]
    if any(isinstance(element, int) and not isinstance(element, bool) for element in elements):
        meant = ', '.join(str(float(element)) for element in elements)
        meant = f'[{meant}]' if parameter.is_array else meant
        raise ConfigError(
            f'{parameter.name} is an integer, expected {parameter.type_name}: ROS keeps the two '
            f'apart, write {meant}'
        )


def main(arguments: list[str] | None = None) -> int:
    """Run the node until it is told to stop; returns the exit status."""
    try:
        rclpy.init(args=arguments)
    except RuntimeError as error:  # what rcl raises for arguments and files it cannot parse
        reason = str(error).split(', at /')[0]
        return _fail(f'{reason}; in a ROS parameter file a list of doubles needs 1.0, not 1')
    node = None
    try:
        node = OctoArmNode()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        # Not `spin`: a signal that arrives just before the executor waits does not wake it, and
        # it would wait for ever.
        while rclpy.ok():
            executor.spin_once(timeout_sec=LONGEST_WAIT)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except RuntimeError:
        # A signal may end the context while the executor builds its wait set on it.
        if rclpy.ok():
            raise
    except OctoArmError as error:
        return _fail(f'{error} (parameters come from --ros-args --params-file FILE)')
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _fail(problem: str) -> int:
    print(f'octo_arm_node: error: {problem}', file=sys.stderr)
    return 1


if __name__ == '__main__':
    sys.exit(main())
