"""From readings of load cells to tensions, for node, bags and CSV files alike."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import TensionError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.inputs import check_tensions

_ROUNDING = 1e-15  # over an offset: rounding of the sum of reading and offset


@dataclass(frozen=True)
class LoadCellCalibration:
    """Calibration of the load cells of an arm: tension = scale * reading + offset.

    Tensions within the deadband of zero are then set to zero, since the cells of slack tendons
    read small values of either sign. A tension further below zero is refused.

    Attributes:
        deadband: of every tension [N], >= 0.
        offset: of each tendon [N]; empty for none.
        scale: of each tendon [-], > 0; empty for 1.
        names: name of each tendon in incoming messages, see `wire.tension_fields`; empty for the
            name of the tendon.
    """

    deadband: float = 0.0
    offset: tuple[float, ...] = ()
    scale: tuple[float, ...] = ()
    names: tuple[str, ...] = ()

    @functools.cached_property
    def is_identity(self) -> bool:
        """Whether readings are tensions without conversion."""
        return not (self.deadband or any(self.offset) or any(one != 1.0 for one in self.scale))

    def tensions(self, arm: Arm, readings: ArrayLike) -> FloatArray:
        """Tensions of ``arm`` for ``readings``, both (..., *`Arm.tension_shape`) [N].

        Raises:
            TensionError: if the shape is another, or a tension is not finite or below zero by
                more than the deadband; the message names the tendon.
        """
        if self.is_identity:
            return check_tensions(arm, readings)
        array = np.asarray(readings)
        if array.dtype.kind not in 'fiu' or array.shape[-len(arm.tension_shape) :] != (
            arm.tension_shape
        ):
            return check_tensions(arm, readings)  # raises the error
        tensions = self.scale_and_offset(array.astype(np.float64))
        try:
            return check_tensions(arm, tensions)
        except TensionError as error:
            raise TensionError(
                f'{error} after tension_scale and tension_offset, or within the tension_deadband '
                f'of {self.deadband:g} N'
            ) from None

    def scale_and_offset(self, readings: FloatArray) -> FloatArray:
        """Tensions for ``readings``, (..., tendons) or (..., *`Arm.tension_shape`) [N].

        Nothing is refused: tensions below minus the deadband are returned as they are.
        """
        count = len(self.scale) or len(self.offset)
        if not count:
            return np.where(np.abs(readings) <= self.deadband, 0.0, readings)
        # Sections with equal numbers of tendons are rows.
        axes = 1 if readings.shape[-1] == count else 2
        shape = readings.shape[-axes:]
        scale, offset = self._columns(shape)
        with np.errstate(all='ignore'):  # what is not finite is refused as a tension
            tensions = scale * readings + offset
        band = np.maximum(self.deadband, _ROUNDING * np.abs(offset))
        return np.where(np.abs(tensions) <= band, 0.0, tensions)

    def readings(self, tensions: FloatArray) -> FloatArray:
        """Readings of cells without errors under ``tensions`` (tendons,) [N]: the inverse."""
        scale, offset = self._columns(tensions.shape)
        return np.asarray((tensions - offset) / scale)

    def _columns(self, shape: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
        """Scale and offset of each tendon, in the ``shape`` of a set of tensions."""
        scale = np.array(self.scale).reshape(shape) if self.scale else np.ones(shape)
        offset = np.array(self.offset).reshape(shape) if self.offset else np.zeros(shape)
        return scale, offset
