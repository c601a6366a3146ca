"""Wrenches on the tip, in the frame of the arm, of its tip or of a sensor."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from geometry_msgs.msg import WrenchStamped
from scipy.spatial.transform import Rotation

from octo_arm_model.arm.errors import LoadError, OctoArmError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.solver import Solver
from octo_arm_model.ros.messages import wrench_values
from octo_arm_model.ros.node.prepared_arm import Prepared
from octo_arm_model.ros.node.sensor_frames import SensorFrames
from octo_arm_model.wire.stamp import Stamp

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
        wrench, is_following = self._placed(message, prepared)
        prepared.solver.check_tip_wrench(wrench)
        self.value, self.is_following = wrench if wrench.any() else None, is_following

    def _placed(self, message: WrenchStamped, prepared: Prepared) -> tuple[FloatArray, bool]:
        """The wrench of a ``message`` about the tip, and whether it turns with it.

        Raises:
            MeasurementError: if its frame is not known.
            LoadError: if it moves on the tip.
        """
        wrench, frame = wrench_values(message.wrench), str(message.header.frame_id)
        config, stamp = prepared.config, Stamp.of(message.header.stamp).ns
        tip = config.frame_prefix + TIP_FRAME
        if frame in ('', config.base_frame):
            return wrench, False
        if frame == tip:
            return wrench, True
        # Not measured yet: what is no number would be refused as such.
        prepared.solver.check_tip_wrench(wrench)
        is_following = self._frames.are_fixed(frame, tip)
        if not is_following and self._frames.is_beyond(frame, tip):
            problem = f'its frame is {frame[:99]!r}, which moves on {tip!r}'
            raise LoadError(f'{problem}, expected static transforms between the two')
        pose = self._frames.pose_of(frame, tip if is_following else config.base_frame, stamp)
        turned = Rotation.from_quat(np.array(pose.quaternion)).apply(wrench.reshape(2, 3))
        if is_following:
            turned[1] += np.cross(np.array(pose.position), turned[0])
        return turned.ravel(), is_following
