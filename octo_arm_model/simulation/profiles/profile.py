"""A command profile: the tension commanded to every tendon, over time."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from octo_arm_model.arm.errors import ProfileError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import MAX_PROFILE_ROWS
from octo_arm_model.arm.validation import real_numbers
from octo_arm_model.rod.interpolation import interpolated

INTERPOLATIONS = ('smooth', 'linear', 'steps')


@dataclass(frozen=True, eq=False)
class CommandProfile:
    """Commanded tensions over time.

    Between rows, ``smooth`` is monotone cubic interpolation of zero rate at both ends (PCHIP,
    Fritsch and Butland 1984), ``linear`` interpolates linearly, and ``steps`` holds each row until
    the next.

    Attributes:
        times: (n,) [s], increasing, at least two and at most `MAX_PROFILE_ROWS`; counted from the
            first.
        tensions: (n, tendons) [N], finite, none negative, in the order of `Arm.tendon_names`.
        interpolation: one of `INTERPOLATIONS`.

    Raises:
        ProfileError: if they are not as described; the message names the row.
    """

    times: FloatArray
    tensions: FloatArray
    interpolation: str = 'smooth'

    def __post_init__(self) -> None:
        """Validate; keep read-only copies."""
        if self.interpolation not in INTERPOLATIONS:
            expected = ', '.join(INTERPOLATIONS)
            raise ProfileError(f'interpolation is {self.interpolation!r}, expected {expected}')
        given = real_numbers(self.times), real_numbers(self.tensions)
        if given[0] is None or given[1] is None:
            raise ProfileError('times and tensions are expected to be numbers')
        times, tensions = given[0].copy(), given[1].copy()
        if times.ndim != 1 or tensions.ndim != 2 or len(times) != len(tensions):
            raise ProfileError(
                f'times are {times.shape} and tensions {tensions.shape}, expected (n,) and '
                '(n, tendons)'
            )
        if len(times) > MAX_PROFILE_ROWS:
            raise ProfileError(f'{len(times)} rows, expected at most {MAX_PROFILE_ROWS}')
        if len(times) < 2:
            raise ProfileError(f'{len(times)} row(s), expected at least two')
        _check_times(times.tolist())
        wrong = ~(np.isfinite(tensions) & (tensions >= 0.0))
        if wrong.any():
            row, tendon = np.argwhere(wrong)[0].tolist()
            raise ProfileError(
                f'tension {tendon + 1} is {tensions[row, tendon]}, expected a finite number >= 0 '
                '[N]',
                row,
            )
        times -= times[0]
        for name, array in (('times', times), ('tensions', tensions)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def duration(self) -> float:
        """Time from the first row to the last [s]."""
        return float(self.times[-1])

    def at(self, time: ArrayLike, *, loop: bool = False) -> FloatArray:
        """Tensions (..., tendons) [N] at ``time`` (...) [s].

        Constant before the first and after the last row, or, with ``loop``, periodic. At another
        speed use ``profile.at(speed * time)``.
        """
        t = np.asarray(time, dtype=np.float64)
        t = np.mod(t, self.duration) if loop else np.clip(t, 0.0, self.duration)
        if self.interpolation == 'smooth':
            # A cubic between rows of 0 may be negative by rounding.
            return np.maximum(self._smooth(t), 0.0)
        if self.interpolation == 'linear':
            return interpolated(t, self.times, self.tensions)
        return self.tensions[np.searchsorted(self.times, t, side='right') - 1]

    @functools.cached_property
    def _smooth(self) -> PchipInterpolator:
        # A copy of the first row before and of the last after give the ends zero rate.
        times = np.concatenate(([-1.0], self.times, [self.duration + 1.0]))
        rows = np.concatenate((self.tensions[:1], self.tensions, self.tensions[-1:]))
        return PchipInterpolator(times, rows, axis=0)


def _check_times(times: list[float]) -> None:
    for row, time in enumerate(times):
        if not math.isfinite(time):
            raise ProfileError(f'time is {time}, expected a finite number [s]', row)
        if row and time <= times[row - 1]:
            expected = f'expected more than {times[row - 1]} [s]'
            raise ProfileError(f'time is {time}, {expected}', row)


def transition(start: ArrayLike, stop: ArrayLike, duration: float) -> CommandProfile:
    """A smooth profile from tensions ``start`` to ``stop`` [N], (tendons,) or `Arm.tension_shape`.

    Raises:
        ProfileError: if a tension is invalid or ``duration`` is not > 0 [s].
    """
    rows = np.array([np.ravel(start), np.ravel(stop)], dtype=np.float64)
    return CommandProfile(np.array([0.0, duration]), rows)
