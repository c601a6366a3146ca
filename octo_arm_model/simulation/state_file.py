"""Files of the state of a simulator: the moving arm, its winches, and what they were commanded."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np

from octo_arm_model.arm.errors import ConfigError, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.motion import Dynamics
from octo_arm_model.rod.motion_state import MotionState

SUFFIX = '.npz'
_PART = 'simulator.json'  # beside the arrays of `Dynamics.save`
_VERSION = 1
_MOST_BYTES = 2**20


def write_state(
    path: Path, dynamics: Dynamics, state: MotionState, values: Mapping[str, FloatArray | float]
) -> None:
    """Write a ``state`` and further ``values`` to the file ``path``, whole or not at all.

    Raises:
        ConfigError: if it cannot be written, or ``path`` does not end with .npz.
    """
    if path.suffix != SUFFIX:
        raise ConfigError(f'{path} is no file of a state, expected a name that ends with {SUFFIX}')
    part = path.with_name(f'{path.name}.part')
    plain = {name: np.asarray(value).tolist() for name, value in values.items()}
    try:
        dynamics.save(state, part)
        with ZipFile(part, 'a') as file:
            file.writestr(_PART, json.dumps({'version': _VERSION, **plain}))
        os.replace(part, path)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise ConfigError(f'{path} cannot be written: {error.strerror}') from error


def read_state(
    path: Path, dynamics: Dynamics, shapes: Mapping[str, tuple[int, ...]]
) -> tuple[MotionState, dict[str, FloatArray]]:
    """The state in the file ``path`` and the values of these ``shapes``, checked.

    Raises:
        ConfigError: if it cannot be read, or is none of this arm or version.
    """
    try:
        with ZipFile(path) as file:
            if file.getinfo(_PART).file_size > _MOST_BYTES:
                raise ValueError(f'{_PART} has more than {_MOST_BYTES} bytes')
            given = json.loads(file.read(_PART))
    except KeyError:
        raise ConfigError(f'{path} is the state of an arm alone, without its winches') from None
    except Exception as error:
        # Damaged files make zipfile and json raise errors of many types.
        raise ConfigError(f'{path} cannot be read as a state: {error}') from None
    if not isinstance(given, dict) or given.get('version') != _VERSION:
        found = given.get('version') if isinstance(given, dict) else given
        raise ConfigError(f'{path} is of version {shown(found)}, expected {_VERSION}')
    values = {name: _array(path, name, given.get(name), shape) for name, shape in shapes.items()}
    return dynamics.load(path), values


def _array(path: Path, name: str, value: Any, shape: tuple[int, ...]) -> FloatArray:
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        array = np.full(1, np.nan)
    if array.shape != shape or not np.isfinite(array).all():
        raise ConfigError(f'{path}: {name} is {shown(value)}, expected numbers {shape}')
    return array
