"""``octo-arm play``: command profiles, played over ROS or written to files."""

from __future__ import annotations

import argparse
import math
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from octo_arm_model.cli.options import read_json
from octo_arm_model.config.config import Config
from octo_arm_model.config.presets import find_config
from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.arm.validation import not_negative, positive
from octo_arm_model.core.errors import ArmDefinitionError, ConfigError
from octo_arm_model.core.limits import MAX_PROFILE_ROWS
from octo_arm_model.simulation.commands import TOPIC, Profile, find_profile, profile_names
from octo_arm_model.simulation.profile_files import write_csv

_DESCRIPTION = """\
Pull the tendons of an arm along a profile: publish its tensions on tendon_commands, where the
simulator octo_arm_sim or real winches listen. PROFILE is a movement of --list, or a file. A CSV
file has the columns time [s] and one of tensions [N] for each tendon, by name; a YAML file has
times:, tensions: (a row for each time, tendons from the tip) and, if wanted, interpolation:
smooth, linear or steps. What goes beyond a tendon's limit (tendon_limits of the arm) is not
played. At the end, and at Ctrl-C, the tendons are let go smoothly.
"""
_EPILOG = """\
examples:
  octo-arm play --list                                      # what this arm can do
  octo-arm play fetching_in_space --speed 2 --loop          # until Ctrl-C
  octo-arm play bending --config renda2012_table2
  octo-arm play my_movement.csv --topic tendon_tensions     # straight to octo_arm_node
  octo-arm play rotating --plot rotating.png --csv rotating.csv     # without ROS
"""
_RATES = (1.0, 1000.0)  # [Hz]
_REFRESH = 0.1  # [s]
_NO_ROS = (
    'playing needs ROS 2 and the package octo_arm_msgs ({} is missing): source them, or put '
    'tools/with_ros in front; --list, --csv and --plot do without'
)


def add_command(commands: Any) -> None:
    """Add the command to the subparsers ``commands``."""
    parser = commands.add_parser(
        'play',
        help='pull tendons along a profile of commands',
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        'profile', metavar='PROFILE', nargs='?', help='movement of --list, or a CSV or YAML file'
    )
    parser.add_argument('--list', action='store_true', help='list the movements of the arm')
    parser.add_argument(
        '--config',
        default='renda2012_table4',
        metavar='CONFIG',
        help='ROS parameter file of the arm, or the name of a preset (default: %(default)s)',
    )
    parser.add_argument(
        '--highest',
        metavar='N',
        help='largest tension [N] of rotating, ramps, steps and sweeps: one number, or rows as '
        '--tensions of solve; by default what the arm bears',
    )
    parser.add_argument(
        '--speed', type=float, default=1.0, help='times as fast as written (default: %(default)s)'
    )
    parser.add_argument('--loop', action='store_true', help='begin anew at the end, until Ctrl-C')
    parser.add_argument(
        '--rate', type=float, default=50.0, metavar='HZ',
        help='commands, or rows of --csv, a second (default: %(default)s)',
    )  # fmt: skip
    parser.add_argument('--topic', default=TOPIC, help='where to publish (default: %(default)s)')
    parser.add_argument(
        '--hold', action='store_true', help='leave the tendons as they are in the end'
    )
    parser.add_argument(
        '--wait',
        type=float,
        default=5.0,
        metavar='S',
        help='how long to wait for somebody to subscribe [s] (default: %(default)s)',
    )
    parser.add_argument('--csv', type=Path, metavar='CSV', help='write it there instead')
    parser.add_argument(
        '--plot', type=Path, metavar='PNG', help='draw it there instead; needs matplotlib'
    )
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> None:
    positive('--speed', options.speed, '-')
    not_negative('--wait', options.wait, 'time', 's')
    lowest, highest = _RATES
    if not lowest <= options.rate <= highest:
        raise ArmDefinitionError('--rate', options.rate, f'{lowest} to {highest} [Hz]')
    config = find_config(options.config)
    arm = config.arm
    if options.list == (options.profile is not None):
        raise ConfigError('expected either PROFILE or --list')
    if options.list:
        print(_listing(arm))
        return
    strongest = None
    if options.highest is not None:
        strongest = read_json(options.highest, '--highest', "'[[0.5,0.5,0.5,0.5]]'")
    profile = find_profile(options.profile, arm, strongest)
    if options.csv or options.plot:
        _write(options, profile, arm)
    else:
        _play(options, profile, config)


def _listing(arm: Arm) -> str:
    """Movements of ``arm``: name, duration, description."""
    names = profile_names(arm)
    width = max(len(name) for name in names)
    return '\n'.join(
        f'{name:{width}} {find_profile(name, arm).duration:6.1f} s  {description}'
        for name, description in names.items()
    )


def _write(options: argparse.Namespace, profile: Profile, arm: Arm) -> None:
    duration = profile.duration / options.speed
    if duration * options.rate > MAX_PROFILE_ROWS - 1:
        raise ConfigError(
            f'{options.profile} is {duration * options.rate:.6g} rows at this --speed and --rate, '
            f'expected at most {MAX_PROFILE_ROWS}'
        )
    times = np.linspace(0.0, duration, max(2, 1 + round(duration * options.rate)))
    tensions = profile.at(options.speed * times)
    if options.csv:
        with options.csv.open('w', encoding='utf-8', newline='') as file:
            write_csv(file, times, tensions, arm)
        print(options.csv)
    if options.plot:
        from octo_arm_model.simulation.profile_figure import draw_profile

        draw_profile(times, tensions, arm, options.profile, options.plot)
        print(options.plot)


def _play(options: argparse.Namespace, profile: Profile, config: Config) -> None:
    try:
        from octo_arm_model.ros.profile_player import play
    except ModuleNotFoundError as error:
        raise ConfigError(_NO_ROS.format(error.name)) from error

    line = _Line(options.profile)
    try:
        play(
            profile,
            config,
            topic=options.topic,
            speed=options.speed,
            loop=options.loop,
            rate=options.rate,
            release=not options.hold,
            timeout=options.wait,
            report=line,
        )
    finally:
        line.leave()


class _Line:
    """What is being done, on a terminal; elsewhere nothing."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._shown = -math.inf
        self._is_open = False

    def __call__(self, what: str, played: float, duration: float) -> None:
        """Show that ``what`` has gone on for ``played`` of ``duration`` [s], or begun anew."""
        now = time.monotonic()
        if not sys.stderr.isatty() or now - self._shown < _REFRESH:
            return
        self._shown, self._is_open = now, True
        rounds = max(0, math.ceil(played / duration) - 1)
        within = played - rounds * duration
        again = f', time {rounds + 1}' if rounds else ''
        sys.stderr.write(f'\r{self._name}: {what}, {within:.1f} of {duration:.1f} s{again}\x1b[K')
        sys.stderr.flush()

    def leave(self) -> None:
        """Go on below the line."""
        if self._is_open:
            sys.stderr.write('\n')
            self._is_open = False
