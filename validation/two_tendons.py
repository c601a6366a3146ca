"""A trajectory that other simulators are compared by, and its convergence.

    python validation/two_tendons.py

SoRoMoX (github.com/tud-phi/soromox, paper_results/secIVa_benchmarking_sequential_cpu) lets an
upright cylinder fall, too long to stand under its own weight, while two tendons are pulled by 1 N
from the start, and has its tip by itself, by SoRoSim and by PyElastica. The first two have strains
linear in each half of the arm; the third has shear, and damping of the velocity instead of
viscosity.
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
# Of the tip at these, across in the plane of the fall and up [m].
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
_FIRST = 1e-5  # steps of the jump of tensions and weight [s]
_FIRSTS = 10


def dynamics(level: int, gravity: float) -> Dynamics:
    """The cylinder."""
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
    """Tip at `TIMES`, across and up, (6, 2) [m]."""
    # It begins straight and without strain, which is an equilibrium without weight.
    state = dynamics(level, 0.0).at_rest(Inputs(np.zeros((1, 2))))
    falling, pull, found = dynamics(level, 9.81), Inputs(np.ones((1, 2))), []
    for _ in range(_FIRSTS):
        state = falling.step(state, pull, _FIRST)
    state = falling.step(state, pull, step - _FIRSTS * _FIRST)
    each = round(TIMES[0] / step)
    for number in range(2, len(TIMES) * each + 1):
        state = falling.step(state, pull, step)
        if number % each == 0:
            x, y, z = falling.backbone(state).tip
            found.append([float(np.hypot(x, y)), float(z)])
    return np.array(found)


def main() -> None:
    """Print the distances from the finest solution."""
    finest = fall(2, 1e-3)
    print(f'{"tip across, up [mm] at":31}', *(f'{time:>11.1f} s' for time in TIMES))
    print(f'{"finest":31}', *(f'{1e3 * x:6.1f} {1e3 * z:6.1f}' for x, z in finest))
    others = {name: np.array(tips) for name, tips in TIPS.items()}
    for level, step in ((0, 1e-2), (0, 5e-3), (0, 2e-3), (1, 2e-3)):
        nodes = dynamics(level, 0.0).nodes.s.size
        others[f'{nodes} nodes, {1e3 * step:g} ms'] = fall(level, step)
    for name, tips in others.items():
        away = 1e3 * np.linalg.norm(tips - finest, axis=1)
        print(f'{name + ", off by [mm]":31}', *(f'{one:13.3f}' for one in away))


if __name__ == '__main__':
    main()
