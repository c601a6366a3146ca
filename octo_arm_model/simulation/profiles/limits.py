"""Limits of commanded tensions, and their check."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import ArrayLike, NDArray

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ProfileError, TensionError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.stiffness import default_highest
from octo_arm_model.config.config import Config, load_config
from octo_arm_model.config.paper_data import BENDING, FETCHING_IN_PLANE, FETCHING_IN_SPACE
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.rod.inputs import check_tensions
from octo_arm_model.simulation.profiles.profile import CommandProfile

_FIGURES = {
    'renda2012_table2': {f'11 {panel}': tensions for panel, tensions in BENDING.items()},
    'renda2012_table4': {'14': FETCHING_IN_PLANE, '15': FETCHING_IN_SPACE},
}
_ROUNDING = 1e-9  # relative, of interpolation or a solution between tensions at their limit


def figures(arm: Arm) -> dict[str, FloatArray]:
    """Tensions (tendons,) [N] of the paper's figures of ``arm``, by number; empty for others."""
    for name, found in _FIGURES.items():
        preset = _preset(name)
        # The paper's arms have no weight; what moves has one.
        if preset == arm.with_density(preset.material.density):
            return {figure: np.ravel(tensions) for figure, tensions in found.items()}
    return {}


def highest_tensions(arm: Arm) -> FloatArray:
    """Default limit of each tendon (tendons,) [N].

    The larger of `default_highest` and the tensions of the paper's figures.
    """
    highest = default_highest(arm).ravel()
    for tensions in figures(arm).values():
        highest = np.maximum(highest, tensions)
    # Rounded up to two digits, and made from decimals so that powers of ten are not rounded.
    exponents = np.floor(np.log10(highest) - 1.0).astype(np.int64)
    digits = np.ceil(highest / 10.0**exponents - 1e-9)
    return np.array([float(f'{two:.0f}e{power}') for two, power in zip(digits, exponents)])


def tendon_limits(config: Config) -> FloatArray:
    """Largest tension that may be commanded of each tendon (tendons,) [N]."""
    if config.tendon_limits:
        return np.array(config.tendon_limits)
    return highest_tensions(config.arm)


def are_beyond(tensions: FloatArray, limits: FloatArray) -> NDArray[np.bool_]:
    """Which of ``tensions`` (..., tendons) [N] exceed their limit in ``limits`` (tendons,) [N]."""
    return tensions > limits * (1.0 + _ROUNDING)


def check_command(arm: Arm, tensions: ArrayLike, limits: FloatArray) -> FloatArray:
    """Return commanded ``tensions``, (tendons,) or of `Arm.tension_shape` [N], as (tendons,).

    Raises:
        TensionError: if they do not fit ``arm``, or one exceeds its limit in ``limits``
            (tendons,) [N]; the message names the tendon.
    """
    shaped = np.asarray(tensions)
    if shaped.shape == (len(arm.tendons),):
        shaped = shaped.reshape(arm.tension_shape)
    checked = check_tensions(arm, shaped)
    if checked.ndim != len(arm.tension_shape):
        raise TensionError(f'tensions have shape {checked.shape}, expected {arm.tension_shape}')
    flat = checked.ravel()
    beyond = np.flatnonzero(are_beyond(flat, limits))
    if beyond.size:
        tendon = int(beyond[0])
        raise TensionError(
            f'tension of {arm.tendon_names[tendon]} is {float(flat[tendon])!r} N, expected at '
            f'most its limit {float(limits[tendon])!r} N (tendon_limits)'
        )
    return flat


def check_profile(profile: CommandProfile, arm: Arm, limits: FloatArray) -> None:
    """Check that all rows of ``profile``, and so all tensions, keep ``limits`` (tendons,) [N].

    Raises:
        ProfileError: if one does not; the message names the row.
    """
    beyond = are_beyond(profile.tensions, limits).any(axis=1)
    # The first row beyond a limit, or any row to check its shape.
    for row in [int(np.argmax(beyond))] if beyond.any() else [0]:
        try:
            check_command(arm, profile.tensions[row], limits)
        except TensionError as error:
            raise ProfileError(str(error), row) from None


@functools.cache
def _preset(name: str) -> Arm:
    return load_config(preset_path(name)).arm
