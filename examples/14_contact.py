"""An arm over a floor curls round a post: the forces and the depths of its contacts."""

import numpy as np

from octo_arm_model import Cylinder, Loads, Plane, Solver, load_config

arm = load_config('renda2012_table4').arm.with_density(1080.0)
# Positions in base_frame [m]; stiffness is pressure over depth [N/m^3], of the order of E / R.
floor = Plane((0.0, 0.0, -0.02), (0.0, 0.0, 1.0), stiffness=2e6)
post = Cylinder((0.25, 0.06, 0.0), (0.0, 0.0, 1.0), 0.03, stiffness=2e6)
loads = Loads(gravity=(0.0, 0.0, -9.81), fluid_density=1000.0, obstacles=(floor, post))
solver = Solver(arm, 'exact', loads=loads, accuracy=1e-5)

pull = np.zeros((3, 4))
shape = solver.solve(pull)
for part in np.linspace(0.5, 1.0, 3):
    pull[:, 0] = 0.1 * part, 1.0 * part, 3.0 * part
    # The search starts from the last shape, as an arm stays on its side of a post.
    shape = solver.follow(pull, shape)
    contacts = solver.contacts(shape)
    forces = 1e3 * np.linalg.norm(contacts.force, axis=1)
    depths = 1e3 * contacts.penetration.max(axis=1)
    print(f'{part:.2f} of the pull: ', end='')
    print(f'floor {forces[0]:4.1f} mN, {depths[0]:.3f} mm deep; ', end='')
    print(f'post {forces[1]:4.1f} mN, {depths[1]:.3f} mm deep')

moved = 1e3 * solver.sensitivity(shape).compliance[:3, :3] @ [0.0, 0.001, 0.0]
print(f'a millinewton on the tip along y moves it by {moved[1]:.2f} mm')
