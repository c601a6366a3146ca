"""How much faster than real time the arm moves, on one core.

    python benchmarks/dynamics.py

The arm of Table 4 in water (Renda et al. 2018), its tendons pulled in 0.2 s and held, in steps of
2 or 5 ms; by NumPy, by numba, with friction and with winches. Every step is the least of several
rounds, as others use the machine.
"""

from __future__ import annotations

import dataclasses
import os
import time

# One thread of BLAS too, which reads this when it is loaded.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import numpy as np

from octo_arm_model import Arm, Dynamics, Inputs, Loads, MotionProperties, Solver, load_config
from octo_arm_model.arm.motion_properties import WATERS
from octo_arm_model.rod.forms import is_available

_SECONDS, _RAMP, _ROUNDS = 1.0, 0.2, 5
_PULL = np.array([[0.05, 0.0, 0.0, 0.0], [0.1, 0.3, 0.0, 0.0], [0.2, 0.0, 0.1, 0.0]])
_REELED = {'tendon_3_1': 0.004, 'tendon_1_2': 0.002}
_LOADS = Loads(gravity=(0.0, 0.0, -9.81), fluid_density=1022.0)


def times_real(arm: Arm, step: float, compiled: bool, reeled: dict[str, float]) -> float:
    """Simulated time over the time that it takes."""
    solver = Solver(arm, 'exact', loads=_LOADS, compiled=compiled)
    dynamics = Dynamics(solver, MotionProperties(300.0, 0.0, *WATERS['renda2018']))
    first, steps = dynamics.at_rest(Inputs(0.0 * _PULL)), round(_SECONDS / step)
    least = np.full(steps, np.inf)
    for _ in range(_ROUNDS):
        state = first
        for number in range(steps):
            part = min((number + 1) * step / _RAMP, 1.0)
            lengths = {name: part * value for name, value in reeled.items()}
            inputs = Inputs(part * _PULL, lengths)
            began = time.perf_counter()
            state = dynamics.step(state, inputs, step)
            least[number] = min(least[number], time.perf_counter() - began)
    return float(_SECONDS / least.sum())


def main() -> None:
    """Print a table."""
    plain = load_config('renda2012_table4').arm.with_density(1080.0)
    rough = dataclasses.replace(plain, friction=(0.1,))
    stretching = dataclasses.replace(plain, axial_stiffness=(500.0,))
    cases: list[tuple[str, Arm, float, bool, dict[str, float]]] = [
        ('NumPy, 2 ms', plain, 2e-3, False, {})
    ]
    if is_available():
        cases += [
            ('numba, 2 ms', plain, 2e-3, True, {}),
            ('numba, 5 ms', plain, 5e-3, True, {}),
            ('numba, 2 ms, friction', rough, 2e-3, True, {}),
            ('numba, 2 ms, winches', stretching, 2e-3, True, _REELED),
        ]
    print(f'{"case":24} times real time')
    for name, arm, step, compiled, reeled in cases:
        print(f'{name:24} {times_real(arm, step, compiled, reeled):8.2f}')


if __name__ == '__main__':
    main()
