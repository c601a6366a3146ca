"""Tendons at the nodes: their paths and lengths, and the derivatives of both.

A tendon of tension T at the offset r + d in the cross section, d within its sheath, runs along

    u = (lambda, v_n, v_b) + U(r + d, r'),    U(r, r') = w (kappa x r + r'),    e = u / |u|    (1)

per reference length of the arm; w(lambda) is the widening, see `section_loops`. |u| is its
stretch, and d has the least energy T |u| + k |d|^2 / 2, whose gradient by the twist z is T g:

    k d + T p = 0,    p = A^T e,    A d = U(d, 0)                                              (2)
    g = e . (lambda, v_n, v_b)_z + G(e, r + d, r'),    G(e, r, r') = e . U_z(r, r')            (3)

Where something changes du by du|d at held offset, and the left side of (2) by f,

    du = du|d + A dd,    k D dd = -f,    D = 1 + T A^T P A / (k |u|),    P = 1 - e e^T         (4)
    d|u| = e . du,    de = P du / |u|,    dg = de . u_z|d + G(e, dr + dd, dr')                 (5)

    of z             du|d = (lambda, v_n, v_b)_z + U_z(r + d, r')    f = T (A^T de|d + A_z^T e)
    of T             0                                                   p
    of k             0                                                   d
    of a path r, r'  U(dr, dr')                                          T A^T de|d

As second derivatives of the energy are symmetric, |u|_z = g + T g_T.
"""

import functools
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.section_formulas import offset_stiffness, widening
from octo_arm_model.rod.tables import REST_T, Tables


class PathChange(NamedTuple):
    """Derivatives by a quantity of each tendon, for constant twists and other tendons."""

    unit: FloatArray  #: derivative of e, (3, N, J)
    stretch: FloatArray  #: derivative of |u|, (N, J)
    gradient: FloatArray  #: derivative of T g, the gradient of the energy by the twist, (N, J, m)


class Tendons:
    """All tendons at all nodes, for given twists.

    Private arrays are (..., c, N, J): derivatives by ... of c components at N nodes.

    Attributes:
        tension: local T [N], zero beyond the anchorage, (N, J).
        width: radius over reference radius, w, (N, 1).
        widening: derivative of the width by the stretch, (N, 1).
        scaled: w kappa [1/m], (3, N, 1).
        has_sheaths: whether any tendon can leave its path.
        stretch: |u|, the length per reference length of the arm [-], zero beyond, (N, J).
    """

    def __init__(
        self, tables: Tables, z: FloatArray, tensions: FloatArray, offsets: FloatArray
    ) -> None:
        """Compute tendons at twists ``z`` (N, m), local ``tensions`` (N, J) [N] and `offsets`."""
        columns = z.T[..., np.newaxis]
        self._kappa, stretch = columns[:3], columns[3]
        self.width, self.widening, _ = widening(tables.law, stretch)
        self.scaled, self._strains = self.width * self._kappa, z.shape[1]
        self.tension = tensions * tables.reach
        paths = np.ascontiguousarray(tables.tendons.transpose(2, 0, 1))
        self._r, self._slope = paths[:2], paths[2:]
        self._compliance, self._offset = tables.compliance, np.zeros_like(self._r)
        self.has_sheaths = bool(tables.compliance.any())
        if self.has_sheaths:
            # Node functions leave the offsets of tendons without tension as they were, even NaN.
            self._offset = np.where(self.tension != 0.0, offsets.transpose(2, 0, 1), 0.0)
            self._r = self._r + self._offset
        u = self._u(self._r, self._slope)
        u[0] += stretch
        if self._strains == 6:
            u[1:] += columns[4:]
        size = np.sqrt(np.einsum('cnj,cnj->nj', u, u))
        self.stretch, self._tangent, self._inverse = size * tables.reach, u, tables.reach / size

    @functools.cached_property
    def unit(self) -> FloatArray:
        """Unit tangents e, zero beyond the anchorages, (3, N, J)."""
        return np.asarray(self._tangent * self._inverse)

    @functools.cached_property
    def gradient(self) -> FloatArray:
        """g, the derivative of |u| by the twist at held offset, (N, J, m)."""
        return self._g(self.unit).transpose(1, 2, 0)

    @functools.cached_property
    def stretch_by_twist(self) -> FloatArray:
        """Derivative of |u| by the twist, and of the energy's gradient by T, (N, J, m)."""
        return self.gradient + self.by_tension.gradient if self.has_sheaths else self.gradient

    @property
    def stretch_by_tension(self) -> FloatArray:
        """Derivative of |u| by T [1/N], (N, J); zero in rigid sheaths."""
        return self.by_tension.stretch if self.has_sheaths else np.zeros_like(self.stretch)

    @functools.cached_property
    def unit_by_twist(self) -> FloatArray:
        """Derivative of e by the twist of the same node, (m, 3, N, J)."""
        kappa = np.zeros((4, *self.scaled.shape))  # derivative of w kappa, (4, 3, N, 1)
        kappa[0, 0] = kappa[1, 1] = kappa[2, 2] = self.width
        kappa[3] = self.widening * self._kappa
        u = np.zeros((self._strains, *self.unit.shape))
        u[:4] = _cross(kappa, self._r)
        u[3, 1:] += self.widening * self._slope
        for c in range(self._strains - 3):
            u[3 + c, c] += 1.0
        if self.has_sheaths:
            force = _cross_transposed(self.scaled, self._unit_change(u))
            force[:4] += _cross_transposed(kappa, self.unit)
            u += _cross(self.scaled, self._offset_change(self.tension * force))
        return self._unit_change(u)

    @functools.cached_property
    def by_tension(self) -> PathChange:
        """Derivatives by local tension [1/N], with T g_T as gradient; zero in rigid sheaths."""
        return self._path_change(self._offset_change(self._stretch_by_offset))

    @functools.cached_property
    def by_sheath_stiffness(self) -> PathChange:
        """Derivatives by the stiffness of every sheath [1/Pa]; zero for rigid ones."""
        return self._path_change(self._offset_change(self._offset))

    def by_path(self, path: FloatArray) -> PathChange:
        """Return derivatives by a shift along ``path`` (4, N, J), see `outward_paths`."""
        r, slope = path[:2], path[2:]
        if self.has_sheaths:
            unit = self._unit_change(self._u(r, slope))
            r = r + self._offset_change(self.tension * _cross_transposed(self.scaled, unit))
        return self._path_change(r, slope)

    def _path_change(self, r: FloatArray, slope: FloatArray | float = 0.0) -> PathChange:
        """Return (5) for a change of r + d by ``r`` (2, N, J) and of r' by ``slope``."""
        u = self._u(r, slope)
        unit = self._unit_change(u)
        gradient = self.tension * (self._g(unit) + self._g_of_path(self.unit, r, slope))
        return PathChange(unit, (self.unit * u).sum(axis=0), gradient.transpose(1, 2, 0))

    def _u(self, r: FloatArray, slope: FloatArray | float) -> FloatArray:
        """Return U(r, r'), (3, N, J)."""
        u = _cross(self.scaled, r)
        u[1:] += self.width * slope
        return u

    def _g(self, unit: FloatArray) -> FloatArray:
        """Return ``unit`` . u_z at held offset, (m, N, J)."""
        product = self._g_of_path(unit, self._r, self._slope)
        product[3:] += unit[: self._strains - 3]
        return product

    def _g_of_path(self, unit: FloatArray, r: FloatArray, slope: FloatArray | float) -> FloatArray:
        """Return G = (w kappa)_z . (r x e) + w_z r' . e for e = ``unit``, (m, N, J)."""
        (x, y), (e_t, e_n, e_b) = r, unit
        product = np.zeros((self._strains, *self.tension.shape))
        product[0], product[1], product[2] = x * e_b - y * e_n, y * e_t, -x * e_t
        product[3] = (self._kappa * product[:3]).sum(axis=0) + (slope * unit[1:]).sum(axis=0)
        product[3] *= self.widening
        product[:3] *= self.width
        return product

    @functools.cached_property
    def _stretch_by_offset(self) -> FloatArray:
        """The derivative p of |u| by the offset, (2, N, J)."""
        return _cross_transposed(self.scaled, self.unit)

    def _offset_change(self, force: FloatArray) -> FloatArray:
        """Return dd of (4) for f = ``force`` (..., 2, N, J), zero in rigid sheaths."""
        stiff = self._compliance * self.tension * self._inverse
        (t, n, b), (p_n, p_b) = self.scaled, self._stretch_by_offset
        nn, nb, bb = offset_stiffness((t, n, b), (p_n, p_b), stiff)
        x, y = np.moveaxis(force, -3, 0)
        change = np.stack([bb * x - nb * y, nn * y - nb * x], axis=-3)
        return change * (-self._compliance / (nn * bb - nb * nb))

    def _unit_change(self, u: FloatArray) -> FloatArray:
        """Return de of (5) for changes ``u`` (..., 3, N, J)."""
        along = (self.unit * u).sum(axis=-3)
        return (u - self.unit * along[..., np.newaxis, :, :]) * self._inverse


def _cross(kappa: FloatArray, r: FloatArray) -> FloatArray:
    """Return cross products kappa x r of curvatures (..., 3, N, 1) and offsets (..., 2, N, J)."""
    t, n, b = (kappa[..., c, :, :] for c in range(3))
    x, y = r[..., 0, :, :], r[..., 1, :, :]
    along = n * y - b * x
    product = np.empty((*along.shape[:-2], 3, *along.shape[-2:]))
    product[..., 0, :, :], product[..., 1, :, :], product[..., 2, :, :] = along, -t * y, t * x
    return product


def _cross_transposed(kappa: FloatArray, u: FloatArray) -> FloatArray:
    """Return the transpose of `_cross` by r, times ``u`` (..., 3, N, J): (..., 2, N, J)."""
    (t, n, b), (u_t, u_n, u_b) = np.moveaxis(kappa, -3, 0), np.moveaxis(u, -3, 0)
    return np.stack([t * u_b - b * u_t, n * u_t - t * u_n], axis=-3)


def unloaded_twists(tables: Tables, strains: int = 4) -> FloatArray:
    """Return the twists (N, m) of the unloaded arm, with so many ``strains``."""
    z = np.zeros((len(tables.reach), strains))
    z[:, :3], z[:, 3] = tables.body[:, REST_T:], 1.0
    return z


def outward_paths(arm: Arm, tables: Tables, s: FloatArray) -> FloatArray:
    """Return unit shifts of the tendons away from the midline at ``s`` (N,) [m], (4, N, J).

    They are along n and b [-], with the slopes of both [1/m], and zero beyond the anchorages.
    """
    return np.ascontiguousarray(arm.tendon_outwards(s).swapaxes(1, 2) * tables.reach)
