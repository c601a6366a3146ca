"""Tendons with friction in the steps from a known balance of a loaded arm.

A step of Newton's method is made at constant tensions along the tendons. After it these follow
from the angles by which tendons turn in the new shape, as without loads, and the arm answers their
change. What that makes of the angles is left for the next step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.linearised import Response, System
from octo_arm_model.core.loaded.sliding.coupling import (
    Coupling,
    change_of,
    couplings,
    next_angle,
    predicted_angle,
)
from octo_arm_model.core.loaded.sliding.friction import Friction, Sliding
from octo_arm_model.core.loaded.sliding.sliding_balance import has_converged
from octo_arm_model.core.loaded.state import Condition
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.section.strain_measures import lengthening_by_twist, pull_by_twist

_SIMILAR = 0.3  # angle that an arm turns by for which couplings hardly change [rad]


class SlidingTendons(NamedTuple):
    """The tendons of one arm that are under tension.

    Attributes:
        friction: theirs.
        tensions: at the base, (1, tendons) [N].
        before: along them, from which they slide, (tendons, points) [N]; None for slack ones.
        angle: by which they have turned since the base, predicted from a balance nearby,
            (tendons, 1, points) [rad].
        coupling: of cross sections in a balance before.
        turned: how far the arm has turned since that [rad].
    """

    friction: Friction
    tensions: FloatArray
    before: FloatArray | None
    angle: FloatArray
    coupling: Coupling
    turned: float = 0.0

    @classmethod
    def near(
        cls, friction: Friction, condition: Condition, twist: FloatArray, sliding: Sliding,
        last: SlidingTendons | None,
    ) -> SlidingTendons:  # fmt: skip
        """Those of an arm of ``friction`` in a ``condition`` with an axis of it.

        Near a balance of ``twist`` (n, 1, points) in which they are ``sliding``, and were those of
        the ``last`` one, if that is known.
        """
        tensions, before = condition.tensions, condition.before
        some = friction.pulled(tensions)
        known = some.of_some(sliding)
        angle = known.angle
        if (
            last is not None and angle is not None and last.friction is some
            and last.turned <= _SIMILAR
        ):  # fmt: skip
            coupling, turned = last.coupling, last.turned
        else:
            turning = some.turning(twist, known.tensions)
            angle = turning.angle
            coupling, turned = couplings(some.energy, twist, known.tensions, turning), 0.0
        held = None if before is None else before[some.pull]
        pull = tensions[:, some.pull]
        now = Sliding(*some.tensions(pull, held, angle))
        angle = predicted_angle(some, known, angle, coupling, now)
        return cls(some, pull, held, angle, coupling, turned)

    def after_turning(self, angle: float) -> SlidingTendons:
        """The same where the arm has turned by another ``angle`` [rad]."""
        return self._replace(turned=self.turned + angle)

    def at(self, angle: FloatArray) -> Sliding:
        """All tendons of the arm, these turned by ``angle`` (tendons, 1, points) [rad]."""
        return self._of_all(*self.friction.tensions(self.tensions, self.before, angle), angle)

    def after(
        self, sliding: Sliding, twist: FloatArray, system: System, imbalance: FloatArray,
        most: int,
    ) -> tuple[Response, Sliding, bool]:  # fmt: skip
        """After a step that answers an ``imbalance`` at the tensions of ``sliding``.

        The answers are those of a ``system``. Tensions are changed at ``most`` so often, until
        they are those of the new shape. ``imbalance`` and the ``twist`` before are (n, 1, points),
        and tendons all those of the arm, see `at`.

        Returns:
            The step, the tendons after it, and whether their tensions are those of the new shape.
        """
        friction, some = self.friction, self.friction.of_some(sliding)
        tensions, slip, _, angle = some
        assert angle is not None
        step = system.solve(imbalance[:, np.newaxis])
        left, is_settled = np.inf, False
        for _ in range(most):
            there = twist + step.twist[:, 0]
            turned = friction.turning(there, tensions).angle
            new = next_angle(friction, angle, turned, self.coupling, Sliding(tensions, slip))
            before, last = tensions, left
            left, angle = change_of(friction, angle, new), new
            tensions, slip = friction.tensions(self.tensions, self.before, angle)
            less = _pulled(friction.energy, there, tensions, before - tensions)
            pulled = system.solve(less[:, np.newaxis])
            step = Response(step.twist + pulled.twist, step.turn + pulled.turn)
            is_settled = has_converged(left, last)
            if is_settled:
                break
        return step, self._of_all(tensions, slip, angle), is_settled

    def _of_all(self, tensions: FloatArray, slip: FloatArray, angle: FloatArray) -> Sliding:
        of_all = self.friction.of_all
        return Sliding(of_all(tensions), of_all(slip, -1.0), angle=of_all(angle))


def _pulled(
    energy: SectionEnergy, twist: FloatArray, local_tensions: FloatArray, change: FloatArray
) -> FloatArray:
    """How the gradient of the energy by the ``twist`` (n, 1, points) changes with the tensions.

    With a ``change`` of these, and tendons in sheaths where ``local_tensions`` displace them.
    """
    if energy.displaces_tendons:
        along = lengthening_by_twist(energy, twist, local_tensions)
        return np.einsum('ijbn,jbn->ibn', along, change)
    return pull_by_twist(energy, twist, change)
