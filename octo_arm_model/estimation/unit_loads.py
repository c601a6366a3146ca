"""Loads of magnitude one, of which a state holds the magnitudes."""

from __future__ import annotations

import numpy as np
from scipy.integrate import trapezoid

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.loads import DistributedLoad, Loads, PointLoad
from octo_arm_model.arm.profile import Constant, Linear
from octo_arm_model.estimation.unknowns import Unknowns

_AXES: tuple[tuple[float, float, float], ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_PIECES = 64  # of the table of a current along an arm that is no cone
_FINE = 256  # likewise of a quadrature


def unit_loads(arm: Arm, unknowns: Unknowns) -> tuple[Loads, ...]:
    """Of the point forces and the current of ``unknowns`` on ``arm``, each along every axis."""
    unit = [
        Loads(points=(PointLoad(point.s, axis),))
        for point in unknowns.point_forces
        for axis in _AXES
    ]
    if unknowns.current is not None:
        unit += [Loads(distributed=(_current(arm, axis),)) for axis in _AXES]
    return tuple(unit)


def _current(arm: Arm, axis: tuple[float, float, float]) -> DistributedLoad:
    """Pressure of 1 Pa along ``axis``, times the diameter."""
    profiles = arm.body.profiles.values()
    s = np.array([0.0, arm.length])
    if not all(isinstance(profile, (Constant, Linear)) for profile in profiles):
        inside = sorted({knot for knot in arm.body.knots if 0.0 < knot < arm.length})
        ends = [0.0, *inside, arm.length]
        # Parts of what is between two knots; a load has no more points than a table may have.
        parts = max(1, _PIECES // (len(ends) - 1))
        s = np.interp(np.arange(parts * (len(ends) - 1) + 1) / parts, np.arange(len(ends)), ends)
    force = np.outer(2.0 * arm.body.radius(s), axis)
    return DistributedLoad(tuple(s.tolist()), tuple(map(tuple, force.tolist())))


def facing_area(arm: Arm) -> float:
    """Diameter integrated over the unloaded arm [m^2]: what a pressure of 1 Pa acts on."""
    s = np.linspace(0.0, arm.length, _FINE + 1)
    return float(trapezoid(2.0 * arm.body.radius(s), s))
