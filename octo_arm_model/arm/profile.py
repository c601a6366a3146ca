"""Profiles of a quantity along the arm: a radius, a modulus, a tendon's offset or angle."""

import functools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline, PchipInterpolator, make_interp_spline

from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import MAX_TABLE_POINTS
from octo_arm_model.arm.validation import check_fields, finite, positive, real_numbers, set_fields

_POINTS = 1001  # of the spline of fifth degree whose derivative is that of a function


PCHIP, LINEAR = BETWEEN = 'pchip', 'linear'  # interpolations of tables


class Profile(ABC):
    """A smooth function of the arc coordinate s [m] with finite values."""

    @abstractmethod
    def value(self, s: ArrayLike) -> FloatArray:
        """Return the values at ``s`` [m], of the shape of ``s``."""

    @abstractmethod
    def slope(self, s: ArrayLike) -> FloatArray:
        """Return the derivatives by s at ``s`` [per metre], of the shape of ``s``."""

    @property
    def knots(self) -> tuple[float, ...]:
        """The arc coordinates at which the profile is not smooth [m]; intervals end there."""
        return ()

    @property
    def reach(self) -> float:
        """The largest arc coordinate at which the profile has a value [m]."""
        return math.inf

    def cover(self, name: str, stop: float) -> None:
        """Check that the profile has a value from the base to s = ``stop`` [m].

        Raises:
            ArmDefinitionError: if it ends before ``stop``; the message has its ``name``.
        """
        if self.reach < stop:
            expected = f'at least {stop} [m], as far as it is needed'
            raise ArmDefinitionError(f'last s of {name}', self.reach, expected)


@dataclass(frozen=True)
class Linear(Profile):
    """A profile that is linear in s from the base to s = ``length``.

    Attributes:
        start: value at s = 0.
        stop: value at s = ``length``.
        length: arc coordinate of ``stop`` [m].
    """

    start: float
    stop: float
    length: float

    def __post_init__(self) -> None:
        check_fields(self, 'linear.', dict.fromkeys(vars(self), (finite,)))

    def value(self, s: ArrayLike) -> FloatArray:
        """Return the values at ``s`` [m]."""
        # Interpolation from the nearer end is exact at both ends, and rounding makes no value
        # between two values >= 0 negative.
        x = np.asarray(s, dtype=np.float64) / self.length
        change = self.stop - self.start
        return np.where(x <= 0.5, self.start + change * x, self.stop - change * (1.0 - x))

    def slope(self, s: ArrayLike) -> FloatArray:
        """Return the derivatives at ``s`` [per metre]."""
        return np.full(np.shape(s), (self.stop - self.start) / self.length)


@dataclass(frozen=True)
class Constant(Profile):
    """A profile that is constant in s.

    Attributes:
        level: the value.
    """

    level: float

    def __post_init__(self) -> None:
        set_fields(self, level=finite('constant', self.level))

    def value(self, s: ArrayLike) -> FloatArray:
        """Return the values at ``s`` [m]."""
        return np.full(np.shape(s), self.level)

    def slope(self, s: ArrayLike) -> FloatArray:
        """Return zeros."""
        return np.zeros(np.shape(s))


@dataclass(frozen=True)
class Table(Profile):
    """A profile through points: a monotone cubic, or linear with kinks at the points.

    The cubic is PCHIP (Fritsch and Butland 1984); both are linear for two points.

    Attributes:
        s: arc coordinates [m], at least two and at most `MAX_TABLE_POINTS`, the first 0,
            increasing.
        values: value at each point.
        name: name of the table in errors.
        between: interpolation, 'pchip' or 'linear'.

    Raises:
        ArmDefinitionError: if the points are not as described.
    """

    s: tuple[float, ...]
    values: tuple[float, ...]
    name: str = 'table'
    between: str = PCHIP

    def __post_init__(self) -> None:
        if self.between not in BETWEEN:
            expected = f'one of {", ".join(BETWEEN)}'
            raise ArmDefinitionError(f'{self.name}.between', self.between, expected)
        for field in ('s', 'values'):
            given = getattr(self, field)
            column = real_numbers(given)
            if column is None or column.ndim != 1 or not np.isfinite(column).all():
                raise ArmDefinitionError(f'{self.name}.{field}', given, 'finite numbers')
            if column.size > MAX_TABLE_POINTS:
                expected = f'at most {MAX_TABLE_POINTS} values, not {column.size}'
                raise ArmDefinitionError(f'{self.name}.{field}', given, expected)
            set_fields(self, **{field: tuple(column.tolist())})
        if len(self.s) < 2 or self.s[0] != 0.0 or min(np.diff(self.s)) <= 0.0:
            expected = 'at least two arc coordinates from 0.0 on, increasing [m]'
            raise ArmDefinitionError(f'{self.name}.s', self.s, expected)
        if len(self.values) != len(self.s):
            expected = f'{len(self.s)} values, one for each s'
            raise ArmDefinitionError(f'{self.name}.values', self.values, expected)

    @functools.cached_property
    def _interpolant(self) -> PchipInterpolator | BSpline:
        if self.between == PCHIP:
            return PchipInterpolator(self.s, self.values)
        return make_interp_spline(self.s, self.values, k=1)

    def value(self, s: ArrayLike) -> FloatArray:
        """Return the values at ``s`` [m]."""
        # Without rounding no value would exceed those of the points.
        return np.clip(self._interpolant(s), min(self.values), max(self.values))

    def slope(self, s: ArrayLike) -> FloatArray:
        """Return the derivatives at ``s`` [per metre]."""
        return np.asarray(self._interpolant(s, nu=1), dtype=np.float64)

    @property
    def knots(self) -> tuple[float, ...]:
        """The points between the first and the last [m]."""
        return self.s[1:-1]

    @property
    def reach(self) -> float:
        """The last point [m]."""
        return self.s[-1]


@dataclass(frozen=True)
class Function(Profile):
    """A profile that is a Python function of an array of s [m].

    Attributes:
        of_s: function of an array of arc coordinates in [0, ``length``] [m] that returns values.
        length: largest arc coordinate at which the functions can be called [m].
        slope_of_s: function that returns the derivatives; None for those of a spline.

    Raises:
        ArmDefinitionError: if the length is not positive.
    """

    of_s: Callable[[FloatArray], FloatArray]
    length: float
    slope_of_s: Callable[[FloatArray], FloatArray] | None = None

    def __post_init__(self) -> None:
        set_fields(self, length=positive('function.length', self.length, 'm'))

    def value(self, s: ArrayLike) -> FloatArray:
        """Return the values at ``s`` [m]."""
        s = np.asarray(s, dtype=np.float64)
        return np.broadcast_to(np.asarray(self.of_s(s), dtype=np.float64), s.shape)

    def slope(self, s: ArrayLike) -> FloatArray:
        """Return the derivatives at ``s`` [per metre]."""
        s = np.asarray(s, dtype=np.float64)
        if self.slope_of_s is not None:
            return np.broadcast_to(np.asarray(self.slope_of_s(s), dtype=np.float64), s.shape)
        return np.asarray(self._spline(s, nu=1), dtype=np.float64)

    @functools.cached_property
    def _spline(self) -> BSpline:
        s = np.linspace(0.0, self.length, _POINTS)
        return make_interp_spline(s, self.value(s), k=5, check_finite=False)

    @property
    def reach(self) -> float:
        """The largest arc coordinate at which the functions can be called [m]."""
        return self.length


def as_profile(value: float | Profile) -> Profile:
    """Return ``value`` as a profile: a number becomes a `Constant`."""
    return value if isinstance(value, Profile) else Constant(value)
