"""How far each tendon may be pulled: the limits of commanded tensions, and their one check."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model.analysis.inverse import default_highest
from octo_arm_model.config.config import Config, load_config
from octo_arm_model.config.paper_data import BENDING, FETCHING_IN_PLANE, FETCHING_IN_SPACE
from octo_arm_model.config.presets import preset_path
from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.errors import ProfileError, TensionError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.section.tendon_sums import check_tensions
from octo_arm_model.simulation.profile import CommandProfile

_FIGURES = {
    'renda2012_table2': {f'11 {panel}': tensions for panel, tensions in BENDING.items()},
    'renda2012_table4': {'14': FETCHING_IN_PLANE, '15': FETCHING_IN_SPACE},
}
_ROUNDING = 1e-9  # relative, of interpolation between tensions that are at their limit


def figures(arm: Arm) -> dict[str, FloatArray]:
    """Tensions (tendons,) [N] of the paper's figures of ``arm``, by number; empty for others."""
    for name, found in _FIGURES.items():
        if _preset(name) == arm:
            return {figure: np.ravel(tensions) for figure, tensions in found.items()}
    return {}


def highest_tensions(arm: Arm) -> FloatArray:
    """Largest tension of each tendon where none is given (tendons,) [N].

    What the arm bears, or a figure of the paper asks for.
    """
    highest = default_highest(arm).ravel()
    for tensions in figures(arm).values():
        highest = np.maximum(highest, tensions)
    # To two digits, upwards; read as decimals, so that no power of ten is rounded.
    exponents = np.floor(np.log10(highest) - 1.0).astype(np.int64)
    digits = np.ceil(highest / 10.0**exponents - 1e-9)
    return np.array([float(f'{two:.0f}e{power}') for two, power in zip(digits, exponents)])


def tendon_limits(config: Config) -> FloatArray:
    """Largest tension that may be commanded of each tendon (tendons,) [N]."""
    if config.tendon_limits:
        return np.array(config.tendon_limits)
    return highest_tensions(config.arm)


def check_command(arm: Arm, tensions: ArrayLike, limits: FloatArray) -> FloatArray:
    """Return ``tensions`` to be commanded, (tendons,) or as `Arm.tension_shape` [N], flat.

    Raises:
        TensionError: if they are none of ``arm``, or one is beyond its limit of ``limits``
            (tendons,) [N]; the message names the tendon.
    """
    shaped = np.asarray(tensions)
    if shaped.shape == (len(arm.tendons),):
        shaped = shaped.reshape(arm.tension_shape)
    checked = check_tensions(arm, shaped)
    if checked.ndim != len(arm.tension_shape):
        raise TensionError(f'tensions have shape {checked.shape}, expected {arm.tension_shape}')
    flat = checked.ravel()
    beyond = np.flatnonzero(flat > limits * (1.0 + _ROUNDING))
    if beyond.size:
        tendon = int(beyond[0])
        raise TensionError(
            f'tension of {arm.tendon_names[tendon]} is {float(flat[tendon])!r} N, expected at '
            f'most its limit {float(limits[tendon])!r} N (tendon_limits)'
        )
    return flat


def check_profile(profile: CommandProfile, arm: Arm, limits: FloatArray) -> None:
    """Check that ``profile`` keeps ``limits`` (tendons,) [N]; between its rows it always does.

    Raises:
        ProfileError: if it does not; the message names the row.
    """
    beyond = (profile.tensions > limits * (1.0 + _ROUNDING)).any(axis=1)
    # Of the rows, the first that a command of it would be refused for.
    for row in [int(np.argmax(beyond))] if beyond.any() else [0]:
        try:
            check_command(arm, profile.tensions[row], limits)
        except TensionError as error:
            raise ProfileError(str(error), row) from None


@functools.cache
def _preset(name: str) -> Arm:
    return load_config(preset_path(name)).arm
