"""What every measurement of an arm is: value, covariance, what a state predicts, derivatives."""

from __future__ import annotations

import abc
import functools
from collections.abc import Hashable, Iterator, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag

from octo_arm_model.arm.errors import MeasurementError, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.validation import LARGEST, SMALLEST, real_numbers
from octo_arm_model.estimation.state.prediction import Prediction

_LARGEST = 1000  # numbers in one measurement


class Measurement(abc.ABC):
    """Something measured.

    Attributes:
        name: of its kind.
        is_linear: whether it depends on the state alone, linearly, and not on the shape.
        value: what was measured, (m,).
        covariance: of its error, (m, m).
    """

    name: str
    is_linear: ClassVar[bool] = False

    def __init__(self, value: ArrayLike, noise: ArrayLike) -> None:
        """Take ``value`` with ``noise``.

        That is one standard deviation for all numbers, one for each, (m,), or a covariance
        (m, m).

        Raises:
            MeasurementError: if they are not finite numbers of such sizes, or the noise is no
                positive definite covariance.
        """
        self.value = magnitudes(f'{self.name}: value', value).ravel()
        size = self.value.size
        if not 0 < size <= _LARGEST:
            expected = f'1 to {_LARGEST} numbers'
            raise MeasurementError(f'{self.name}: value has {size} numbers, expected {expected}')
        given = numbers(f'{self.name}: noise', noise)
        if given.ndim < 2 and given.size in (1, size):
            self._check_deviations(given)
            self.covariance = np.diag(np.broadcast_to(given, size) ** 2)
            self.noise_root: FloatArray = np.sqrt(self.covariance)
            return
        if given.shape != (size, size):
            raise MeasurementError(
                f'{self.name}: noise has shape {given.shape}, expected {size} standard deviations '
                f'or a covariance ({size}, {size})'
            )
        variances, expected = given.diagonal(), 'expected a positive definite covariance'
        if not (variances > 0.0).all():
            at = int(variances.argmin())
            raise MeasurementError(
                f'{self.name}: the variance of number {at + 1} of {size} is {variances[at]:g}, '
                f'{expected}'
            )
        self._check_deviations(np.sqrt(variances))
        self.covariance = 0.5 * given + 0.5 * given.T
        try:
            self.noise_root = np.asarray(np.linalg.cholesky(self.covariance), np.float64)
        except np.linalg.LinAlgError:
            raise MeasurementError(
                f'{self.name}: some combination of its {size} numbers has a variance of '
                f'{np.linalg.eigvalsh(self.covariance)[0]:g}, {expected}'
            ) from None

    def _check_deviations(self, noise: FloatArray) -> None:
        """Check the standard deviations of the ``noise``.

        Raises:
            MeasurementError: if one is not within `SMALLEST` and `LARGEST`.
        """
        wrong = noise[~((noise >= SMALLEST) & (noise <= LARGEST))]
        if wrong.size:
            raise MeasurementError(
                f'{self.name}: noise has a standard deviation of {wrong.flat[0]:g}, expected '
                f'{SMALLEST:g} to {LARGEST:g}'
            )

    @property
    def kind(self) -> Hashable:
        """What is measured and where: measurements of one kind differ by their values alone."""
        return self.name, self.value.size

    def each_apart(self, at: Prediction) -> Iterator[tuple[Measurement, Measurement]]:
        """All but one of the sensors that measured it and that one, for each in turn.

        Nothing where it is of one sensor.
        """
        return iter(())

    @abc.abstractmethod
    def innovation(self, at: Prediction) -> FloatArray:
        """What was measured less what is predicted, (m,)."""

    @abc.abstractmethod
    def jacobian(self, at: Prediction) -> FloatArray:
        """Change of what is predicted by the state, (m, state)."""

    def second(self, at: Prediction) -> FloatArray | None:
        """Second derivatives of what is predicted by the state, nearly, (m, state, state).

        None where nothing tells them but differences.
        """
        return None

    def check_size(self, expected: int, what: str) -> None:
        """Check how many numbers there are; ``what`` they should be, in words.

        Raises:
            MeasurementError: if they are not as many as ``expected``.
        """
        if self.value.size != expected:
            raise MeasurementError(
                f'{self.name}: value has {self.value.size} numbers, expected {expected}: {what}'
            )


def residuals(measurements: Sequence[Measurement], at: Prediction) -> FloatArray:
    """Innovations of all ``measurements``, one after the other."""
    if len(measurements) == 1:
        return measurements[0].innovation(at)
    return np.concatenate([one.innovation(at) for one in measurements])


def jacobians(measurements: Sequence[Measurement], at: Prediction) -> FloatArray:
    """Their Jacobians, one below the other."""
    if len(measurements) == 1:
        return measurements[0].jacobian(at)
    return np.concatenate([one.jacobian(at) for one in measurements])


def seconds(measurements: Sequence[Measurement], at: Prediction) -> tuple[FloatArray, bool]:
    """Their second derivatives, zero of those that do not give any, and whether all do."""
    found = [one.second(at) for one in measurements]
    sizes, state = [one.value.size for one in measurements], at.x.size
    if all(second is None for second in found):
        return _nothing(sum(sizes), state), False
    given = [
        _nothing(size, state) if second is None else second
        for size, second in zip(sizes, found, strict=True)
    ]
    is_whole = all(second is not None for second in found)
    return given[0] if len(given) == 1 else np.concatenate(given), is_whole


@functools.lru_cache(maxsize=64)
def _nothing(size: int, state: int) -> FloatArray:
    """Zeros (size, state, state), the same ones each time."""
    found = np.zeros((size, state, state))
    found.setflags(write=False)
    return found


def noise_root(measurements: Sequence[Measurement]) -> FloatArray:
    """Root of the covariance of all ``measurements`` together."""
    if len(measurements) == 1:
        return measurements[0].noise_root
    return np.asarray(block_diag(*(one.noise_root for one in measurements)))


def numbers(name: str, value: ArrayLike) -> FloatArray:
    """A copy of ``value`` as an array.

    Raises:
        MeasurementError: if it is not of finite numbers.
    """
    array = real_numbers(value)
    if array is None or not np.isfinite(array).all():
        raise MeasurementError(f'{name} is {shown(value)}, expected finite numbers')
    return array.copy()


def magnitudes(name: str, value: ArrayLike) -> FloatArray:
    """`numbers`, as large as a measurement may be at most.

    Raises:
        MeasurementError: if it is not of finite numbers, or one is beyond `LARGEST`.
    """
    found = numbers(name, value)
    if (np.abs(found) > LARGEST).any():
        raise MeasurementError(
            f'{name} is {shown(value)}, expected numbers of at most {LARGEST:g}'
        )
    return found
