"""The potential of a frictionless tendon of constant tension: tension times deformed length.

A tendon is a polygon through points that move with the solid. Each of its points is a mean of
nodal displacements, so that its length, the forces on the nodes and their derivatives follow
exactly. What a point is the mean of says how tendon and rubber touch:

* its sheath, a circle of given radius around the tendon's place, which presses into the rubber
  (on a line, without a radius, rubber would yield without end as elements get smaller);
* or the whole cross section, as the plane that fits its motion: the tendon then keeps its place in
  the section, as beam models assume.

At its anchorage a tendon pulls on the whole cross section, as a disc would pass it on.
"""

from __future__ import annotations

import numpy as np
from arm_mesh import ArmMesh
from scipy.sparse import block_diag, bmat, csr_matrix, diags, vstack

from octo_arm_model import Arm
from octo_arm_model.arm.hints import FloatArray

_RIM = 8  # points of a sheath's rim
_RINGS, _SPOKES = 6, 16  # of the points of a section


class SolidTendon:
    """One tendon, laid through a mesh. Energies and forces are those per newton of tension."""

    def __init__(
        self, mesh: ArmMesh, arm: Arm, number: int, sheath: float | None, steps: int
    ) -> None:
        """Lay tendon ``number`` of ``arm``, counted section by section from the tip.

        ``sheath`` is the radius of its sheath [m], None where the whole section holds it, and
        ``steps`` how many pieces its polygon has in every layer.
        """
        end = arm.sections[arm.tendon_section[number] - 1].anchorage
        last = int(np.argmin(np.abs(mesh.planes - end)))
        s = np.interp(
            np.arange(last * steps + 1) / steps, np.arange(last + 1), mesh.planes[: last + 1]
        )
        self._start = np.stack([s, *(offsets[number] for offsets in arm.tendon_offsets(s))])
        inside = self._start[:, :-1]
        points, weights = _rim(inside, sheath) if sheath else _section(arm, inside)
        means = vstack([_means(mesh, points, weights), _disc(mesh, *self._start[:, -1])]).tocsr()
        # What is at z < 0 mirrors what is at z > 0: along z the means of the two vanish.
        sideways = csr_matrix(means.shape) if mesh.half else means
        self._edges = [(m[1:] - m[:-1]).tocsr() for m in (means, means, sideways)]
        # A half arm bears half of the tendon in its plane.
        self._share = 0.5 if mesh.half else 1.0

    def length(self, displacement: FloatArray) -> float:
        """Deformed length [m] for a ``displacement`` of the nodes (nodes, 3) [m]."""
        return float(np.sum(np.linalg.norm(self._deformed(displacement), axis=0)))

    def gradient(self, displacement: FloatArray) -> FloatArray:
        """Derivative (nodes, 3) of the length, of which a half arm bears its part."""
        edges = self._deformed(displacement)
        towards = self._share * edges / np.linalg.norm(edges, axis=0)
        return np.stack([m.T @ t for m, t in zip(self._edges, towards)], axis=1)

    def hessian(self, displacement: FloatArray) -> csr_matrix:
        """Second derivatives of the same; x, y and z node by node."""
        edges = self._deformed(displacement)
        lengths = np.linalg.norm(edges, axis=0)
        units = edges / lengths
        across = np.eye(3)[:, :, np.newaxis] - units[:, np.newaxis] * units
        across *= self._share / lengths
        matrices = block_diag(self._edges, format='csr')
        middle = bmat([[diags(across[i, j]) for j in range(3)] for i in range(3)])
        matrix = (matrices.T @ middle.tocsr() @ matrices).tocoo()
        # From component by component to node by node.
        nodes = len(displacement)
        rows, columns = (3 * (i % nodes) + i // nodes for i in (matrix.row, matrix.col))
        return csr_matrix((matrix.data, (rows, columns)), matrix.shape)

    def _deformed(self, displacement: FloatArray) -> FloatArray:
        edges: FloatArray = np.stack([m @ u for m, u in zip(self._edges, displacement.T)])
        edges += np.diff(self._start, axis=1)
        return edges


def _rim(where: FloatArray, radius: float) -> tuple[FloatArray, FloatArray]:
    """Points (3, tendon points, rim) of a sheath around ``where`` and their weights."""
    angle = 2.0 * np.pi * (np.arange(_RIM) + 0.5) / _RIM
    ring = radius * np.stack([np.zeros(_RIM), np.cos(angle), np.sin(angle)])
    points = where[:, :, np.newaxis] + ring[:, np.newaxis]
    return points, np.full(points.shape[1:], 1.0 / _RIM)


def _section(arm: Arm, where: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points of whole sections, and weights that fit planes and read them at ``where``."""
    nodes, shares = np.polynomial.legendre.leggauss(_RINGS)
    size = np.sqrt(0.5 * (nodes + 1.0))[:, np.newaxis]  # even in area
    angle = 2.0 * np.pi * (np.arange(_SPOKES) + 0.5) / _SPOKES
    unit = np.stack([size * np.cos(angle), size * np.sin(angle)]).reshape(2, 1, -1)
    radius = arm.body.radius(where[0])[:, np.newaxis]
    points = np.concatenate([where[:1, :, np.newaxis] + 0.0 * unit[:1], radius * unit])
    weights = np.repeat(0.5 * shares / _SPOKES, _SPOKES)
    tilt = 4.0 * np.einsum('cp,cpk->pk', where[1:], points[1:]) / radius**2
    return points, weights * (1.0 + tilt)


def _means(mesh: ArmMesh, points: FloatArray, weights: FloatArray) -> csr_matrix:
    """Matrix (tendon points, nodes) of the weighted means over ``points``."""
    count, width = weights.shape
    flat = points.reshape(3, -1).copy()
    if mesh.half:
        flat[2] = np.abs(flat[2])
    starts = np.arange(0, count * width + 1, width)
    return csr_matrix((weights.ravel(), np.arange(count * width), starts)) @ mesh.at(flat)


def _disc(mesh: ArmMesh, s: float, y: float, z: float) -> csr_matrix:
    """Row (1, nodes) that fits a plane to the section's motion and reads it at ``y`` and ``z``."""
    nodes, values, area = mesh.face(s)
    _, along_n, along_b = np.einsum('cfa,afq->cfq', mesh.nodes[:, nodes], values)
    plane = np.stack([np.ones_like(along_n), along_n, along_b])
    moments = np.einsum('ifq,jfq,fq->ij', plane, plane, area)
    if mesh.half:  # what is odd in z has its like on the other side
        moments[2, :2] = moments[:2, 2] = 0.0
    weight = area * np.einsum('i,ifq->fq', np.linalg.solve(moments, [1.0, y, z]), plane)
    shares = np.einsum('fq,afq->fa', weight, values)
    return csr_matrix(np.bincount(nodes.ravel(), shares.ravel(), mesh.nodes.shape[1]))
