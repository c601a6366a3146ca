"""The measurement of the wrench under the base, which is the sum of all external loads."""

from __future__ import annotations

import weakref
from typing import NamedTuple

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
        sums = _sums(prediction.model)
        magnitudes = np.append(prediction.x, 1.0)
        lever = prediction.solved.position - prediction.solved.position[0]
        moment = np.cross(lever, sums.at_stations @ magnitudes).sum(axis=0)
        predicted = np.concatenate([sums.force @ magnitudes, moment + sums.moment @ magnitudes])
        return self.value - predicted

    def jacobian(self, prediction: Prediction) -> FloatArray:
        """Return the derivatives of the predicted wrench by the state, (6, state)."""
        sums = _sums(prediction.model)
        lever = prediction.solved.position - prediction.solved.position[0]
        forces = sums.at_stations @ np.append(prediction.x, 1.0)
        moment = sums.moment[:, :-1] + np.cross(
            lever[:, :, np.newaxis], sums.at_stations[..., :-1], axis=1
        ).sum(axis=0)
        by_state = prediction.change.pose[:, :3]
        moment += np.cross(by_state, forces[:, :, np.newaxis], axis=1).sum(axis=0)
        return np.concatenate([sums.force[:, :-1], moment])


class _Sums(NamedTuple):
    """The resultants of unit loads; the last column is that of the known loads.

    Attributes:
        force: resultant force, (3, state + 1).
        moment: sum of the free moments, (3, state + 1).
        at_stations: forces at stations with the moment of the loads for every shape that is a
            cubic spline through the stations, (stations, 3, state + 1).
    """

    force: FloatArray
    moment: FloatArray
    at_stations: FloatArray


_CACHE: weakref.WeakKeyDictionary[ArmModel, _Sums] = weakref.WeakKeyDictionary()


def _sums(model: ArmModel) -> _Sums:
    if model not in _CACHE:
        grid, state = model.solver.grid, model.state
        moment = np.zeros((3, state.size + 1))
        at_stations = np.zeros((grid.s.size, 3, state.size + 1))
        columns = range(state.size)[state.unit_loads]
        for column, loads in (*zip(columns, model.unit_loads), (state.size, model.loads)):
            at_stations[..., column] = forces_at_stations(model.arm, grid, loads)
            moments = [loads.tip_moment, *(point.moment for point in loads.points)]
            moment[:, column] = np.sum(moments, axis=0)
        np.fill_diagonal(at_stations[-1, :, state.tip_force], 1.0)
        np.fill_diagonal(moment[:, state.tip_moment], 1.0)
        _CACHE[model] = _Sums(at_stations.sum(axis=0), moment, at_stations)
    return _CACHE[model]


def require_covered(loads: Loads) -> None:
    """Raise MeasurementError if there are loads whose forces the sum does not contain."""
    for kind in ('others', 'obstacles'):
        if getattr(loads, kind):
            raise MeasurementError(f'base wrench: loads.{kind} are not covered')


def forces_at_stations(arm: Arm, grid: StationGrid, loads: Loads) -> FloatArray:
    """Return forces at the stations (stations, 3) [N] with the moment of those of ``loads``.

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
