"""Tendons under friction along an arm that they alone load, and small changes of both."""

from __future__ import annotations

from collections.abc import Callable
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
_SMALL = 1e-12  # what is left of a small change, in parts of it


class Sections(Protocol):
    """How cross sections answer tensions along the tendons.

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


def tension_changes(
    friction: Friction,
    sliding: Sliding,
    twist: FloatArray,
    respond: Callable[[FloatArray], FloatArray],
    direct: FloatArray,
) -> FloatArray:
    """Small changes of the tensions at the points [N], (tendons, columns, points).

    Of the one arm ``sliding`` with ``twist`` (n, points). ``direct`` is how they change while the
    shape does not, and ``respond`` gives the change (n, columns, points) of the twist with that of
    the tensions.

    Raises:
        ConvergenceError: if they are not found.
    """
    count, columns, points = direct.shape
    scale = np.abs(direct).max(axis=(0, 2), keepdims=True)
    scale = np.where(scale > 0.0, scale, 1.0)

    def step(rows: FloatArray) -> FloatArray:
        change = rows.reshape(columns, count, points).swapaxes(0, 1)
        moved = by_twist(friction, sliding, twist, respond(change))
        return (direct / scale + moved).swapaxes(0, 1).reshape(columns, -1)

    start = (direct / scale).swapaxes(0, 1).reshape(columns, -1)
    found, _ = fixed_point(step, start, _SMALL, _MOST, "the change of the tendons' tensions")
    return found.reshape(columns, count, points).swapaxes(0, 1) * scale


def by_twist(
    friction: Friction, sliding: Sliding, twist: FloatArray, change: FloatArray
) -> FloatArray:
    """Change of the tensions with a ``change`` (n, columns, points) of the ``twist``."""
    return friction.by_angle(sliding, friction.angle_by_twist(sliding.turning, twist, change))
