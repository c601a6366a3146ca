"""What effects beyond the plain arm cost: ratios to the solve without, in one run.

    python benchmarks/effects.py

For the prototype and the arm of Table 4, by NumPy and compiled, without loads and followed under
a force on the tip. A sheath is of 7 G, friction of mu = 0.1, and both are together; winches follow
a movement in steps of about 0.3 %, each from the last solution, with the lengths of all tendons
given. A second table has a metal rod with tendons straight between discs.
"""

from __future__ import annotations

import dataclasses
import functools
import time
from collections.abc import Callable, Iterator

import numpy as np

from octo_arm_model import Backbone, Discs, Solver, Wound, displacements_of, solve_displacements
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import load_config
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE

_STEPS = 40
_ROUNDS = 5
_WRENCH = (0.005, 0.0, 0.0, 0.0, 0.0, 0.0)  # [N, N m]
_SHEATH = 7.0  # over the shear modulus
_FRICTION = 0.1
_ARMS = (
    ('renda2012_prototype', np.array([[2.0, 0.5, 0.0, 0.0]])),
    ('renda2012_table4', 0.5 * np.array(FETCHING_IN_SPACE)),
)


def movement(tensions: FloatArray) -> list[FloatArray]:
    """Tensions that vary about ``tensions`` [N]."""
    phase = np.arange(tensions.size).reshape(tensions.shape)
    return [
        tensions * (0.9 + 0.05 * np.sin(0.03 * step) + 0.05 * np.cos(0.03 * step + phase))
        for step in range(_STEPS)
    ]


def least(steps: Callable[[], Iterator[None]]) -> float:
    """Time of all ``steps``, each the least of several rounds [s], as others use the machine."""
    rounds = []
    for _ in range(_ROUNDS):
        times = [time.perf_counter()]
        times.extend(time.perf_counter() for _ in steps())
        rounds.append(np.diff(times))
    return float(np.min(rounds, axis=0).sum())


def follow(
    solver: Solver, moved: list[FloatArray], wrench: tuple[float, ...] | None
) -> Iterator[None]:
    """Solve for every set of tensions, each from the last solution."""
    last: Backbone | None = None
    for tensions in moved:
        last = solver.follow(tensions, last, wrench)
        yield


def wind(
    solver: Solver, lengths: list[dict[str, float]], wrench: tuple[float, ...] | None, first: Wound
) -> Iterator[None]:
    """Solve for every set of lengths, each from the last solution."""
    last = first
    for wanted in lengths:
        last = solve_displacements(solver, wanted, start=last, tip_wrench=wrench)
        yield


def compare_discs() -> None:
    """Measure a rod with and without discs and print a table."""
    print('| rao2021 by | solve [ms] | 10 discs | 20 discs | 10 discs, friction |')
    print('| --- | --- | --- | --- | --- |')
    arm = load_config('rao2021').arm
    ten, twenty = (dataclasses.replace(arm, discs=Discs.evenly(n, arm.length)) for n in (10, 20))
    arms = arm, ten, twenty, dataclasses.replace(ten, friction=(_FRICTION,))
    moved = movement(np.array([[1.0, 0.2, 0.0], [0.5, 0.0, 0.3]]))
    for compiled in (False, True):
        times = []
        for one in arms:
            solver = Solver(one, 'exact', material='linear', compiled=compiled)
            times.append(least(functools.partial(follow, solver, moved, _WRENCH)))
        ratios = ' | '.join(f'{each / times[0]:.1f}' for each in times[1:])
        by = 'compiled' if compiled else 'NumPy'
        print(f'| {by} | {1e3 * times[0] / _STEPS:.2f} | {ratios} |')


def main() -> None:
    """Measure and print two tables."""
    print('| arm | loads | by | solve [ms] | sheath | friction | both | lengths |')
    print('| --- | --- | --- | --- | --- | --- | --- | --- |')
    for name, tensions in _ARMS:
        arm = load_config(name).arm
        stiffness = _SHEATH * arm.material.shear_modulus
        soft_arm = dataclasses.replace(arm, sheath_stiffness=(stiffness,))
        rough_arm, rough_soft_arm = (
            dataclasses.replace(one, friction=(_FRICTION,)) for one in (arm, soft_arm)
        )
        moved = movement(tensions)
        for compiled in (False, True):
            plain, soft, rough, rough_soft = (
                Solver(one, 'exact', compiled=compiled)
                for one in (arm, soft_arm, rough_arm, rough_soft_arm)
            )
            for wrench in (None, _WRENCH):
                lengths = [
                    dict(zip(arm.tendon_names, displacements_of(plain, one).ravel().tolist()))
                    for one in (plain.solve(each, wrench) for each in moved)
                ]
                first = solve_displacements(plain, lengths[0], tip_wrench=wrench)
                list(follow(soft, moved[:1], wrench))
                solve = least(lambda: follow(plain, moved, wrench))
                sheath = least(lambda: follow(soft, moved, wrench))
                friction = least(lambda: follow(rough, moved, wrench))
                both = least(lambda: follow(rough_soft, moved, wrench))
                winches = least(lambda: wind(plain, lengths, wrench, first))
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
