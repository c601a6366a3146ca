"""Solve the model exact independently of the package, as a reference for tests.

Only the numbers and profiles of an `Arm` and its `Loads` are from the package. The package has
closed forms, Newton's method and an integrator; this module has vectors, a sum over the fibres of
a cross section, and SciPy's solver of boundary value problems.

A strain is (kappa, v): rotation of the frame and displacement of the midline per reference length
in the axes t, n, b, (4, nodes) without shear and (6, nodes) with it; kappa = (1 + q) omega.
"""

import numpy as np
from reference import Shape, active_at, cables, cross, pulls
from scipy.integrate import solve_bvp
from scipy.spatial.transform import Rotation

from octo_arm_model import Arm, Backbone, Loads


def disc(rings: int = 24, spokes: int = 64) -> tuple[np.ndarray, np.ndarray]:
    """Return fibres of the unit disc: positions (3, fibres) and areas (fibres,)."""
    points, weights = np.polynomial.legendre.leggauss(rings)
    radius, weights = (points + 1) / 2, weights / 2
    angle = 2 * np.pi * (np.arange(spokes) + 0.5) / spokes
    positions = np.stack(
        [
            np.zeros((rings, spokes)),
            np.outer(radius, np.cos(angle)),
            np.outer(radius, np.sin(angle)),
        ]
    )
    area = np.outer(weights * radius, np.full(spokes, 2 * np.pi / spokes))
    return positions.reshape(3, -1), area.ravel()


PLACES, AREAS = disc()


class Cut:
    """Cross sections of an arm at ``s`` (nodes,) in a panel with ``active`` sections."""

    def __init__(
        self, arm: Arm, s: np.ndarray, active: int, tensions: np.ndarray, law: str = 'linear'
    ) -> None:
        s = np.atleast_1d(s).astype(float)
        material = arm.material
        self.is_rubber = law == 'neo_hookean'
        self.radius = arm.body.radius(s)
        self.young, self.rigidity = material.youngs_modulus_at(s), material.shear_modulus_at(s)
        self.area = np.pi * self.radius**2
        self.inertia = np.pi * self.radius**4 / 4
        self.r, self.slope = cables(arm, active, s)
        self.pulls = pulls(arm, tensions, active)[:, np.newaxis]

    @property
    def scale(self) -> tuple[np.ndarray, np.ndarray]:
        """Scales of moment and force (nodes,): sums of tensions and of their moments."""
        force = self.pulls.sum() + 1e-4 * self.young * self.area
        lever = np.maximum(self.radius, np.linalg.norm(self.r, axis=0).max(axis=0, initial=0))
        return force * lever, force

    def _tendons(self, strain: np.ndarray, width: np.ndarray) -> np.ndarray:
        """Return tangents u of the tendons per reference length, (3, tendons, ..., nodes)."""
        midline = strain[3:]
        midline = np.concatenate([midline, np.zeros((6 - len(strain), *strain.shape[1:]))])
        shape = (3, -1, *(1,) * (strain.ndim - 2), self.radius.size)
        r, slope = self.r.reshape(shape), self.slope.reshape(shape)
        return midline[:, np.newaxis] + width * (cross(strain[:3, np.newaxis], r) + slope)

    def energy(self, strain: np.ndarray) -> np.ndarray:
        """Return the energy per length of a real or complex ``strain`` (n, ..., nodes)."""
        kappa, stretch = strain[:3], strain[3]
        if self.is_rubber:  # incompressible, E = 3 mu: the sum over fibres stretched by l
            width, shape = stretch**-0.5, (-1, *(1,) * (strain.ndim - 1))
            _, y, z = (place.reshape(shape) * self.radius for place in PLACES)
            fibre = stretch + width * (kappa[1] * z - kappa[2] * y)
            energies = (fibre**2 + 2 / fibre - 3) / 6
            value = self.young * self.radius**2 * (energies * AREAS.reshape(shape)).sum(axis=0)
        else:
            width = np.ones_like(stretch)
            value = self.young * self.area * (stretch - 1) ** 2 / 2
            value = value + self.young * self.inertia * (kappa[1] ** 2 + kappa[2] ** 2) / 2
            value = value + self.rigidity * self.area * (strain[4:] ** 2).sum(axis=0) / 2
        value = value + self.rigidity * 2 * self.inertia * (width * kappa[0]) ** 2 / 2
        u = self._tendons(strain, width)
        lengths = np.sqrt((u * u).sum(axis=0))
        pulls = self.pulls.reshape(-1, *(1,) * (lengths.ndim - 1))
        return value + (pulls * lengths).sum(axis=0)

    def resultants(self, strain: np.ndarray) -> np.ndarray:
        """Return moment and force (n, ..., nodes) of the section with its tendons.

        They are the gradient of the energy, by complex steps that are exact to rounding.
        """
        size = len(strain)
        steps = 1e-30j * np.eye(size).reshape(size, size, *(1,) * (strain.ndim - 1))
        return self.energy(strain[:, np.newaxis] + steps).imag / 1e-30

    def balance(self, wrench: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Return the strain (n, nodes) in balance with ``wrench``, by Newton's method."""
        strain, (moment, force), twists = start.copy(), self.scale, len(start) - 3
        scale = np.stack([moment] * 3 + [force] * twists) + np.abs(wrench)
        unit = np.stack([1e-7 / self.radius] * 3 + [np.full(self.radius.shape, 1e-7)] * twists)
        moves = unit * np.eye(len(start))[:, :, np.newaxis]
        for _ in range(60):
            resultants = self.resultants(strain)
            if (np.abs(resultants - wrench) <= 1e-12 * scale).all():
                return strain
            changes = self.resultants(strain[:, np.newaxis] + moves) - resultants[:, np.newaxis]
            matrix, residual = (changes / unit).transpose(2, 0, 1), (wrench - resultants).T
            step = np.linalg.solve(matrix, residual[..., np.newaxis])[..., 0].T
            strain = strain + np.minimum(1.0, 0.5 * strain[3] / (np.abs(step[3]) + 1e-300)) * step
        raise AssertionError(f'no balance of a cross section with {wrench}')


def imbalance(
    arm: Arm,
    law: str,
    backbone: Backbone,
    i: int,
    force: np.ndarray = np.zeros(3),
    moment: np.ndarray = np.zeros(3),
) -> float:
    """Return the relative residual at station ``i`` of a section with the wrench from beyond."""
    cut = Cut(arm, backbone.s[i], int(backbone.section[i]), backbone.tendon_tensions[i], law)
    stretch = 1 + backbone.q[i]
    omega = np.array([backbone.tau[i], backbone.xi[i], backbone.k[i]])
    resultants = cut.resultants(np.append(stretch * omega, stretch)[:, np.newaxis])[:, 0]
    axes = Rotation.from_quat(backbone.quaternion[i]).as_matrix()
    moment_scale, force_scale = cut.scale
    return max(
        np.abs(axes.T @ moment - resultants[:3]).max() / (moment_scale[0] + np.abs(moment).max()),
        abs(axes[:, 0] @ force - resultants[3]) / (force_scale[0] + np.abs(force).max()),
    )


def least_strain(
    arm: Arm, tensions: np.ndarray, s: float, law: str, shear: bool = False
) -> np.ndarray:
    """Return the strain (4,) or (6,) of least energy at ``s``, followed from zero tensions."""
    cut, size = Cut(arm, np.array([s]), active_at(arm, s), tensions, law), 6 if shear else 4
    rest = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0])[:size, np.newaxis]
    strain, tensions_of_cables = rest, cut.pulls
    for factor in np.linspace(0.1, 1.0, 10):
        cut.pulls = factor * tensions_of_cables
        strain = cut.balance(0.0 * rest, strain)
    moves = 1e-3 * np.random.default_rng(0).normal(size=(size, 100, 1))
    moves[:3] /= cut.radius
    assert (cut.energy(strain[:, np.newaxis] + moves) > cut.energy(strain)).all()
    return strain[:, 0]


def loaded_bvp(
    arm: Arm,
    tensions: np.ndarray,
    start: Backbone,
    loads: Loads,
    *,
    shear: bool = False,
    tol: float = 1e-8,
) -> Shape:
    """Solve an arm of one section and the linear law under a tip wrench, weight and buoyancy.

    Return the shape at the stations of the first guess ``start``. The unknowns are position,
    quaternion and moment; the force is known, because all loads are dead.
    """
    size, warm = 6 if shear else 4, dict[int, np.ndarray]()
    rest = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0])[:size]

    def axes_of(quaternion: np.ndarray) -> np.ndarray:
        return Rotation.from_quat(quaternion.T).as_matrix().transpose(1, 2, 0)

    def rates(s: np.ndarray, y: np.ndarray) -> np.ndarray:
        axes, cut = axes_of(y[3:7]), Cut(arm, s, 1, tensions)
        tip = arm.body.radius_tip
        beyond = np.pi * (cut.radius**2 + cut.radius * tip + tip**2) / 3 * (arm.length - s)
        weight = (arm.material.density - loads.fluid_density) * beyond
        force = np.array(loads.tip_force)[:, np.newaxis] + np.outer(loads.gravity, weight)
        local = [np.einsum('ijn,in->jn', axes, wrench) for wrench in (y[7:], force)]
        first_strain = warm.get(s.size, np.tile(rest[:, np.newaxis], s.size))
        strain = warm[s.size] = cut.balance(np.concatenate(local)[:size], first_strain)
        forward = np.zeros((3, s.size))
        forward[: size - 3] = strain[3:]
        velocity = np.einsum('ijn,jn->in', axes, forward)
        kappa, (vector, scalar) = strain[:3], (y[3:6], y[6])
        turn = [scalar * kappa + cross(vector, kappa), [-(vector * kappa).sum(axis=0)]]
        return np.concatenate(
            [velocity, *(0.5 * np.array(part) for part in turn), -cross(velocity, force)]
        )

    def borders(first: np.ndarray, last: np.ndarray) -> np.ndarray:
        start_pose = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
        return np.concatenate([first[:7] - start_pose, last[7:] - loads.tip_moment])

    guess = np.column_stack([start.position, start.quaternion, 0.0 * start.position]).T
    solution = solve_bvp(rates, borders, start.s, guess, tol=tol, bc_tol=1e-12, max_nodes=4000)
    assert solution.success, solution.message
    result = solution.sol(start.s)
    return Shape(result[:3].T, axes_of(result[3:7]).transpose(2, 0, 1), np.zeros((0, 4)))
