"""Capstan friction: the tension of every tendon at every node.

A tendon that slides loses tension with the angle theta by which it has turned since the base,
dT = -mu T dtheta, where it is drawn in, and gains it where it is let out; in between it sticks
(Euler and Eytelwein). With the tension T_0 at the base and the tension ``before`` at each node,
the tension is the nearest to ``before`` that friction holds,

    T = clip(before, T_0 exp(-mu theta), T_0 exp(mu theta)).

It is the play operator of hysteresis, and from slack, before = 0, the monotone pull. theta follows
from the twists, see `loops.angles`, so that T is a function of them, and so are its derivatives:
dT = slip mu T dtheta, slip -1 where a tendon is drawn in, 1 where it is let out and 0 where it
sticks.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.errors import ConvergenceError, SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.arrays import Bends
from octo_arm_model.rod.elements import Elements
from octo_arm_model.rod.forms import Form
from octo_arm_model.rod.tables import Tables, Work

_STRAIGHT = 1e-9  # angle over the length of the arm below which a tendon counts as straight [rad]
SAME = 1e-6  # relative difference up to which two tensions of a tendon count as equal
# Tolerance of the angles by which tendons in sheaths turn [rad], and most iterations for them.
_PLACED, _MOST_PLACED = 1e-13, 50
_NOTHING = 1e-300  # tension of a tendon that nobody pulls, of which an angle is asked [N]


class Sliding(NamedTuple):
    """Tendons under friction.

    Attributes:
        tensions: at the nodes [N], zero beyond anchorages, (N, J).
        angle: by which each has turned since the base [rad], (N, J).
        along: tensions at the points of `Friction.fine` [N], (M, J); None of tendons that are
            drawn in all along, from slack.
        before: there, from which they slid.
        base: tension at the base of those that reach there [N], (M, J).
        loss: mu theta there, (M, J).
    """

    tensions: FloatArray
    angle: FloatArray
    along: FloatArray | None = None
    before: FloatArray | None = None
    base: FloatArray | None = None
    loss: FloatArray | None = None

    @property
    def slip(self) -> FloatArray | None:
        """At the fine points, -1 where drawn in, 1 where let out and 0 where it sticks, (M, J).

        None of tendons that are drawn in all along, from slack.
        """
        if self.before is None or self.base is None or self.loss is None:
            return None
        kept = np.exp(-self.loss)
        slip = (self.before >= self.base / kept * (1.0 - SAME)).astype(np.float64)
        np.copyto(slip, -1.0, where=self.before <= self.base * kept * (1.0 + SAME))
        return slip


class Friction:
    """Friction of the tendons of one arm.

    The tension at the nodes has the same moments within each element as that at many more points,
    so that integrals of what it bends are those of a tension with kinks.

    Attributes:
        fine: the points that a history is at.
        nodes: arc coordinates of the nodes [m], (N,).
        reach: `Tables.reach` at the fine points, (M, J).
        to_fine: from values at the nodes of an element to those at its fine points, (M / E, p).
        to_nodes: the other way round, (p, M / E).
    """

    def __init__(self, tables: Tables, form: Form, elements: Elements) -> None:
        """Of the arm of ``tables`` at the nodes of ``elements``."""
        self._tables, self._form, self._elements = tables, form, elements
        self.fine, self.nodes, self.to_fine = elements.fine, elements.s, tables.to_fine
        self.reach = np.repeat(tables.reach[:: elements.points], len(self.to_fine), axis=0)
        self.to_nodes = self.projection(elements)
        self._last: FloatArray | None = None  # tensions that are begun with in sheaths

    def projection(self, elements: Elements) -> FloatArray:
        """As `to_nodes`, to those of others of the same ``elements``, (p, M / E)."""
        rule, count = elements.rule, len(self.to_fine)
        places, weights = (own[:count] / elements.edges[1] for own in self.fine[3:5])
        return (rule.interpolate(places) * weights[:, np.newaxis]).T / rule.weights[:, np.newaxis]

    def spread(self, matrix: FloatArray, values: FloatArray) -> FloatArray:
        """``values`` (E k, J) by the ``matrix`` (n, k) of one element, (E n, J)."""
        rows = matrix @ values.reshape(self._elements.lengths.size, -1, values.shape[1])
        return rows.reshape(-1, values.shape[1])

    def slide(self, tensions: FloatArray, before: FloatArray | None, angle: FloatArray) -> Sliding:
        """Tendons that turn by ``angle`` (N, J) [rad] under ``tensions`` (J,) [N] at the base.

        From tensions ``before`` (M, J) [N] at the fine points, or from slack.
        """
        mu = self._tables.friction
        if before is None:
            return Sliding(tensions * self._tables.reach * np.exp(-mu * angle), angle)
        base, loss = tensions * self.reach, mu * self.spread(self.to_fine, angle)
        along = clipped(base, before, loss)
        return Sliding(self.spread(self.to_nodes, along), angle, along, before, base, loss)

    def slide_along(
        self, z: FloatArray, tensions: FloatArray, before: FloatArray | None, work: Work
    ) -> Sliding:
        """Tendons along an arm of twists ``z`` (N, m), with arguments of `slide`.

        In sheaths the angles depend on the tensions, so that both are iterated.

        Raises:
            ConvergenceError: if the iteration does not converge.
        """
        tables, local, last, left = self._tables, tensions * self._tables.reach, None, np.inf
        gives_way = bool(tables.compliance.any())
        if gives_way and self._last is not None:
            local = np.where(local > 0.0, np.maximum(self._last, 1e-300), 0.0)
        for _ in range(_MOST_PLACED):
            self._form.angles(tables, z, local, work)
            found = self.slide(tensions, before, work.angle.copy())
            if not gives_way:
                return found
            self._last = local = found.tensions
            if last is not None:
                left = float(np.abs(found.angle - last).max(initial=0.0))
                if not left > _PLACED:  # nor NaN, where a section cannot be
                    return found
            last = found.angle
        raise ConvergenceError('the tension of tendons in their sheaths', left, _MOST_PLACED)

    def angles_of_all(self, z: FloatArray, sliding: Sliding, work: Work) -> FloatArray:
        """Angles (N, J) [rad] of tendons that nobody pulls as well, at twists ``z`` (N, m)."""
        self._form.angles(self._tables, z, np.maximum(sliding.tensions, _NOTHING), work)
        return work.angle.copy()

    def history(self, sliding: Sliding, tensions: FloatArray) -> FloatArray:
        """Tensions (M, J) at the fine points of tendons under ``tensions`` (J,) at the base."""
        if sliding.along is not None:
            return sliding.along
        angle = self.spread(self.to_fine, sliding.angle)
        return np.asarray(tensions * self.reach * np.exp(-self._tables.friction * angle))


def clipped(base: FloatArray, before: FloatArray, loss: FloatArray) -> FloatArray:
    """Tensions after ``before`` that friction holds, all (n, J).

    ``loss`` is mu theta, and ``base`` the tension at the base [N].
    """
    kept = np.exp(-loss)
    return np.asarray(np.minimum(np.maximum(before, base * kept), base / kept))


class Changes:
    """Small changes of tensions with friction, while tendons slip and stick where they do.

    An angle changes with what changes in its own element, up to it, and with what does in those
    before, up to their ends. So arrays are (E, J, p + 1, p, ...): by the p nodes of an element, of
    the angles to each of them and to its end. J are the tendons that are pulled.
    """

    def __init__(
        self, friction: Friction, tables: Tables, z: FloatArray, sliding: Sliding, work: Work
    ) -> None:
        """Linearise about tendons that are ``sliding`` along an arm of twists ``z`` (N, m)."""
        if not sliding.tensions.all():
            # One that nobody pulls turns as well, which matters as soon as somebody does.
            angle, loss = friction.angles_of_all(z, sliding, work), sliding.loss
            if loss is not None:
                loss = tables.friction * friction.spread(friction.to_fine, angle)
            sliding = sliding._replace(angle=angle, loss=loss)
        self._friction, self._tables, self._sliding = friction, tables, sliding
        bends = Bends(tables, z, sliding.tensions, work)
        self._tendons, self._pulled = bends.tendons, bends.tendons.pulled
        self._shape = tables.lengths.size, self._pulled.size, len(tables.to_end)
        self._offsets = work.offsets[:, self._pulled]
        self._directions, self._rate = _Directions(bends, z), bends.rate
        self._by_u, by_kappa = self._by_directions(bends, z)
        u = self._directions.by_twist()
        # Derivative of the gradient of the energy by the local tension, (N, m, J).
        self._pull = np.einsum('cnj,canj->naj', self._tendons.unit, u)
        self._by_z = np.empty((*self._by_u.shape[1:], z.shape[1]))
        for strain in range(z.shape[1]):
            by = (self._by_u * self._by_element(u[:, strain])).sum(axis=0)
            self._by_z[..., strain] = by + by_kappa[strain] if strain < 3 else by
        self._slips, self._inverse = self._by_angle(), None
        if self._tendons.compliance.any():
            own = (self._by_u * self._by_element(self._directions.by_tension())).sum(axis=0)
            own = self._slid(self._dense(own))
            inverse = np.linalg.inv(np.eye(len(z)) - self._by_tendon(own))
            self._inverse = np.asarray(inverse, dtype=np.float64)

    def require(self, names: tuple[str, ...], tensions: FloatArray) -> None:
        """Refuse derivatives where tensions under ``tensions`` (J,) [N] at the base have none.

        ``names`` are those of the tendons.

        Raises:
            SolveError: if a tendon that is pulled sticks anywhere, slips both ways, or is so
                straight that turning it either way makes it lose tension.
        """
        friction, sliding = self._friction, self._sliding
        rubs = (tensions > 0.0) & (self._tables.friction > 0.0)
        s, length = friction.fine.s, friction.fine.edges[-1]
        straight = np.zeros(self._tables.reach.shape, np.bool_)
        straight[:, self._pulled] = self._rate <= _STRAIGHT / length
        found = [('is straight', friction.nodes, straight & (self._tables.reach > 0.0))]
        if sliding.before is not None:
            acts, slip = friction.reach > 0.0, sliding.slip
            assert slip is not None
            found.insert(0, ('slips both ways', s, acts & (slip != slip[0])))
            found.insert(0, ('sticks', s, acts & (slip == 0.0)))
        for what, places, bad in found:
            bad = bad & rubs
            if bad.any():
                place, tendon = np.unravel_index(int(np.argmax(bad)), bad.shape)
                raise SolveError(
                    f'no derivatives: with friction, {names[tendon]} of {tensions[tendon]:.4g} N '
                    f'{what} at s = {places[place]:.4g} m, expected one that slides and turns all '
                    'along'
                )

    def _by_element(self, values: FloatArray) -> FloatArray:
        """``values`` (..., N, J) as (..., E, J, 1, p)."""
        elements, tendons, points = self._shape
        rows = values.reshape(*values.shape[:-2], elements, 1, points, tendons)
        return np.asarray(rows.swapaxes(-1, -2).swapaxes(-2, -3))

    def _by_tendon(self, values: FloatArray) -> FloatArray:
        """``values`` (E, J, p, k) as (J, N, k)."""
        return values.swapaxes(0, 1).reshape(self._shape[1], -1, values.shape[3])

    def _by_angle(self) -> FloatArray:
        """Derivative of tensions by angles within elements, (E, J, p, p)."""
        friction, sliding = self._friction, self._sliding
        tensions, along = sliding.tensions, sliding.along
        elements, tendons, points = self._shape
        mu, pulled = self._tables.friction[self._pulled], self._pulled
        slip = sliding.slip
        if along is None or slip is None:
            rates = -tensions[:, pulled] * mu
            by_element = rates.reshape(elements, points, tendons).swapaxes(1, 2)
            return np.asarray(by_element[..., np.newaxis] * np.eye(points))
        rates = (slip[:, pulled] * along[:, pulled] * mu).reshape(elements, -1, tendons)
        by_nodes = rates.swapaxes(1, 2)[:, :, np.newaxis] * friction.to_nodes
        return np.asarray(by_nodes @ friction.to_fine)

    def _slid(self, angles: FloatArray) -> FloatArray:
        """Change of tensions (E, J, p, k) by one of ``angles`` (E, J, p, k) for held ones."""
        return np.asarray(self._slips @ angles)

    def _by_directions(self, bends: Bends, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives of the angles by u, and by curvatures for held u, (3, E, J, p + 1, p)."""
        tables, (elements, _, points) = self._tables, self._shape
        h = tables.lengths[:, np.newaxis, np.newaxis, np.newaxis]
        # By bends, of their integrals to nodes and the end of elements.
        across = np.divide(
            bends.bend, bends.rate, out=np.zeros_like(bends.bend), where=bends.rate > 0.0
        )
        to_end = np.append(tables.to_point, [tables.weights[:points] / tables.lengths[0]], axis=0)
        by_bend = (to_end * h) * self._by_element(across)
        by_element = self._by_element(bends.bend)[:, :, :, 0]
        for e, j in zip(*np.nonzero(bends.is_rough)):
            bend = tables.to_fine @ by_element[:, e, j].T
            size = np.sqrt((bend * bend).sum(axis=1, keepdims=True))
            bend /= np.where(size > 0.0, size, 1.0)
            rows = tables.fine_weights * bend.T[:, np.newaxis]
            by_bend[:, e, j] = tables.lengths[e] * (rows @ tables.to_fine)
        by_unit = by_bend @ tables.differentiation
        by_unit /= h
        kappa = z[:, :3].T.reshape(3, elements, 1, 1, points)
        by_unit += _cross(by_bend, kappa)
        unit = self._by_element(bends.tendons.unit)
        by_kappa = _cross(unit, by_bend)
        size = np.sqrt((bends.kink * bends.kink).sum(axis=0))
        scale = size * np.sqrt(np.maximum(1.0 - 0.25 * size * size, 1e-12))
        kink = np.divide(bends.kink, scale, out=np.zeros_like(bends.kink), where=scale > 0.0)
        kink = kink[..., np.newaxis]
        by_unit += (kink * tables.ends[0])[:, :, :, np.newaxis]
        by_unit[:, :-1, :, -1] -= kink[:, 1:] * tables.ends[1]
        by_unit -= unit * (by_unit * unit).sum(axis=0)
        by_unit *= self._by_element(bends.tendons.over)
        return by_unit, by_kappa

    def _dense(self, parts: FloatArray) -> FloatArray:
        """Changes of all angles by all nodes (E, J, p, N ...) of ``parts`` (E, J, p + 1, ...)."""
        elements, tendons, points = self._shape
        found = np.zeros((elements, tendons, points, elements, *parts.shape[3:]))
        for e in range(elements):
            found[e, :, :, e] = parts[e, :, :-1]
            found[e + 1 :, :, :, e] = parts[e, :, -1:]
        return found.reshape(elements, tendons, points, -1)

    def _summed(self, parts: FloatArray) -> FloatArray:
        """Changes of all angles (E, J, p, k) by those ``parts`` (E, J, p + 1, k) of elements."""
        whole = parts[:, :, -1:]
        return np.asarray(parts[:, :, :-1] + whole.cumsum(axis=0) - whole)

    def add_to(self, jacobian: FloatArray) -> None:
        """Add what the change of tensions adds to a ``jacobian`` (N m, N m) with them held."""
        nodes, strains, tendons = self._pull.shape
        elements, _, points = self._shape
        if self._inverse is not None:
            own = self._by_tendon(self._slid(self._dense(self._by_z)))
            jacobian += (self._pull @ (self._inverse @ own).swapaxes(0, 1)).reshape(
                len(jacobian), -1
            )
            return
        size = points * strains
        parts = self._by_z.reshape(elements, tendons, points + 1, size)
        own = self._pull.reshape(elements, points, strains, tendons) @ self._slid(
            parts[:, :, :-1]
        ).swapaxes(1, 2)
        slips = self._slips.sum(axis=-1).swapaxes(1, 2).reshape(nodes, 1, tendons)
        rows = (self._pull * slips).reshape(nodes * strains, tendons)
        for e in range(elements):
            here = slice(e * size, (e + 1) * size)
            jacobian[here, here] += own[e].reshape(size, size)
            jacobian[(e + 1) * size :, here] += rows[(e + 1) * size :] @ parts[e, :, -1]

    def by_base_tension(self) -> FloatArray:
        """Derivative by each tendon's own tension at the base [-], (N, J)."""
        return self._settled(self._own(lambda _, slip, loss: (slip != 0.0) * np.exp(slip * loss)))

    def _own(self, of: Callable[[FloatArray, FloatArray, FloatArray], FloatArray]) -> FloatArray:
        """What is a function ``of`` tension, slip and mu theta, at the nodes, (N, J)."""
        friction, sliding = self._friction, self._sliding
        reach, mu = self._tables.reach, self._tables.friction
        slip = sliding.slip
        if sliding.along is None or sliding.loss is None or slip is None:
            drawn_in = np.full_like(sliding.angle, -1.0)
            return np.asarray(reach * of(sliding.tensions, drawn_in, mu * sliding.angle))
        # A slack tendon is drawn in next, whatever it was before.
        slip = np.where(sliding.along > 0.0, slip, -1.0)
        found = of(sliding.along, slip, sliding.loss)
        return reach * friction.spread(friction.to_nodes, found)

    def by_twists(self, change: FloatArray) -> FloatArray:
        """Changes (N, J, k) by those of the twists (N, m, k), base tensions held."""
        elements, _, points = self._shape
        rows = change.reshape(elements, 1, -1, change.shape[2])
        return self._of_angles(self._by_z.reshape(*self._shape[:2], points + 1, -1) @ rows)

    def _of_angles(self, parts: FloatArray) -> FloatArray:
        """Changes of the tensions (N, J, k) by ``parts`` of those of angles, see `_summed`."""
        slid = self._by_tendon(self._slid(self._summed(parts)))
        found = np.zeros((*self._sliding.tensions.shape, parts.shape[3]))
        found[:, self._pulled] = slid.swapaxes(0, 1)
        return self._settled(found)

    @property
    def by_friction(self) -> FloatArray:
        """Derivative by each tendon's own mu at fixed twists [N], (N, J)."""
        mu = np.maximum(self._tables.friction, 1e-300)
        return self._settled(self._own(lambda along, slip, loss: slip * along * loss / mu))

    def by_offset(self, outwards: FloatArray) -> FloatArray:
        """Derivative by each tendon's own distance from the midline [N/m], (N, J).

        ``outwards`` (4, N, J) are the directions away from it along n and b [-] and their slopes.
        """
        own = outwards[..., self._pulled]
        return self._by_direction(self._directions.by_path(own[:2], own[2:]))

    @property
    def by_sheath_stiffness(self) -> FloatArray:
        """Derivative by the stiffness of each tendon's own sheath [N/Pa], (N, J)."""
        return self._by_direction(self._directions.by_sheath_stiffness(self._offsets))

    def _by_direction(self, change: FloatArray) -> FloatArray:
        """Change of the tensions (N, J) by a ``change`` (3, N, J') of u of the pulled tendons."""
        parts = (self._by_u * self._by_element(change)).sum(axis=(0, -1))
        return self._of_angles(parts[..., np.newaxis])[..., 0]

    def _settled(self, direct: FloatArray) -> FloatArray:
        """Change of tensions (N, J, ...) that in sheaths changes angles, from that without."""
        if self._inverse is not None:
            own = direct[:, self._pulled].swapaxes(0, 1)
            rows = self._inverse @ own.reshape(*own.shape[:2], -1)
            direct[:, self._pulled] = rows.reshape(own.shape).swapaxes(0, 1)
        return direct


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross products of the first axes."""
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


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
