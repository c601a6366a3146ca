"""The physics of the model exact, stated and solved a second time, for the tests to compare with.

Nothing here uses the package but the plain numbers of an `Arm` and of its `Loads`. Where the
package has closed forms, Newton's method and an integrator of its own, this has vectors, a sum
over the fibres of a cross section, and SciPy's root finding, boundary value problems and
minimisation.

A strain is (kappa, v): rotation of the frame and motion of the midline per reference length, in
the axes t, n, b, as (4, nodes) without shear and (6, nodes) with it; kappa = (1 + q) omega.
"""

from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_bvp
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize, root
from scipy.spatial.transform import Rotation

from octo_arm_model import Arm, Backbone, Loads


def disc(rings: int = 24, spokes: int = 64) -> tuple[np.ndarray, np.ndarray]:
    """Fibres of the unit disc: places (3, fibres) and areas (fibres,)."""
    points, weights = np.polynomial.legendre.leggauss(rings)
    radius, weights = (points + 1) / 2, weights / 2
    angle = 2 * np.pi * (np.arange(spokes) + 0.5) / spokes
    place = np.stack(
        [
            np.zeros((rings, spokes)),
            np.outer(radius, np.cos(angle)),
            np.outer(radius, np.sin(angle)),
        ]
    )
    area = np.outer(weights * radius, np.full(spokes, 2 * np.pi / spokes))
    return place.reshape(3, -1), area.ravel()


PLACES, AREAS = disc()


def cross(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Cross product along the first axis."""
    return np.stack(
        [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
    )


class Cut:
    """Cross sections of an arm at ``s`` (nodes,), all in one panel with ``active`` sections."""

    def __init__(
        self, arm: Arm, s: np.ndarray, active: int, tensions: np.ndarray, law: str = 'linear'
    ) -> None:
        s = np.atleast_1d(s).astype(float)
        body, material = arm.body, arm.material
        self.is_rubber = law == 'neo_hookean'
        self.radius = body.radius_base + (body.radius_tip - body.radius_base) * s / body.length
        self.young = float(material.youngs_modulus)
        self.rigidity = self.young / (2 * (1 + float(material.poisson_ratio)))
        self.area = np.pi * self.radius**2
        self.inertia = np.pi * self.radius**4 / 4
        places, slopes, pulls = [], [], []
        flat = iter(np.ravel(tensions))
        for number, section in enumerate(arm.sections, start=1):
            rate = (section.offset_anchorage - section.offset_base) / section.anchorage
            y = section.offset_base + rate * s
            for angle, twist in zip(section.angles, section.twist or 99 * (0.0,)):
                turn = twist / section.anchorage
                phi = angle + turn * s
                zero = np.zeros_like(s)
                out = np.stack([zero, np.cos(phi), np.sin(phi)])
                around = np.stack([zero, -np.sin(phi), np.cos(phi)])
                pull = next(flat)
                if number <= active:
                    places.append(y * out)
                    slopes.append(rate * out + y * turn * around)
                    pulls.append(pull)
        self.r = np.stack(places, axis=1) if places else np.zeros((3, 0, s.size))
        self.slope = np.stack(slopes, axis=1) if places else np.zeros((3, 0, s.size))
        self.pulls = np.array(pulls).reshape(-1, 1)

    @property
    def scale(self) -> tuple[np.ndarray, np.ndarray]:
        """Scales of moment and force, (nodes,): sums of tensions and of their moments."""
        force = self.pulls.sum() + 1e-4 * self.young * self.area
        lever = np.maximum(self.radius, np.linalg.norm(self.r, axis=0).max(axis=0, initial=0))
        return force * lever, force

    def _tendons(self, strain: np.ndarray, width: np.ndarray) -> np.ndarray:
        """Motion u of the tendons per reference length, (3, tendons, ..., nodes)."""
        middle = strain[3:]
        middle = np.concatenate([middle, np.zeros((6 - len(strain), *strain.shape[1:]))])
        shape = (3, -1, *(1,) * (strain.ndim - 2), self.radius.size)
        r, slope = self.r.reshape(shape), self.slope.reshape(shape)
        return middle[:, np.newaxis] + width * (cross(strain[:3, np.newaxis], r) + slope)

    def energy(self, strain: np.ndarray) -> np.ndarray:
        """Energy per reference length of ``strain`` (n, ..., nodes), complex numbers included."""
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
        """Moment and force (n, ..., nodes) of the section and its tendons together.

        The gradient of the energy by complex steps, which are exact to rounding.
        """
        size = len(strain)
        steps = 1e-30j * np.eye(size).reshape(size, size, *(1,) * (strain.ndim - 1))
        return self.energy(strain[:, np.newaxis] + steps).imag / 1e-30

    def balance(self, wrench: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Strain (n, nodes) in balance with ``wrench`` (n, nodes): Newton's method."""
        strain, (moment, force), twists = start.copy(), self.scale, len(start) - 3
        scale = np.stack([moment] * 3 + [force] * twists) + np.abs(wrench)
        unit = np.stack([1e-7 / self.radius] * 3 + [np.full(self.radius.shape, 1e-7)] * twists)
        moves = unit * np.eye(len(start))[:, :, np.newaxis]
        for _ in range(60):
            found = self.resultants(strain)
            if (np.abs(found - wrench) <= 1e-12 * scale).all():
                return strain
            moved = self.resultants(strain[:, np.newaxis] + moves) - found[:, np.newaxis]
            matrix, left = (moved / unit).transpose(2, 0, 1), (wrench - found).T
            step = np.linalg.solve(matrix, left[..., np.newaxis])[..., 0].T
            strain = strain + np.minimum(1.0, 0.5 * strain[3] / (np.abs(step[3]) + 1e-300)) * step
        raise AssertionError(f'no balance of a cross section with {wrench}')


def active_at(arm: Arm, s: float) -> int:
    """Sections whose tendons act at ``s``; at an anchorage on the side of the base."""
    return sum(section.anchorage >= s for section in arm.sections)


def least_strain(
    arm: Arm, tensions: np.ndarray, s: float, law: str, shear: bool = False
) -> np.ndarray:
    """Strain (4,) or (6,) of least energy at ``s``, by a general-purpose optimiser."""
    cut = Cut(arm, np.array([s]), active_at(arm, s), tensions, law)
    radius = cut.radius[0]
    unit = np.array([1 / radius] * 3 + [1.0] * (3 if shear else 1))
    rest = np.zeros(unit.size)
    rest[3] = 1.0
    size = cut.young * cut.area[0]

    def value(x: np.ndarray) -> float:
        strain = (unit * x)[:, np.newaxis]
        if cut.is_rubber:
            crushed = strain[3] <= 0.05 or strain[3] ** 1.5 < 1.05 * np.hypot(*x[1:3])
            if crushed:
                return np.inf
        return float(cut.energy(strain)[0] / size)

    def slope(x: np.ndarray) -> np.ndarray:
        return unit * cut.resultants((unit * x)[:, np.newaxis])[:, 0] / size

    found = minimize(value, rest, jac=slope, method='BFGS', options={'gtol': 1e-9})
    assert np.abs(found.jac).max() < 1e-6, found.message
    # The energy is flat at its minimum: the last digits are found by its gradient.
    polished = root(slope, found.x, tol=1e-13)
    assert np.abs(polished.x - found.x).max() < 1e-4
    return unit * polished.x


class Shape(NamedTuple):
    """A loaded arm: positions (n, 3), rotation matrices (n, 3, 3) with columns t, n, b."""

    position: np.ndarray
    rotation: np.ndarray


class _Panel(NamedTuple):
    start: float
    stop: float
    active: int
    force_beyond: np.ndarray
    point_moment: np.ndarray  # at its stop, zero at the tip


def _load_density(arm: Arm, loads: Loads, s: np.ndarray, middle: float) -> np.ndarray:
    """Force per reference length at ``s`` in the panel around ``middle``, (3, ...)."""
    body = arm.body
    radius = body.radius_base + (body.radius_tip - body.radius_base) * s / body.length
    weight = (arm.material.density - loads.fluid_density) * np.pi * radius**2
    density = np.multiply.outer(np.array(loads.gravity), weight)
    for load in loads.distributed:
        if load.s[0] < middle < load.s[-1]:
            density = density + np.stack([np.interp(s, load.s, f) for f in zip(*load.force)])
    return density


def force_beyond(
    arm: Arm, loads: Loads, s: np.ndarray, stop: float, at_stop: np.ndarray
) -> np.ndarray:
    """Resultant (3, n) of the loads between ``s`` and the end ``stop`` of its panel."""
    points, weights = np.polynomial.legendre.leggauss(8)
    half = (stop - s) / 2
    where = s + np.multiply.outer(points + 1, half)
    density = _load_density(arm, loads, where, float((np.min(s) + stop) / 2))
    return at_stop[:, np.newaxis] + half * np.einsum('g,dgn->dn', weights, density)


def _panels(arm: Arm, loads: Loads) -> list[_Panel]:
    borders = {0.0, arm.length, *(section.anchorage for section in arm.sections)}
    borders |= {load.s for load in loads.points}
    borders |= {s for load in loads.distributed for s in load.s}
    ends = sorted(borders)
    panels: list[_Panel] = []
    force, moment = np.zeros(3), np.zeros(3)
    for start, stop in zip(ends[-2::-1], ends[:0:-1]):
        for load in loads.points:
            if load.s == stop:
                force = force + np.array(load.force)
                moment = moment + np.array(load.moment)
        active = active_at(arm, stop)
        panels.append(_Panel(start, stop, active, force, moment))
        force = force_beyond(arm, loads, np.array([start]), stop, force)[:, 0]
        moment = np.zeros(3)
    return panels[::-1]


def _rotation(quaternion: np.ndarray) -> np.ndarray:
    """Matrices (3, 3, n) of quaternions x, y, z, w (4, n) of any length."""
    return Rotation.from_quat(quaternion.T).as_matrix().transpose(1, 2, 0)


def loaded_bvp(
    arm: Arm,
    tensions: np.ndarray,
    start: Backbone,
    loads: Loads,
    *,
    shear: bool = False,
    tol: float = 1e-8,
) -> Shape:
    """Shape of the loaded arm of the linear law, as a boundary value problem of all panels.

    At the stations of the shape ``start``, near which it is searched. The unknowns of each panel
    are position, quaternion and moment; the force is known, as all loads are dead.
    """
    tensions = np.asarray(tensions, dtype=float)
    panels = _panels(arm, loads)
    count = len(panels)
    tip_force, tip_moment = np.array(loads.tip_force), np.array(loads.tip_moment)
    start_pose = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    size = 6 if shear else 4
    rest = np.zeros(size)
    rest[3] = 1.0
    warm: dict[tuple[int, int], np.ndarray] = {}

    def rates(number: int, s: np.ndarray, y: np.ndarray) -> np.ndarray:
        panel = panels[number]
        cut = Cut(arm, s, panel.active, tensions)
        axes = _rotation(y[3:7])
        force = force_beyond(arm, loads, s, panel.stop, panel.force_beyond)
        force = force + tip_force[:, np.newaxis]
        local = np.concatenate(
            [np.einsum('ijn,in->jn', axes, y[7:]), np.einsum('ijn,in->jn', axes, force)]
        )[:size]
        start = warm.get((number, s.size), np.tile(rest[:, np.newaxis], s.size))
        strain = cut.balance(local, start)
        warm[number, s.size] = strain
        forward = np.zeros((3, s.size))
        forward[: size - 3] = strain[3:]
        velocity = np.einsum('ijn,jn->in', axes, forward)
        kappa, (vector, scalar) = strain[:3], (y[3:6], y[6])
        turn = 0.5 * np.concatenate(
            [scalar * kappa + cross(vector, kappa), [-(vector * kappa).sum(axis=0)]]
        )
        return np.concatenate([velocity, turn, -cross(velocity, force)])

    def everywhere(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.concatenate(
            [
                (panel.stop - panel.start)
                * rates(number, panel.start + (panel.stop - panel.start) * x, part)
                for number, (panel, part) in enumerate(zip(panels, np.split(y, count)))
            ]
        )

    def borders(first: np.ndarray, last: np.ndarray) -> np.ndarray:
        begin, end = first.reshape(count, 10), last.reshape(count, 10)
        jumps = begin[1:] - end[:-1]
        moments = np.array([panel.point_moment for panel in panels])
        jumps[:, 7:] += moments[:-1]
        tip = end[-1, 7:] - tip_moment - moments[-1]
        return np.concatenate([begin[0, :7] - start_pose, jumps.ravel(), tip])

    x = np.linspace(0, 1, 15)
    known = np.column_stack([start.position, start.quaternion, 0.0 * start.position])
    y = np.concatenate(
        [
            CubicSpline(start.s, known)(panel.start + (panel.stop - panel.start) * x).T
            for panel in panels
        ]
    )
    solution = solve_bvp(everywhere, borders, x, y, tol=tol, bc_tol=1e-12, max_nodes=4000)
    assert solution.success, solution.message
    columns = []
    for s in start.s:
        number = next(i for i, panel in enumerate(panels) if s <= panel.stop)
        panel = panels[number]
        at = solution.sol((s - panel.start) / (panel.stop - panel.start))
        columns.append(at[10 * number : 10 * number + 7])
    poses = np.array(columns).T
    return Shape(poses[:3].T, _rotation(poses[3:]).transpose(2, 0, 1))
