"""Tendons of prescribed displacement instead of tension: the tensions that hold them.

The length of a tendon is the derivative of the arm's minimal energy E(T) by its tension, and E is
concave: the tensions that hold given lengths l maximise E(T) - sum T l over T >= 0. Where the
multiplier would be negative the tendon is slack, and the maximum is unique where the equilibrium
is. Projected Newton method on the taut tendons (Bertsekas 1982).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from octo_arm_model.core.errors import ConvergenceError, SolveError, TensionError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.core.solver import Solver

# Lengths are met to this part of the length of the arm.
TOLERANCE = 1e-9
MAX_ITERATIONS = 60
_SMALLEST_STEP = 1e-6


@dataclass(frozen=True)
class Wound:
    """An arm with tendons of prescribed displacement.

    Attributes:
        backbone: its shape; ``backbone.tensions`` are the tensions of all tendons [N].
        displacement: by how much each tendon is shorter than in the unloaded arm [m], of
            `Arm.tension_shape`; more than was wound where it is slack.
        slack: names of wound tendons without tension that are longer than their path.
    """

    backbone: Backbone
    displacement: FloatArray
    slack: tuple[str, ...]


def solve_displacements(
    solver: Solver,
    displacements: Mapping[str, float],
    tensions: Mapping[str, float] | None = None,
    start: Backbone | None = None,
) -> Wound:
    """Shape and tensions for some tendons wound in by length and the others held by tension.

    Args:
        solver: of the model exact.
        displacements: length wound in, by tendon name [m]; negative for length paid out.
        tensions: tension by tendon name [N]; zero for those named in neither.
        start: solution to begin from.

    Raises:
        TensionError: if a tendon is unknown, named in both, or a value is impossible.
        ConvergenceError: if no tensions were found that hold these lengths.
    """
    arm = solver.arm
    given = dict(tensions or {})
    for name in [*displacements, *given]:
        if name not in arm.tendon_names:
            known = ', '.join(arm.tendon_names)
            raise TensionError(f'unknown tendon {name}; this arm has {known}')
    for name, value in displacements.items():
        if name in given:
            raise TensionError(f'tendon {name} has both a displacement and a tension')
        if not np.isfinite(value):
            raise TensionError(f'displacement of {name} is {value!r} m, expected a finite number')
    wound = np.array([name in displacements for name in arm.tendon_names])
    wanted = np.array([displacements[name] for name in arm.tendon_names if name in displacements])
    current = np.array([given.get(name, 0.0) for name in arm.tendon_names])
    if start is not None:
        current[wound] = start.tensions.ravel()[wound]

    problem = _Winding(solver, wound, wanted)
    found, excess = problem.solve(current, start)
    whole = solver.rest_lengths - solver.tendon_lengths(found)
    names = np.array(arm.tendon_names)[wound]
    taut = found.tensions.ravel()[wound] > 0.0
    loose = names[~taut & (excess > TOLERANCE * arm.length)]
    return Wound(found, whole, tuple(loose.tolist()))


class _Winding:
    """Newton's method on the tensions of the wound tendons."""

    def __init__(self, solver: Solver, wound: FloatArray, wanted: FloatArray) -> None:
        self._solver, self._wound, self._wanted = solver, wound, wanted
        self._scale = TOLERANCE * solver.arm.length

    def solve(self, tensions: FloatArray, start: Backbone | None) -> tuple[Backbone, FloatArray]:
        """Backbone that holds the wanted displacements and by how much it exceeds them [m]."""
        wound = self._wound
        backbone, excess = self._solve(tensions, start)
        for iteration in range(MAX_ITERATIONS):
            pull = backbone.tensions.ravel()[wound]
            # The active set: a slack tendon whose path is short enough stays slack.
            free = (pull > 0.0) | (excess < 0.0)
            if np.abs(excess[free]).max(initial=0.0) <= self._scale:
                return backbone, excess
            changes = self._solver.sensitivity(backbone).by_tension.tendon_length
            stiffness = -changes[np.ix_(wound, wound)]
            step = np.zeros_like(pull)
            step[free] = np.linalg.lstsq(
                stiffness[np.ix_(free, free)], -excess[free], rcond=1e-10
            )[0]
            part = 1.0
            while True:
                new = np.maximum(0.0, pull + part * step)
                tensions = tensions.copy()
                tensions[wound] = new
                try:
                    found, left = self._solve(tensions, backbone)
                except SolveError:
                    found = None
                # Curvature condition: past the maximum the slope may not grow to 0.9 of the first.
                moved = new - pull
                if found is not None and left @ moved <= 0.9 * np.abs(excess @ moved):
                    break
                part *= 0.5
                if part < _SMALLEST_STEP:
                    raise self._error(excess[free], iteration)
            backbone, excess = found, left
        raise self._error(excess, MAX_ITERATIONS)

    def _error(self, excess: FloatArray, iterations: int) -> ConvergenceError:
        left = float(np.abs(excess).max(initial=0.0)) / self._solver.arm.length
        return ConvergenceError('the displacement of the tendons', left, iterations)

    def _solve(self, tensions: FloatArray, start: Backbone | None) -> tuple[Backbone, FloatArray]:
        solver = self._solver
        backbone = solver.solve(tensions.reshape(solver.arm.tension_shape), start=start)
        displacement = (solver.rest_lengths - solver.tendon_lengths(backbone)).ravel()
        return backbone, displacement[self._wound] - self._wanted
