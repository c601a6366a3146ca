"""The estimator in the scenario of Ferguson, Kuntz and Hermans 2026 (bendier), and its time.

Their robot: a rod of 1.2 mm, E = 40 GPa and G = 15 GPa, 0.25 m long, with four tendons at 10 mm,
one wound once around it and three straight; tensions known to 0.1 N, the tip to 0.1 mm, a force on
the tip of 0.05 N per axis, errors correlated over 1 s, 900 steps at 30 Hz. Here tendons touch the
arm all along, there at nine discs; the motion is one of our own.

    python benchmarks/estimation.py [--brief]
"""

from __future__ import annotations

import math
import time

import numpy as np
from brief import IS_BRIEF, make_parser

from octo_arm_model import Arm, Body, Material, Section
from octo_arm_model.core.compiled.numba_build import is_available
from octo_arm_model.core.errors import SolveError
from octo_arm_model.estimation.estimate import Estimate
from octo_arm_model.estimation.filter import Filter
from octo_arm_model.estimation.measurements import Measurement, Tensions, TipPosition
from octo_arm_model.estimation.prediction import ArmModel, Prediction
from octo_arm_model.estimation.unknowns import Unknowns, Walk

STEPS = 3 if IS_BRIEF else 900
PERIOD = 1.0 / 30.0
CORRELATED = 1.0  # s
TENSION, FORCE, TIP = 0.1, 0.05, 1e-4  # standard deviations [N, N, m]
# White noise of the reading besides the correlated error, and how fast tensions may change.
READING, SPEED = 1e-3, 50.0
ROBOT = Arm(
    Material.from_moduli(40e9, 15e9),
    Body(0.25, 0.0006, 0.0006, disc_radius=0.01),
    (
        Section(
            0.25, 0.01, 0.01,
            angles=(0.0, math.pi, 1.5 * math.pi, 0.0),
            twist=(2.0 * math.pi, 0.0, 0.0, 0.0),
        ),
    ),
)  # fmt: skip


def arm_model(remembers: bool, is_compiled: bool) -> ArmModel:
    """The robot, whose errors are correlated in time or, to the estimator, are not."""
    correlated = CORRELATED if remembers else 1e-6
    unknowns = Unknowns(
        Walk(20.0, SPEED),
        tension_bias=Walk.stationary(TENSION, correlated),
        tip_force=Walk.stationary(FORCE, correlated),
    )
    return ArmModel(ROBOT, unknowns, material='linear', stations=51, compiled=is_compiled)


def simulated() -> list[tuple[list[Measurement], Prediction]]:
    """What is measured and what is true, at every step."""
    model = arm_model(True, is_available())
    state, rng = model.state, np.random.default_rng(2026)
    x = state.prior_stddev() * rng.normal(size=state.size)
    made: list[tuple[list[Measurement], Prediction]] = []
    for step in range(STEPS):
        if step:
            noise = rng.normal(size=state.size)
            x = state.decay(PERIOD) * x + state.growth(PERIOD) * noise
        turns = np.array([0.2, 0.3, 0.25, 0.15]) * step * PERIOD
        x[state.tension] = 2.0 + 1.5 * np.sin(2.0 * np.pi * turns + np.arange(4.0))
        at = Prediction(model, x.copy(), made[-1][1].solved if made else None)
        reading = x[state.tension] + x[state.tension_bias] + READING * rng.normal(size=4)
        tip = at.solved.tip + TIP * rng.normal(size=3)
        made.append(([Tensions(reading, READING), TipPosition(tip, TIP)], at))
    return made


def report(name: str, found: list[Estimate], truth: list[Prediction], seconds: float) -> None:
    """Print errors, their normalised squares and how many are inside 95 %."""
    errors, squares, tensions, inside = [], [], [], []
    for one, at in zip(found, truth, strict=True):
        state = one.state
        error = one.mean - at.x
        force, tension = error[state.tip_force], error[state.tension]
        covariance = one.covariance
        of_force = covariance[state.tip_force, state.tip_force]
        errors.append(force)
        squares.append(force @ np.linalg.solve(of_force, force))
        of_tension = covariance[state.tension, state.tension]
        tensions.append(tension @ np.linalg.solve(of_tension, tension))
        inside.append(np.abs(force) < 1.96 * np.sqrt(np.diag(of_force)))
    zero = np.sqrt(np.mean([(at.x[state.tip_force] ** 2).sum() for at in truth]))
    rms = np.sqrt((np.array(errors) ** 2).sum(axis=1).mean())
    print(
        f'{name:36}{1e3 * seconds / len(found):9.2f}{rms:12.4f}{zero:11.4f}'
        f'{np.mean(squares):9.2f}{np.mean(tensions):9.2f}{100.0 * np.mean(inside):10.1f}'
    )


def main() -> None:
    """Print the table."""
    make_parser(__doc__).parse_args()
    made = simulated()
    truth = [at for _, at in made]
    print(f'{STEPS} steps of the scenario, with the covariance at every station')
    print(
        f'{"":36}{"ms/step":>9}{"force rms N":>12}{"zero N":>11}{"of 3":>9}{"of 4":>9}'
        f'{"95 % has":>10}'
    )
    for is_compiled in (True, False) if is_available() else (False,):
        way = 'compiled' if is_compiled else 'NumPy alone'
        for remembers, prior in ((False, 'without prior in time'), (True, 'with prior in time')):
            model = arm_model(remembers, is_compiled)
            Filter(model).add(0.0, made[0][0]).pose_covariance.sum()  # compiles
            own = Filter(model)
            found = []
            start = time.process_time()
            for step, (measured, _) in enumerate(made):
                found.append(own.add(step * PERIOD, measured))
                assert found[-1].pose_covariance.shape == (51, 6, 6)
            report(f'{prior}, {way}', found, truth, time.process_time() - start)
    model = arm_model(False, is_available())
    converged = 0
    start = time.process_time()
    for measured, _ in made[::2]:
        try:
            Filter(model).add(0.0, measured)
            converged += 1
        except SolveError as error:
            print(f'cold: {error}')
    count = len(made[::2])
    spent = 1e3 * (time.process_time() - start) / count
    print(f'cold: {converged} of {count} converged, {spent:.1f} ms each')


if __name__ == '__main__':
    main()
