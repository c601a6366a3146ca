"""The calibration of load cells and encoders of an arm, built from its parameters."""

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ArmDefinitionError, ConfigError, TensionError, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.validation import finite
from octo_arm_model.config.parameter import Values, check_length
from octo_arm_model.rod.checks import check_tensions

_ROUNDING = 1e-15  # relative to an offset: rounding of the sum of reading and offset


@dataclass(frozen=True)
class Calibration:
    """The calibration of load cells [N], or of encoders of winches [m], one for each tendon.

    Tensions, or lengths reeled in, are scale * reading + offset. Those within the deadband about
    zero are then set to zero, since load cells of slack tendons read small values of either sign.
    """

    deadband: float = 0.0  #: largest magnitude that is set to zero [N], >= 0
    offset: tuple[float, ...] = ()  #: offset for each tendon [N, m]; empty for no offsets
    #: scale for each tendon [N, m per unit of the reading]; empty for 1. It is > 0 for tensions;
    #: for encoders the radius of the spool for radians, < 0 if the motor lets the tendon out as it
    #: turns forwards.
    scale: tuple[float, ...] = ()
    #: name of the reading of each tendon in incoming messages, as in `wire.tensions`; tendons of
    #: one motor have the same name; empty for the names of the tendons
    names: tuple[str, ...] = ()

    @functools.cached_property
    def is_identity(self) -> bool:
        """Whether readings are tensions as they are."""
        return not (self.deadband or any(self.offset) or any(k != 1.0 for k in self.scale))

    def tensions(self, arm: Arm, readings: ArrayLike) -> FloatArray:
        """Return tensions of ``arm`` for ``readings``, both (..., *`Arm.tension_shape`) [N].

        Raises:
            TensionError: if the shape is wrong, or a tension is not finite or below minus the
                deadband; the message names the tendon.
        """
        array, shape = np.asarray(readings), arm.tension_shape
        is_set = array.dtype.kind in 'fiu' and array.shape[-len(shape) :] == shape
        if self.is_identity or not is_set:
            return check_tensions(arm, readings)  # raises the error of what is no set
        tensions = self.scale_and_offset(array.astype(np.float64))
        try:
            return check_tensions(arm, tensions)
        except TensionError as error:
            raise TensionError(
                f'{error} after tension_scale and tension_offset, or within the tension_deadband '
                f'of {self.deadband:g} N'
            ) from None

    def scale_and_offset(self, readings: FloatArray) -> FloatArray:
        """Return tensions [N], or lengths reeled in [m], for ``readings``.

        Both are (..., tendons) or (..., *`Arm.tension_shape`). None is refused: tensions below
        minus the deadband are returned as they are.
        """
        flat, count = readings, max(len(self.scale), len(self.offset))
        if count and readings.shape[-1] != count:
            # If all sections have equal numbers of tendons, each is a row.
            flat = readings.reshape(*readings.shape[:-2], count)
        offset = np.array(self.offset or 0.0)
        with np.errstate(all='ignore'):  # a value that is not finite is refused as a tension
            values = flat * (self.scale or 1.0) + offset
        band = np.maximum(self.deadband, _ROUNDING * np.abs(offset))
        return np.where(np.abs(values) <= band, 0.0, values).reshape(readings.shape)

    def readings(self, tensions: FloatArray) -> FloatArray:
        """Return what load cells without errors read under ``tensions`` (tendons,) [N]."""
        return np.asarray((tensions - np.array(self.offset or 0.0)) / (self.scale or 1.0))


def build_load_cells(given: Values, arm: Arm) -> Calibration:
    """Return the calibration of the load cells of ``arm``.

    Raises:
        ConfigError: if offsets, scales or names are given, but not one for each tendon.
    """
    names = given['tension_names']
    distinct = [name for name in names if name != '-']
    if len(set(distinct)) < len(distinct) or '' in names or (names and not distinct):
        expected = 'distinct names or -, one name at least'
        raise ConfigError(f'tension_names is {shown(list(names))}, expected {expected}')
    lists = 'tension_offset', 'tension_scale', 'tension_names'
    check_each(given, arm, *lists)
    return Calibration(given['tension_deadband'], *(given[name] for name in lists))


def build_encoders(given: Values, arm: Arm) -> Calibration:
    """Return the calibration of the encoders of ``arm``.

    Raises:
        ConfigError: if offsets, scales or names are given, but not one for each tendon.
        ArmDefinitionError: if a scale is 0.
    """
    names, scale = given['displacement_names'], given['displacement_scale']
    if '' in names:
        raise ConfigError(f'displacement_names is {shown(list(names))}, expected names or -')
    for factor in scale:
        if not finite('displacement_scale', factor):
            expected = 'a finite number other than 0 [m per unit of the reading]'
            raise ArmDefinitionError('displacement_scale', factor, expected)
    scale = len(arm.tendons) * scale if len(scale) == 1 else scale
    scaled = {**given, 'displacement_scale': scale}
    check_each(scaled, arm, 'displacement_names', 'displacement_scale', 'displacement_offset')
    return Calibration(0.0, given['displacement_offset'], scale, names)


def check_each(given: Values, arm: Arm, *names: str) -> None:
    """Check that each of the lists ``names`` is empty or has a value for each tendon of ``arm``.

    Raises:
        ConfigError: if a list has another number of values.
    """
    for name in names:
        if given[name]:
            check_length(name, given[name], len(arm.tendons), ', one per tendon')
