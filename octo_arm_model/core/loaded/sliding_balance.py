"""Balance of an arm that tendons with friction alone load."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from octo_arm_model.core.errors import ConvergenceError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.friction import Friction, Sliding
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.section.newton import initial_strain, minimise
from octo_arm_model.core.section.strain_measures import check_fibres, to_twist

TOLERANCE = 1e-9  # of the angles by which tendons turn [rad]
MOST = 100  # steps


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
    How far a tendon has turned at a place depends on the arm up to there alone, so that the
    iteration converges (it is one of Volterra's equations).

    Raises:
        ConvergenceError: if it does not.
    """
    angle = np.zeros((friction.coefficient.size, len(tensions), friction.points))
    left = 0.0
    for iteration in range(1, MOST + 1):
        local_tensions, slip = friction.tensions(tensions, before, angle)
        twist = sections(local_tensions)
        turning = friction.turning(twist, local_tensions)
        if iteration == 1:
            angle = friction.first_angle(turning)
            continue
        new = friction.next_angle(angle, slip, turning)
        last, left = left, float(np.abs(new - angle).max(initial=0.0))
        angle = new
        if has_converged(left, last):
            local_tensions, slip = friction.tensions(tensions, before, angle)
            return sections(local_tensions), Sliding(local_tensions, slip, turning), iteration
    raise ConvergenceError('the tension along the tendons', left, MOST)


def has_converged(left: float, last: float) -> bool:
    """Whether a next step would leave nothing, which makes this part of the one before, or less.

    False for NaN.
    """
    return left <= TOLERANCE or (left * left <= TOLERANCE * last and left < last)


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
