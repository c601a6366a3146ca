"""Arms and unknowns for the tests of the estimator."""

import numpy as np

from octo_arm_model import Arm, Body, Loads, Material, Section
from octo_arm_model.estimation.model import ArmModel
from octo_arm_model.estimation.unknowns import PointForce, Unknowns, Walk

RUBBER = Arm(
    Material(1.1e5, 0.5, 1080.0), Body(0.2, 0.0075, 0.003), (Section(0.18, 0.006, 0.0025),)
)
WEIGHT = Loads(gravity=(0.0, 0.0, -9.81), fluid_density=1000.0, tip_force=(0.0, 1e-3, 0.0))
LIKELY = Walk.stationary(0.01, 1.0)  # prior of a force [N]
EVERYTHING = Unknowns(
    tension=Walk(5.0, 1.0),
    tension_bias=Walk(0.1, 0.01),
    tip_force=LIKELY,
    tip_moment=Walk(1e-3),
    point_forces=(PointForce(0.12, LIKELY),),
    current=Walk(1.0),
    log_modulus=Walk(0.05, 0.001),
    tension_loss=Walk.stationary(0.1, 1.0),
)
TENSIONS = np.array([0.5, 0.8, 0.2, 0.4])


def rubber(unknowns: Unknowns, model: str = 'exact', loads: Loads = Loads()) -> ArmModel:
    return ArmModel(RUBBER, unknowns, model, loads=loads, stations=31)
