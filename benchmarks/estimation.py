"""The estimator in the scenario of `tip_force_scenario`, 900 steps, and its time.

python benchmarks/estimation.py [--brief]
"""

from __future__ import annotations

import os
import time

# One thread of BLAS too, which reads this when it is loaded.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import numpy as np
from brief import IS_BRIEF, make_parser
from tip_force_scenario import PERIOD, arm_model, is_inside, simulated, square

from octo_arm_model.arm.errors import SolveError
from octo_arm_model.estimation.estimate import Estimate
from octo_arm_model.estimation.filter import Filter
from octo_arm_model.estimation.model import Prediction
from octo_arm_model.rod.forms import is_available

STEPS = 3 if IS_BRIEF else 900
SEED = 2026


def report(name: str, found: list[Estimate], truth: list[Prediction], seconds: float) -> None:
    """Print errors, their normalised squares and how many are inside 95 %."""
    force, tension = found[0].state.tip_force, found[0].state.tension
    pairs = list(zip(found, truth, strict=True))
    errors = np.array([(one.mean - at.x)[force] for one, at in pairs])
    zero = np.sqrt(np.mean([(at.x[force] ** 2).sum() for at in truth]))
    rms = np.sqrt((errors**2).sum(axis=1).mean())
    squares, tensions = (
        np.mean([square(one, at, part) for one, at in pairs]) for part in (force, tension)
    )
    inside = np.mean([is_inside(one, at, force) for one, at in pairs])
    print(
        f'{name:36}{1e3 * seconds / len(found):9.2f}{rms:12.4f}{zero:11.4f}'
        f'{squares:9.2f}{tensions:9.2f}{100.0 * inside:10.1f}'
    )


def main() -> None:
    """Print the table."""
    make_parser(__doc__).parse_args()
    made = simulated(STEPS, SEED, is_available())
    truth = [at for _, at in made]
    print(f'{STEPS} steps of the scenario, with the shape and its covariance at every station')
    print(
        f'{"":36}{"ms/step":>9}{"force rms N":>12}{"zero N":>11}{"of 3":>9}{"of 4":>9}'
        f'{"95 % has":>10}'
    )
    for is_compiled in (True, False) if is_available() else (False,):
        way = 'compiled' if is_compiled else 'NumPy alone'
        for remembers, prior in ((False, 'without prior in time'), (True, 'with prior in time')):
            model = arm_model(remembers=remembers, is_compiled=is_compiled)
            Filter(model).add(0.0, made[0][0]).pose_covariance.sum()  # compiles
            own = Filter(model)
            found = []
            start = time.process_time()
            for step, (measured, _) in enumerate(made):
                found.append(own.add(step * PERIOD, measured))
                assert found[-1].pose_covariance.shape == (51, 6, 6)
                assert found[-1].backbone.position.shape == (51, 3)
            report(f'{prior}, {way}', found, truth, time.process_time() - start)
    model = arm_model(remembers=False, is_compiled=is_available())
    converged = 0
    start = time.process_time()
    for measured, _ in made[::2]:
        try:
            innovations = Filter(model).add(0.0, measured).innovations
            converged += all(one.is_accepted for one in innovations)
        except SolveError as error:
            print(f'cold: {error}')
    count = len(made[::2])
    spent = 1e3 * (time.process_time() - start) / count
    print(f'cold: {converged} of {count} converged with all accepted, {spent:.1f} ms each')


if __name__ == '__main__':
    main()
