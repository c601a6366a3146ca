"""Tendons of prescribed displacement instead of tension: the tensions that hold them.

A winch that reels in D leaves its tendon of axial stiffness k [N] under the tension T with

    D(T) = l(0) - l(T) + T (l(0) + f) / k

for its length l in the arm and f between base and winch: what the arm gives way, and what the
tendon stretches over its whole length. l is the derivative of the arm's minimal energy E(T) by the
tension, and E is concave: the tensions that hold given D maximise a concave function over T >= 0.
Where the multiplier would be negative the tendon is slack, and the maximum is unique where the
equilibrium is. `winding` has the method that finds it. Tendons with friction stretch by what it
leaves of T, and have no such maximum: see `sliding`, also for what tendons that do not
stretch cannot tell.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model.analysis.winding.sliding import SlidingWinding
from octo_arm_model.analysis.winding.wound import Wound, wound_of
from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import (
    ArmDefinitionError,
    ContinuationError,
    SolveError,
    TensionError,
    listed,
    shown,
)
from octo_arm_model.arm.validation import LARGEST, finite
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.solver import Solver


def solve_displacements(
    solver: Solver,
    displacements: Mapping[str, float],
    tensions: Mapping[str, float] | None = None,
    start: Backbone | Wound | None = None,
    tip_wrench: ArrayLike | None = None,
) -> Wound:
    """Shape and tensions for some tendons wound in by length and the others held by tension.

    Args:
        solver: of the model exact.
        displacements: length reeled in, by tendon name [m], zero for the taut unloaded arm;
            negative for length paid out.
        tensions: tension by tendon name [N]; zero for those named in neither.
        start: solution to begin from; one of this function takes a few solves, not tens. Tendons
            with friction slide from their tensions there, without one from slack.
        tip_wrench: as of `Solver.solve`.

    Raises:
        TensionError: if a tendon is unknown, named in both, or a value is impossible, as of a
            displacement that is longer than what there is to reel in.
        ConvergenceError: if no tensions were found that hold these lengths; a `ContinuationError`
            if that would take more time than the budget of one solve.
        OctoArmError: as `Solver.solve`.
    """
    arm = solver.arm
    given = dict(tensions or {})
    check_displacements(arm, displacements, given)
    driven = np.array([name in displacements for name in arm.tendon_names])
    wanted = np.array([displacements.get(name, np.nan) for name in arm.tendon_names])
    solver.check_displacements(wanted[driven], np.flatnonzero(driven).tolist())
    current = np.array([given.get(name, 0.0) for name in arm.tendon_names])
    with solver.together():
        backbone = start.backbone if isinstance(start, Wound) else start
        found = solver.wind(np.where(driven, wanted, 0.0), driven, current, tip_wrench, backbone)
        if found is not None:
            return wound_of(arm, *found, wanted, driven)
        problem = SlidingWinding(solver, driven, wanted, tip_wrench, backbone)
        if backbone is not None:
            try:
                begin = np.where(driven, backbone.tensions.ravel(), current)
                return problem.solve(begin, backbone)
            except ContinuationError:
                raise  # Its budget is spent.
            except SolveError:
                pass
        return problem.solve(current, None)


def check_displacements(
    arm: Arm, displacements: Mapping[str, float], tensions: Mapping[str, float]
) -> None:
    """Check that both are of different tendons of ``arm``, and displacements finite.

    Raises:
        TensionError: if not; the message names the tendon.
    """
    names = frozenset(arm.tendon_names)
    for name in [*displacements, *tensions]:
        if name not in names:
            known = listed(arm.tendon_names)
            raise TensionError(f'unknown tendon {listed([name])}; this arm has {known}')
    for name, value in displacements.items():
        if name in tensions:
            raise TensionError(f'tendon {name} has both a displacement and a tension')
        # Of larger ones the squares are beyond the range of floats.
        try:
            finite(name, value)
        except ArmDefinitionError:
            raise TensionError(
                f'displacement of {name} is {shown(value)} m, expected a finite number of at most '
                f'{LARGEST:g}'
            ) from None
