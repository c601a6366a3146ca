"""One shape in one call."""

from __future__ import annotations

import functools

from numpy.typing import ArrayLike

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.pose import Pose
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.solver import DEFAULT_MODEL, Solver
from octo_arm_model.rod.stations import DEFAULT_STATIONS


@functools.lru_cache(maxsize=16)
def _cached_solver(arm: Arm, model: str, stations: int, base: Pose) -> Solver:
    # For one shape machine code takes longer to load than it saves.
    return Solver(arm, model, stations, base, compiled=False)


def solve(
    arm: Arm,
    tensions: ArrayLike,
    model: str = DEFAULT_MODEL,
    stations: int = DEFAULT_STATIONS,
    base: Pose = Pose(),
) -> Backbone:
    """Shape of ``arm`` under ``tensions``; see `Solver`. Solvers are cached."""
    return _cached_solver(arm, model, stations, base).solve(tensions)
