"""Shape of a tendon-driven, octopus-inspired soft arm from the tensions of its tendons.

The core: an `Arm`, `solve` or a `Solver`, and the `Backbone` they return. It needs NumPy
and YAML, and nothing of ROS.
"""

from __future__ import annotations

from octo_arm_model.arm import Arm
from octo_arm_model.backbone import Backbone
from octo_arm_model.body import Body, ProfiledBody
from octo_arm_model.config import Config, load_config
from octo_arm_model.errors import (
    ArmDefinitionError,
    ConfigError,
    ConvergenceError,
    LoadError,
    OctoArmError,
    SolveError,
    TensionError,
)
from octo_arm_model.kinematics import Pose
from octo_arm_model.loads import DistributedLoad, Loads, PointLoad
from octo_arm_model.material import Material
from octo_arm_model.profiles import Constant, Function, Linear, Profile, Table
from octo_arm_model.solver import MODELS, Solver, solve
from octo_arm_model.tendon import RoutedSection, Section, Tendon

__version__ = '0.1.0'

__all__ = [
    'MODELS',
    'Arm',
    'ArmDefinitionError',
    'Backbone',
    'Body',
    'Config',
    'ConfigError',
    'Constant',
    'ConvergenceError',
    'DistributedLoad',
    'Function',
    'Linear',
    'LoadError',
    'Loads',
    'Material',
    'OctoArmError',
    'PointLoad',
    'Pose',
    'Profile',
    'ProfiledBody',
    'RoutedSection',
    'Section',
    'SolveError',
    'Solver',
    'Table',
    'Tendon',
    'TensionError',
    'load_config',
    'solve',
]
