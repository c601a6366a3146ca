"""Numbers as they are given, checked: every refusal names the field, its value and the range."""

from __future__ import annotations

import math

import numpy as np

from octo_arm_model.core.errors import ArmDefinitionError


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


def vector(name: str, value: object, unit: str) -> tuple[float, float, float]:
    """Return ``value`` as three floats.

    Raises:
        ArmDefinitionError: if it is not three finite numbers in ``unit``.
    """
    expected = f'three finite numbers [{unit}]'
    try:
        array = np.array(value)
    except ValueError:  # rows of different length
        raise ArmDefinitionError(name, value, expected) from None
    if array.shape != (3,) or array.dtype.kind not in 'fiu' or not np.isfinite(array).all():
        raise ArmDefinitionError(name, value, expected)
    x, y, z = array.astype(np.float64).tolist()
    return x, y, z
