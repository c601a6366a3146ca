"""A viscoelastic material. Not in the paper, whose arm is elastic.

Standard linear solid: under a step of strain its modulus is E (1 + ratio exp(-t / time)), where E,
that of the arm's definition, is the relaxed one. In every model the shape under tendons alone
depends on tensions over modulus, so that without inertia the viscoelastic arm under tensions T(t)
has the shape of the elastic arm under *effective* tensions, which satisfy

    T + time dT/dt = T_effective + (1 + ratio) time dT_effective/dt

Of a step of T, the part 1 / (1 + ratio) is effective at once, and the rest with the time constant
(1 + ratio) time. This is exact initially and at rest, and in between to first order in the
strains. Weight and other loads act on the relaxed arm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.parameter import ParameterGroup, stated


@dataclass(frozen=True)
class Relaxation(ParameterGroup):
    """Parameters of the relaxing modulus."""

    GROUP = 'relaxation'

    ratio: float = stated(
        'instantaneous over relaxed modulus, less one [-]; 0 for an elastic arm, as in the paper',
        0.0, '>= 0', 'ratio',
    )  # fmt: skip
    time: float = stated(
        'time constant of the relaxing modulus at constant strain [s]', 1.0, '> 0'
    )


class SimulatedRelaxation:
    """Effective tensions of one arm over time.

    Attributes:
        relaxation: its parameters; may be replaced between two steps.
        crept: tension that the material has given way to (tendons,) [N].
    """

    def __init__(self, relaxation: Relaxation, tendons: int) -> None:
        """Begin at rest with ``tendons`` slack tendons."""
        self.relaxation = relaxation
        self.crept: FloatArray = np.zeros(tendons)

    def step(self, tension: FloatArray, dt: float) -> FloatArray:
        """Effective tensions (tendons,) [N] after ``tension`` has acted for ``dt`` [s]."""
        ratio, time = self.relaxation.ratio, self.relaxation.time
        left = math.exp(-dt / ((1.0 + ratio) * time)) if ratio else 0.0
        self.crept = (1.0 - left) * tension + left * self.crept
        return (tension + ratio * self.crept) / (1.0 + ratio)
