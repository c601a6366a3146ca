"""Measure what sheaths, friction, discs and winches cost, as ratios to the solve without them.

    python benchmarks/effects.py [--brief]

The arms are the prototype and that of Table 4, by NumPy and by numba, without loads and with a
force on the tip. Sheaths have a stiffness of 7 G, friction has mu = 0.1. Tensions change by about
0.3 % per step, and every solve starts from the last solution. For winches the lengths of all
tendons are given instead. A second table is of a metal rod whose tendons are straight between
discs.
"""

from __future__ import annotations

import dataclasses
import functools
import time
from collections.abc import Callable, Iterator

import numpy as np
from brief import IS_BRIEF, make_parser

from octo_arm_model import Backbone, Discs, Solver, Wound, displacements_of, solve_displacements
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import load_config
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE

_STEPS, _ROUNDS = (2, 1) if IS_BRIEF else (40, 5)
_WRENCH = (0.005, 0.0, 0.0, 0.0, 0.0, 0.0)  # [N, N m]
_SHEATH = 7.0  # stiffness of the sheath over the shear modulus
_FRICTION = 0.1
_ARMS = (
    ('renda2012_prototype', np.array([[2.0, 0.5, 0.0, 0.0]])),
    ('renda2012_table4', 0.5 * np.array(FETCHING_IN_SPACE)),
)


def tensions_of_movement(tensions: FloatArray) -> list[FloatArray]:
    """Return the steps of a movement about ``tensions`` [N]."""
    phase = np.arange(tensions.size).reshape(tensions.shape)
    return [
        tensions * (0.9 + 0.05 * np.sin(0.03 * step) + 0.05 * np.cos(0.03 * step + phase))
        for step in range(_STEPS)
    ]


def shortest_time(steps: Callable[[], Iterator[None]]) -> float:
    """Return the sum of the shortest times of each of the ``steps`` in several rounds [s]."""
    rounds = []
    for _ in range(_ROUNDS):
        times = [time.perf_counter()]
        times.extend(time.perf_counter() for _ in steps())
        rounds.append(np.diff(times))
    return float(np.min(rounds, axis=0).sum())


def follow_tensions(
    solver: Solver, movement: list[FloatArray], wrench: tuple[float, ...] | None
) -> Iterator[None]:
    """Solve for each set of tensions, starting from the last solution."""
    last: Backbone | None = None
    for tensions in movement:
        last = solver.follow(tensions, last, wrench)
        yield


def follow_displacements(
    solver: Solver, steps: list[dict[str, float]], wrench: tuple[float, ...] | None, first: Wound
) -> Iterator[None]:
    """Solve for each set of tendon displacements [m], starting from the last solution."""
    last = first
    for target in steps:
        last = solve_displacements(solver, target, start=last, tip_wrench=wrench)
        yield


def compare_discs() -> None:
    """Print the table of a rod with and without discs."""
    print('| rao2021 by | solve [ms] | x 10 discs | x 20 discs | x 10 discs, friction |')
    print('| --- | --- | --- | --- | --- |')
    arm = load_config('rao2021').arm
    ten, twenty = (dataclasses.replace(arm, discs=Discs.evenly(n, arm.length)) for n in (10, 20))
    arms = arm, ten, twenty, dataclasses.replace(ten, friction=(_FRICTION,))
    movement = tensions_of_movement(np.array([[1.0, 0.2, 0.0], [0.5, 0.0, 0.3]]))
    for compiled in (False, True):
        times = []
        for variant in arms:
            solver = Solver(variant, 'exact', material='linear', compiled=compiled)
            follow = functools.partial(follow_tensions, solver, movement, _WRENCH)
            times.append(shortest_time(follow))
        ratios = ' | '.join(f'{seconds / times[0]:.1f}' for seconds in times[1:])
        by = 'compiled' if compiled else 'NumPy'
        print(f'| {by} | {1e3 * times[0] / _STEPS:.2f} | {ratios} |')


def main() -> None:
    """Print the table of sheaths, friction and winches, and that of discs."""
    make_parser(__doc__).parse_args()
    print('| arm | loads | by | solve [ms] | x sheath | x friction | x both | x winches |')
    print('| --- | --- | --- | --- | --- | --- | --- | --- |')
    for name, tensions in _ARMS:
        arm = load_config(name).arm
        stiffness = _SHEATH * arm.material.shear_modulus
        sheathed_arm = dataclasses.replace(arm, sheath_stiffness=(stiffness,))
        friction_arm, both_arm = (
            dataclasses.replace(each, friction=(_FRICTION,)) for each in (arm, sheathed_arm)
        )
        movement = tensions_of_movement(tensions)
        for compiled in (False, True):
            plain, sheathed, with_friction, with_both = (
                Solver(each, 'exact', compiled=compiled)
                for each in (arm, sheathed_arm, friction_arm, both_arm)
            )
            for wrench in (None, _WRENCH):
                lengths = [
                    dict(zip(arm.tendon_names, displacements_of(plain, each).ravel().tolist()))
                    for each in (plain.solve(step_tensions, wrench) for step_tensions in movement)
                ]
                first = solve_displacements(plain, lengths[0], tip_wrench=wrench)
                list(follow_tensions(sheathed, movement[:1], wrench))
                solve = shortest_time(lambda: follow_tensions(plain, movement, wrench))
                sheath = shortest_time(lambda: follow_tensions(sheathed, movement, wrench))
                friction = shortest_time(lambda: follow_tensions(with_friction, movement, wrench))
                both = shortest_time(lambda: follow_tensions(with_both, movement, wrench))
                winches = shortest_time(
                    lambda: follow_displacements(plain, lengths, wrench, first)
                )
                print(
                    f'| {name} | {"tip force" if wrench else "none"} | '
                    f'{"compiled" if compiled else "NumPy"} | {1e3 * solve / _STEPS:.2f} | '
                    f'{sheath / solve:.1f} | {friction / solve:.1f} | {both / solve:.1f} | '
                    f'{winches / solve:.1f} |'
                )
    print()
    compare_discs()


if __name__ == '__main__':
    main()
