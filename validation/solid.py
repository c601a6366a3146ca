"""Compute the energy of a nearly or wholly incompressible neo-Hookean solid.

The energy in displacement and pressure is the integral of

    mu/2 (tr(F^T F) - 3) - mu ln J + p (J - 1) - p^2 / (2 lambda),    J = det F,

which is stationary in both fields, with mu and lambda from the arm's E and nu. For nu = 0.5 lambda
is infinite and the pressure enforces J = 1. Displacements are quadratic and pressures linear on
hexahedra (Taylor-Hood), which do not lock.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from arm_mesh import ArmMesh
from scipy.sparse import csr_matrix

from octo_arm_model import Material
from octo_arm_model.arm.hints import FloatArray

_CHUNK = 400  # elements per batch, which bounds memory
_ONE = np.eye(3)


class Solid:
    """The elastic energy of an arm's elements.

    The unknowns are the displacements x, y, z node by node, then the pressures at the corners.

    Attributes:
        size: number of unknowns.
        displacements: number of unknowns that are displacements.
    """

    def __init__(self, mesh: ArmMesh, material: Material, disc_factor: float) -> None:
        """Tabulate the elements of ``mesh``; discs are ``disc_factor`` times as stiff."""
        nodes, corners = mesh.displacement, mesh.pressure
        self._count = nodes.N
        self.displacements = 3 * int(nodes.N)
        self.size = self.displacements + int(corners.N)
        self._weight = nodes.dx
        # (elements, functions, 3, points) and (functions, points).
        self._slope = np.stack([np.asarray(f[0].grad) for f in nodes.basis]).transpose(2, 0, 1, 3)
        self._linear = np.stack([np.asarray(f[0])[0] for f in corners.basis])
        self._node, self._corner = nodes.element_dofs.T, corners.element_dofs.T
        s = np.asarray(nodes.global_coordinates())[0]
        factor = np.where(np.isin(mesh.layer, mesh.discs), disc_factor, 1.0)[:, np.newaxis]
        ratio = material.poisson_ratio_at(s)
        self._mu = factor * material.shear_modulus_at(s)
        self._compliance = (1.0 - 2.0 * ratio) / (2.0 * ratio * self._mu)
        unknowns = [3 * self._node + i for i in range(3)] + [self.displacements + self._corner]
        self._unknown = np.concatenate(unknowns, axis=1)

    def energy(self, state: FloatArray) -> float:
        """Return the elastic energy [J]; NaN if an element is inverted."""
        total = 0.0
        for part, f, j, p in self._parts(state):
            mu = self._mu[part]
            density = 0.5 * mu * (np.einsum('eijq,eijq->eq', f, f) - 3.0) - mu * np.log(j)
            density += p * (j - 1.0) - 0.5 * self._compliance[part] * p**2
            total += float(np.sum(self._weight[part] * density))
        return total

    def volume(self, state: FloatArray) -> tuple[float, float]:
        """Return the smallest and the largest J."""
        j = np.concatenate([j.ravel() for _, _, j, _ in self._parts(state)])
        return float(j.min()), float(j.max())

    def gradient(self, state: FloatArray) -> FloatArray:
        """Return the derivatives of the energy by the unknowns; NaN if an element is inverted."""
        gradient = np.zeros(self.size)
        for part, f, j, p in self._parts(state):
            inverse = _inverse_transpose(f, j)
            stress = self._stress(part, f, inverse, j, p) * self._weight[part][:, None, None]
            forces = np.einsum('eijq,eajq->eia', stress, self._slope[part], optimize=True)
            excess = self._weight[part] * (j - 1.0 - self._compliance[part] * p)
            local = np.concatenate([forces.reshape(len(f), -1), excess @ self._linear.T], axis=1)
            gradient += np.bincount(self._unknown[part].ravel(), local.ravel(), self.size)
        return gradient

    def hessian(self, state: FloatArray) -> csr_matrix:
        """Return the second derivatives of the energy, a symmetric, indefinite matrix."""
        values = [self._local_hessian(*part) for part in self._parts(state)]
        width = self._unknown.shape[1]
        rows = np.repeat(self._unknown, width, axis=1).ravel()
        columns = np.tile(self._unknown, (1, width)).ravel()
        return csr_matrix((np.concatenate(values).ravel(), (rows, columns)), (self.size,) * 2)

    def _parts(
        self, state: FloatArray
    ) -> Iterator[tuple[slice, FloatArray, FloatArray, FloatArray]]:
        """Yield batches of elements with F, J and p at their quadrature points."""
        displacement = state[: self.displacements].reshape(-1, 3)
        pressure = state[self.displacements :]
        for start in range(0, len(self._node), _CHUNK):
            part = slice(start, start + _CHUNK)
            f = np.einsum(
                'eai,eajq->eijq', displacement[self._node[part]], self._slope[part], optimize=True
            )
            f += _ONE[:, :, np.newaxis]
            j = np.linalg.det(f.transpose(0, 3, 1, 2))
            j = np.where(j > 0.0, j, np.nan)
            yield part, f, j, pressure[self._corner[part]] @ self._linear

    def _stress(
        self, part: slice, f: FloatArray, inverse: FloatArray, j: FloatArray, p: FloatArray
    ) -> FloatArray:
        """Return the first Piola-Kirchhoff stress."""
        return self._mu[part][:, None, None] * (f - inverse) + (p * j)[:, None, None] * inverse

    def _local_hessian(
        self, part: slice, f: FloatArray, j: FloatArray, p: FloatArray
    ) -> FloatArray:
        """Return second derivatives of energies, (elements, unknowns, unknowns)."""
        slope, weight, mu = self._slope[part], self._weight[part], self._mu[part]
        inverse = _inverse_transpose(f, j)
        count, functions = slope.shape[:2]
        # With g = F^-T grad: dP : grad = mu grad.grad + (mu - p J) g (x) g^T + p J g (x) g.
        g = np.einsum('eijq,eajq->eaiq', inverse, slope, optimize=True)
        mu_slope = slope * (weight * mu)[:, None, None]
        geometric = g * (weight * (mu - p * j))[:, None, None]
        volumetric = g * (weight * p * j)[:, None, None]
        width = 3 * functions
        local = np.zeros((count, width + 8, width + 8))
        shape = (count, functions, -1)
        diagonal = mu_slope.reshape(shape) @ slope.reshape(shape).transpose(0, 2, 1)
        for i in range(3):
            rows = slice(i * functions, (i + 1) * functions)
            for k in range(3):
                columns = slice(k * functions, (k + 1) * functions)
                block = geometric[:, :, k] @ g[:, :, i].transpose(0, 2, 1)
                block += volumetric[:, :, i] @ g[:, :, k].transpose(0, 2, 1)
                local[:, rows, columns] = block + diagonal if i == k else block
            mixed = (g[:, :, i] * (weight * j)[:, None]) @ self._linear.T
            local[:, rows, width:] = mixed
            local[:, width:, rows] = mixed.transpose(0, 2, 1)
        local[:, width:, width:] = -np.einsum(
            'eq,aq,bq->eab', weight * self._compliance[part], self._linear, self._linear
        )
        return local


def _inverse_transpose(f: FloatArray, j: FloatArray) -> FloatArray:
    """Return F^-T from the cross products of the rows of F."""
    rows = [np.cross(f[:, (i + 1) % 3], f[:, (i + 2) % 3], axis=1) for i in range(3)]
    return np.stack(rows, axis=1) / j[:, None, None]
