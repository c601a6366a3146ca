"""``octo-arm identify``: parameters of the arm from measured midlines."""

import argparse
import dataclasses
import json
from collections.abc import Mapping, Sequence
from typing import Any

from octo_arm_model.cli import arguments
from octo_arm_model.cli.files import Bar, check_out, refuse_inside, writing
from octo_arm_model.cli.recordings import ALL, RECORDINGS, add_recording, of_each, read_options
from octo_arm_model.config.config import Config
from octo_arm_model.experiment import identification
from octo_arm_model.experiment.compare import compare, write_tables
from octo_arm_model.experiment.fit import LOSSES
from octo_arm_model.experiment.identification import Identification
from octo_arm_model.experiment.identify import identify
from octo_arm_model.experiment.motion import identify_motion
from octo_arm_model.experiment.observations import Observations
from octo_arm_model.experiment.uncertainty import AUTO, Misfit
from octo_arm_model.experiment.unknowns import FITS, OF_MOTION, is_of_arm


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
    left_out = [{'steps': list(steps), **(_misfit(one) or {})} for steps, one in best.step_misfits]
    cross_validation: dict[str, Any] | None = None
    if best.cross_validation is not None:
        cross_validation = {**(_misfit(best.cross_validation) or {}), 'left_out': left_out}
    return {
        'model': best.model,
        'trustworthy': best.is_trustworthy,
        'loss': best.loss,
        'model_error_floor': best.floor,
        'model_error_stddev': best.tip_stddev,
        'estimates': {
            name: {
                **dataclasses.asdict(one),
                'interval95_near_models': identification.envelope_of(fitted, name),
            }
            for name, one in best.estimates.items()
        },
        'correlations': correlations,
        'undetermined': list(best.undetermined),
        'residuals': {'before': _misfit(best.before), 'after': _misfit(best.after)},
        'cross_validation': cross_validation,
        'models': [
            {
                'model': one.model,
                'trustworthy': one.is_trustworthy,
                'values': {name: own.value for name, own in one.estimates.items()},
                'intervals95': {name: own.interval95 for name, own in one.estimates.items()},
                'residuals': _misfit(one.after),
                'cross_validation': _misfit(one.cross_validation),
            }
            for one in fitted
        ],
        'alignment_camera_to_base': best.alignment.as_dict(),
        'steps': len(observations.shapes),
        'clock_offset': observations.offset,
        'notes': [*notes, *best.notes],
    }


def summary(best: Identification, fitted: Sequence[Identification], notes: Sequence[str]) -> str:
    """The same in text."""
    lines = [*notes, '', f'model {best.model}']
    width = max(len(name) for name in best.estimates)
    for name, estimate in best.estimates.items():
        lines.append(f'  {name:{width}}  {identification.in_words(estimate)}')
    if best.undetermined:
        what = 'NOT FITTED' if best.is_trustworthy else 'NOTHING FITTED'
        lines += ['', f'{what}, as these data leave open:']
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
        for one in sorted(fitted, key=identification.rank):
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


SUMMARY = 'fit the arm to midlines in a bag'
DESCRIPTION = f"""\
Fit the arm to midlines or tips measured in a recorded experiment, by robust least squares, with
confidence intervals and correlations. What can be fitted, by default youngs_modulus:

  {'  '.join(FITS)}

poisson_ratio, sheath_stiffness and tendon_offsets need the model exact; rest_curvature, _torsion,
bending_stiffness (E J of a uniform arm) and friction another than renda2012, friction also steps
loaded and unloaded; axial_stiffness (of tendons), displacement_scale (one factor for the spools
of all motors) and displacement_offset (their zeros) encoder readings under tension.
damping (of motion.viscosity, or else motion.damping_time), drag and added_mass need a recording
that swings, whose frames the moving arm is fitted to (--dynamic), with what else shows there.
The alignment is fitted as well where --align is 'fit', or not given while the midlines are not in
base_frame. What the data cannot tell is left as it is, one parameter at a time, and said.
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

Intervals come from leaving out one load at a time, with all its repeats, with Student's t, whose
degrees of freedom are one less than the loads that matter. They hold what differs from one load
to another (noise, errors of single tensions) and a bias as large as the model error floor: what
held-back loads show beyond the noise. They do not hold what looks like another
modulus (a wrong length, friction while tensions only rise). Of the models that one is taken which
best explains loads it was not fitted to; where others do nearly as well and say otherwise, that is
said, with the interval of all of them together. The loss, too, is that of the lesser misfit at
held-back loads, or --loss.

"""
    + RECORDINGS
)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add its options."""
    add_recording(parser, 'all')
    parser.add_argument(
        '--fit',
        nargs='+',
        choices=FITS,
        default=['youngs_modulus'],
        metavar='NAME',
        help='what to fit (default: youngs_modulus)',
    )
    parser.add_argument(
        '--loss',
        choices=(AUTO, *LOSSES),
        default=AUTO,
        help='what is minimised: soft_l1 bounds the influence of outliers, linear is least '
        'squares (default: the better at held-back loads)',
    )
    arguments.add_path(parser, '--out', 'CONFIG', 'ROS parameter file of the fitted arm to write')
    arguments.add_path(
        parser, '--pictures', 'DIR', 'folder for pictures: intervals, residuals along s'
    )
    text = 'folder for midlines.csv, stations.csv and tensions.csv of the fitted arm'
    arguments.add_path(parser, '--csv', 'DIR', text)
    arguments.add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Fit the models, and print and write the best; 1 where the data determine nothing."""
    refuse_inside(options.bag, options.out, options.pictures, options.csv)
    # Folders first: what is to be both is refused then.
    check_out(options, '--pictures', folder=True, draws=True)
    check_out(options, '--csv', folder=True)
    check_out(options, '--out', folder=False)
    # These show in a motion alone.
    options.dynamic |= not {*OF_MOTION}.isdisjoint(options.fit)
    default = [] if options.dynamic else [ALL]
    recording, observations, models, alignment, notes, trajectory = read_options(options, default)
    fits = list(dict.fromkeys(options.fit))
    if alignment is None and 'alignment' not in fits:
        fits.append('alignment')

    def fit(model: str) -> Identification:
        with Bar(f'fits of {model}') as bar:
            shapes, values = observations.shapes, recording.parameters
            if trajectory is not None and alignment is not None:
                return identify_motion(
                    shapes, values, fits, alignment, trajectory, bar, options.loss
                )
            return identify(shapes, values, model, fits, alignment, bar, options.loss)

    fitted = of_each(models, 'fitted', notes, fit)
    best = identification.best_of(fitted)
    notes += identification.disagreements(fitted)
    if options.pictures is not None:
        from octo_arm_model.experiment.pictures import pictures_of_fit, save_all

        pictures = pictures_of_fit(fitted, observations.shapes, trajectory)
        with writing(options.pictures, folder=True) as place, Bar('pictures') as bar:
            save_all(pictures, place, bar.on_terminal)
        notes.append(f'{len(pictures)} pictures are in {options.pictures}')
    if options.out is not None and best.is_trustworthy:
        text = identification.as_config(best, str(options.bag or options.tension_csv))
        with writing(options.out) as place:
            place.write_text(text, encoding='utf-8')
        notes.append(f'the fitted arm is in {options.out}')
    elif options.out is not None:
        notes.append(f'{options.out} is not written: the data do not determine the arm')
    if options.csv is not None and best.is_trustworthy:
        shapes = best.with_tensions(observations.shapes)
        with Bar('steps of the fitted arm') as bar:
            fitted_arm = compare(
                shapes, best.parameters, best.model, best.alignment, bar.on_terminal, trajectory
            )
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
