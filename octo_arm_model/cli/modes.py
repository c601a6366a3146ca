"""``octo-arm modes``: natural frequencies, damping and shapes of the arm about an equilibrium."""

import argparse
import json
from pathlib import Path

import numpy as np

from octo_arm_model.analysis.drawing import equal_axes, set_limits
from octo_arm_model.cli import arguments
from octo_arm_model.cli.files import check_out, writing
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.modes import Modes, modes
from octo_arm_model.rod.motion_state import Inputs

SUMMARY = 'natural frequencies of the arm'
DESCRIPTION = """\
Find the natural modes of the arm about its equilibrium under tensions: frequencies of small
oscillations, with the added mass of the water, and their damping by the viscosity of the material.
Tendons with friction stick. The model is exact, whatever CONFIG says.
"""
EPILOG = """\
examples:
  octo-arm modes renda2012_table4 --density 1080 --viscosity 300
  octo-arm modes renda2012_table4 --density 1080 --fluid-density 1000 --water renda2018
  octo-arm modes my_arm.yaml --tensions '[[0,0,0.1,0],[0,0,0,0],[1,0,0,0]]' --plot modes.png

exit status: 0 done, 1 no stable equilibrium, 2 the input is wrong
"""


OPTIONS = f"""\
{arguments.MOVING_ARM}
{arguments.tensions_option('all others, or all, are slack')}
--count N = 6: number of modes, the slowest first
--plot PNG path: picture of the shapes; needs matplotlib
{arguments.JSON}: frequencies, damping ratios and shapes
"""


def run(options: argparse.Namespace) -> None:
    """Find the modes, and print and draw them."""
    config, _ = arguments.read_moving_arm(options)
    check_out(options, '--plot', folder=False, draws=True)
    dynamics, tensions = config.dynamics(), np.zeros(config.arm.tension_shape)
    if options.tensions is not None:
        tensions = arguments.read_tensions(options.tensions, config.arm)
    state = dynamics.at_rest(Inputs(tensions))
    found = modes(dynamics, state, options.count)
    if options.plot:
        with writing(options.plot) as place:
            draw_modes(place, found, dynamics.backbone(state))
    if options.json:
        print(json.dumps({name: value.tolist() for name, value in found._asdict().items()}))
        return
    print(f'{"mode":>4}  {"frequency [Hz]":>14}  {"damping ratio":>13}')
    for number, (frequency, damping) in enumerate(zip(found.frequencies, found.damping), start=1):
        print(f'{number:4}  {frequency:14.4f}  {damping:13.4f}')
    if options.plot:
        print(options.plot)


def draw_modes(path: Path, result: Modes, backbone: Backbone) -> None:
    """Draw the shapes of the modes about the equilibrium ``backbone`` into a PNG file."""
    from matplotlib.figure import Figure

    count = len(result.frequencies)
    figure = Figure(figsize=(3.0 * min(count, 4), 3.2 * -(-count // 4)), layout='constrained')
    size = 0.2 * backbone.s[-1]
    for number, shape in enumerate(result.shapes, start=1):
        axes = figure.add_subplot(-(-count // 4), min(count, 4), number, projection='3d')
        for amplitude, colour in ((-size, '0.6'), (0.0, 'C0'), (size, '0.6')):
            axes.plot(*(backbone.position + amplitude * shape).T, color=colour)
        axes.set_title(f'mode {number}, {result.frequencies[number - 1]:.4g} Hz')
        set_limits(axes, equal_axes(backbone.position, 0.6))
        axes.locator_params(nbins=4)
        axes.set_box_aspect(None, zoom=0.8)  # leaves room for the labels
    figure.suptitle('Equilibrium (blue) and both ends of the oscillation (grey)')
    figure.savefig(path, dpi=120, format='png', bbox_inches='tight')
