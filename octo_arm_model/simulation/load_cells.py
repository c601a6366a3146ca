"""Readings of load cells: gain, noise, resolution and losses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.validation import positive
from octo_arm_model.config.parameter import ParameterGroup, stated


@dataclass(frozen=True)
class LoadCells(ParameterGroup):
    """Parameters of the load cells of an arm, the same for all, applied in the order listed here.

    By default all are off.
    """

    GROUP = 'load_cells'

    gain_stddev: float = stated(
        'standard deviation of the gain of each load cell, drawn once [-]', 0.0, '>= 0',
        'standard deviation',
    )  # fmt: skip
    noise_stddev: float = stated(
        'standard deviation of the noise of each reading [N]; readings of slack tendons go '
        'below 0', 0.0, '>= 0', 'standard deviation',
    )  # fmt: skip
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


class SimulatedLoadCells:
    """One load cell for each tendon, over time."""

    def __init__(self, load_cells: LoadCells, tendons: int) -> None:
        """Draw the gains of ``tendons`` load cells."""
        self._tendons = tendons
        self._own = load_cells
        self._draw()

    def change(self, load_cells: LoadCells) -> None:
        """Replace the parameters; another seed gives new gains, noise and losses."""
        before, self._own = self._own, load_cells
        if load_cells.seed != before.seed:
            self._draw()

    def _draw(self) -> None:
        # A stream for each, so that switching one on does not change the others.
        gains, self._noise, self._losses = map(
            np.random.default_rng, np.random.SeedSequence(self._own.seed).spawn(3)
        )
        self._deviation = gains.standard_normal(self._tendons)

    def read(self, tension: FloatArray) -> FloatArray | None:
        """Readings for the errorless readings ``tension`` (tendons,) [N]; None where lost."""
        own = self._own
        noise = self._noise.standard_normal(self._tendons)
        is_lost = self._losses.random() < own.drop_probability
        reading = (1.0 + own.gain_stddev * self._deviation) * tension
        reading += own.noise_stddev * noise
        if own.resolution:
            reading = own.resolution * np.rint(reading / own.resolution)
        return None if is_lost else reading
