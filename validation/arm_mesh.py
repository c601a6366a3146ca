"""Mesh a round, tapered arm with hexahedra: a square mapped to the disc, times layers along s.

The thickness of a layer is a given fraction of the arm's radius there. A point of the arm has
*reference coordinates* (X, Y, layer): `to_disc` maps (X, Y) in the square [-1, 1]^2 to the unit
disc, and layers are numbered from the base. In reference coordinates the elements are prisms with
straight sides, in which points are located. In space they are curved, quadratic in all directions.
The axes are x = t, y = n and z = b of the base.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.sparse import csr_matrix
from skfem import Basis, ElementHex1, ElementHex2, FacetBasis, MeshHex, MeshHex2

from octo_arm_model import Arm
from octo_arm_model.arm.hints import FloatArray, IntArray

# Half the side of the inner square in the unit disc: its corners stay inside the rim.
_CORE = 0.45
_RINGS_FROM = 0.5  # |X| or |Y| at which the rings around the inner square begin


@dataclass(frozen=True)
class Mesh:
    """Density of the elements.

    Attributes:
        across: elements from the midline to a side of the inner square, and number of rings around
            it; a whole section has 12 across^2 elements.
        along: layers per length of the local radius.
    """

    across: int
    along: float

    def __str__(self) -> str:
        """Return a short name."""
        return f'{self.across}x{self.along:g}'


def to_disc(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Map (X, Y) to the unit disc."""
    size = np.maximum(np.abs(x), np.abs(y))
    reciprocal = 1.0 / np.where(size > 0.0, size, 1.0)
    sideways = np.abs(x) >= np.abs(y)
    # On each side of the square one of these is 1 or -1, the other the position along the side.
    u, v = x * reciprocal, y * reciprocal
    angle = np.where(sideways, 0.25 * np.pi * v, 0.25 * np.pi * u)
    cosine, sine = np.cos(angle), np.sin(angle)
    round_x = np.where(sideways, np.sign(x) * cosine, sine)
    round_y = np.where(sideways, sine, np.sign(y) * cosine)
    ring = np.clip((size - _RINGS_FROM) / (1.0 - _RINGS_FROM), 0.0, None)
    core = _CORE * np.minimum(size / _RINGS_FROM, 1.0) * (1.0 - ring)
    return core * u + ring * round_x, core * v + ring * round_y


def from_disc(y: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Map points of the unit disc to (X, Y), the inverse of `to_disc`."""
    sideways = np.abs(y) >= np.abs(z)
    major = np.where(sideways, np.abs(y), np.abs(z))
    minor = np.where(sideways, z, y)
    # For v and p: core (1 - p) + p cos = major and core (1 - p) v + p sin = minor.
    low, high = -np.ones_like(major), np.ones_like(major)
    for _ in range(60):
        v = 0.5 * (low + high)
        ring = np.clip((major - _CORE) / (np.cos(0.25 * np.pi * v) - _CORE), 0.0, None)
        trial = _CORE * (1.0 - ring) * v + ring * np.sin(0.25 * np.pi * v)
        is_core = major <= _CORE
        trial = np.where(is_core, major * v, trial)
        low, high = np.where(trial < minor, v, low), np.where(trial < minor, high, v)
    size = np.where(is_core, major / _CORE * _RINGS_FROM, _RINGS_FROM + ring * (1.0 - _RINGS_FROM))
    along, across = np.where(sideways, y, z), size * v
    along = np.copysign(size, along)
    return np.where(sideways, along, across), np.where(sideways, across, along)


def _section(count: int, half: bool) -> tuple[FloatArray, IntArray]:
    """Return points (2, points) in (X, Y) and the quadrilaterals (4, quads) between them."""
    inner = np.linspace(-_RINGS_FROM, _RINGS_FROM, 2 * count + 1)
    lattices = [list(np.meshgrid(inner, inner[count:] if half else inner, indexing='ij'))]
    side = np.linspace(-1.0, 1.0, 2 * count + 1)
    # Rings towards +X, +Y, -X and -Y; half a section has half, all, half and none of them.
    sides = [side[count:], side, side[: count + 1]] if half else [side] * 4
    for quarter, positions in enumerate(sides):
        x, y = np.meshgrid(np.linspace(_RINGS_FROM, 1.0, count + 1), positions, indexing='ij')
        y = x * y
        for _ in range(quarter):
            x, y = -y, x
        lattices.append([x, y])
    corners = np.concatenate([_quads(np.stack(lattice)) for lattice in lattices], axis=2)
    # Points shared by lattices are merged.
    points, indices = np.unique(np.round(corners.reshape(2, -1), 12), axis=1, return_inverse=True)
    return points, indices.reshape(4, -1)


def _quads(lattice: FloatArray) -> FloatArray:
    """Return the corners (2, 4, quads) of the cells of a ``lattice`` (2, n, m)."""
    low, high = slice(None, -1), slice(1, None)
    around = ((low, low), (high, low), (high, high), (low, high))
    return np.stack([lattice[:, i, j].reshape(2, -1) for i, j in around], axis=1)


class ArmMesh:
    """Elements of an arm with bases for quadratic displacements and linear pressures.

    Attributes:
        planes: arc coordinates of the layers' faces [m], (layers + 1,).
        displacement: basis of the displacements on the curved elements.
        pressure: basis of the pressures at the same quadrature points.
        nodes, corners: points of the displacements and of the pressures [m], (3, n).
        layer: number of the layer of each element, (elements,).
        discs: numbers of the layers that are discs.
        half: whether this is the half z >= 0 of an arm that is symmetric about z = 0.
    """

    def __init__(self, arm: Arm, mesh: Mesh, half: bool, disc: float = 0.0) -> None:
        """Mesh ``arm``; ``disc`` is the thickness of discs that end at anchorages, or 0 [m]."""
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
        """Map ``reference`` coordinates (3, n) to points [m]."""
        s = np.interp(reference[2], np.arange(self.planes.size), self.planes)
        return np.stack([s, *(self._arm.body.radius(s) * np.array(to_disc(*reference[:2])))])

    def at(self, points: FloatArray, pressure: bool = False) -> csr_matrix:
        """Return the matrix that interpolates values at nodes or corners at ``points`` (3, n)."""
        s, *across = points
        layer = np.interp(s, self.planes, np.arange(self.planes.size))
        x, y = from_disc(*(across / self._arm.body.radius(s)))
        inside = np.stack([np.clip(x, -1.0, 1.0), np.clip(y, 0.0 if self.half else -1.0, 1.0)])
        basis = self._straight[1 if pressure else 0]
        return basis.probes(np.concatenate([inside, layer[np.newaxis]])).tocsr()

    def face(self, s: float) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return the finite elements of the plane between layers that is nearest to ``s`` [m].

        Returns:
            Nodes of the elements on one side (faces, functions); their functions at the quadrature
            points of the plane (functions, faces, points); area of each of these points [m^2].
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
    """Return the planes between layers [m], (layers + 1,), and the numbers of the discs."""
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
