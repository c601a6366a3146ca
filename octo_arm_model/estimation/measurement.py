"""A measurement of an arm: value, covariance, prediction by a state, and derivatives."""

from __future__ import annotations

import abc
import copy
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag

from octo_arm_model.arm.errors import MeasurementError, shown
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.arm.validation import LARGEST, SMALLEST, real_numbers
from octo_arm_model.estimation.model import Prediction

_LARGEST = 1000  # largest number of values in one measurement


class Measurement(abc.ABC):
    """A measurement of an arm.

    Attributes:
        name: name of its kind.
        is_linear: whether it is a linear function of the state that does not depend on the shape.
        value: the measured numbers, (m,).
        covariance: covariance of their errors, (m, m).
    """

    name: str
    is_linear: ClassVar[bool] = False

    def __init__(self, value: ArrayLike, noise: ArrayLike) -> None:
        """Check and store a ``value`` with its ``noise``.

        The noise is one standard deviation for all numbers, one for each, (m,), or a covariance
        (m, m).

        Raises:
            MeasurementError: if they are not finite numbers of these sizes, or the covariance is
                not positive definite.
        """
        self.value = checked_numbers(f'{self.name}: value', value).ravel()
        size = self.value.size
        if not 0 < size <= _LARGEST:
            expected = f'1 to {_LARGEST} numbers'
            raise MeasurementError(f'{self.name}: value has {size} numbers, expected {expected}')
        given = checked_numbers(f'{self.name}: noise', noise, np.inf)
        expected = 'expected a positive definite covariance'
        if given.ndim < 2 and given.size in (1, size):
            deviations = np.broadcast_to(given, size)
        elif given.shape != (size, size):
            raise MeasurementError(
                f'{self.name}: noise has shape {given.shape}, expected {size} standard deviations '
                f'or a covariance ({size}, {size})'
            )
        elif (given.diagonal() > 0.0).all():
            deviations = np.sqrt(given.diagonal())
        else:
            number = int(given.diagonal().argmin())
            raise MeasurementError(
                f'{self.name}: the variance of number {number + 1} of {size} is '
                f'{given[number, number]:g}, {expected}'
            )
        invalid = deviations[~((deviations >= SMALLEST) & (deviations <= LARGEST))]
        if invalid.size:
            raise MeasurementError(
                f'{self.name}: noise has a standard deviation of {invalid.flat[0]:g}, expected '
                f'{SMALLEST:g} to {LARGEST:g}'
            )
        self.covariance = np.diag(deviations**2)
        if given.ndim == 2:
            self.covariance = 0.5 * given + 0.5 * given.T
        try:
            self.noise_root = np.asarray(np.linalg.cholesky(self.covariance), np.float64)
        except np.linalg.LinAlgError:
            raise MeasurementError(
                f'{self.name}: some combination of its {size} numbers has a variance of '
                f'{np.linalg.eigvalsh(self.covariance)[0]:g}, {expected}'
            ) from None

    @abc.abstractmethod
    def innovation(self, prediction: Prediction) -> FloatArray:
        """Return the measured less the predicted value, (m,)."""

    @abc.abstractmethod
    def jacobian(self, prediction: Prediction) -> FloatArray:
        """Return the derivatives of the predicted value by the state, (m, state)."""

    def is_same(self, other: Measurement) -> bool:
        """Return whether an ``other`` measurement is of the same class and equal in all fields."""
        mine, theirs = vars(self), vars(other)
        are_equal = (np.array_equal(mine[name], theirs.get(name, ())) for name in mine)
        return type(self) is type(other) and all(are_equal)

    def channels(self, prediction: Prediction) -> tuple[str, ...]:
        """Return the sensor of each number, (m,); a sensor is used or doubted as a whole."""
        return (self.name,) * self.value.size

    def second(self, prediction: Prediction) -> FloatArray | None:
        """Return approximate second derivatives of the predicted value, (m, state, state).

        None if only finite differences would give them.
        """
        return None

    def check_size(self, expected: int, meaning: str) -> None:
        """Check the number of values; ``meaning`` says in words which are expected.

        Raises:
            MeasurementError: if the number of values is not ``expected``.
        """
        if self.value.size != expected:
            raise MeasurementError(
                f'{self.name}: value has {self.value.size} numbers, expected {expected}: {meaning}'
            )


class Rows:
    """The numbers of several measurements, one below the other; all of them, or some.

    Attributes:
        measurements: the measurements.
        noise: covariance of the errors of the numbers, (m, m).
        noise_root: lower triangular square root of this covariance, (m, m).
    """

    def __init__(self, measurements: Sequence[Measurement], some: IntArray | None = None) -> None:
        """Join the numbers of ``measurements``: those with the indices ``some``; all if None."""
        self.measurements, self._indices = measurements, some
        self.noise = _block_diagonal([part.covariance for part in measurements])
        self.noise_root = _block_diagonal([part.noise_root for part in measurements])
        if some is not None:
            self.noise = self.noise[np.ix_(some, some)]
            self.noise_root = np.asarray(np.linalg.cholesky(self.noise), np.float64)

    def __len__(self) -> int:
        return len(self.noise_root)

    def blurred(self, factor: float) -> Rows:
        """Return the same numbers with standard deviations times a ``factor``."""
        rows = copy.copy(self)
        rows.noise_root = factor * self.noise_root
        return rows

    def subset(self, indices: IntArray) -> Rows:
        """Return the numbers at ``indices`` alone."""
        return self if len(indices) == len(self) else Rows(self.measurements, indices)

    def innovation(self, prediction: Prediction) -> FloatArray:
        """Return the measured less the predicted numbers, (m,)."""
        return self._selected([part.innovation(prediction) for part in self.measurements])

    def jacobian(self, prediction: Prediction) -> FloatArray:
        """Return the derivatives of the predicted numbers by the state, (m, state)."""
        return self._selected([part.jacobian(prediction) for part in self.measurements])

    def second(self, prediction: Prediction) -> FloatArray | None:
        """Return second derivatives, (m, state, state): zero if unknown, None if all are."""
        known = [part.second(prediction) for part in self.measurements]
        if all(part is None for part in known):
            return None
        size = prediction.x.size
        zeros = [np.zeros((part.value.size, size, size)) for part in self.measurements]
        return self._selected([b if a is None else a for a, b in zip(known, zeros, strict=True)])

    def has_second(self, prediction: Prediction) -> bool:
        """Return whether `second` knows all second derivatives."""
        return all(part.second(prediction) is not None for part in self.measurements)

    def channels(self, prediction: Prediction) -> tuple[str, ...]:
        """Return the names of the sensors of the numbers, (m,)."""
        return tuple(name for part in self.measurements for name in part.channels(prediction))

    def _selected(self, parts: Sequence[FloatArray]) -> FloatArray:
        values = parts[0] if len(parts) == 1 else np.concatenate(parts)
        return values if self._indices is None else values[self._indices]


def _block_diagonal(blocks: Sequence[FloatArray]) -> FloatArray:
    return blocks[0] if len(blocks) == 1 else np.asarray(block_diag(*blocks))


def checked_numbers(name: str, value: ArrayLike, most: float = LARGEST) -> FloatArray:
    """Return a copy of ``value`` as an array.

    Raises:
        MeasurementError: if it does not consist of finite numbers of at most ``most``.
    """
    array = real_numbers(value)
    if array is None or not np.isfinite(array).all():
        raise MeasurementError(f'{name} is {shown(value)}, expected finite numbers')
    if (np.abs(array) > most).any():
        raise MeasurementError(f'{name} is {shown(value)}, expected numbers of at most {most:g}')
    return array.copy()
