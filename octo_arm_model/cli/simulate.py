"""``octo-arm simulate``: simulate the motion along a profile of tensions, without ROS."""

import argparse
import time

import numpy as np

from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.cli import arguments
from octo_arm_model.cli.files import Bar, check_out, unwritten, writing
from octo_arm_model.simulation.movements import find_profile
from octo_arm_model.simulation.moving_arm import (
    STEP,
    animate,
    check_animation,
    draw_motion,
    simulate,
    write_motion_csv,
)

SUMMARY = 'simulate the motion of the arm along a profile of tensions'
DESCRIPTION = """\
Simulate the motion of the arm under a profile of tensions, with inertia, weight, viscosity of the
material, and drag and added mass of the surrounding water. The arm starts at rest. PROFILE is a
movement of `octo-arm play --list`, or a file in the formats of that command. Tensions change
linearly within a step. The model is exact, whatever CONFIG says. ROS is not needed.
"""
EPILOG = """\
examples:
  octo-arm simulate renda2012_table4 fetching_in_plane --density 1080 --viscosity 300 \\
      --gravity 0 0 -9.81 --fluid-density 1022 --water renda2018 --plot fetching.png
  octo-arm simulate my_arm.yaml steps --out steps --csv steps.csv --hold 5
  octo-arm simulate my_arm.yaml my_profile.csv --animate my_profile.gif --rate 25

A bag has the topics tendon_tensions, backbone/path, backbone/poses, strains and tip_pose. A CSV
file has a row for each moment: time [s], position [m] and velocity [m/s] of the tip and tensions
[N]. The same options give the same numbers.

exit status: 0 done, 1 a step of the motion fails, as of an arm that is crushed, 2 the input is
wrong or a file cannot be written, 130 interrupted
"""


OPTIONS = f"""\
{arguments.MOVING_ARM}
profile PROFILE: movement of octo-arm play --list, or a CSV or YAML file
{arguments.highest_option('what the arm bears', ' of rotating, ramps, steps and sweeps')}
--step S = {STEP}: longest step of the integration [s]
--rate HZ = 50.0: written moments per second
--hold S = 0.0: time after the end of the profile [s]
--out BAG path: new bag to write
--csv CSV path: table to write
--plot PNG path: picture to write; needs matplotlib
--animate GIF path: moving picture to write; needs matplotlib
{arguments.STORAGE}
"""


def run(options: argparse.Namespace) -> None:
    """Simulate the motion, and write the files that options name."""
    config, parameters = arguments.read_moving_arm(options)
    if options.out is None:
        arguments.refuse_without_effect(options, ('--storage',), 'without --out')
    for name in ('--csv', '--plot', '--animate'):
        check_out(options, name, folder=False, draws=name != '--csv')
    files = [path for path in (options.csv, options.plot, options.animate) if path is not None]
    if len(set(files)) < len(files):
        raise ConfigError('--csv, --plot and --animate are expected to be different files')
    profile = find_profile(options.profile, config.arm, arguments.read_highest(options))
    if options.animate is not None:
        check_animation((profile.duration + options.hold) * options.rate + 1.0, options.rate)
    start = time.monotonic()
    with Bar('moments') as bar:
        moments = simulate(
            config.dynamics(), profile, options.step, options.rate, options.hold, bar
        )
        if options.out is None:
            motion = list(moments)
        else:
            from octo_arm_model.bags.outputs import add_motion
            from octo_arm_model.bags.writer import BagWriter

            custom = {'octo_arm_simulate': f'{options.config} {options.profile}'}
            with unwritten(options.out), BagWriter(options.out, options.storage, custom) as writer:
                motion = add_motion(writer, config, parameters, moments)
    elapsed = time.monotonic() - start
    around, what = config.loads.obstacles, options.profile
    for path, write in (
        (options.csv, lambda place: write_motion_csv(place, motion, config.arm.tendon_names)),
        (options.plot, lambda place: draw_motion(place, motion, what, around)),
        (options.animate, lambda place: animate(place, motion, options.rate, what, around, bar)),
    ):
        if path is not None:
            with writing(path) as place, Bar('frames') as bar:
                write(place)
    tip = ', '.join(f'{1e3 * c:.2f}' for c in motion[-1].backbone.tip)
    fastest = max(float(np.linalg.norm(one.tip_velocity)) for one in motion)
    print(f'{motion[-1].time:.4g} s simulated in {elapsed:.4g} s')
    print(f'tip at the end at {tip} mm, at most {fastest:.3g} m/s fast')
    for path in (options.out, *files):
        if path is not None:
            print(path)
