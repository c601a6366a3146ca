"""Winches, relaxation and load cells in series: from commanded to measured tensions."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.validation import positive
from octo_arm_model.config.build import LoadCellCalibration
from octo_arm_model.config.parameter import ParameterGroup, stated


@dataclass(frozen=True)
class Winches(ParameterGroup):
    """Parameters of the winches of an arm, the same for all, applied in the order listed here.

    By default all are off.
    """

    GROUP = 'winches'

    slack_floor: float = stated('least tension the winches keep [N]', 0.0, '>= 0', 'tension')
    force_limit: float = stated(
        'largest tension of the winches, at least slack_floor [N]; 0 for no limit',
        0.0,
        '>= 0',
        'tension',
    )
    rate_limit: float = stated(
        'largest rate at which their set point changes [N/s]; 0 for no limit', 0.0, '>= 0', 'rate'
    )
    speed_limit: float = stated(
        'largest rate at which lengths of an arm that moves are reeled in or out [m/s]; 0 for no '
        'limit',
        0.0,
        '>= 0',
        'rate',
    )
    lag: float = stated(
        'time constant with which tensions, or lengths, follow the set point [s]; 0 for at once',
        0.0,
        '>= 0',
        'time',
    )
    encoders: bool = stated(
        'whether lengths that the winches have reeled in are published, on '
        'tendon_displacements; an octo_arm_node that hears them is driven by them',
        False,
    )

    def __post_init__(self) -> None:
        """Validate."""
        super().__post_init__()
        if 0.0 < self.force_limit < self.slack_floor:
            expected = f'0, or at least winches.slack_floor, {self.slack_floor} [N]'
            raise ArmDefinitionError('winches.force_limit', self.force_limit, expected)

    def step(
        self, tension: FloatArray, set_point: FloatArray, command: FloatArray, dt: float
    ) -> tuple[FloatArray, FloatArray]:
        """Tensions and set points after ``command`` has been given for ``dt`` [s], all in [N].

        The set point at the end of the step is used for the whole step, and the lag is integrated
        exactly: stable for any step.
        """
        wanted = np.maximum(command, self.slack_floor)
        if self.force_limit:
            wanted = np.minimum(wanted, self.force_limit)
        if self.rate_limit:
            most = self.rate_limit * dt
            wanted = np.clip(wanted, set_point - most, set_point + most)
        left = self._left(dt)
        return (1.0 - left) * wanted + left * tension, wanted

    def reel(self, length: FloatArray, command: FloatArray, dt: float) -> FloatArray:
        """Lengths after ``command`` has been given for ``dt`` [s] from ``length``, all in [m]."""
        change = (1.0 - self._left(dt)) * (command - length)
        if self.speed_limit:
            most = self.speed_limit * dt
            change = np.clip(change, -most, most)
        return np.asarray(length + change)

    def _left(self, dt: float) -> float:
        return math.exp(-dt / self.lag) if self.lag else 0.0


@dataclass(frozen=True)
class Relaxation(ParameterGroup):
    """Parameters of a viscoelastic material. Not in the paper, whose arm is elastic.

    Standard linear solid: under a step of strain its modulus is E (1 + ratio exp(-t / time)),
    where E, that of the arm's definition, is the relaxed one. In every model the shape under
    tendons alone depends on tensions over modulus, so that without inertia the viscoelastic arm
    under tensions T(t) has the shape of the elastic arm under *effective* tensions, which satisfy

        T + time dT/dt = T_effective + (1 + ratio) time dT_effective/dt

    Of a step of T, the part 1 / (1 + ratio) is effective at once, and the rest with the time
    constant (1 + ratio) time. This is exact initially and at rest, and in between to first order
    in the strains. Weight and other loads act on the relaxed arm.
    """

    GROUP = 'relaxation'

    ratio: float = stated(
        'instantaneous over relaxed modulus, less one [-]; 0 for an elastic arm, as in the paper',
        0.0,
        '>= 0',
        'ratio',
    )
    time: float = stated(
        'time constant of the relaxing modulus at constant strain [s]', 1.0, '> 0'
    )

    def step(self, crept: FloatArray, tension: FloatArray, dt: float) -> FloatArray:
        """Tension that the material has given way to after ``tension`` has acted for ``dt`` [s].

        ``crept`` is that before; all (tendons,) [N].
        """
        left = self._left(dt)
        return (1.0 - left) * tension + left * crept

    def effective(self, crept: FloatArray, tension: FloatArray) -> FloatArray:
        """Of a ``tension`` when the material has given way to ``crept``, (tendons,) [N]."""
        return (tension + self.ratio * crept) / (1.0 + self.ratio)

    def tension(self, crept: FloatArray, effective: FloatArray, dt: float) -> FloatArray:
        """Tension that is ``effective`` after it has acted for ``dt`` [s] from ``crept`` on."""
        left = self._left(dt)
        kept = (1.0 + self.ratio) * effective - self.ratio * left * crept
        return np.maximum(kept / (1.0 + self.ratio * (1.0 - left)), 0.0)

    def _left(self, dt: float) -> float:
        return math.exp(-dt / ((1.0 + self.ratio) * self.time)) if self.ratio else 0.0


@dataclass(frozen=True)
class LoadCells(ParameterGroup):
    """Parameters of the load cells of an arm, the same for all, applied in the order listed here.

    By default all are off.
    """

    GROUP = 'load_cells'

    gain_stddev: float = stated(
        'standard deviation of the gain of each load cell, drawn once [-]',
        0.0,
        '>= 0',
        'standard deviation',
    )
    noise_stddev: float = stated(
        'standard deviation of the noise of each reading [N]; readings of slack tendons go '
        'below 0',
        0.0,
        '>= 0',
        'standard deviation',
    )
    resolution: float = stated(
        'what readings are multiples of [N]; 0 for all digits', 0.0, '>= 0', 'tension'
    )
    drop_probability: float = stated(
        'probability that a message of readings is lost [-]', 0.0, 'in [0, 1]'
    )
    seed: int = stated('seed of gains, noise and losses', 0, '>= 0')

    def __post_init__(self) -> None:
        """Validate."""
        super().__post_init__()
        if self.resolution:
            positive('load_cells.resolution', self.resolution, 'N')


@dataclass(frozen=True)
class Hardware:
    """Parameters of the hardware, by default ideal.

    Attributes:
        winches: parameters of the winches, which pull the tendons.
        load_cells: parameters of the load cells, which measure their tensions.
        relaxation: parameters of the viscoelastic material.
        calibration: conversion of readings to tensions; its inverse is applied to the tensions.
    """

    winches: Winches = field(default_factory=Winches)
    load_cells: LoadCells = field(default_factory=LoadCells)
    relaxation: Relaxation = field(default_factory=Relaxation)
    calibration: LoadCellCalibration = field(default_factory=LoadCellCalibration)


class SimulatedHardware:
    """The hardware over time, initially with slack tendons.

    Attributes:
        state: tensions, set points and crept tensions [N], and lengths that winches of an arm that
            moves have reeled in [m], (4, tendons); noise is none of it.
    """

    def __init__(self, hardware: Hardware, tendons: int) -> None:
        """Begin with ``tendons`` slack tendons."""
        self._own = hardware
        self.state: FloatArray = np.zeros((4, tendons))
        self._draw()

    def change(self, hardware: Hardware) -> None:
        """Replace the parameters; the tensions stay. Another seed gives new gains and noise."""
        before, self._own = self._own, hardware
        if hardware.load_cells.seed != before.load_cells.seed:
            self._draw()

    def pull(self, command: FloatArray, dt: float, held: ArrayLike) -> FloatArray:
        """Effective tensions after ``command`` (tendons,) [N] has been given for ``dt`` [s].

        Under these the elastic arm has the shape of this one; without relaxation they are the
        tensions of the tendons. Of tendons ``held`` at a length nothing changes.
        """
        tension, set_point, crept, length = self.state
        tension, set_point = self._own.winches.step(tension, set_point, command, dt)
        crept = self._own.relaxation.step(crept, tension, dt)
        self.state = np.where(held, self.state, [tension, set_point, crept, length])
        return self._own.relaxation.effective(self.state[2], self.state[0])

    def hold(self, effective: FloatArray, length: FloatArray, dt: float, held: ArrayLike) -> None:
        """Take what an arm did in ``dt`` [s]: ``effective`` tensions [N] of tendons ``held``.

        And the ``length`` that winches have reeled in [m]; each (tendons,).
        """
        crept, relaxation = self.state[2], self._own.relaxation
        tension = relaxation.tension(crept, effective, dt)
        new = [tension, tension, relaxation.step(crept, tension, dt)]
        self.state = np.array([*np.where(held, new, self.state[:3]), length])

    def _draw(self) -> None:
        # A stream for each, so that switching one on does not change the others.
        seeds = np.random.SeedSequence(self._own.load_cells.seed).spawn(3)
        gains, self._noise, self._losses = map(np.random.default_rng, seeds)
        self._deviation = gains.standard_normal(self.state.shape[1])

    def read(self) -> FloatArray | None:
        """What load cells read of the tensions now, (tendons,) [N]; None where it is lost."""
        own, tension = self._own.load_cells, self._own.calibration.readings(self.state[0])
        noise = self._noise.standard_normal(tension.size)
        is_lost = self._losses.random() < own.drop_probability
        reading = (1.0 + own.gain_stddev * self._deviation) * tension + own.noise_stddev * noise
        if own.resolution:
            reading = own.resolution * np.rint(reading / own.resolution)
        return None if is_lost else reading
