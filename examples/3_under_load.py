"""An arm in water with a force on its tip: the displacement and the uncertainty of the tip."""

from dataclasses import replace

import numpy as np

from octo_arm_model import Loads, Uncertainty, load_config

config = load_config('renda2012_table4')
in_water = Loads(gravity=(0.0, 0.0, -9.81), fluid_density=1000.0)
config = replace(config, arm=config.arm.with_density(1080.0), loads=in_water)
solver = config.solver('exact')

free = solver.solve([[0, 0, 0.2, 0], [1.0, 0, 0, 0], [0, 3.0, 0, 0]])
pushed = solver.solve(free.tensions, tip_wrench=[0, 0, 0.002, 0, 0, 0], start=free)
print('2 mN upwards move the tip by [mm]:', 1e3 * (pushed.tip - free.tip))

derivatives = solver.sensitivity(free)
print('its compliance predicts [mm]:     ', 1e3 * derivatives.compliance[:3, 2] * 0.002)
covariance = derivatives.tip_covariance(Uncertainty(tension=0.02, youngs_modulus=0.05))
print('standard deviation of the tip for 0.02 N and 5 % of E [mm]:', end=' ')
print(1e3 * np.sqrt(np.diag(covariance)[:3]))
