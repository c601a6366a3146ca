"""The measurement of the wrench under the base, which is the sum of all external loads."""

from __future__ import annotations

import functools

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.interpolate import CubicSpline

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.loads import Loads
from octo_arm_model.estimation.measurement import Measurement
from octo_arm_model.estimation.model import ArmModel, Prediction
from octo_arm_model.rod.loads import force_per_length
from octo_arm_model.rod.stations import StationGrid

_GAUSS = 4  # points of the quadrature between two stations


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
        moment = np.cross(_lever(prediction), forces).sum(axis=0) + free_moment @ magnitudes
        return self.value - np.concatenate([forces.sum(axis=0), moment])

    def jacobian(self, prediction: Prediction) -> FloatArray:
        """Return the derivatives of the predicted wrench by the state, (6, state)."""
        at_stations, free_moment = _unit_forces(prediction.model)
        forces, by_magnitude = at_stations @ np.append(prediction.x, 1.0), at_stations[..., :-1]
        moment = np.cross(_lever(prediction)[..., np.newaxis], by_magnitude, axis=1)
        moment += np.cross(prediction.change.pose[:, :3], forces[..., np.newaxis], axis=1)
        return np.concatenate([by_magnitude.sum(axis=0), moment.sum(axis=0) + free_moment[:, :-1]])


def _lever(prediction: Prediction) -> FloatArray:
    return prediction.solved.position - prediction.solved.position[0]


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
