"""A step response: a tendon is pulled at once, and the arm rings as its modes predict.

python examples/8_ringing.py [picture.png]
"""

import itertools
import sys

import numpy as np

from octo_arm_model import Dynamics, Inputs, MotionProperties, Solver, load_config, modes

STEP, SECONDS = 5e-3, 8.0
arm = load_config('renda2012_prototype').arm.with_density(1080.0)
dynamics = Dynamics(Solver(arm, 'exact', stations=11), MotionProperties(viscosity=300.0))
pull = np.array([[0.2, 0.0, 0.0, 0.0]])

state, tips = dynamics.at_rest(Inputs(0.0 * pull)), []
for _ in range(round(SECONDS / STEP)):
    state = dynamics.step(state, Inputs(pull), STEP)
    tips.append(dynamics.backbone(state).tip)

# The arm rings about this equilibrium.
rest = dynamics.at_rest(Inputs(pull))
slowest = modes(dynamics, rest, 2)
place = dynamics.backbone(rest).tip
along = (np.array(tips) - place) @ (place - [arm.length, 0.0, 0.0])
time = np.arange(1, len(tips) + 1) * STEP
# Faster modes have decayed by then.
rises = np.flatnonzero((along[:-1] < 0.0) & (along[1:] >= 0.0) & (time[1:] > 0.5))
crossings = time[rises] - along[rises] / (along[rises + 1] - along[rises]) * STEP
peaks = [along[begin:end].max() for begin, end in itertools.pairwise(rises)]
frequency = (len(crossings) - 1) / (crossings[-1] - crossings[0])
damping = np.log(peaks[0] / peaks[-1]) / (2.0 * np.pi * (len(peaks) - 1))
print(f'rings at {frequency:.3f} Hz, damping ratio {damping:.4f}')
print(f'its mode {slowest.frequencies[0]:.3f} Hz, damping ratio {slowest.damping[0]:.4f}')

if len(sys.argv) > 1:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 4.0), layout='constrained')
    axes = figure.add_subplot(xlabel='time [s]', ylabel='tip from its final place [mm]')
    size = 1e3 / np.linalg.norm(place - [arm.length, 0.0, 0.0])
    axes.plot(time, size * along)
    decay = -2.0 * np.pi * slowest.frequencies[0] * slowest.damping[0]
    envelope = peaks[0] * np.exp(decay * (time - crossings[0] - 0.25 / frequency))
    axes.plot(time, size * envelope, 'k--', label='damping of the slowest mode')
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    figure.savefig(sys.argv[1], dpi=120)
