"""The tensions that hold tendons at prescribed displacements, one shape after the other.

Of the paper's models, and of tendons with friction; `rod.winches` finds others together with the
shape. Friction leaves no energy, and a tendon that is let out a little after it was drawn in, or
the other way round, slips next to its base alone: its displacement changes by the square of what
its tension does, and its derivative at the turn is zero. Newton's steps are therefore damped as
those of Levenberg and Marquardt, by a part of what the tendons would yield on the slack arm, and
take differences over about as much as tensions will change. Where the slipping part of a tendon
grows past a point of the arm derivatives jump, so that a step may end farther from the goal than
it began, but not than several before (Grippo, Lampariello and Lucidi 1986).

Of tendons that do not stretch there can be more than ways in which the arm deforms: four parallel
ones in which two opposite lengths together are the other two. Such lengths leave one tendon slack,
unless they agree; then friction alone tells their tensions apart, by less than numbers have
digits. Tensions then stay near those they were, and what lengths contradict each other by is left.
Likewise left is, to a millionth of the arm, what takes a tendon to slip next to its base by less
than the points of the arm resolve.
"""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
from numpy.typing import ArrayLike, NDArray

from octo_arm_model.analysis.winding.tendon_displacement import (
    displacements_by_tension,
    displacements_of,
)
from octo_arm_model.analysis.winding.wound import Wound, wound_of
from octo_arm_model.arm.errors import ConvergenceError, SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.solver import Solver
from octo_arm_model.rod.winches import MET, ROUNDING

_MOST = 100  # steps
# Damping at first, at least and at most, in parts of what tendons yield on the slack arm, and its
# change after a step that went too far and after one that did not.
_DAMPING, _LIGHTEST, _HEAVIEST = 1e-2, 1e-8, 1e9
_HEAVIER, _LIGHTER = 4.0, 0.1
# At least while steps make the merit this part of it, or little is left: tensions that lengths
# hardly tell of stay near those they were.
_LIGHT, _QUICK = 1e-4, 0.1
# Differences are corrected by rank-one updates (Broyden 1965) while steps make the merit this.
_QUICKEST = 0.02
_REMEMBERED = 5  # steps, than the worst of which a next one must not be worse
_MOST_EXCHANGES, _PATIENCE = 200, 3  # of slack and taut tendons; without getting fewer
_DIFFERENCE = 1e-5  # of the largest tension, or of one that reels in this part of the length
# Differences are over this part of the step expected, but at most over this part of the tension.
_SECANT, _FARTHEST = 0.5, 0.3
# Lengths that contradict each other by at most this part of that of the arm are held as they are.
_CONTRADICTION = 1e-6
_LONGEST = 30  # steps for what is left of less than that to be halved, else it is held as it is
_TURNED = 1e-3  # part of its yielding that a tendon shows which slips from more than its base


def _level(backbone: Backbone) -> int:
    assert backbone.equilibrium is not None
    return backbone.equilibrium.level


class SlidingWinding:
    """The method of Levenberg and Marquardt on the tensions of the driven tendons."""

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
        self._met, self._rounding = MET * self._length, ROUNDING * self._length

    @functools.cached_property
    def _slack_changes(self) -> FloatArray:
        """Derivative of all displacements by all tensions of the slack arm [m/N]."""
        solver = self._solver
        slack = solver.solve(np.zeros(solver.arm.tension_shape))
        return displacements_by_tension(solver, solver.sensitivity(slack))

    @functools.cached_property
    def _yields(self) -> FloatArray:
        """Likewise of each by its own tension, (tendons,)."""
        return np.diag(self._slack_changes)

    def solve(self, tensions: FloatArray, start: Backbone | None) -> Wound:
        """What holds the wanted displacements, from ``tensions`` (tendons,) [N]."""
        wound = self._search(tensions, start)
        if _level(wound.backbone):
            # The way there may have taken more nodes than these tensions do.
            found = wound.backbone.tensions.ravel()
            alone = self._solve(found, None if self._history is None else start)[0]
            if _level(alone) < _level(wound.backbone):
                return self._search(found, alone)
        return wound

    def _search(self, tensions: FloatArray, start: Backbone | None) -> Wound:
        backbone, displacement = self._solve(tensions, start)
        expected = np.abs(displacement - self._wanted) / self._yields
        damping, before, is_fresh = _DAMPING, np.inf, False
        slopes: FloatArray | None = None
        merits = [self._merit(tensions, displacement)]
        least, waited, best = np.inf, 0, backbone
        for _ in range(_MOST):
            self._solver.check_time()
            left, waited = self._left(tensions, displacement), waited + 1
            if left < least:
                waited = 0 if left < 0.5 * least else waited
                least, best = left, backbone
            if waited > _LONGEST and least <= self._borne:
                break
            if slopes is None:
                over = _SECANT * expected
                slopes, is_fresh = self._differences(backbone, displacement, over), True
            damped = slopes + damping * np.diag(self._yields)
            step = self._step(tensions, displacement, damped)
            if left <= self._met:
                is_fine = np.abs(step).max() <= MET * tensions.max()
                if is_fine or left <= self._rounding or left >= 0.5 * before:
                    return self._wound(backbone, displacement)
            elif is_fresh and self._contradict(tensions, displacement, slopes):
                return self._wound(backbone, displacement)
            new = np.maximum(0.0, tensions + step)
            try:
                found, reached = self._solve(new, backbone)
                # Where the arm sticks nothing changes, up to where it slips.
                merit = self._merit(new, reached)
            except SolveError:
                merit = np.inf
            if merit <= max(merits[-_REMEMBERED:]):
                is_light = left > self._borne and merit > _QUICK * merits[-1]
                damping = max(damping * _LIGHTER, _LIGHTEST if is_light else _LIGHT)
                moved = new - tensions
                before, expected, size = left, np.abs(moved), float(moved @ moved)
                if merit <= _QUICKEST * merits[-1] and size > 0.0:
                    missed = reached - displacement - slopes @ moved
                    slopes, is_fresh = slopes + np.outer(missed, moved) / size, False
                else:
                    slopes = None
                merits.append(merit)
                backbone, displacement, tensions = found, reached, new
                continue
            if left <= self._met:
                return self._wound(backbone, displacement)
            if not is_fresh:
                slopes = None
                continue
            damping *= _HEAVIER
            if damping > _HEAVIEST:
                break
        if least <= self._borne:
            reached = displacements_of(self._solver, best).ravel()
            return self._wound(best, reached)
        raise ConvergenceError('the displacement of the tendons', least / self._length, _MOST)

    @property
    def _borne(self) -> float:
        """By how much lengths may contradict each other [m]."""
        return _CONTRADICTION * self._length

    def _contradict(
        self, tensions: FloatArray, displacement: FloatArray, slopes: FloatArray
    ) -> bool:
        """Whether what displacements lack is little, and not what tensions of ``slopes`` change.

        Which says nothing where a tendon only begins to slip the other way.
        """
        free = np.flatnonzero(self._free(tensions, displacement))
        matrix, yields = slopes[np.ix_(free, free)], self._yields[free]
        if self._left(tensions, displacement) > self._borne or (
            (np.diag(matrix) < _TURNED * yields).any()
        ):
            return False
        damped = matrix + _DAMPING * np.diag(yields)
        moved = np.linalg.lstsq(damped, (self._wanted - displacement)[free], rcond=None)[0]
        return bool(np.abs(matrix @ moved).max() <= 0.5 * self._met)

    def _free(self, tensions: FloatArray, displacement: FloatArray) -> NDArray[np.bool_]:
        """Tendons that are taut or become so: a slack one whose path is short enough stays so."""
        with np.errstate(invalid='ignore'):  # of tendons that are not driven
            free: NDArray[np.bool_] = (tensions > 0.0) | (displacement < self._wanted)
        return free & self._driven

    def _left(self, tensions: FloatArray, displacement: FloatArray) -> float:
        """Largest error of the displacements [m]."""
        free = self._free(tensions, displacement)
        return float(np.abs(displacement - self._wanted)[free].max(initial=0.0))

    def _wound(self, backbone: Backbone, displacement: FloatArray) -> Wound:
        return wound_of(self._solver.arm, backbone, displacement, self._wanted, self._driven)

    def _step(
        self, tensions: FloatArray, displacement: FloatArray, changes: FloatArray
    ) -> FloatArray:
        """Newton's step of all tensions, of which some get slack and others taut.

        It solves a linear complementarity problem, by block principal pivoting (Kostreva 1978),
        with the rule of the last index (Murty 1974) where that goes round in circles.
        """
        driven = np.flatnonzero(self._driven)
        matrix = changes[np.ix_(driven, driven)]
        wrong = (self._wanted - displacement)[driven]
        wanted = wrong + matrix @ tensions[driven]
        taut = (tensions[driven] > 0.0) | (wrong > self._rounding)
        fewest, patience = driven.size + 1, _PATIENCE
        found = np.zeros(driven.size)
        for _ in range(_MOST_EXCHANGES):
            found[:] = 0.0
            some = np.flatnonzero(taut)
            found[some] = np.linalg.lstsq(matrix[np.ix_(some, some)], wanted[some], rcond=None)[0]
            lacking = wanted - matrix @ found > self._rounding
            wrong_way = np.flatnonzero(np.where(taut, found < 0.0, lacking))
            if not wrong_way.size:
                break
            patience = _PATIENCE if wrong_way.size < fewest else patience - 1
            fewest = min(fewest, wrong_way.size)
            taut[wrong_way if patience > 0 else wrong_way[-1]] ^= True
        step = np.zeros_like(tensions)
        step[driven] = np.maximum(found, 0.0) - tensions[driven]
        return step

    def _merit(self, tensions: FloatArray, displacement: FloatArray) -> float:
        """How far displacements, or the slackness of tendons, are from what is wanted."""
        yields = self._yields
        wrong = np.minimum(yields * tensions, displacement - self._wanted)[self._driven]
        return float(wrong @ (wrong / yields[self._driven]))

    def _differences(
        self, backbone: Backbone, displacement: FloatArray, over: FloatArray
    ) -> FloatArray:
        """Differences of all displacements by the free tensions [m/N], in the way these go.

        ``over`` is by how much tensions differ [N], (tendons,); a little at least.
        """
        tensions = backbone.tensions.ravel()
        changes = self._slack_changes.copy()
        usual = self._length / self._yields.max()
        least = _DIFFERENCE * max(float(tensions.max()), _DIFFERENCE * usual)
        size = np.fmax(least, np.minimum(over, _FARTHEST * tensions))
        free = self._free(tensions, displacement)
        is_let_out = (displacement > self._wanted) & (tensions > size) & free
        over = np.where(is_let_out, -size, size)
        found = self._solver.reeled_by_tension(backbone, over)
        if found is not None:
            return found
        for k in np.flatnonzero(free):
            self._solver.check_time()
            moved = tensions.copy()
            moved[k] += over[k]
            reached = self._solve(moved, backbone)[1]
            changes[:, k] = (reached - displacement) / over[k]
        return changes

    def _solve(self, tensions: FloatArray, start: Backbone | None) -> tuple[Backbone, FloatArray]:
        """Shape under ``tensions`` (tendons,) and all displacements (tendons,) [m].

        From what tendons did before.
        """
        solver, history = self._solver, self._history
        given = tensions.reshape(solver.arm.tension_shape)
        if history is None:
            backbone = solver.solve(given, self._tip_wrench, start)
        else:
            last = dataclasses.replace(start or history, point_tensions=history.point_tensions)
            backbone = solver.follow(given, last, self._tip_wrench)
        return backbone, displacements_of(solver, backbone).ravel()
