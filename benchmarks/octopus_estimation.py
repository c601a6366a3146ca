"""Measure the estimator on an octopus arm with wrong parameters: no friction, E 5 % too small.

The arm of Table 4 of the paper, with its weight and twelve tendons, moves slowly in water while a
force acts on its tip. The true arm has friction (mu = 0.15) and a modulus that is 5 % larger than
the estimator's. Tensions, the tip and two markers are measured. Printed are errors of shape and
force and their share within 95 % bands: with all sensors, while one sensor is lost, after it is
back, and while the tip is measured wrongly.

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
from octo_arm_model.estimation.estimator import Estimator
from octo_arm_model.estimation.measurements import Markers, Measurement, Tensions, TipPosition
from octo_arm_model.estimation.model import ArmModel
from octo_arm_model.estimation.unknowns import Unknowns, Walk

STEPS, SEEDS = (4, 1) if IS_BRIEF else (200, 4)
FIRST_COUNTED = 0 if IS_BRIEF else 20  # step before which errors do not count
PERIOD = 0.05  # [s]
LOST_STEPS, FAULTY_STEPS = 30, 4  # steps without a sensor, and with a faulty one
STATIONS, MARKER_STATIONS = 46, [15, 30]
ARM = load_config(preset_path('renda2012_table4')).arm.with_density(1080.0)
WATER = Loads(gravity=(0.0, 0.0, -9.81), fluid_density=1000.0)
MODULUS = 1.1e5  # [Pa], of Table 4
FRICTION, MODULUS_RATIO = 0.15, 1.05
TRUE_ARM = dataclasses.replace(
    ARM,
    material=dataclasses.replace(ARM.material, youngs_modulus=MODULUS_RATIO * MODULUS),
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


# From a step and all measurements to those that the filter gets.
Select = Callable[[int, dict[str, Measurement]], list[Measurement]]


class Moment(NamedTuple):
    """The true shape and tip force at one time, and the measurements by the name of the sensor."""

    shape: Backbone
    force: NDArray[np.float64]
    measurements: dict[str, Measurement]


def simulate(seed: int) -> list[Moment]:
    """Simulate a run: the true arm follows its tensions and a random force on its tip."""
    rng = np.random.default_rng(seed)
    solver = Solver(TRUE_ARM, 'exact', STATIONS, loads=WATER)
    phase, rate = rng.uniform(0.0, 2.0 * math.pi, 12), rng.uniform(0.1, 0.3, 12)
    force, shape, moments = FORCE.stddev * rng.normal(size=3), None, []
    for step in range(STEPS):
        if step:
            noise = FORCE.stddev * math.sqrt(-math.expm1(-2.0 * PERIOD)) * rng.normal(size=3)
            force = math.exp(-PERIOD) * force + noise
        angle = 2.0 * math.pi * rate * step * PERIOD + phase
        tensions = 0.125 * HIGHEST * (1.0 + np.sin(angle))
        wrench = np.append(force, np.zeros(3))
        shape = solver.follow(tensions.reshape(ARM.tension_shape), shape, wrench)
        readings = tensions + LOAD_CELL * rng.normal(size=12)
        positions = shape.position + CAMERA * rng.normal(size=(STATIONS, 3))
        measurements: dict[str, Measurement] = {
            'tensions': Tensions(readings, LOAD_CELL),
            'tip': TipPosition(positions[-1], CAMERA),
            'markers': Markers(shape.s[MARKER_STATIONS], positions[MARKER_STATIONS], CAMERA),
        }
        moments.append(Moment(shape, force, measurements))
    return moments


class Errors:
    """Errors of shape and force, and their share within the 95 % bands."""

    def __init__(self) -> None:
        """Start without errors."""
        self.refused: dict[str, int] = {}
        self.seconds, self.count = 0.0, 0
        self._position: list[NDArray[np.float64]] = []
        self._force: list[NDArray[np.float64]] = []
        self._inside: list[list[float]] = []

    def add(
        self, unknowns: Unknowns, moments: list[Moment], select: Select, counted: range
    ) -> None:
        """Run a filter with the measurements of ``select``; add errors of steps ``counted``."""
        estimator = Estimator({'': ArmModel(ARM, unknowns, loads=WATER, stations=STATIONS)})
        start = time.process_time()
        for step, moment in enumerate(moments):
            try:
                measured = select(step, moment.measurements)
                estimate = estimator.add(round(1e9 * PERIOD * step), measured).estimate
            except SolveError:
                self.refused['steps'] = self.refused.get('steps', 0) + 1
                continue
            covariance = estimate.pose_covariance
            if step not in counted:
                continue
            position = estimate.backbone.position - moment.shape.position
            force = estimate.tip_wrench[:3] - moment.force
            # Without the base, which is fixed and has no covariance.
            band = 1.96 * np.sqrt(np.einsum('nii->ni', covariance)[1:, :3])
            force_band = 1.96 * np.sqrt(np.diag(estimate.tip_wrench_covariance)[:3])
            self._position.append(position)
            self._force.append(force)
            self._inside.append(
                [
                    float(np.mean(np.abs(position[1:]) < band)),
                    float(np.mean(np.abs(position[-1]) < band[-1])),
                    float(np.mean(np.abs(force) < force_band)),
                ]
            )
        self.seconds += time.process_time() - start
        self.count += len(moments)
        for name, kind in estimator.consistency.items():
            if kind.refused:
                self.refused[name] = self.refused.get(name, 0) + kind.refused

    def report(self, name: str) -> None:
        """Print a row of the table."""
        position, force = np.array(self._position), np.array(self._force)
        along, tip = (
            1e3 * np.sqrt((error**2).sum(axis=-1).mean()) for error in (position, position[:, -1])
        )
        inside = ''.join(f'{100.0 * share:9.1f}' for share in np.mean(self._inside, axis=0))
        force_rms = 1e3 * np.sqrt((force**2).sum(axis=1).mean())
        refused = ', '.join(f'{count} {sensor}' for sensor, count in self.refused.items())
        per_step = 1e3 * self.seconds / self.count
        print(f'{name:34}{along:8.2f}{tip:8.2f}{force_rms:9.3f}{inside}{per_step:8.1f}  {refused}')


def report(
    name: str, runs: list[list[Moment]], unknowns: Unknowns, select: Select, counted: range
) -> None:
    """Print the row of a filter with ``unknowns``, see `Errors.add`."""
    errors = Errors()
    for run in runs:
        errors.add(unknowns, run, select, counted)
    errors.report(name)


def main() -> None:
    """Print a row for each case."""
    make_parser(__doc__).parse_args()
    runs = [simulate(seed) for seed in range(SEEDS)]
    counted = range(FIRST_COUNTED, STEPS)
    force = 1e3 * np.sqrt(np.mean([each.force @ each.force for run in runs for each in run]))
    print(
        f'{SEEDS} runs of {STEPS} steps; true arm with mu = {FRICTION:g} and E '
        f'{100 * (MODULUS_RATIO - 1):.0f} % larger; the force is {force:.3f} mN rms'
    )
    print('Rms errors, their share within 95 % bands, time per step, and refused measurements')
    print('(refused steps are those in which no estimate converged)')
    print(
        f'{"":34}{"arm mm":>8}{"tip mm":>8}{"force mN":>9}{"arm %":>9}{"tip %":>9}'
        f'{"force %":>9}{"ms":>8}  refused'
    )

    def all_sensors(step: int, measurements: dict[str, Measurement]) -> list[Measurement]:
        return list(measurements.values())

    def tensions_only(step: int, measurements: dict[str, Measurement]) -> list[Measurement]:
        return [measurements['tensions']]

    for name, unknowns, select in (
        ('tensions only', Unknowns(PULLS), tensions_only),
        ('all sensors, only force estimated', FROM_SHAPE, all_sensors),
        ('all sensors and unknowns', FULL, all_sensors),
    ):
        report(name, runs, unknowns, select, counted)
    first = STEPS // 4
    last = min(first + LOST_STEPS, STEPS - 1)
    for lost in ('tensions', 'tip', 'markers'):

        def without_lost(
            step: int, measurements: dict[str, Measurement], lost: str = lost
        ) -> list[Measurement]:
            is_lost = first <= step < last
            return [each for name, each in measurements.items() if not is_lost or name != lost]

        seconds = (last - first) * PERIOD
        report(f'no {lost} for {seconds:g} s', runs, FULL, without_lost, range(first, last))
        report('  and after that', runs, FULL, without_lost, range(last, STEPS))

    faulty = range(first, min(first + FAULTY_STEPS, last))

    def with_fault(step: int, measurements: dict[str, Measurement]) -> list[Measurement]:
        if step not in faulty:
            return list(measurements.values())
        tip = TipPosition(measurements['tip'].value + [0.0, 0.2, 0.0], CAMERA)
        return [measurements['tensions'], tip, measurements['markers']]

    report(f'tip wrong by 20 cm, {SEEDS * len(faulty)} times', runs, FULL, with_fault, faulty)


if __name__ == '__main__':
    main()
