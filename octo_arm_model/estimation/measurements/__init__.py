"""What can be measured of an arm.

A new measurement is one more class that is a `Measurement`.
"""

from octo_arm_model.estimation.measurements.measurement import (
    Measurement,
    jacobians,
    noise_root,
    residuals,
    seconds,
)
from octo_arm_model.estimation.measurements.places import Curvatures, Markers
from octo_arm_model.estimation.measurements.tendons import TendonDisplacements, Tensions
from octo_arm_model.estimation.measurements.tip import TipPose, TipPosition

__all__ = [
    'Curvatures',
    'Markers',
    'Measurement',
    'TendonDisplacements',
    'Tensions',
    'TipPose',
    'TipPosition',
    'jacobians',
    'noise_root',
    'residuals',
    'seconds',
]
