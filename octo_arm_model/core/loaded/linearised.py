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
from octo_arm_model.core.numerics.vectors import skew

_BAND = 8  # rows and columns from the diagonal that two neighbouring ends reach
_MIDDLE = 2 * _BAND  # row of the diagonal in a band as LAPACK has it
# Phi_1 - Phi_0 = ..., d m_0 - d m_1 = ...; unknowns Phi_0, m_0, Phi_1, m_1.
_ENDS = np.hstack([np.diag([-1.0] * 3 + [1.0] * 3), np.diag([1.0] * 3 + [-1.0] * 3)])


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
    their axes a and by what couples them to curvatures.

    Attributes:
        axial: factors of the Hessian of the energy by the linear strains, (n, n, arms, points).
        matrix: of each element, from k to what Phi at its first end and d m at its last leave,
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
    ) -> None:
        """Factorise.

        ``hessian`` (n, n, ..., points) of the energy by the twist, ``rotation`` (3, 3, ...,
        points), ``tangent`` u' (3, ..., points), ``moment`` and ``force`` in base_frame (3, ...,
        points). Moments are measured in ``unit`` [N m], so that all equations are of one size.

        Raises:
            ConvergenceError: if the system is singular.
        """
        self._collocation, self._unit = collocation, unit
        # From here on by arm and point of it, for one arm too.
        by_arm = -1, collocation.s.size
        hessian = hessian.reshape(*hessian.shape[:2], *by_arm)
        self._rotation = rotation = rotation.reshape(3, 3, *by_arm)
        tangent, moment, force = (x.reshape(3, *by_arm) for x in (tangent, moment, force))
        axes = rotation[:, : len(hessian) - 3]
        self.axial = factorise(hessian[3:, 3:])
        self._small = invert(self.axial)
        turned = np.einsum('ijan,jkan->ikan', rotation, hessian[:3])
        across = np.einsum('jian,jkan->ikan', skew(force), axes)
        self._rows = rows = np.concatenate([across, -turned[:, 3:]])
        self._stretched = np.einsum('ikan,klan->ilan', rows, self._small)
        condensed = np.einsum('ikan,jkan->ijan', self._stretched, rows)
        bending = np.einsum('ikan,jkan->ijan', turned[:, :3], rotation)
        bending -= condensed[3:, 3:]
        # n x (u' x Phi) = u' (n . Phi) - Phi (n . u').
        by_turn = -condensed[:3, :3] - tangent[:, np.newaxis] * force
        by_turn.reshape(9, *by_arm)[::4] += np.add.reduce(tangent * force)
        follow = skew(moment) + condensed[3:, :3]
        self._factorise(by_turn, condensed[:3, 3:], follow, bending)

    def _factorise(
        self, by_turn: FloatArray, by_bend: FloatArray, follow: FloatArray, bending: FloatArray
    ) -> None:
        """Of what Phi and k do to d m' and k at the points, each (3, 3, ..., points)."""
        rule, h = self._collocation.rule, self._collocation.step[:, np.newaxis]
        turn, bend = (self._collocation.by_element(x) * h for x in (by_turn, by_bend))
        follow = self._collocation.by_element(follow)
        arms, elements, points = turn.shape[2:]
        system = ((turn * h) @ self._collocation.twice).reshape(*turn.shape, points)
        system -= rule.to_end * bend[..., np.newaxis, :]
        system -= rule.from_start * (follow * h)[..., np.newaxis]
        diagonal = system.reshape(*turn.shape[:-1], -1)[..., :: points + 1]
        diagonal += self._collocation.by_element(bending)
        # Rows (row, point), columns (column, point).
        matrix = system.transpose(2, 3, 0, 4, 1, 5)
        self.matrix = matrix.reshape(arms, elements, 3 * points, 3 * points)
        try:
            self._inverse = np.linalg.inv(self.matrix)
        except np.linalg.LinAlgError:
            raise _singular() from None
        # k by Phi at the first end and by d m at the last.
        sides = np.zeros((arms, elements, 3, points, 6))
        sides[..., :3] = (follow - turn @ rule.to_end.T).transpose(2, 3, 0, 4, 1)
        for i in range(3):
            sides[..., i, :, 3 + i] = self._unit
        bends = self._inverse @ sides.reshape(arms, elements, 3 * points, 6)
        self._bends = bends
        # From k to d m at the first end.
        before = (turn * h) @ (rule.weights[:, np.newaxis] * rule.from_start) - bend * rule.weights
        before = before.transpose(2, 3, 0, 1, 4).reshape(arms, elements, 3, 3 * points)
        self._before = before / -self._unit
        # From Phi at the first end and d m at the last to Phi at the last and d m at the first.
        self.ends = np.concatenate([self._turned(bends), self._before @ bends], axis=2)
        self.ends[..., 3:, :3] -= (turn @ rule.weights).transpose(2, 3, 0, 1) / self._unit
        self._link()

    def _turned(self, bends: FloatArray) -> FloatArray:
        """Change of Phi along elements, (arms, elements, 3, columns), by k at their points."""
        rule, h = self._collocation.rule, self._collocation.step[:, np.newaxis, np.newaxis]
        *lead, count, columns = bends.shape
        by_row = bends.reshape(*lead, 3, count // 3, columns)
        return np.asarray(h * (rule.weights @ by_row))

    def _link(self) -> None:
        """Factorise the banded system of Phi and d m at all ends of elements of all arms."""
        arms, elements = self.ends.shape[:2]
        size = 6 * (elements + 1)
        blocks = np.empty((arms, elements, *_ENDS.shape))
        blocks[...] = _ENDS
        blocks[..., :3] -= self.ends[..., :3]
        blocks[..., 9:] -= self.ends[..., 3:]
        band = np.zeros((arms, size, 3 * _BAND + 1))
        band[:, [0, 1, 2, size - 3, size - 2, size - 1], _MIDDLE] = 1.0
        places = _places(elements)
        band.reshape(arms, -1)[:, places] = blocks.reshape(arms, -1)
        factors, pivots, singular = dgbtrf(
            band.reshape(-1, 3 * _BAND + 1).T, _BAND, _BAND, overwrite_ab=True
        )
        if singular:
            raise _singular()
        self._band = factors.T.reshape(band.shape)
        # Pivots of each arm are numbers of its own rows.
        self._pivots = pivots.reshape(arms, size) - _first_rows(arms, size)

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
        rule, h = self._collocation.rule, self._collocation.step[:, np.newaxis]
        arms, elements, rows, _ = self._inverse.shape
        strains, points = len(imbalance), imbalance.shape[-1]
        given = imbalance.reshape(strains, -1, arms, points)
        columns = given.shape[1]
        stretched = np.einsum('ikan,kcan->ican', self._stretched, given[3:])
        carried = self._collocation.by_element(stretched[:3]) * -h
        sides = np.einsum('ijan,jcan->ican', self._rotation, given[:3]) + stretched[3:]
        sides = self._collocation.by_element(sides) - carried @ rule.to_end.T
        # (3, columns, arms, elements, points) to one system for each element.
        sides = sides.transpose(2, 3, 0, 4, 1).reshape(arms, elements, rows, columns)
        bends = self._inverse @ sides
        right = np.zeros((arms, 6 * (elements + 1), columns))
        ends = right[:, 3:-3].reshape(arms, elements, 6, columns)
        ends[:, :, :3] = self._turned(bends)
        ends[:, :, 3:] = self._before @ bends
        ends[:, :, 3:] -= (carried @ rule.weights).transpose(2, 3, 0, 1) / self._unit
        found, _ = dgbtrs(
            self._band.reshape(-1, 3 * _BAND + 1).T, _BAND, _BAND, right.reshape(-1, columns),
            (self._pivots + _first_rows(*self._pivots.shape)).ravel(),
        )  # fmt: skip
        ends = found.reshape(arms, elements + 1, 6, columns)
        bends += self._bends @ np.concatenate([ends[:, :-1, :3], ends[:, 1:, 3:]], axis=2)
        k = bends.reshape(arms, elements, 3, -1, columns).transpose(2, 4, 0, 1, 3)
        turn = h * (k @ rule.from_start.T)
        turn += ends[:, :-1, :3].transpose(2, 3, 0, 1)[..., np.newaxis]
        moved = np.concatenate([turn, k]).reshape(6, columns, arms, -1)
        twist = np.empty(given.shape)
        np.einsum('jian,jcan->ican', self._rotation, moved[3:], out=twist[:3])
        linear = given[3:] + np.einsum('ikan,ican->kcan', self._rows, moved)
        np.einsum('klan,lcan->kcan', self._small, linear, out=twist[3:])
        return Response(twist.reshape(imbalance.shape), moved[:3].reshape(3, *imbalance.shape[1:]))

    def of(self, arms: IntArray) -> Linearised:
        """The systems of some ``arms`` of several, or that of all of them."""
        if len(self.matrix) == 1:
            return self
        part = copy.copy(self)
        for name in ('_rotation', '_rows', '_stretched', '_small', 'axial'):
            setattr(part, name, getattr(self, name)[:, :, arms])
        for name in ('matrix', '_inverse', '_bends', '_before', 'ends', '_band', '_pivots'):
            setattr(part, name, getattr(self, name)[arms])
        return part


def _first_rows(arms: int, size: int) -> IntArray:
    """The first of the ``size`` rows of each arm in the system of all, (arms, 1)."""
    return np.arange(0, arms * size, size)[:, np.newaxis]


@functools.cache
def _places(elements: int) -> IntArray:
    """Where the rows of all ``elements`` are in the band of an arm, (elements, 6, 12)."""
    row, column = np.indices((6, 12))
    first = 6 * np.arange(elements)[:, np.newaxis, np.newaxis]
    return ((first + column) * (3 * _BAND + 1) + _MIDDLE + 3 + row - column).ravel()


def _singular() -> ConvergenceError:
    return ConvergenceError('the balance under load', np.inf, 0)
