"""Newton's method for the balance of a loaded rod in one condition, or of several in theirs."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from octo_arm_model.core.errors import ConvergenceError
from octo_arm_model.core.hints import IntArray, Number
from octo_arm_model.core.loaded.equilibrium import Equilibrium
from octo_arm_model.core.loaded.known_balance import KnownBalance
from octo_arm_model.core.loaded.linearised import Linearised, System, TipAnswer
from octo_arm_model.core.loaded.sliding.sliding_response import newton_step
from octo_arm_model.core.loaded.sliding.sliding_tendons import SlidingTendons
from octo_arm_model.core.loaded.stability import SAME
from octo_arm_model.core.loaded.state import Condition, Stability, State
from octo_arm_model.core.rod.solution import Shape

MOST = 10  # iterations
PROGRESS = 0.7  # what each iteration must leave less than of the residual
# Where a load states no tangent stiffness convergence is linear: iterations, and progress of each.
_MOST_LINEAR, _LINEAR_PROGRESS = 200, 0.99
FIRST_PROGRESS = 3.0  # likewise the first, which takes up the change of the loads
# A factorised system is used for another step where the one before left this residual and part of
# it.
NEAR, QUICK = 2e-5, 0.02
# A step with the same system leaves about the same part of residual and turn as the step before.
# Where the residual is not evaluated its estimate has this factor.
SAFETY = 10.0
# Steps that turn the arm by no more, whose square is rounding, need not be evaluated [rad].
_SMALL = 3e-7
TINY = 1e-300  # angle of a step that turns nothing, which is a step all the same [rad]
_MOST_SLID = 4  # times that tensions along tendons with friction change in a step near a balance
PREDICTED = 0.1  # part of the residual that a step with a system known before may leave


class Iterate(NamedTuple):
    """Result of Newton's method.

    Attributes:
        state: balanced or not.
        iterations: made.
        corrected: how far all of them but the first, which takes up the change of the loads, have
            turned the arm [rad].
        system: the last one solved, how it answers wrenches on the tip, or its stability where
            that is known already, if the state is balanced.
        moved: how far all of them have turned the arm [rad], where this is known.
        changed: the residual before the first, likewise.
        tendons: with friction, near a balance that was known.
    """

    state: State
    iterations: int
    corrected: Number
    system: System | TipAnswer | Stability | None
    moved: Number = np.inf
    changed: Number = np.inf
    tendons: SlidingTendons | None = None


class Newton(Protocol):
    """From a shape to balance in a condition, for as long as there is progress."""

    def __call__(self, condition: Condition, shape: Shape, tolerance: float) -> Iterate:
        """Iterate until the residual is within ``tolerance``."""


class _Progress(NamedTuple):
    """Newton's method on its way, of one arm, or of several that have gone the same way.

    Attributes:
        state: where it is.
        system: of the last step, or of a balance nearby that is known before the first.
        again: whether the next step uses it again.
        is_known: whether it is that of a balance nearby.
        is_first: whether no step has been made but such that left too much.
        iterations: made.
        corrected, moved, changed: as of `Iterate`, (...).
        turned: how far the arm has turned since the system was linearised, (...) [rad].
        angle: how far the last step has turned it, (...) [rad].
        convergence: part of the residual that this step has left, (...).
        is_settled: whether tensions along tendons with friction are those of its shape.
    """

    state: State
    system: System | None
    again: bool
    is_known: bool
    is_first: bool
    iterations: int
    corrected: Number
    moved: Number
    changed: Number
    turned: Number
    angle: Number
    convergence: Number
    is_settled: bool = True

    @property
    def last_system(self) -> System | None:
        """The last system if it is that of nearly the same state, of all arms."""
        return self.system if np.all(self.turned <= SAME) else None

    def of(self, arms: IntArray) -> _Progress:
        """That of some ``arms`` of several."""
        system = self.system
        return self._replace(
            state=self.state.of(arms),
            system=system.of(arms) if isinstance(system, Linearised) else None,
            corrected=self.corrected[arms],
            moved=self.moved[arms],
            changed=self.changed[arms],
            turned=self.turned[arms],
            angle=self.angle[arms],
            convergence=self.convergence[arms],
        )

    def ended(self, system: System | None) -> Iterate:
        """What has become of it, with the ``system`` of a balance."""
        return Iterate(
            self.state, self.iterations, self.corrected, system, self.moved, self.changed
        )


# What to do after an iteration: nothing, as there is no progress or it is balanced; another with
# the same system or a new one; the same anew, as what was known has left too much.
_STUCK, _BALANCED, _SAME_SYSTEM, _NEW_SYSTEM, _ANEW = range(5)


def newton(problem: Equilibrium, condition: Condition, shape: Shape, tolerance: float) -> Iterate:
    """`Newton` for ``problem``."""
    now = _begin(problem, condition, shape, None)
    most = _MOST_LINEAR if problem.loads.without_tangent else MOST
    if now.state.residual <= tolerance:
        return now.ended(now.last_system)
    while now.iterations < most:
        try:
            # Of wild shapes tendons in sheaths have no places.
            after = _iterate(problem, now)
        except ConvergenceError:
            return now.ended(None)
        residuals = float(now.state.residual), float(after.state.residual)
        verdict = _verdict(problem, now, *residuals, tolerance)
        now = _next(now, after, verdict)
        if verdict in (_STUCK, _BALANCED):
            return now.ended(now.last_system if verdict == _BALANCED else None)
    return now.ended(None)


def newton_of_all(
    problem: Equilibrium, condition: Condition, shape: Shape, tolerance: float,
    known: KnownBalance | None = None,
) -> list[tuple[IntArray, Iterate]]:  # fmt: skip
    """`newton` of several arms at once, in groups of those that go the same way.

    The system of a balance of ``shape`` that is ``known`` makes the first step, as long as that
    leaves a small part of the residual.

    Returns:
        Numbers of the arms of each group, and what became of them.
    """
    found = []
    tendons = None if known is None else known.tendons_under(condition)
    now = _begin(problem, condition, shape, known, tendons)
    # In the banded system of all arms NaN would spread to others.
    start = [
        _BALANCED if left <= tolerance else _SAME_SYSTEM if left == left else _STUCK
        for left in now.state.residual.tolist()
    ]
    groups = _groups(np.arange(len(start)), start, now, now)
    while groups:
        verdict, arms, now = groups.pop()
        system = now.last_system if verdict == _BALANCED else None
        if verdict not in (_STUCK, _BALANCED) and now.iterations < MOST:
            try:
                after = _iterate(problem, now, tolerance, tendons)
                residuals = zip(now.state.residual.tolist(), after.state.residual.tolist())
                verdicts = [
                    _verdict(problem, now, *both, tolerance, after.is_settled)
                    for both in residuals
                ]
                groups += _groups(arms, verdicts, now, after)
                continue
            except ConvergenceError:
                pass
        ended = now.ended(system)
        if tendons is not None:
            ended = ended._replace(tendons=tendons.after_turning(float(np.max(now.moved))))
        found.append((arms, ended))
    return found


def _begin(
    problem: Equilibrium, condition: Condition, shape: Shape, known: KnownBalance | None,
    tendons: SlidingTendons | None = None,
) -> _Progress:  # fmt: skip
    is_known = known is not None
    system = None if known is None else known.system
    state = None if known is None else known.under(condition, shape, tendons)
    if state is None:
        sliding = None if tendons is None else tendons.at(tendons.angle)
        state = problem.state(condition, shape, not is_known, sliding)
    nothing = np.zeros_like(state.residual)
    return _Progress(
        state, system, is_known, is_known, True, 0, nothing, nothing, state.residual, nothing,
        nothing, nothing,
    )  # fmt: skip


def _iterate(
    problem: Equilibrium, now: _Progress, enough: float = 0.0,
    tendons: SlidingTendons | None = None,
) -> _Progress:  # fmt: skip
    """After another step, that uses its system again.

    The residual that it leaves is estimated, not evaluated, where it is ``enough`` for all arms.
    Tensions along ``tendons`` with friction, if given, follow after the step.

    Raises:
        ConvergenceError: if there is none.
    """
    state, system, turned = now.state, now.system, now.turned
    if system is None or not now.again:
        system, turned = problem.linearised(state, near=now.last_system), 0.0
    sliding, is_settled, old = None, True, state.residual
    # Newton's method leaves about the square of a residual; what is not near is linearised.
    is_far = now.is_known or float(old.max()) ** 2 > NEAR
    if tendons is None:
        step = newton_step(problem, system, state)
    else:
        assert state.sliding is not None
        step, sliding, is_settled = tendons.after(
            state.sliding, state.shape.twist, system, state.imbalance, 1 if is_far else _MOST_SLID
        )
    turn = problem.turn(step)
    left = None
    if now.again and not now.is_known and is_settled:
        # The step before was made with the same system.
        left = SAFETY * old * np.maximum(now.convergence, turn / np.maximum(now.angle, TINY))
    if left is not None and ((left <= enough) & (turn <= _SMALL)).all():
        new = problem.last_state(state, step, left, sliding)
    else:
        new = problem.state(state.condition, problem.moved(state.shape, step), is_far, sliding)
    return _Progress(
        new, system, True, False, False, now.iterations + 1,
        now.corrected + (0.0 if now.is_first else turn), now.moved + turn, now.changed,
        turned + turn, turn, new.residual / old, is_settled,
    )  # fmt: skip


def _verdict(
    problem: Equilibrium, before: _Progress, old: float, new: float, tolerance: float,
    is_settled: bool = True,
) -> int:  # fmt: skip
    """What to do with an arm after a step that took its residual from ``old`` to ``new``.

    Where tensions along its tendons are not ``is_settled`` it is not balanced yet.
    """
    progress = _LINEAR_PROGRESS if problem.loads.without_tangent else PROGRESS
    if before.is_first:
        progress = PREDICTED if before.is_known else FIRST_PROGRESS
    if not new <= progress * old:  # nor where it is NaN
        return _ANEW if before.is_known else _STUCK
    if new <= tolerance:
        return _BALANCED if is_settled else _SAME_SYSTEM
    # A system known before makes one step.
    is_near = new <= NEAR and new <= QUICK * old and not before.is_known
    return _SAME_SYSTEM if is_near else _NEW_SYSTEM


def _next(before: _Progress, after: _Progress, verdict: int) -> _Progress:
    """Where to go on from."""
    if verdict in (_ANEW, _STUCK):
        return before._replace(system=None, is_known=False, iterations=after.iterations)
    return after if verdict == _SAME_SYSTEM else after._replace(again=False)


def _groups(
    arms: IntArray, verdicts: list[int], before: _Progress, after: _Progress
) -> list[tuple[int, IntArray, _Progress]]:
    """Verdicts on ``arms``, those of each, and their `_next`."""
    groups = []
    for verdict in set(verdicts):
        now, these = _next(before, after, verdict), arms
        if verdicts.count(verdict) < len(verdicts):
            chosen = np.array([number for number, one in enumerate(verdicts) if one == verdict])
            now, these = now.of(chosen), arms[chosen]
        groups.append((verdict, these, now))
    return groups
