"""Readings of load cells: gain, noise, resolution and losses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from octo_arm_model.config.parameter import Parameter
from octo_arm_model.core.arm.validation import not_negative, whole, within
from octo_arm_model.core.hints import FloatArray

LOAD_CELL_PARAMETERS = (
    Parameter('load_cells.gain_stddev', float,
              'standard deviation of the gain of each load cell, drawn once [-]', 0.0,
              range='>= 0'),
    Parameter('load_cells.noise_stddev', float,
              'standard deviation of the noise of each reading [N]; readings of slack tendons go '
              'below 0', 0.0, range='>= 0'),
    Parameter('load_cells.resolution', float,
              'what readings are multiples of [N]; 0 for all digits', 0.0, range='>= 0'),
    Parameter('load_cells.drop_probability', float,
              'probability that a message of readings is lost [-]', 0.0, range='in [0, 1]'),
    Parameter('load_cells.seed', int, 'seed of gains, noise and losses', 0, range='>= 0'),
)  # fmt: skip


@dataclass(frozen=True)
class LoadCells:
    """Parameters of the load cells of an arm, the same for all.

    What they are is in `LOAD_CELL_PARAMETERS`. They are applied in the order listed here; by
    default all are off.

    Raises:
        ArmDefinitionError: if a value is outside its range.
    """

    gain_stddev: float = 0.0
    noise_stddev: float = 0.0
    resolution: float = 0.0
    drop_probability: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        """Validate."""
        not_negative('load_cells.gain_stddev', self.gain_stddev, 'standard deviation', '-')
        not_negative('load_cells.noise_stddev', self.noise_stddev, 'standard deviation', 'N')
        not_negative('load_cells.resolution', self.resolution, 'tension', 'N')
        within('load_cells.drop_probability', self.drop_probability, 0.0, 1.0, '-')
        whole('load_cells.seed', self.seed)


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
