"""A tip controller at 200 Hz: statics give the tensions, the velocity of the tip the damping."""

import numpy as np

from octo_arm_model import (
    Dynamics,
    Inputs,
    Loads,
    MotionProperties,
    Solver,
    TipPosition,
    find_tensions,
    load_config,
)

PERIOD, SECONDS = 5e-3, 3.0
STIFFNESS, DAMPING = 1.0, 0.4  # gains of the error [-] and of the velocity [s]
HIGHEST, TARGET = 4.0, np.array([0.24, -0.06, -0.03])
arm = load_config('renda2012_prototype').arm.with_density(1080.0)
loads = Loads(gravity=(0.0, 0.0, -9.81), fluid_density=1022.0)
water = MotionProperties(300.0, normal_drag=2.5, tangential_drag=0.01, added_mass=1.5)
dynamics = Dynamics(Solver(arm, 'exact', stations=2, loads=loads), water)
inverse = find_tensions(dynamics.solver, TipPosition(TARGET), highest=HIGHEST)
# The derivative of tensions by the position of the tip at rest.
by_tip = np.linalg.pinv(dynamics.solver.sensitivity(inverse.backbone).by_tension.tip[:3], 0.3)


def reach(is_controlled: bool) -> np.ndarray:
    """Return the distances of the tip from the target over time [m]."""
    state, away = dynamics.at_rest(Inputs(np.zeros(arm.tension_shape))), []
    for _ in range(round(SECONDS / PERIOD)):
        error = dynamics.backbone(state).tip - TARGET
        speed = dynamics.velocities(state)[-1]
        tensions = inverse.backbone.tensions.ravel()
        if is_controlled:
            tensions = tensions - by_tip @ (STIFFNESS * error + DAMPING * speed)
        inputs = Inputs(tensions.clip(0.0, HIGHEST).reshape(arm.tension_shape))
        state = dynamics.step(state, inputs, PERIOD)
        away.append(np.linalg.norm(error))
    return np.array(away)


for is_controlled in (False, True):
    away = reach(is_controlled)
    settled = PERIOD * (np.flatnonzero(away > 2e-3)[-1] + 1)
    rms = 1e3 * np.sqrt(np.mean(np.square(away[round(1.0 / PERIOD) :])))
    name = 'controlled' if is_controlled else 'by statics alone'
    print(f'{name:17} beyond 2 mm until {settled:.2f} s, {rms:.2f} mm rms after 1 s')
