"""Small motions about an equilibrium: natural frequencies, and a linear model for control.

The residual of a rod that moves is linear in small changes of its twists z and their rates,

    K dz + C dz' + M dz'' + P dT = 0

for changes dT of the tensions. Times the weights of the nodes K and M are symmetric (Gauss
collocation), K where all loads have an energy.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh

from octo_arm_model.arm.errors import ConfigError, SolveError, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.equilibrium import Condition
from octo_arm_model.rod.loads import kinematics
from octo_arm_model.rod.motion import Dynamics, MotionState


class Modes(NamedTuple):
    """Natural modes of an arm about an equilibrium, the slowest first.

    Attributes:
        frequencies: without damping [Hz], (k,).
        damping: ratio of the damping to the critical one [-], (k,).
        shapes: displacement of the stations in base_frame, the largest 1, (k, S, 3).
    """

    frequencies: FloatArray
    damping: FloatArray
    shapes: FloatArray


class LinearModel(NamedTuple):
    """State space x' = A x + B u, y = C x + D u, about an equilibrium, in k of its modes.

    The input u is the change of the tensions of J tendons [N], the output y that of the position
    of the tip [m]. D is what faster modes contribute, as if they followed at once.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray


class _ModalEquations(NamedTuple):
    """Modes as columns, (N m, k), and the linear equations in them, of mass one."""

    shapes: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    full_stiffness: FloatArray
    weights: FloatArray
    by_stations: FloatArray
    by_tensions: FloatArray


def modes(dynamics: Dynamics, state: MotionState, count: int = 6) -> Modes:
    """The ``count`` slowest modes about a ``state`` at rest, as `Dynamics.at_rest` gives it.

    Tendons with friction stick. Damping ratios are to first order in what couples the modes.

    Raises:
        ConfigError: if there are not so many modes.
        SolveError: if the equilibrium is not stable.
    """
    found = _linearisation(dynamics, state, count)
    omega = np.sqrt(found.stiffness.diagonal())
    moved = np.moveaxis(found.by_stations @ found.shapes, -1, 0)
    size = np.sqrt((moved * moved).sum(axis=2)).max(axis=1)
    return Modes(
        omega / (2.0 * np.pi),
        0.5 * found.damping.diagonal() / omega,
        moved / size[:, np.newaxis, np.newaxis],
    )


def linearise(dynamics: Dynamics, state: MotionState, count: int = 12) -> LinearModel:
    """The linear model in ``count`` modes about a ``state`` at rest.

    Raises:
        ConfigError: if there are not so many modes, or tendons have friction, which has no
            derivative.
        SolveError: if the equilibrium is not stable.
    """
    if dynamics.problem.friction is not None:
        raise ConfigError('tendons have friction: the arm has no linear model')
    found = _linearisation(dynamics, state, count)
    one, zero = np.eye(count), np.zeros((count, count))
    tip = found.by_stations[-1]
    push = -found.shapes.T @ (found.weights[:, np.newaxis] * found.by_tensions)
    by_modes = tip @ found.shapes
    direct = -tip @ np.linalg.solve(found.full_stiffness, found.by_tensions)
    direct -= by_modes @ np.linalg.solve(found.stiffness, push)
    return LinearModel(
        np.block([[zero, one], [-found.stiffness, -found.damping]]),
        np.concatenate([np.zeros_like(push), push]),
        np.concatenate([by_modes, np.zeros_like(by_modes)], axis=1),
        direct,
    )


def _linearisation(dynamics: Dynamics, state: MotionState, count: int) -> _ModalEquations:
    problem, z = dynamics.problem, state.z
    size = z.size
    if count not in range(1, size + 1):
        raise ConfigError(f'number of modes is {shown(count)}, expected 1 to {size}')
    known = dynamics.still(state)
    # With tensions held at every node tendons with friction stick.
    condition = Condition(known.at_nodes.tensions, state.tip_wrench)
    known = problem.evaluate(problem.at_nodes(condition), z)
    problem.fill_jacobian(known)
    parts = [problem.work.jacobian.copy()]
    jacobian = problem.work.jacobian
    for c1, c0 in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)):
        jacobian[:] = 0.0
        problem.add_motion(z, c1, c0)
        parts.append(jacobian.copy())
    stiffness, still = parts[0], parts[1]
    damping, inertia = parts[2] - still, parts[3] - still
    weights = np.repeat(problem.elements.weights, z.shape[1])
    weighted = [weights[:, np.newaxis] * one for one in (stiffness, inertia)]
    potential, kinetic = (0.5 * (one + one.T) for one in weighted)
    slowest = [size - count, size - 1]
    try:
        # Of M about K, as M hardly differs from zero in the fastest modes.
        squares, shapes = eigh(kinetic, potential, subset_by_index=slowest)
    except np.linalg.LinAlgError:
        raise SolveError('the equilibrium is not stable: it has no modes') from None
    shapes = shapes[:, ::-1] / np.sqrt(squares[::-1])
    rows = shapes.T * weights
    _, slope = kinematics(problem.elements.from_base, problem.work, z.shape[1])
    places = dynamics.places.integration
    by_stations = (places @ slope.reshape(len(z), -1)).reshape(len(places), 3, size)
    by_tensions = problem.tendons(known).stretch_by_twist * problem.tables.reach[..., np.newaxis]
    return _ModalEquations(
        shapes,
        rows @ stiffness @ shapes,
        rows @ damping @ shapes,
        stiffness,
        weights,
        by_stations,
        by_tensions.swapaxes(1, 2).reshape(size, -1),
    )
