"""Solves the arm for the tensions and the tip wrench of messages, and offers services."""

import copy
import time
from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any

import numpy as np
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Path
from octo_arm_msgs.msg import SectionStrains
from octo_arm_msgs.srv import FindTensions, Solve
from rclpy.node import Node
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
from octo_arm_model.ros.work import QueuedService
from octo_arm_model.wire.backbone import TIP_POSE, BackboneWriter
from octo_arm_model.wire.messages import Stamp
from octo_arm_model.wire.tensions import DISPLACEMENTS, TENDON_TENSIONS, read_displacements

TIP_FRAME = 'tip'  # follows the prefix of frames


class TipWrench:
    """The wrench on the tip, from messages.

    A wrench in base_frame keeps its direction. A wrench in the tip frame, or in a frame that
    static transforms connect to it, turns with the tip and acts at the origin of its frame. Any
    other frame that transforms connect to base_frame gives only the axes, at the message's stamp.

    Attributes:
        value: the newest wrench (6,) [N, N m], in base_frame or the axes of the tip, or None.
        is_following: whether the wrench turns with the tip.
    """

    def __init__(self, frames: SensorFrames, current: Callable[[], Prepared]) -> None:
        """Start without a wrench; ``current`` returns the arm that wrenches act on."""
        self._frames, self._current = frames, current
        self.value: FloatArray | None = None
        self.is_following = False

    def acting(self) -> tuple[Solver, FloatArray | None]:
        """Return the solver of the arm under the wrench, and the wrench to solve it with, or None.

        ConfigError if the model of the arm has no loads.
        """
        prepared = self._current()
        if self.value is None or not self.is_following:
            return prepared.solver, self.value
        solver, load = prepared.followed
        load.force, load.moment = tuple(self.value[:3].tolist()), tuple(self.value[3:].tolist())
        return solver, None

    def change_arm(self, before: Prepared, now: Prepared) -> str:
        """Drop a wrench that does not fit the arm ``now``; return the reason, or ''."""
        if self.value is None:
            return ''
        try:
            now.solver.check_tip_wrench(self.value)
            problem = ''
        except OctoArmError as error:
            problem = str(error)
        previous_frame, frame = before.config.base_frame, now.config.base_frame
        if frame != previous_frame:
            problem = f'it was given in {previous_frame!r}, and base_frame is {frame!r}'
        if problem:
            self.value = None
        return problem

    def take(self, topic: str, message: WrenchStamped) -> None:
        """Keep the wrench of a ``message``; OctoArmError if it or its frame is invalid."""
        prepared = self._current()
        wrench, frame = wrench_values(message.wrench), str(message.header.frame_id)
        config, stamp = prepared.config, Stamp.of(message.header.stamp).ns
        tip, is_following = config.frame_prefix + TIP_FRAME, False
        # This check comes first, so that an invalid wrench is refused whatever its frame.
        prepared.solver.check_tip_wrench(wrench)
        if frame == tip:
            is_following = True
        elif frame not in ('', config.base_frame):
            is_following = self._frames.are_fixed(frame, tip)
            if not is_following and self._frames.is_beyond(frame, tip):
                problem = f'its frame is {frame[:99]!r}, which moves on {tip!r}'
                raise LoadError(f'{problem}, expected static transforms between the two')
            pose = self._frames.pose_of(frame, tip if is_following else config.base_frame, stamp)
            rotated = pose.rotation.apply(wrench.reshape(2, 3))
            if is_following:
                rotated[1] += np.cross(np.array(pose.position), rotated[0])
            wrench = rotated.ravel()
            prepared.solver.check_tip_wrench(wrench)
        self.value, self.is_following = wrench if wrench.any() else None, is_following


def _highest(request: FindTensions.Request, solver: Solver) -> FloatArray:
    highest = np.array(request.highest, dtype=np.float64)
    if highest.size == 0:
        return default_highest(solver.arm)
    if highest.size == 1:
        return np.full(solver.arm.tension_shape, highest[0])
    if highest.size != len(solver.arm.tendons):
        raise TargetError(
            f'highest has {highest.size} values, expected {len(solver.arm.tendons)}, one or none'
        )
    return highest.reshape(solver.arm.tension_shape)


def _target(request: FindTensions.Request) -> Target:
    point, q = request.tip.position, request.tip.orientation
    position = np.array([point.x, point.y, point.z])
    if request.target == FindTensions.Request.TIP_POSITION:
        return TipPosition(position)
    if request.target == FindTensions.Request.TIP_POSE:
        return TipPose(position, np.array([q.x, q.y, q.z, q.w]))
    if request.target == FindTensions.Request.BENDING:
        return Bending(request.plane, request.angle)
    raise TargetError(f'target is {request.target}, expected 0 position, 1 pose or 2 bending')


class ArmServer(Server[Prepared, BackbonePublishers]):
    """Publishes the backbone for tensions and displacements, and offers services."""

    def __init__(self, node: Node) -> None:
        """Declare the parameters of ``node``; ConfigError if a value has the wrong type."""
        super().__init__(node, PARAMETERS, Prepared.of, BackbonePublishers)
        self._services: list[QueuedService] = []
        self._tip_wrench = TipWrench(self._frames, lambda: self._arm)
        self._wrench: LatestSubscription | None = None
        self._driven_arm = self._diagnostics.arm = DrivenArm()
        self._diagnostics.is_used = self._is_used

    def _open(self) -> None:
        self._inputs.subscribe(JointState, DISPLACEMENTS, partial(self._on_motors, ''))
        # Only tensions are answered: a wrench that a newer one replaces does not count as skipped.
        self._wrench = self._inputs.subscribe(
            WrenchStamped, 'tip_wrench', self._tip_wrench.take, is_answered=False
        )
        # Copies the solver once, for the thread of this service, which may outlive its activation.
        own_solver = lru_cache(maxsize=1)(copy.copy)
        self._services = [
            QueuedService(self._node, Solve, 'solve', partial(self._on_solve, own_solver)),
            QueuedService(self._node, FindTensions, 'find_tensions', self._on_find_tensions),
        ]

    def _close(self) -> None:
        for service in self._services:
            service.close()
        self._services, self._wrench, self._tip_wrench.value = [], None, None
        self._driven_arm.reset()

    def _change_arm(self, before: Prepared | None, now: Prepared) -> None:
        config, logger = now.config, self._node.get_logger()
        if before is not None:
            if problem := self._tip_wrench.change_arm(before, now):
                logger.warning(f'tip_wrench dropped: {problem}')
            for dropped in self._driven_arm.change_config(before.config, config):
                logger.warning(dropped)
        how = ' (compiled)' if now.solver.is_compiled else ''
        logger.info(
            f'{config.model}{how}, {len(config.arm.sections)} section(s), {config.arm.length} m, '
            f'{config.stations} stations in {config.base_frame}; tendons from the tip: '
            + ' '.join(config.arm.tendon_names)
        )

    def _is_used(self, topic: str) -> bool:
        """Whether the newest message on ``topic`` has an effect on the shape."""
        by_length = len(self._driven_arm.displacements)
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
        """Publish the shape for load cell ``readings`` [N] or ``displacements`` [m], or refuse."""
        config, outbox, driven_arm = self._arm.config, self._publishers, self._driven_arm
        assert outbox is not None
        if self._wrench is not None:  # a wrench that came before these readings
            self._wrench.answer_latest()
        self._diagnostics.received(topic, stamp, is_tensions=readings is not None)
        resolved = self._diagnostics.clock.time_of(stamp)
        start = time.perf_counter()
        tensions = None
        if readings is not None:
            tensions = config.load_cells.tensions(config.arm, readings)
        solver, wrench = self._tip_wrench.acting()
        answer = driven_arm.answer(
            solver,
            config,
            wrench,
            resolved.ns,
            tensions,
            displacements,
            has_covariance=outbox.is_tip_heard,
        )
        duration = time.perf_counter() - start
        outbox.publish(answer.backbone, answer.covariance, resolved)
        if answer.unknown is not None:
            self._diagnostics.tip_unknown(answer.unknown)
            self._diagnostics.log.add(f'{TIP_POSE} not published', in_short(answer.unknown))
        if driven_arm.displacements:
            outbox.publish_tensions(answer.backbone, resolved)
        self._diagnostics.answered(answer.backbone, duration)

    def _on_motors(self, field: str, topic: str, message: Any) -> None:
        config = self._arm.config
        displacements = read_displacements(message, config.arm, config.encoders, field)
        self._publish_shape(topic, stamp_of(message), displacements=displacements)

    def _on_solve(
        self,
        own_solver: Callable[[Solver], Solver],
        request: Solve.Request,
        response: Solve.Response,
        pause: Callable[[], None],
    ) -> None:
        arm = self._arm  # another one may take its place meanwhile
        solver, frame = own_solver(arm.solver), arm.config.base_frame
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
        self,
        request: FindTensions.Request,
        response: FindTensions.Response,
        pause: Callable[[], None],
    ) -> None:
        arm = self._arm
        solver, frame = copy.copy(arm.solver), arm.config.base_frame
        now = self._node.get_clock().now().to_msg()
        try:
            axis, stiffness = request.stiffness_direction, None
            if request.stiffness != 0.0:
                stiffness = Stiffness(np.array([axis.x, axis.y, axis.z]), request.stiffness)
            arguments = solver, _target(request), _highest(request, solver)
            inverse = find_tensions(*arguments, stiffness=stiffness, pause=pause)
        except OctoArmError as error:
            response.success, response.message = False, str(error)
            return
        response.success, response.reached, response.error = True, inverse.reached, inverse.error
        response.message = '' if inverse.reached else 'out of reach; this is as near as was found'
        response.tensions = tensions_message(inverse.backbone.tensions, solver.arm, now, frame)
        response.tip = pose_message(inverse.backbone.position[-1], inverse.backbone.quaternion[-1])
