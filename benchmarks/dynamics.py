"""How much faster than real time the arm moves, on one core.

    python benchmarks/dynamics.py [--brief]

The arm of Table 4 in water (Renda et al. 2018), its tendons pulled in 0.2 s and held, in steps of
2 or 5 ms; by NumPy, by numba, with friction and with winches, on more nodes, and eight arms in one
process. Every step is the least of several rounds, as others use the machine.

Where PyElastica is installed (pip install pyelastica) both swing a tapered rod. Each is compared
with its own limit, which differ by less than a millimetre.
"""

from __future__ import annotations

import dataclasses
import os
import time
from collections.abc import Callable
from typing import Any

# One thread of BLAS too, which reads this when it is loaded.
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
_REELED = {'tendon_3_1': 0.004, 'tendon_1_2': 0.002}
_LOADS = Loads(gravity=(0.0, 0.0, -9.81), fluid_density=1022.0)
_WATER = MotionProperties(300.0, 0.0, *WATERS['renda2018'])


def times_real(
    dynamics: Dynamics, step: float, reeled: dict[str, float], arms: int = 1
) -> tuple[float, FloatArray]:
    """Simulated time over the time that so many ``arms`` take, and the tip of the last [m]."""
    first, steps = dynamics.at_rest(Inputs(0.0 * _PULL)), round(_SECONDS / step)
    least = np.full((steps, arms), np.inf)
    for _ in range(_ROUNDS):
        states = [first] * arms
        for number, arm in np.ndindex(steps, arms):
            part = min((number + 1) * step / _RAMP, 1.0)
            lengths = {name: part * value for name, value in reeled.items()}
            # Each arm is pulled by other tensions, the last by all of them.
            inputs = Inputs(part * (arm + 1) / arms * _PULL, lengths)
            began = time.perf_counter()
            states[arm] = dynamics.step(states[arm], inputs, step)
            least[number, arm] = min(least[number, arm], time.perf_counter() - began)
    return _SECONDS / float(least.sum()), dynamics.backbone(states[-1]).tip


def moving(arm: Arm, compiled: bool, level: int = 0) -> Dynamics:
    """An ``arm`` in water."""
    solver = Solver(arm, 'exact', loads=_LOADS, compiled=compiled)
    return Dynamics(solver, _WATER, level=level)


# A rod that tapers, in air, and falls from straight, without any damping: length, radius at the
# base and at the tip [m], E [Pa], density [kg/m^3], gravity [m/s^2].
_ROD = 0.45, 0.015, 0.005, 1.1e5, 1080.0, 1.0
_SWING = 0.1 if IS_BRIEF else 1.0  # [s]
_FIRST = 1e-5  # steps of the jump of gravity [s]


def our_swing(level: int, step: float) -> tuple[float, FloatArray]:
    """Time that the swing takes and the tip at its end (3,) [m]."""
    length, base, tip, young, density, gravity = _ROD
    tendons = Section(length, 0.5 * tip, 0.5 * tip)
    arm = Arm(Material(young, density=density), Body(length, base, tip), (tendons,))

    def falling(weight: float) -> Dynamics:
        loads = Loads(gravity=(0.0, 0.0, -weight))
        solver = Solver(arm, 'exact', stations=2, material='linear', shear=True, loads=loads)
        return Dynamics(solver, level=level)

    dynamics, inputs = falling(gravity), Inputs(np.zeros((1, 4)))
    state = falling(0.0).at_rest(inputs)
    began = time.perf_counter()
    for dt in (*10 * [_FIRST], step - 10 * _FIRST, *(round(_SWING / step) - 1) * [step]):
        state = dynamics.step(state, inputs, dt)
    return time.perf_counter() - began, dynamics.backbone(state).tip


def their_swing(elastica: Any, elements: int) -> tuple[float, FloatArray]:
    """As `our_swing`, by PyElastica with so many ``elements``."""
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
    kinds = elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing
    world = type('World', kinds, {})()
    world.append(rod)
    world.constrain(rod).using(
        elastica.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,)
    )
    weight = np.array([0.0, 0.0, -gravity])
    world.add_forcing_to(rod).using(elastica.GravityForces, acc_gravity=weight)
    world.finalize()
    # Twice this step is not stable.
    stepper, steps = elastica.PositionVerlet(), round(_SWING / min(5e-4, 0.02 / elements))
    now, dt = np.float64(0.0), np.float64(_SWING / steps)
    began = time.perf_counter()
    for _ in range(steps):
        now = stepper.step(world, now, dt)
    return time.perf_counter() - began, rod.position_collection[:, -1].copy()


def print_swings(
    name: str,
    swing: Callable[[int], tuple[float, FloatArray]],
    unit: str,
    sizes: list[int],
    order: int,
) -> FloatArray:
    """Print errors and times, of an error of an ``order`` in 1 / size; the limit of the tip."""
    swing(sizes[0])  # compiles
    found = [swing(size) for size in sizes]
    (before, last), part = (tip for _, tip in found[-2:]), (sizes[-1] / sizes[-2]) ** order
    limit = last + (last - before) / (part - 1.0)
    for size, (elapsed, tip) in zip(sizes, found):
        error = 1e3 * float(np.linalg.norm(tip - limit))
        print(f'{name:12}{size:6} {unit:18}{error:10.3f} mm {elapsed:9.3f} s')
    return limit


def print_speeds(plain: Arm, is_compiled: bool) -> None:
    """The arm ``plain``, and with other effects."""
    rough = dataclasses.replace(plain, friction=(0.1,))
    stretching = dataclasses.replace(plain, axial_stiffness=(500.0,))
    cases: list[tuple[str, Arm, float, bool, dict[str, float], int]] = [
        ('NumPy, 2 ms', plain, 2e-3, False, {}, 1)
    ]
    if is_compiled:
        cases += [
            ('numba, 2 ms', plain, 2e-3, True, {}, 1),
            ('numba, 5 ms', plain, 5e-3, True, {}, 1),
            ('numba, 2 ms, friction', rough, 2e-3, True, {}, 1),
            ('numba, 2 ms, winches', stretching, 2e-3, True, _REELED, 1),
            (f'numba, 5 ms, {_ARMS} arms', plain, 5e-3, True, {}, _ARMS),
        ]
    print(f'{"case":24} times real time')
    for name, arm, step, compiled, reeled, arms in cases:
        fast, _ = times_real(moving(arm, compiled), step, reeled, arms)
        print(f'{name:24} {fast:8.2f}')


def print_meshes(plain: Arm, is_compiled: bool) -> None:
    """Cost and error by elements and nodes."""
    print('\nelements  points  nodes  ms a step of 2 ms  tip off the finest [mm]')
    levels = range(2 if IS_BRIEF else len(LEVELS) - 1)
    meshes = [moving(plain, is_compiled, level) for level in levels]
    results = [(one.nodes, *times_real(one, 2e-3, {})) for one in meshes]
    for nodes, fast, tip in results:
        off = 1e3 * float(np.linalg.norm(tip - results[-1][-1]))
        counts = f'{nodes.lengths.size:8} {nodes.points:7} {nodes.s.size:6}'
        print(f'{counts} {2.0 / fast:18.2f} {off:24.1e}')


def main() -> None:
    """Print tables."""
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
    print(f'\n{"a rod":12}{"":25}{"error":>13} {"a second takes":>11}')
    ours = print_swings(
        'this', lambda n: our_swing(1, 1.0 / n), 'steps a second', [50, 100, 200, 1000, 2000], 2
    )
    theirs = print_swings(
        'PyElastica', lambda n: their_swing(elastica, n), 'elements', [40, 80, 160, 320, 640], 1
    )
    print(f'limits differ by {1e3 * float(np.linalg.norm(ours - theirs)):.2f} mm')


if __name__ == '__main__':
    main()
