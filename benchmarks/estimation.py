"""Measure the estimator in the simulated scenario of Ferguson, Kuntz and Hermans 2026 (bendier).

Their robot is a rod of 1.2 mm diameter and 0.25 m length, with E = 40 GPa and G = 15 GPa. It has
four tendons at 10 mm, one helical with one turn and three straight. Standard deviations are 0.1 N
of tensions, 0.1 mm of the tip and 0.05 N per axis of the force on the tip, at 30 Hz, with errors
correlated over 1 s. Here tendons touch the rod all along, there at nine discs; the motion is
another. A run of 30 s thus has some thirty independent errors, and means of runs scatter: each is
printed with its standard error. Eight runs cannot distinguish 3.0 from 3.3.

python benchmarks/estimation.py [--seeds N] [--brief]
"""

from __future__ import annotations

import math
import time

import numpy as np
from brief import IS_BRIEF, make_parser

from octo_arm_model import Arm, Body, Material, Section
from octo_arm_model.arm.errors import SolveError
from octo_arm_model.estimation.estimator import Estimator
from octo_arm_model.estimation.measurements import Measurement, Tensions, TipPosition
from octo_arm_model.estimation.model import ArmModel, Prediction
from octo_arm_model.estimation.unknowns import Unknowns, Walk
from octo_arm_model.rod.forms import is_available

STEPS, SEEDS, FIRST = (3, 1, 2026) if IS_BRIEF else (900, 32, 2026)
PERIOD, CORRELATION_TIME = 1.0 / 30.0, 1.0  # [s]
TENSION, FORCE, TIP = 0.1, 0.05, 1e-4  # standard deviations [N, N, m]
# White noise of the load cells besides the correlated error [N], and rate of tensions [N/s^0.5].
READING, TENSION_RATE = 1e-3, 50.0
ROBOT = Arm(
    Material.from_moduli(40e9, 15e9),
    Body(0.25, 0.0006, 0.0006, disc_radius=0.01),
    (
        Section(
            0.25,
            0.01,
            0.01,
            angles=(0.0, math.pi, 1.5 * math.pi, 0.0),
            twist=(2.0 * math.pi, 0.0, 0.0, 0.0),
        ),
    ),
)
Run = list[tuple[list[Measurement], Prediction]]


def arm_model(*, has_prior: bool, is_compiled: bool) -> ArmModel:
    """Return the robot's model, with errors correlated in time or taken as independent."""
    correlation_time = CORRELATION_TIME if has_prior else 1e-6
    unknowns = Unknowns(
        Walk(20.0, TENSION_RATE),
        tension_bias=Walk.stationary(TENSION, correlation_time),
        tip_force=Walk.stationary(FORCE, correlation_time),
    )
    return ArmModel(ROBOT, unknowns, material='linear', stations=51, compiled=is_compiled)


def simulate(seed: int) -> Run:
    """Return the measurements and the true state of every step of a run."""
    model = arm_model(has_prior=True, is_compiled=is_available())
    state, rng = model.state, np.random.default_rng(seed)
    x = state.prior_stddev() * rng.normal(size=state.size)
    run: Run = []
    for step in range(STEPS):
        if step:
            noise = rng.normal(size=state.size)
            x = state.decay(PERIOD) * x + state.growth(PERIOD) * noise
        turns = np.array([0.2, 0.3, 0.25, 0.15]) * step * PERIOD
        x[state.tension] = 2.0 + 1.5 * np.sin(2.0 * np.pi * turns + np.arange(4.0) + seed)
        truth = Prediction(model, x.copy(), run[-1][1].solved if run else None)
        reading = x[state.tension] + x[state.tension_bias] + READING * rng.normal(size=4)
        tip = truth.solved.tip + TIP * rng.normal(size=3)
        run.append(([Tensions(reading, READING), TipPosition(tip, TIP)], truth))
    return run


def report(name: str, runs: list[Run], *, has_prior: bool, is_compiled: bool) -> None:
    """Print errors of all ``runs``, their normalised squares (NEES) and the coverage of 95 %."""
    model, means = arm_model(has_prior=has_prior, is_compiled=is_compiled), []
    seconds = 0.0
    force, tension = model.state.tip_force, model.state.tension
    Estimator({'': model}).add(0, runs[0][0][0]).estimate.pose_covariance.sum()  # compiles
    for run in runs:
        estimator, rows = Estimator({'': model}), []
        for step, (measurements, truth) in enumerate(run):
            start = time.process_time()
            estimate = estimator.add(round(1e9 * step * PERIOD), measurements).estimate
            assert estimate.pose_covariance.shape == (51, 6, 6) and estimate.backbone.tip.size == 3
            seconds += time.process_time() - start
            error, covariance = estimate.mean - truth.x, estimate.covariance
            nees = [
                error[part] @ np.linalg.solve(covariance[part, part], error[part])
                for part in (force, tension)
            ]
            covered = np.abs(error[force]) < 1.96 * np.sqrt(covariance.diagonal()[force])
            rows.append([error[force] @ error[force], *nees, covered.mean()])
        means.append(np.mean(rows, axis=0))
    square, *others = np.mean(means, axis=0)
    _, *errors = np.std(means, axis=0) / math.sqrt(len(means))
    columns = ''.join(
        f'{scale * mean:9.{digits}f} +- {scale * error:4.{digits}f}'
        for mean, error, scale, digits in zip(others, errors, (1, 1, 100), (2, 2, 1), strict=True)
    )
    per_step = 1e3 * seconds / (len(runs) * STEPS)
    print(f'{name:36}{per_step:9.2f}{math.sqrt(square):12.4f}{columns}')


def main() -> None:
    """Print the table."""
    parser = make_parser(__doc__)
    parser.add_argument('--seeds', type=int, default=SEEDS, help='number of runs')
    runs = [simulate(FIRST + number) for number in range(parser.parse_args().seeds)]
    print(f'{len(runs)} runs of {STEPS} steps, with shape and covariance at every station')
    print('NEES should be 3 for the force and 4 for the tensions, the coverage 95 %')
    columns = ('NEES of force', 'NEES of tension', 'coverage %')
    print(f'{"":36}{"ms/step":>9}{"force rms N":>12}' + ''.join(f'{name:>17}' for name in columns))
    for is_compiled in (True, False) if is_available() else (False,):
        way = 'compiled' if is_compiled else 'NumPy alone'
        for has_prior, prior in ((False, 'without prior in time'), (True, 'with prior in time')):
            some = runs if is_compiled else runs[:1]
            report(f'{prior}, {way}', some, has_prior=has_prior, is_compiled=is_compiled)
    model, cold = arm_model(has_prior=False, is_compiled=is_available()), runs[0][::2]
    converged = 0
    start = time.process_time()
    for measurements, _ in cold:
        try:
            output = Estimator({'': model}).add(0, measurements)
            converged += all(innovation.is_accepted for innovation in output.innovations)
        except SolveError as error:
            print(f'from the unloaded arm: {error}')
    spent = 1e3 * (time.process_time() - start) / len(cold)
    print(
        f'from the unloaded arm: {converged} of {len(cold)} steps converged with all measurements '
        f'accepted, {spent:.1f} ms each'
    )


if __name__ == '__main__':
    main()
