"""The unknown quantities of an arm, and how each may change in time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import NoneType

import numpy as np
from scipy.integrate import trapezoid

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import MeasurementError, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.loads import DistributedLoad, Loads, PointLoad
from octo_arm_model.arm.profile import Constant, Linear
from octo_arm_model.arm.validation import LARGEST, SMALLEST, check_class, is_number
from octo_arm_model.estimation.gaussian import Gaussian, lower_root

_AXES = ('x', 'y', 'z')
_ALONG = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_PIECES = 64  # pieces of the table of a current along an arm that is not a cone
_FINE = 256  # pieces of the quadrature of `facing_area`


@dataclass(frozen=True)
class Walk:
    """The prior of a quantity in time: a random walk, or a Gauss-Markov process.

    Raises:
        MeasurementError: if a value is outside its range.
    """

    stddev: float  #: standard deviation at the start, about zero, > 0 [unit of the quantity]
    rate: float = 0.0  #: standard deviation of the random change in a second, >= 0 [unit/s^0.5]
    #: time in which the mean decays by e, > 0 [s]; infinite for a random walk
    correlation_time: float = math.inf

    def __post_init__(self) -> None:
        """Validate."""
        for name, value, least in (('stddev', self.stddev, SMALLEST), ('rate', self.rate, 0.0)):
            if not is_number(value) or not least <= value <= LARGEST:
                expected = f'{least:g} to {LARGEST:g}'
                raise MeasurementError(f'{name} of a walk is {shown(value)}, expected {expected}')
        time = self.correlation_time
        if not is_number(time) or not time > 0.0:
            raise MeasurementError(
                f'correlation_time of a walk is {shown(time)}, expected > 0 [s]'
            )

    @classmethod
    def stationary(cls, stddev: float, correlation_time: float) -> Walk:
        """Return the Gauss-Markov process whose standard deviation is constant without data."""
        checked = cls(stddev, correlation_time=correlation_time)
        return replace(checked, rate=stddev * math.sqrt(2.0 / correlation_time))


@dataclass(frozen=True)
class PointForce:
    """An unknown force on a cross section."""

    s: float  #: arc coordinate of the cross section [m]
    force: Walk  #: prior of each component of the force in base_frame [N]


@dataclass(frozen=True)
class Unknowns:
    """The priors of the estimated quantities; a quantity whose prior is None is zero."""

    #: true tension of every tendon, one prior for all or one for each [N]
    tension: Walk | tuple[Walk, ...]
    #: constant error of every load cell, shown less true tension [N]
    tension_bias: Walk | None = None
    #: each component of an external force on the tip, in base_frame [N]
    tip_force: Walk | None = None
    #: each component of an external moment on the tip, in base_frame [N m]
    tip_moment: Walk | None = None
    point_forces: tuple[PointForce, ...] = ()  #: external forces on given cross sections
    #: each component of the pressure of a uniform current [Pa]: a dead force per reference length,
    #: pressure times diameter, whatever the inclination of the arm
    current: Walk | None = None
    log_modulus: Walk | None = None  #: logarithm of E over that of the arm's description [-]
    #: logarithm of the tension of every tendon at the base over the constant tension along the arm
    #: that has the same effect [-]. Friction makes the latter less where a tendon is drawn in and
    #: more where it is let out.
    tension_loss: Walk | None = None


def place_names(positions: Sequence[float]) -> list[str]:
    """Return names of ``positions`` [m] with four digits, or as many as make them different."""
    for digits in range(4, 18):
        names = [f'{s:.{digits}g} m' for s in positions]
        if len(set(names)) == len(names):
            break
    return names


class State:
    """The unknowns of one arm as a vector.

    Attributes:
        unknowns: the estimated quantities and their priors.
        names: names of the components.
        size: number of components.
        tension, tension_bias, tip_force, tip_moment, point_forces, current, log_modulus,
        tension_loss: slice of the vector with this quantity; empty if it is not estimated.
        unit_loads: slice of the vector with the magnitudes of `unit_loads`.
        reading: derivatives of the readings of the load cells by the state, (tendons, n).
        tip_wrench: derivatives of the wrench on the tip by the state, (6, n).
    """

    def __init__(self, unknowns: Unknowns, arm: Arm) -> None:
        """Lay out the vector of the ``unknowns`` of an ``arm``.

        Raises:
            MeasurementError: if a point force is not on the arm, or the number of priors of the
                tension is not that of the tendons.
        """
        check_class('unknowns', unknowns, Unknowns)
        check_class('arm', arm, Arm)
        self.unknowns = unknowns
        self.names: list[str] = []
        self._walks: list[Walk] = []
        self.tension = self._add('tension', unknowns.tension, arm.tendon_names)
        self.tension_bias = self._add('tension_bias', unknowns.tension_bias, arm.tendon_names)
        self.tip_force = self._add('tip_force', unknowns.tip_force, _AXES)
        self.tip_moment = self._add('tip_moment', unknowns.tip_moment, _AXES)
        start = len(self.names)
        for point in unknowns.point_forces:
            check_class('one of point_forces', point, PointForce)
        places = place_names([point.s for point in unknowns.point_forces])
        for point, place in zip(unknowns.point_forces, places, strict=True):
            if not 0.0 < point.s <= arm.length:
                raise MeasurementError(
                    f's of a point force is {point.s}, expected within (0, {arm.length}] [m]'
                )
            self._add(f'force at {place}', point.force, _AXES)
        self.point_forces = slice(start, len(self.names))
        self.current = self._add('current', unknowns.current, _AXES)
        self.unit_loads = slice(start, len(self.names))
        self.log_modulus = self._add('log_modulus', unknowns.log_modulus, ('E',))
        self.tension_loss = self._add('tension_loss', unknowns.tension_loss, arm.tendon_names)
        self.size = len(self.names)
        self.reading = np.zeros((len(arm.tendon_names), self.size))
        np.fill_diagonal(self.reading[:, self.tension], 1.0)
        np.fill_diagonal(self.reading[:, self.tension_bias], 1.0)
        self.tip_wrench = np.zeros((6, self.size))
        np.fill_diagonal(self.tip_wrench[:3, self.tip_force], 1.0)
        np.fill_diagonal(self.tip_wrench[3:, self.tip_moment], 1.0)
        self._stddev, self._rate, self._time = np.array(
            [(walk.stddev, walk.rate, walk.correlation_time) for walk in self._walks]
        ).T

    def _add(
        self, quantity: str, walk: Walk | tuple[Walk, ...] | None, components: tuple[str, ...]
    ) -> slice:
        start = len(self.names)
        check_class(quantity, walk, Walk, Sequence, NoneType)
        if walk is not None:
            walks = len(components) * (walk,) if isinstance(walk, Walk) else walk
            if len(walks) != len(components):
                expected = f'one or {len(components)}: {", ".join(components)}'
                raise MeasurementError(f'{quantity} has {len(walks)} priors, expected {expected}')
            for component_walk in walks:
                check_class(quantity, component_walk, Walk)
            self.names += [f'{quantity} {part}' for part in components]
            self._walks += walks
        return slice(start, len(self.names))

    @property
    def prior(self) -> Gaussian:
        """The distribution of the state before any measurement."""
        return Gaussian(np.zeros(self.size), np.diag(self._stddev))

    def prior_stddev(self, elapsed: float = 0.0) -> FloatArray:
        """Return the deviations (n,) of the prior ``elapsed`` [s] after the start."""
        return np.hypot(self._stddev * self.decay(elapsed), self.growth(elapsed))

    def later(self, known: Gaussian, elapsed: float) -> Gaussian:
        """Return the distribution that a ``known`` one becomes ``elapsed`` [s] later."""
        decay, growth = self.decay(elapsed), self.growth(elapsed)
        if not growth.any() and (decay == 1.0).all():
            return known
        root = lower_root(np.column_stack([decay[:, np.newaxis] * known.root, np.diag(growth)]))
        return Gaussian(decay * known.mean, root)

    def decay(self, elapsed: float) -> FloatArray:
        """Return the factor (n,) by which the mean decays in ``elapsed`` [s]."""
        return np.exp(-elapsed / self._time)

    def growth(self, elapsed: float) -> FloatArray:
        """Return the standard deviation (n,) of the random change in ``elapsed`` [s]."""
        ratio = 2.0 * elapsed / self._time
        # A random walk, whose correlation time is infinite, decays by nothing.
        remaining = np.divide(-np.expm1(-ratio), ratio, out=np.ones_like(ratio), where=ratio > 0.0)
        return np.asarray(self._rate * np.sqrt(elapsed * remaining))


def unit_loads(arm: Arm, unknowns: Unknowns) -> tuple[Loads, ...]:
    """Return unit loads: each point force and the current of ``unknowns``, along every axis."""
    loads = [
        Loads(points=(PointLoad(point.s, axis),))
        for point in unknowns.point_forces
        for axis in _ALONG
    ]
    if unknowns.current is not None:
        loads += [Loads(distributed=(_current(arm, axis),)) for axis in _ALONG]
    return tuple(loads)


def _current(arm: Arm, axis: tuple[float, float, float]) -> DistributedLoad:
    """Return the force per length of a pressure of 1 Pa along ``axis`` on the diameter."""
    profiles = arm.body.profiles.values()
    s = np.array([0.0, arm.length])
    if not all(isinstance(profile, (Constant, Linear)) for profile in profiles):
        inner = sorted({knot for knot in arm.body.knots if 0.0 < knot < arm.length})
        ends = [0.0, *inner, arm.length]
        # Pieces between two knots; a load has no more points than a table may have.
        pieces = max(1, _PIECES // (len(ends) - 1))
        s = np.interp(np.arange(pieces * (len(ends) - 1) + 1) / pieces, np.arange(len(ends)), ends)
    force = np.outer(2.0 * arm.body.radius(s), axis)
    return DistributedLoad(tuple(s.tolist()), tuple(map(tuple, force.tolist())))


def facing_area(arm: Arm) -> float:
    """Return the area of the unloaded arm seen from the side [m^2], on which a pressure acts."""
    s = np.linspace(0.0, arm.length, _FINE + 1)
    return float(trapezoid(2.0 * arm.body.radius(s), s))
