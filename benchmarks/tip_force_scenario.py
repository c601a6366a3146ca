"""The scenario of Ferguson, Kuntz and Hermans 2026 (bendier), simulated.

Their robot: a rod of 1.2 mm, E = 40 GPa and G = 15 GPa, 0.25 m long, with four tendons at 10 mm,
one wound once around it and three straight; tensions known to 0.1 N, the tip to 0.1 mm, a force on
the tip of 0.05 N per axis, errors correlated over 1 s, at 30 Hz. Here tendons touch the arm all
along, there at nine discs; the motion is one of our own. The tip moves by hundreds of times what
it is measured to.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from octo_arm_model import Arm, Body, Material, Section
from octo_arm_model.arm.budget import Budget
from octo_arm_model.estimation.estimate import Estimate
from octo_arm_model.estimation.measurements import Measurement, Tensions, TipPosition
from octo_arm_model.estimation.model import BUDGET, ArmModel, Prediction
from octo_arm_model.estimation.unknowns import Unknowns, Walk

PERIOD = 1.0 / 30.0
CORRELATED = 1.0  # s
TENSION, FORCE, TIP = 0.1, 0.05, 1e-4  # standard deviations [N, N, m]
# White noise of the reading besides the correlated error, and how fast tensions may change.
READING, SPEED = 1e-3, 50.0
ROBOT = Arm(
    Material.from_moduli(40e9, 15e9),
    Body(0.25, 0.0006, 0.0006, disc_radius=0.01),
    (
        Section(
            0.25, 0.01, 0.01,
            angles=(0.0, math.pi, 1.5 * math.pi, 0.0),
            twist=(2.0 * math.pi, 0.0, 0.0, 0.0),
        ),
    ),
)  # fmt: skip


def arm_model(
    *, remembers: bool, is_compiled: bool = False, stations: int = 51, budget: Budget = BUDGET
) -> ArmModel:
    """The robot, whose errors are correlated in time or, to the estimator, are not."""
    correlated = CORRELATED if remembers else 1e-6
    unknowns = Unknowns(
        Walk(20.0, SPEED),
        tension_bias=Walk.stationary(TENSION, correlated),
        tip_force=Walk.stationary(FORCE, correlated),
    )
    return ArmModel(
        ROBOT, unknowns, material='linear', stations=stations, compiled=is_compiled, budget=budget
    )


def simulated(
    steps: int, seed: int, is_compiled: bool = False
) -> list[tuple[list[Measurement], Prediction]]:
    """What is measured and what is true, at every step."""
    model = arm_model(remembers=True, is_compiled=is_compiled)
    state, rng = model.state, np.random.default_rng(seed)
    x = state.prior_stddev() * rng.normal(size=state.size)
    made: list[tuple[list[Measurement], Prediction]] = []
    for step in range(steps):
        if step:
            noise = rng.normal(size=state.size)
            x = state.decay(PERIOD) * x + state.growth(PERIOD) * noise
        turns = np.array([0.2, 0.3, 0.25, 0.15]) * step * PERIOD
        x[state.tension] = 2.0 + 1.5 * np.sin(2.0 * np.pi * turns + np.arange(4.0) + seed)
        at = Prediction(model, x.copy(), made[-1][1].solved if made else None)
        reading = x[state.tension] + x[state.tension_bias] + READING * rng.normal(size=4)
        tip = at.solved.tip + TIP * rng.normal(size=3)
        made.append(([Tensions(reading, READING), TipPosition(tip, TIP)], at))
    return made


def square(found: Estimate, truth: Prediction, part: slice) -> float:
    """Normalised squared error of a ``part`` of the state; its mean is the size of that."""
    error = (found.mean - truth.x)[part]
    return float(error @ np.linalg.solve(found.covariance[part, part], error))


def is_inside(found: Estimate, truth: Prediction, part: slice) -> NDArray[np.bool_]:
    """Whether the true values of a ``part`` of the state are within bands of 95 %."""
    limit = 1.96 * np.sqrt(np.diag(found.covariance)[part])
    return np.asarray(np.abs((found.mean - truth.x)[part]) < limit)
