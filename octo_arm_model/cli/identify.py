"""``octo-arm identify``: parameters of the arm from measured midlines."""

from __future__ import annotations

import argparse
import json

from octo_arm_model.cli.options.experiment import ALL, RECORDINGS, add_recording
from octo_arm_model.cli.options.shared import add_json, add_path
from octo_arm_model.cli.output.files import check_out, refuse_inside, writing
from octo_arm_model.cli.output.fit import as_dict, summary
from octo_arm_model.cli.output.progress import Bar
from octo_arm_model.cli.read_experiment import of_each, read_options
from octo_arm_model.config.config import Config
from octo_arm_model.experiment.compare import compare
from octo_arm_model.experiment.csv_output import write_tables
from octo_arm_model.experiment.fitting.fitted_file import as_config
from octo_arm_model.experiment.fitting.held_back import AUTO
from octo_arm_model.experiment.fitting.identification import Identification
from octo_arm_model.experiment.fitting.identify import identify
from octo_arm_model.experiment.fitting.least_squares.fit import LOSSES
from octo_arm_model.experiment.fitting.model_choice import best_of, disagreements
from octo_arm_model.experiment.fitting.unknowns.unknown import FITS

SUMMARY = 'fit the arm to midlines in a bag'
DESCRIPTION = f"""\
Fit the arm to midlines or tips measured in a recorded experiment, by robust least squares, with
confidence intervals and correlations. What can be fitted, by default youngs_modulus:

  {'  '.join(FITS)}

poisson_ratio, sheath_stiffness and tendon_offsets need the model exact, friction another than
renda2012 and steps that were loaded and unloaded, axial_stiffness (of the tendons themselves)
encoder readings of tendons under tension, with an unknown zero for each. The alignment is fitted
as well where --align is 'fit', or not given while the midlines are not in base_frame. What the
data cannot tell is left as it is, one parameter at a time, and said.
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
    add_path(parser, '--out', 'CONFIG', 'ROS parameter file of the fitted arm to write')
    add_path(parser, '--pictures', 'DIR', 'folder for pictures: intervals, residuals along s')
    text = 'folder for midlines.csv, stations.csv and tensions.csv of the fitted arm'
    add_path(parser, '--csv', 'DIR', text)
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Fit the models, and print and write the best; 1 where the data determine nothing."""
    refuse_inside(options.bag, options.out, options.pictures, options.csv)
    # Folders first: what is to be both is refused then.
    check_out(options, '--pictures', folder=True, draws=True)
    check_out(options, '--csv', folder=True)
    check_out(options, '--out', folder=False)
    recording, observations, models, alignment, notes = read_options(options, [ALL])
    fits = list(dict.fromkeys(options.fit))
    if alignment is None and 'alignment' not in fits:
        fits.append('alignment')

    def fit(model: str) -> Identification:
        with Bar(f'fits of {model}') as bar:
            shapes, values = observations.shapes, recording.parameters
            return identify(shapes, values, model, fits, alignment, bar, options.loss)

    fitted = of_each(models, 'fitted', notes, fit)
    best = best_of(fitted)
    notes += disagreements(fitted)
    if options.pictures is not None:
        from octo_arm_model.experiment.figure_files import save_all
        from octo_arm_model.experiment.identify_figures import pictures_of

        pictures = pictures_of(fitted, observations.shapes)
        with writing(options.pictures, folder=True) as place, Bar('pictures') as bar:
            save_all(pictures, place, bar.on_terminal)
        notes.append(f'{len(pictures)} pictures are in {options.pictures}')
    if options.out is not None and best.is_trustworthy:
        text = as_config(best, str(options.bag or options.tension_csv))
        with writing(options.out) as place:
            place.write_text(text, encoding='utf-8')
        notes.append(f'the fitted arm is in {options.out}')
    elif options.out is not None:
        notes.append(f'{options.out} is not written: the data do not determine the arm')
    if options.csv is not None and best.is_trustworthy:
        shapes = best.with_tensions(observations.shapes)
        with Bar('steps of the fitted arm') as bar:
            fitted_arm = compare(
                shapes, best.parameters, best.model, best.alignment, bar.on_terminal
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
