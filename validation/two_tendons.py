"""Compare a published trajectory of other simulators with ours, and check convergence.

    python validation/two_tendons.py

SoRoMoX (github.com/tud-phi/soromox, paper_results/secIVa_benchmarking_sequential_cpu) publishes
the tip of a falling cylinder: upright, too long to stand under its own weight, with two tendons at
1 N from the start. Its results are from SoRoMoX, SoRoSim and PyElastica. The first two have
strains that are linear in each half of the arm; PyElastica has shear, and damps velocities instead
of strain rates.
"""

from __future__ import annotations

import math

import numpy as np

from octo_arm_model import (
    Arm,
    Body,
    Dynamics,
    Inputs,
    Loads,
    Material,
    MotionProperties,
    Pose,
    Section,
    Solver,
)
from octo_arm_model.arm.hints import FloatArray

TIMES = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
# Horizontal and vertical positions of the tip at `TIMES` in the plane of the fall [m].
TIPS = {
    'SoRoMoX': (
        (0.0215, 0.5973),
        (0.0925, 0.5893),
        (0.2528, 0.5306),
        (0.458, 0.3117),
        (0.4977, 0.1946),
        (0.4159, 0.3827),
    ),
    'SoRoSim': (
        (0.0202, 0.5974),
        (0.0892, 0.5899),
        (0.2462, 0.5343),
        (0.4536, 0.3205),
        (0.4983, 0.1913),
        (0.4194, 0.3778),
    ),
    'PyElastica': (
        (0.0213, 0.5958),
        (0.103, 0.5864),
        (0.2921, 0.5039),
        (0.489, 0.2294),
        (0.4819, 0.2512),
        (0.2864, 0.5079),
    ),
}
_HALF = math.sqrt(0.5)
_UPRIGHT = Pose(quaternion=(0.0, -_HALF, 0.0, _HALF))
_FIRST = 1e-5  # time step after the jump of tensions and weight [s]
_FIRSTS = 10  # number of these steps


def dynamics(level: int, gravity: float) -> Dynamics:
    """Return the dynamics of the cylinder."""
    tendons = Section(0.6, 0.02, 0.02, (0.0, 0.5 * math.pi))
    arm = Arm(Material(1e6, density=1000.0), Body(0.6, 0.03, 0.03), (tendons,))
    solver = Solver(
        arm,
        'exact',
        stations=2,
        base=_UPRIGHT,
        material='linear',
        loads=Loads(gravity=(0.0, 0.0, -gravity)),
    )
    return Dynamics(solver, MotionProperties(viscosity=1e4), level=level)


def fall(level: int, step: float) -> FloatArray:
    """Return the horizontal and vertical positions of the tip at `TIMES` (6, 2) [m]."""
    # The straight arm without strain is the equilibrium without weight.
    state = dynamics(level, 0.0).at_rest(Inputs(np.zeros((1, 2))))
    cylinder, pull, tips = dynamics(level, 9.81), Inputs(np.ones((1, 2))), []
    for _ in range(_FIRSTS):
        state = cylinder.step(state, pull, _FIRST)
    state = cylinder.step(state, pull, step - _FIRSTS * _FIRST)
    steps_per_time = round(TIMES[0] / step)
    for number in range(2, len(TIMES) * steps_per_time + 1):
        state = cylinder.step(state, pull, step)
        if number % steps_per_time == 0:
            x, y, z = cylinder.backbone(state).tip
            tips.append([float(np.hypot(x, y)), float(z)])
    return np.array(tips)


def main() -> None:
    """Print the finest solution and the distances of the others from it."""
    finest = fall(2, 1e-3)
    print(f'{"tip horizontal, vertical [mm]":31}', *(f'{time:>11.1f} s' for time in TIMES))
    print(f'{"finest":31}', *(f'{1e3 * x:6.1f} {1e3 * z:6.1f}' for x, z in finest))
    solutions = {name: np.array(tips) for name, tips in TIPS.items()}
    for level, step in ((0, 1e-2), (0, 5e-3), (0, 2e-3), (1, 2e-3)):
        nodes = dynamics(level, 0.0).nodes.s.size
        solutions[f'{nodes} nodes, {1e3 * step:g} ms'] = fall(level, step)
    for name, tips in solutions.items():
        distances = 1e3 * np.linalg.norm(tips - finest, axis=1)
        print(f'{name + ", distance [mm]":31}', *(f'{distance:13.3f}' for distance in distances))


if __name__ == '__main__':
    main()
