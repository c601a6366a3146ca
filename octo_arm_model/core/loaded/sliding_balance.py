"""Balance of an arm that tendons with friction alone load."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.friction import Friction, Sliding
from octo_arm_model.core.numerics.fixed_point import fixed_point
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.section.newton import initial_strain, minimise
from octo_arm_model.core.section.strain_measures import check_fibres, to_twist

TOLERANCE = 1e-11  # of the angles by which tendons turn
_MOST = 100  # steps


class Sections(Protocol):
    """Twist of cross sections under given tensions along the tendons.

    Attributes:
        residual: what is left of their equations after the last call, relative, (batch,).
    """

    residual: FloatArray

    def __call__(self, local_tensions: FloatArray) -> FloatArray:
        """Twist (n, batch, points) under ``local_tensions`` (tendons, batch, points) [N].

        Raises:
            SolveError: if there is no balance.
        """


def balance(
    friction: Friction,
    sections: Sections,
    tensions: FloatArray,
    before: FloatArray | None,
) -> tuple[FloatArray, Sliding, int]:
    """Twist (n, batch, points), the tendons along it, and the steps that took.

    ``tensions`` (batch, tendons) [N] are those at the base, ``before`` is as in `Friction.slide`.
    How far a tendon has turned at a place depends on the arm up to there alone, so that fixed
    point iteration converges (it is one of Volterra's equations).

    Raises:
        ConvergenceError: if it does not.
    """
    count = len(tensions)
    shape = (friction.coefficient.size, count, -1)

    def angles(given: FloatArray) -> FloatArray:
        # Mixing may leave an angle below zero by a little.
        angle = np.maximum(given, 0.0).reshape(count, shape[0], -1).swapaxes(0, 1)
        twist = sections(friction.tensions(tensions, before, angle)[0])
        return friction.turning(twist).angle.swapaxes(0, 1).reshape(count, -1)

    start = np.zeros((count, friction.coefficient.size * friction.points))
    found, iterations = fixed_point(
        angles, start, TOLERANCE, _MOST, 'the tension along the tendons'
    )
    angle = found.reshape(count, shape[0], -1).swapaxes(0, 1)
    twist = sections(friction.tensions(tensions, before, angle)[0])
    return twist, friction.slide(tensions, before, friction.turning(twist)), iterations


class ExactSections:
    """`Sections` of least energy, found from those of the call before."""

    def __init__(self, energy: SectionEnergy) -> None:
        """Begin without a call before."""
        self._energy = energy
        self._strain: FloatArray | None = None
        self.residual: FloatArray = np.zeros(0)

    def __call__(self, local_tensions: FloatArray) -> FloatArray:
        """See `Sections`."""
        start = self._strain
        if start is None:
            start = initial_strain(self._energy, local_tensions)
        found = minimise(self._energy, local_tensions, start)
        check_fibres(self._energy, found.strain)
        self._strain, self.residual = found.strain, found.residual
        return to_twist(self._energy.law, found.strain)
