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

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.errors import ConfigError, SolveError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.collocation import Collocation
from octo_arm_model.core.numerics.vectors import cross
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.section.tendon_tangents import (
    Tangents,
    curvature,
    direction_by_twist,
    kink_angle,
    tangents,
)

_STRAIGHT = 1e-9  # angle over the length of the arm below which a tendon counts as straight [rad]
_NONE = 1e-30  # coefficient of friction that is none
SAME = 1e-8  # part by which tensions of one tendon may differ by rounding


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
        turning: how it turns.
    """

    tensions: FloatArray
    slip: FloatArray
    turning: Turning

    @property
    def sticks(self) -> bool:
        """Whether any tendon sticks anywhere."""
        return bool((self.slip == 0.0).any())


class Friction:
    """Friction of the tendons of one arm at collocation points.

    Attributes:
        coefficient: mu of every tendon [-], (tendons,).
        points: how many points there are.
    """

    def __init__(self, arm: Arm, energy: SectionEnergy, collocation: Collocation) -> None:
        """Prepare for ``arm`` and its ``energy`` at the points of ``collocation``.

        Raises:
            ConfigError: if tendons dig into the body as well, which changes how they turn.
        """
        if arm.sheath_stiffness:
            raise ConfigError(
                'tendons.friction and tendons.sheath_stiffness do not go together: how tendons '
                'turn is known of those that keep their places'
            )
        self.coefficient, self.points = np.array(arm.friction), collocation.s.size
        self._names = arm.tendon_names
        # That of the smallest number is as none, and can be divided by.
        self._mu = np.maximum(self.coefficient, _NONE)[:, np.newaxis, np.newaxis]
        self._energy, self._collocation = energy, collocation
        rule = collocation.rule
        self._ends = rule.interpolate(np.array([0.0, 1.0]))
        self._differentiate = rule.differentiation

    def turning(self, twist: FloatArray) -> Turning:
        """How tendons turn under ``twist`` (4 or 6, batch, points)."""
        found = tangents(self._energy, twist)
        slope, kinks = self._slope(found.unit)
        bent = np.stack(curvature(*twist[:3], *found.unit, *slope))
        rate = _length(bent)
        angle = self._angle(rate, kink_angle(*kinks))
        return Turning(angle, rate, bent, kinks, found)

    def slide(self, tensions: FloatArray, before: FloatArray | None, turning: Turning) -> Sliding:
        """Tendons of ``tensions`` (batch, tendons) [N] at the base.

        ``before`` are their tensions at the points, (tendons, points) [N]; None for slack ones.
        """
        return Sliding(*self.tensions(tensions, before, turning.angle), turning)

    def tensions(
        self, tensions: FloatArray, before: FloatArray | None, angle: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Tensions at the points, and which way tendons slip, for angles they turn by."""
        at_base = self._energy.local_tensions(tensions)
        kept = np.exp(-self._mu * angle)
        low = at_base * kept
        if before is None:
            return low, np.full(low.shape, -1.0)
        high = at_base / kept
        held = before[:, np.newaxis]
        slip = np.where(held >= high * (1.0 - SAME), 1.0, 0.0)
        slip[held <= low * (1.0 + SAME)] = -1.0
        return np.clip(held, low, high), slip

    def first_angle(self, turning: Turning) -> FloatArray:
        """What the angles nearly are that tendons turn by, had they no friction in ``turning``.

        Exact for a curvature in proportion to the tension of a tendon that is drawn in.
        """
        return np.log1p(self._mu * turning.angle) / self._mu

    def next_angle(self, angle: FloatArray, slip: FloatArray, turning: Turning) -> FloatArray:
        """Nearer angles than ``angle``, with which tendons slip and turn.

        Newton's method for theta' = c where a tendon bends the arm by itself, c in proportion to
        its tension: dc = sigma mu c dtheta, for sigma of -1, 1, or 0 where it sticks. Angles that
        stay are right whatever c depends on.
        """
        left = turning.angle - angle
        # The integrating factor, where a tendon slips as at its base.
        grows = np.exp(self._mu * slip[..., :1] * angle)
        moved = self._collocation.integrate_from_base(slip * turning.rate * left / grows)
        return np.asarray(np.maximum(turning.angle + self._mu * grows * moved, 0.0))

    def angle_by_twist(
        self, turning: Turning, twist: FloatArray, change: FloatArray
    ) -> FloatArray:
        """Change of the angles (tendons, columns, points) with one ``twist`` (n, points).

        ``change`` is (n, columns, points).
        """
        twist = twist[:, np.newaxis]
        unit = turning.tangents.unit
        bent = cross(change[:3, np.newaxis], unit)
        return self.angle_by_direction(
            turning, twist, direction_by_twist(self._energy, twist, change), bent
        )

    def angle_by_direction(
        self, turning: Turning, twist: FloatArray, change: FloatArray, bent: FloatArray | float
    ) -> FloatArray:
        """Change of the angles with that of the tendons' directions u and curvatures ``bent``."""
        moved = turning.tangents.turned(change)
        slope, kinks = self._slope(moved)
        bends = np.stack(curvature(*twist[:3], *moved, *slope)) + bent
        along = np.einsum('i...,i...->...', turning.curvature, bends)
        size = np.broadcast_to(turning.rate, along.shape)
        rate = np.divide(along, size, out=np.zeros_like(along), where=size > 0.0)
        half = np.minimum(0.5 * _length(turning.kinks), 1.0)
        jump = np.einsum('i...,i...->...', turning.kinks, kinks)
        scale = 2.0 * half * np.sqrt(1.0 - half * half)
        jump = np.divide(jump, scale, out=np.zeros_like(jump), where=scale > 0.0)
        return self._angle(rate, jump)

    def by_base_tension(self, sliding: Sliding) -> FloatArray:
        """Change of each tendon's tension with that at its base, (tendons, points) [-].

        Of one arm whose shape stays as it is.
        """
        ones = self._energy.local_tensions(np.ones((1, self.coefficient.size)))
        kept = ones * np.exp(sliding.slip * self._mu * sliding.turning.angle)
        return np.asarray(kept[:, 0])

    def by_coefficient(self, sliding: Sliding) -> FloatArray:
        """Change of each tendon's tension with its mu, likewise [N]."""
        return np.asarray((sliding.slip * sliding.turning.angle * sliding.tensions)[:, 0])

    def by_angle(self, sliding: Sliding, angle: FloatArray) -> FloatArray:
        """Change of the tensions with one of the angle (tendons, columns, points) [N]."""
        return np.asarray(sliding.slip * self._mu * sliding.tensions * angle)

    def require_derivatives(self, tensions: FloatArray, sliding: Sliding) -> None:
        """Refuse derivatives where there are none.

        Raises:
            SolveError: if a tendon under tension sticks anywhere, or is so straight that turning
                it either way makes it lose tension.
        """
        pulled = (sliding.tensions[:, 0] > 0.0) & (self.coefficient[:, np.newaxis] > 0.0)
        slip = np.where(pulled, sliding.slip[:, 0], -1.0)
        for what, bad in (
            ('sticks', slip == 0.0),
            ('slips both ways', pulled & (slip != slip[:, :1])),
            ('is straight', pulled & (sliding.turning.rate[:, 0] <= self._straight)),
        ):
            if bad.any():
                tendon, point = np.unravel_index(int(np.argmax(bad)), bad.shape)
                raise SolveError(
                    f'no derivatives: with friction, {self._names[tendon]} of '
                    f'{tensions[tendon]:.4g} N {what} at s = {self._collocation.s[point]:.4g} m, '
                    'expected one that slides and turns all along'
                )

    @property
    def _straight(self) -> float:
        return _STRAIGHT / self._collocation.length

    def _slope(self, unit: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivative by s of vectors in the axes of cross sections, and jumps between elements."""
        own = self._collocation
        by_element = own.by_element(unit)
        slope = (by_element @ self._differentiate.T) / own.step[:, np.newaxis]
        ends = by_element @ self._ends.T
        return slope.reshape(unit.shape), ends[..., 1:, 0] - ends[..., :-1, 1]

    def _angle(self, rate: FloatArray, kinks: FloatArray) -> FloatArray:
        """Integral from the base of ``rate`` (..., points), and all ``kinks`` passed."""
        own = self._collocation
        angle = own.integrate_from_base(rate)
        own.by_element(angle)[..., 1:, :] += np.add.accumulate(kinks, axis=-1)[..., np.newaxis]
        return angle


def _length(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.einsum('i...,i...->...', vectors, vectors)))
