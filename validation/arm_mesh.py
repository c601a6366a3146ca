"""Hexahedra of a round, tapered arm: the disc as a mapped square, times layers along s.

Layers are as thick as the arm is there, or a given part of it. A point of the arm has *reference
coordinates* (X, Y, layer): (X, Y) in the square [-1, 1]^2 is what `to_disc` lays into the unit
disc, and the layers are numbered from the base. In them every element is a prism with straight
sides, so that points are found there; the elements themselves are curved, quadratic in all
directions. The axes are x = t, y = n and z = b of the base.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.sparse import csr_matrix
from skfem import Basis, ElementHex1, ElementHex2, FacetBasis, MeshHex, MeshHex2

from octo_arm_model import Arm
from octo_arm_model.arm.hints import FloatArray, IntArray

# Half the side of the square that stays one, in the unit disc: its corners are clear of the rim.
_CORE = 0.45
_RINGS_FROM = 0.5  # |X| or |Y| where the rings around it begin


@dataclass(frozen=True)
class Mesh:
    """Numbers of elements.

    Attributes:
        across: elements from the midline to a side of the inner square, and of the rings around
            it; a whole section has 12 across^2 elements.
        along: layers in a length of one radius, wherever that is.
    """

    across: int
    along: float

    def __str__(self) -> str:
        """Short name."""
        return f'{self.across}x{self.along:g}'


def to_disc(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Point of the unit disc for (X, Y)."""
    size = np.maximum(np.abs(x), np.abs(y))
    over = 1.0 / np.where(size > 0.0, size, 1.0)
    sideways = np.abs(x) >= np.abs(y)
    # One of these is 1 in size, the other how far along its side the point is.
    u, v = x * over, y * over
    angle = np.where(sideways, 0.25 * np.pi * v, 0.25 * np.pi * u)
    near, far = np.cos(angle), np.sin(angle)
    round_x = np.where(sideways, np.sign(x) * near, far)
    round_y = np.where(sideways, far, np.sign(y) * near)
    part = np.clip((size - _RINGS_FROM) / (1.0 - _RINGS_FROM), 0.0, None)
    core = _CORE * np.minimum(size / _RINGS_FROM, 1.0) * (1.0 - part)
    return core * u + part * round_x, core * v + part * round_y


def from_disc(y: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(X, Y) of points of the unit disc, the inverse of `to_disc`."""
    sideways = np.abs(y) >= np.abs(z)
    near = np.where(sideways, np.abs(y), np.abs(z))
    far = np.where(sideways, z, y)
    # Along a side: core (1 - p) + p cos = near and core (1 - p) v + p sin = far, for v and p.
    low, high = -np.ones_like(near), np.ones_like(near)
    for _ in range(60):
        v = 0.5 * (low + high)
        part = np.clip((near - _CORE) / (np.cos(0.25 * np.pi * v) - _CORE), 0.0, None)
        at = _CORE * (1.0 - part) * v + part * np.sin(0.25 * np.pi * v)
        inside = near <= _CORE
        at = np.where(inside, near * v, at)
        low, high = np.where(at < far, v, low), np.where(at < far, high, v)
    size = np.where(inside, near / _CORE * _RINGS_FROM, _RINGS_FROM + part * (1.0 - _RINGS_FROM))
    along, across = np.where(sideways, y, z), size * v
    along = np.copysign(size, along)
    return np.where(sideways, along, across), np.where(sideways, across, along)


def _section(count: int, half: bool) -> tuple[FloatArray, IntArray]:
    """Corners (2, points) of the quadrilaterals (4, quads) of a section, in (X, Y)."""
    inner = np.linspace(-_RINGS_FROM, _RINGS_FROM, 2 * count + 1)
    lattices = [list(np.meshgrid(inner, inner[count:] if half else inner, indexing='ij'))]
    side = np.linspace(-1.0, 1.0, 2 * count + 1)
    # Rings on the sides towards +X, +Y, -X and -Y: half, all, half and none in half a section.
    sides = [side[count:], side, side[: count + 1]] if half else [side] * 4
    for turn, part in enumerate(sides):
        x, y = np.meshgrid(np.linspace(_RINGS_FROM, 1.0, count + 1), part, indexing='ij')
        y = x * y
        for _ in range(turn):
            x, y = -y, x
        lattices.append([x, y])
    corners = np.concatenate([_quads(np.stack(lattice)) for lattice in lattices], axis=2)
    # Points shared by lattices are merged.
    points, where = np.unique(np.round(corners.reshape(2, -1), 12), axis=1, return_inverse=True)
    return points, where.reshape(4, -1)


def _quads(lattice: FloatArray) -> FloatArray:
    """The four corners, around each, of what a ``lattice`` (2, n, m) encloses, (2, 4, quads)."""
    low, high = slice(None, -1), slice(1, None)
    around = ((low, low), (high, low), (high, high), (low, high))
    return np.stack([lattice[:, i, j].reshape(2, -1) for i, j in around], axis=1)


class ArmMesh:
    """Elements of an arm, with the quadratic displacement and linear pressure that live on them.

    Attributes:
        planes: arc coordinates of the layers' faces [m], (layers + 1,).
        displacement: basis of the displacement, on the curved elements.
        pressure: basis of the pressure, at the same quadrature points.
        nodes, corners: places of displacements and of pressures [m], (3, n).
        layer: of every element, (elements,).
        discs: which layers are discs.
        half: whether this is the half z >= 0 of an arm that is symmetric about z = 0.
    """

    def __init__(self, arm: Arm, mesh: Mesh, half: bool, disc: float = 0.0) -> None:
        """Fill ``arm``; where ``disc`` is not 0, a layer so thick [m] ends at every anchorage."""
        self.half, self._arm = half, arm
        self.planes, self.discs = _planes(arm, mesh.along, disc)
        points, quads = _section(mesh.across, half)
        layers, count = self.planes.size - 1, points.shape[1]
        corners = np.concatenate(
            [np.tile(points, layers + 1), [np.repeat(np.arange(layers + 1.0), count)]]
        )
        first = (quads[:, np.newaxis] + count * np.arange(layers)[:, np.newaxis]).reshape(4, -1)
        a, b, c, d = first
        # In the order of scikit-fem's corners 000, 001, 010, 100, 011, 101, 110, 111.
        elements = np.stack([a, a + count, d, b, d + count, b + count, c, c + count])
        straight = MeshHex(corners, elements)
        curved = MeshHex2.from_mesh(straight)
        self._straight = Basis(straight, ElementHex2()), Basis(straight, ElementHex1())
        curved = MeshHex2(self.place(curved.doflocs), curved.t)
        self.displacement = Basis(curved, ElementHex2(), intorder=5)
        self.pressure = Basis(curved, ElementHex1(), intorder=5)
        self.nodes, self.corners = (self.place(basis.doflocs) for basis in self._straight)
        self.layer = np.repeat(np.arange(layers), quads.shape[1])

    def place(self, reference: FloatArray) -> FloatArray:
        """Places [m] of points given in ``reference`` coordinates (3, n)."""
        s = np.interp(reference[2], np.arange(self.planes.size), self.planes)
        return np.stack([s, *(self._arm.body.radius(s) * np.array(to_disc(*reference[:2])))])

    def at(self, points: FloatArray, pressure: bool = False) -> csr_matrix:
        """Matrix that takes values at the nodes (or the corners) to ``points`` (3, n) [m]."""
        s, *across = points
        layer = np.interp(s, self.planes, np.arange(self.planes.size))
        x, y = from_disc(*(across / self._arm.body.radius(s)))
        inside = np.stack([np.clip(x, -1.0, 1.0), np.clip(y, 0.0 if self.half else -1.0, 1.0)])
        basis = self._straight[1 if pressure else 0]
        return basis.probes(np.concatenate([inside, layer[np.newaxis]])).tocsr()

    def face(self, s: float) -> tuple[IntArray, FloatArray, FloatArray]:
        """The plane at ``s`` [m], which must be one between layers.

        Returns:
            Nodes of the elements on one side of it, (faces, functions); their functions at the
            quadrature points of the plane, (functions, faces, points); area about each [m^2].
        """
        straight = self._straight[0].mesh
        plane = float(np.argmin(np.abs(self.planes - s)))
        facets = straight.facets_satisfying(lambda x: np.abs(x[2] - plane) < 1e-6)
        basis = FacetBasis(straight, ElementHex2(), facets=facets, intorder=6)
        nodes = basis.element_dofs.T
        values = np.stack([np.asarray(f[0]) for f in basis.basis])
        slopes = np.stack([np.asarray(f[0].grad)[:2] for f in basis.basis])
        (a, b), (c, d) = np.einsum('cfa,axfq->cxfq', self.nodes[1:, nodes], slopes)
        return nodes, values, basis.dx * np.abs(a * d - b * c)


def _planes(arm: Arm, along: float, disc: float) -> tuple[FloatArray, IntArray]:
    """Planes between layers [m], (layers + 1,), and which layers are discs."""
    fine = np.linspace(0.0, arm.length, 2001)
    in_radii = cumulative_trapezoid(1.0 / arm.body.radius(fine), fine, initial=0.0)
    parts, discs, start = [np.zeros(1)], [], 0.0
    for end in sorted(section.anchorage for section in arm.sections):
        first, last = np.interp([start, end - disc], fine, in_radii)
        count = max(1, round(along * (last - first)))
        inside = np.interp(np.linspace(first, last, count + 1)[1:], in_radii, fine)
        inside[-1] = end - disc
        parts.append(inside if disc == 0.0 else np.append(inside, end))
        discs.append(sum(part.size for part in parts) - 2)
        start = end
    return np.concatenate(parts), np.array(discs if disc else [], dtype=np.int64)
