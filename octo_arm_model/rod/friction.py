"""Capstan friction: the tension of every tendon at every node, and its derivatives.

A tendon of unit tangent e in the axes of the sections, see `tendons`, turns between the base and a
node by the wrap angle

    theta = int |c| ds + sum 2 asin(|[e]| / 2),    c = e' + kappa x e                          (1)

with jumps [e] where strains jump, see `angle_loops.angles`. It loses tension, dT = -mu T
dtheta, where it is drawn in, gains as much where it is let out, and sticks in between (Euler and
Eytelwein). With the tension T_0 at the base and T_b before at each node, T is the nearest to T_b
of all within

    lower = T_0 exp(-mu theta) <= T <= T_0 exp(mu theta) = upper,                              (2)

the play operator of hysteresis, and from slack, T_b = 0, the monotone pull. With the slip sigma,
-1 where drawn in, 1 where let out and 0 where it sticks,

    dT = sigma mu T dtheta + |sigma| exp(sigma mu theta) dT_0 + sigma theta T dmu              (3)
    dtheta = int c . dc / |c| ds + sum [e] . d[e] / (|[e]| (1 - [e]^2 / 4)^(1/2)),
    dc = (de)' + dkappa x e + kappa x de                                                       (4)

which is theta_e de + theta_kappa dkappa. e changes by e_z dz, in sheaths by e_T dT, and as paths
do, so that with S = sigma mu T

    (1 - S theta_e e_T) dT = S (theta_z dz + theta_e de) + the rest of (3),
    theta_z dz = theta_e e_z dz + theta_kappa dkappa                                           (5)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from octo_arm_model.arm.errors import ConvergenceError, SolveError
from octo_arm_model.arm.hints import BoolArray, FloatArray
from octo_arm_model.rod.elements import Elements
from octo_arm_model.rod.section_arrays import Bends
from octo_arm_model.rod.tables import Tables, Work
from octo_arm_model.rod.tendons import Tendons

_STRAIGHT = 1e-9  # angle over the length of the arm below which a tendon counts as straight [rad]
SAME = 1e-6  # relative difference up to which two tensions of a tendon count as equal
# Tolerance of wrap angles of tendons in sheaths [rad], and most iterations for them.
_CONVERGED, _MOST_ITERATIONS = 1e-13, 50
_MOST_LOSS = 100.0  # mu theta beyond which nothing is left of a tension
_LEAST = 1e-300  # tension of a tendon that nobody pulls, of which an angle is asked [N]
# As `forms.Form.angles`.
FillsAngles: TypeAlias = Callable[[Tables, FloatArray, FloatArray, Work], None]


class Band(NamedTuple):
    """The tensions that friction holds, (2), at any n points; all (n, J) [N].

    Attributes:
        lower: of tendons that are drawn in.
        upper: of tendons that are let out.
        before: from which they slide.
    """

    lower: FloatArray
    upper: FloatArray
    before: FloatArray

    @classmethod
    def of(cls, base: FloatArray, loss: FloatArray, before: FloatArray) -> Band:
        """For tensions ``base`` at the base and a ``loss`` of mu theta [-]."""
        remaining = np.exp(-loss)
        return cls(base * remaining, base / remaining, before)

    @property
    def tensions(self) -> FloatArray:
        """T, the nearest to those before."""
        return np.minimum(np.maximum(self.before, self.lower), self.upper)

    @property
    def slip(self) -> FloatArray:
        """Sigma of (3)."""
        slip = (self.before >= self.upper * (1.0 - SAME)).astype(np.float64)
        np.copyto(slip, -1.0, where=self.before <= self.lower * (1.0 + SAME))
        return slip


class LocalTensions(NamedTuple):
    """Tendons with friction along an arm.

    Attributes:
        tensions: at the nodes [N], zero beyond anchorages, (N, J).
        angle: theta, (N, J) [rad].
        band: at the points of `Friction.fine`; None of tendons that are drawn in from slack.
    """

    tensions: FloatArray
    angle: FloatArray
    band: Band | None = None


class Friction:
    """Friction of the tendons of one arm.

    The tension at the nodes has the same moments within each element as that at many more points,
    so that integrals of what it bends are those of a tension with kinks. One without kinks is the
    same at the nodes as before: a tendon that is not moved keeps its tension.

    Attributes:
        tables: of the arm.
        fine: the points that a history is at.
        nodes: arc coordinates of the nodes [m], (N,).
        reach: `Tables.reach` at the fine points, (M, J).
        to_nodes: from values at the fine points of an element to those at its nodes, (p, M / E).
    """

    def __init__(self, tables: Tables, angles: FillsAngles, elements: Elements) -> None:
        """Of the arm of ``tables`` at the nodes of ``elements``; ``angles`` fills in theta."""
        self.tables, self._angles, self._elements = tables, angles, elements
        self.fine, self.nodes = elements.fine, elements.s
        self.reach = np.repeat(tables.reach[:: elements.points], len(self.tables.to_fine), axis=0)
        self.to_nodes = self.projection(elements)
        self._last: FloatArray | None = None  # tensions that are begun with in sheaths

    def projection(self, elements: Elements) -> FloatArray:
        """As `to_nodes`, to those of others of the same ``elements``, (p, M / E)."""
        rule, count = elements.rule, len(self.tables.to_fine)
        fine, length = self.fine, elements.edges[1]
        basis = rule.interpolate(fine.s[:count] / length)
        moments = basis.T * (fine.weights[:count] / length)
        return np.asarray(np.linalg.solve(moments @ basis, moments))

    def spread(self, matrix: FloatArray, values: FloatArray) -> FloatArray:
        """``values`` (E k, J) by the ``matrix`` (n, k) of one element, (E n, J)."""
        rows = matrix @ values.reshape(self._elements.lengths.size, -1, values.shape[1])
        return rows.reshape(-1, values.shape[1])

    def hold(
        self, tensions: FloatArray, before: FloatArray | None, angle: FloatArray
    ) -> LocalTensions:
        """Tendons of an ``angle`` (N, J) [rad] under ``tensions`` (J,) [N] at the base, by (2).

        From tensions ``before`` (M, J) [N] at the fine points, or from slack.
        """
        mu = self.tables.friction
        if before is None:
            return LocalTensions(tensions * self.tables.reach * np.exp(-mu * angle), angle)
        loss = mu * self.spread(self.tables.to_fine, angle)
        band = Band.of(tensions * self.reach, loss, before)
        return LocalTensions(self.spread(self.to_nodes, band.tensions), angle, band)

    def hold_along(
        self, z: FloatArray, tensions: FloatArray, before: FloatArray | None, work: Work
    ) -> LocalTensions:
        """Tendons along an arm of twists ``z`` (N, m), with arguments of `hold`.

        In sheaths the angles depend on the tensions, so that both are iterated.

        Raises:
            ConvergenceError: if the iteration does not converge.
        """
        tables, local = self.tables, tensions * self.tables.reach
        if not tables.compliance.any():
            return self.hold(tensions, before, self.angles(z, local, work))
        if self._last is not None:
            local = np.where(local > 0.0, np.maximum(self._last, _LEAST), 0.0)
        last, left = np.full_like(local, np.inf), np.inf
        for _ in range(_MOST_ITERATIONS):
            found = self.hold(tensions, before, self.angles(z, local, work))
            left = float(np.abs(found.angle - last).max(initial=0.0))
            last, local = found.angle, found.tensions
            if left <= _CONVERGED:
                self._last = local
            if not left > _CONVERGED:  # nor NaN, where a section cannot be
                return found
        raise ConvergenceError('the tension of tendons in their sheaths', left, _MOST_ITERATIONS)

    def pulled(
        self,
        tensions: FloatArray,
        before: FloatArray,
        angle: FloatArray,
        more: FloatArray,
        free: FloatArray,
    ) -> FloatArray:
        """Tensions at the base (J,) [N] at which integrals are more than under ``tensions`` (J,).

        By ``more`` (J,) [N m], of local tensions by (2), for ``before`` and ``angle`` see `hold`,
        and of that at the base over a ``free`` length (J,) [m]. They are linear between the
        tensions at which one of the fine points begins or ends to stick.
        """
        loss = self.tables.friction * self.spread(self.tables.to_fine, angle)
        remaining = np.exp(-np.minimum(loss, _MOST_LOSS))
        weights, found = self.fine.weights[:, np.newaxis] * self.reach, tensions.copy()
        for j, (was, part, weight) in enumerate(zip(before.T, remaining.T, weights.T)):
            turns = np.concatenate([was * part, was / part])
            order, nothing = turns.argsort(), np.zeros_like(weight)
            let_out = np.concatenate([weight / part, nothing])[order]
            drawn_in = np.concatenate([nothing, weight * part])[order]
            ends = np.append(0.0, turns[order])
            ends = np.append(ends, 1e3 * max(ends[-1], tensions[j]) + 1.0)
            slopes = np.append(let_out[::-1].cumsum()[::-1], 0.0) + free[j]
            slopes[1:] += drawn_in.cumsum()
            integrals = np.append(0.0, np.cumsum(slopes * np.diff(ends)))
            wanted = np.interp(tensions[j], ends, integrals) + more[j]
            found[j] = np.interp(wanted, integrals, ends)
        return found

    def angles(self, z: FloatArray, tensions: FloatArray, work: Work) -> FloatArray:
        """Theta (N, J) of tendons under ``tensions`` (N, J) [N] along an arm of twists ``z``."""
        self._angles(self.tables, z, tensions, work)
        return work.angle.copy()

    def history(self, local: LocalTensions, tensions: FloatArray) -> FloatArray:
        """Tensions (M, J) at the fine points of tendons under ``tensions`` (J,) at the base."""
        if local.band is not None:
            return local.band.tensions
        angle = self.spread(self.tables.to_fine, local.angle)
        return np.asarray(tensions * self.reach * np.exp(-self.tables.friction * angle))


class TensionDerivatives:
    """Derivatives of local tensions, while tendons slip and stick where they do.

    An angle changes with what changes in its own element, up to it, and with what does in those
    before, up to their ends. So derivatives of angles are (E, J, p + 1, p, ...): by the p nodes of
    an element, of the angles from its start to each of them and to its end. J are the tendons that
    are pulled there; elsewhere they are all.
    """

    def __init__(
        self, friction: Friction, z: FloatArray, local: LocalTensions, tendons: Tendons, work: Work
    ) -> None:
        """About ``tendons`` of the tensions ``local`` along an arm of twists ``z`` (N, m)."""
        self._slide(friction, local)
        self._z, self._work = z, work
        pulled = np.flatnonzero(local.tensions.any(axis=0))
        self._pulled = pulled if pulled.size else np.array([0])  # for the shapes of arrays
        rate = self._slip * self._tables.friction * self._tension
        rate = self._by_element(rate[:, self._pulled])
        self._by_angle = (self._to_nodes * rate) @ self._to_points  # S, (E, J, p, p)
        self._pull = tendons.stretch_by_twist[:, self._pulled].swapaxes(1, 2)
        self._by_e, by_kappa = self._angle_derivatives(tendons)
        by_twist = self._by_element(tendons.unit_by_twist[..., self._pulled])[..., 0, :]
        by_z = np.einsum('cejik,mcejk->ejikm', self._by_e, by_twist)
        by_z[..., :3] += np.moveaxis(by_kappa, 0, -1)
        self._by_z = by_z.reshape(*by_z.shape[:3], -1)
        self._inverse: FloatArray | None = None
        if tendons.has_sheaths:
            by_tension = self._by_element(tendons.by_tension.unit[..., self._pulled])
            own = self._by_all_nodes((self._by_e * by_tension).sum(axis=0))
            try:
                self._inverse = np.asarray(np.linalg.inv(np.eye(len(z)) - own))
            except np.linalg.LinAlgError:  # a section that cannot be
                raise ConvergenceError(
                    'the tension of tendons in their sheaths', np.inf, 0
                ) from None

    def _slide(self, friction: Friction, local: LocalTensions) -> None:
        """Which way tendons of tensions ``local`` slip, and where this is known."""
        self._friction, self._tables, self._local = friction, friction.tables, local
        if local.band is None:
            self._s, self._tension = friction.nodes, local.tensions
            self._slip = np.full_like(self._tension, -1.0)
            self._to_points = self._to_nodes = np.eye(len(self._tables.to_end))
        else:
            self._s, self._tension = friction.fine.s, local.band.tensions
            self._slip = local.band.slip
            self._to_points, self._to_nodes = self._tables.to_fine, friction.to_nodes

    def require(self, names: tuple[str, ...], tensions: FloatArray) -> None:
        """Refuse derivatives where tensions under ``tensions`` (J,) [N] at the base have none.

        ``names`` are those of the tendons.

        Raises:
            SolveError: if a tendon that is pulled sticks anywhere, slips both ways, or is so
                straight that turning it either way makes it lose tension.
        """
        rubs = (tensions > 0.0) & (self._tables.friction > 0.0)
        acts, slip = self._tension > 0.0, self._slip
        straight = self._are_straight()
        for what, places, bad in (
            ('sticks', self._s, acts & (slip == 0.0)),
            ('slips both ways', self._s, acts & (slip != slip[0])),
            ('is straight', self._friction.nodes, straight & (self._tables.reach > 0.0)),
        ):
            if (bad & rubs).any():
                place, tendon = np.unravel_index(int(np.argmax(bad & rubs)), bad.shape)
                raise SolveError(
                    f'no derivatives: with friction, {names[tendon]} of {tensions[tendon]:.4g} N '
                    f'{what} at s = {places[place]:.4g} m, expected one that slides and turns all '
                    'along'
                )

    def _are_straight(self) -> BoolArray:
        """Where tendons do not turn, (N, J)."""
        straight = np.zeros(self._tables.reach.shape, np.bool_)
        straight[:, self._pulled] = self._rate <= _STRAIGHT / self._friction.fine.edges[-1]
        return straight

    def add_to(self, jacobian: FloatArray) -> None:
        """Add what the change of tensions adds to a ``jacobian`` (N m, N m) with them held."""
        parts = self._by_z
        if self._inverse is not None:
            rates = self._inverse @ self._by_all_nodes(parts)
            jacobian += (self._pull @ rates.swapaxes(0, 1)).reshape(jacobian.shape)
            return
        elements, tendons, _, size = parts.shape
        pull = self._pull.reshape(elements, -1, self._pull.shape[1], tendons)
        inside = pull @ (self._by_angle @ parts[:, :, :-1]).swapaxes(1, 2)
        # Beyond an element all angles change alike.
        beyond = pull * self._by_angle.sum(axis=-1).swapaxes(1, 2)[:, :, np.newaxis]
        beyond = beyond.reshape(-1, tendons)
        for e in range(elements):
            start, end = e * size, (e + 1) * size
            jacobian[start:end, start:end] += inside[e].reshape(size, size)
            jacobian[end:, start:end] += beyond[end:] @ parts[e, :, -1]

    @property
    def by_base_tension(self) -> FloatArray:
        """Derivative by each tendon's own tension at the base [-], (N, J)."""
        loss = self._tables.friction * self._friction.spread(self._to_points, self._angles())
        # A slack tendon is drawn in next, whatever it was before.
        slip = np.where(self._tension > 0.0, self._slip, -1.0)
        return self._at_nodes(np.abs(slip) * np.exp(slip * loss))

    @property
    def by_friction(self) -> FloatArray:
        """Derivative by each tendon's own mu [N], (N, J)."""
        angle = self._friction.spread(self._to_points, self._local.angle)
        return self._at_nodes(self._slip * angle * self._tension)

    def by_unit(self, change: FloatArray) -> FloatArray:
        """Change (N, J) where paths ``change`` e (3, N, J)."""
        own = self._by_element(change[..., self._pulled])
        return self._of_angles((self._by_e * own).sum(axis=(0, -1))[..., np.newaxis])[..., 0]

    def by_twists(self, change: FloatArray) -> FloatArray:
        """Changes (N, J, k) by those of the twists (N, m, k), base tensions held."""
        rows = change.reshape(len(self._by_z), 1, -1, change.shape[2])
        return self._of_angles(self._by_z @ rows)

    def _angles(self) -> FloatArray:
        """Angles, of tendons that nobody pulls as well, which matter as soon as somebody does."""
        tensions = self._local.tensions
        if tensions.any(axis=0).all():
            return self._local.angle
        return self._friction.angles(self._z, np.maximum(tensions, _LEAST), self._work)

    def _angle_derivatives(self, tendons: Tendons) -> tuple[FloatArray, FloatArray]:
        """theta_e and theta_kappa of (4), (3, E, J, p + 1, p)."""
        tables, e = self._tables, tendons.unit[..., self._pulled]
        bends = Bends(tables, self._z, e, tables.reach[:, self._pulled])
        self._rate, by_c = bends.rate, self._by_bends(bends)
        by_kappa = _cross(self._by_element(e), by_c)
        by_e = (
            by_c @ tables.differentiation / tables.lengths[:, np.newaxis, np.newaxis, np.newaxis]
        )
        by_e += _cross(by_c, self._by_element(self._z[:, :3].T[..., np.newaxis]))
        # The jump at the start of an element counts at all of its nodes, that at its end beyond.
        square = (bends.kink * bends.kink).sum(axis=0)
        by_jump = _direction(bends.kink) / np.sqrt(np.maximum(1.0 - 0.25 * square, 1e-12))
        by_jump = by_jump[..., np.newaxis]
        by_e += (by_jump * tables.ends[0])[:, :, :, np.newaxis]
        by_e[:, :-1, :, -1] -= by_jump[:, 1:] * tables.ends[1]
        return by_e, by_kappa

    def _by_bends(self, bends: Bends) -> FloatArray:
        """Derivative of the integral in (1) by c, (3, E, J, p + 1, p)."""
        tables, lengths = self._tables, self._tables.lengths[:, np.newaxis, np.newaxis]
        whole = tables.weights[: len(tables.to_end)] / tables.lengths[0]
        weights = np.append(tables.to_point, [whole], axis=0) * lengths
        found = weights[:, np.newaxis] * self._by_element(_direction(bends.bend))
        e, j = np.nonzero(bends.is_rough)
        fine = _direction(self._by_element(bends.bend)[:, e, j] @ tables.to_fine.T)
        found[:, e, j] = lengths[e] * ((tables.fine_weights * fine) @ tables.to_fine)
        return np.asarray(found)

    def _by_element(self, values: FloatArray) -> FloatArray:
        """``values`` (..., E k, J) as (..., E, J, 1, k)."""
        elements = self._tables.lengths.size
        rows = values.reshape(*values.shape[:-2], elements, 1, -1, values.shape[-1])
        return np.ascontiguousarray(rows.swapaxes(-1, -2).swapaxes(-2, -3))

    def _at_nodes(self, values: FloatArray) -> FloatArray:
        """Derivative (N, J) by a quantity of each tendon that adds ``values`` (M, J) to (3)."""
        return self._solved(self._tables.reach * self._friction.spread(self._to_nodes, values))

    def _by_all_nodes(self, parts: FloatArray) -> FloatArray:
        """S times angles that change by ``parts`` (E, J, p + 1, p k), (J, N, N k)."""
        elements, tendons, points = *parts.shape[:2], parts.shape[2] - 1
        inside = self._by_angle @ parts[:, :, :-1]
        beyond = self._by_angle.sum(axis=-1).swapaxes(0, 1)[..., np.newaxis]
        found = np.zeros((tendons, elements, points, elements, parts.shape[3]))
        for e in range(elements):
            found[:, e, :, e] = inside[e]
            found[:, e + 1 :, :, e] = beyond[:, e + 1 :] * parts[e, :, np.newaxis, -1:]
        return found.reshape(tendons, elements * points, -1)

    def _of_angles(self, parts: FloatArray) -> FloatArray:
        """Changes of tensions (N, J, k) where angles change by ``parts`` (E, J, p + 1, k)."""
        whole = parts[:, :, -1:]
        held = self._by_angle @ (parts[:, :, :-1] + (whole.cumsum(axis=0) - whole))
        found = np.zeros((*self._local.tensions.shape, parts.shape[3]))
        found[:, self._pulled] = held.swapaxes(1, 2).reshape(len(found), -1, parts.shape[3])
        return self._solved(found)

    def _solved(self, right: FloatArray) -> FloatArray:
        """Changes dT of (5) of its ``right`` side, (N, J, ...)."""
        if self._inverse is not None:
            own = right[:, self._pulled].swapaxes(0, 1)
            rows = self._inverse @ own.reshape(*own.shape[:2], -1)
            right[:, self._pulled] = rows.reshape(own.shape).swapaxes(0, 1)
        return right


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross products of the first axes."""
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def _direction(vectors: FloatArray) -> FloatArray:
    """``vectors`` (3, ...) over their length, zero where they are."""
    size = np.sqrt((vectors * vectors).sum(axis=0))
    return np.divide(vectors, size, out=np.zeros_like(vectors), where=size > 0.0)
