"""Tensions as they are given: shape and bounds."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import TensionError, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.validation import real_numbers

_FEW = 64  # numbers, up to which Python takes less time than NumPy


def check_tensions(arm: Arm, tensions: ArrayLike) -> FloatArray:
    """Return ``tensions`` as a float array that ends in the shape `Arm.tension_shape` [N].

    Where that is flat, one set may also be given in rows, one for each section.

    Raises:
        TensionError: if the shape is not that of the arm, or a tension is negative or not
            finite; the message names the tendon.
    """
    shape = arm.tension_shape
    if len(shape) == 1:
        tensions = _flatten_rows(arm, tensions)
    array = real_numbers(tensions)
    if array is None or array.shape[-len(shape) :] != shape:
        expected = f'(..., {", ".join(str(count) for count in shape)})'
        if array is None:
            raise TensionError(
                f'tensions must be numbers in rows of equal length, expected shape {expected}'
            )
        meaning = f'{len(arm.tendons)} tendons, section by section from the tip'
        if len(shape) == 2:
            meaning = f'{shape[0]} section(s) from the tip, {shape[1]} tendons each'
        raise TensionError(f'tensions have shape {array.shape}, expected {expected}: {meaning}')
    if not _is_fine(array):
        bad = ~((array >= 0.0) & (array < np.inf))
        index = tuple(int(i) for i in np.argwhere(bad)[0])
        tendon = int(np.ravel_multi_index(index[-len(shape) :], shape))
        lead = index[: -len(shape)]
        raise TensionError(
            f'tension of {arm.tendon_names[tendon]}{f" in set {lead}" if lead else ""} is '
            f'{float(array[index])!r} N, expected a finite number >= 0'
        )
    return array


def check_highest(arm: Arm, highest: ArrayLike) -> FloatArray:
    """Return largest tensions, one number or of `Arm.tension_shape`, as (tendons,) [N].

    Raises:
        TensionError: if they have another shape, or one is not finite and > 0.
    """
    given = real_numbers(highest)
    try:
        limits = np.broadcast_to(np.nan if given is None else given, arm.tension_shape).ravel()
    except ValueError:
        given = None
    if given is None:
        raise TensionError(
            f'highest is {shown(highest)}, expected one number or shape {arm.tension_shape}'
        )
    for name, value in zip(arm.tendon_names, limits.tolist(), strict=True):
        if not 0.0 < value < np.inf:
            raise TensionError(
                f'highest tension of {name} is {shown(value)} N, expected a finite number > 0'
            )
    return limits


def _is_fine(array: FloatArray) -> bool:
    """Whether all are finite and >= 0."""
    if 0 < array.size <= _FEW:
        # NaN and an overflow of the sum are decided by NumPy below.
        values = array.ravel().tolist()
        if min(values) >= 0.0 and math.isfinite(sum(values)):
            return True
    # NaN fails the first comparison, infinity the second.
    return not array.size or bool(array.min() >= 0.0 and array.max() < np.inf)


def _flatten_rows(arm: Arm, tensions: ArrayLike) -> ArrayLike:
    """One set of ``tensions`` in rows, one for each section of ``arm``, as one row."""
    if not isinstance(tensions, (list, tuple)) or len(tensions) != len(arm.sections):
        return tensions
    flat: list[float] = []
    for row, section in zip(tensions, arm.sections, strict=True):
        if not isinstance(row, (list, tuple)) or len(row) != len(section.tendons):
            return tensions
        flat += row
    return flat
