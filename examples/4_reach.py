"""The inverse: tensions for a target of the tip, and the lengths that winches reel in for it."""

import numpy as np

from octo_arm_model import TipPosition, find_tensions, load_config, solve_displacements

solver = load_config('renda2012_table4').solver('exact')
inverse = find_tensions(solver, TipPosition(np.array([0.25, 0.1, -0.1])), highest=5.0)
print('reached:', inverse.reached, ' error [mm]:', 1e3 * inverse.error)
print('tensions [N], one row a section from the tip:')
print(inverse.backbone.tensions.round(3))

reeled = solver.rest_lengths - solver.tendon_lengths(inverse.backbone)
print('reeled in [mm]:')
print((1e3 * reeled).round(2))

# Winches that hold these lengths, instead of tensions, hold the same shape.
lengths = dict(zip(solver.arm.tendon_names, reeled.ravel().tolist(), strict=True))
again = solve_displacements(solver, lengths)
print('tip by lengths and by tensions differ by [mm]:', end=' ')
print((1e3 * (again.backbone.tip - inverse.backbone.tip)).round(6))
