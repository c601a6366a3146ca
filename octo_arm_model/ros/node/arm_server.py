"""Answers tensions with the shape of the arm under a wrench on its tip, and requests."""

import copy
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Path
from octo_arm_msgs.msg import SectionStrains
from octo_arm_msgs.srv import FindTensions, Solve
from rclpy.node import Node
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState

from octo_arm_model.analysis.driven_arm import DrivenArm
from octo_arm_model.analysis.inverse import find_tensions
from octo_arm_model.analysis.targets import Bending, Stiffness, Target, TipPose, TipPosition
from octo_arm_model.arm.errors import LoadError, OctoArmError, TargetError, in_short
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.stiffness import default_highest
from octo_arm_model.config.parameters import PARAMETERS
from octo_arm_model.rod.solver import Solver
from octo_arm_model.ros.node.inputs import LatestSubscription, stamp_of
from octo_arm_model.ros.node.outputs import BackbonePublishers
from octo_arm_model.ros.node.sensor_frames import SensorFrames
from octo_arm_model.ros.node.server import Prepared, Server
from octo_arm_model.ros.topics import decoded, pose_message, tensions_message, wrench_values
from octo_arm_model.ros.work import SLICE, QueuedService, Steps, sliced
from octo_arm_model.wire.backbone import TIP_POSE, BackboneWriter
from octo_arm_model.wire.messages import Stamp
from octo_arm_model.wire.tensions import DISPLACEMENTS, TENDON_TENSIONS, read_displacements

TIP_FRAME = 'tip'  # after the prefix of frames


class TipWrench:
    """The wrench on the tip that messages say.

    Those in base_frame keep their direction. Those in the frame of the tip, or in one that static
    transforms connect to it, turn with it, and act where that frame is. Of any other frame that
    transforms connect to base_frame the axes count alone, at the stamp of the message.

    Attributes:
        value: the last one (6,) [N, N m], in base_frame or in the axes of the tip; None for none.
        is_following: whether it turns with the tip.
    """

    def __init__(self, frames: SensorFrames, current: Callable[[], Prepared]) -> None:
        """Begin without a wrench; ``current`` returns the arm that wrenches act on."""
        self._frames, self._current = frames, current
        self.value: FloatArray | None = None
        self.is_following = False

    def acting(self) -> tuple[Solver, FloatArray | None]:
        """The solver of the arm under the wrench, and what is to be given to it.

        Raises:
            ConfigError: if the model of the arm has no loads.
        """
        prepared = self._current()
        if self.value is None or not self.is_following:
            return prepared.solver, self.value
        solver, load = prepared.followed
        load.force, load.moment = tuple(self.value[:3].tolist()), tuple(self.value[3:].tolist())
        return solver, None

    def change_arm(self, before: Prepared, now: Prepared) -> str:
        """Drop the wrench where it does not go with another arm; returns why, or ''."""
        if self.value is None:
            return ''
        try:
            now.solver.check_tip_wrench(self.value)
            problem = ''
        except OctoArmError as error:
            problem = str(error)
        given, frame = before.config.base_frame, now.config.base_frame
        if frame != given:
            problem = f'it was given in {given!r}, and base_frame is {frame!r}'
        if problem:
            self.value = None
        return problem

    def take(self, topic: str, message: WrenchStamped) -> None:
        """Keep the wrench of a ``message`` for the tensions to come.

        Raises:
            OctoArmError: if it is none, or its frame is not known.
        """
        prepared = self._current()
        wrench, frame = wrench_values(message.wrench), str(message.header.frame_id)
        config, stamp = prepared.config, Stamp.of(message.header.stamp).ns
        tip, is_following = config.frame_prefix + TIP_FRAME, False
        # First, so that a wrench that is no number is refused for that, whatever its frame.
        prepared.solver.check_tip_wrench(wrench)
        if frame == tip:
            is_following = True
        elif frame not in ('', config.base_frame):
            is_following = self._frames.are_fixed(frame, tip)
            if not is_following and self._frames.is_beyond(frame, tip):
                problem = f'its frame is {frame[:99]!r}, which moves on {tip!r}'
                raise LoadError(f'{problem}, expected static transforms between the two')
            pose = self._frames.pose_of(frame, tip if is_following else config.base_frame, stamp)
            turned = Rotation.from_quat(np.array(pose.quaternion)).apply(wrench.reshape(2, 3))
            if is_following:
                turned[1] += np.cross(np.array(pose.position), turned[0])
            wrench = turned.ravel()
            prepared.solver.check_tip_wrench(wrench)
        self.value, self.is_following = wrench if wrench.any() else None, is_following


def _highest(request: FindTensions.Request, solver: Solver) -> FloatArray:
    given = np.array(request.highest, dtype=np.float64)
    if given.size == 0:
        return default_highest(solver.arm)
    if given.size == 1:
        return np.full(solver.arm.tension_shape, given[0])
    if given.size != len(solver.arm.tendons):
        raise TargetError(
            f'highest has {given.size} values, expected {len(solver.arm.tendons)}, one or none'
        )
    return given.reshape(solver.arm.tension_shape)


def _target(request: FindTensions.Request) -> Target:
    place, turn = request.tip.position, request.tip.orientation
    position = np.array([place.x, place.y, place.z])
    if request.target == FindTensions.Request.TIP_POSITION:
        return TipPosition(position)
    if request.target == FindTensions.Request.TIP_POSE:
        return TipPose(position, np.array([turn.x, turn.y, turn.z, turn.w]))
    if request.target == FindTensions.Request.BENDING:
        return Bending(request.plane, request.angle)
    raise TargetError(f'target is {request.target}, expected 0 position, 1 pose or 2 bending')


class ArmServer(Server[Prepared, BackbonePublishers]):
    """Answers tensions and displacements with backbones, and offers services."""

    def __init__(self, node: Node) -> None:
        """Declare the parameters of ``node``.

        Raises:
            ConfigError: if a value is of another type than ROS needs.
        """
        super().__init__(node, PARAMETERS, Prepared.of, BackbonePublishers)
        self._services: list[QueuedService] = []
        self._tip_wrench = TipWrench(self._frames, lambda: self._arm)
        self._wrench: LatestSubscription | None = None
        self._winding = self._diagnostics.arm = DrivenArm()
        self._diagnostics.is_used = self._is_used

    def _open(self) -> None:
        node, work = self._node, self._inputs.work
        self._inputs.subscribe(JointState, DISPLACEMENTS, partial(self._on_motors, ''))
        # Tensions are answered, not wrenches: of these none counts as skipped.
        self._wrench = self._inputs.subscribe(
            WrenchStamped, 'tip_wrench', self._tip_wrench.take, is_answered=False
        )
        self._services = [
            QueuedService(node, Solve, 'solve', self._on_solve, work),
            QueuedService(node, FindTensions, 'find_tensions', self._on_find_tensions, work),
        ]

    def _close(self) -> None:
        for service in self._services:
            service.close()
        self._services, self._wrench, self._tip_wrench.value = [], None, None
        self._winding.reset()

    def _change_arm(self, before: Prepared | None, now: Prepared) -> None:
        config, logger = now.config, self._node.get_logger()
        self._inputs.forget()
        if before is not None:
            if problem := self._tip_wrench.change_arm(before, now):
                logger.warning(f'tip_wrench dropped: {problem}')
            for dropped in self._winding.change_config(before.config, config):
                logger.warning(dropped)
        how = ' (compiled)' if now.solver.is_compiled else ''
        logger.info(
            f'{config.model}{how}, {len(config.arm.sections)} section(s), {config.arm.length} m, '
            f'{config.stations} stations in {config.base_frame}; tendons from the tip: '
            + ' '.join(config.arm.tendon_names)
        )

    def _is_used(self, topic: str) -> bool:
        """Whether what came last on ``topic`` has an effect on the shape."""
        by_length = len(self._winding.displacements)
        if self._wrench is not None and topic == self._wrench.topic:
            return self._tip_wrench.value is not None
        if self._inputs.is_apart(topic):
            return bool(by_length)
        return by_length < len(self._arm.config.arm.tendons)

    def _on_readings(self, topic: str, stamp: Stamp | None, readings: FloatArray) -> None:
        self._publish_shape(topic, stamp, readings=readings)

    def _publish_shape(
        self,
        topic: str,
        stamp: Stamp | None,
        readings: FloatArray | None = None,
        displacements: dict[str, float] | None = None,
    ) -> None:
        """Answer ``readings`` of load cells or ``displacements``; OctoArmError if refused."""
        config, outbox, winding = self._arm.config, self._publishers, self._winding
        assert outbox is not None
        if self._wrench is not None:  # one that came before
            self._wrench.answer_latest()
        self._diagnostics.received(topic, stamp, is_tensions=readings is not None)
        at = self._diagnostics.clock.time_of(stamp)
        began = time.perf_counter()
        tensions = None
        if readings is not None:
            tensions = config.load_cells.tensions(config.arm, readings)
        solver, wrench = self._tip_wrench.acting()
        answer = winding.answer(
            solver,
            config,
            wrench,
            at.ns,
            tensions,
            displacements,
            has_covariance=outbox.is_tip_heard,
        )
        duration = time.perf_counter() - began
        outbox.publish(answer.backbone, answer.covariance, at)
        if answer.unknown is not None:
            self._diagnostics.tip_unknown(answer.unknown)
            self._refusal_log.say(TIP_POSE, f'not published: {in_short(answer.unknown)}')
        if winding.displacements:
            outbox.publish_tensions(answer.backbone, at)
        self._diagnostics.answered(answer.backbone, duration)

    def _on_motors(self, field: str, topic: str, message: Any) -> None:
        config = self._arm.config
        found = read_displacements(message, config.arm, config.encoders, field)
        self._publish_shape(topic, stamp_of(message), displacements=found)

    def _on_solve(self, request: Solve.Request, response: Solve.Response) -> Steps:
        yield from ()  # a single solve, which has a budget
        solver, frame = self._arm.solver, self._arm.config.base_frame
        try:
            tensions = TENDON_TENSIONS.read(request.tensions, solver.arm)
            wrench = wrench_values(request.tip_wrench)
            backbone = solver.solve(tensions, wrench if wrench.any() else None)
            lengths = solver.tendon_lengths(backbone)
        except OctoArmError as error:
            response.success, response.message = False, str(error)
            return
        response.success = True
        stamp = Stamp.of(request.tensions.header.stamp)
        writer = BackboneWriter(frame, backbone.model, solver.grid.s, solver.grid.section)
        response.path = decoded(writer.path(backbone, *stamp), Path)
        response.strains = decoded(writer.strains(backbone, *stamp), SectionStrains)
        response.tendon_length = lengths.ravel().tolist()
        response.residual = float(backbone.residual)
        response.iterations = int(backbone.iterations)

    def _on_find_tensions(
        self, request: FindTensions.Request, response: FindTensions.Response
    ) -> Steps:
        # A copy, as the solver of the node goes on meanwhile.
        solver, frame = copy.copy(self._arm.solver), self._arm.config.base_frame
        now = self._node.get_clock().now().to_msg()
        try:
            along, stiffness = request.stiffness_direction, None
            if request.stiffness != 0.0:
                stiffness = Stiffness(np.array([along.x, along.y, along.z]), request.stiffness)
            given = _target(request), _highest(request, solver)
            found = yield from sliced(
                lambda pause: find_tensions(solver, *given, stiffness=stiffness, pause=pause),
                SLICE,
            )
        except OctoArmError as error:
            response.success, response.message = False, str(error)
            return
        response.success, response.reached, response.error = True, found.reached, found.error
        response.message = '' if found.reached else 'out of reach; this is as near as was found'
        response.tensions = tensions_message(found.backbone.tensions, solver.arm, now, frame)
        response.tip = pose_message(found.backbone.position[-1], found.backbone.quaternion[-1])
