"""Tendons of prescribed displacement instead of tension: the tensions that hold them.

A winch that reels in D leaves its tendon of axial stiffness k [N] under the tension T with

    D(T) = l(0) - l(T) + T (l(0) + f) / k

for its length l in the arm and f between base and winch: what the arm gives way, and what the
tendon stretches over its whole length. l is the derivative of the arm's minimal energy E(T) by the
tension, and E is concave: the tensions that hold given D maximise a concave function over T >= 0.
Where the multiplier would be negative the tendon is slack, and the maximum is unique where the
equilibrium is. Projected Newton method on the taut tendons (Bertsekas 1982); from a solution
nearby with the derivatives of that one, brought up to date by rank-one updates (Broyden 1965)
as long as they serve.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import nnls

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.errors import (
    ConfigError,
    ContinuationError,
    ConvergenceError,
    SolveError,
    TensionError,
    shown,
)
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.core.solver import Solver

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
        start: solution to begin from; one of this function takes a few solves, not tens.
        tip_wrench: as of `Solver.solve`.

    Raises:
        TensionError: if a tendon is unknown, named in both, or a value is impossible.
        ConfigError: if tendons have friction, for which displacements are not known.
        ConvergenceError: if no tensions were found that hold these lengths.
        OctoArmError: as `Solver.solve`.
    """
    arm = solver.arm
    given = dict(tensions or {})
    _check_friction(arm)
    check_displacements(arm, displacements, given)
    driven = np.array([name in displacements for name in arm.tendon_names])
    wanted = np.array([displacements.get(name, np.nan) for name in arm.tendon_names])
    current = np.array([given.get(name, 0.0) for name in arm.tendon_names])
    problem = _Winding(solver, driven, wanted, tip_wrench)
    if start is None:
        return problem.solve(current, None)
    backbone = start.backbone if isinstance(start, Wound) else start
    begin = np.where(driven, backbone.tensions.ravel(), current)
    changes = None
    if isinstance(start, Wound):
        changes = start.changes
        begin = problem.predict(begin, start)
    try:
        return problem.solve(begin, backbone, changes)
    except ContinuationError:
        raise  # Its budget is spent.
    except SolveError:
        return problem.solve(current, None)


def tendon_compliance(solver: Solver) -> FloatArray:
    """By how much each tendon itself stretches per newton [m/N], (tendons,)."""
    arm = solver.arm
    whole = solver.rest_lengths.ravel().copy()
    if arm.free_length:
        whole += arm.free_length
    stiffness = np.array(arm.axial_stiffness or np.zeros(whole.size))
    does = stiffness > 0.0
    return np.divide(whole, stiffness, out=np.zeros_like(whole), where=does)


def displacements_of(solver: Solver, backbone: Backbone) -> FloatArray:
    """Length that the winch of each tendon has reeled in [m], of `Arm.tension_shape`.

    For a single solution of ``solver``; of a slack tendon the least that makes it taut.

    Raises:
        ConfigError: if ``backbone`` is that of a batch or of another solver, or tendons both
            stretch and have friction.
    """
    if solver.arm.axial_stiffness:
        _check_friction(solver.arm)
    shortened = solver.rest_lengths - solver.tendon_lengths(backbone)
    stretched = tendon_compliance(solver) * backbone.tensions.ravel()
    return shortened + stretched.reshape(shortened.shape)


def check_displacements(
    arm: Arm, displacements: Mapping[str, float], tensions: Mapping[str, float]
) -> None:
    """Check that both are of different tendons of ``arm``, and displacements finite.

    Raises:
        TensionError: if not; the message names the tendon.
    """
    for name in [*displacements, *tensions]:
        if name not in arm.tendon_names:
            known = ', '.join(arm.tendon_names)
            raise TensionError(f'unknown tendon {name}; this arm has {known}')
    for name, value in displacements.items():
        if name in tensions:
            raise TensionError(f'tendon {name} has both a displacement and a tension')
        if not np.isfinite(value):
            raise TensionError(f'displacement of {name} is {value!r} m, expected a finite number')


def _check_friction(arm: Arm) -> None:
    if arm.friction:
        # Without an energy nothing is maximised, and they stretch by what friction leaves.
        raise ConfigError(
            'displacements of tendons are for those without friction; tendons.friction is '
            f'{shown(list(arm.friction))}'
        )


class _Winding:
    """Newton's method on the tensions of the driven tendons."""

    def __init__(
        self,
        solver: Solver,
        driven: NDArray[np.bool_],
        wanted: FloatArray,
        tip_wrench: ArrayLike | None,
    ) -> None:
        """Prepare; ``wanted`` (tendons,) [m] counts where a tendon is ``driven``."""
        self._solver, self._driven, self._wanted = solver, driven, wanted
        self._tip_wrench = tip_wrench
        self._length = solver.arm.length
        self._compliance = tendon_compliance(solver)

    def predict(self, tensions: FloatArray, start: Wound) -> FloatArray:
        """Tensions to begin with instead of ``tensions``, by the derivatives of ``start``."""
        moved = tensions - start.backbone.tensions.ravel()
        displacement = start.displacement.ravel() + start.changes @ moved
        return np.maximum(0.0, tensions + self._step(tensions, displacement, start.changes))

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
                if is_fine or left <= _ROUNDING * self._length or left >= before:
                    return self._wound(backbone, displacement, changes)
            part = 1.0
            while True:
                if part < 1.0 and not fresh:
                    # Derivatives of another solution may point the wrong way.
                    changes, fresh, part = self._changes(backbone), True, 1.0
                    step = self._step(tensions, displacement, changes)
                new = np.maximum(0.0, tensions + part * step)
                moved = new - tensions
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
        free = np.flatnonzero(self._free(tensions, displacement))
        step = np.zeros_like(tensions)
        wrong = self._wanted - displacement
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
        lengths = self._solver.sensitivity(backbone).by_tension.tendon_length
        return np.diag(self._compliance) - lengths

    def _wound(self, backbone: Backbone, displacement: FloatArray, changes: FloatArray) -> Wound:
        names = np.array(self._solver.arm.tendon_names)
        with np.errstate(invalid='ignore'):
            loose = displacement - self._wanted > self._met
        slack = self._driven & (backbone.tensions.ravel() == 0.0) & loose
        shape = self._solver.arm.tension_shape
        whole = displacement.reshape(shape)
        return Wound(backbone, whole, tuple(names[slack].tolist()), self._driven, changes)

    def _error(self, left: float, iterations: int) -> ConvergenceError:
        what = 'the displacement of the tendons'
        return ConvergenceError(what, left / self._length, iterations)

    def _solve(self, tensions: FloatArray, start: Backbone | None) -> tuple[Backbone, FloatArray]:
        """Shape under ``tensions`` (tendons,) and all displacements (tendons,) [m]."""
        solver = self._solver
        given = tensions.reshape(solver.arm.tension_shape)
        backbone = solver.solve(given, self._tip_wrench, start)
        shortened = (solver.rest_lengths - solver.tendon_lengths(backbone)).ravel()
        return backbone, shortened + self._compliance * tensions
