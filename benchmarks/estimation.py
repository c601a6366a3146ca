"""The estimator in the scenario of Ferguson, Kuntz and Hermans 2026 (bendier), simulated.

Their robot: a rod of 1.2 mm, E = 40 GPa and G = 15 GPa, 0.25 m long, with four tendons at 10 mm,
one wound once around it and three straight; tensions known to 0.1 N, the tip to 0.1 mm, a force on
the tip of 0.05 N per axis, errors correlated over 1 s, at 30 Hz. Here tendons touch the arm all
along, there at nine discs; the motion is one of our own. The tip moves by hundreds of times what
it is measured to. A run has some thirty independent errors, as they last for a second, so that
means of runs scatter: behind each is its standard error. Eight runs do not tell 3.0 from 3.3.

python benchmarks/estimation.py [--seeds N] [--brief]
"""

from __future__ import annotations

import math
import time

import numpy as np
from brief import IS_BRIEF, make_parser

from octo_arm_model import Arm, Body, Material, Section
from octo_arm_model.arm.errors import SolveError
from octo_arm_model.estimation.estimator import Filter
from octo_arm_model.estimation.measurements import Measurement, Tensions, TipPosition
from octo_arm_model.estimation.model import ArmModel, Prediction
from octo_arm_model.estimation.unknowns import Unknowns, Walk
from octo_arm_model.rod.forms import is_available

STEPS, SEEDS, FIRST = (3, 1, 2026) if IS_BRIEF else (900, 32, 2026)
PERIOD, CORRELATED = 1.0 / 30.0, 1.0  # [s]
TENSION, FORCE, TIP = 0.1, 0.05, 1e-4  # standard deviations [N, N, m]
# White noise of the reading besides the correlated error, and how fast tensions may change.
READING, SPEED = 1e-3, 50.0
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
Made = list[tuple[list[Measurement], Prediction]]


def arm_model(*, remembers: bool, is_compiled: bool) -> ArmModel:
    """The robot, whose errors are correlated in time or, to the estimator, are not."""
    correlated = CORRELATED if remembers else 1e-6
    unknowns = Unknowns(
        Walk(20.0, SPEED),
        tension_bias=Walk.stationary(TENSION, correlated),
        tip_force=Walk.stationary(FORCE, correlated),
    )
    return ArmModel(ROBOT, unknowns, material='linear', stations=51, compiled=is_compiled)


def simulated(seed: int) -> Made:
    """What is measured and what is true, at every step."""
    model = arm_model(remembers=True, is_compiled=is_available())
    state, rng = model.state, np.random.default_rng(seed)
    x = state.prior_stddev() * rng.normal(size=state.size)
    made: Made = []
    for step in range(STEPS):
        if step:
            noise = rng.normal(size=state.size)
            x = state.decay(PERIOD) * x + state.growth(PERIOD) * noise
        turns = np.array([0.2, 0.3, 0.25, 0.15]) * step * PERIOD
        x[state.tension] = 2.0 + 1.5 * np.sin(2.0 * np.pi * turns + np.arange(4.0) + seed)
        at = Prediction(model, x.copy(), made[-1][1].solved if made else None)
        reading = x[state.tension] + x[state.tension_bias] + READING * rng.normal(size=4)
        tip = at.solved.tip + TIP * rng.normal(size=3)
        made.append(([Tensions(reading, READING), TipPosition(tip, TIP)], at))
    return made


def report(name: str, runs: list[Made], *, remembers: bool, is_compiled: bool) -> None:
    """Print errors of all ``runs``, their normalised squares and how many are inside 95 %."""
    model, means, seconds = arm_model(remembers=remembers, is_compiled=is_compiled), [], 0.0
    force, tension = model.state.tip_force, model.state.tension
    Filter(model).add(0.0, runs[0][0][0]).pose_covariance.sum()  # compiles
    for made in runs:
        own, rows = Filter(model), []
        for step, (measured, at) in enumerate(made):
            start = time.process_time()
            found = own.add(step * PERIOD, measured)
            assert found.pose_covariance.shape == (51, 6, 6) and found.backbone.tip.size == 3
            seconds += time.process_time() - start
            error, covariance = found.mean - at.x, found.covariance
            squares = [
                error[part] @ np.linalg.solve(covariance[part, part], error[part])
                for part in (force, tension)
            ]
            inside = np.abs(error[force]) < 1.96 * np.sqrt(covariance.diagonal()[force])
            rows.append([error[force] @ error[force], *squares, inside.mean()])
        means.append(np.mean(rows, axis=0))
    square, *others = np.mean(means, axis=0)
    _, *errors = np.std(means, axis=0) / math.sqrt(len(means))
    columns = ''.join(
        f'{scale * mean:9.{digits}f} +- {scale * error:4.{digits}f}'
        for mean, error, scale, digits in zip(others, errors, (1, 1, 100), (2, 2, 1), strict=True)
    )
    spent = 1e3 * seconds / (len(runs) * STEPS)
    print(f'{name:36}{spent:9.2f}{math.sqrt(square):12.4f}{columns}')


def main() -> None:
    """Print the table."""
    parser = make_parser(__doc__)
    parser.add_argument('--seeds', type=int, default=SEEDS, help='how many runs')
    runs = [simulated(FIRST + number) for number in range(parser.parse_args().seeds)]
    print(f'{len(runs)} runs of {STEPS} steps, with shape and covariance at every station')
    print(f'{"":36}{"ms/step":>9}{"force rms N":>12}{"of 3":>17}{"of 4":>17}{"95 % has":>17}')
    for is_compiled in (True, False) if is_available() else (False,):
        way = 'compiled' if is_compiled else 'NumPy alone'
        for remembers, prior in ((False, 'without prior in time'), (True, 'with prior in time')):
            some = runs if is_compiled else runs[:1]
            report(f'{prior}, {way}', some, remembers=remembers, is_compiled=is_compiled)
    model, converged, cold = (
        arm_model(remembers=False, is_compiled=is_available()),
        0,
        runs[0][::2],
    )
    start = time.process_time()
    for measured, _ in cold:
        own = Filter(model)
        try:
            own.add(0.0, measured)
            converged += all(one.is_accepted for one in own.innovations)
        except SolveError as error:
            print(f'cold: {error}')
    spent = 1e3 * (time.process_time() - start) / len(cold)
    print(f'cold: {converged} of {len(cold)} converged with all accepted, {spent:.1f} ms each')


if __name__ == '__main__':
    main()
