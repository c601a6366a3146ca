"""A reach that is learnt: the cross-entropy method over profiles of tensions.

The best of several random profiles of tensions give the next mean and spread. A profile is good
if the tip is near the target at the end, and slow; no gradient is used.
"""

import numpy as np

from octo_arm_model import Dynamics, Inputs, Loads, MotionProperties, Solver, load_config

STEP, SECONDS, KNOTS = 2e-2, 0.5, 2
ROUNDS, PROFILES, BEST = 14, 12, 3
HIGHEST, TARGET = 2.0, np.array([0.235, -0.06, 0.05])
arm = load_config('renda2012_prototype').arm.with_density(1080.0)
water = MotionProperties(300.0, normal_drag=2.5, tangential_drag=0.01, added_mass=1.5)
dynamics = Dynamics(Solver(arm, 'exact', stations=2, loads=Loads(fluid_density=1022.0)), water)
rest = dynamics.at_rest(Inputs(np.zeros(arm.tension_shape)))
TENDONS = arm.tension_shape[1]


def reach(profile: np.ndarray) -> tuple[float, float]:
    """Return the distance of the tip to the target [m] and its speed [m/s] after a ``profile``."""
    knots = np.vstack([np.zeros(TENDONS), profile.clip(0.0, HIGHEST)])
    times, state = np.linspace(0.0, SECONDS, KNOTS + 1), rest
    for time in np.arange(1, round(SECONDS / STEP) + 1) * STEP:
        tensions = [np.interp(time, times, column) for column in knots.T]
        state = dynamics.step(state, Inputs([tensions]), STEP)
    away = dynamics.backbone(state).tip - TARGET
    return float(np.linalg.norm(away)), float(np.linalg.norm(dynamics.velocities(state)[-1]))


rng = np.random.default_rng(0)
mean, spread = np.full((KNOTS, TENDONS), 0.25 * HIGHEST), np.full((KNOTS, TENDONS), 0.5 * HIGHEST)
for number in range(ROUNDS):
    profiles = mean + spread * rng.standard_normal((PROFILES, KNOTS, TENDONS))
    profiles[0] = mean
    results = [reach(profile) for profile in profiles]
    # A speed of 0.1 m/s costs as much as a distance of 10 mm.
    order = np.argsort([distance + 0.1 * speed for distance, speed in results])
    best = profiles[order[:BEST]]
    mean, spread = best.mean(axis=0), best.std(axis=0) + 0.02 * HIGHEST
    if number == 0:
        first = reach(mean)
distance, speed = reach(mean)
print(f'after the first round {1e3 * first[0]:.1f} mm from the target at {first[1]:.3f} m/s')
print(f'after the last {1e3 * distance:.1f} mm at {speed:.3f} m/s')
