"""What can be measured of an arm: tendons, tip, places along it.

A new measurement is one more class that is a `Measurement`.
"""

from __future__ import annotations

import functools
import math
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from octo_arm_model.arm.errors import MeasurementError, TensionError, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.measurement import Measurement, numbers
from octo_arm_model.estimation.model import Prediction
from octo_arm_model.rod.rotations import left_jacobian
from octo_arm_model.rod.stations import nearest

__all__ = [
    'LOAD_CELL',
    'Curvatures',
    'Markers',
    'Measurement',
    'TendonDisplacements',
    'Tensions',
    'TipPose',
    'TipPosition',
]
LOAD_CELL = 'load cell'  # and the name of its tendon


class _TendonMeasurement(Measurement):
    """One number for each of some tendons."""

    def __init__(
        self, value: ArrayLike, noise: ArrayLike, tendons: tuple[str, ...] | None = None
    ) -> None:
        """One number for each of ``tendons`` by name; of all, in the order of the arm, if None."""
        super().__init__(value, noise)
        self._tendons = tendons

    def _which(self, at: Prediction) -> tuple[int, ...]:
        names = at.model.arm.tendon_names
        wanted = names if self._tendons is None else self._tendons
        self.check_size(len(wanted), 'one for each tendon')
        if unknown := [name for name in wanted if name not in names]:
            known = ', '.join(names)
            raise MeasurementError(
                f'{self.name}: unknown tendon {unknown[0]}; this arm has {known}'
            )
        return tuple(map(names.index, wanted))


class Tensions(_TendonMeasurement):
    """Tensions as load cells show them, bias included [N]."""

    name = 'tensions'
    is_linear = True

    def innovation(self, at: Prediction) -> FloatArray:
        """What was measured less what is predicted, (m,) [N]."""
        return self.value - self.jacobian(at) @ at.x

    def jacobian(self, at: Prediction) -> FloatArray:
        """Change of what is predicted by the state, (m, state)."""
        state = at.model.state
        return _one_hot(self._which(at), (state.tension, state.tension_bias), state.size)

    def channels(self, at: Prediction) -> tuple[str, ...]:
        """See `Measurement`: every load cell is a sensor of its own."""
        names = at.model.arm.tendon_names
        return tuple(f'{LOAD_CELL} {names[number]}' for number in self._which(at))


def _one_hot(which: tuple[int, ...], parts: tuple[slice, ...], size: int) -> FloatArray:
    """Matrix (numbers, ``size``) of ones where ``which`` of the ``parts`` are summed."""
    found = np.zeros((len(which), size))
    for part in parts:
        if part.stop > part.start:
            found[np.arange(len(which)), part.start + np.array(which)] = 1.0
    return found


class TendonDisplacements(_TendonMeasurement):
    """Length that the winch of each tendon has reeled in [m].

    By so much it is shorter within the arm than without tensions, and stretched itself.
    """

    name = 'tendon displacements'

    def innovation(self, at: Prediction) -> FloatArray:
        """What was measured less what is predicted, (m,) [m]."""
        which = self._which(at)
        try:
            at.model.solver.check_displacements(self.value, which)
        except TensionError as error:
            raise MeasurementError(str(error)) from None
        stretched = at.model.tendon_compliance * at.x[at.model.state.tension]
        drawn_in = at.model.solver.rest_lengths.ravel() - at.tendon_lengths + stretched
        return self.value - drawn_in[list(which)]

    def jacobian(self, at: Prediction) -> FloatArray:
        """Change of what is predicted by the state, (m, state)."""
        by_state, state = -at.change.tendon_length, at.model.state
        by_state[:, state.tension] += np.diag(at.model.tendon_compliance)
        return by_state[list(self._which(at))]


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


class _PlacedMeasurement(Measurement):
    """As many numbers at each of some s as there are ``components``."""

    components: ClassVar[tuple[str, ...]]

    def __init__(self, s: ArrayLike, value: ArrayLike, noise: ArrayLike) -> None:
        """At ``s`` (n,) [m] a ``value`` (n, components).

        Raises:
            MeasurementError: as `Measurement`; if there is not one value for each s.
        """
        super().__init__(value, noise)
        self.s = numbers(f'{self.name}: s', s)
        expected = len(self.components) * self.s.size
        self.check_size(expected, f'{", ".join(self.components)} at each s')

    def _stations(self, at: Prediction) -> FloatArray:
        """The s of the stations [m], between which the places are."""
        length, s = at.model.arm.length, self.s
        if s.ndim != 1 or not ((s >= 0.0) & (s <= length)).all():
            raise MeasurementError(
                f'{self.name}: s is {shown(s)}, expected within [0, {length}] [m]'
            )
        return at.model.solver.grid.s


class Markers(_PlacedMeasurement):
    """Positions of points of the midline at known s, in base_frame, (n, 3) [m]."""

    name = 'markers'
    components = ('x', 'y', 'z')

    def innovation(self, at: Prediction) -> FloatArray:
        """What was measured less what is predicted, (3 n,) [m]."""
        return self.value - (self._weights(at) @ at.solved.position).ravel()

    def jacobian(self, at: Prediction) -> FloatArray:
        """Change of what is predicted by the state, (3 n, state)."""
        moved = np.tensordot(self._weights(at), at.change.pose[:, :3], axes=1)
        return moved.reshape(self.value.size, -1)

    def _weights(self, at: Prediction) -> FloatArray:
        """Those (n, stations) of the positions of stations: a cubic spline."""
        return _spline_weights(tuple(self._stations(at).tolist()), tuple(self.s.tolist()))


class Curvatures(_PlacedMeasurement):
    """Curvatures xi about n and k about b at the stations nearest to known s, (n, 2) [1/m].

    As fibre sensors measure them.
    """

    name = 'curvatures'
    components = ('xi', 'k')

    def innovation(self, at: Prediction) -> FloatArray:
        """What was measured less what is predicted, (2 n,) [1/m]."""
        nearby, shape = nearest(self.s, self._stations(at)), at.solved
        return self.value - np.stack([shape.xi, shape.k], axis=1)[nearby].ravel()

    def jacobian(self, at: Prediction) -> FloatArray:
        """Change of what is predicted by the state, (2 n, state)."""
        change = at.change.strain[nearest(self.s, self._stations(at)), 1:3]
        return change.reshape(self.value.size, -1)


@functools.lru_cache(maxsize=8)
def _spline_weights(stations: tuple[float, ...], s: tuple[float, ...]) -> FloatArray:
    return np.asarray(CubicSpline(stations, np.eye(len(stations)))(s))
