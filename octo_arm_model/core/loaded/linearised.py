"""The linearised equilibrium: changes of a rod under small wrenches, as one factorised system.

Small rotations Phi of the cross sections, k = Phi' and changes d of u', all in base_frame, obey

    k = H^-1 (d m + m x Phi + ...)    d = C k + D Phi + ...    d m' = n x (d - u' x Phi)

with the wrench (m, n) and the stiffness of the cross section. Collocated, k at the points of an
element follow from Phi at its end towards the base and d m at the other; a banded system links
the elements. Unlike in a shooting method, errors are not amplified along the arm.
"""

from __future__ import annotations

import functools
from typing import NamedTuple, Protocol

import numpy as np
from scipy.linalg.lapack import dgbtrf, dgbtrs

from octo_arm_model.core.errors import ConvergenceError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.collocation import Collocation
from octo_arm_model.core.numerics.batched_ldlt import factorise, invert
from octo_arm_model.core.numerics.vectors import cross, skew

_BAND = 8  # rows and columns from the diagonal that two neighbouring ends reach


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
    """The linearised equilibrium about one state."""

    def __init__(
        self,
        collocation: Collocation,
        hessian: FloatArray,
        rotation: FloatArray,
        tangent: FloatArray,
        moment: FloatArray,
        force: FloatArray,
        unit: float,
    ) -> None:
        """Factorise.

        ``hessian`` (n, n, points) of the energy by the twist, ``rotation`` (3, 3, points),
        ``tangent`` u' (3, points), ``moment`` and ``force`` in base_frame (3, points).
        Moments are measured in ``unit`` [N m], so that all equations are of one size.

        Raises:
            ConvergenceError: if the system is singular.
        """
        self._collocation, self._rotation, self._force = collocation, rotation, force
        self._unit = unit
        axes = rotation[:, : len(hessian) - 3]
        self._small = small = invert(factorise(hessian[3:, 3:]))
        # The linear strains follow from rotation and curvature, in base_frame.
        self._mixed = np.einsum('ijn,jkn->ikn', rotation, hessian[:3, 3:])
        coupling = np.einsum('ikn,kln->iln', self._mixed, small)
        self._coupling = coupling
        self._compliance = np.einsum('ikn,kln->iln', axes, small)
        bending = hessian[:3, :3] - np.einsum(
            'ikn,kln,jln->ijn', hessian[:3, 3:], small, hessian[:3, 3:], optimize=False
        )
        bending = np.einsum('ijn,jkn,lkn->iln', rotation, bending, rotation, optimize=False)
        # n x Phi along the axes: (axes x n) . Phi.
        self._across = cross(axes, np.broadcast_to(force[:, np.newaxis], axes.shape))
        carry = skew(force)
        by_turn = np.einsum('ikn,jkn->ijn', self._compliance, self._across) - skew(tangent)
        by_turn = np.einsum('ijn,jkn->ikn', carry, by_turn)
        by_bend = np.einsum('ijn,jkn,lkn->iln', carry, axes, coupling, optimize=False)
        follow = skew(moment) - np.einsum('ikn,jkn->ijn', coupling, self._across)
        self._by_turn, self._by_bend, self._follow = by_turn, by_bend, follow
        self._factorise(bending)

    def _factorise(self, bending: FloatArray) -> None:
        own, rule, step = self._collocation, self._collocation.rule, self._collocation.step
        points, elements = rule.points.size, step.size
        h = step[:, np.newaxis]
        turn, bend, follow = (
            own.by_element(x) * h for x in (self._by_turn, self._by_bend, self._follow)
        )
        twice = (rule.to_end[:, :, np.newaxis] * rule.from_start).transpose(0, 2, 1)
        scaled = (turn * h).reshape(-1, points)
        system = (scaled @ twice.reshape(-1, points).T).reshape(3, 3, elements, points, points)
        system -= rule.to_end * bend[..., np.newaxis, :]
        system -= rule.from_start * follow[..., np.newaxis]
        index = np.arange(points)
        system[..., index, index] += own.by_element(bending)
        # Rows (row, point), columns (column, point).
        matrix = system.transpose(2, 0, 3, 1, 4).reshape(elements, 3 * points, 3 * points)
        try:
            self._inverse = np.linalg.inv(matrix)
        except np.linalg.LinAlgError:
            raise ConvergenceError('the balance under load', np.inf, 0) from None
        self._matrix = matrix
        # k by Phi at the first end and by d m at the last.
        by_first = own.by_element(self._follow) - turn @ rule.to_end.T
        ones = np.zeros((3, 3, elements, points))
        ones[[0, 1, 2], [0, 1, 2]] = self._unit
        sides = np.concatenate([by_first, ones], axis=1)
        sides = sides.transpose(2, 0, 3, 1).reshape(elements, 3 * points, 6)
        bends = (self._inverse @ sides).reshape(elements, 3, points, 6)
        self._bends = bends
        # Phi at the last end and d m at the first, by both.
        weights = rule.weights
        to_last = np.einsum('p,eipc->eic', weights, bends) * h[..., np.newaxis]
        self._to_moment = h * (
            np.einsum('pqej,jl->pqel', turn, weights[:, np.newaxis] * rule.from_start)
            - own.by_element(self._by_bend) * weights
        )
        to_first = -np.einsum('pqel,eqlc->epc', self._to_moment, bends)
        to_first[..., :3] -= np.einsum('pqej,j->epq', turn, weights)
        self._link(to_last, to_first / self._unit)

    def _link(self, to_last: FloatArray, to_first: FloatArray) -> None:
        """Factorise the banded system of Phi and d m at all ends of elements."""
        elements = len(to_last)
        size = 6 * (elements + 1)
        band = np.zeros((3 * _BAND + 1, size))
        blocks = np.zeros((elements, 6, 12))
        # Phi_1 = Phi_0 + ..., d m_0 = d m_1 + ...; unknowns Phi_0, m_0, Phi_1, m_1.
        blocks[:, :3, :3] = -to_last[..., :3]
        blocks[:, :3, 9:] = -to_last[..., 3:]
        blocks[:, 3:, :3] = -to_first[..., :3]
        blocks[:, 3:, 9:] = -to_first[..., 3:]
        for i in range(3):
            blocks[:, i, i] -= 1.0
            blocks[:, i, 6 + i] += 1.0
            blocks[:, 3 + i, 3 + i] += 1.0
            blocks[:, 3 + i, 9 + i] -= 1.0
        row, column = np.indices((6, 12))
        for number in range(elements):
            band[2 * _BAND + 3 + row - column, 6 * number + column] = blocks[number]
        for i in range(3):
            band[2 * _BAND, i] = 1.0
            band[2 * _BAND, size - 3 + i] = 1.0
        self._band, self._pivots, singular = dgbtrf(band, _BAND, _BAND, overwrite_ab=True)
        if singular:
            raise ConvergenceError('the balance under load', np.inf, 0)

    @functools.cached_property
    def sign(self) -> int:
        """Sign of the determinant of the whole system, 1 or -1."""
        exchanges = np.count_nonzero(self._pivots != np.arange(self._pivots.size))
        negative = np.count_nonzero(self._band[2 * _BAND] < 0.0)
        negative += np.count_nonzero(np.linalg.slogdet(self._matrix)[0] < 0.0)
        return 1 - 2 * int((exchanges + negative) % 2)

    def solve(self, imbalance: FloatArray) -> Response:
        """Response to small ``imbalance`` (n, columns, points), in the axes of cross sections."""
        own, rule, step = self._collocation, self._collocation.rule, self._collocation.step
        columns, count = imbalance.shape[1], own.s.size
        points, elements = rule.points.size, step.size
        h = step[:, np.newaxis]
        stretched = np.einsum('ikn,kcn->icn', self._compliance, imbalance[3:])
        sides = np.einsum('ijn,jcn->icn', self._rotation, imbalance[:3])
        sides -= np.einsum('ikn,kcn->icn', self._coupling, imbalance[3:])
        force = np.broadcast_to(self._force[:, np.newaxis], stretched.shape)
        carried = cross(force, stretched)
        carried = own.by_element(carried) * h
        sides = own.by_element(sides) - carried @ rule.to_end.T
        # (3, columns, elements, points) to one system for each element.
        sides = sides.transpose(2, 0, 3, 1).reshape(elements, 3 * points, columns)
        bends = (self._inverse @ sides).reshape(elements, 3, points, columns)
        last = np.einsum('p,eipc->eic', rule.weights, bends) * h[..., np.newaxis]
        first = -np.einsum('pqel,eqlc->epc', self._to_moment, bends)
        first -= (carried @ rule.weights).transpose(2, 0, 1)
        right = np.zeros((6 * (elements + 1), columns))
        right[3:-3] = np.concatenate([last, first / self._unit], axis=1).reshape(-1, columns)
        found, _ = dgbtrs(self._band, _BAND, _BAND, right, self._pivots)
        ends = found.reshape(-1, 6, columns)
        known = np.concatenate([ends[:-1, :3], ends[1:, 3:]], axis=1)
        bends += np.einsum('eipk,ekc->eipc', self._bends, known)
        by_element = bends.transpose(1, 3, 0, 2)
        turn = (
            h * (by_element @ rule.from_start.T)
            + ends[:-1, :3].transpose(1, 2, 0)[..., np.newaxis]
        )
        turn = turn.reshape(3, columns, count)
        k = by_element.reshape(3, columns, count)
        twist = np.empty_like(imbalance)
        twist[:3] = np.einsum('jin,jcn->icn', self._rotation, k)
        linear = imbalance[3:] + np.einsum('jkn,jcn->kcn', self._across, turn)
        linear -= np.einsum('jkn,jcn->kcn', self._mixed, k)
        twist[3:] = np.einsum('kln,lcn->kcn', self._small, linear)
        return Response(twist, turn)
