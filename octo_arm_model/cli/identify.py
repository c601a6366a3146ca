"""``octo-arm identify``: parameters of the arm from measured midlines."""

import argparse
import dataclasses
import json
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from octo_arm_model.cli import arguments
from octo_arm_model.cli.files import Bar, check_out, writing
from octo_arm_model.cli.recordings import ALL, RECORDINGS, of_each, read_options, recording_options
from octo_arm_model.config.config import Config
from octo_arm_model.experiment import identification
from octo_arm_model.experiment.compare import write_tables
from octo_arm_model.experiment.fit import LOSSES
from octo_arm_model.experiment.identification import Identification
from octo_arm_model.experiment.identify import identify
from octo_arm_model.experiment.observations import Observations
from octo_arm_model.experiment.uncertainty import AUTO, Misfit
from octo_arm_model.experiment.unknowns import FITS, is_of_arm


def _misfit(misfit: Misfit) -> dict[str, float]:
    return {'rms': misfit.rms, 'tip_error_percent': 100.0 * misfit.tip_error}


def as_dict(
    best: Identification,
    fitted: Sequence[Identification],
    observations: Observations,
    notes: Sequence[str],
) -> dict[str, Any]:
    """Return all results of the ``best`` model in SI units, and the main ones of the others."""
    correlations: Mapping[str, Any] | None = None
    if best.correlations is not None:
        names = [name for name, value in best.estimates.items() if value.value is not None]
        table = best.correlations.tolist()
        correlations = {name: dict(zip(names, row)) for name, row in zip(names, table)}
    left_out = [{'steps': list(steps), **_misfit(m)} for steps, m in best.step_misfits]
    cross_validation: dict[str, Any] | None = None
    if best.cross_validation is not None:
        cross_validation = {**_misfit(best.cross_validation), 'left_out': left_out}
    return {
        'model': best.model,
        'trustworthy': best.is_trustworthy,
        'loss': best.loss,
        'model_error_floor': best.floor,
        'model_error_stddev': best.tip_stddev,
        'estimates': {
            name: {
                **dataclasses.asdict(value),
                'interval95_near_models': identification.envelope_of(fitted, name),
            }
            for name, value in best.estimates.items()
        },
        'correlations': correlations,
        'undetermined': list(best.undetermined),
        'residuals': {'before': _misfit(best.before), 'after': best.after and _misfit(best.after)},
        'cross_validation': cross_validation,
        'models': [
            {
                'model': fit.model,
                'trustworthy': fit.is_trustworthy,
                'values': {name: value.value for name, value in fit.estimates.items()},
                'intervals95': {name: value.interval95 for name, value in fit.estimates.items()},
                'residuals': fit.after and _misfit(fit.after),
                'cross_validation': fit.cross_validation and _misfit(fit.cross_validation),
            }
            for fit in fitted
        ],
        'alignment_camera_to_base': dataclasses.asdict(best.alignment),
        'steps': len(observations.shapes),
        'clock_offset': observations.offset,
        'notes': [*notes, *best.notes],
    }


def summary(best: Identification, fitted: Sequence[Identification], notes: Sequence[str]) -> str:
    """Return the results as text: estimates and misfits of the best model, and all models."""
    lines = [*notes, '', f'model {best.model}']
    width = max(len(name) for name in best.estimates)
    for name, estimate in best.estimates.items():
        lines.append(f'  {name:{width}}  {identification.in_words(estimate)}')
    if best.undetermined:
        heading = 'NOT FITTED' if best.is_trustworthy else 'NOTHING FITTED'
        lines += ['', f'{heading}, as these data leave open:']
        lines += [f'  {text}' for text in best.undetermined]
    if best.notes:
        lines += ['', *best.notes]
    lines += ['', 'distance of model and measurement   rms [mm]   tip [% of L]']
    for title, misfit in (
        ('before', best.before),
        ('after', best.after),
        ('loads left out of the fit', best.cross_validation),
    ):
        lines.append(f'  {title:<33}{_cells(misfit)}')
    if best.tip_stddev is not None:
        lines.append(
            f'  each coordinate of the tip at loads left out, without noise: '
            f'{100.0 * best.tip_stddev:.2f} % of L (model_error_stddev)'
        )
    if len(fitted) > 1:
        lines += ['', 'models, by loads left out            rms [mm]   tip [% of L]']
        for fit in sorted(fitted, key=identification.rank):
            values = ', '.join(
                f'{name} {estimate.value:.5g} {estimate.unit}'
                for name, estimate in fit.estimates.items()
                if estimate.value is not None and is_of_arm(name)
            )
            lines.append(f'  {fit.model:<33}{_cells(fit.cross_validation)}   {values}')
    return '\n'.join(lines)


def _cells(misfit: Misfit | None) -> str:
    if misfit is None:
        return f'{"-":>11}{"-":>15}'
    return f'{misfit.rms * 1e3:>11.3f}{100.0 * misfit.tip_error:>15.2f}'


SUMMARY = 'fit the arm to midlines in a bag'
DESCRIPTION = f"""\
Fit the arm to midlines or tips measured in a recorded experiment, by robust least squares, with
confidence intervals and correlations. These can be fitted, by default youngs_modulus:

{textwrap.indent(textwrap.fill(', '.join(FITS), 95), '  ')}

poisson_ratio, sheath_stiffness and tendon_offsets need the model exact. rest_curvature, _torsion,
bending_stiffness (E J of a uniform arm) and friction need another model than renda2012; friction
also needs steps of loading and unloading. axial_stiffness (of tendons), displacement_scale (one
factor for the spools of all motors) and displacement_offset (their zeros) need encoder readings
under tension. damping (motion.viscosity, or else motion.damping_time), drag and added_mass need a
recording of a swinging arm; the motion of the model is fitted to its frames (--dynamic).
The alignment is fitted as well with --align fit, or without --align if the midlines are not in
base_frame. A parameter that the data do not determine is reported and keeps its value.
"""
EPILOG = (
    """\
examples:
  octo-arm identify experiment
  octo-arm identify experiment --out fitted.yaml --pictures fitted
  octo-arm identify experiment --model exact --fit youngs_modulus tension_offset --json
  octo-arm identify experiment --model exact --fit youngs_modulus sheath_stiffness
  octo-arm identify experiment --model exact --fit youngs_modulus friction
  octo-arm identify experiment --model exact --fit youngs_modulus axial_stiffness
  octo-arm identify swings --fit damping drag added_mass --align none
  octo-arm identify trial --displacements /servos:angle --spools 0.01 --fit displacement_scale

Intervals come from leaving out one load at a time, with all its repeats, and Student's t, with one
degree of freedom less than there are loads that matter. They include errors that differ from load
to load (noise, errors of single tensions) and a bias as large as the model error, the misfit at
left-out loads beyond the noise. They do not include errors that look like another modulus (a wrong
length, friction while tensions only rise). The chosen model is the one that best explains loads
that it was not fitted to. If another explains them as well, within 10 % or chance, and has other
values, that is reported with the interval of all of them. Without --loss, the loss with the
smaller misfit at left-out loads is chosen.

"""
    + RECORDINGS
)


OPTIONS = f"""\
{recording_options('all')}
--fit NAME... {arguments.choice(FITS)}: parameters to fit (default: youngs_modulus)
--loss {arguments.choice((AUTO, *LOSSES))}: loss to minimise: soft_l1 bounds the influence of
    outliers, linear is least squares (default: the better one at left-out loads)
--out CONFIG path: ROS parameter file of the fitted arm to write
--pictures DIR path: folder for pictures: intervals, residuals along s
--csv DIR path: folder for midlines.csv, stations.csv and tensions.csv of the fitted arm
{arguments.JSON}
"""


def run(options: argparse.Namespace) -> int:
    """Fit the models; print and write the best one. Return 1 if the data determine nothing."""
    # Folders come first, so that a path given as both a folder and a file is refused.
    check_out(options, '--pictures', folder=True, draws=True)
    check_out(options, '--csv', folder=True)
    check_out(options, '--out', folder=False)
    recording, observations, models, alignment, notes, trajectory = read_options(options, [ALL])
    fits = list(dict.fromkeys(options.fit or ['youngs_modulus']))
    if alignment is None and 'alignment' not in fits:
        fits.append('alignment')

    def fit(model: str) -> Identification:
        with Bar(f'fits of {model}') as bar:
            shapes, values = observations.shapes, recording.parameters
            start, loss = alignment, options.loss
            return identify(shapes, values, model, fits, start, bar, loss or AUTO, trajectory)

    fitted = of_each(models, 'fitted', notes, fit)
    best = identification.best_of(fitted)
    notes += identification.disagreements(fitted)
    if 'alignment' in fits:
        pose = *best.alignment.position, *best.alignment.quaternion
        notes.append(f'the camera is at --align {" ".join(f"{one:.6g}" for one in pose)}')
    if options.pictures is not None:
        from octo_arm_model.experiment.pictures import pictures_of_fit, save_all

        pictures = pictures_of_fit(fitted)
        with writing(options.pictures, folder=True) as place, Bar('pictures') as bar:
            save_all(pictures, place, bar.on_terminal)
        notes.append(f'{len(pictures)} pictures are in {options.pictures}')
    if options.out is not None and best.is_trustworthy:
        source = options.bag or options.tension_csv or options.displacement_csv
        text = identification.as_config(best, str(source))
        with writing(options.out) as place:
            place.write_text(text, encoding='utf-8')
        notes.append(f'the fitted arm is in {options.out}')
    elif options.out is not None:
        notes.append(f'{options.out} is not written: the data do not determine the arm')
    if options.csv is not None and best.is_trustworthy:
        with Bar('steps of the fitted arm'):
            fitted_arm = best.comparison
        names = Config.from_parameters(best.parameters).arm.tendon_names
        with writing(options.csv, folder=True) as place:
            tables = write_tables(place, [fitted_arm], names)
        notes.append(f'{", ".join(tables)} of the fitted arm are in {options.csv}')
    elif options.csv is not None:
        notes.append(f'{options.csv} stays empty: the data do not determine the arm')
    print(
        json.dumps(as_dict(best, fitted, observations, notes))
        if options.json
        else summary(best, fitted, notes)
    )
    return 0 if best.is_trustworthy else 1
