"""A force on the tip is detected and estimated from tensions and a marker alone."""

import numpy as np

from octo_arm_model import load_config
from octo_arm_model.estimation.estimator import Estimator
from octo_arm_model.estimation.measurements import Tensions, TipPosition
from octo_arm_model.estimation.model import ArmModel
from octo_arm_model.estimation.unknowns import Unknowns, Walk

config = load_config('renda2012_prototype')
force = Walk.stationary(stddev=0.01, correlation_time=0.5)
unknowns = Unknowns(tension=Walk(5.0, 5.0), tip_force=force)
estimator = Estimator({'tip': ArmModel.of(config, unknowns, stations=31)})
simulated, tensions = config.solver('exact', stations=31), np.array([1.0, 0.4, 0.3, 0.5])
for step in range(8):
    push = [0.0, 0.0, 0.015 if step >= 4 else 0.0]
    marker = simulated.solve([tensions], [*push, 0.0, 0.0, 0.0]).tip
    measured = [Tensions(tensions, 0.01), TipPosition(marker, 1e-3)]
    estimate = estimator.add(step * 10**8, measured).estimate  # times are in nanoseconds
    wrench, covariance = estimate.tip_wrench[:3], estimate.tip_wrench_covariance[:3, :3]
    is_touched = wrench @ np.linalg.solve(covariance, wrench) > 16.3  # chi-square of 3, 0.1 %
    state = 'touched' if is_touched else 'free   '
    state = f'refused: {", ".join(estimate.refused)}' if estimate.refused else state
    print(f'{0.1 * step:.1f} s  {state}  {wrench.round(4)} N')
