"""Balance of an arm that tendons with friction alone load.

The unknowns are the angles that the tendons turn by since the base. Newton's method finds them in
few steps, by how they and the cross sections change together, see `coupling`.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from octo_arm_model.core.errors import ConvergenceError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.sliding.coupling import (
    EXACT,
    Coupling,
    change_of,
    couplings,
    next_angle,
    predicted_angle,
)
from octo_arm_model.core.loaded.sliding.friction import Friction, Sliding
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.section.newton import initial_strain, minimise
from octo_arm_model.core.section.strain_measures import check_fibres, to_scaled, to_twist

TOLERANCE = 1e-9  # of the tensions along tendons, relative
MOST = 100  # Newton steps
_SLOW = 3  # number of the step from a known balance at which the coupling is computed anew
CHANGED = 0.2  # relative change of tensions up to which a known balance predicts the next


class Sections(Protocol):
    """Twist of cross sections under given tensions along the tendons.

    Attributes:
        residual: relative residual of their equations after the last call [-], (batch,).
    """

    residual: FloatArray

    def begin(self, twist: FloatArray) -> None:
        """Begin the iteration of the next call at ``twist`` (n, batch, points)."""

    def __call__(self, local_tensions: FloatArray) -> FloatArray:
        """Twist (n, batch, points) under ``local_tensions`` (tendons, batch, points) [N].

        Raises:
            SolveError: if there is no balance.
        """


class Slid(NamedTuple):
    """A balance of arms under tendons with friction.

    Attributes:
        twist: of the cross sections, (n, batch, points).
        sliding: tensions along the tendons.
        angle: by which each tendon has turned since the base [rad], (tendons, batch, points).
        coupling: of its cross sections, approximately.
        steps: number of Newton steps.
    """

    twist: FloatArray
    sliding: Sliding
    angle: FloatArray
    coupling: Coupling
    steps: int

    def is_near(self, tensions: FloatArray) -> bool:
        """Whether its tensions at the base are within `CHANGED` of ``tensions`` (tendons,) [N].

        For a single arm.
        """
        at_base = self.sliding.tensions[:, 0, 0]
        return bool((np.abs(tensions - at_base) <= CHANGED * at_base).all())


def balance(
    friction: Friction, sections: Sections, tensions: FloatArray, before: FloatArray | None,
    known: Slid | None = None,
) -> Slid:  # fmt: skip
    """Balance of arms under ``tensions`` (batch, tendons) [N] at the base alone.

    ``before`` is as in `Friction.slide`. A ``known`` balance nearby, if given, predicts the angles
    to begin with. The angle by which a tendon has turned at a place depends on the arm up to there
    alone, as in any equation of Volterra, so that the iteration converges.

    Raises:
        ConvergenceError: if it does not converge.
    """
    now, last, left = known, 0.0, 0.0
    angle = np.zeros((friction.coefficient.size, len(tensions), friction.points))
    if known is not None:
        sliding = Sliding(*friction.tensions(tensions, before, known.angle))
        angle = predicted_angle(friction, known.sliding, known.angle, known.coupling, sliding)
        left = change_of(friction, known.angle, angle)
    for steps in range(1, MOST + 1):
        sliding = Sliding(*friction.tensions(tensions, before, angle))
        if now is not None:
            change = sliding.tensions - now.sliding.tensions
            sections.begin(now.twist + np.einsum('ikbn,kbn->ibn', now.coupling.by_pull, change))
        twist = sections(sliding.tensions)
        if now is not None and has_converged(left, last):
            return Slid(twist, sliding, angle, now.coupling, steps - 1)
        turning = friction.turning(twist, sliding.tensions)
        if now is None and steps == 1:
            # Exact for a curvature in proportion to the tension of a tendon that is drawn in.
            angle = np.log1p(friction.mu * turning.angle) / friction.mu
            continue
        if now is None or (known is not None and steps == _SLOW):
            coupling = couplings(friction.energy, twist, sliding.tensions, turning)
        else:
            coupling = now.coupling  # which hardly changes
        now = Slid(twist, sliding, angle, coupling, steps)
        angle = next_angle(friction, now.angle, turning.angle, coupling, sliding)
        last, left = left, change_of(friction, now.angle, angle)
    raise ConvergenceError('the tension along the tendons', left, MOST)


def has_converged(left: float, last: float) -> bool:
    """Whether the next change would be within `TOLERANCE`, after changes ``last`` and ``left``.

    It is taken to shrink by the same ratio again, but by no more than `EXACT`, the accuracy of a
    step. False for NaN.
    """
    if left <= TOLERANCE:
        return True
    return left < last and left * max(left / last, EXACT) <= TOLERANCE


class ExactSections:
    """`Sections` of least energy; each call begins at the result of the one before."""

    def __init__(self, energy: SectionEnergy) -> None:
        """Minimise the energies of ``energy``."""
        self._energy = energy
        self._strain: FloatArray | None = None
        self.residual: FloatArray = np.zeros(0)

    def begin(self, twist: FloatArray) -> None:
        """See `Sections`."""
        self._strain = to_scaled(self._energy.law, twist)

    def __call__(self, local_tensions: FloatArray) -> FloatArray:
        """See `Sections`."""
        start = self._strain
        if start is None:
            start = initial_strain(self._energy, local_tensions)
        found = minimise(self._energy, local_tensions, start)
        check_fibres(self._energy, found.strain)
        self._strain, self.residual = found.strain, found.residual
        return to_twist(self._energy.law, found.strain)
