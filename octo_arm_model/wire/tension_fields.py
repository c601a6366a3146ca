"""Tensions out of fields of any message, and under names of any kind.

For each tendon of the arm there is the name of its value in what comes in, or the number of the
value from 0 on where these have no names, or `NONE`: that tendon has no load cell, and is slack.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import TensionError, listed, shown
from octo_arm_model.arm.hints import FloatArray

NONE = '-'
MAX_VALUES = 100_000  # of one message
_STEP = re.compile(r'^([A-Za-z]\w*)((?:\[\d{1,9}\])*)$')


def field_values(message: Any, path: str) -> FloatArray:
    """Numbers of the field ``path`` of a ``message``, such as 'wrench.force.x' or 'data[2]', (n,).

    Raises:
        TensionError: if there is no such field, or it holds no numbers.
    """
    value = message
    for step in path.split('.'):
        match = _STEP.match(step)
        if match is None or not hasattr(value, match[1]):
            raise TensionError(f'no field {shown(path)}')
        value = getattr(value, match[1])
        for number in re.findall(r'\d+', match[2]):
            if not isinstance(value, (list, tuple, np.ndarray)) or int(number) >= len(value):
                raise TensionError(f'no field {shown(path)}: it has no entry {number}')
            value = value[int(number)]
    if isinstance(value, (list, tuple, np.ndarray)) and len(value) > MAX_VALUES:
        raise TensionError(f'{path} has {len(value)} values, expected at most {MAX_VALUES}')
    try:
        array = np.atleast_1d(np.asarray(value))
    except ValueError:
        array = np.array([None])
    if array.dtype.kind not in 'fiu' or array.ndim != 1:
        raise TensionError(f'{path} is {shown(value)}, expected numbers')
    return array.astype(np.float64)


def values_by_name(names: Sequence[str], values: Sequence[float], field: str) -> dict[str, float]:
    """The ``values`` of the ``field`` of a message by the ``names`` of their tendons.

    Raises:
        TensionError: if there are not as many names, or too many, or one is repeated.
    """
    if len(names) > MAX_VALUES:
        raise TensionError(f'name has {len(names)} entries, expected at most {MAX_VALUES}')
    if len(names) != len(values):
        raise TensionError(f'name has {len(names)} entries but {field} has {len(values)}')
    found = dict(zip(names, values))
    if len(found) < len(names):
        repeated = sorted(name for name, count in Counter(names).items() if count > 1)
        raise TensionError(f'tendon named more than once: {listed(repeated)}')
    return found


def tensions_by_names(
    values: FloatArray, names: Sequence[str] | None, wanted: Sequence[str], arm: Arm
) -> FloatArray:
    """Tensions of ``arm``, of `Arm.tension_shape` [N], from ``values`` (n,) of these ``names``.

    ``wanted`` is the name or number of each tendon's value, or `NONE`; empty for the tendons' own
    names, or, where there are no names, the order of the tendons.

    Raises:
        TensionError: if a value is missing, or named more than once, or there are too many.
    """
    if len(values) > MAX_VALUES:
        raise TensionError(f'{len(values)} values, expected at most {MAX_VALUES}')
    if names is not None and len(names) != len(values):
        raise TensionError(f'{len(names)} names but {len(values)} values')
    if not wanted:
        count = len(arm.tendons)
        if names is None and len(values) != count:
            raise TensionError(
                f'{len(values)} values, expected {count}, one for each tendon, or tension_names '
                '(--tendons) that say which is which'
            )
        wanted = arm.tendon_names if names is not None else list(map(str, range(count)))
    places = {str(n): n for n in range(len(values))}
    if names is not None:
        places |= {name: n for n, name in enumerate(names)}
        for name, count in Counter(names).items():
            if count > 1 and name in wanted:
                raise TensionError(f'named more than once: {listed([name])}')
    tensions = np.zeros(len(arm.tendons))
    for tendon, name in enumerate(wanted):
        if name == NONE:
            continue
        if name not in places:
            raise TensionError(
                f'no value {shown(name)} for {arm.tendon_names[tendon]}; there are '
                f'{listed(names or list(places))}'
            )
        tensions[tendon] = values[places[name]]
    return tensions.reshape(arm.tension_shape)


def names_of(message: Any, count: int) -> list[str] | None:
    """Names of the values in the field 'name' of a ``message``, if there are ``count``."""
    names = getattr(message, 'name', None)
    if isinstance(names, (list, tuple)) and len(names) == count and count:
        return [str(name) for name in names]
    return None
