"""A reach like the octopus's: the arm straightens from the base, and its bend travels to the tip.

The arm is in water. All sections are bent at first; then they are released one after the other,
from the base to the tip.

    python examples/11_octopus_reach.py [picture.png]
"""

import sys

import numpy as np

from octo_arm_model import Dynamics, Inputs, Loads, MotionProperties, Solver, load_config

STEP, SECONDS = 5e-3, 2.0
BENT = np.array([0.06, 1.0, 4.0])  # tension of one tendon of each section, from the tip [N]
RELEASE = np.array([[1.6, 2.6], [0.8, 1.8], [0.0, 1.0]])  # begin and end of each release [s]
arm = load_config('renda2012_table4').arm.with_density(1080.0)
water = MotionProperties(300.0, normal_drag=2.5, tangential_drag=0.01, added_mass=1.5)
dynamics = Dynamics(Solver(arm, 'exact', stations=91, loads=Loads(fluid_density=1022.0)), water)


def inputs(time: float) -> Inputs:
    """Return the tensions at a time [s]."""
    tensions = np.zeros(arm.tension_shape)
    fractions = [np.interp(time, times, [1.0, 0.0]) for times in RELEASE]
    tensions[:, 0] = BENT * fractions
    return Inputs(tensions)


state, shapes = dynamics.at_rest(inputs(0.0)), []
for number in range(round(SECONDS / STEP) + 1):
    if number:
        state = dynamics.step(state, inputs(number * STEP), STEP)
    if number % 20 == 0:
        shape = dynamics.backbone(state)
        shapes.append(shape.position)
        # The bend is at the middle of the integral of the curvature.
        turned = np.cumsum(np.abs(shape.k))
        bend = float(np.interp(0.5 * turned[-1], turned, shape.s)) if turned[-1] else 0.0
        if number % 100 == 0:
            fast = float(np.linalg.norm(dynamics.velocities(state), axis=1).max())
            print(f'{number * STEP:.1f} s: bend at {1e3 * bend:5.1f} mm, at most {fast:.2f} m/s')

if len(sys.argv) > 1:
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 3.4), layout='constrained')
    axes = figure.add_subplot(xlabel='x [m]', ylabel='y [m]', aspect='equal')
    lines = LineCollection(
        [position[:, :2] for position in shapes], array=0.1 * np.arange(len(shapes))
    )
    axes.add_collection(lines)
    axes.autoscale()
    axes.grid(alpha=0.3)
    figure.colorbar(lines, label='time [s]')
    figure.savefig(sys.argv[1], dpi=90)
