"""Estimates and innovations as tidy CSV files, units in their headers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from octo_arm_model.config.files import CsvFiles
from octo_arm_model.estimation.state.prediction import ArmModel
from octo_arm_model.estimation.state.unknowns import State
from octo_arm_model.experiment.estimating.estimates import TimedEstimate
from octo_arm_model.experiment.estimating.history import Moment

_AXES = ('x', 'y', 'z')
_WRENCH = [*(f'force {axis} [N]' for axis in _AXES), *(f'moment {axis} [N m]' for axis in _AXES)]
_TIP = [f'tip {axis} [m]' for axis in _AXES]
INNOVATIONS = (
    'time [s]', 'measurement', 'component', 'innovation', 'stddev', 'normalised square',
    'accepted',
)  # fmt: skip


class EstimateTables(CsvFiles):
    """Writes estimate.csv, a row for each time, and innovations.csv, a row for each number."""

    def __init__(self, folder: Path, models: Mapping[str, ArmModel]) -> None:
        """Write into ``folder`` what is estimated by ``models``.

        Raises:
            OSError: if a file cannot be written.
        """
        super().__init__()
        self._hypotheses = list(models) if len(models) > 1 else []
        self._estimates = self.open(folder / 'estimate.csv')
        self._innovations = self.open(folder / 'innovations.csv')
        self._innovations.writerow(INNOVATIONS)
        state = next(iter(models.values())).state
        others = [state.names[number] for number in _besides_contact(state)]
        values = [*_TIP, *_WRENCH, *(f'{name}{_unit(name)}' for name in others)]
        deviations = [name.replace(' [', ' stddev [') for name in values]
        self._estimates.writerow([
            'time [s]', 'stamp [ns]', 'contact', 'contact s [m]', *values, *deviations,
            'normalised square', 'numbers', 'refused',
            *(f'probability {name}' for name in self._hypotheses),
        ])  # fmt: skip

    def write(self, moment: Moment, one: TimedEstimate) -> None:
        """Write ``one`` estimate.

        Raises:
            OSError: if it cannot be written.
        """
        time, estimate = round(moment.time, 9), one.estimate
        at = _besides_contact(estimate.state)
        deviations = np.sqrt(np.diag(estimate.covariance))[at]
        self._estimates.writerow([
            time, one.stamp_ns, moment.hypothesis, moment.s,
            *moment.tip.tolist(), *moment.wrench.tolist(), *estimate.mean[at].tolist(),
            *moment.tip_stddev.tolist(), *moment.wrench_stddev.tolist(), *deviations.tolist(),
            *estimate.normalised_square,
            ' and '.join(part.name for part in one.innovations if not part.is_accepted),
            *(one.probabilities[name] for name in self._hypotheses),
        ])  # fmt: skip
        for part in one.innovations:
            stddev = np.sqrt(np.diag(part.covariance))
            for number, (value, size) in enumerate(zip(part.value, stddev, strict=True)):
                self._innovations.writerow([
                    time, part.name, number, float(value), float(size), part.normalised_square,
                    int(part.is_accepted),
                ])  # fmt: skip


def _besides_contact(state: State) -> list[int]:
    """Components of a ``state`` but those of the contact, which has columns of its own."""
    others = slice(state.point_forces.start + 3, state.point_forces.stop)
    parts = state.tension, state.tension_bias, others, state.log_modulus, state.tension_loss
    return [number for part in parts for number in range(state.size)[part]]


def _unit(name: str) -> str:
    return ' [-]' if name.startswith(('log_modulus', 'tension_loss')) else ' [N]'
