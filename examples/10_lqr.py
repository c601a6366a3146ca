"""The arm in motion: how it rings after a step, and a controller from its linear model (LQR)."""

import numpy as np
from scipy.linalg import solve_continuous_are

from octo_arm_model import (
    Dynamics,
    Inputs,
    Loads,
    MotionProperties,
    Solver,
    linearise,
    load_config,
    modes,
)

STEP, SECONDS = 5e-3, 2.0
arm = load_config('renda2012_table4').arm.with_density(1080.0)
loads = Loads(gravity=(0.0, 0.0, -9.81), fluid_density=1022.0)
water = MotionProperties(300.0, normal_drag=2.5, tangential_drag=0.01, added_mass=1.5)
dynamics = Dynamics(Solver(arm, 'exact', stations=21, loads=loads), water)

# The linear model holds near this equilibrium, in which all tendons are a little tight.
rest = dynamics.at_rest(Inputs(np.full((3, 4), 0.05)))
slowest = modes(dynamics, rest, 4)
print('frequencies [Hz]', slowest.frequencies.round(3), 'damping', slowest.damping.round(4))
model = linearise(dynamics, rest, 4)
effort = 1e-2 * np.eye(12)  # [m^2/N^2]: 0.1 N cost as much as 10 mm of the tip
cost = solve_continuous_are(model.A, model.B, model.C.T @ model.C, effort)
gain = np.linalg.solve(effort, model.B.T @ cost)


def swing(is_controlled: bool) -> float:
    """Return the root mean square distance of the tip from its place at rest after a push [mm]."""
    state, x, distances, place = rest, np.zeros(8), [], dynamics.backbone(rest).tip
    # The state of the modes follows from positions and velocities of the stations.
    tips = slowest.shapes[:, -1]
    scale = (model.C[:, :4].T * tips).sum(axis=1) / (tips * tips).sum(axis=1)
    to_modes = np.linalg.pinv(slowest.shapes.reshape(4, -1).T * scale)
    still = dynamics.backbone(rest).position
    for number in range(round(SECONDS / STEP)):
        tensions = np.full(12, 0.05) - is_controlled * gain @ x
        push = 0.01 if number * STEP < 0.2 else 0.0
        inputs = Inputs(tensions.clip(0.0).reshape(3, 4), tip_wrench=(0, push, 0, 0, 0, 0))
        state = dynamics.step(state, inputs, STEP)
        moved = dynamics.backbone(state).position - still
        x[:4] = to_modes @ moved.ravel()
        x[4:] = to_modes @ dynamics.velocities(state).ravel()
        distances.append(np.linalg.norm(dynamics.backbone(state).tip - place))
    return float(1e3 * np.sqrt(np.mean(np.square(distances[round(0.2 / STEP) :]))))


print(f'rings by {swing(False):.2f} mm, controlled by {swing(True):.2f} mm')
