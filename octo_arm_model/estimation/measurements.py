"""The measurements of an arm: of its tendons, of its tip, of points along it, and of its base.

A new kind of measurement is a subclass of `Measurement`.
"""

from __future__ import annotations

import functools
import math
from typing import ClassVar

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import MeasurementError, TensionError, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.loads import Loads
from octo_arm_model.estimation.measurement import Measurement, checked_numbers
from octo_arm_model.estimation.model import ArmModel, Prediction
from octo_arm_model.rod.loads import force_per_length
from octo_arm_model.rod.rotations import left_jacobian
from octo_arm_model.rod.stations import StationGrid, nearest

__all__ = [
    'LOAD_CELL',
    'BaseWrench',
    'Curvatures',
    'Markers',
    'Measurement',
    'TendonDisplacements',
    'Tensions',
    'TipPose',
    'TipPosition',
]
_GAUSS = 4  # points of the quadrature of loads between two stations
LOAD_CELL = 'load cell'  # first part of a sensor's name; the tendon's name follows


class _TendonMeasurement(Measurement):
    """A measurement with one number for each of some tendons."""

    def __init__(
        self, value: ArrayLike, noise: ArrayLike, tendons: tuple[str, ...] | None = None
    ) -> None:
        """Store one number for each of ``tendons``, by name; None: all in the arm's order."""
        super().__init__(value, noise)
        self._tendons = tendons

    def _indices(self, prediction: Prediction) -> tuple[int, ...]:
        names = prediction.model.arm.tendon_names
        selected = names if self._tendons is None else self._tendons
        self.check_size(len(selected), 'one for each tendon')
        if unknown := [name for name in selected if name not in names]:
            known = ', '.join(names)
            raise MeasurementError(
                f'{self.name}: unknown tendon {unknown[0]}; this arm has {known}'
            )
        return tuple(map(names.index, selected))


class Tensions(_TendonMeasurement):
    """A measurement of tensions by load cells, which show them with their bias [N]."""

    name = 'tensions'
    is_linear = True

    def innovation(self, prediction: Prediction) -> FloatArray:
        """Return the measured less the predicted tensions, (m,) [N]."""
        return self.value - self.jacobian(prediction) @ prediction.x

    def jacobian(self, prediction: Prediction) -> FloatArray:
        """Return the derivatives of the predicted tensions by the state, (m, state)."""
        return prediction.model.state.reading[list(self._indices(prediction))]

    def channels(self, prediction: Prediction) -> tuple[str, ...]:
        """Return the load cell of each number, (m,): every load cell is a sensor of its own."""
        names = prediction.model.arm.tendon_names
        return tuple(f'{LOAD_CELL} {names[number]}' for number in self._indices(prediction))


class TendonDisplacements(_TendonMeasurement):
    """A measurement of the length that the winch of each tendon has reeled in [m].

    It is the shortening of the path of the tendon in the arm, and the stretch of the tendon.
    """

    name = 'tendon displacements'

    def innovation(self, prediction: Prediction) -> FloatArray:
        """Return the measured less the predicted lengths, (m,) [m]."""
        indices, model = self._indices(prediction), prediction.model
        try:
            model.solver.check_displacements(self.value, indices)
        except TensionError as error:
            raise MeasurementError(str(error)) from None
        stretched = model.tendon_compliance * prediction.x[model.state.tension]
        reeled_in = model.solver.rest_lengths.ravel() - prediction.tendon_lengths + stretched
        return self.value - reeled_in[list(indices)]

    def jacobian(self, prediction: Prediction) -> FloatArray:
        """Return the derivatives of the predicted lengths by the state, (m, state)."""
        by_state, state = -prediction.change.tendon_length, prediction.model.state
        by_state[:, state.tension] += np.diag(prediction.model.tendon_compliance)
        return by_state[list(self._indices(prediction))]


class TipPosition(Measurement):
    """A measurement of the position of the tip in base_frame, (3,) [m]."""

    name = 'tip position'

    def innovation(self, prediction: Prediction) -> FloatArray:
        """Return the measured less the predicted position, (3,) [m]."""
        self.check_size(3, 'x, y, z')
        return self.value - prediction.solved.tip

    def jacobian(self, prediction: Prediction) -> FloatArray:
        """Return the derivatives of the predicted position by the state, (3, state)."""
        return prediction.change.tip[:3]

    def second(self, prediction: Prediction) -> FloatArray | None:
        """Return the second derivatives of the position by the state, (3, state, state)."""
        return prediction.tip_curvature


class TipPose(Measurement):
    """A measurement of the tip's pose in base_frame: position [m] and quaternion x, y, z, w.

    Its noise is that of the position and of a small rotation vector in base_frame, (6, 6).
    """

    name = 'tip pose'

    def __init__(self, position: ArrayLike, quaternion: ArrayLike, noise: ArrayLike) -> None:
        """Check and store a ``position`` [m] and a ``quaternion`` whose x axis is the tangent.

        Raises:
            MeasurementError: if numbers or noise are invalid, or the quaternion has not length 1.
        """
        position_array = checked_numbers('tip pose: position', position)
        quaternion_array = checked_numbers('tip pose: quaternion', quaternion)
        if position_array.shape != (3,) or quaternion_array.shape != (4,):
            raise MeasurementError('tip pose: expected a position (3,) and a quaternion (4,)')
        if abs(math.hypot(*quaternion_array.tolist()) - 1.0) > 1e-3:
            raise MeasurementError(
                f'tip pose: quaternion is {shown(quaternion)}, expected length 1'
            )
        # The value has as many numbers as the error; the rotation is stored apart.
        super().__init__(np.concatenate([position_array, np.zeros(3)]), noise)
        self._quaternion = quaternion_array

    def innovation(self, prediction: Prediction) -> FloatArray:
        """Return the position error, and the rotation vector to the measured frame, (6,)."""
        position_error = self.value[:3] - prediction.solved.tip
        return np.concatenate([position_error, self._error(prediction).as_rotvec()])

    def jacobian(self, prediction: Prediction) -> FloatArray:
        """Return the derivatives of the predicted pose by the state, (6, state)."""
        jacobian = prediction.change.tip.copy()
        # The rotation vector changes by the right Jacobian, as the predicted frame turns.
        left_derivative = left_jacobian(-self._error(prediction).as_rotvec())
        jacobian[3:] = np.linalg.solve(left_derivative, jacobian[3:])
        return jacobian

    def _error(self, near: Prediction) -> Rotation:
        predicted = Rotation.from_quat(np.array(near.solved.quaternion[-1]))
        return Rotation.from_quat(self._quaternion) * predicted.inv()


class _PlacedMeasurement(Measurement):
    """A measurement with the numbers ``components`` at each of several s."""

    components: ClassVar[tuple[str, ...]]

    def __init__(self, s: ArrayLike, value: ArrayLike, noise: ArrayLike) -> None:
        """Check and store a ``value`` (n, components) at ``s`` (n,) [m].

        Raises:
            MeasurementError: if numbers or noise are invalid, or not as many as s.
        """
        super().__init__(value, noise)
        self.s = checked_numbers(f'{self.name}: s', s)
        expected = len(self.components) * self.s.size
        self.check_size(expected, f'{", ".join(self.components)} at each s')

    def _stations(self, prediction: Prediction) -> FloatArray:
        """Return the s of the stations [m], and check that those measured at are on the arm."""
        length, s = prediction.model.arm.length, self.s
        if s.ndim != 1 or not ((s >= 0.0) & (s <= length)).all():
            raise MeasurementError(
                f'{self.name}: s is {shown(s)}, expected within [0, {length}] [m]'
            )
        return prediction.model.solver.grid.s


class Markers(_PlacedMeasurement):
    """A measurement of points of the midline at known s, in base_frame, (n, 3) [m]."""

    name = 'markers'
    components = ('x', 'y', 'z')

    def innovation(self, prediction: Prediction) -> FloatArray:
        """Return the measured less the predicted positions, (3 n,) [m]."""
        return self.value - (self._weights(prediction) @ prediction.solved.position).ravel()

    def jacobian(self, prediction: Prediction) -> FloatArray:
        """Return the derivatives of the predicted positions by the state, (3 n, state)."""
        weights, by_state = self._weights(prediction), prediction.change.pose[:, :3]
        return np.tensordot(weights, by_state, axes=1).reshape(self.value.size, -1)

    def _weights(self, prediction: Prediction) -> FloatArray:
        """Return the weights (n, stations) of the stations by a cubic spline through them."""
        return _spline_weights(tuple(self._stations(prediction).tolist()), tuple(self.s.tolist()))


class Curvatures(_PlacedMeasurement):
    """A measurement of the curvatures xi and k at the stations nearest to s, (n, 2) [1/m].

    They are about n and b, as fibre sensors measure them.
    """

    name = 'curvatures'
    components = ('xi', 'k')

    def innovation(self, prediction: Prediction) -> FloatArray:
        """Return the measured less the predicted curvatures, (2 n,) [1/m]."""
        indices, shape = nearest(self.s, self._stations(prediction)), prediction.solved
        return self.value - np.stack([shape.xi, shape.k], axis=1)[indices].ravel()

    def jacobian(self, prediction: Prediction) -> FloatArray:
        """Return the derivatives of the predicted curvatures by the state, (2 n, state)."""
        change = prediction.change.strain[nearest(self.s, self._stations(prediction)), 1:3]
        return change.reshape(self.value.size, -1)


@functools.lru_cache(maxsize=8)
def _spline_weights(stations: tuple[float, ...], s: tuple[float, ...]) -> FloatArray:
    return np.asarray(CubicSpline(stations, np.eye(len(stations)))(s))


class BaseWrench(Measurement):
    """A measurement of the wrench of all external loads about the base, in base_frame, (6,).

    The sensor is under base and winches, so tendons exert internal forces only [N, N m].
    """

    name = 'base wrench'

    def innovation(self, prediction: Prediction) -> FloatArray:
        """Return the measured less the predicted wrench, (6,) [N, N m]."""
        self.check_size(6, 'force and moment')
        at_stations, free_moment = _unit_forces(prediction.model)
        magnitudes = np.append(prediction.x, 1.0)
        forces = at_stations @ magnitudes
        lever = prediction.solved.position - prediction.solved.position[0]
        moment = np.cross(lever, forces).sum(axis=0) + free_moment @ magnitudes
        return self.value - np.concatenate([forces.sum(axis=0), moment])

    def jacobian(self, prediction: Prediction) -> FloatArray:
        """Return the derivatives of the predicted wrench by the state, (6, state)."""
        at_stations, free_moment = _unit_forces(prediction.model)
        forces, by_magnitude = at_stations @ np.append(prediction.x, 1.0), at_stations[..., :-1]
        lever = prediction.solved.position - prediction.solved.position[0]
        moment = np.cross(lever[..., np.newaxis], by_magnitude, axis=1)
        moment += np.cross(prediction.change.pose[:, :3], forces[..., np.newaxis], axis=1)
        return np.concatenate([by_magnitude.sum(axis=0), moment.sum(axis=0) + free_moment[:, :-1]])


@functools.lru_cache(maxsize=8)
def _unit_forces(model: ArmModel) -> tuple[FloatArray, FloatArray]:
    """Return `forces_at_stations` of unit loads (stations, 3, state + 1), and their free moments.

    The last column is that of the known loads; the moments are (3, state + 1).
    """
    grid, state = model.solver.grid, model.state
    moment = np.zeros((3, state.size + 1))
    at_stations = np.zeros((grid.s.size, 3, state.size + 1))
    columns = range(state.size)[state.unit_loads]
    for column, loads in (*zip(columns, model.unit_loads), (state.size, model.loads)):
        at_stations[..., column] = forces_at_stations(model.arm, grid, loads)
        moments = [loads.tip_moment, *(point.moment for point in loads.points)]
        moment[:, column] = np.sum(moments, axis=0)
    at_stations[-1, :, :-1] += state.tip_wrench[:3]
    moment[:, :-1] += state.tip_wrench[3:]
    return at_stations, moment


def require_covered(loads: Loads) -> None:
    """Raise MeasurementError if there are loads whose forces the sum does not contain."""
    for kind in ('others', 'obstacles'):
        if getattr(loads, kind):
            raise MeasurementError(f'base wrench: loads.{kind} are not covered')


def forces_at_stations(arm: Arm, grid: StationGrid, loads: Loads) -> FloatArray:
    """Return forces at the stations (stations, 3) [N] with the moment of those of ``loads``.

    It is the same for every shape that is a cubic spline through the stations.

    Raises:
        MeasurementError: if there are loads in ``loads.others``, or obstacles.
    """
    require_covered(loads)
    points, weights = leggauss(_GAUSS)
    inner = [s for s in (*loads.knots, *arm.discs.faces) if 0.0 < s < arm.length]
    ends = np.union1d(grid.s, inner)
    half = 0.5 * np.diff(ends)[:, np.newaxis]
    s = (ends[:-1, np.newaxis] + half * (1.0 + points)).ravel()
    density = force_per_length(arm, s, loads) * (half * weights).reshape(-1, 1)
    cardinal = CubicSpline(grid.s, np.eye(grid.s.size))
    force = np.asarray(cardinal(s)).T @ density
    for point in loads.points:
        force += np.outer(cardinal(point.s), point.force)
    force[-1] += loads.tip_force
    return np.asarray(force)
