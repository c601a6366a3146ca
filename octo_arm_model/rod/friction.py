"""Capstan friction: the tension of every tendon at every node.

A tendon that slides loses tension with the angle theta by which it has turned since the base,
dT = -mu T dtheta, where it is drawn in, and gains it where it is let out; in between it sticks
(Euler and Eytelwein). With the tension T_0 at the base and the tension ``before`` at each node,
the tension is the nearest to ``before`` that friction holds,

    T = clip(before, T_0 exp(-mu theta), T_0 exp(mu theta)).

It is the play operator of hysteresis, and from slack, before = 0, the monotone pull. theta follows
from the twists, see `loops.angles`, so that T is a function of them, and so are its derivatives:
dT = slip mu T dtheta, slip -1 where a tendon is drawn in, 1 where it is let out, 0 where it sticks.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.errors import ConvergenceError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.rod.arrays import Bends
from octo_arm_model.rod.forms import Form
from octo_arm_model.rod.tables import Tables, Work

SAME = 1e-8  # relative difference up to which two tensions of a tendon count as equal
# Tolerance of the angles by which tendons in sheaths turn [rad], and most iterations for them.
_PLACED, _MOST_PLACED = 1e-13, 50


class Sliding(NamedTuple):
    """Tendons under friction, arrays are (N, J).

    Attributes:
        tensions: at the nodes [N], zero beyond anchorages.
        slip: -1 where a tendon is drawn in, 1 where it is let out and 0 where it sticks.
        angle: by which each has turned since the base [rad].
    """

    tensions: FloatArray
    slip: FloatArray
    angle: FloatArray


def slide(
    tables: Tables, tensions: FloatArray, before: FloatArray | None, angle: FloatArray
) -> Sliding:
    """Tendons that turn by ``angle`` (N, J) [rad], from tensions ``before`` (N, J) [N] or slack.

    ``tensions`` (J,) [N] are those at the base.
    """
    kept = np.exp(-tables.friction * angle)
    base = tensions * tables.reach
    low = base * kept
    if before is None:
        return Sliding(low, np.full(low.shape, -1.0), angle)
    high = base / kept
    slip = (before >= high * (1.0 - SAME)).astype(np.float64)
    np.copyto(slip, -1.0, where=before <= low * (1.0 + SAME))
    return Sliding(np.minimum(np.maximum(before, low), high), slip, angle)


def slide_along(
    tables: Tables, form: Form, z: FloatArray, tensions: FloatArray, before: FloatArray | None,
    work: Work, near: FloatArray | None = None,
) -> Sliding:  # fmt: skip
    """Tendons along an arm of twists ``z`` (N, m), with arguments of `slide`.

    In sheaths the angles depend on the tensions, so that both are iterated, from tensions ``near``
    (N, J) if any.

    Raises:
        ConvergenceError: if the iteration does not converge.
    """
    local = tensions * tables.reach if near is None else near
    last, left = None, np.inf
    gives_way = bool(tables.compliance.any())
    for _ in range(_MOST_PLACED):
        form.angles(tables, z, local, work)
        found = slide(tables, tensions, before, work.angle.copy())
        if not gives_way:
            return found
        if last is not None:
            left = float(np.abs(found.angle - last).max(initial=0.0))
            if not left > _PLACED:  # nor NaN, where a section cannot be
                return found
        local, last = found.tensions, found.angle
    raise ConvergenceError('the tension of tendons in their sheaths', left, _MOST_PLACED)


class Changes:
    """Small changes of tensions with friction, while tendons slip and stick where they do.

    Attributes:
        by_z: derivative of the tension by the twists at all nodes, base tensions held,
            (J, N, N, m) [N] over the unit of a twist.
        pull: derivative of the gradient of the energy by the local tension, (J, N, m).
    """

    def __init__(
        self, tables: Tables, z: FloatArray, sliding: Sliding, work: Work
    ) -> None:
        """Linearise about tendons that are ``sliding`` along an arm of twists ``z`` (N, m)."""
        self._tables, self._sliding = tables, sliding
        bends = Bends(tables, z, sliding.tensions, work)
        self._tendons, self.pulled = bends.tendons, bends.tendons.pulled
        slips = sliding.slip * sliding.tensions * tables.friction
        self._offsets = work.offsets[:, self.pulled]
        self._slips = slips[:, self.pulled].T[..., np.newaxis]
        direct = self._turn(bends, z)
        self._directions = _Directions(bends, z)
        u = self._directions.by_twist()
        self.pull = np.einsum('cnj,canj->jna', self._tendons.unit, u)
        by_z = np.zeros((*self._by_u.shape[:3], z.shape[1]))
        by_z[..., :3] = direct
        for c in range(3):
            by_z += self._by_u[..., c, np.newaxis] * u[c].transpose(2, 1, 0)[:, np.newaxis]
        by_z *= self._slips[..., np.newaxis]
        self._inverse: FloatArray | None = None
        if self._tendons.compliance.any():
            own = np.einsum('jikc,ckj->jik', self._by_u, self._directions.by_tension())
            self._inverse = np.linalg.inv(np.eye(len(z)) - self._slips * own)
            by_z = (self._inverse @ by_z.reshape(*by_z.shape[:2], -1)).reshape(by_z.shape)
        self.by_z = by_z

    def _turn(self, bends: Bends, z: FloatArray) -> FloatArray:
        """Set `_by_u`; derivative of the angles by the curvatures for held u, (J, N, N, 3)."""
        tables, unit = self._tables, bends.tendons.unit
        elements, points, tendons = tables.lengths.size, len(tables.to_end), unit.shape[2]
        across = np.divide(
            bends.bend, bends.rate, out=np.zeros_like(bends.bend), where=bends.rate > 0.0
        )
        h = tables.lengths[:, np.newaxis, np.newaxis, np.newaxis]
        # Of the integrand at k by the unit tangent at l, (3, E, k, l, J).
        by_element = across.reshape(3, elements, points, 1, tendons)
        of_rate = by_element * (tables.differentiation[..., np.newaxis] / h)
        diagonal = np.arange(points)
        kappa = z[:, :3].T[..., np.newaxis]
        of_rate[:, :, diagonal, diagonal] += np.cross(across, kappa, axis=0).reshape(
            3, elements, points, tendons
        )
        size = np.sqrt((bends.kink * bends.kink).sum(axis=0))
        scale = size * np.sqrt(np.maximum(1.0 - 0.25 * size * size, 1e-12))
        kink = np.divide(bends.kink, scale, out=np.zeros_like(bends.kink), where=scale > 0.0)
        self._by_u = np.zeros((tendons, elements, points, elements, points, 3))
        direct = np.zeros((tendons, elements, points, elements, points, 3))
        own, lengths = np.arange(elements), tables.lengths[:, np.newaxis, np.newaxis]
        start = np.einsum('l,cej->celj', tables.ends[0], kink)
        inside = np.einsum('ik,ceklj->ceilj', tables.to_point, of_rate) * h
        inside += start[:, :, np.newaxis]
        weights = tables.weights[:points] / tables.lengths[0]
        whole = np.einsum('k,ceklj->celj', weights, of_rate) * lengths + start
        whole[:, :-1] -= np.einsum('l,cej->celj', tables.ends[1], kink[:, 1:])
        turned = np.cross(unit, across, axis=0).reshape(3, elements, points, tendons)
        turned_inside = (tables.to_point[..., np.newaxis] * h) * turned[:, :, np.newaxis]
        for e in range(elements):
            self._by_u[:, e + 1 :, :, e] = whole[:, e].T[:, np.newaxis, np.newaxis]
            later = tables.weights[e * points : (e + 1) * points, np.newaxis] * turned[:, e]
            direct[:, e + 1 :, :, e] = later.transpose(2, 1, 0)[:, np.newaxis, np.newaxis]
        self._by_u[:, own, :, own] = inside.transpose(1, 4, 2, 3, 0)
        direct[:, own, :, own] = turned_inside.transpose(1, 4, 2, 3, 0)
        nodes = elements * points
        by_unit = self._by_u.reshape(tendons, nodes, nodes, 3)
        over, c = bends.tendons.over.T[:, np.newaxis], unit.transpose(2, 1, 0)[:, np.newaxis]
        along = (by_unit * c).sum(axis=-1, keepdims=True)
        self._by_u = (by_unit - along * c) * over[..., np.newaxis]
        return direct.reshape(tendons, nodes, nodes, 3)

    def add_to(self, jacobian: FloatArray) -> None:
        """Add what the change of tensions adds to a ``jacobian`` (N m, N m) with them held."""
        nodes, strains = self.pull.shape[1:]
        rows = self.pull.transpose(1, 2, 0)
        changes = self.by_z.reshape(len(self.by_z), nodes, -1).swapaxes(0, 1)
        jacobian += (rows @ changes).reshape(nodes * strains, -1)

    def by_base_tension(self) -> FloatArray:
        """Derivative by each tendon's own tension at the base [-], (N, J)."""
        tables, (_, slip, angle) = self._tables, self._sliding
        return self._settled(tables.reach * (slip != 0.0) * np.exp(slip * tables.friction * angle))

    def by_twists(self, change: FloatArray) -> FloatArray:
        """Changes (N, J, k) by those of the twists (N, m, k), base tensions held."""
        found = np.zeros((*self._sliding.tensions.shape, change.shape[2]))
        rows = self.by_z.reshape(*self.by_z.shape[:2], -1)
        found[:, self.pulled] = (rows @ change.reshape(-1, change.shape[2])).swapaxes(0, 1)
        return found

    @property
    def by_friction(self) -> FloatArray:
        """Derivative by each tendon's own mu at fixed twists [N], (N, J)."""
        tensions, slip, angle = self._sliding
        return self._settled(slip * angle * tensions)

    def by_offset(self, outwards: FloatArray) -> FloatArray:
        """Derivative by each tendon's own distance from the midline [N/m], (N, J).

        ``outwards`` (4, N, J) are the directions away from it along n and b [-] and their slopes.
        """
        own = outwards[..., self.pulled]
        return self._by_direction(self._directions.by_path(own[:2], own[2:]))

    @property
    def by_sheath_stiffness(self) -> FloatArray:
        """Derivative by the stiffness of each tendon's own sheath [N/Pa], (N, J)."""
        return self._by_direction(self._directions.by_sheath_stiffness(self._offsets))

    def _by_direction(self, change: FloatArray) -> FloatArray:
        """Change of the tensions (N, J) by a ``change`` (3, N, J') of u of the pulled tendons."""
        angle = np.einsum('jikc,ckj->ji', self._by_u, change)
        found = np.zeros(self._sliding.tensions.shape)
        found[:, self.pulled] = (self._slips[..., 0] * angle).T
        return self._settled(found)

    def _settled(self, direct: FloatArray) -> FloatArray:
        """Change of tensions (N, J) that in sheaths changes angles, from that without."""
        if self._inverse is not None:
            own = direct[:, self.pulled].T[..., np.newaxis]
            direct[:, self.pulled] = (self._inverse @ own)[..., 0].T
        return direct


class _Directions:
    """How u of tendons changes, which runs along them, see `loops`; (3, n, J)."""

    def __init__(self, bends: Bends, z: FloatArray) -> None:
        """About the twists ``z`` (n, m)."""
        self._bends, self._tendons, self._z = bends, bends.tendons, z
        self._gives_way = bool(self._tendons.compliance.any())
        t, n, b = self._tendons.strain[:3]
        u_t, u_n, u_b = self._tendons.unit
        self._across = np.stack([t * u_b - b * u_t, n * u_t - t * u_n])

    def by_twist(self) -> FloatArray:
        """Derivative by the twists of the same node, (3, m, n, J)."""
        tendons, width, wider = self._tendons, self._bends.width, self._bends.widening
        x, y, strains = tendons.x, tendons.y, self._z.shape[1]
        t, n, b = self._z[:, :3].T[..., np.newaxis]
        u = np.zeros((3, strains, *x.shape))
        u[0, 1], u[0, 2] = width * y, -width * x
        u[1, 0], u[2, 0] = -width * y, width * x
        u[0, 3] = 1.0 + wider * (n * y - b * x)
        u[1, 3], u[2, 3] = wider * (tendons.dx - t * y), wider * (tendons.dy + t * x)
        for c in range(strains - 3 - 1):
            u[1 + c, 4 + c] = 1.0
        if self._gives_way:
            scaled = np.zeros((3, strains, len(x), 1))
            for c in range(3):
                scaled[c, c] = width
            scaled[0, 3], scaled[1, 3], scaled[2, 3] = wider * t, wider * n, wider * b
            u_t, u_n, u_b = tendons.unit
            u += self._displaced(
                tendons.tension * np.stack(
                    [scaled[0] * u_b - scaled[2] * u_t, scaled[1] * u_t - scaled[0] * u_n]
                ) + self._by_u(u)
            )  # fmt: skip
        return u

    def by_tension(self) -> FloatArray:
        """Derivative by the local tension."""
        return self._displaced(self._across)

    def by_sheath_stiffness(self, offsets: FloatArray) -> FloatArray:
        """Derivative by the stiffness of the sheath, for ``offsets`` (n, J, 2) [m] in it."""
        return self._displaced(offsets.transpose(2, 0, 1))

    def by_path(self, place: FloatArray, slope: FloatArray) -> FloatArray:
        """Change by changes of the ``place`` in the section and its ``slope``, (2, n, J)."""
        u = self._moved(place)
        u[1:] += self._bends.width * slope
        return u + self._displaced(self._by_u(u)) if self._gives_way else u

    def _by_u(self, u: FloatArray) -> FloatArray:
        """Change of the gradient by the offset, (2, ..., n, J), by a change ``u`` (3, ...)."""
        tendons = self._tendons
        t, n, b = tendons.strain[:3]
        along = (u * tendons.unit.reshape(3, *(1,) * (u.ndim - 3), *tendons.x.shape)).sum(axis=0)
        p_n, p_b = self._across
        over = tendons.tension * tendons.over
        return over * np.stack(
            [t * u[2] - b * u[0] - p_n * along, n * u[0] - t * u[1] - p_b * along]
        )

    def _moved(self, offset: FloatArray) -> FloatArray:
        """Change of u by a change of the ``offset`` (2, ..., n, J) of tendons."""
        t, n, b = self._tendons.strain[:3]
        x, y = offset
        return np.stack([n * y - b * x, -t * y, t * x])

    def _displaced(self, force: FloatArray) -> FloatArray:
        """Change of u by a change ``force`` (2, ..., n, J) of the gradient by the offset."""
        tendons = self._tendons
        p_n, p_b = self._across
        stiff = tendons.compliance * tendons.tension * tendons.over
        nn, nb, bb = tendons.offset_stiffness(p_n, p_b, stiff)
        over = -tendons.compliance / (nn * bb - nb * nb)
        x, y = force
        return self._moved(np.stack([over * (bb * x - nb * y), over * (nn * y - nb * x)]))
