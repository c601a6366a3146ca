"""The way back: tensions for a wanted tip, and how far winches have to wind for them."""

import numpy as np

from octo_arm_model import TipPosition, find_tensions, load_config, solve_displacements

solver = load_config('renda2012_table4').solver('exact')
found = find_tensions(solver, TipPosition(np.array([0.25, 0.1, -0.1])), highest=5.0)
print('reached:', found.reached, ' error [mm]:', 1e3 * found.error)
print('tensions [N], one row a section from the tip:')
print(found.backbone.tensions.round(3))

wound = solver.rest_lengths - solver.tendon_lengths(found.backbone)
print('reeled in [mm]:')
print((1e3 * wound).round(2))

# Winches that hold these lengths, instead of tensions, hold the same shape.
lengths = dict(zip(solver.arm.tendon_names, wound.ravel().tolist(), strict=True))
again = solve_displacements(solver, lengths)
print('tip by lengths and by tensions differ by [mm]:', end=' ')
print((1e3 * (again.backbone.tip - found.backbone.tip)).round(6))
