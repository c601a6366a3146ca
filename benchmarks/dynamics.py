"""Measure how much faster than real time the dynamics are, on one core.

    python benchmarks/dynamics.py [--brief]

The arm of Table 4 moves in water (Renda et al. 2018). Its tensions rise for 0.2 s and are then
held, in time steps of 2 or 5 ms. The cases are NumPy, numba, friction, winches, finer meshes and
eight arms in one process. Each step counts with its shortest time of several rounds, because other
programs use the machine.

If PyElastica is installed (pip install pyelastica), both codes compute the swing of a tapered rod.
The error of each is relative to its own limit; the limits differ by less than a millimetre.
"""

from __future__ import annotations

import dataclasses
import functools
import os
import time
from collections.abc import Callable
from typing import Any

# BLAS reads this when it is loaded.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import numpy as np
from brief import IS_BRIEF, make_parser

from octo_arm_model import (
    Arm,
    Body,
    Dynamics,
    Inputs,
    Loads,
    Material,
    MotionProperties,
    Section,
    Solver,
    load_config,
)
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.material import WATERS
from octo_arm_model.rod.elements import LEVELS
from octo_arm_model.rod.forms import is_available

_SECONDS, _RAMP, _ROUNDS = (0.05, 0.2, 1) if IS_BRIEF else (1.0, 0.2, 5)
_ARMS = 8
_PULL = np.array([[0.05, 0.0, 0.0, 0.0], [0.1, 0.3, 0.0, 0.0], [0.2, 0.0, 0.1, 0.0]])
_REELED_IN = {'tendon_3_1': 0.004, 'tendon_1_2': 0.002}
_LOADS = Loads(gravity=(0.0, 0.0, -9.81), fluid_density=1022.0)
_WATER = MotionProperties(300.0, 0.0, *WATERS['renda2018'])


def real_time_ratio(
    dynamics: Dynamics, step: float, reeled_in: dict[str, float], arms: int = 1
) -> tuple[float, FloatArray]:
    """Return the ratio of simulated to computing time, and the tip of the last arm (3,) [m]."""
    rest, steps = dynamics.at_rest(Inputs(0.0 * _PULL)), round(_SECONDS / step)
    shortest = np.full((steps, arms), np.inf)
    for _ in range(_ROUNDS):
        states = [rest] * arms
        for k, arm in np.ndindex(steps, arms):
            fraction = min((k + 1) * step / _RAMP, 1.0)
            lengths = {name: fraction * value for name, value in reeled_in.items()}
            # Arms differ in their tensions; the last has all of _PULL.
            inputs = Inputs(fraction * (arm + 1) / arms * _PULL, lengths)
            start = time.perf_counter()
            states[arm] = dynamics.step(states[arm], inputs, step)
            shortest[k, arm] = min(shortest[k, arm], time.perf_counter() - start)
    return _SECONDS / float(shortest.sum()), dynamics.backbone(states[-1]).tip


def dynamics_in_water(arm: Arm, compiled: bool, level: int = 0) -> Dynamics:
    """Return the dynamics of an ``arm`` in water."""
    solver = Solver(arm, 'exact', loads=_LOADS, compiled=compiled)
    return Dynamics(solver, _WATER, level=level)


# A tapered rod falls from straight, in air and without damping: length, radius at the base and at
# the tip [m], E [Pa], density [kg/m^3], gravity [m/s^2].
_ROD = 0.45, 0.015, 0.005, 1.1e5, 1080.0, 1.0
_SWING = 0.1 if IS_BRIEF else 1.0  # [s]
_FIRST = 1e-5  # first time steps, in which gravity jumps [s]


def swing_by_us(level: int, step: float) -> tuple[float, FloatArray]:
    """Return the computing time of the swing [s] and the tip at its end (3,) [m]."""
    length, base, tip, young, density, gravity = _ROD
    tendons = Section(length, 0.5 * tip, 0.5 * tip)
    arm = Arm(Material(young, density=density), Body(length, base, tip), (tendons,))

    def dynamics_under(acceleration: float) -> Dynamics:
        loads = Loads(gravity=(0.0, 0.0, -acceleration))
        solver = Solver(arm, 'exact', stations=2, material='linear', shear=True, loads=loads)
        return Dynamics(solver, level=level)

    dynamics, inputs = dynamics_under(gravity), Inputs(np.zeros((1, 4)))
    state = dynamics_under(0.0).at_rest(inputs)
    start = time.perf_counter()
    for dt in (*10 * [_FIRST], step - 10 * _FIRST, *(round(_SWING / step) - 1) * [step]):
        state = dynamics.step(state, inputs, dt)
    return time.perf_counter() - start, dynamics.backbone(state).tip


def swing_by_elastica(elastica: Any, elements: int) -> tuple[float, FloatArray]:
    """Return the same two results as `swing_by_us`, computed by PyElastica."""
    length, base, tip, young, density, gravity = _ROD
    middle = (np.arange(elements) + 0.5) / elements
    rod = elastica.CosseratRod.straight_rod(
        elements,
        np.zeros(3),
        np.array([1.0, 0.0, 0.0]),
        np.array([0.0, 0.0, 1.0]),
        length,
        base + (tip - base) * middle,
        density,
        youngs_modulus=young,
        shear_modulus=young / 3.0,
    )
    mixins = elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing
    simulator = type('World', mixins, {})()
    simulator.append(rod)
    simulator.constrain(rod).using(
        elastica.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,)
    )
    weight = np.array([0.0, 0.0, -gravity])
    simulator.add_forcing_to(rod).using(elastica.GravityForces, acc_gravity=weight)
    simulator.finalize()
    # Twice this time step is not stable.
    stepper, steps = elastica.PositionVerlet(), round(_SWING / min(5e-4, 0.02 / elements))
    simulated, dt = np.float64(0.0), np.float64(_SWING / steps)
    start = time.perf_counter()
    for _ in range(steps):
        simulated = stepper.step(simulator, simulated, dt)
    return time.perf_counter() - start, rod.position_collection[:, -1].copy()


def print_swings(
    name: str,
    swing: Callable[[int], tuple[float, FloatArray]],
    unit: str,
    sizes: list[int],
    order: int,
) -> FloatArray:
    """Print error and time of each size; return the tip extrapolated by ``order`` (3,) [m]."""
    swing(sizes[0])  # compiles
    results = [swing(size) for size in sizes]
    (previous, last), ratio = (tip for _, tip in results[-2:]), (sizes[-1] / sizes[-2]) ** order
    limit = last + (last - previous) / (ratio - 1.0)
    for size, (elapsed, tip) in zip(sizes, results):
        error = 1e3 * float(np.linalg.norm(tip - limit))
        print(f'{name:12}{size:6} {unit:18}{error:10.3f} mm {elapsed:9.3f} s')
    return limit


def print_speeds(plain: Arm, is_compiled: bool) -> None:
    """Print the speed of the ``plain`` arm, and of the arm with friction and with winches."""
    with_friction = dataclasses.replace(plain, friction=(0.1,))
    with_winches = dataclasses.replace(plain, axial_stiffness=(500.0,))
    cases: list[tuple[str, Arm, float, bool, dict[str, float], int]] = [
        ('NumPy, 2 ms', plain, 2e-3, False, {}, 1)
    ]
    if is_compiled:
        cases += [
            ('numba, 2 ms', plain, 2e-3, True, {}, 1),
            ('numba, 5 ms', plain, 5e-3, True, {}, 1),
            ('numba, 2 ms, friction', with_friction, 2e-3, True, {}, 1),
            ('numba, 2 ms, winches', with_winches, 2e-3, True, _REELED_IN, 1),
            (f'numba, 5 ms, {_ARMS} arms', plain, 5e-3, True, {}, _ARMS),
        ]
    print(f'{"case":24} simulated s per s')
    for name, arm, step, compiled, reeled_in, arms in cases:
        ratio, _ = real_time_ratio(dynamics_in_water(arm, compiled), step, reeled_in, arms)
        print(f'{name:24} {ratio:8.2f}')


def print_meshes(plain: Arm, is_compiled: bool) -> None:
    """Print time per step and error of the tip for meshes of the rod."""
    print('\nelements  points  nodes  ms/step of 2 ms   tip to finest [mm]')
    levels = range(2 if IS_BRIEF else len(LEVELS) - 1)
    meshes = [dynamics_in_water(plain, is_compiled, level) for level in levels]
    results = [(mesh.nodes, *real_time_ratio(mesh, 2e-3, {})) for mesh in meshes]
    for nodes, ratio, tip in results:
        distance = 1e3 * float(np.linalg.norm(tip - results[-1][-1]))
        counts = f'{nodes.lengths.size:8} {nodes.points:7} {nodes.s.size:6}'
        print(f'{counts} {2.0 / ratio:18.2f} {distance:24.1e}')


def main() -> None:
    """Print the speeds, the meshes and the comparison with PyElastica."""
    make_parser(__doc__).parse_args()
    plain = load_config('renda2012_table4').arm.with_density(1080.0)
    is_compiled = is_available()
    print_speeds(plain, is_compiled)
    print_meshes(plain, is_compiled)
    try:
        import elastica
    except ImportError:
        print('\nPyElastica is not installed')
        return
    print(f'\n{"tapered rod":12}{"":24}{"tip error":>13} {"per simulated s":>15}')
    ours = print_swings(
        'this code', lambda n: swing_by_us(1, 1.0 / n), 'steps/s', [50, 100, 200, 1000, 2000], 2
    )
    swing = functools.partial(swing_by_elastica, elastica)
    theirs = print_swings('PyElastica', swing, 'elements', [40, 80, 160, 320, 640], 1)
    print(f'the limits differ by {1e3 * float(np.linalg.norm(ours - theirs)):.2f} mm')


if __name__ == '__main__':
    main()
