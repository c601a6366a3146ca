"""The estimator on an octopus arm whose description is wrong: friction, and E 5 % too small.

The arm of Table 4 of the paper in water, with its weight and twelve tendons, moves slowly and is
pushed at its tip. The true arm has friction (mu = 0.15) and a modulus 5 % larger than told.
Measured are tensions, the tip and two markers. What is asked: by how much the shape and the force
are wrong, and how many of these errors are inside bands of 95 %; what is left while one sensor is
lost, and once it is back; whether one that lies is refused.

    python benchmarks/octopus_estimation.py [--brief]
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from brief import IS_BRIEF, make_parser
from numpy.typing import NDArray

from octo_arm_model import Backbone, Loads, Solver, load_config
from octo_arm_model.arm.errors import SolveError
from octo_arm_model.arm.stiffness import bending_force, default_highest
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.estimation.estimator import Filter
from octo_arm_model.estimation.measurements import Markers, Measurement, Tensions, TipPosition
from octo_arm_model.estimation.model import ArmModel
from octo_arm_model.estimation.unknowns import Unknowns, Walk

STEPS, SEEDS = (4, 1) if IS_BRIEF else (200, 4)
SETTLED = 0 if IS_BRIEF else 20  # steps that do not count
PERIOD = 0.05  # [s]
LOST, LIES = 30, 4  # steps in which a sensor is lost, and in which one lies
STATIONS, MARKED = 46, [15, 30]
ARM = load_config(preset_path('renda2012_table4')).arm.with_density(1080.0)
WATER = Loads(gravity=(0.0, 0.0, -9.81), fluid_density=1000.0)
MODULUS = 1.1e5  # [Pa], of the table
FRICTION, STIFFER = 0.15, 1.05
TRUE_ARM = dataclasses.replace(
    ARM,
    material=dataclasses.replace(ARM.material, youngs_modulus=STIFFER * MODULUS),
    friction=(FRICTION,) * len(ARM.tendons),
)
HIGHEST = default_highest(ARM).ravel()
LOAD_CELL, CAMERA = 0.005 * HIGHEST, 1e-3  # standard deviations [N], [m]
FORCE = Walk.stationary(bending_force(ARM, 0.1), 1.0)
PULLS = tuple(Walk(highest, 0.3 * highest) for highest in HIGHEST)
FROM_SHAPE = Unknowns(PULLS, tip_force=FORCE)
FULL = dataclasses.replace(
    FROM_SHAPE, log_modulus=Walk(0.05), tension_loss=Walk.stationary(2.0 * FRICTION, 1.0)
)


class Moment(NamedTuple):
    """What is true at one time, and what is measured, by the name of its sensor."""

    shape: Backbone
    force: NDArray[np.float64]
    measured: dict[str, Measurement]


def moved(seed: int) -> list[Moment]:
    """The true arm, followed through its motion."""
    rng = np.random.default_rng(seed)
    solver = Solver(TRUE_ARM, 'exact', STATIONS, loads=WATER)
    phase, rate = rng.uniform(0.0, 2.0 * math.pi, 12), rng.uniform(0.1, 0.3, 12)
    force, shape, made = FORCE.stddev * rng.normal(size=3), None, []
    for step in range(STEPS):
        if step:
            noise = FORCE.stddev * math.sqrt(-math.expm1(-2.0 * PERIOD)) * rng.normal(size=3)
            force = math.exp(-PERIOD) * force + noise
        turn = 2.0 * math.pi * rate * step * PERIOD + phase
        tensions = 0.125 * HIGHEST * (1.0 + np.sin(turn))
        wrench = np.append(force, np.zeros(3))
        shape = solver.follow(tensions.reshape(ARM.tension_shape), shape, wrench)
        read = tensions + LOAD_CELL * rng.normal(size=12)
        seen = shape.position + CAMERA * rng.normal(size=(STATIONS, 3))
        measured: dict[str, Measurement] = {
            'tensions': Tensions(read, LOAD_CELL),
            'tip': TipPosition(seen[-1], CAMERA),
            'markers': Markers(shape.s[MARKED], seen[MARKED], CAMERA),
        }
        made.append(Moment(shape, force, measured))
    return made


class Errors:
    """Errors of shape and force, and how many are inside 95 %."""

    def __init__(self) -> None:
        """Of nothing yet."""
        self.refused: dict[str, int] = {}
        self.seconds, self.count = 0.0, 0
        self._position: list[NDArray[np.float64]] = []
        self._force: list[NDArray[np.float64]] = []
        self._inside: list[list[float]] = []

    def add(
        self,
        unknowns: Unknowns,
        made: list[Moment],
        told: Callable[[int, dict[str, Measurement]], list[Measurement]],
        counted: range,
    ) -> None:
        """Of a filter of ``unknowns`` that is ``told`` what is ``made``, of steps ``counted``."""
        own = Filter(ArmModel(ARM, unknowns, loads=WATER, stations=STATIONS))
        start = time.process_time()
        for step, now in enumerate(made):
            try:
                found = own.add(PERIOD * step, told(step, now.measured))
            except SolveError:
                self.refused['times'] = self.refused.get('times', 0) + 1
                continue
            covariance = found.pose_covariance
            if step not in counted:
                continue
            position = found.backbone.position - now.shape.position
            force = found.tip_wrench[:3] - now.force
            # The base stands still, and its band has no width.
            band = 1.96 * np.sqrt(np.einsum('nii->ni', covariance)[1:, :3])
            of_force = 1.96 * np.sqrt(np.diag(found.tip_wrench_covariance)[:3])
            self._position.append(position)
            self._force.append(force)
            self._inside.append(
                [
                    float(np.mean(np.abs(position[1:]) < band)),
                    float(np.mean(np.abs(position[-1]) < band[-1])),
                    float(np.mean(np.abs(force) < of_force)),
                ]
            )
        self.seconds += time.process_time() - start
        self.count += len(made)
        for name, count in own.refused.items():
            self.refused[name] = self.refused.get(name, 0) + count

    def report(self, name: str) -> None:
        """Print a row of the table."""
        position, force = np.array(self._position), np.array(self._force)
        along, tip = (
            1e3 * np.sqrt((part**2).sum(axis=-1).mean()) for part in (position, position[:, -1])
        )
        inside = ''.join(f'{100.0 * one:9.1f}' for one in np.mean(self._inside, axis=0))
        newtons = 1e3 * np.sqrt((force**2).sum(axis=1).mean())
        refused = ', '.join(f'{count} {what}' for what, count in self.refused.items())
        spent = 1e3 * self.seconds / self.count
        print(f'{name:34}{along:8.2f}{tip:8.2f}{newtons:9.3f}{inside}{spent:8.1f}  {refused}')


def main() -> None:
    """Print the table."""
    make_parser(__doc__).parse_args()
    runs = [moved(seed) for seed in range(SEEDS)]
    everywhere = range(SETTLED, STEPS)
    zero = 1e3 * np.sqrt(np.mean([now.force @ now.force for made in runs for now in made]))
    print(
        f'{SEEDS} runs of {STEPS} steps, mu = {FRICTION:g} and E {100 * (STIFFER - 1):.0f} % '
        f'wrong; the force is {zero:.3f} mN rms'
    )
    print('refused times are those at which nothing converged')
    print(
        f'{"":34}{"arm mm":>8}{"tip mm":>8}{"force mN":>9}{"95 % has":>9}{"of tip":>9}'
        f'{"of force":>9}{"ms":>8}  refused'
    )

    def all_of(step: int, measured: dict[str, Measurement]) -> list[Measurement]:
        return list(measured.values())

    def tensions_alone(step: int, measured: dict[str, Measurement]) -> list[Measurement]:
        return [measured['tensions']]

    for name, unknowns, told in (
        ('tensions alone', Unknowns(PULLS), tensions_alone),
        ('all sensors; no unknown E, friction', FROM_SHAPE, all_of),
        ('all sensors and unknowns', FULL, all_of),
    ):
        errors = Errors()
        for made in runs:
            errors.add(unknowns, made, told, everywhere)
        errors.report(name)
    first = STEPS // 4
    last = min(first + LOST, STEPS - 1)
    for lost in ('tensions', 'tip', 'markers'):

        def without(
            step: int, measured: dict[str, Measurement], lost: str = lost
        ) -> list[Measurement]:
            gone = lost if first <= step < last else ''
            return [one for name, one in measured.items() if name != gone]

        seconds = (last - first) * PERIOD
        for name, counted in (
            (f'{lost} lost for {seconds:g} s, meanwhile', range(first, last)),
            ('  and from then on', range(last, STEPS)),
        ):
            errors = Errors()
            for made in runs:
                errors.add(FULL, made, without, counted)
            errors.report(name)

    lies = range(first, min(first + LIES, last))

    def lying(step: int, measured: dict[str, Measurement]) -> list[Measurement]:
        if step not in lies:
            return list(measured.values())
        tip = measured['tip']
        return [
            measured['tensions'],
            TipPosition(tip.value + [0.0, 0.2, 0.0], CAMERA),
            measured['markers'],
        ]

    errors = Errors()
    for made in runs:
        errors.add(FULL, made, lying, lies)
    errors.report(f'tip told 20 cm off, {SEEDS * len(lies)} times')


if __name__ == '__main__':
    main()
