"""Shape of a tendon-driven, octopus-inspired soft arm from the tensions of its tendons.

The core: an `Arm`, `solve` or a `Solver`, and the `Backbone` they return. It needs NumPy
and YAML, and nothing of ROS.
"""

from __future__ import annotations

from octo_arm_model.arm import Arm, Body, Material, Section
from octo_arm_model.config import Config, load_config
from octo_arm_model.errors import (
    ArmDefinitionError,
    ConfigError,
    ConvergenceError,
    OctoArmError,
    SolveError,
    TensionError,
)
from octo_arm_model.kinematics import Pose
from octo_arm_model.solver import MODELS, Backbone, Solver, solve

__version__ = '0.1.0'

__all__ = [
    'MODELS',
    'Arm',
    'ArmDefinitionError',
    'Backbone',
    'Body',
    'Config',
    'ConfigError',
    'ConvergenceError',
    'Material',
    'OctoArmError',
    'Pose',
    'Section',
    'SolveError',
    'Solver',
    'TensionError',
    'load_config',
    'solve',
]
