"""What `octo-arm identify` prints of fitted models: JSON, and text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from octo_arm_model.experiment.fitting.fitted_file import in_words
from octo_arm_model.experiment.fitting.held_back import Misfit
from octo_arm_model.experiment.fitting.identification import Identification
from octo_arm_model.experiment.fitting.model_choice import envelope_of, rank
from octo_arm_model.experiment.fitting.unknowns.unknown import is_of_arm
from octo_arm_model.experiment.shapes.observations import Observations


def _misfit(misfit: Misfit | None) -> dict[str, float] | None:
    if misfit is None:
        return None
    return {'rms': misfit.rms, 'tip_error_percent': 100.0 * misfit.tip_error}


def as_dict(
    best: Identification,
    fitted: Sequence[Identification],
    observations: Observations,
    notes: Sequence[str],
) -> dict[str, Any]:
    """Everything of the ``best`` model in SI units, and what the others come to."""
    names = list(best.estimates)
    correlations: Mapping[str, Any] | None = None
    if best.correlations is not None:
        names = [name for name, one in best.estimates.items() if one.value is not None]
        table = best.correlations.tolist()
        correlations = {name: dict(zip(names, row)) for name, row in zip(names, table)}
    cross_validation = _misfit(best.cross_validation)
    return {
        'model': best.model,
        'trustworthy': best.is_trustworthy,
        'loss': best.loss,
        'model_error_floor': best.floor,
        'model_error_stddev': best.tip_stddev,
        'estimates': {
            name: {
                'value': one.value,
                'stddev': one.stddev,
                'interval95': None if one.interval95 is None else list(one.interval95),
                'model_stddev': one.model_stddev,
                'interval95_near_models': envelope_of(fitted, name),
                'unit': one.unit,
            }
            for name, one in best.estimates.items()
        },
        'correlations': correlations,
        'undetermined': list(best.undetermined),
        'residuals': {'before': _misfit(best.before), 'after': _misfit(best.after)},
        'cross_validation': None if cross_validation is None else {
            **cross_validation,
            'left_out': [
                {'steps': list(steps), **(_misfit(one) or {})} for steps, one in best.step_misfits
            ],
        },
        'models': [
            {
                'model': one.model,
                'trustworthy': one.is_trustworthy,
                'values': {name: estimate.value for name, estimate in one.estimates.items()},
                'intervals95': {
                    name: estimate.interval95 for name, estimate in one.estimates.items()
                },
                'residuals': _misfit(one.after),
                'cross_validation': _misfit(one.cross_validation),
            }
            for one in fitted
        ],
        'alignment_camera_to_base': best.alignment.as_dict(),
        'steps': len(observations.shapes),
        'clock_offset': observations.offset,
        'notes': [*notes, *best.notes],
    }  # fmt: skip


def summary(best: Identification, fitted: Sequence[Identification], notes: Sequence[str]) -> str:
    """The same in text."""
    lines = [*notes, '', f'model {best.model}']
    width = max(len(name) for name in best.estimates)
    for name, estimate in best.estimates.items():
        lines.append(f'  {name:{width}}  {in_words(estimate)}')
    if best.undetermined:
        what = 'NOT FITTED' if best.is_trustworthy else 'NOTHING FITTED'
        lines += ['', f'{what}, as these data leave open:']
        lines += [f'  {text}' for text in best.undetermined]
    if best.notes:
        lines += ['', *best.notes]
    lines += ['', 'distance of model and measurement   rms [mm]   tip [% of L]']
    for title, misfit in (
        ('before', best.before), ('after', best.after),
        ('loads left out of the fit', best.cross_validation),
    ):  # fmt: skip
        lines.append(f'  {title:<33}{_cells(misfit)}')
    if best.tip_stddev is not None:
        lines.append(
            f'  each coordinate of the tip at loads left out, without noise: '
            f'{100.0 * best.tip_stddev:.2f} % of L (model_error_stddev)'
        )
    if len(fitted) > 1:
        lines += ['', 'models, by loads left out            rms [mm]   tip [% of L]']
        for one in sorted(fitted, key=rank):
            values = ', '.join(
                f'{name} {estimate.value:.5g} {estimate.unit}'
                for name, estimate in one.estimates.items()
                if estimate.value is not None and is_of_arm(name)
            )
            lines.append(f'  {one.model:<33}{_cells(one.cross_validation)}   {values}')
    return '\n'.join(lines)


def _cells(misfit: Misfit | None) -> str:
    if misfit is None:
        return f'{"-":>11}{"-":>15}'
    return f'{misfit.rms * 1e3:>11.3f}{100.0 * misfit.tip_error:>15.2f}'
