"""The inputs and the state of a moving arm; states can be copied and saved."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.arm.hints import FloatArray, Vector
from octo_arm_model.arm.pose import Pose
from octo_arm_model.rod.equilibrium import Condition
from octo_arm_model.rod.factors import Factors, Linear
from octo_arm_model.rod.inertia import MovingProblem
from octo_arm_model.rod.tables import COLUMNS

_VERSION = 2  # version of the files of states
_ARRAYS = 'twist', 'place', 'water', 'tensions', 'tip_wrench', 'base', 'wrench', 'base_wrench'
_MOST_BYTES = 2**28  # largest size of a file


@dataclass(frozen=True)
class Inputs:
    """The inputs of an arm at the end of a step; they change linearly over the step.

    Attributes:
        tensions: tensions of the tendons at the base [N], of `Arm.tension_shape`.
        displacements: lengths that winches have reeled in, by tendon name [m]; the tensions of
            these tendons are not used.
        tip_wrench: force and moment on the tip in base_frame, besides those of the loads, (6,)
            [N, N m]; None for zero.
        current: velocity of the water [m/s]; None for that of `MotionProperties`.
        base: pose of the base; None for that of the solver.
    """

    tensions: ArrayLike
    displacements: Mapping[str, float] = field(default_factory=dict)
    tip_wrench: ArrayLike | None = None
    current: Vector | None = None
    base: Pose | None = None


class CheckedInputs(NamedTuple):
    """Checked `Inputs` as arrays."""

    condition: Condition  #: tensions, lengths and tip wrench, which includes that of the loads
    current: FloatArray  #: velocity of the water, (3,) [m/s]
    base: FloatArray  #: position [m] and quaternion w, x, y, z of the base, (7,)


@dataclass(frozen=True, eq=False)
class MotionState:
    """The state of a moving arm, on which the next step depends.

    Arrays are read-only. There are N nodes with m strains. Places are positions from the base of
    the solver, and axes, (N, 12).

    Attributes:
        time: time of the state [s].
        twist: twists, their rates, and accelerations of the rule after this step and the last one,
            (4, N, m).
        place: places, velocities, accelerations and accelerations of the rule, (4, N, 12).
        water: velocity of the water, its acceleration and that of the rule, (3, 3).
        tensions: tensions of the tendons at the base [N], (J,).
        tip_wrench: wrench on the tip, which includes that of the loads, (6,) [N, N m].
        base: position [m] and quaternion w, x, y, z of the base, (7,).
        wrench: largest moment and force along the arm in the axes of sections, (m,) [N m, N].
        base_wrench: wrench about the base of all loads, inertia and water, (6,) [N, N m].
        history: tensions at the points of friction [N], (M, J); None without friction.
        residual: residual of the balance [-].
        iterations: number of iterations of the last step.
        dt: size of the last step [s]; 0 at rest.
        factors: factors that the next step may begin with.
    """

    time: float
    twist: FloatArray
    place: FloatArray
    water: FloatArray
    tensions: FloatArray
    tip_wrench: FloatArray
    base: FloatArray
    wrench: FloatArray
    base_wrench: FloatArray
    history: FloatArray | None = None
    residual: float = 0.0
    iterations: int = 0
    dt: float = 0.0
    factors: Linear | None = None

    @property
    def z(self) -> FloatArray:
        """Copy of the twists (N, m), as numba would compile again for a read-only array."""
        return self.twist[0].copy()


def save_state(state: MotionState, path: Path, others: Mapping[str, FloatArray]) -> None:
    """Write a ``state`` and other arrays to ``path``; `load_state` restores it exactly."""
    arrays = {name: getattr(state, name) for name in _ARRAYS} | dict(others)
    arrays['numbers'] = np.array(
        [_VERSION, state.time, state.residual, state.iterations, state.dt]
    )
    if state.history is not None:
        arrays['history'] = state.history
    if isinstance(state.factors, Factors):
        factors, pivots, sign = state.factors
        arrays |= {'factors': factors, 'pivots': pivots, 'sign': np.array(sign)}
    with path.open('wb') as file:
        np.savez(file, **arrays)


def load_state(path: Path, problem: MovingProblem) -> MotionState:
    """Return the state in the file ``path`` of an arm with the equations ``problem``.

    Raises:
        ConfigError: if the file cannot be read, or is of another arm or version.
    """
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise ValueError(f'it has more than {_MOST_BYTES} bytes')
        # The file is opened here, as NumPy leaves one open that is damaged.
        with path.open('rb') as opened, np.load(opened, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except Exception as error:
        # Damaged files make zipfile and NumPy raise errors of many types, MemoryError too.
        raise ConfigError(f'{path} cannot be read as a state: {error}') from None
    _check(arrays, path, problem)
    version, time, residual, iterations, dt = arrays['numbers'].tolist()
    if version != _VERSION:
        raise ConfigError(f'{path} is of version {version:g}, expected {_VERSION}')
    factors: Linear | None = None
    if 'factors' in arrays:
        lu = np.asfortranarray(arrays['factors'])
        factors = Factors(lu, arrays['pivots'].astype(np.int32), int(arrays['sign']))
    values = {name: arrays[name] for name in _ARRAYS}
    return MotionState(
        time,
        **values,
        history=arrays.get('history'),
        residual=residual,
        iterations=int(iterations),
        dt=dt,
        factors=factors,
    )


def _check(arrays: dict[str, FloatArray], path: Path, problem: MovingProblem) -> None:
    nodes, strains, count = problem.elements.s.size, problem.strains, problem.tables.friction.size
    shapes: dict[str, tuple[int, ...]] = {
        'numbers': (5,),
        'twist': (4, nodes, strains),
        'place': (4, nodes, COLUMNS),
        'water': (3, 3),
        'tensions': (count,),
        'tip_wrench': (6,),
        'base': (7,),
        'wrench': (strains,),
        'base_wrench': (6,),
    }
    if problem.friction is not None:
        shapes['history'] = (problem.friction.fine.s.size, count)
    size = nodes * strains
    if 'factors' in arrays:
        shapes |= {'factors': (size, size), 'pivots': (size,), 'sign': ()}
    for name, shape in shapes.items():
        array = arrays.get(name)
        if array is None or array.shape != shape or array.dtype.kind not in 'fi':
            description = 'missing' if array is None else f'{array.dtype} {array.shape}'
            raise ConfigError(f'{path}: {name} is {description}, expected numbers {shape}')
        if not np.isfinite(array).all():
            raise ConfigError(f'{path}: {name} is not finite')
        array.setflags(write=False)
    if 'factors' in arrays and not (0 <= arrays['pivots'].min() <= arrays['pivots'].max() < size):
        raise ConfigError(f'{path}: pivots are out of range, expected 0 to {size - 1}')
