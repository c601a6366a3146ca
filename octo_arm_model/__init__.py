"""Shape of a tendon-driven, octopus-inspired soft arm from the tensions of its tendons.

The core: an `Arm`, `solve` or a `Solver`, and the `Backbone` they return. It needs
NumPy, SciPy and YAML, and nothing of ROS.
"""

from octo_arm_model.analysis.inverse import Inverse, find_tensions
from octo_arm_model.analysis.targets import BackboneShape, Bending, Stiffness, TipPose, TipPosition
from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.body import Body, GivenStiffness, ProfiledBody, RectangularBody, RestShape
from octo_arm_model.arm.errors import (
    ArmDefinitionError,
    ConfigError,
    ConvergenceError,
    LoadError,
    OctoArmError,
    SolveError,
    TargetError,
    TensionError,
)
from octo_arm_model.arm.loads import DistributedLoad, FollowingWrench, Loads, PointLoad
from octo_arm_model.arm.material import Material, MotionProperties
from octo_arm_model.arm.obstacles import Cylinder, Plane, Sphere
from octo_arm_model.arm.pose import Pose
from octo_arm_model.arm.profile import Constant, Function, Linear, Profile, Table
from octo_arm_model.arm.stiffness import estimate_sheath_stiffness
from octo_arm_model.arm.tendon import Discs, RoutedSection, Section, Tendon
from octo_arm_model.config.config import Config, load_config
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.contact import Contacts
from octo_arm_model.rod.displacements import (
    Wound,
    WoundSensitivity,
    displacements_of,
    solve_displacements,
    wound_sensitivity,
)
from octo_arm_model.rod.modes import LinearModel, Modes, linearise, modes
from octo_arm_model.rod.motion import Dynamics, Inputs, MotionState
from octo_arm_model.rod.sensitivity import Sensitivity, Uncertainty
from octo_arm_model.rod.solver import MODELS, Solver, solve

__version__ = '0.1.0'

__all__ = [
    'MODELS',
    'Arm',
    'ArmDefinitionError',
    'Backbone',
    'BackboneShape',
    'Bending',
    'Body',
    'Config',
    'ConfigError',
    'Constant',
    'Contacts',
    'ConvergenceError',
    'Cylinder',
    'Discs',
    'DistributedLoad',
    'Dynamics',
    'FollowingWrench',
    'Function',
    'GivenStiffness',
    'Inputs',
    'Inverse',
    'Linear',
    'LinearModel',
    'LoadError',
    'Loads',
    'Material',
    'Modes',
    'MotionProperties',
    'MotionState',
    'OctoArmError',
    'Plane',
    'PointLoad',
    'Pose',
    'Profile',
    'ProfiledBody',
    'RectangularBody',
    'RestShape',
    'RoutedSection',
    'Section',
    'Sensitivity',
    'SolveError',
    'Solver',
    'Sphere',
    'Stiffness',
    'Table',
    'TargetError',
    'Tendon',
    'TensionError',
    'TipPose',
    'TipPosition',
    'Uncertainty',
    'Wound',
    'WoundSensitivity',
    'displacements_of',
    'estimate_sheath_stiffness',
    'find_tensions',
    'linearise',
    'load_config',
    'modes',
    'solve',
    'solve_displacements',
    'wound_sensitivity',
]
