"""Small changes of the tensions along the tendons of one arm with friction.

A tension that slips is T = T_0 exp(-+ mu theta), so that dT / T = dT_0 / T_0 -+ d(mu theta), and
one that sticks stays. theta changes with the directions u of a tendon, which follow from the twist
of the cross sections and, in a sheath that gives way, from where the tendon stands in it.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.errors import SolveError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.sliding.friction import Friction, Sliding, length_of
from octo_arm_model.core.numerics.vectors import cross
from octo_arm_model.core.section.condensed import Condensed
from octo_arm_model.core.section.formulas import offset_direction
from octo_arm_model.core.section.parameter_derivatives import ParameterDerivatives
from octo_arm_model.core.section.strain_measures import scaled_change, to_scaled
from octo_arm_model.core.section.tendons.tendon_tangents import direction_by_twist

_STRAIGHT = 1e-9  # angle over the length of the arm below which a tendon counts as straight [rad]


class FrictionChanges:
    """Changes of the tensions at the points [N], (tendons, columns, points).

    To first order, while tendons slip and stick in the same places as before.

    Attributes:
        tensions: the tensions before the change [N], (tendons, 1, points).
    """

    def __init__(self, friction: Friction, sliding: Sliding, twist: FloatArray) -> None:
        """Linearise about tendons that are ``sliding`` along one arm of ``twist`` (n, points)."""
        self._friction, self._slip = friction, sliding.slip
        self.tensions = sliding.tensions
        self._twist, energy = twist[:, np.newaxis], friction.energy
        self._turning = sliding.turning or friction.turning(self._twist, sliding.tensions)
        self._strain = to_scaled(energy.law, self._twist)
        self._condensed: Condensed | None = energy.condensed(self._strain, sliding.tensions)
        self._sections = energy if self._condensed is None else self._condensed.sections

    def by_twist(self, change: FloatArray) -> FloatArray:
        """Change of the tensions by a ``change`` (n, columns, points) of the twist."""
        direction = direction_by_twist(self._sections, self._twist, change)
        found = self._condensed
        if found is not None:
            scaled = scaled_change(self._friction.energy, self._twist, change)
            direction += self._by_pull(
                found, np.einsum('aijn,icn->ajcn', found.mixed[..., 0, :], scaled)
            )
        turned = cross(change[:3, np.newaxis], self._turning.tangents.unit)
        return self._by_direction(direction, turned)

    def by_tension(self, change: FloatArray) -> FloatArray | float:
        """Change of the tensions by a ``change`` (tendons, columns, points) of the tensions [N].

        Tension displaces tendons in compliant sheaths, which changes the angles they turn by.
        Zero in rigid sheaths.
        """
        found = self._condensed
        if found is None:
            return 0.0
        return self._by_direction(self._by_pull(found, found.pull * change))

    def by_base_tension(self) -> FloatArray:
        """Derivative by each tendon's own tension at the base [-], (tendons, points)."""
        count = self._friction.coefficient.size
        slips = self._friction.energy.local_tensions(np.ones((1, count))) * (self._slip != 0.0)
        angle = self._turning.angle
        return np.asarray((slips * np.exp(self._slip * self._friction.mu * angle))[:, 0])

    def by_coefficient(self) -> FloatArray:
        """Derivative by each tendon's own mu [N], (tendons, points)."""
        return np.asarray((self._slip * self._turning.angle * self.tensions)[:, 0])

    def by_offset(self, parameters: ParameterDerivatives) -> FloatArray:
        """Derivative by each tendon's own distance from the midline [N/m], (tendons, points)."""
        direction, found = parameters.direction_by_offset(self._strain), self._condensed
        if found is not None:
            direction = direction + self._by_pull(found, found.by_path(direction))
        return self._by_direction(direction)[:, 0]

    def by_sheath_stiffness(self) -> FloatArray:
        """Derivative by each tendon's own sheath stiffness [N/Pa], (tendons, points).

        (0, points) where all sheaths are rigid.
        """
        found = self._condensed
        if found is None:
            return np.zeros((0, self._twist.shape[2]))
        return self._by_direction(self._by_pull(found, found.offset))[:, 0]

    def require_derivatives(self, tensions: FloatArray) -> None:
        """Refuse derivatives where the tensions have none.

        ``tensions`` (tendons,) [N] are those at the base, for the message.

        Raises:
            SolveError: if a tendon under tension sticks anywhere, or is so straight that turning
                it either way makes it lose tension.
        """
        friction, own = self._friction, self._friction.collocation
        pulled = (self.tensions[:, 0] > 0.0) & (friction.coefficient[:, np.newaxis] > 0.0)
        slip = np.where(pulled, self._slip[:, 0], -1.0)
        straight = _STRAIGHT / own.length
        for what, bad in (
            ('sticks', slip == 0.0),
            ('slips both ways', pulled & (slip != slip[:, :1])),
            ('is straight', pulled & (self._turning.rate[:, 0] <= straight)),
        ):
            if bad.any():
                tendon, point = np.unravel_index(int(np.argmax(bad)), bad.shape)
                raise SolveError(
                    f'no derivatives: with friction, {friction.names[tendon]} of '
                    f'{tensions[tendon]:.4g} N {what} at s = {own.s[point]:.4g} m, '
                    'expected one that slides and turns all along'
                )

    def _by_pull(self, found: Condensed, by_offset: FloatArray) -> FloatArray:
        """Change of u (3, tendons, columns, points) as tendons move in their sheaths.

        They move to balance the change ``by_offset`` (2, tendons, columns, points) of the gradient
        of the energy by their offset.
        """
        x, y = -found.moved(by_offset)
        t, n, b, stretch = self._strain[:4]
        width = self._sections.widening(stretch)[0]
        return np.stack(offset_direction(t, n, b, width, x, y, 0.0, 0.0))

    def _by_direction(self, change: FloatArray, turned: FloatArray | float = 0.0) -> FloatArray:
        """Change of the tensions by a ``change`` (3, tendons, columns, points) of u.

        ``turned``, of the same shape, is the change of kappa x e by that of kappa [1/m].
        """
        friction, turning = self._friction, self._turning
        moved = turning.tangents.turned(change)
        derivative, kinks = friction.derivative(self._twist, moved)
        bends = derivative + turned
        along = np.einsum('i...,i...->...', turning.curvature, bends)
        size = np.broadcast_to(turning.rate, along.shape)
        rate = np.divide(along, size, out=np.zeros_like(along), where=size > 0.0)
        half = np.minimum(0.5 * length_of(turning.kinks), 1.0)
        jump = np.einsum('i...,i...->...', turning.kinks, kinks)
        scale = 2.0 * half * np.sqrt(1.0 - half * half)
        jump = np.divide(jump, scale, out=np.zeros_like(jump), where=scale > 0.0)
        angle = friction.integrate(rate, jump)
        return np.asarray(self._slip * friction.mu * self.tensions * angle)
