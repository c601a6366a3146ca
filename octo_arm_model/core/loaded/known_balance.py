"""A balance of one arm that others near it are found from."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.hints import FloatArray, Number
from octo_arm_model.core.loaded.equilibrium import Equilibrium
from octo_arm_model.core.loaded.linearised import Linearised
from octo_arm_model.core.loaded.stability import SAME, SAME_LOADS
from octo_arm_model.core.loaded.state import Condition, State, in_sections, relative
from octo_arm_model.core.rod.solution import Shape
from octo_arm_model.core.section.strain_measures import pull_by_twist


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
    """A balance of one arm under dead loads, without friction.

    Attributes:
        system: linearised about nearly it.
        margin: of its stability.
    """

    def __init__(
        self, problem: Equilibrium, state: State, system: Linearised, margin: Margin
    ) -> None:
        """Of ``state``, with or without an axis of the one arm."""
        self._problem, self._state = problem, state
        self.system, self.margin = system, margin

    def under(self, condition: Condition, shape: Shape) -> State | None:
        """The state of its ``shape``, of each of several arms, under other tensions.

        None where the ``condition`` has other loads too, or tensions displace the tendons, so that
        these do not pull in proportion to them.
        """
        problem, state = self._problem, self._state
        before, tensions = state.condition, condition.tensions
        if problem.energy.displaces_tendons or problem.loads.scaled is not None:
            return None
        wrench = before.tip_wrench.ravel().tolist()
        if condition.factor != before.factor or any(
            one != wrench for one in condition.tip_wrench.tolist()
        ):
            return None
        energy, more = problem.energy.pulled(tensions - before.tensions.ravel())
        imbalance = -pull_by_twist(energy, shape.twist, more)
        # With an axis of arms.
        points = shape.twist.shape[-1]
        rotation = state.rotation.reshape(3, 3, 1, points)
        tangent = state.tangent.reshape(3, 1, points)
        both = np.array([state.moment, state.force]).reshape(2, 3, 1, points)
        loads = in_sections(rotation, both)[: len(imbalance)]
        residual = state.residual + relative(imbalance, problem.pulled(tensions).scale, loads)
        if (arms := len(tensions)) > 1:
            rotation, tangent, both = (x.repeat(arms, axis=-2) for x in (rotation, tangent, both))
        return State(condition, shape, rotation, tangent, both[0], both[1], imbalance, residual)

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
