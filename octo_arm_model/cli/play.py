"""``octo-arm play``: play a command profile over ROS, or write it to files."""

import argparse
import math
import sys

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ArmDefinitionError, ConfigError
from octo_arm_model.arm.limits import MAX_PROFILE_ROWS
from octo_arm_model.arm.validation import not_negative, positive
from octo_arm_model.cli import arguments
from octo_arm_model.cli.files import check_out, writing
from octo_arm_model.config.config import Config, load_config
from octo_arm_model.simulation.movements import TOPIC, find_profile, profile_names
from octo_arm_model.simulation.profiles import CommandProfile, draw_profile, write_csv
from octo_arm_model.terminal import StatusLine, missing

SUMMARY = 'pull tendons along a profile of commands'
DESCRIPTION = """\
Publish the tensions of a profile on tendon_commands, for the simulator octo_arm_sim or real
winches. PROFILE is a movement of --list, or a file. A CSV file has a column time [s] and a column
of tensions [N] for each tendon, by name. A YAML file has times:, tensions: (a row for each time,
tendons from the tip) and, if wanted, interpolation: smooth, linear or steps. A profile above a
tendon's limit (tendon_limits of the arm) is refused. At the end, and at Ctrl-C, the tensions are
ramped to zero.
"""
EPILOG = """\
examples:
  octo-arm play --list                                      # movements of this arm
  octo-arm play fetching_in_space --speed 2 --loop          # until Ctrl-C
  octo-arm play bending --config renda2012_table2
  octo-arm play my_movement.csv --topic tendon_tensions     # straight to octo_arm_node
  octo-arm play rotating --plot rotating.png --csv rotating.csv     # without ROS
"""
_RATES = (1.0, 1000.0)  # [Hz]
_OF_PLAYING = '--loop', '--hold', '--topic', '--wait'
_OF_ONE = '--highest', '--speed', '--rate', '--csv', '--plot'


OPTIONS = f"""\
profile PROFILE?: movement of --list, or a CSV or YAML file
--list: list the movements of the arm
--config CONFIG = renda2012_table4: {arguments.ARM_FILE}
{arguments.highest_option('what the arm bears', ' of rotating, ramps, steps and sweeps')}
--speed SPEED = 1.0: factor on the speed of the profile
--loop: repeat the profile until Ctrl-C
--rate HZ = 50.0: commands, or rows of --csv, per second
--topic TOPIC = {TOPIC}: topic to publish
--hold: keep the last tensions at the end
--wait S = 5.0: longest wait for a subscriber [s]
--csv CSV path: write the profile to this table instead
--plot PNG path: draw the profile instead; needs matplotlib
"""


def run(options: argparse.Namespace) -> None:
    """List the movements, or write, draw or play the profile."""
    positive('--speed', options.speed, '-')
    not_negative('--wait', options.wait, 'time', 's')
    lowest, highest = _RATES
    if not lowest <= options.rate <= highest:
        raise ArmDefinitionError('--rate', options.rate, f'{lowest} to {highest} [Hz]')
    config = load_config(options.config)
    arm = config.arm
    if options.list == (options.profile is not None):
        raise ConfigError('expected either PROFILE or --list')
    if options.list:
        arguments.refuse_without_effect(options, (*_OF_PLAYING, *_OF_ONE), 'with --list')
        names = profile_names(arm)
        width = max(len(name) for name in names)
        for name, description in names.items():
            print(f'{name:{width}} {find_profile(name, arm).duration:6.1f} s  {description}')
        return
    profile = find_profile(options.profile, arm, arguments.read_highest(options))
    if options.csv or options.plot:
        arguments.refuse_without_effect(options, _OF_PLAYING, 'with --csv or --plot')
        if options.csv == options.plot:
            raise ConfigError(f'--csv and --plot are {str(options.csv)!r}, expected two files')
        check_out(options, '--csv', folder=False)
        check_out(options, '--plot', folder=False, draws=True)
        _write(options, profile, arm)
    else:
        _play(options, profile, config)


def _write(options: argparse.Namespace, profile: CommandProfile, arm: Arm) -> None:
    duration = profile.duration / options.speed
    if duration * options.rate > MAX_PROFILE_ROWS - 1:
        raise ConfigError(
            f'{options.profile} is {duration * options.rate:.6g} rows at this --speed and --rate, '
            f'expected at most {MAX_PROFILE_ROWS}'
        )
    times = np.linspace(0.0, duration, max(2, 1 + round(duration * options.rate)))
    tensions = profile.at(options.speed * times)
    if options.csv:
        with writing(options.csv) as place, place.open('w', encoding='utf-8', newline='') as file:
            write_csv(file, times, tensions, arm)
        print(options.csv)
    if options.plot:
        with writing(options.plot) as place:
            draw_profile(times, tensions, arm, options.profile, place)
        print(options.plot)


def _play(options: argparse.Namespace, profile: CommandProfile, config: Config) -> None:
    try:
        from octo_arm_model.ros.client.commands import play
    except ModuleNotFoundError as error:
        without = '--list, --csv and --plot do without'
        raise ConfigError(f'playing {missing(error)}; {without}') from error

    def describe(activity: str, played: float, duration: float) -> str:
        rounds = max(0, math.ceil(played / duration) - 1)
        again = f', time {rounds + 1}' if rounds else ''
        elapsed = played - rounds * duration
        return f'{options.profile}: {activity}, {elapsed:.1f} of {duration:.1f} s{again}'

    with StatusLine(sys.stderr) as line:
        play(
            profile,
            config,
            topic=options.topic,
            speed=options.speed,
            loop=options.loop,
            rate=options.rate,
            release=not options.hold,
            timeout=options.wait,
            report=lambda *played: line.show(lambda: describe(*played)),
        )
