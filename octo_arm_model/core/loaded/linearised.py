"""The linearised equilibrium: changes of a rod under small wrenches, as one factorised system.

Small rotations Phi of the cross sections, k = Phi' and changes d of u', all in base_frame, obey

    k = H^-1 (d m + m x Phi + ...)    d = C k + D Phi + ...    d m' = n x (d - u' x Phi)

with the wrench (m, n) and the stiffness of the cross section. Collocated, k at the points of an
element follow from Phi at its end towards the base and d m at the other; a banded system links
the elements. Unlike in a shooting method, errors are not amplified along the arm.
"""

from __future__ import annotations

import copy
import functools
from typing import NamedTuple, Protocol

import numpy as np
from scipy.linalg.lapack import dgbtrf, dgbtrs

from octo_arm_model.core.errors import ConvergenceError
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.loaded.collocation import Collocation
from octo_arm_model.core.numerics.batched_ldlt import factorise, invert
from octo_arm_model.core.numerics.gauss import gauss_rule
from octo_arm_model.core.numerics.inverses import inverses
from octo_arm_model.core.numerics.vectors import skew

_BAND = 8  # rows and columns from the diagonal that two neighbouring ends reach
_MIDDLE = 2 * _BAND  # row of the diagonal in a band as LAPACK has it
_RIGID, _ONE = -np.eye(6), np.eye(3)[:, np.newaxis]


class Response(NamedTuple):
    """Small changes of a rod.

    Attributes:
        twist: in the axes of the cross sections, (4 or 6, columns, points).
        turn: rotation in base_frame, (3, columns, points) [rad].
    """

    twist: FloatArray
    turn: FloatArray


class System(Protocol):
    """The linearised equilibrium near a state."""

    @property
    def sign(self) -> int:
        """Sign of its determinant, 1 or -1."""

    def solve(self, imbalance: FloatArray) -> Response:
        """Response to small ``imbalance`` (n, columns, points)."""


class TipAnswer(NamedTuple):
    """Response of a rod to unit forces, and unit moments over its length, on its tip.

    Attributes:
        compliance: work of each on the change that each makes, (6, 6).
        twist: the changes, (4 or 6, 6, points).
        sign: of the determinant of the system, over that without loads, 1 or -1.
        is_definite: whether the symmetric part of the compliance is positive definite.
    """

    compliance: FloatArray
    twist: FloatArray
    sign: int
    is_definite: bool


class Linearised:
    """The linearised equilibrium about one state, or about those of several arms.

    Linear strains follow from rotations and curvatures at the same point, by the rows (a x n) for
    their axes a and by what couples them to curvatures. The unknowns are the curvatures at the
    points, times the length h of their element.

    Attributes:
        hessian: of the energy by the twist, as given, (n, n, arms, points).
        axial: factors of the Hessian of the energy by the linear strains, (n, n, arms, points).
        matrix: of each element, from h k to what Phi at its first end and d m at its last leave,
            (arms, elements, 3 each, 3 each).
        ends: how much Phi at the last end of each element exceeds that at the first, and d m at
            the first that at the last, by Phi at the first and d m at the last, (arms, elements,
            6, 6).
    """

    def __init__(
        self,
        collocation: Collocation,
        hessian: FloatArray,
        rotation: FloatArray,
        tangent: FloatArray,
        moment: FloatArray,
        force: FloatArray,
        unit: float,
        near: Linearised | None = None,
    ) -> None:
        """Factorise.

        ``hessian`` (n, n, ..., points) of the energy by the twist, ``rotation`` (3, 3, ...,
        points), ``tangent`` u' (3, ..., points), ``moment`` and ``force`` in base_frame (3, ...,
        points). Moments are measured in ``unit`` [N m], so that all equations are of one size.
        From the system of a state ``near`` inverses of elements follow in less time, to about
        1e-12: enough for Newton's method, not for derivatives.

        Raises:
            ConvergenceError: if the system is singular.
        """
        self._collocation, self._unit = collocation, unit
        self._weights = collocation.rule.weights / unit
        # From here on by arm and point of it, for one arm too.
        by_arm = -1, collocation.s.size
        self.hessian = hessian = hessian.reshape(*hessian.shape[:2], *by_arm)
        rotation = rotation.reshape(3, 3, *by_arm)
        tangent, moment, force = (x.reshape(3, *by_arm) for x in (tangent, moment, force))
        self.axial = factorise(hessian[3:, 3:])
        self._small = invert(self.axial)
        turned = np.einsum('ijan,jkan->ikan', rotation, hessian[:3])
        across = np.einsum('jian,jkan->ikan', skew(force), rotation[:, : len(hessian) - 3])
        rows = np.concatenate([across, -turned[:, 3:]])
        # What wrenches in the axes of cross sections do to h d m' and to the balance of moments.
        self._given = given = np.zeros((6, *hessian.shape[1:]))
        given[3:, :3] = rotation
        np.einsum('ikan,klan->ilan', rows, self._small, out=given[:, 3:])
        # What Phi and k do to d m' and to that balance.
        form = np.einsum('ikan,jkan->ijan', given[:, 3:], -rows)
        by_turn, follow, bending, carried = form[:3, :3], form[3:, :3], form[3:, 3:], given[:3, 3:]
        bending += np.einsum('ikan,jkan->ijan', turned[:, :3], rotation)
        # n x (u' x Phi) = u' (n . Phi) - Phi (n . u').
        by_turn -= tangent[:, np.newaxis] * force
        form.reshape(36, *by_arm)[:15:7] += np.add.reduce(tangent * force)
        follow -= skew(moment)
        # By Phi and h k.
        by_turn *= collocation.steps
        bending /= collocation.steps
        carried *= collocation.steps
        self._factorise(form, near)

    def _factorise(self, form: FloatArray, near: Linearised | None) -> None:
        """Of what Phi and h k do to h d m' and to the balance of moments, (6, 6, arms, points)."""
        own, points, unit = self._collocation, self._collocation.rule.points.size, self._unit
        sums, turned = _sums(points)
        form = own.by_element(form.reshape(2, 3, 2, 3, *form.shape[2:]))
        form = np.ascontiguousarray(form.transpose(4, 5, 1, 3, 0, 2, 6))
        arms, elements = form.shape[:2]
        # By row and column of each element, (arms, elements, 3, 3, ...).
        # Element by element: BLAS would share one product of all among its threads.
        found = (form.reshape(arms, elements, 9, -1) @ sums).reshape(*form.shape[:4], -1)
        size, square = 3 * points, points * points
        matrix = found[..., :square].reshape(*form.shape[:4], points, points)
        self.matrix = matrix.swapaxes(3, 4).reshape(arms, elements, size, size)
        try:
            self._inverse: FloatArray = inverses(
                self.matrix, None if near is None else near._inverse
            )
        except np.linalg.LinAlgError:
            raise _singular() from None
        # h k by Phi at the first end and by d m at the last.
        by_ends = np.empty((arms, elements, 3, points, 6))
        by_ends[..., :3] = found[..., square : square + points].swapaxes(3, 4)
        np.multiply(_ONE, unit, out=by_ends[..., 3:])
        self._bends = bends = self._inverse @ by_ends.reshape(arms, elements, size, 6)
        # From h k to Phi at the last end and d m at the first.
        self._to_ends = np.empty((arms, elements, 6, size))
        self._to_ends[:, :, :3] = turned
        to_first = found[..., square + points : -1].reshape(arms, elements, 3, size)
        np.divide(to_first, unit, out=self._to_ends[:, :, 3:])
        # From Phi at the first end and d m at the last to Phi at the last and d m at the first.
        self.ends = self._to_ends @ bends
        self.ends[..., 3:, :3] += found[..., -1] / unit
        self._link()

    def _link(self) -> None:
        """Factorise the banded system of Phi and d m at all ends of elements of all arms."""
        arms, elements = self.ends.shape[:2]
        rigid, places = _band(elements)
        band = np.empty((arms, *rigid.shape))
        band[:] = rigid
        band.reshape(arms, -1)[:, places] = (_RIGID - self.ends).reshape(arms, -1)
        factors, pivots, singular = dgbtrf(
            band.reshape(-1, 3 * _BAND + 1).T, _BAND, _BAND, overwrite_ab=True
        )
        if singular:
            raise _singular()
        self._band = factors.T.reshape(band.shape)
        # Pivots of each arm are numbers of its own rows.
        self._pivots = pivots.reshape(arms, -1) - _first_rows(arms, len(rigid))

    @functools.cached_property
    def _linked(self) -> tuple[FloatArray, IntArray]:
        """Factors and pivots of the banded system of all arms, as LAPACK has them."""
        pivots = self._pivots + _first_rows(*self._pivots.shape)
        return self._band.reshape(-1, 3 * _BAND + 1).T, pivots.ravel()

    @property
    def signs(self) -> IntArray:
        """Sign of the determinant of the whole system of each arm, 1 or -1."""
        odd = np.count_nonzero(self._pivots != np.arange(self._pivots.shape[1]), axis=1)
        odd += np.count_nonzero(self._band[..., _MIDDLE] < 0.0, axis=1)
        odd += np.count_nonzero(np.linalg.slogdet(self.matrix)[0] < 0.0, axis=1)
        return np.asarray(1 - 2 * (odd % 2))

    @property
    def sign(self) -> int:
        """That of one arm."""
        return int(self.signs[0])

    def solve(self, imbalance: FloatArray) -> Response:
        """Response to small ``imbalance`` (n, columns, ..., points), in axes of cross sections.

        The system of one arm also responds for several, each of one column.
        """
        own, rule = self._collocation, self._collocation.rule
        arms, elements, rows, _ = self._inverse.shape
        given = imbalance.reshape(len(imbalance), -1, arms, imbalance.shape[-1])
        columns = given.shape[1]
        by_point = 2, 3, columns, arms, elements, rule.points.size
        carried, sides = np.einsum('ikan,kcan->ican', self._given, given).reshape(by_point)
        sides += carried @ rule.to_end.T
        # To one system for each element.
        sides = sides.transpose(2, 3, 0, 4, 1).reshape(arms, elements, rows, columns)
        bends = self._inverse @ sides
        right = np.zeros((arms, 6 * (elements + 1), columns))
        ends = right[:, 3:-3].reshape(arms, elements, 6, columns)
        np.matmul(self._to_ends, bends, out=ends)
        moment = ends[:, :, 3:]
        moment += (carried @ self._weights).transpose(2, 3, 0, 1)
        band, pivots = self._linked
        found, _ = dgbtrs(band, _BAND, _BAND, right.reshape(-1, columns), pivots)
        changes = found.reshape(arms, elements + 1, 6, columns)
        bends += self._bends @ found.reshape(arms, -1, columns).take(_ends(elements), axis=1)
        moved: FloatArray = np.empty(by_point)
        moved[1] = bends.reshape(arms, elements, 3, -1, columns).transpose(2, 4, 0, 1, 3)
        turn = np.matmul(moved[1], rule.from_start.T, out=moved[0])
        turn += changes[:, :-1, :3].transpose(2, 3, 0, 1)[..., np.newaxis]
        moved = moved.reshape(6, columns, arms, -1)
        twist = np.einsum('ikan,ican->kcan', self._given, moved)
        twist /= own.steps
        twist[3:] += np.einsum('klan,lcan->kcan', self._small, given[3:])
        return Response(twist.reshape(imbalance.shape), moved[:3].reshape(3, *imbalance.shape[1:]))

    def of(self, arms: IntArray) -> Linearised:
        """The systems of some ``arms`` of several, or that of all of them."""
        if len(self.matrix) == 1:
            return self
        part = copy.copy(self)
        part.__dict__.pop('_linked', None)
        for name in ('hessian', '_given', '_small', 'axial'):
            setattr(part, name, getattr(self, name)[:, :, arms])
        for name in ('matrix', '_inverse', '_bends', '_to_ends', 'ends', '_band', '_pivots'):
            setattr(part, name, getattr(self, name)[arms])
        return part


@functools.cache
def _first_rows(arms: int, size: int) -> IntArray:
    """The first of the ``size`` rows of each arm in the system of all, (arms, 1)."""
    return np.arange(0, arms * size, size)[:, np.newaxis]


@functools.cache
def _ends(elements: int) -> IntArray:
    """Unknowns of an arm that are Phi at the first and d m at the last end of each element."""
    own = np.array([0, 1, 2, 9, 10, 11])
    return own + 6 * np.arange(elements)[:, np.newaxis]


@functools.cache
def _sums(points: int) -> tuple[FloatArray, FloatArray]:
    """What the equations of an element of so many ``points`` are made from.

    From what Phi and k do to d m' and to the balance of moments, each, at the points, to what h k
    at each does to that balance at each, (points, points), and Phi at the first end, (points,); to
    what h k at each, (points,), and that Phi do to d m at that end. And from h k at the points,
    (3 points,), to how much more Phi is at the last end.
    """
    rule, one = gauss_rule(points), np.eye(points)
    sums = np.zeros((2, 2, points, points * points + 2 * points + 1))
    square, ends = np.split(sums, [points * points], axis=-1)
    square = square.reshape(2, 2, points, points, points)
    square[0, 0] = rule.to_end.T[:, :, np.newaxis] * rule.from_start[:, np.newaxis]
    square[0, 1] = np.einsum('pq,rq->rpq', rule.to_end, one)
    square[1, 0] = np.einsum('pq,rp->rpq', rule.from_start, one)
    square[1, 1] = np.einsum('rp,rq->rpq', one, one)
    weighted = rule.weights[:, np.newaxis] * rule.from_start
    ends[0, 0] = -np.hstack([rule.to_end.T, weighted, rule.weights[:, np.newaxis]])
    ends[0, 1, :, points:-1] = -np.diag(rule.weights)
    ends[1, 0, :, :points] = -one
    turned = np.kron(np.eye(3), rule.weights)
    return sums.reshape(4 * points, -1), turned.astype(np.float64)


@functools.cache
def _band(elements: int) -> tuple[FloatArray, IntArray]:
    """The band of an arm of so many ``elements``, and where in it -1 - `Linearised.ends` belong.

    Its rows are Phi_1 - Phi_0 = ... and d m_0 - d m_1 = ... of each element, between Phi = 0 at
    the base and d m = 0 at the tip; its unknowns Phi_0, m_0, Phi_1, m_1, ...
    """
    size, width = 6 * (elements + 1), 3 * _BAND + 1
    band, one = np.zeros((size, width)), np.arange(6)
    band[[0, 1, 2, size - 3, size - 2, size - 1], _MIDDLE] = 1.0
    first = 6 * np.arange(elements)[:, np.newaxis, np.newaxis]

    def places(row: IntArray, column: IntArray) -> IntArray:
        return ((first + column) * width + _MIDDLE + 3 + row - column).ravel()

    band.reshape(-1)[places(one, one + 6 * (one < 3))] = 1.0
    row, column = np.indices((6, 6))
    return band, places(row, column + 6 * (column > 2))


def _singular() -> ConvergenceError:
    return ConvergenceError('the balance under load', np.inf, 0)
