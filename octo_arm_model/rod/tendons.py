"""Tendons at the nodes: their stretch, and what it and their energy change by.

For a tendon of tension T on a path at r + d in the cross section, as in `loops`,

    u = (lambda, v_n, v_b) + w kappa x (r + d) + w r',    its energy T |u| + k |d|^2 / 2

is least by the offset d, so that k d + T p = 0 with p = d|u|/dd, and where p or T changes d does,
k D dd + d(T p) = 0. All then follows from one function: what changes where paths move.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.tables import Tables


class Stretch(NamedTuple):
    """Length of tendons per reference length of the arm, zero beyond the anchorages.

    Attributes:
        stretch: |u|, (N, J) [-].
        gradient: by the twist for a fixed offset in the sheath, which is that of the energy over
            the tension, (N, J, m).
        by_tension: by the tension at fixed twist [1/N], (N, J); zero without a sheath.
        length_by_z: by the twist at fixed tension, where the offset follows, (N, J, m): what a
            length changes by, and what the residual changes by per newton of local tension.
    """

    stretch: FloatArray
    gradient: FloatArray
    by_tension: FloatArray
    length_by_z: FloatArray


class Moved(NamedTuple):
    """What changes where paths move at fixed twist.

    Attributes:
        gradient: change of the gradient of the energy by the twist, (N, J, m).
        stretch: change of |u|, (N, J).
    """

    gradient: FloatArray
    stretch: FloatArray


def tendon_stretch(
    tables: Tables, z: FloatArray, tensions: FloatArray, offsets: FloatArray
) -> Stretch:
    """Of twists ``z`` (N, m) under local ``tensions`` (N, J) [N] with `Work.offsets`."""
    return Tendons(tables, z, tensions, offsets).stretch()


class Tendons:
    """All tendons at all nodes, at given twists. Indices inside: components first, then (N, J).

    Attributes:
        tension: local [N], zero beyond the anchorage, (N, J).
        width: radius over reference radius, w, (N, 1).
        slope: its derivative by the stretch, (N, 1).
        kappa: curvatures [1/m], (3, N, 1).
        scaled: the same times w.
        has_sheaths: whether any tendon can leave its path.
    """

    def __init__(
        self, tables: Tables, z: FloatArray, tensions: FloatArray, offsets: FloatArray
    ) -> None:
        """Of twists ``z`` (N, m) under local ``tensions`` (N, J) [N] with `Work.offsets`."""
        self._strains, self._compliance = z.shape[1], tables.compliance
        self.has_sheaths = bool(tables.compliance.any())
        columns = z.T[..., np.newaxis]
        stretch = columns[3]
        if tables.widens:
            self.width = 1.0 / np.sqrt(stretch)
            self.slope = -0.5 * self.width / stretch
        else:
            self.width, self.slope = np.ones_like(stretch), np.zeros_like(stretch)
        self.kappa = columns[:3]
        self.scaled = columns[:3] * self.width
        x, y, self._dx, self._dy = np.ascontiguousarray(tables.tendons.transpose(2, 0, 1))
        self.tension = tensions * tables.reach
        self._offsets = offsets.transpose(2, 0, 1)
        if self.has_sheaths:
            # Node functions leave those of tendons that nobody pulls as they were.
            self._offsets = self._offsets * (self.tension != 0.0)
            x, y = x + self._offsets[0], y + self._offsets[1]
        self._x, self._y = x, y
        u = self._across(x, y)
        u[0] += stretch
        u[1] += self.width * self._dx
        u[2] += self.width * self._dy
        if self._strains == 6:
            u[1:] += columns[4:]
        self._u, self._length = u, np.sqrt(np.einsum('anj,anj->nj', u, u))
        self._reach, self._size = tables.reach, self._length * tables.reach

    @property
    def stretches(self) -> FloatArray:
        """|u|, (N, J) [-], zero beyond the anchorages."""
        return self._size

    def stretch(self) -> Stretch:
        """`Stretch` of all tendons."""
        gradient = self._gradient
        if not self.has_sheaths:
            return Stretch(self._size, gradient, np.zeros_like(self._size), gradient)
        by_tension = self.moved(-self._answer(self._push))
        return Stretch(self._size, gradient, by_tension.stretch, gradient + by_tension.gradient)

    def by_sheath_stiffness(self) -> Moved:
        """Per pascal of every sheath; zero of a rigid one."""
        return self.moved(-self._answer(self._offsets))

    def by_offset(self, outwards: FloatArray) -> Moved:
        """Per metre of every tendon's distance from the midline.

        ``outwards`` (4, N, J) are the directions away from it along n and b [-] and their slopes
        [1/m], zero beyond the anchorages.
        """
        path, slopes = outwards[:2], outwards[2:]
        if self.has_sheaths:
            _, turned = self._turned(path, slopes)
            t, n, b = self.scaled
            push = np.stack([t * turned[2] - b * turned[0], n * turned[0] - t * turned[1]])
            path = path - self._answer(push)
        return self.moved(path, slopes)

    def moved(self, path: FloatArray, slopes: FloatArray | None = None) -> Moved:
        """What changes per unit where paths move along ``path`` (2, N, J), with ``slopes``."""
        along, turned = self._turned(path, slopes)
        found = self._by_strain(turned)
        f = self.tension * self._unit
        found[0] += path[0] * f[2] - path[1] * f[1]
        found[1] += path[1] * f[0]
        found[2] -= path[0] * f[0]
        if slopes is not None:
            found[3] += self.slope * (slopes[0] * f[1] + slopes[1] * f[2])
        return Moved(self._by_twist(found), along)

    @functools.cached_property
    def _unit(self) -> FloatArray:
        """U / |u|, zero beyond the anchorages, (3, N, J)."""
        return np.asarray(self._u * (self._reach / self._length))

    @functools.cached_property
    def _per_length(self) -> FloatArray:
        """T / |u|, (N, J)."""
        return np.asarray(self.tension / self._length)

    @functools.cached_property
    def _gradient(self) -> FloatArray:
        return self._by_twist(self._by_strain(self._unit))

    @functools.cached_property
    def _push(self) -> FloatArray:
        """p: derivative of |u| by the offset, (2, N, J)."""
        (t, n, b), (c_t, c_n, c_b) = self.scaled, self._unit
        return np.stack([t * c_b - b * c_t, n * c_t - t * c_n])

    def _across(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Cross product w kappa x r, (3, N, J)."""
        t, n, b = self.scaled
        found = np.empty((3, *x.shape))
        found[0], found[1], found[2] = n * y - b * x, -t * y, t * x
        return found

    def _turned(
        self, path: FloatArray, slopes: FloatArray | None
    ) -> tuple[FloatArray, FloatArray]:
        """Changes of |u| (N, J) and, times T, of u / |u| (3, N, J), where paths move."""
        u = self._across(*path)
        if slopes is not None:
            u[1:] += self.width * slopes
        along = np.einsum('anj,anj->nj', self._unit, u)
        u -= self._unit * along
        u *= self._per_length
        return along, u

    def _answer(self, push: FloatArray) -> FloatArray:
        """(k D)^-1 of a ``push`` (2, N, J), zero in rigid sheaths."""
        t, n, b = self.scaled
        p_n, p_b = self._push
        stiff = self._compliance * self._per_length
        nn = 1.0 + stiff * (b * b + t * t - p_n * p_n)
        nb = -stiff * (b * n + p_n * p_b)
        bb = 1.0 + stiff * (n * n + t * t - p_b * p_b)
        found = np.stack([bb * push[0] - nb * push[1], nn * push[1] - nb * push[0]])
        found *= self._compliance / (nn * bb - nb * nb)
        return found

    def _by_strain(self, f: FloatArray) -> FloatArray:
        """Products f . du/de of vectors ``f`` (3, N, J) with scaled strains, (m, N, J)."""
        found = np.empty((self._strains, *f.shape[1:]))
        found[0] = self._x * f[2] - self._y * f[1]
        found[1] = self._y * f[0]
        found[2] = -self._x * f[0]
        found[3] = f[0] + self.slope * (self._dx * f[1] + self._dy * f[2])
        found[4:] = f[1 : self._strains - 3]
        return found

    def _by_twist(self, g: FloatArray) -> FloatArray:
        """From a gradient (m, N, J) by the scaled strain to that by the twist, (N, J, m)."""
        g[3] += self.slope * (self.kappa * g[:3]).sum(axis=0)
        g[:3] *= self.width
        return g.transpose(1, 2, 0)
