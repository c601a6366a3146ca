"""The node ``octo_arm_node``: tendon tensions in, backbone and strains out."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import rclpy
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped, WrenchStamped
from nav_msgs.msg import Path
from octo_arm_msgs.msg import SectionStrains, TendonTensions
from octo_arm_msgs.srv import FindTensions, Solve
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from octo_arm_model.arm import Arm
from octo_arm_model.backbone import Backbone
from octo_arm_model.config import Config
from octo_arm_model.errors import ConvergenceError, LoadError, OctoArmError
from octo_arm_model.hints import FloatArray
from octo_arm_model.ros.declare import read_parameters
from octo_arm_model.ros.health import Health
from octo_arm_model.ros.messages import (
    backbone_messages,
    lengths_message,
    tensions_from_array,
    tensions_from_joint_state,
    tensions_from_tendon_tensions,
    tip_message,
    wrench_from_stamped,
)
from octo_arm_model.ros.services import answer_find_tensions, answer_solve

# The newest tensions are the ones to answer; best effort hears reliable publishers as well.
INPUT_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
OUTPUT_QOS = QoSProfile(depth=5, reliability=ReliabilityPolicy.RELIABLE)
WARNING_PERIOD = 1.0  # [s] between warnings of refused messages
LONGEST_WAIT = 0.5  # [s] between looks at whether to go on


class OctoArmNode(Node):
    """Publishes the shape of the arm for every valid tension message."""

    def __init__(self, **options: Any) -> None:
        """Read the parameters, prepare the arm and start listening.

        Raises:
            ConfigError: if a parameter is missing, unknown or of the wrong type, or they do not go
                together.
            ArmDefinitionError: if the arm cannot exist.
        """
        super().__init__(
            'octo_arm', automatically_declare_parameters_from_overrides=True, **options
        )
        config = Config.from_parameters(read_parameters(self))
        self._solver = config.solver()
        self._uncertainty = config.uncertainty
        self._frame = config.base_frame
        self._tip_wrench: FloatArray | None = None
        self._last: Backbone | None = None
        self._health = Health(self, config.model)

        self._path = self.create_publisher(Path, 'backbone/path', OUTPUT_QOS)
        self._poses = self.create_publisher(PoseArray, 'backbone/poses', OUTPUT_QOS)
        self._strains = self.create_publisher(SectionStrains, 'strains', OUTPUT_QOS)
        self._tip = self.create_publisher(PoseWithCovarianceStamped, 'tip_pose', OUTPUT_QOS)
        self._lengths = self.create_publisher(JointState, 'tendon_lengths', OUTPUT_QOS)
        for message_type, topic, read in (
            (TendonTensions, 'tendon_tensions', tensions_from_tendon_tensions),
            (Float64MultiArray, 'tendon_tensions/array', tensions_from_array),
            (JointState, 'tendon_tensions/joint_state', tensions_from_joint_state),
        ):
            self.create_subscription(message_type, topic, self._callback(topic, read), INPUT_QOS)
        self.create_subscription(WrenchStamped, 'tip_wrench', self._on_wrench, INPUT_QOS)
        self.create_service(Solve, 'solve', self._on_solve)
        self.create_service(FindTensions, 'find_tensions', self._on_find_tensions)
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
                backbone = self._solve(read(message, self._solver.arm))
                lengths = self._solver.tendon_lengths(backbone)
                covariance = self._solver.tip_covariance(backbone, self._uncertainty)
            except OctoArmError as error:
                self._refuse(topic, error)
                return
            self._publish(backbone, lengths, covariance, self._stamp(message))
            self._health.answered(backbone)

        return answer

    def _solve(self, tensions: FloatArray) -> Backbone:
        """Follow the last solution; where that leads nowhere begin anew."""
        try:
            backbone = self._solver.solve(tensions, self._tip_wrench, self._last)
        except ConvergenceError:
            if self._last is None:
                raise
            backbone = self._solver.solve(tensions, self._tip_wrench)
        self._last = backbone
        return backbone

    def _publish(
        self, backbone: Backbone, lengths: FloatArray, covariance: FloatArray, stamp: Time
    ) -> None:
        arm, frame = self._solver.arm, self._frame
        path, poses, strains = backbone_messages(backbone, stamp, frame)
        self._path.publish(path)
        self._poses.publish(poses)
        self._strains.publish(strains)
        self._tip.publish(tip_message(backbone, covariance, stamp, frame))
        self._lengths.publish(lengths_message(lengths, backbone.tensions, arm, stamp, frame))

    def _on_wrench(self, message: WrenchStamped) -> None:
        """Keep the wrench for the tensions to come."""
        try:
            wrench = wrench_from_stamped(message, self._frame)
            if wrench.any() and self._solver.model != 'exact':
                raise LoadError(f'model is {self._solver.model!r}, which has no tip wrench')
        except OctoArmError as error:
            self._refuse('tip_wrench', error)
            return
        self._tip_wrench = wrench if wrench.any() else None

    def _on_solve(self, request: Solve.Request, response: Solve.Response) -> Solve.Response:
        return answer_solve(request, response, self._solver, self._frame)

    def _on_find_tensions(
        self, request: FindTensions.Request, response: FindTensions.Response
    ) -> FindTensions.Response:
        now = self.get_clock().now().to_msg()
        return answer_find_tensions(request, response, self._solver, self._frame, now)

    def _refuse(self, topic: str, error: OctoArmError) -> None:
        self._health.refused(f'{topic}: {error}')
        self.get_logger().warning(
            f'{topic} refused: {error}', throttle_duration_sec=WARNING_PERIOD
        )

    def _stamp(self, message: Any) -> Time:
        """Stamp of ``message``; the time of receipt where it has none or an unset one."""
        header = getattr(message, 'header', None)
        if header is None or (header.stamp.sec == 0 and header.stamp.nanosec == 0):
            return self.get_clock().now().to_msg()
        return header.stamp


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
