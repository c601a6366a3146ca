"""Checks of input: every error names the field, its value and the expected values."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.ma import MaskedArray

from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import MAX_NAME

# Bounds of all magnitudes: powers of numbers beyond them leave the range of floats.
LARGEST, SMALLEST = 1e30, 1e-30
_NUMBERS = {float, int}


def set_fields(instance: object, **values: object) -> None:
    """Set fields of a frozen dataclass to their checked ``values``, in its ``__post_init__``."""
    for name, value in values.items():
        object.__setattr__(instance, name, value)


def check_fields(
    instance: Any, prefix: str, checks: Mapping[str, tuple[Any, ...]], kept: tuple[type, ...] = ()
) -> None:
    """Check fields of a dataclass, and convert their values, in its ``__post_init__``.

    Fields are called by their names after ``prefix`` in errors. ``checks`` has for the name of a
    field a function of such a name and a value, as below, and its further arguments. Instances of
    the classes ``kept`` are not checked.

    Raises:
        ArmDefinitionError: if a value is not as its check expects.
    """
    for field in instance.__dataclass_fields__:
        if field in checks and not isinstance(value := getattr(instance, field), kept):
            check, *arguments = checks[field]
            set_fields(instance, **{field: check(f'{prefix}{field}', value, *arguments)})


def check_class(name: str, value: object, kind: type, *others: type) -> None:
    """Check that ``value`` is an instance of a given class; raise ArmDefinitionError if not."""
    if not isinstance(value, (kind, *others)):
        raise ArmDefinitionError(name, value, f'an instance of {kind.__name__}')


def is_number(value: object) -> bool:
    """Whether ``value`` is one real number; a boolean is none."""
    return isinstance(value, (int, float, np.number)) and not isinstance(value, bool)


def finite(
    name: str,
    value: object,
    expected: str = 'a finite number',
    least: float = -math.inf,
    most: float = LARGEST,
) -> float:
    """Return ``value`` as a float >= ``least`` of magnitude at most ``most``.

    Raises:
        ArmDefinitionError: if it is not such a number; the message has the text ``expected``.
    """
    if not is_number(value):
        raise ArmDefinitionError(name, value, expected)
    try:
        number = float(value)  # type: ignore[arg-type]
    except OverflowError:  # an integer beyond the range of floats
        number = math.inf
    if not math.isfinite(number) or number < least:
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
    return finite(name, value, f'a finite {what} >= 0 [{unit}]', 0.0, most)


def within(name: str, value: object, low: float, high: float, unit: str) -> float:
    """Return ``value`` as a float from ``low`` to ``high``.

    Raises:
        ArmDefinitionError: if it is not a finite number between them, in ``unit``.
    """
    expected = f'a finite number within [{low:.12g}, {high:.12g}] [{unit}]'
    number = finite(name, value, expected, low)
    if number > high:
        raise ArmDefinitionError(name, value, expected)
    return number


def whole(name: str, value: object) -> int:
    """Return ``value`` as an integer >= 0; raise ArmDefinitionError if it is not one."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 0:
        raise ArmDefinitionError(name, value, 'an integer >= 0')
    return int(value)


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
    """Return ``value``, an array or nested lists, as floats; None if it is no array of numbers.

    Numbers are neither texts, nor booleans, which NumPy would convert to 0 and 1, nor masked
    elements, of which NumPy would take the value behind the mask.
    """
    if isinstance(value, MaskedArray) and np.any(value.mask):
        return None
    if isinstance(value, np.ndarray) and value.dtype == object:  # such as a table with texts
        value = value.tolist()
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different length
        return None
    if array.dtype.kind not in 'fiu':
        return None
    if isinstance(value, (list, tuple)) and not _NUMBERS.issuperset(map(type, value)):
        elements = np.array(value, dtype=object).ravel().tolist()
        # Most elements are numbers, and a check of each takes long.
        others = [element for element in elements if type(element) not in _NUMBERS]
        if any(np.asarray(element).dtype.kind == 'b' for element in others):
            return None
    return array.astype(np.float64, copy=False)


def is_text(value: object) -> bool:
    """Whether ``value`` is a text that fits into a ROS message.

    It has at most `MAX_NAME` characters, no NUL, which would end it there, and no surrogates,
    which UTF-8 cannot encode.
    """
    return (
        isinstance(value, str)
        and len(value) <= MAX_NAME
        and '\0' not in value
        and not any('\ud800' <= character <= '\udfff' for character in value)
    )
