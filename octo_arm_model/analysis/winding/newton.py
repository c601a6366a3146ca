"""Newton's method for the tensions that hold tendons at prescribed displacements.

Projected on the taut tendons (Bertsekas 1982), of the maximum that `displacement` explains. From a
solution nearby it begins with the derivatives of that one, which rank-one updates (Broyden 1965)
correct until a step reduces the error too little; then they are computed anew.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import nnls

from octo_arm_model.analysis.winding.complementarity import complementary_step, lacking
from octo_arm_model.analysis.winding.tendon_displacement import (
    displacements_by_tension,
    displacements_of,
)
from octo_arm_model.core.errors import ConvergenceError, SolveError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.solver import Solver

# Displacements are met to this part of the length of the arm, and tensions to this of the largest.
TOLERANCE = 1e-9
MAX_ITERATIONS = 60
_ROUNDING = 1e-13  # of the length of the arm, that displacements are computed to
_SMALLEST_STEP = 1e-6
# Derivatives of a solution nearby are used while each step leaves no more than this of the error.
_SLOW = 0.1


@dataclass(frozen=True)
class Wound:
    """An arm with tendons of prescribed displacement.

    Attributes:
        backbone: its shape; ``backbone.tensions`` are the tensions of all tendons [N].
        displacement: length that the winch of each tendon has reeled in [m], of
            `Arm.tension_shape`; of a slack one, what would make it taut, more than was asked for.
        slack: names of tendons of prescribed displacement without tension, longer than their path.
        driven: whether the displacement of each tendon was prescribed, (tendons,).
        changes: derivative of ``displacement`` by the tensions [m/N], (tendons, tendons), nearly:
            what another solution begins with.
    """

    backbone: Backbone
    displacement: FloatArray
    slack: tuple[str, ...]
    driven: NDArray[np.bool_] = field(repr=False)
    changes: FloatArray = field(repr=False)


class Winding:
    """Newton's method on the tensions of the driven tendons."""

    def __init__(
        self,
        solver: Solver,
        driven: NDArray[np.bool_],
        wanted: FloatArray,
        tip_wrench: ArrayLike | None,
        history: Backbone | None = None,
    ) -> None:
        """Prepare; ``wanted`` (tendons,) [m] counts where a tendon is ``driven``.

        Tendons with friction slide from their tensions in ``history``, else from slack.
        """
        self._history = history
        self._solver, self._driven, self._wanted = solver, driven, wanted
        self._tip_wrench = None if tip_wrench is None else solver.check_tip_wrench(tip_wrench)
        self._length = solver.arm.length
        self._is_near = False  # so that few tendons become slack or taut

    def follow(self, tensions: FloatArray, start: Wound) -> Wound:
        """What holds the wanted displacements, from another solution.

        ``tensions`` (tendons,) [N] are those of ``start``, or others where tendons are not driven.
        """
        self._is_near = True
        moved = tensions - start.backbone.tensions.ravel()
        # By the derivatives of the solution before.
        displacement = start.displacement.ravel() + start.changes @ moved
        step = self._step(tensions, displacement, start.changes)
        return self.solve(np.maximum(0.0, tensions + step), start.backbone, start.changes)

    def solve(
        self, tensions: FloatArray, start: Backbone | None, changes: FloatArray | None = None
    ) -> Wound:
        """What holds the wanted displacements, from ``tensions`` (tendons,) [N]."""
        backbone, displacement = self._solve(tensions, start)
        left, fresh = np.inf, False
        for iteration in range(MAX_ITERATIONS):
            before, left = left, self._left(tensions, displacement)
            if changes is None or (left > _SLOW * before and not fresh and left > self._met):
                changes, fresh = self._changes(backbone), True
            else:
                fresh = False
            step = self._step(tensions, displacement, changes)
            if left <= self._met:
                is_fine = np.abs(step).max() <= TOLERANCE * max(float(tensions.max()), 1e-300)
                if is_fine or left <= self._rounding or left >= before:
                    return self._wound(backbone, displacement, changes)
            part = 1.0
            while True:
                if part < 1.0 and not fresh:
                    # Derivatives of another solution may point the wrong way.
                    changes, fresh, part = self._changes(backbone), True, 1.0
                    step = self._step(tensions, displacement, changes)
                new = np.maximum(0.0, tensions + part * step)
                moved = new - tensions
                self._solver.check_time()  # A step beyond the budget counts as one too long.
                try:
                    found, reached = self._solve(new, backbone)
                except SolveError:
                    found = None
                # Curvature condition: past the maximum the slope may not grow to 0.9 of the first.
                if found is not None and (
                    self._work(reached, moved) <= 0.9 * abs(self._work(displacement, moved))
                ):
                    break
                if left <= self._met:
                    return self._wound(backbone, displacement, changes)  # it is all rounding
                part *= 0.5
                if part < _SMALLEST_STEP:
                    raise self._error(left, iteration)
            # Broyden's update: the derivatives along the step are those that were found.
            size = float(moved @ moved)
            if size > 0.0:
                missed = reached - displacement - changes @ moved
                changes = changes + np.outer(missed, moved) / size
            backbone, displacement, tensions = found, reached, new
        raise self._error(left, MAX_ITERATIONS)

    @property
    def _rounding(self) -> float:
        return _ROUNDING * self._length

    @property
    def _met(self) -> float:
        return TOLERANCE * self._length

    def _free(self, tensions: FloatArray, displacement: FloatArray) -> NDArray[np.bool_]:
        """Tendons that are taut or become so: a slack one whose path is short enough stays so."""
        with np.errstate(invalid='ignore'):  # of tendons that are not driven
            free: NDArray[np.bool_] = (tensions > 0.0) | (displacement < self._wanted)
        return free & self._driven

    def _left(self, tensions: FloatArray, displacement: FloatArray) -> float:
        """Largest error of the displacements [m]."""
        free = self._free(tensions, displacement)
        return float(np.abs(displacement - self._wanted)[free].max(initial=0.0))

    def _step(
        self, tensions: FloatArray, displacement: FloatArray, changes: FloatArray
    ) -> FloatArray:
        """Newton's step of all tensions; zero but for those that are free."""
        wrong = np.where(self._driven, self._wanted - displacement, 0.0)
        if self._is_near:
            slack = lacking(wrong, self._length)
            near = complementary_step(changes, wrong, tensions, self._driven, slack)
            if near is not None:
                return near
        free = np.flatnonzero(self._free(tensions, displacement))
        step = np.zeros_like(tensions)
        step[free] = np.linalg.lstsq(changes[np.ix_(free, free)], wrong[free], rcond=1e-10)[0]
        if (tensions + step >= 0.0).all():
            return step
        # Which tendons end slack follows from the quadratic programme that Newton's step solves:
        # least (T' - T) C (T' - T) / 2 - wrong (T' - T) over T' >= 0, for C = U^T U.
        driven = np.flatnonzero(self._driven)
        part = changes[np.ix_(driven, driven)]
        values, vectors = np.linalg.eigh(0.5 * (part + part.T))
        root = np.sqrt(np.maximum(values, 1e-10 * values[-1]))
        goal = (vectors.T @ wrong[driven]) / root + root * (vectors.T @ tensions[driven])
        step[driven] = nnls(root[:, np.newaxis] * vectors.T, goal)[0] - tensions[driven]
        return step

    def _work(self, displacement: FloatArray, moved: FloatArray) -> float:
        driven = self._driven
        return float((displacement - self._wanted)[driven] @ moved[driven])

    def _changes(self, backbone: Backbone) -> FloatArray:
        """Derivative of all displacements by all tensions [m/N], (tendons, tendons)."""
        return displacements_by_tension(self._solver, self._solver.sensitivity(backbone))

    def _wound(self, backbone: Backbone, displacement: FloatArray, changes: FloatArray) -> Wound:
        arm, slack = self._solver.arm, list[str]()
        for tendon in np.flatnonzero(backbone.tensions.ravel() == 0.0).tolist():
            wanted = self._wanted[tendon] if self._driven[tendon] else np.inf
            if displacement[tendon] > wanted + self._met:
                slack.append(arm.tendon_names[tendon])
        whole = displacement.reshape(arm.tension_shape)
        return Wound(backbone, whole, tuple(slack), self._driven, changes)

    def _error(self, left: float, iterations: int) -> ConvergenceError:
        what = 'the displacement of the tendons'
        return ConvergenceError(what, left / self._length, iterations)

    def _solve(self, tensions: FloatArray, start: Backbone | None) -> tuple[Backbone, FloatArray]:
        """Shape under ``tensions`` (tendons,) and all displacements (tendons,) [m]."""
        solver = self._solver
        given = tensions.reshape(solver.arm.tension_shape)
        backbone = solver.solve(given, self._tip_wrench, start)
        return backbone, displacements_of(solver, backbone).ravel()
