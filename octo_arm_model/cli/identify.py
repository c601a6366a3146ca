"""``octo-arm identify``: parameters of the arm from measured midlines."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

from octo_arm_model.cli.experiment_options import EPILOG, add_recording, read_options
from octo_arm_model.cli.options import add_json, add_path, check_out, new_command
from octo_arm_model.cli.progress import Bar
from octo_arm_model.config.config import Config, parameters_as_yaml
from octo_arm_model.core.errors import ConfigError, SolveError
from octo_arm_model.experiment.compare import compare
from octo_arm_model.experiment.csv_output import write_tables
from octo_arm_model.experiment.fitting.identify import Identification, Misfit, identify
from octo_arm_model.experiment.fitting.uncertainty import Estimate
from octo_arm_model.experiment.fitting.unknowns import FITS
from octo_arm_model.experiment.recording.observations import Observations

_DESCRIPTION = f"""\
Fit the arm to midlines or tips measured in a recorded experiment, by robust least squares, with
confidence intervals and correlations. What can be fitted, by default youngs_modulus:

  {'  '.join(FITS)}

poisson_ratio and tendon_offsets need the model exact. The alignment is fitted as well where
--align is 'fit', or not given while the midlines are not in base_frame.
"""
_EXAMPLES = """\
examples:
  octo-arm identify experiment
  octo-arm identify experiment --model all --out fitted.yaml
  octo-arm identify experiment --model exact --fit youngs_modulus tension_offset --json

Intervals come from leaving out one step at a time, with Student's t, whose degrees of freedom are
one less than the steps that matter. They hold what differs from step to step (noise, errors of
single tensions) and not what is wrong in all steps alike (a model that does not fit, a wrong
length). Of several models that one is taken which best explains steps it was not fitted to.

"""


def add_command(commands: Any) -> None:
    """Add the command to the subparsers ``commands``."""
    parser = new_command(
        commands,
        'identify',
        _run,
        'fit the arm to midlines in a bag',
        _DESCRIPTION,
        _EXAMPLES + EPILOG,
    )
    add_recording(parser)
    parser.add_argument(
        '--fit',
        nargs='+',
        choices=FITS,
        default=['youngs_modulus'],
        metavar='NAME',
        help='what to fit (default: youngs_modulus)',
    )
    add_path(parser, '--out', 'CONFIG', 'ROS parameter file of the fitted arm to write')
    text = 'folder for midlines.csv, stations.csv and tensions.csv of the fitted arm'
    add_path(parser, '--csv', 'DIR', text)
    add_json(parser)


def _run(options: argparse.Namespace) -> int:
    check_out(options.out, folder=False)
    check_out(options.csv, folder=True, name='--csv')
    recording, observations, models, alignment, notes = read_options(options)
    notes = [*observations.notes, *notes]
    fits = list(dict.fromkeys(options.fit))
    if alignment is None and 'alignment' not in fits:
        fits.append('alignment')
    fitted: dict[str, Identification] = {}
    for model in models:
        try:
            with Bar(f'fits of {model}') as bar:
                fitted[model] = identify(
                    observations.shapes, recording.parameters, model, fits, alignment, bar
                )
        except (ConfigError, SolveError) as error:
            if model == models[-1] and not fitted:
                raise
            notes.append(f'{model} is not fitted: {error}')
    best = best_of(list(fitted.values()))
    if options.out is not None and best.is_trustworthy:
        options.out.write_text(
            as_config(best, str(options.bag or options.tension_csv)), encoding='utf-8'
        )
        notes.append(f'the fitted arm is in {options.out}')
    elif options.out is not None:
        notes.append(f'{options.out} is not written: the data do not determine the arm')
    if options.csv is not None and any(name.startswith('tension_') for name in best.estimates):
        notes.append('no CSV files: compare does it, with the fitted file as --config, and --out')
    elif options.csv is not None and best.is_trustworthy:
        fitted_arm = compare(observations.shapes, best.parameters, best.model, best.alignment)
        names = Config.from_parameters(best.parameters).arm.tendon_names
        tables = write_tables(options.csv, [fitted_arm], names)
        notes.append(f'{", ".join(tables)} of the fitted arm are in {options.csv}')
    print(
        json.dumps(as_dict(best, list(fitted.values()), observations, notes))
        if options.json
        else summary(best, list(fitted.values()), notes)
    )
    return 0 if best.is_trustworthy else 1


def best_of(fitted: Sequence[Identification]) -> Identification:
    """The one that best explains steps it was not fitted to; of one step, the step itself."""
    return min(fitted, key=_rank)


def _rank(one: Identification) -> float:
    misfit = one.cross_validation or one.after
    return math.inf if misfit is None else misfit.rms


def as_config(fitted: Identification, source: str) -> str:
    """ROS parameter file of a fitted arm, with how well its material is known."""
    values = dict(fitted.parameters)
    estimates = fitted.estimates
    young, ratio = estimates.get('youngs_modulus'), estimates.get('poisson_ratio')
    if young is not None and young.value is not None and young.stddev is not None:
        values['material.youngs_modulus_stddev'] = young.stddev / young.value
    if ratio is not None and ratio.stddev is not None:
        values['material.poisson_ratio_stddev'] = ratio.stddev
    Config.from_parameters(values)  # It must load where it goes.
    lines = [f'# Fitted to {source} by octo-arm identify.']
    for name, estimate in estimates.items():
        lines.append(f'# {name}: {_told(estimate)}')
    if 'tension_scale' in estimates or 'tension_offset' in estimates:
        lines.append(
            '# The tensions of this arm are tension_scale times those recorded plus '
            'tension_offset (1 and 0 where not fitted).'
        )
    return '\n'.join(lines) + '\n' + parameters_as_yaml(values)


def _told(estimate: Estimate) -> str:
    if estimate.value is None:
        return 'not determined'
    text = f'{estimate.value:.6g} {estimate.unit}'
    if estimate.stddev is None or estimate.interval95 is None:
        return f'{text}, no interval'
    low, high = estimate.interval95
    return f'{text}, stddev {estimate.stddev:.2g}, 95 % interval {low:.6g} to {high:.6g}'


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
        table = best.correlations.tolist()
        correlations = {name: dict(zip(names, row)) for name, row in zip(names, table)}
    cross_validation = _misfit(best.cross_validation)
    return {
        'model': best.model,
        'trustworthy': best.is_trustworthy,
        'estimates': {
            name: {
                'value': one.value,
                'stddev': one.stddev,
                'interval95': None if one.interval95 is None else list(one.interval95),
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
        lines.append(f'  {name:{width}}  {_told(estimate)}')
    if best.undetermined:
        lines += ['', 'NOTHING FITTED, as these data leave open:']
        lines += [f'  {text}' for text in best.undetermined]
    if best.notes:
        lines += ['', *best.notes]
    lines += ['', 'distance of model and measurement   rms [mm]   tip [% of L]']
    for title, misfit in (
        ('before', best.before), ('after', best.after),
        ('steps left out of the fit', best.cross_validation),
    ):  # fmt: skip
        lines.append(f'  {title:<33}{_cells(misfit)}')
    if len(fitted) > 1:
        lines += ['', 'models, by steps left out            rms [mm]   tip [% of L]']
        for one in sorted(fitted, key=_rank):
            values = ', '.join(
                f'{name} {estimate.value:.5g} {estimate.unit}'
                for name, estimate in one.estimates.items()
                if estimate.value is not None and not name.startswith('alignment')
            )
            lines.append(f'  {one.model:<33}{_cells(one.cross_validation)}   {values}')
    return '\n'.join(lines)


def _cells(misfit: Misfit | None) -> str:
    if misfit is None:
        return f'{"-":>11}{"-":>15}'
    return f'{misfit.rms * 1e3:>11.3f}{100.0 * misfit.tip_error:>15.2f}'
