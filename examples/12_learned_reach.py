"""A reach that is learnt: the cross-entropy method over profiles of tensions.

Of random profiles of a few tendons the best become the next mean and spread. What counts is how
near the tip is to the target at the end and how fast it still is; no gradient is used.
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
    """Distance of the tip from the target [m] and its speed [m/s] after a profile of tensions."""
    knots = np.vstack([np.zeros(TENDONS), profile.clip(0.0, HIGHEST)])
    times, state = np.linspace(0.0, SECONDS, KNOTS + 1), rest
    for time in np.arange(1, round(SECONDS / STEP) + 1) * STEP:
        pulled = [np.interp(time, times, column) for column in knots.T]
        state = dynamics.step(state, Inputs([pulled]), STEP)
    away = dynamics.backbone(state).tip - TARGET
    return float(np.linalg.norm(away)), float(np.linalg.norm(dynamics.velocities(state)[-1]))


rng = np.random.default_rng(0)
mean, spread = np.full((KNOTS, TENDONS), 0.25 * HIGHEST), np.full((KNOTS, TENDONS), 0.5 * HIGHEST)
for number in range(ROUNDS):
    profiles = mean + spread * rng.standard_normal((PROFILES, KNOTS, TENDONS))
    profiles[0] = mean
    results = [reach(profile) for profile in profiles]
    # 0.1 m/s is as bad as 10 mm.
    order = np.argsort([distance + 0.1 * speed for distance, speed in results])
    best = profiles[order[:BEST]]
    mean, spread = best.mean(axis=0), best.std(axis=0) + 0.02 * HIGHEST
    if number == 0:
        first = reach(mean)
distance, speed = reach(mean)
print(f'after the first round {1e3 * first[0]:.1f} mm from the target at {first[1]:.3f} m/s')
print(f'after the last {1e3 * distance:.1f} mm at {speed:.3f} m/s')
