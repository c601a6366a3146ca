"""Command profiles by name: built-in movements, and files."""

from __future__ import annotations

from pathlib import Path

from numpy.typing import ArrayLike

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ProfileError
from octo_arm_model.simulation.profiles.movements import MOVEMENTS
from octo_arm_model.simulation.profiles.profile import CommandProfile
from octo_arm_model.simulation.profiles.profile_files import read_profile

# Commanded tensions have the same topics as measured ones, below this name.
TOPIC = 'tendon_commands'


def profile_names(arm: Arm) -> dict[str, str]:
    """Names and descriptions of the movements for ``arm``."""
    return {
        name: movement.description
        for name, movement in MOVEMENTS.items()
        if not movement.objection(arm)
    }


def find_profile(name: str, arm: Arm, highest: ArrayLike | None = None) -> CommandProfile:
    """Profile for ``arm``: a built-in movement, or a CSV or YAML file.

    Args:
        name: of a movement, or path of a file (.csv, .yaml, .yml).
        arm: the arm.
        highest: largest tension [N] of all tendons or of each, of `Arm.tension_shape`; by default
            `default_highest`. Not for tensions of the paper and of files.

    Raises:
        ProfileError: if there is no such profile, it is not for this arm, or the file is invalid;
            the message has the name of the file and the line.
    """
    if name in MOVEMENTS:
        if objection := MOVEMENTS[name].objection(arm):
            raise ProfileError(objection)
        return MOVEMENTS[name].profile(arm, highest)
    if Path(name).suffix in ('.csv', '.yaml', '.yml'):
        if highest is not None:
            raise ProfileError(f'highest does not go with a file such as {name}')
        return read_profile(name, arm)
    known = ', '.join(profile_names(arm))
    raise ProfileError(f'no profile {name!r}, expected a .csv or .yaml file or one of {known}')
