"""What can be measured of an arm: value, covariance, what a state predicts, and its derivatives.

A new measurement is one more class that is a `Measurement`.
"""

from __future__ import annotations

import abc
import functools
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from octo_arm_model.core.arm.validation import real_numbers
from octo_arm_model.core.errors import MeasurementError, shown
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.numerics.vectors import left_jacobian
from octo_arm_model.estimation.prediction import Prediction

_LARGEST = 1000  # numbers in one measurement


class Measurement(abc.ABC):
    """Something measured.

    Attributes:
        name: of its kind.
        is_linear: whether it depends on the state alone, linearly, and not on the shape.
        value: what was measured, (m,).
        covariance: of its error, (m, m).
    """

    name: ClassVar[str]
    is_linear: ClassVar[bool] = False

    def __init__(self, value: ArrayLike, noise: ArrayLike) -> None:
        """Take ``value`` with ``noise``.

        That is one standard deviation for all numbers, one for each, (m,), or a covariance
        (m, m).

        Raises:
            MeasurementError: if they are not finite numbers of such sizes, or the noise is no
                positive definite covariance.
        """
        self.value = _numbers(f'{self.name}: value', value).ravel()
        size = self.value.size
        if not 0 < size <= _LARGEST:
            expected = f'1 to {_LARGEST} numbers'
            raise MeasurementError(f'{self.name}: value has {size} numbers, expected {expected}')
        given = _numbers(f'{self.name}: noise', noise)
        if given.ndim < 2 and given.size in (1, size):
            if not (given > 0.0).all():
                raise MeasurementError(
                    f'{self.name}: noise is {shown(noise)}, expected standard deviations > 0'
                )
            self.covariance = np.diag(np.broadcast_to(given, size) ** 2)
            self.noise_root: FloatArray = np.sqrt(self.covariance)
            return
        if given.shape != (size, size):
            raise MeasurementError(
                f'{self.name}: noise has shape {given.shape}, expected {size} standard deviations '
                f'or a covariance ({size}, {size})'
            )
        self.covariance = 0.5 * (given + given.T)
        try:
            self.noise_root = np.asarray(np.linalg.cholesky(self.covariance), np.float64)
        except np.linalg.LinAlgError:
            raise MeasurementError(
                f'{self.name}: noise is {shown(noise)}, expected a positive definite covariance'
            ) from None

    @abc.abstractmethod
    def innovation(self, at: Prediction) -> FloatArray:
        """What was measured less what is predicted, (m,)."""

    @abc.abstractmethod
    def jacobian(self, at: Prediction) -> FloatArray:
        """Change of what is predicted by the state, (m, state)."""

    def _check_size(self, expected: int, what: str) -> None:
        if self.value.size != expected:
            raise MeasurementError(
                f'{self.name}: value has {self.value.size} numbers, expected {expected}: {what}'
            )


class _OfTendons(Measurement):
    """One number for each of some tendons."""

    def __init__(
        self, value: ArrayLike, noise: ArrayLike, tendons: tuple[str, ...] | None = None
    ) -> None:
        """One number for each of ``tendons`` by name; of all, in the order of the arm, if None."""
        super().__init__(value, noise)
        self._tendons = tendons

    def _which(self, at: Prediction) -> IntArray:
        names = at.model.arm.tendon_names
        wanted = names if self._tendons is None else self._tendons
        self._check_size(len(wanted), 'one for each tendon')
        for name in wanted:
            if name not in names:
                known = ', '.join(names)
                raise MeasurementError(f'{self.name}: unknown tendon {name}; this arm has {known}')
        return np.array([names.index(name) for name in wanted])


class Tensions(_OfTendons):
    """Tensions as load cells show them, bias included [N]."""

    name = 'tensions'
    is_linear = True

    def innovation(self, at: Prediction) -> FloatArray:
        """What was measured less what is predicted, (m,) [N]."""
        return self.value - self.jacobian(at) @ at.x

    def jacobian(self, at: Prediction) -> FloatArray:
        """Change of what is predicted by the state, (m, state)."""
        which, state = self._which(at), at.model.state
        jacobian = np.zeros((which.size, state.size))
        rows = np.arange(which.size)
        jacobian[rows, state.tension.start + which] = 1.0
        if state.tension_bias.stop > state.tension_bias.start:
            jacobian[rows, state.tension_bias.start + which] = 1.0
        return jacobian


class TendonDisplacements(_OfTendons):
    """Length that the winch of each tendon has reeled in [m].

    By so much it is shorter within the arm than without tensions, and stretched itself.
    """

    name = 'tendon displacements'

    def innovation(self, at: Prediction) -> FloatArray:
        """What was measured less what is predicted, (m,) [m]."""
        stretched = at.model.tendon_compliance * at.x[at.model.state.tension]
        drawn_in = at.model.solver.rest_lengths.ravel() - at.tendon_lengths + stretched
        return self.value - drawn_in[self._which(at)]

    def jacobian(self, at: Prediction) -> FloatArray:
        """Change of what is predicted by the state, (m, state)."""
        by_state, state = -at.change.tendon_length, at.model.state
        by_state[:, state.tension] += np.diag(at.model.tendon_compliance)
        return by_state[self._which(at)]


class TipPosition(Measurement):
    """Position of the tip in base_frame, (3,) [m]."""

    name = 'tip position'

    def innovation(self, at: Prediction) -> FloatArray:
        """What was measured less what is predicted, (3,) [m]."""
        self._check_size(3, 'x, y, z')
        return self.value - at.solved.tip

    def jacobian(self, at: Prediction) -> FloatArray:
        """Change of what is predicted by the state, (3, state)."""
        return at.change.tip[:3]


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
        at = _numbers('tip pose: position', position)
        turned = _numbers('tip pose: quaternion', quaternion)
        if at.shape != (3,) or turned.shape != (4,):
            raise MeasurementError('tip pose: expected a position (3,) and a quaternion (4,)')
        if abs(np.linalg.norm(turned) - 1.0) > 1e-3:
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


class _AtPlaces(Measurement):
    """As many numbers at each of some s as there are ``components``."""

    components: ClassVar[tuple[str, ...]]

    def __init__(self, s: ArrayLike, value: ArrayLike, noise: ArrayLike) -> None:
        """At ``s`` (n,) [m] a ``value`` (n, components).

        Raises:
            MeasurementError: as `Measurement`; if there is not one value for each s.
        """
        super().__init__(value, noise)
        self.s = _numbers(f'{self.name}: s', s)
        expected = len(self.components) * self.s.size
        self._check_size(expected, f'{", ".join(self.components)} at each s')


class Markers(_AtPlaces):
    """Positions of points of the midline at known s, in base_frame, (n, 3) [m]."""

    name = 'markers'
    components = ('x', 'y', 'z')

    def innovation(self, at: Prediction) -> FloatArray:
        """What was measured less what is predicted, (3 n,) [m]."""
        return self.value - (_interpolation(at, self.s) @ at.solved.position).ravel()

    def jacobian(self, at: Prediction) -> FloatArray:
        """Change of what is predicted by the state, (3 n, state)."""
        moved = np.tensordot(_interpolation(at, self.s), at.change.pose[:, :3], axes=1)
        return moved.reshape(self.value.size, -1)


class Curvatures(_AtPlaces):
    """Curvatures xi about n and k about b at the stations nearest to known s, (n, 2) [1/m].

    As fibre sensors measure them.
    """

    name = 'curvatures'
    components = ('xi', 'k')

    def innovation(self, at: Prediction) -> FloatArray:
        """What was measured less what is predicted, (2 n,) [1/m]."""
        stations, shape = self._stations(at), at.solved
        return self.value - np.stack([shape.xi, shape.k], axis=1)[stations].ravel()

    def jacobian(self, at: Prediction) -> FloatArray:
        """Change of what is predicted by the state, (2 n, state)."""
        change = at.change.strain[self._stations(at), 1:3]
        return change.reshape(self.value.size, -1)

    def _stations(self, at: Prediction) -> IntArray:
        s = at.model.solver.grid.s
        _check_on_arm(self.name, self.s, at)
        return np.searchsorted(0.5 * (s[1:] + s[:-1]), self.s)


def residuals(measurements: Sequence[Measurement], at: Prediction) -> FloatArray:
    """Innovations of all ``measurements``, one after the other."""
    return np.concatenate([one.innovation(at) for one in measurements])


def jacobians(measurements: Sequence[Measurement], at: Prediction) -> FloatArray:
    """Their Jacobians, one below the other."""
    return np.concatenate([one.jacobian(at) for one in measurements])


def noise_root(measurements: Sequence[Measurement]) -> FloatArray:
    """Root of the covariance of all ``measurements`` together."""
    return np.asarray(block_diag(*(one.noise_root for one in measurements)))


def _numbers(name: str, value: ArrayLike) -> FloatArray:
    array = real_numbers(value)
    if array is None or not np.isfinite(array).all():
        raise MeasurementError(f'{name} is {shown(value)}, expected finite numbers')
    return array.copy()


def _check_on_arm(name: str, s: FloatArray, at: Prediction) -> None:
    length = at.model.arm.length
    if s.ndim != 1 or not ((s >= 0.0) & (s <= length)).all():
        raise MeasurementError(f'{name}: s is {shown(s)}, expected within [0, {length}] [m]')


def _interpolation(at: Prediction, s: FloatArray) -> FloatArray:
    """Weights (n, stations) of the positions of stations in those at ``s``: a cubic spline."""
    _check_on_arm('markers', s, at)
    stations = at.model.solver.grid.s
    return _spline_weights(tuple(stations.tolist()), tuple(s.tolist()))


@functools.lru_cache(maxsize=8)
def _spline_weights(stations: tuple[float, ...], s: tuple[float, ...]) -> FloatArray:
    return np.asarray(CubicSpline(stations, np.eye(len(stations)))(s))
