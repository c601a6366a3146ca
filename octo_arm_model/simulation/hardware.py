"""The winches, the relaxation and the load cells: from commanded to measured tensions."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.validation import positive
from octo_arm_model.config.calibration import Calibration
from octo_arm_model.config.parameter import ParameterGroup, stated


@dataclass(frozen=True)
class Winches(ParameterGroup):
    """The parameters of the winches, which are the same for all and apply in this order.

    By default none has an effect.
    """

    GROUP = 'winches'

    slack_floor: float = stated(
        'double | 0.0 | >= 0 | what tension', 'least tension the winches keep [N]'
    )
    force_limit: float = stated(
        'double | 0.0 | >= 0 | what tension',
        'largest tension of the winches, at least slack_floor [N]; 0 for no limit',
    )
    rate_limit: float = stated(
        'double | 0.0 | >= 0 | what rate',
        'largest rate at which their set point changes [N/s]; 0 for no limit',
    )
    speed_limit: float = stated(
        'double | 0.0 | >= 0 | what rate | with dynamics',
        'largest rate at which lengths of an arm that moves are reeled in or out [m/s]; 0 for no '
        'limit',
    )
    lag: float = stated(
        'double | 0.0 | >= 0 | what time',
        'time constant with which tensions, or lengths, follow the set point [s]; 0 for at once',
    )
    encoders: bool = stated(
        'bool | False',
        'whether lengths that the winches have reeled in are published, on '
        'tendon_displacements; an octo_arm_node that hears them is driven by them',
    )

    def __post_init__(self) -> None:
        """Check the values."""
        super().__post_init__()
        if 0.0 < self.force_limit < self.slack_floor:
            expected = f'0, or at least winches.slack_floor, {self.slack_floor} [N]'
            raise ArmDefinitionError('winches.force_limit', self.force_limit, expected)

    def step(
        self, tension: FloatArray, set_point: FloatArray, command: FloatArray, dt: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return tensions and set points after ``dt`` [s] under a ``command``, all in [N].

        The set point at the end of the step holds for the whole step, and the lag is integrated
        exactly, which is stable for any step.
        """
        target = np.maximum(command, self.slack_floor)
        if self.force_limit:
            target = np.minimum(target, self.force_limit)
        if self.rate_limit:
            most = self.rate_limit * dt
            target = np.clip(target, set_point - most, set_point + most)
        decay = self._decay(dt)
        return (1.0 - decay) * target + decay * tension, target

    def reel(self, length: FloatArray, command: FloatArray, dt: float) -> FloatArray:
        """Return the lengths after ``dt`` [s] under a ``command``, from ``length``, all in [m]."""
        change = (1.0 - self._decay(dt)) * (command - length)
        if self.speed_limit:
            most = self.speed_limit * dt
            change = np.clip(change, -most, most)
        return np.asarray(length + change)

    def _decay(self, dt: float) -> float:
        return math.exp(-dt / self.lag) if self.lag else 0.0


@dataclass(frozen=True)
class Relaxation(ParameterGroup):
    """The parameters of a viscoelastic material; the arm of the paper is elastic.

    It is a standard linear solid: after a step of strain the modulus is E (1 + ratio exp(-t /
    time)), where the E of the arm is the relaxed modulus. In every model the shape under tendons
    alone depends on tensions over modulus, so that without inertia the viscoelastic arm under
    tensions T(t) has the shape of the elastic arm under *effective* tensions, which satisfy

        T + time dT/dt = T_effective + (1 + ratio) time dT_effective/dt

    The part 1 / (1 + ratio) of a step of T is effective at once, and the rest with the time
    constant (1 + ratio) time. This is exact at first and at rest, and in between to first order in
    the strains. Weight and other loads act on the relaxed arm.
    """

    GROUP = 'relaxation'

    ratio: float = stated(
        'double | 0.0 | >= 0 | what ratio',
        'instantaneous over relaxed modulus, less one [-]; 0 for an elastic arm, as in the paper',
    )
    time: float = stated(
        'double | 1.0 | > 0', 'time constant of the relaxing modulus at constant strain [s]'
    )

    def step(self, crept: FloatArray, tension: FloatArray, dt: float) -> FloatArray:
        """Return the crept tension after ``tension`` has acted for ``dt`` [s], (tendons,) [N].

        ``crept`` is the crept tension before: the one whose strain the material has at rest.
        """
        decay = self._decay(dt)
        return (1.0 - decay) * tension + decay * crept

    def effective(self, crept: FloatArray, tension: FloatArray) -> FloatArray:
        """Return effective tensions for a ``tension`` and a ``crept`` one, (tendons,) [N]."""
        return (tension + self.ratio * crept) / (1.0 + self.ratio)

    def tension(self, crept: FloatArray, effective: FloatArray, dt: float) -> FloatArray:
        """Return the tension that is ``effective`` after ``dt`` [s], from ``crept``."""
        decay = self._decay(dt)
        numerator = (1.0 + self.ratio) * effective - self.ratio * decay * crept
        return np.maximum(numerator / (1.0 + self.ratio * (1.0 - decay)), 0.0)

    def _decay(self, dt: float) -> float:
        return math.exp(-dt / ((1.0 + self.ratio) * self.time)) if self.ratio else 0.0


@dataclass(frozen=True)
class LoadCells(ParameterGroup):
    """The parameters of the load cells, which are the same for all and apply in this order.

    By default none has an effect.
    """

    GROUP = 'load_cells'

    gain_stddev: float = stated(
        'double | 0.0 | >= 0 | what standard deviation',
        'standard deviation of the gain of each load cell, drawn once [-]',
    )
    noise_stddev: float = stated(
        'double | 0.0 | >= 0 | what standard deviation',
        'standard deviation of the noise of each reading [N]; readings of slack tendons go '
        'below 0',
    )
    resolution: float = stated(
        'double | 0.0 | >= 0 | what tension',
        'step of which readings are multiples [N]; 0 for all digits',
    )
    drop_probability: float = stated(
        'double | 0.0 | in [0, 1]', 'probability that a message of readings is lost [-]'
    )
    seed: int = stated('integer | 0 | >= 0', 'seed of gains, noise and losses')

    def __post_init__(self) -> None:
        """Check the values."""
        super().__post_init__()
        if self.resolution:
            positive('load_cells.resolution', self.resolution, 'N')


@dataclass(frozen=True)
class Hardware:
    """The parameters of the hardware, which by default is ideal."""

    #: parameters of the winches, which pull the tendons
    winches: Winches = field(default_factory=Winches)
    #: parameters of the load cells, which measure their tensions
    load_cells: LoadCells = field(default_factory=LoadCells)
    #: parameters of the viscoelastic material
    relaxation: Relaxation = field(default_factory=Relaxation)
    #: conversion of readings to tensions; its inverse is applied to the tensions
    calibration: Calibration = field(default_factory=Calibration)


class SimulatedHardware:
    """The hardware over time, with slack tendons at first.

    Attributes:
        state: tensions, set points and crept tensions [N], and lengths that winches of an arm that
            moves have reeled in [m], (4, tendons), without noise.
    """

    def __init__(self, hardware: Hardware, tendons: int) -> None:
        """Begin with ``tendons`` slack tendons."""
        self._hardware = hardware
        self.state: FloatArray = np.zeros((4, tendons))
        self._draw()

    def change(self, hardware: Hardware) -> None:
        """Replace the parameters; the tensions stay. Another seed gives new gains and noise."""
        before, self._hardware = self._hardware, hardware
        if hardware.load_cells.seed != before.load_cells.seed:
            self._draw()

    def pull(self, command: FloatArray, dt: float, held: ArrayLike) -> FloatArray:
        """Return effective tensions after ``dt`` [s] under a ``command``, both (tendons,) [N].

        Under them the elastic arm has the shape of this one; without relaxation they are the
        tensions of the tendons. The state of tendons ``held`` at a length stays.
        """
        tension, set_point, crept, length = self.state
        tension, set_point = self._hardware.winches.step(tension, set_point, command, dt)
        crept = self._hardware.relaxation.step(crept, tension, dt)
        self.state = np.where(held, self.state, [tension, set_point, crept, length])
        return self._hardware.relaxation.effective(self.state[2], self.state[0])

    def hold(self, effective: FloatArray, length: FloatArray, dt: float, held: ArrayLike) -> None:
        """Take ``effective`` tensions [N] of the ``held`` tendons of an arm after ``dt`` [s].

        Take also the ``length`` that winches have reeled in [m]; each (tendons,).
        """
        crept, relaxation = self.state[2], self._hardware.relaxation
        tension = relaxation.tension(crept, effective, dt)
        new = [tension, tension, relaxation.step(crept, tension, dt)]
        self.state = np.array([*np.where(held, new, self.state[:3]), length])

    def _draw(self) -> None:
        # Each has a stream of random numbers, so that one that is switched on changes no other.
        seeds = np.random.SeedSequence(self._hardware.load_cells.seed).spawn(3)
        gains, self._noise, self._losses = map(np.random.default_rng, seeds)
        self._deviation = gains.standard_normal(self.state.shape[1])

    def read(self) -> FloatArray | None:
        """Return what load cells read now, (tendons,) [N]; None if the message is lost."""
        cells = self._hardware.load_cells
        tension = self._hardware.calibration.readings(self.state[0])
        noise = self._noise.standard_normal(tension.size)
        is_lost = self._losses.random() < cells.drop_probability
        gain = 1.0 + cells.gain_stddev * self._deviation
        reading = gain * tension + cells.noise_stddev * noise
        if cells.resolution:
            reading = cells.resolution * np.rint(reading / cells.resolution)
        return None if is_lost else reading
