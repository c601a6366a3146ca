"""An independent solution of the paper's statements, for the tests to compare with.

Nothing here uses the package but the plain numbers of an `Arm`. Where the package uses the
published scalar equations, collocation, quaternions and a Lie-group integrator, this uses
vectors, 3x3 matrices and an ODE solver at tight tolerance.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from octo_arm_model import Arm, Pose

TANGENT = np.array([1.0, 0.0, 0.0])
# Offset of tendon 1 to 4 from the midline per unit distance, in the axes (t, n, b) (eq. 6).
DIRECTIONS = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
Rates = Callable[[float], np.ndarray]


class Shape(NamedTuple):
    """Positions (n, 3), rotation matrices (n, 3, 3) with columns t, n, b; strains (n, 4)."""

    position: np.ndarray
    rotation: np.ndarray
    strains: np.ndarray


def cross(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Cross product along the last axis; np.cross takes longer on small arrays."""
    x, y, z = np.moveaxis(u, -1, 0)
    p, q, r = np.moveaxis(v, -1, 0)
    return np.stack([y * r - z * q, z * p - x * r, x * q - y * p], axis=-1)


def stiffness(arm: Arm, s: float) -> np.ndarray:
    """K = diag(GI, EJ, EJ) and below it EA: four numbers."""
    young, ratio = arm.material.youngs_modulus, arm.material.poisson_ratio
    body = arm.body
    radius = (body.radius_tip - body.radius_base) / body.length * s + body.radius_base
    bending = young * np.pi * radius**4 / 4
    shear = young / (2 * (1 + ratio))
    return np.array([shear * np.pi * radius**4 / 2, bending, bending, young * np.pi * radius**2])


def stiffness_rate(arm: Arm, s: float) -> np.ndarray:
    """Derivative of the three rotational stiffnesses along s."""
    body = arm.body
    taper = (body.radius_tip - body.radius_base) / body.length
    return 4 * taper / (body.radius_base + taper * s) * stiffness(arm, s)[:3]


def cables(arm: Arm, active: int, s: float) -> tuple[np.ndarray, np.ndarray]:
    """Offsets r of the cables of sections 1..active and their derivative r', each (m, 3)."""
    offsets, slopes = [], []
    for section in arm.sections[:active]:
        slope = (section.offset_anchorage - section.offset_base) / section.anchorage
        offsets.append((section.offset_base + slope * s) * DIRECTIONS)
        slopes.append(slope * DIRECTIONS)
    return np.concatenate(offsets), np.concatenate(slopes)


def moment_rate(
    arm: Arm, tensions: np.ndarray, active: int, s: float, omega: np.ndarray, rate: np.ndarray
) -> np.ndarray:
    """Sum over the cables of (9b) in the local frame, for omega and its derivative ``rate``.

    M_dot = -T t_c x t - T dt_c/ds x (u - u_c), where u - u_c = -r, t_c = e_t + omega x r + r'
    and the derivative of a vector given in local components gains omega x of it.
    """
    r, slope = cables(arm, active, s)
    pull = np.reshape(tensions[:active], (-1, 1))
    t_c = TANGENT + cross(omega, r) + slope
    t_c_rate = cross(rate, r) + cross(omega, slope) + cross(omega, t_c)
    return (-pull * cross(t_c, TANGENT) + pull * cross(t_c_rate, r)).sum(axis=0)


def omega_rate(
    arm: Arm, tensions: np.ndarray, active: int, s: float, omega: np.ndarray
) -> np.ndarray:
    """omega' from (4), K' omega + K omega' = M_dot, where M_dot is affine in omega'."""
    constant = moment_rate(arm, tensions, active, s, omega, np.zeros(3))
    columns = [moment_rate(arm, tensions, active, s, omega, axis) - constant for axis in np.eye(3)]
    matrix = np.diag(stiffness(arm, s)[:3]) - np.stack(columns, axis=1)
    return np.linalg.solve(matrix, constant - stiffness_rate(arm, s) * omega)


def jump(arm: Arm, tensions: np.ndarray, number: int) -> np.ndarray:
    """Change of omega by (11) at the anchorage of section ``number``, counted from the tip."""
    section = arm.sections[number - 1]
    t1, t2, t3, t4 = tensions[number - 1]
    b, bending = section.offset_anchorage, stiffness(arm, section.anchorage)[1]
    xi = b * (t4 - t2) / (b**2 * (t4 + t2) + bending)
    return np.array([0.0, xi, b * (t1 - t3) / (b**2 * (t1 + t3) + bending)])


def longitudinal_strain(
    arm: Arm, tensions: np.ndarray, active: int, s: float, omega: np.ndarray
) -> float:
    """q = N / EA with N = -sum T t_c . t (9a)."""
    r, slope = cables(arm, active, s)
    t_c = TANGENT + cross(omega, r) + slope
    return float(-(np.ravel(tensions[:active]) * t_c[:, 0]).sum() / stiffness(arm, s)[3])


def closed_form_omega(arm: Arm, tensions: np.ndarray, active: int, s: float) -> np.ndarray:
    """omega from (8a) and (3a): the full 3x3 system, tendon by tendon."""
    matrix, right = np.diag(stiffness(arm, s)[:3]), np.zeros(3)
    for r, slope, pull in zip(*cables(arm, active, s), np.ravel(tensions[:active])):
        matrix = matrix + pull * (r @ r * np.eye(3) - np.outer(r, r))
        right = right - pull * np.cross(r, TANGENT + slope)
    return np.linalg.solve(matrix, right)


def strain_functions(
    arm: Arm, tensions: np.ndarray, model: str
) -> list[tuple[float, float, Rates]]:
    """Panels (start, stop, strains of s) from the base to the tip, each smooth."""
    tensions = np.asarray(tensions, dtype=float)
    stretches: list[tuple[float, float, Rates]] = []
    if arm.sections[0].anchorage < arm.body.length:
        stretches.append((arm.sections[0].anchorage, arm.body.length, lambda s: np.zeros(4)))
    omega = np.zeros(3)
    for number, section in enumerate(arm.sections, start=1):
        stop = section.anchorage
        start = arm.sections[number].anchorage if number < len(arm.sections) else 0.0
        if model == 'renda2012':
            omega = omega + jump(arm, tensions, number)
            solution = solve_ivp(
                lambda s, w, n=number: omega_rate(arm, tensions, n, s, w),
                (stop, start),
                omega,
                'DOP853',
                dense_output=True,
                rtol=1e-11,
                atol=1e-11,
            )
            assert solution.success
            of_s, omega = solution.sol, solution.y[:, -1]
        else:

            def of_s(s: float, n: int = number) -> np.ndarray:
                return closed_form_omega(arm, tensions, n, s)

        def strains(s: float, of_s: Rates = of_s, n: int = number) -> np.ndarray:
            w = of_s(s)
            return np.append(w, longitudinal_strain(arm, tensions, n, s, w))

        stretches.append((start, stop, strains))
    return stretches[::-1]


def integrate_kinematics(
    stretches: list[tuple[float, float, Rates]], stations: np.ndarray, base: Pose = Pose()
) -> Shape:
    """(1) for the 3x3 matrix of t, n, b and the position, by an ODE solver."""

    def rates(s: float, state: np.ndarray, strains: Rates) -> np.ndarray:
        tau, xi, k, q = strains(s)
        t, n, b = state[3:].reshape(3, 3)
        frame_rate = np.concatenate([k * n - xi * b, -k * t + tau * b, xi * t - tau * n])
        return (1 + q) * np.concatenate([t, frame_rate])

    axes = Rotation.from_quat(base.quaternion).as_matrix().T
    state = np.concatenate([base.position, axes.ravel()])
    states, at_stations = [], []
    for start, stop, strains in stretches:
        inside = stations[(stations > start) & (stations <= stop)]
        if start == stretches[0][0]:
            inside = np.append(start, inside)
        solution = solve_ivp(
            rates, (start, stop), state, 'DOP853', inside, rtol=1e-10, atol=1e-11, args=(strains,)
        )
        assert solution.success
        state = solution.y[:, -1]
        states.append(solution.y)
        at_stations += [strains(s) for s in inside]
    position, axes = np.split(np.concatenate(states, axis=1).T, [3], axis=1)
    rotation = axes.reshape(-1, 3, 3).transpose(0, 2, 1)
    return Shape(position, rotation, np.array(at_stations))


def solve(
    arm: Arm, tensions: np.ndarray, model: str, stations: np.ndarray, base: Pose = Pose()
) -> Shape:
    """Shape of the arm at ``stations``, which must hold every anchorage and both ends."""
    return integrate_kinematics(strain_functions(arm, tensions, model), stations, base)
