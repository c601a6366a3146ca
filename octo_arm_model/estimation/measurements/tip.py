"""What is measured of the tip: its position or its pose."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from octo_arm_model.arm.errors import MeasurementError, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.measurements.measurement import Measurement, numbers
from octo_arm_model.estimation.state.prediction import Prediction
from octo_arm_model.rod.rotations import left_jacobian


class TipPosition(Measurement):
    """Position of the tip in base_frame, (3,) [m]."""

    name = 'tip position'

    def innovation(self, at: Prediction) -> FloatArray:
        """What was measured less what is predicted, (3,) [m]."""
        self.check_size(3, 'x, y, z')
        return self.value - at.solved.tip

    def jacobian(self, at: Prediction) -> FloatArray:
        """Change of what is predicted by the state, (3, state)."""
        return at.change.tip[:3]

    def second(self, at: Prediction) -> FloatArray | None:
        """See `Measurement`."""
        return at.tip_curvature


class TipPose(Measurement):
    """Pose of the tip in base_frame: position [m] and quaternion x, y, z, w, (7,).

    Its noise is that of the position and of a small rotation vector in base_frame, (6, 6).
    """

    name = 'tip pose'

    def __init__(self, position: ArrayLike, quaternion: ArrayLike, noise: ArrayLike) -> None:
        """Take a ``position`` [m] and a ``quaternion`` x, y, z, w, whose x axis is the tangent.

        Raises:
            MeasurementError: as `Measurement`; if the quaternion is not of length 1.
        """
        at = numbers('tip pose: position', position)
        turned = numbers('tip pose: quaternion', quaternion)
        if at.shape != (3,) or turned.shape != (4,):
            raise MeasurementError('tip pose: expected a position (3,) and a quaternion (4,)')
        if abs(math.hypot(*turned.tolist()) - 1.0) > 1e-3:
            raise MeasurementError(
                f'tip pose: quaternion is {shown(quaternion)}, expected length 1'
            )
        # Only the noise has the size of an error.
        super().__init__(np.concatenate([at, np.zeros(3)]), noise)
        self._rotation = Rotation.from_quat(turned)

    def innovation(self, at: Prediction) -> FloatArray:
        """Position measured less predicted, and rotation vector from one to the other, (6,)."""
        return np.concatenate([self.value[:3] - at.solved.tip, self._away(at).as_rotvec()])

    def jacobian(self, at: Prediction) -> FloatArray:
        """Change of what is predicted by the state, (6, state)."""
        jacobian = at.change.tip.copy()
        # A rotation of the prediction comes before that vector: the right Jacobian.
        turned = left_jacobian(-self._away(at).as_rotvec())
        jacobian[3:] = np.linalg.solve(turned, jacobian[3:])
        return jacobian

    def _away(self, at: Prediction) -> Rotation:
        return self._rotation * Rotation.from_quat(np.array(at.solved.quaternion[-1])).inv()
