"""Capstan friction: the tension of every tendon at every node, and its derivatives.

A tendon of unit tangent e in the axes of the sections turns between the base and a node by the
wrap angle

    theta = int |c| ds + sum 2 asin(|[e]| / 2),    c = e' + kappa x e                          (1)

with jumps [e] where strains jump. It loses tension, dT = -mu T dtheta, where it is drawn in, gains
as much where it is let out, and sticks in between (Euler and Eytelwein). With the tension T_0 at
the base, and the earlier tension T_b at each node, T is the value nearest to T_b within

    lower = T_0 exp(-mu theta) <= T <= T_0 exp(mu theta) = upper,                              (2)

which is the play operator of hysteresis; from slack, T_b = 0, it is the monotone pull. With the
slip sigma, -1 where drawn in, 1 where let out and 0 where the tendon sticks,

    dT = sigma mu T dtheta + |sigma| exp(sigma mu theta) dT_0 + sigma theta T dmu              (3)
    dtheta = int c . dc / |c| ds + sum [e] . d[e] / (|[e]| (1 - [e]^2 / 4)^(1/2)),
    dc = (de)' + dkappa x e + kappa x de                                                       (4)

which is theta_e de + theta_kappa dkappa. The tangent e changes by e_z dz, in sheaths by e_T dT,
and with the paths, so that with S = sigma mu T

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
# Tolerance of wrap angles of tendons in sheaths [rad], and the most iterations for them.
_CONVERGED, _MOST_ITERATIONS = 1e-13, 50
_MOST_LOSS = 100.0  # mu theta beyond which a tension counts as lost
_LEAST = 1e-300  # tension of a slack tendon whose angle is computed [N]
# The type of `forms.Form.angles`.
FillsAngles: TypeAlias = Callable[[Tables, FloatArray, FloatArray, Work], None]


class Band(NamedTuple):
    """The band (2) of tensions that friction can hold, at n points, (n, J) [N] each."""

    lower: FloatArray  #: tensions of tendons that are drawn in
    upper: FloatArray  #: tensions of tendons that are let out
    before: FloatArray  #: tensions from which tendons slide

    @classmethod
    def of(cls, base: FloatArray, loss: FloatArray, before: FloatArray) -> Band:
        """Return the band for tensions ``base`` at the base and a ``loss`` of mu theta [-]."""
        remaining = np.exp(-loss)
        return cls(base * remaining, base / remaining, before)

    @property
    def tensions(self) -> FloatArray:
        """T of (2): the tensions in the band nearest to those before."""
        return np.minimum(np.maximum(self.before, self.lower), self.upper)

    @property
    def slip(self) -> FloatArray:
        """Sigma of (3)."""
        slip = (self.before >= self.upper * (1.0 - SAME)).astype(np.float64)
        np.copyto(slip, -1.0, where=self.before <= self.lower * (1.0 + SAME))
        return slip


class LocalTensions(NamedTuple):
    """The tensions of tendons with friction along an arm."""

    tensions: FloatArray  #: tensions at the nodes [N], zero beyond anchorages, (N, J)
    angle: FloatArray  #: wrap angles theta, (N, J) [rad]
    #: the band at the points `Friction.fine`; None if tendons are drawn in from slack
    band: Band | None = None


class Friction:
    """The friction of the tendons of one arm.

    Tensions along a tendon have kinks, so they are computed at many fine points and projected to
    the nodes: within each element, the moments of the tension at the nodes are those at the fine
    points. A tension without kinks is unchanged, so a tendon that does not move keeps its tension.

    Attributes:
        tables: the arm at the nodes.
        fine: the fine points, at which the history of the tensions is kept.
        nodes: arc coordinates of the nodes [m], (N,).
        reach: whether a tendon reaches a fine point, 1 or 0, (M, J).
        to_nodes: projection from the fine points of an element to its nodes, (p, M / E).
    """

    def __init__(self, tables: Tables, angles: FillsAngles, elements: Elements) -> None:
        """Prepare the nodes of ``elements`` and their ``tables``; ``angles`` computes theta."""
        self.tables, self._angles, self._elements = tables, angles, elements
        self.fine, self.nodes = elements.fine, elements.s
        self.reach = np.repeat(tables.reach[:: elements.points], len(self.tables.to_fine), axis=0)
        self.to_nodes = self.projection(elements)
        self._last: FloatArray | None = None  # first guess of tensions in sheaths
        self._last_integrals: tuple[FloatArray, ...] | None = None

    def projection(self, elements: Elements) -> FloatArray:
        """Return the projection from fine points to nodes of other ``elements``, (p, M / E)."""
        rule, count = elements.rule, len(self.tables.to_fine)
        fine, length = self.fine, elements.edges[1]
        basis = rule.interpolate(fine.s[:count] / length)
        moments = basis.T * (fine.weights[:count] / length)
        return np.asarray(np.linalg.solve(moments @ basis, moments))

    def spread(self, matrix: FloatArray, values: FloatArray) -> FloatArray:
        """Apply the ``matrix`` (n, k) of one element to ``values`` (E k, J): (E n, J)."""
        rows = matrix @ values.reshape(self._elements.lengths.size, -1, values.shape[1])
        return rows.reshape(-1, values.shape[1])

    def hold(
        self, tensions: FloatArray, before: FloatArray | None, angle: FloatArray
    ) -> LocalTensions:
        """Return the local tensions by (2), from ``tensions`` (J,) [N] at the base.

        ``angle`` (N, J) [rad] is theta. Tendons slide from the tensions ``before`` (M, J) [N] at
        the fine points, or from slack if it is None.
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
        """Return the local tensions in an arm of twists ``z`` (N, m), as `hold` does.

        In sheaths the angles depend on the tensions, so both are iterated.

        Raises:
            ConvergenceError: if the iteration does not converge.
        """
        tables, local = self.tables, tensions * self.tables.reach
        if not tables.compliance.any():
            return self.hold(tensions, before, self.angles(z, local, work))
        if self._last is not None:
            local = np.where(local > 0.0, np.maximum(self._last, _LEAST), 0.0)
        last, change = np.full_like(local, np.inf), np.inf
        for _ in range(_MOST_ITERATIONS):
            local_tensions = self.hold(tensions, before, self.angles(z, local, work))
            change = float(np.abs(local_tensions.angle - last).max(initial=0.0))
            last, local = local_tensions.angle, local_tensions.tensions
            if change <= _CONVERGED:
                self._last = local
            if not change > _CONVERGED:  # or NaN, if a strain is impossible
                return local_tensions
        raise ConvergenceError('the tension of tendons in their sheaths', change, _MOST_ITERATIONS)

    def pulled(
        self,
        tensions: FloatArray,
        before: FloatArray,
        angle: FloatArray,
        increase: FloatArray,
        free: FloatArray,
    ) -> FloatArray:
        """Return the tensions at the base (J,) [N] at which an integral of tensions is larger.

        It is the integral of local tensions by (2), plus the tension at the base times a ``free``
        length (J,) [m]. It is larger by ``increase`` (J,) [N m] than under ``tensions`` (J,).
        The other arguments are those of `hold`. The integral is linear between the tensions at
        which one of the fine points begins or ends to stick.
        """
        ends, integrals = self._integrals(tensions, before, angle)
        integrals = integrals + free * ends
        integral = _interpolated(tensions, ends, integrals) + increase
        return _interpolated(integral, integrals, ends)

    def _integrals(
        self, tensions: FloatArray, before: FloatArray, angle: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return tensions at the base (k, J), in order, and the integrals (k, J) under each.

        Those of the last ``before`` and ``angle`` are kept, for several steps from one state.
        """
        if self._last_integrals is not None:
            last_before, last_angle, *last = self._last_integrals
            if last_before is before and last_angle is angle:
                return last[0], last[1]
        loss = self.tables.friction * self.spread(self.tables.to_fine, angle)
        remaining = np.exp(-np.minimum(loss, _MOST_LOSS))
        limits = np.concatenate([before * remaining, before / remaining])
        order, weights = limits.argsort(axis=0), self.fine.weights[:, np.newaxis] * self.reach
        ends, zeros = np.zeros((len(limits) + 2, tensions.size)), np.zeros(before.shape)
        ends[1:-1] = np.take_along_axis(limits, order, axis=0)
        ends[-1] = 1e3 * np.maximum(ends[-2], tensions) + 1.0
        let_out = np.take_along_axis(np.concatenate([weights / remaining, zeros]), order, axis=0)
        drawn_in = np.take_along_axis(np.concatenate([zeros, weights * remaining]), order, axis=0)
        slopes, integrals = np.zeros(ends[1:].shape), np.zeros(ends.shape)
        slopes[:-1] = let_out[::-1].cumsum(axis=0)[::-1]
        slopes[1:] += drawn_in.cumsum(axis=0)
        np.cumsum(slopes * np.diff(ends, axis=0), axis=0, out=integrals[1:])
        self._last_integrals = before, angle, ends, integrals
        return ends, integrals

    def angles(self, z: FloatArray, tensions: FloatArray, work: Work) -> FloatArray:
        """Return theta (N, J) of tendons under ``tensions`` (N, J) [N] at twists ``z`` (N, m)."""
        self._angles(self.tables, z, tensions, work)
        return work.angle.copy()

    def history(self, local: LocalTensions, tensions: FloatArray) -> FloatArray:
        """Return tensions (M, J) at the fine points, with ``tensions`` (J,) at the base."""
        if local.band is not None:
            return local.band.tensions
        angle = self.spread(self.tables.to_fine, local.angle)
        return np.asarray(tensions * self.reach * np.exp(-self.tables.friction * angle))


def _interpolated(x: FloatArray, places: FloatArray, values: FloatArray) -> FloatArray:
    """Interpolate ``values`` (k, J) between ``places`` (k, J) at ``x`` (J,), column by column."""
    number = np.clip((places <= x).sum(axis=0), 1, len(places) - 1), np.arange(x.size)
    last = number[0] - 1, number[1]
    start, size = places[last], np.maximum(places[number] - places[last], 1e-300)
    part = np.clip((x - start) / size, 0.0, 1.0)
    return np.asarray(values[last] + part * (values[number] - values[last]))


class TensionDerivatives:
    """Derivatives of local tensions, at a fixed slip or stick of every point.

    An angle depends on its own element up to the node, and on the whole of the elements before. So
    derivatives of angles are (E, J, p + 1, p, ...): by the p nodes of an element, of the angles
    from its start to each of them and to its end. These J are the tendons under tension; elsewhere
    J are all tendons.
    """

    def __init__(
        self, friction: Friction, z: FloatArray, local: LocalTensions, tendons: Tendons, work: Work
    ) -> None:
        """Linearise about ``tendons`` with tensions ``local`` in an arm of twists ``z`` (N, m)."""
        self._slide(friction, local)
        self._z, self._work = z, work
        pulled = np.flatnonzero(local.tensions.any(axis=0))
        self._pulled = pulled if pulled.size else np.array([0])  # arrays need one tendon
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
            coupling = self._by_all_nodes((self._by_e * by_tension).sum(axis=0))
            try:
                self._inverse = np.asarray(np.linalg.inv(np.eye(len(z)) - coupling))
            except np.linalg.LinAlgError:  # a strain is impossible
                raise ConvergenceError(
                    'the tension of tendons in their sheaths', np.inf, 0
                ) from None

    def _slide(self, friction: Friction, local: LocalTensions) -> None:
        """Find the slip of tendons with tensions ``local``, at the nodes or at the fine points."""
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
        """Check that tensions have derivatives, under ``tensions`` (J,) [N] at the base.

        ``names`` are the names of the tendons, for the error.

        Raises:
            SolveError: if a tendon that is pulled sticks anywhere, slips both ways, or is so
                straight that turning it either way makes it lose tension.
        """
        rubs = (tensions > 0.0) & (self._tables.friction > 0.0)
        acts, slip = self._tension > 0.0, self._slip
        straight = self._are_straight()
        for state, places, fails in (
            ('sticks', self._s, acts & (slip == 0.0)),
            ('slips both ways', self._s, acts & (slip != slip[0])),
            ('is straight', self._friction.nodes, straight & (self._tables.reach > 0.0)),
        ):
            if (fails & rubs).any():
                place, tendon = np.unravel_index(int(np.argmax(fails & rubs)), fails.shape)
                raise SolveError(
                    f'no derivatives: with friction, {names[tendon]} of {tensions[tendon]:.4g} N '
                    f'{state} at s = {places[place]:.4g} m, expected one that slides and turns '
                    'all along'
                )

    def _are_straight(self) -> BoolArray:
        """Whether tendons are straight at the nodes, (N, J)."""
        straight = np.zeros(self._tables.reach.shape, np.bool_)
        straight[:, self._pulled] = self._rate <= _STRAIGHT / self._friction.fine.edges[-1]
        return straight

    def add_to(self, jacobian: FloatArray) -> None:
        """Add the effect of changing tensions to a ``jacobian`` (N m, N m) at fixed tensions."""
        parts = self._by_z
        if self._inverse is not None:
            rates = self._inverse @ self._by_all_nodes(parts)
            jacobian += (self._pull @ rates.swapaxes(0, 1)).reshape(jacobian.shape)
            return
        elements, tendons, _, size = parts.shape
        pull = self._pull.reshape(elements, -1, self._pull.shape[1], tendons)
        inside = pull @ (self._by_angle @ parts[:, :, :-1]).swapaxes(1, 2)
        # Beyond an element all angles change by the same amount.
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
        # A slack tendon can only be drawn in next.
        slip = np.where(self._tension > 0.0, self._slip, -1.0)
        return self._at_nodes(np.abs(slip) * np.exp(slip * loss))

    @property
    def by_friction(self) -> FloatArray:
        """Derivative by each tendon's own mu [N], (N, J)."""
        angle = self._friction.spread(self._to_points, self._local.angle)
        return self._at_nodes(self._slip * angle * self._tension)

    def by_unit(self, change: FloatArray) -> FloatArray:
        """Return the change (N, J) of tensions by a ``change`` (3, N, J) of e with the paths."""
        tangent = self._by_element(change[..., self._pulled])
        return self._of_angles((self._by_e * tangent).sum(axis=(0, -1))[..., np.newaxis])[..., 0]

    def by_twists(self, change: FloatArray) -> FloatArray:
        """Return the changes (N, J, k) by a ``change`` (N, m, k) of twists, T_0 fixed."""
        rows = change.reshape(len(self._by_z), 1, -1, change.shape[2])
        return self._of_angles(self._by_z @ rows)

    def _angles(self) -> FloatArray:
        """Return all angles, also those of slack tendons, which matter once these are pulled."""
        tensions = self._local.tensions
        if tensions.any(axis=0).all():
            return self._local.angle
        return self._friction.angles(self._z, np.maximum(tensions, _LEAST), self._work)

    def _angle_derivatives(self, tendons: Tendons) -> tuple[FloatArray, FloatArray]:
        """Return theta_e and theta_kappa of (4), (3, E, J, p + 1, p) each."""
        tables, e = self._tables, tendons.unit[..., self._pulled]
        bends = Bends(tables, self._z, e, tables.reach[:, self._pulled])
        self._rate, by_c = bends.rate, self._by_bends(bends)
        by_kappa = np.cross(self._by_element(e), by_c, axis=0)
        by_e = (
            by_c @ tables.differentiation / tables.lengths[:, np.newaxis, np.newaxis, np.newaxis]
        )
        by_e += np.cross(by_c, self._by_element(self._z[:, :3].T[..., np.newaxis]), axis=0)
        # The jump at the start of an element counts at all of its nodes; the one at its end does
        # not.
        square = (bends.kink * bends.kink).sum(axis=0)
        by_jump = _direction(bends.kink) / np.sqrt(np.maximum(1.0 - 0.25 * square, 1e-12))
        by_jump = by_jump[..., np.newaxis]
        by_e += (by_jump * tables.ends[0])[:, :, :, np.newaxis]
        by_e[:, :-1, :, -1] -= by_jump[:, 1:] * tables.ends[1]
        return by_e, by_kappa

    def _by_bends(self, bends: Bends) -> FloatArray:
        """Return the derivative of the integral in (1) by c, (3, E, J, p + 1, p)."""
        tables, lengths = self._tables, self._tables.lengths[:, np.newaxis, np.newaxis]
        element_weights = tables.weights[: len(tables.to_end)] / tables.lengths[0]
        weights = np.append(tables.to_point, [element_weights], axis=0) * lengths
        derivative = weights[:, np.newaxis] * self._by_element(_direction(bends.bend))
        e, j = np.nonzero(bends.is_rough)
        fine = _direction(self._by_element(bends.bend)[:, e, j] @ tables.to_fine.T)
        derivative[:, e, j] = lengths[e] * ((tables.fine_weights * fine) @ tables.to_fine)
        return np.asarray(derivative)

    def _by_element(self, values: FloatArray) -> FloatArray:
        """Reshape ``values`` (..., E k, J) to (..., E, J, 1, k)."""
        elements = self._tables.lengths.size
        rows = values.reshape(*values.shape[:-2], elements, 1, -1, values.shape[-1])
        return np.ascontiguousarray(rows.swapaxes(-1, -2).swapaxes(-2, -3))

    def _at_nodes(self, values: FloatArray) -> FloatArray:
        """Return the change (N, J) of tensions if a quantity adds ``values`` (M, J) to (3)."""
        return self._solved(self._tables.reach * self._friction.spread(self._to_nodes, values))

    def _by_all_nodes(self, parts: FloatArray) -> FloatArray:
        """Return S times the angles that change by ``parts`` (E, J, p + 1, p k), (J, N, N k)."""
        elements, tendons, points = *parts.shape[:2], parts.shape[2] - 1
        inside = self._by_angle @ parts[:, :, :-1]
        beyond = self._by_angle.sum(axis=-1).swapaxes(0, 1)[..., np.newaxis]
        derivative = np.zeros((tendons, elements, points, elements, parts.shape[3]))
        for e in range(elements):
            derivative[:, e, :, e] = inside[e]
            derivative[:, e + 1 :, :, e] = beyond[:, e + 1 :] * parts[e, :, np.newaxis, -1:]
        return derivative.reshape(tendons, elements * points, -1)

    def _of_angles(self, parts: FloatArray) -> FloatArray:
        """Return changes of tensions (N, J, k) if angles change by ``parts`` (E, J, p + 1, k)."""
        whole = parts[:, :, -1:]
        within = self._by_angle @ (parts[:, :, :-1] + (whole.cumsum(axis=0) - whole))
        change = np.zeros((*self._local.tensions.shape, parts.shape[3]))
        change[:, self._pulled] = within.swapaxes(1, 2).reshape(len(change), -1, parts.shape[3])
        return self._solved(change)

    def _solved(self, right: FloatArray) -> FloatArray:
        """Return dT of (5) for its right-hand side ``right`` (N, J, ...), which is overwritten."""
        if self._inverse is not None:
            pulled = right[:, self._pulled].swapaxes(0, 1)
            rows = self._inverse @ pulled.reshape(*pulled.shape[:2], -1)
            right[:, self._pulled] = rows.reshape(pulled.shape).swapaxes(0, 1)
        return right


def _direction(vectors: FloatArray) -> FloatArray:
    """Return ``vectors`` (3, ...) over their lengths; zero where they are zero."""
    size = np.sqrt((vectors * vectors).sum(axis=0))
    return np.divide(vectors, size, out=np.zeros_like(vectors), where=size > 0.0)
