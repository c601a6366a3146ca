"""A balance of one arm that others near it are found from."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.hints import FloatArray, Number
from octo_arm_model.core.loaded.equilibrium import Equilibrium
from octo_arm_model.core.loaded.linearised import Linearised
from octo_arm_model.core.loaded.sliding.sliding_tendons import SlidingTendons
from octo_arm_model.core.loaded.stability import SAME, SAME_LOADS
from octo_arm_model.core.loaded.state import Condition, State, in_sections, relative
from octo_arm_model.core.rod.solution import Shape
from octo_arm_model.core.section.strain_measures import gradient_by_twist, pull_by_twist


class Margin(NamedTuple):
    """By how much an arm at a minimum of its energy may change and stay at one for certain.

    Attributes:
        tip_wrench: on the tip where its stability was tested, (6,) [N, N m].
        angle: by which it may turn [rad]; 0 where its stability has no margin.
        change: likewise of tensions and loads, as a residual.
    """

    tip_wrench: FloatArray
    angle: float = 0.0
    change: float = 0.0


def margin_under(tip_wrench: FloatArray, *, is_firm: bool) -> Margin:
    """That of a balance just tested under a ``tip_wrench``, which ``is_firm`` or not."""
    return Margin(tip_wrench, SAME, SAME_LOADS) if is_firm else Margin(tip_wrench)


class KnownBalance:
    """A balance of one arm under dead loads.

    Attributes:
        system: linearised about nearly it.
        margin: of its stability.
        tendons: its tendons with friction, where they are known.
    """

    def __init__(
        self, problem: Equilibrium, state: State, system: Linearised, margin: Margin,
        tendons: SlidingTendons | None = None,
    ) -> None:  # fmt: skip
        """Of ``state``, with or without an axis of the one arm."""
        self._problem, self._state = problem, state
        self.system, self.margin, self.tendons = system, margin, tendons

    def tendons_under(self, condition: Condition) -> SlidingTendons | None:
        """Its tendons in another ``condition`` of the one arm; None of those without friction."""
        friction, state = self._problem.friction, self._state
        if friction is None or state.sliding is None:
            return None
        twist = state.shape.twist.reshape(len(state.imbalance), 1, -1)
        return SlidingTendons.near(friction, condition, twist, state.sliding, self.tendons)

    def under(
        self, condition: Condition, shape: Shape, tendons: SlidingTendons | None = None
    ) -> State | None:
        """The state of its ``shape``, of each of several arms, under other tensions.

        Where its ``tendons`` have friction they have turned as predicted. None where the
        ``condition`` has other loads too.
        """
        problem, state = self._problem, self._state
        before, tensions = state.condition, condition.tensions
        wrench = before.tip_wrench.ravel().tolist()
        if (
            problem.loads.scaled is not None or condition.factor != before.factor
            or any(one != wrench for one in condition.tip_wrench.tolist())
        ):  # fmt: skip
            return None
        sliding, either = None, tensions
        if tendons is not None:
            # Those that were pulled, too.
            sliding = tendons.at(tendons.angle)
            either = np.concatenate([tensions, before.tensions.reshape(1, -1)])
        energy, pull, scale = problem.pulled(either, sliding)
        # With an axis of arms.
        twist, points = shape.twist, shape.twist.shape[-1]
        rotation = state.rotation.reshape(3, 3, 1, points)
        tangent = state.tangent.reshape(3, 1, points)
        wrenches = np.array([state.moment, state.force]).reshape(2, 3, 1, points)
        loads = in_sections(rotation, wrenches)[: len(twist)]
        if energy.displaces_tendons:
            imbalance = loads - gradient_by_twist(energy, twist, pull)
            residual = relative(imbalance, scale, loads)
        else:
            # Tendons that stay on their paths pull in proportion to their tensions.
            if state.sliding is None:
                energy, more = problem.energy.pulled(tensions - before.tensions.ravel())
            else:
                more = pull - state.sliding.tensions[either.any(axis=0)]
            imbalance = -pull_by_twist(energy, twist, more)
            residual = state.residual + relative(imbalance, scale, loads)
        if (arms := len(tensions)) > 1:
            rotation, tangent, wrenches = (
                x.repeat(arms, axis=-2) for x in (rotation, tangent, wrenches)
            )
        return State(
            condition, shape, rotation, tangent, wrenches[0], wrenches[1], imbalance, residual,
            sliding,
        )  # fmt: skip

    def margin_left(self, state: State, moved: Number, changed: Number) -> Margin | None:
        """What is left of the margin in the balances ``state`` of arms led from this one.

        They have ``moved`` [rad], and their tensions and loads have ``changed``. None where that
        is nothing.
        """
        margin, problem, condition = self.margin, self._problem, state.condition
        angle, change = margin.angle - moved, margin.change - changed
        if not (angle.min() > 0.0 and change.min() > 0.0):
            return None
        for tensions, wrench in zip(condition.tensions, condition.tip_wrench, strict=True):
            loads = problem.load_change(margin.tip_wrench, tensions, wrench)
            if loads > SAME_LOADS or not problem.loads.has_energy(wrench):
                return None
        return margin._replace(angle=float(angle[0]), change=float(change[0]))
