"""Solve the paper's equations independently of the package, as a reference for tests.

Only the numbers and profiles of an `Arm` are from the package. The package uses the published
scalar equations, collocation, quaternions and a Lie-group integrator; this module uses vectors,
3x3 matrices and an ODE solver with tight tolerances.
"""

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from octo_arm_model import Arm, Pose

TANGENT = np.array([1.0, 0.0, 0.0])
Rates = Callable[[float], np.ndarray]


class Shape(NamedTuple):
    """Positions (n, 3), rotation matrices (n, 3, 3) with columns t, n, b; strains (n, 4)."""

    position: np.ndarray
    rotation: np.ndarray
    strains: np.ndarray


def cross(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return the cross product along the first axis; np.cross is slower on small arrays."""
    return np.stack(
        [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
    )


def active_at(arm: Arm, s: float) -> int:
    """Return the number of sections whose tendons act at ``s``, anchorages included."""
    return sum(section.anchorage >= s for section in arm.sections)


def cables(arm: Arm, active: int, s: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return offsets r of the cables of sections 1..active and their slopes r', (3, m, ...)."""
    offsets, slopes = [np.zeros((0, 3, *np.shape(s)))], [np.zeros((0, 3, *np.shape(s)))]
    for tendon in (each for section in arm.sections[:active] for each in section.tendons):
        y, phi = np.asarray(tendon.offset.value(s)), np.asarray(tendon.angle.value(s))
        radial = np.stack([0.0 * phi, np.cos(phi), np.sin(phi)])
        radial_rate = tendon.angle.slope(s) * np.stack([0.0 * phi, -np.sin(phi), np.cos(phi)])
        offsets.append((y * radial)[np.newaxis])
        slopes.append((tendon.offset.slope(s) * radial + y * radial_rate)[np.newaxis])
    return np.concatenate(offsets).swapaxes(0, 1), np.concatenate(slopes).swapaxes(0, 1)


def pulls(arm: Arm, tensions: np.ndarray, active: int) -> np.ndarray:
    """Return the tensions of the cables of sections 1..active, (m,)."""
    return np.ravel(tensions)[: sum(len(section.tendons) for section in arm.sections[:active])]


def stiffness(arm: Arm, s: float) -> np.ndarray:
    """Return the stiffnesses GI, EJ, EJ and EA (4,)."""
    young, shear = arm.material.youngs_modulus_at(s), arm.material.shear_modulus_at(s)
    area = np.pi * arm.body.radius(s) ** 2
    second = area**2 / (4 * np.pi)
    return np.array([2 * shear * second, young * second, young * second, young * area])


def omega_rate(
    arm: Arm, tensions: np.ndarray, active: int, s: float, omega: np.ndarray
) -> np.ndarray:
    """Return omega' from (4), K' omega + K omega' = M_dot, for a cone of one material.

    M_dot is the sum over the cables of (9b) in the local frame, of -T t_c x t and of
    -T dt_c/ds x (u - u_c), where u - u_c = -r, t_c = e_t + omega x r + r' and the derivative of a
    vector given in local components gains omega x of it: affine in omega'.
    """
    r, slope = cables(arm, active, s)
    turn, tangent = omega[:, np.newaxis], TANGENT[:, np.newaxis]
    pull = pulls(arm, tensions, active)
    t_c = tangent + cross(turn, r) + slope
    t_c_rate = cross(turn, slope) + cross(turn, t_c)
    constant = (cross(t_c_rate, r) - cross(t_c, tangent)) @ pull
    # (omega' x r) x r = (r r^T - |r|^2) omega'
    matrix = (pull * r) @ r.T - pull @ (r**2).sum(axis=0) * np.eye(3)
    rigid = stiffness(arm, s)[:3]
    taper = (arm.body.radius_tip - arm.body.radius_base) / arm.length
    rigid_rate = 4 * taper / arm.body.radius(s) * rigid
    return np.linalg.solve(np.diag(rigid) - matrix, constant - rigid_rate * omega)


def jump(arm: Arm, tensions: np.ndarray, number: int) -> np.ndarray:
    """Return the jump of omega by (11) at the anchorage of section ``number`` from the tip."""
    section = arm.sections[number - 1]
    t1, t2, t3, t4 = tensions[number - 1]
    b, bending = section.offset_anchorage, stiffness(arm, section.anchorage)[1]
    xi = b * (t4 - t2) / (b**2 * (t4 + t2) + bending)
    return np.array([0.0, xi, b * (t1 - t3) / (b**2 * (t1 + t3) + bending)])


def strains(
    arm: Arm, tensions: np.ndarray, active: int, s: float, omega: np.ndarray | None = None
) -> np.ndarray:
    """Return tau, xi, k, q: ``omega`` or that of (8a) with (3a), and q = N / EA of (9a)."""
    r, slope = cables(arm, active, s)
    pull, rigid = pulls(arm, tensions, active), stiffness(arm, s)
    if omega is None:
        matrix = np.diag(rigid[:3] + pull @ (r**2).sum(axis=0)) - (pull * r) @ r.T
        omega = np.linalg.solve(matrix, -cross(r, TANGENT[:, np.newaxis] + slope) @ pull)
    # N = -sum T t_c . t
    q = -pull @ (1.0 + cross(omega[:, np.newaxis], r)[0]) / rigid[3]
    return np.append(omega, q)


def strain_functions(
    arm: Arm, tensions: np.ndarray, model: str
) -> list[tuple[float, float, Rates]]:
    """Return smooth panels (start, stop, function from s to strains) from the base to the tip."""
    tensions = np.asarray(tensions, dtype=float)
    ends = {0.0, arm.length, *(section.anchorage for section in arm.sections)}
    panels: list[tuple[float, float, Rates]] = []
    omega = np.zeros(3)
    for start, stop in pairwise(sorted(ends | {s for s in arm.knots if s < arm.length})):
        active = active_at(arm, stop)
        panels.append((start, stop, partial(strains, arm, tensions, active)))
    for number, (start, stop, closed) in reversed(list(enumerate(panels))):
        active = active_at(arm, stop)
        if model == 'closed_form' or not active:
            continue
        omega = omega + jump(arm, tensions, active)
        solution = solve_ivp(
            lambda s, w, n=active: omega_rate(arm, tensions, n, s, w),
            (stop, start),
            omega,
            'DOP853',
            dense_output=True,
            rtol=1e-11,
            atol=1e-11,
        )
        assert solution.success
        omega = solution.y[:, -1]
        panels[number] = start, stop, lambda s, of=solution.sol, own=closed: own(s, of(s))
    return panels


def solve(
    arm: Arm, tensions: np.ndarray, model: str, stations: np.ndarray, base: Pose = Pose()
) -> Shape:
    """Return the shape at ``stations``: (1) for t, n, b and the position, by an ODE solver."""

    def rates(s: float, state: np.ndarray, strains_of: Rates) -> np.ndarray:
        tau, xi, k, q = strains_of(s)
        t, n, b = state[3:].reshape(3, 3)
        frame_rate = np.concatenate([k * n - xi * b, -k * t + tau * b, xi * t - tau * n])
        return (1 + q) * np.concatenate([t, frame_rate])

    axes = Rotation.from_quat(base.quaternion).as_matrix().T
    state = np.concatenate([base.position, axes.ravel()])
    states, at_stations = [], []
    for start, stop, strains_of in strain_functions(arm, tensions, model):
        first = stations >= start if start == 0.0 else stations > start
        inside = stations[first & (stations <= stop)]
        solution = solve_ivp(
            rates,
            (start, stop),
            state,
            'DOP853',
            np.union1d(inside, stop),
            rtol=1e-10,
            atol=1e-11,
            args=(strains_of,),
        )
        assert solution.success
        state = solution.y[:, -1]
        states.append(solution.y[:, : inside.size])
        at_stations += [strains_of(s) for s in inside]
    position, axes = np.split(np.concatenate(states, axis=1).T, [3], axis=1)
    rotation = axes.reshape(-1, 3, 3).transpose(0, 2, 1)
    return Shape(position, rotation, np.array(at_stations))
