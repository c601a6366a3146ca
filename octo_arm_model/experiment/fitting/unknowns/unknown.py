"""The parameters that can be fitted, and the components of x for each.

They form a vector x: of moduli and scales the logarithm of their ratio to the start, so that they
stay positive; of the tendons' own stiffness the ratio of the start to it, in which what encoders
read is linear, and which is zero for tendons that do not stretch; of all others the value itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum, auto

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.experiment.shapes.alignment import Alignment

AXIAL = 'axial_stiffness'
SHEATH = 'sheath_stiffness'
FITS = (
    'youngs_modulus', 'poisson_ratio', SHEATH, 'tendon_offsets', 'friction', 'tension_scale',
    'tension_offset', 'alignment', AXIAL,
)  # fmt: skip
ALIGNMENT = tuple(f'alignment_{part}' for part in ('x', 'y', 'z', 'turn_x', 'turn_y', 'turn_z'))
OFFSET, ZERO = 'tendon_offset.', 'encoder_zero.'  # and the name of a tendon
_EXACT_ONLY = ('poisson_ratio', 'tendon_offsets', SHEATH)
_BY_LOAD_CELLS = ('tension_scale', 'tension_offset')
_FARTHEST = 10.0  # bound of logarithms
_ROUGHEST = 2.0  # largest coefficient of friction that is looked for [-]
_ROUGH = 0.1  # where the search begins without one in the config [-]
_THREAD = 1000.0  # likewise for a tendon's own stiffness E A [N]
_SOFTEST = 1e6  # least stiffness of tendons that is looked for, as its part of the first


class Scale(Enum):
    """How the value of an unknown follows from its component of x."""

    VALUE = auto()
    LOGARITHM = auto()
    INVERSE = auto()


@dataclass(frozen=True)
class Unknown:
    """One number to fit.

    Attributes:
        name: of the parameter.
        unit: its unit.
        start: initial value of x.
        scale: a large change of x.
        low: least value of x.
        high: largest value of x.
        kind: what x is.
        reference: value where x is 0, of a logarithm, or 1, of an inverse.
    """

    name: str
    unit: str
    start: float
    scale: float
    low: float = -math.inf
    high: float = math.inf
    kind: Scale = Scale.VALUE
    reference: float = 1.0

    def value(self, x: float) -> float:
        """Its value at ``x``."""
        if self.kind is Scale.LOGARITHM:
            return self.reference * math.exp(x)
        if self.kind is Scale.INVERSE:
            return self.reference / x if x > 0.0 else math.inf
        return x

    def relative_change(self, x: float, step: float) -> float | None:
        """Relative change of the value by a ``step`` from ``x``; None of one that x itself is."""
        if self.kind is Scale.VALUE:
            return None
        return step if self.kind is Scale.LOGARITHM else -step / max(x, 1e-300)

    def stddev(self, x: float, deviation: float) -> float:
        """Standard deviation of the value for a ``deviation`` of x, to first order."""
        relative = self.relative_change(x, deviation)
        return deviation if relative is None else self.value(x) * abs(relative)


def check_fits(fits: Sequence[str], model: str, is_driven: bool) -> None:
    """Check that ``model`` can be fitted so; tensions are given by lengths if it ``is_driven``.

    Raises:
        ConfigError: if the model has no derivative by one of ``fits``.
    """
    if is_driven and model != 'exact':
        raise ConfigError(
            f'without load cells tensions follow from lengths, which the model {model} does not '
            'know: choose --model exact'
        )
    for name in fits:
        if name not in FITS:
            raise ConfigError(f'cannot fit {name!r}, expected one of {", ".join(FITS)}')
        if name in _EXACT_ONLY and model != 'exact':
            raise ConfigError(
                f'the model {model} has no derivative by {name}: choose --model exact'
            )
        if name == 'friction' and model == 'renda2012':
            raise ConfigError('the model renda2012 has no friction: choose another --model')
        if name in _BY_LOAD_CELLS and is_driven:
            raise ConfigError(f'{name} is of load cells, and there are none in this recording')


def unknowns_of(
    name: str, arm: Arm, pulled: Sequence[str], encoders: Sequence[str], alignment: Alignment
) -> list[Unknown]:
    """The unknowns of one of `FITS`, on ``arm``.

    ``pulled`` are the tendons under tension, ``encoders`` those of them that have one, and
    ``alignment`` is the start of its own fit.
    """
    material = arm.material
    if name in ('youngs_modulus', SHEATH, 'tension_scale'):
        unit, first = {
            'youngs_modulus': ('Pa', float(material.youngs_modulus_at(0.0))),
            SHEATH: ('Pa', arm.sheath_stiffness[0] if arm.sheath_stiffness else 0.0),
            'tension_scale': ('-', 1.0),
        }[name]
        ends = -_FARTHEST, _FARTHEST
        return [Unknown(name, unit, 0.0, 1.0, *ends, Scale.LOGARITHM, first)]
    if name == 'poisson_ratio':
        ratio = float(material.poisson_ratio_at(0.0))
        return [Unknown(name, '-', ratio, 0.5, -1.0 + 1e-6, 0.5)]
    if name == 'friction':
        # Not from zero, the end of its range, which a minimisation hardly leaves.
        given = float(np.mean(arm.friction or (_ROUGH,)))
        return [Unknown(name, '-', given, 0.1, 0.0, _ROUGHEST)]
    if name == 'tension_offset':
        return [Unknown(name, 'N', 0.0, 0.1)]
    if name == 'tendon_offsets':
        return [Unknown(f'{OFFSET}{tendon}', 'm', 0.0, 1e-3) for tendon in pulled]
    if name == AXIAL:
        # Where both together are undetermined the stiffness is left out: it comes last.
        zeros = [Unknown(f'{ZERO}{tendon}', 'm', 0.0, 1e-3) for tendon in encoders]
        first = float(np.mean(arm.axial_stiffness or (0.0,))) or _THREAD
        return [*zeros, Unknown(name, 'N', 1.0, 1.0, 0.0, _SOFTEST, Scale.INVERSE, first)]
    start = (*alignment.shift, *alignment.turn)
    parts = zip(ALIGNMENT, 3 * ['m'] + 3 * ['rad'], start, strict=True)
    return [Unknown(part, unit, float(value), 1e-2) for part, unit, value in parts]


def is_of_arm(name: str) -> bool:
    """Whether an unknown is of the arm and its load cells: no pose of a camera, no encoder's zero.

    These are fitted for the sake of others.
    """
    return name not in ALIGNMENT and not name.startswith(ZERO)
