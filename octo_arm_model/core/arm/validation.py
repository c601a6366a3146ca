"""What is given, checked: every refusal names the field, its value and the range."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from octo_arm_model.core.errors import ArmDefinitionError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.limits import MAX_NAME

_DEEPEST = 32  # axes of an array, at least, that NumPy can make


def finite(name: str, value: object, expected: str = 'a finite number') -> float:
    """Return ``value`` as a float.

    Raises:
        ArmDefinitionError: if it is not a finite number; ``expected`` says what is.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float, np.number)):
        raise ArmDefinitionError(name, value, expected)
    try:
        number = float(value)
    except OverflowError:  # an integer beyond the range of floats
        number = math.inf
    if not math.isfinite(number):
        raise ArmDefinitionError(name, value, expected)
    return number


def positive(name: str, value: object, unit: str) -> float:
    """Return ``value`` as a float > 0.

    Raises:
        ArmDefinitionError: if it is not a finite number > 0 in ``unit``.
    """
    expected = f'a finite number > 0 [{unit}]'
    number = finite(name, value, expected)
    if number <= 0.0:
        raise ArmDefinitionError(name, value, expected)
    return number


def not_negative(name: str, value: object, what: str, unit: str) -> float:
    """Return ``value`` as a float >= 0.

    Raises:
        ArmDefinitionError: if it is not a finite ``what`` >= 0 in ``unit``.
    """
    expected = f'a finite {what} >= 0 [{unit}]'
    number = finite(name, value, expected)
    if number < 0.0:
        raise ArmDefinitionError(name, value, expected)
    return number


def per_tendon(
    name: str, values: Sequence[object], count: int, what: str, unit: str
) -> tuple[float, ...]:
    """Return ``values``, none or one for each of ``count`` tendons, as floats >= 0.

    Empty where all are zero.

    Raises:
        ArmDefinitionError: if they are not so many, or one is not a finite ``what`` in ``unit``.
    """
    if isinstance(values, str) or not isinstance(values, Sequence):
        raise ArmDefinitionError(name, values, f'numbers, one for each of {count} tendons')
    numbers = tuple(not_negative(name, value, what, unit) for value in values)
    if numbers and len(numbers) != count:
        raise ArmDefinitionError(name, numbers, f'{count} numbers, one for each tendon')
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
    """Return ``value``, an array or nested lists, as floats; None where it is none of numbers.

    Booleans, which Python and NumPy take for 0 and 1 beside numbers, are none; nor are texts.
    """
    if _holds_bool(value, _DEEPEST):
        return None
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different length
        return None
    if array.dtype.kind not in 'fiu':
        return None
    return array.astype(np.float64, copy=False)


def _holds_bool(value: object, depth: int) -> bool:
    if isinstance(value, (list, tuple)):
        return depth > 0 and any(_holds_bool(element, depth - 1) for element in value)
    return isinstance(value, (bool, np.bool_)) or (
        isinstance(value, np.ndarray) and value.dtype.kind == 'b'
    )


def is_text(value: object) -> bool:
    """Whether ``value`` is a text that a message can carry.

    No more than `MAX_NAME` characters, without the NUL that ends a text in a message and without
    halves of characters, which have no bytes in UTF-8.
    """
    return (
        isinstance(value, str)
        and len(value) <= MAX_NAME
        and '\0' not in value
        and not any('\ud800' <= character <= '\udfff' for character in value)
    )
