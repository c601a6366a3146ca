"""What every measurement of an arm is: value, covariance, what a state predicts, derivatives."""

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
        wrong = noise[~((noise >= SMALLEST) & (noise <= LARGEST))]
        if wrong.size:
            raise MeasurementError(
                f'{self.name}: noise has a standard deviation of {wrong.flat[0]:g}, expected '
                f'{SMALLEST:g} to {LARGEST:g}'
            )

    @abc.abstractmethod
    def innovation(self, at: Prediction) -> FloatArray:
        """What was measured less what is predicted, (m,)."""

    @abc.abstractmethod
    def jacobian(self, at: Prediction) -> FloatArray:
        """Change of what is predicted by the state, (m, state)."""

    def channels(self, at: Prediction) -> tuple[str, ...]:
        """Name of the sensor of each number, (m,): what is believed or doubted as a whole."""
        return (self.name,) * self.value.size

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


class Rows:
    """Numbers of several measurements, one below the other; all of them, or some.

    Attributes:
        measurements: they.
        noise: covariance of their errors, (m, m).
        noise_root: root of it.
    """

    def __init__(self, measurements: Sequence[Measurement], some: IntArray | None = None) -> None:
        """Of ``measurements``, those numbers that are in ``some``; of all if None."""
        self.measurements, self._some = measurements, some
        self.noise = _block_diagonal([one.covariance for one in measurements])
        self.noise_root = _block_diagonal([one.noise_root for one in measurements])
        if some is not None:
            self.noise = self.noise[np.ix_(some, some)]
            self.noise_root = np.asarray(np.linalg.cholesky(self.noise), np.float64)

    def __len__(self) -> int:
        return len(self.noise_root)

    def blurred(self, factor: float) -> Rows:
        """The same, as if they were less exact by a ``factor``."""
        found = copy.copy(self)
        found.noise_root = factor * self.noise_root
        return found

    def only(self, some: IntArray) -> Rows:
        """Those numbers that are in ``some``."""
        return self if len(some) == len(self) else Rows(self.measurements, some)

    def left(self, at: Prediction) -> FloatArray:
        """What was measured less what is predicted, (m,)."""
        return self._those([one.innovation(at) for one in self.measurements])

    def jacobian(self, at: Prediction) -> FloatArray:
        """Change of what is predicted by the state, (m, state)."""
        return self._those([one.jacobian(at) for one in self.measurements])

    def second(self, at: Prediction) -> FloatArray | None:
        """Second derivatives, zero where they are not known, (m, state, state); None of none."""
        found = [one.second(at) for one in self.measurements]
        if all(one is None for one in found):
            return None
        none = [np.zeros((one.value.size, at.x.size, at.x.size)) for one in self.measurements]
        return self._those([b if a is None else a for a, b in zip(found, none, strict=True)])

    def is_bend_known(self, at: Prediction) -> bool:
        """Whether `second` has all second derivatives."""
        return all(one.second(at) is not None for one in self.measurements)

    def channels(self, at: Prediction) -> tuple[str, ...]:
        """Name of the sensor of each number, (m,)."""
        return tuple(name for one in self.measurements for name in one.channels(at))

    def _those(self, parts: Sequence[FloatArray]) -> FloatArray:
        found = parts[0] if len(parts) == 1 else np.concatenate(parts)
        return found if self._some is None else found[self._some]


def _block_diagonal(blocks: Sequence[FloatArray]) -> FloatArray:
    return blocks[0] if len(blocks) == 1 else np.asarray(block_diag(*blocks))


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
