"""Command profiles by name: the movements built in, and files."""

from __future__ import annotations

from pathlib import Path

from numpy.typing import ArrayLike

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.errors import ProfileError
from octo_arm_model.simulation.movements import MOVEMENTS
from octo_arm_model.simulation.profile import CommandProfile
from octo_arm_model.simulation.profile_files import read_profile

# Commanded tensions have topics like the measured ones, below this name.
TOPIC = 'tendon_commands'


def profile_names(arm: Arm) -> dict[str, str]:
    """Names and descriptions of the movements that ``arm`` can make."""
    return {
        name: movement.description
        for name, movement in MOVEMENTS.items()
        if not movement.objection(arm)
    }


def find_profile(name: str, arm: Arm, highest: ArrayLike | None = None) -> CommandProfile:
    """Profile for ``arm``: a movement that is built in, or a CSV or YAML file.

    Args:
        name: of a movement, or path of a file (.csv, .yaml, .yml).
        arm: the arm that is to move.
        highest: largest tension [N] of all tendons or of each, of `Arm.tension_shape`; by default
            what the arm bears. Tensions of the paper and of files are as they are given there.

    Raises:
        ProfileError: if there is none of that name, it is not for this arm, or the file is wrong;
            the message names the file and its line.
    """
    if name in MOVEMENTS:
        return MOVEMENTS[name].profile(arm, highest)
    if Path(name).suffix in ('.csv', '.yaml', '.yml'):
        if highest is not None:
            raise ProfileError(f'highest does not go with a file such as {name}')
        return read_profile(name, arm)
    known = ', '.join(profile_names(arm))
    raise ProfileError(f'no profile {name!r}, expected a .csv or .yaml file or one of {known}')
