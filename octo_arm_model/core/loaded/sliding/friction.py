"""Capstan friction: the tension of a tendon at every cross section.

A tendon that slides loses tension with the angle by which it turns, dT = -mu T dtheta, where it
is drawn in, and gains it where it is let out; in between it sticks (Euler and Eytelwein). theta
is the angle that its unit tangent e has turned in space since the base,

    theta(s) = int_0^s |e' + kappa x e| ds + kinks    (in the axes of the cross section),

and a kink is where e jumps, at an anchorage say. With the tension T_0 at the base and the tension
``before`` at each place, the tension is the nearest to ``before`` that friction holds,

    T = clip(before, T_0 exp(-mu theta), T_0 exp(mu theta)).

It is the play operator of hysteresis, and from slack, before = 0, the monotone pull.
"""

from __future__ import annotations

import copy
import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.errors import ConvergenceError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.collocation import Collocation
from octo_arm_model.core.numerics.vectors import cross
from octo_arm_model.core.section.energy import MOST_PULLED, SectionEnergy
from octo_arm_model.core.section.strain_measures import to_scaled
from octo_arm_model.core.section.tendons.tendon_tangents import (
    Tangents,
    kink_angle,
    tangents,
)

NO_FRICTION = 1e-30  # coefficient of friction that is none
# Tolerance of the angles by which tendons in sheaths turn [rad], and most iterations for them.
_PLACED, _MOST_PLACED = 1e-13, 50
SAME = 1e-8  # relative difference up to which two tensions of a tendon count as equal


class Turning(NamedTuple):
    """How tendons turn in space; arrays over tendons are (tendons, batch, points).

    Attributes:
        angle: by which each has turned since the base [rad].
        rate: derivative of ``angle`` [rad/m], without kinks.
        curvature: derivative of its unit tangent in the axes of the cross section [1/m], (3, ...).
        kinks: jumps of the unit tangent between elements, (3, tendons, batch, elements - 1).
        tangents: the unit tangents.
    """

    angle: FloatArray
    rate: FloatArray
    curvature: FloatArray
    kinks: FloatArray
    tangents: Tangents


class Sliding(NamedTuple):
    """Tendons under friction; arrays are (tendons, batch, points).

    Attributes:
        tensions: of every tendon [N].
        slip: -1 where it is drawn in, 1 where it is let out and 0 where it sticks.
        turning: how it turns; None where the others were found without.
        angle: by which it has turned since the base [rad], where that is known apart from this.
    """

    tensions: FloatArray
    slip: FloatArray
    turning: Turning | None = None
    angle: FloatArray | None = None

    @property
    def sticks(self) -> bool:
        """Whether any tendon sticks anywhere."""
        return bool((self.slip == 0.0).any())


class Friction:
    """Friction of the tendons of one arm at collocation points.

    Attributes:
        coefficient: mu of every tendon [-], (tendons,).
        mu: the coefficients with `NO_FRICTION` in place of zero, (tendons, 1, 1).
        points: how many points there are.
        energy: of the cross sections at the points.
        collocation: the points.
        names: of the tendons.
        pull: which tendons of the arm these are, (tendons of the arm,).
    """

    def __init__(self, arm: Arm, energy: SectionEnergy, collocation: Collocation) -> None:
        """Prepare for ``arm`` and its ``energy`` at the points of ``collocation``."""
        self.coefficient, self.points = np.array(arm.friction), collocation.s.size
        self.names, self._gives_way = arm.tendon_names, bool(arm.sheath_stiffness)
        # So small a coefficient has no effect, and can be divided by.
        self.mu = np.maximum(self.coefficient, NO_FRICTION)[:, np.newaxis, np.newaxis]
        self.energy, self.collocation = energy, collocation
        rule = collocation.rule
        self._ends = rule.interpolate(np.array([0.0, 1.0])).T.copy()
        self._differentiate = rule.differentiation.T.copy()
        self.pull: NDArray[np.bool_] = np.ones(self.coefficient.size, np.bool_)
        self._pulled: dict[bytes, Friction] = {}

    def pulled(self, tensions: FloatArray) -> Friction:
        """The friction of those tendons alone that are under tension in any arm.

        ``tensions`` (batch, tendons) [N] are those at the base.
        """
        pull: NDArray[np.bool_] = np.asarray(tensions.any(axis=0))
        key = pull.tobytes()
        some = self._pulled.get(key)
        if some is None:
            some = copy.copy(self)
            some.coefficient, some.mu, some.pull = self.coefficient[pull], self.mu[pull], pull
            some.names = tuple(itertools.compress(self.names, pull))
            some.energy = self.energy.pulled(tensions)[0]
            if len(self._pulled) >= MOST_PULLED:
                self._pulled.clear()
            self._pulled[key] = some
        return some

    def of_all(self, values: FloatArray, others: float = 0.0) -> FloatArray:
        """``values`` (tendons, ...) of these and that of the ``others``, of all of the arm."""
        along = np.full((self.pull.size, *values.shape[1:]), others)
        along[self.pull] = values
        return along

    def of_some(self, sliding: Sliding) -> Sliding:
        """These tendons of those of the arm, but for how they turn."""
        tensions, slip, _, angle = sliding
        pull = self.pull
        return Sliding(tensions[pull], slip[pull], angle=None if angle is None else angle[pull])

    def turning(self, twist: FloatArray, local_tensions: FloatArray) -> Turning:
        """How the tendons turn in arms of the ``twist`` (4 or 6, batch, points).

        Their ``local_tensions`` (tendons, batch, points) [N] matter in compliant sheaths only.
        """
        placed = self.energy
        if self._gives_way:
            placed = placed.placed(to_scaled(placed.law, twist), local_tensions)
        found = tangents(placed, twist)
        bent, kinks = self.derivative(twist, found.unit)
        rate = length_of(bent)
        angle = self.integrate(rate, kink_angle(*kinks))
        return Turning(angle, rate, bent, kinks, found)

    def slide(self, tensions: FloatArray, before: FloatArray | None, turning: Turning) -> Sliding:
        """Tendons that turn as in ``turning`` under ``tensions`` (batch, tendons) [N] at the base.

        They slide from tensions ``before`` (tendons, points) [N]; None for slack ones.
        """
        return Sliding(*self.tensions(tensions, before, turning.angle), turning)

    def slide_along(
        self, twist: FloatArray, tensions: FloatArray, before: FloatArray | None
    ) -> Sliding:
        """Tendons along arms of the ``twist`` (4 or 6, batch, points), with arguments of `slide`.

        In compliant sheaths the angles by which tendons turn depend on the tensions, so that both
        are iterated.

        Raises:
            ConvergenceError: if the iteration does not converge.
        """
        local_tensions, left = self.energy.local_tensions(tensions), 0.0
        turning = self.turning(twist, local_tensions)
        for _ in range(_MOST_PLACED):
            sliding = self.slide(tensions, before, turning)
            if not self._gives_way:
                return sliding
            angle, turning = turning.angle, self.turning(twist, sliding.tensions)
            left = float(np.abs(turning.angle - angle).max(initial=0.0))
            if not left > _PLACED:  # nor NaN, where a section cannot be
                return sliding._replace(turning=turning)
        raise ConvergenceError('the tension of tendons in their sheaths', left, _MOST_PLACED)

    def tensions(
        self, tensions: FloatArray, before: FloatArray | None, angle: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Tensions and slip at the points, see `Sliding`, for the ``angle`` of tendons [rad].

        ``tensions`` (batch, tendons) and ``before`` (tendons, points) [N] are those of `slide`,
        ``angle`` is (tendons, batch, points).
        """
        at_base = self.energy.local_tensions(tensions)
        kept = np.exp(-self.mu * angle)
        low = at_base * kept
        if before is None:
            return low, np.full(low.shape, -1.0)
        high = at_base / kept
        held = before[:, np.newaxis]
        slip = (held >= high * (1.0 - SAME)).astype(np.float64)
        np.copyto(slip, -1.0, where=held <= low * (1.0 + SAME))
        return np.minimum(np.maximum(held, low), high), slip

    def derivative(self, twist: FloatArray, unit: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivative by s [1/m] of vectors ``unit`` (3, tendons, batch, points), and their jumps.

        Both are in the axes of the cross sections, which turn by the ``twist`` (n, batch, points).

        Returns:
            (3, tendons, batch, points), and the jumps between elements, (3, tendons, batch,
            elements - 1).
        """
        own = self.collocation
        by_element = own.by_element(unit)
        slope = by_element @ self._differentiate
        slope /= own.step[:, np.newaxis]
        ends = by_element @ self._ends
        derivative = cross(twist[:3, np.newaxis], unit)
        derivative += slope.reshape(unit.shape)
        return derivative, ends[..., 1:, 0] - ends[..., :-1, 1]

    def integrate(self, rate: FloatArray, kinks: FloatArray) -> FloatArray:
        """Integral of ``rate`` (..., points) from the base to each point, with kinks.

        ``kinks`` (..., elements - 1) are added beyond the border of elements where they are.
        """
        own = self.collocation
        angle = own.integrate_from_base(rate)
        own.by_element(angle)[..., 1:, :] += np.add.accumulate(kinks, axis=-1)[..., np.newaxis]
        return angle


def length_of(vectors: FloatArray) -> FloatArray:
    """Lengths (...) of ``vectors`` (3, ...)."""
    return np.asarray(np.sqrt(np.add.reduce(vectors * vectors)))
