"""Compute the potential of a frictionless tendon: constant tension times deformed length.

A tendon is a polygon whose points move by weighted means of nodal displacements. Its length, the
forces on the nodes and their derivatives follow exactly. The mean is over one of two sets:

* the sheath, a circle of given radius around the tendon, which presses into the rubber (under a
  line load, without a radius, the displacement would diverge as elements get smaller);
* the whole cross section, by a plane fitted to its displacements: the tendon then keeps its
  position in the section, as beam models assume.

At its anchorage a tendon pulls on the whole cross section, as through a disc.
"""

from __future__ import annotations

import numpy as np
from arm_mesh import ArmMesh
from scipy.sparse import block_diag, bmat, csr_matrix, diags, vstack

from octo_arm_model import Arm
from octo_arm_model.arm.hints import FloatArray

_RIM = 8  # points of a sheath's circumference
_RINGS, _SPOKES = 6, 16  # quadrature points of a section


class SolidTendon:
    """A tendon in a mesh; energies and forces are per newton of tension."""

    def __init__(
        self, mesh: ArmMesh, arm: Arm, number: int, sheath: float | None, steps: int
    ) -> None:
        """Guide tendon ``number`` of ``arm``, counted by sections from the tip, through ``mesh``.

        ``sheath`` is the radius of its sheath [m], None if whole sections guide it, and ``steps``
        the number of segments per layer.
        """
        end = arm.sections[arm.tendon_section[number] - 1].anchorage
        last = int(np.argmin(np.abs(mesh.planes - end)))
        s = np.interp(
            np.arange(last * steps + 1) / steps, np.arange(last + 1), mesh.planes[: last + 1]
        )
        self._start = np.stack([s, *(offsets[number] for offsets in arm.tendon_offsets(s))])
        before_anchorage = self._start[:, :-1]
        points, weights = (
            _rim(before_anchorage, sheath) if sheath else _section(arm, before_anchorage)
        )
        means = vstack([_means(mesh, points, weights), _disc(mesh, *self._start[:, -1])]).tocsr()
        # The half z < 0 mirrors the half z > 0, so that mean displacements along z vanish.
        means_along_z = csr_matrix(means.shape) if mesh.half else means
        self._edges = [(m[1:] - m[:-1]).tocsr() for m in (means, means, means_along_z)]
        # Half an arm carries half of a tendon in its plane.
        self._share = 0.5 if mesh.half else 1.0

    def length(self, displacement: FloatArray) -> float:
        """Return the deformed length [m] for a ``displacement`` of the nodes (nodes, 3) [m]."""
        return float(np.sum(np.linalg.norm(self._deformed(displacement), axis=0)))

    def gradient(self, displacement: FloatArray) -> FloatArray:
        """Return the derivative (nodes, 3) of the length; for half an arm, half of it."""
        edges = self._deformed(displacement)
        directions = self._share * edges / np.linalg.norm(edges, axis=0)
        return np.stack([m.T @ t for m, t in zip(self._edges, directions)], axis=1)

    def hessian(self, displacement: FloatArray) -> csr_matrix:
        """Return the derivative of `gradient`, with x, y and z node by node."""
        edges = self._deformed(displacement)
        lengths = np.linalg.norm(edges, axis=0)
        units = edges / lengths
        projectors = np.eye(3)[:, :, np.newaxis] - units[:, np.newaxis] * units
        projectors *= self._share / lengths
        matrices = block_diag(self._edges, format='csr')
        middle = bmat([[diags(projectors[i, j]) for j in range(3)] for i in range(3)])
        matrix = (matrices.T @ middle.tocsr() @ matrices).tocoo()
        # Reorder from component by component to node by node.
        nodes = len(displacement)
        rows, columns = (3 * (i % nodes) + i // nodes for i in (matrix.row, matrix.col))
        return csr_matrix((matrix.data, (rows, columns)), matrix.shape)

    def _deformed(self, displacement: FloatArray) -> FloatArray:
        edges: FloatArray = np.stack([m @ u for m, u in zip(self._edges, displacement.T)])
        edges += np.diff(self._start, axis=1)
        return edges


def _rim(centre: FloatArray, radius: float) -> tuple[FloatArray, FloatArray]:
    """Return points (3, tendon points, rim) of a sheath around ``centre`` and their weights."""
    angle = 2.0 * np.pi * (np.arange(_RIM) + 0.5) / _RIM
    ring = radius * np.stack([np.zeros(_RIM), np.cos(angle), np.sin(angle)])
    points = centre[:, :, np.newaxis] + ring[:, np.newaxis]
    return points, np.full(points.shape[1:], 1.0 / _RIM)


def _section(arm: Arm, position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return points of sections, and weights that fit planes and evaluate them at ``position``."""
    nodes, shares = np.polynomial.legendre.leggauss(_RINGS)
    radii = np.sqrt(0.5 * (nodes + 1.0))[:, np.newaxis]  # uniform in area
    angle = 2.0 * np.pi * (np.arange(_SPOKES) + 0.5) / _SPOKES
    unit = np.stack([radii * np.cos(angle), radii * np.sin(angle)]).reshape(2, 1, -1)
    radius = arm.body.radius(position[0])[:, np.newaxis]
    points = np.concatenate([position[:1, :, np.newaxis] + 0.0 * unit[:1], radius * unit])
    weights = np.repeat(0.5 * shares / _SPOKES, _SPOKES)
    tilts = 4.0 * np.einsum('cp,cpk->pk', position[1:], points[1:]) / radius**2
    return points, weights * (1.0 + tilts)


def _means(mesh: ArmMesh, points: FloatArray, weights: FloatArray) -> csr_matrix:
    """Return the matrix (tendon points, nodes) of weighted means over ``points``."""
    count, width = weights.shape
    flat = points.reshape(3, -1).copy()
    if mesh.half:
        flat[2] = np.abs(flat[2])
    starts = np.arange(0, count * width + 1, width)
    return csr_matrix((weights.ravel(), np.arange(count * width), starts)) @ mesh.at(flat)


def _disc(mesh: ArmMesh, s: float, y: float, z: float) -> csr_matrix:
    """Return the row (1, nodes) that evaluates a plane fitted to displacements at y and z."""
    nodes, values, area = mesh.face(s)
    _, along_n, along_b = np.einsum('cfa,afq->cfq', mesh.nodes[:, nodes], values)
    plane = np.stack([np.ones_like(along_n), along_n, along_b])
    moments = np.einsum('ifq,jfq,fq->ij', plane, plane, area)
    if mesh.half:  # terms odd in z cancel with those of the other half
        moments[2, :2] = moments[:2, 2] = 0.0
    weight = area * np.einsum('i,ifq->fq', np.linalg.solve(moments, [1.0, y, z]), plane)
    shares = np.einsum('fq,afq->fa', weight, values)
    return csr_matrix(np.bincount(nodes.ravel(), shares.ravel(), mesh.nodes.shape[1]))
