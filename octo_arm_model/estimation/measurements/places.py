"""What is measured at places along the arm: markers on the midline, curvatures."""

from __future__ import annotations

import functools
from collections.abc import Hashable
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from octo_arm_model.arm.errors import MeasurementError, shown
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.estimation.measurements.measurement import Measurement, numbers
from octo_arm_model.estimation.state.prediction import Prediction
from octo_arm_model.rod.interpolation import nearest


class _AtPlaces(Measurement):
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

    @property
    def kind(self) -> Hashable:
        """See `Measurement`."""
        return self.name, self.s.tobytes()


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
        _check_on_arm(self.name, self.s, at)
        return nearest(self.s, at.model.solver.grid.s)


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
