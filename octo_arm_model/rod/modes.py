"""Small motions about an equilibrium: natural frequencies, and a linear model for control.

The residual of a rod that moves is linear in small changes of its twists z and their rates,

    K dz + C dz' + M dz'' + P dT = 0

for changes dT of the tensions. M times the weights of the nodes is symmetric (Gauss collocation),
and so is K if all loads have an energy.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh

from octo_arm_model.arm.errors import ConfigError, SolveError, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.equilibrium import Condition
from octo_arm_model.rod.loads import kinematics
from octo_arm_model.rod.motion import Dynamics, MotionState

_AT_REST = 1e-3  # residual without the motion, up to which a state counts as at rest


class Modes(NamedTuple):
    """The natural modes of an arm about an equilibrium, the slowest first.

    Attributes:
        frequencies: natural frequencies without damping [Hz], (k,).
        damping: ratio of the damping to the critical one [-], (k,).
        shapes: displacements of the stations in base_frame, of largest norm 1, (k, S, 3).
    """

    frequencies: FloatArray
    damping: FloatArray
    shapes: FloatArray


class LinearModel(NamedTuple):
    """The state-space model x' = A x + B u, y = C x + D u, in k modes about an equilibrium.

    The input u is the change of the tensions of J tendons [N], the output y that of the position
    of the tip [m]. D is the static response of the faster modes.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray


class _ModalEquations(NamedTuple):
    """Modes of unit mass as columns, (N m, k), and the linear equations in them."""

    shapes: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    full_stiffness: FloatArray
    weights: FloatArray
    by_stations: FloatArray
    by_tensions: FloatArray


def modes(dynamics: Dynamics, state: MotionState, count: int = 6) -> Modes:
    """Return the ``count`` slowest modes about a ``state`` at rest, see `Dynamics.at_rest`.

    Tendons with friction stick. Damping ratios are to first order in the coupling of the modes.

    Raises:
        ConfigError: if there are not so many modes, or the state is not at rest.
        SolveError: if the equilibrium is not stable.
    """
    equations = _linearisation(dynamics, state, count)
    omega = np.sqrt(equations.stiffness.diagonal())
    displacement = np.moveaxis(equations.by_stations @ equations.shapes, -1, 0)
    size = np.sqrt((displacement * displacement).sum(axis=2)).max(axis=1)
    return Modes(
        omega / (2.0 * np.pi),
        0.5 * equations.damping.diagonal() / omega,
        displacement / size[:, np.newaxis, np.newaxis],
    )


def linearise(dynamics: Dynamics, state: MotionState, count: int = 12) -> LinearModel:
    """Return the linear model in ``count`` modes about a ``state`` at rest.

    Raises:
        ConfigError: as `modes` does, or if tendons have friction, which has no derivative.
        SolveError: if the equilibrium is not stable.
    """
    if dynamics.problem.friction is not None:
        raise ConfigError('tendons have friction: the arm has no linear model')
    equations = _linearisation(dynamics, state, count)
    one, zero = np.eye(count), np.zeros((count, count))
    tip = equations.by_stations[-1]
    push = -equations.shapes.T @ (equations.weights[:, np.newaxis] * equations.by_tensions)
    by_modes = tip @ equations.shapes
    direct = -tip @ np.linalg.solve(equations.full_stiffness, equations.by_tensions)
    direct -= by_modes @ np.linalg.solve(equations.stiffness, push)
    return LinearModel(
        np.block([[zero, one], [-equations.stiffness, -equations.damping]]),
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
    if not known.residual <= _AT_REST:
        residual = f'{known.residual:.1e}, expected at most {_AT_REST:g}'
        raise ConfigError(f'the arm is not at rest: without motion its residual is {residual}')
    # With tensions held at every node tendons with friction stick.
    condition = Condition(known.at_nodes.tensions, state.tip_wrench)
    known = problem.evaluate(problem.at_nodes(condition), z)
    problem.fill_jacobian(known)
    matrices = [problem.work.jacobian.copy()]
    jacobian = problem.work.jacobian
    for c1, c0 in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)):
        jacobian[:] = 0.0
        problem.add_motion(z, c1, c0)
        matrices.append(jacobian.copy())
    stiffness, at_rest = matrices[0], matrices[1]
    damping, inertia = matrices[2] - at_rest, matrices[3] - at_rest
    weights = np.repeat(problem.elements.weights, z.shape[1])
    weighted = [weights[:, np.newaxis] * matrix for matrix in (stiffness, inertia)]
    potential, kinetic = (0.5 * (matrix + matrix.T) for matrix in weighted)
    slowest = [size - count, size - 1]
    try:
        # The eigenvalues are those of M by K, as M is nearly singular in the fastest modes.
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
