"""Validation of input: every error names the field, its value and the allowed range."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.ma import MaskedArray

from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import MAX_NAME

# Bounds of all magnitudes: powers of larger and smaller ones leave the range of floats.
LARGEST, SMALLEST = 1e30, 1e-30
_NUMBERS = {float, int}


def finite(
    name: str, value: object, expected: str = 'a finite number', most: float = LARGEST
) -> float:
    """Return ``value`` as a float.

    Raises:
        ArmDefinitionError: if it is not a finite number of magnitude up to ``most``; the message
            quotes what is ``expected``.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float, np.number)):
        raise ArmDefinitionError(name, value, expected)
    try:
        number = float(value)
    except OverflowError:  # an integer beyond the range of floats
        number = math.inf
    if not math.isfinite(number):
        raise ArmDefinitionError(name, value, expected)
    if abs(number) > most:
        raise ArmDefinitionError(name, value, f'{expected} of at most {most:g}')
    return number


def positive(name: str, value: object, unit: str) -> float:
    """Return ``value`` as a float > 0.

    Raises:
        ArmDefinitionError: if it is not a finite number > 0 in ``unit``, `SMALLEST` to `LARGEST`.
    """
    expected = f'a finite number > 0 [{unit}]'
    number = finite(name, value, expected)
    if number <= 0.0:
        raise ArmDefinitionError(name, value, expected)
    if number < SMALLEST:
        raise ArmDefinitionError(name, value, f'{expected} of at least {SMALLEST:g}')
    return number


def not_negative(name: str, value: object, what: str, unit: str, most: float = LARGEST) -> float:
    """Return ``value`` as a float >= 0.

    Raises:
        ArmDefinitionError: if it is not a finite ``what`` >= 0 in ``unit``, or beyond ``most``.
    """
    expected = f'a finite {what} >= 0 [{unit}]'
    number = finite(name, value, expected, most)
    if number < 0.0:
        raise ArmDefinitionError(name, value, expected)
    return number


def within(name: str, value: object, low: float, high: float, unit: str) -> float:
    """Return ``value`` as a float from ``low`` to ``high``.

    Raises:
        ArmDefinitionError: if it is not a finite number within these, in ``unit``.
    """
    expected = f'a finite number within [{low:.12g}, {high:.12g}] [{unit}]'
    number = finite(name, value, expected)
    if not low <= number <= high:
        raise ArmDefinitionError(name, value, expected)
    return number


def whole(name: str, value: object) -> int:
    """Return ``value`` as an integer >= 0.

    Raises:
        ArmDefinitionError: if it is not one.
    """
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise ArmDefinitionError(name, value, 'an integer >= 0')
    return value


def per_tendon(
    name: str, values: Sequence[object], count: int, what: str, unit: str, most: float = LARGEST
) -> tuple[float, ...]:
    """Return ``values``, one for all tendons or one for each, as ``count`` floats >= 0.

    Empty where all are zero.

    Raises:
        ArmDefinitionError: if they are neither one nor ``count``, or one is not a finite ``what``
            in ``unit`` of at most ``most``.
    """
    expected = f'a list of one number for all tendons or of {count}, one for each'
    if isinstance(values, np.ndarray) and values.ndim == 1:
        values = values.tolist()
    if isinstance(values, str) or not isinstance(values, Sequence):
        raise ArmDefinitionError(name, values, expected)
    numbers = tuple(not_negative(name, value, what, unit, most) for value in values)
    if len(numbers) not in (0, 1, count):
        raise ArmDefinitionError(name, list(numbers), expected)
    if len(numbers) == 1:
        numbers = count * numbers
    return numbers if any(numbers) else ()


def vector(name: str, value: object, unit: str) -> tuple[float, float, float]:
    """Return ``value`` as three floats.

    Raises:
        ArmDefinitionError: if it is not three finite numbers in ``unit``.
    """
    array = real_numbers(value)
    if array is None or array.shape != (3,) or not np.isfinite(array).all():
        raise ArmDefinitionError(name, value, f'three finite numbers [{unit}]')
    x, y, z = array.tolist()
    return x, y, z


def real_numbers(value: object) -> FloatArray | None:
    """Return ``value``, an array or nested lists, as floats; None where it is no array of numbers.

    Not numbers here are texts, booleans, which NumPy converts to 0 and 1, and masked elements, of
    which NumPy takes the value behind the mask.
    """
    if isinstance(value, MaskedArray) and np.any(value.mask):
        return None
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different length
        return None
    if array.dtype.kind not in 'fiu':
        return None
    if isinstance(value, (list, tuple)) and _holds_bool(value):
        return None
    return array.astype(np.float64, copy=False)


def _holds_bool(value: list[Any] | tuple[Any, ...]) -> bool:
    """Whether nested lists, which NumPy converts to an array of numbers, contain a boolean."""
    if _NUMBERS.issuperset(map(type, value)):
        return False
    elements = np.array(value, dtype=object).ravel().tolist()
    if _NUMBERS.issuperset(map(type, elements)):
        return False  # The usual case, for which the check of each element takes too long.
    return any(np.asarray(element).dtype.kind == 'b' for element in elements)


def is_text(value: object) -> bool:
    """Whether ``value`` is a text that fits into a ROS message.

    At most `MAX_NAME` characters, without NUL, which ends a string there, and without surrogates,
    which UTF-8 cannot encode.
    """
    return (
        isinstance(value, str)
        and len(value) <= MAX_NAME
        and '\0' not in value
        and not any('\ud800' <= character <= '\udfff' for character in value)
    )
