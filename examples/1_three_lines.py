"""Tensions in, shape out."""

from octo_arm_model import load_config

solver = load_config('renda2012_table4').solver()
backbone = solver.solve([[0, 0, 0.5, 0], [4.0, 0, 0, 0], [0, 0, 13.0, 0]])
print('tip [m]:', backbone.tip)
