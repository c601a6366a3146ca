"""Command profiles by name, which are files or movements of an arm, and limits of tensions."""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ProfileError, TensionError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.stiffness import SectionStiffness, default_highest
from octo_arm_model.config.config import Config, load_config
from octo_arm_model.config.paper_data import (
    BENDING,
    FETCHING_IN_PLANE,
    FETCHING_IN_SPACE,
    Tensions,
)
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.rod.checks import check_highest, check_tensions
from octo_arm_model.simulation.profiles import CommandProfile, read_profile
from octo_arm_model.wire.tensions import TENSION_TOPICS, read_joint_commands

MOVE_TIME = 3.0  # time from one posture to the next [s]
HOLD_TIME = 1.0  # time in each posture [s]
TURN_TIME = 6.0  # time in which the bending plane turns once [s]
TURNS = 3
SWEEP_TIME = 10.0  # time for each tendon [s]
SWEEP = (0.2, 1.0)  # first and last frequency [Hz]; a tendon has a whole number of periods
SAMPLE = 0.02  # time between rows of movements that are not sequences of postures [s]
# The compression for `default_highest` is clearly visible, and far below the limits.
_COMPRESSION = 0.1


@dataclass(frozen=True)
class Movement:
    """A profile that is computed for an arm."""

    description: str  #: line for lists of movements
    #: function of an arm without an objection and of largest tensions [N], or None for
    #: `default_highest`, that returns the profile
    profile: Callable[[Arm, ArrayLike | None], CommandProfile]
    #: function of an arm that returns why the movement is not for it; empty if it is
    objection: Callable[[Arm], str] = lambda arm: ''


# Movements of the paper --------------------------------------------------------------------------


def _postures(postures: Sequence[Tensions], arm: Arm, highest: ArrayLike | None) -> CommandProfile:
    """Return a profile from rest through ``postures`` and back, each held for `HOLD_TIME`."""
    if highest is not None:
        raise ProfileError('highest does not go with tensions of the paper')
    rest = np.zeros(len(arm.tendons))
    rows = [rest] * 2 + [np.ravel(posture) for posture in postures for _ in range(2)] + [rest] * 2
    times = np.cumsum([0.0] + [HOLD_TIME, MOVE_TIME] * len(postures) + [HOLD_TIME, MOVE_TIME])
    times = np.append(times, times[-1] + HOLD_TIME)
    return CommandProfile(times, np.array(rows))


def _paper_objection(postures: Sequence[Tensions], preset: str, arm: Arm) -> str:
    shape = np.shape(postures[0])
    if arm.tension_shape != shape:
        return (
            f'these tensions are for {shape[0]} sections of {shape[1]} tendons, such as '
            f'{preset}, those of this arm have shape {arm.tension_shape}'
        )
    # The paper's q = N / (E A); at -1 the arm has zero length.
    ends = np.array([section.anchorage for section in arm.sections])
    axial = SectionStiffness.at(arm, ends).axial
    for posture in postures:
        compression = np.cumsum(np.sum(posture, axis=1)) / axial
        worst = int(np.argmax(compression))
        if compression[worst] >= 1.0:
            return (
                f'these tensions are for {preset}, and would compress this arm to nothing at '
                f's = {ends[worst]} m'
            )
    return ''


def _of_paper(preset: str, description: str, *postures: Tensions) -> Movement:
    return Movement(
        description,
        functools.partial(_postures, postures),
        functools.partial(_paper_objection, postures, preset),
    )


_bending = functools.partial(_of_paper, 'renda2012_table2')
_fetching = functools.partial(_of_paper, 'renda2012_table4')


# Movements of any arm ----------------------------------------------------------------------------


def _highest(arm: Arm, highest: ArrayLike | None) -> FloatArray:
    if highest is None:
        return default_highest(arm, _COMPRESSION).ravel()
    return check_highest(arm, highest)


def _one_by_one(
    times: FloatArray, wave: FloatArray, interpolation: str, arm: Arm, highest: ArrayLike | None
) -> CommandProfile:
    """Pull tendons in turn by ``wave``, fractions of the largest tension at ``times`` [s]."""
    peaks = _highest(arm, highest)
    count, duration = len(peaks), times[-1]
    # The last row of one tendon is the first of the next.
    rows = np.zeros((count * (len(times) - 1) + 1, count))
    for tendon, peak in enumerate(peaks):
        first = tendon * (len(times) - 1)
        rows[first : first + len(times), tendon] = peak * wave
    starts = duration * np.arange(count)
    all_times = np.append((starts[:, np.newaxis] + times[:-1]).ravel(), count * duration)
    return CommandProfile(all_times, rows, interpolation)


def _sweep(arm: Arm, highest: ArrayLike | None) -> CommandProfile:
    times = np.arange(0.0, SWEEP_TIME + 0.5 * SAMPLE, SAMPLE)
    low, high = SWEEP
    periods = low * times + 0.5 * (high - low) / SWEEP_TIME * times**2
    return _one_by_one(times, 0.5 - 0.5 * np.cos(2.0 * np.pi * periods), 'linear', arm, highest)


def _rotating(arm: Arm, highest: ArrayLike | None) -> CommandProfile:
    """Return tensions whose bending plane turns at a constant rate, as in section 6.1."""
    times = np.arange(0.0, TURNS * TURN_TIME + 0.5 * SAMPLE, SAMPLE)
    rise = np.clip(np.minimum(times, times[-1] - times) / (0.5 * TURN_TIME), 0.0, 1.0)
    angle = 2.0 * np.pi / TURN_TIME * times[:, np.newaxis] - 0.5 * np.pi * np.arange(4)
    pull = (rise**2 * (3.0 - 2.0 * rise))[:, np.newaxis] * np.maximum(np.cos(angle), 0.0)
    rows = np.zeros((len(times), len(arm.tendons)))
    rows[:, :4] = _highest(arm, highest)[:4].min() * pull
    return CommandProfile(times, rows, 'linear')


def _rotating_objection(arm: Arm) -> str:
    count = len(arm.sections[0].tendons)
    return '' if count == 4 else f'rotating takes four tendons in section 1, this arm has {count}'


_RAMP = np.array([0.0, MOVE_TIME, MOVE_TIME + HOLD_TIME, 2.0 * MOVE_TIME + HOLD_TIME])
_STEP = np.array([0.0, HOLD_TIME, 2.0 * HOLD_TIME])

MOVEMENTS = {
    'bending': _bending('the three bends of Table 3, Figure 11', *BENDING.values()),
    **{
        f'bending_{panel.lower()}': _bending(f'the bend of Figure 11({panel}), Table 3', tensions)
        for panel, tensions in BENDING.items()
    },
    'fetching_in_plane': _fetching('fetching in one plane, Table 5, Figure 14', FETCHING_IN_PLANE),
    'fetching_in_space': _fetching('fetching in space, Table 5, Figure 15', FETCHING_IN_SPACE),
    'fetching': _fetching(
        'fetching in one plane, then in space, Table 5', FETCHING_IN_PLANE, FETCHING_IN_SPACE
    ),
    'rotating': Movement(
        'section 1 bends, and the plane of the bend goes round', _rotating, _rotating_objection
    ),
    'ramps': Movement(
        'each tendon in turn pulled, held and let go at a steady rate',
        functools.partial(_one_by_one, _RAMP, np.array([0.0, 1.0, 1.0, 0.0]), 'linear'),
    ),
    'steps': Movement(
        'each tendon in turn pulled and let go at once',
        functools.partial(_one_by_one, _STEP, np.array([0.0, 1.0, 0.0]), 'steps'),
    ),
    'sweeps': Movement(
        f'each tendon in turn pulled in a sine of {SWEEP[0]} to {SWEEP[1]} Hz', _sweep
    ),
}


_FIGURES = {
    'renda2012_table2': {f'11 {panel}': tensions for panel, tensions in BENDING.items()},
    'renda2012_table4': {'14': FETCHING_IN_PLANE, '15': FETCHING_IN_SPACE},
}
_ROUNDING = 1e-9  # relative excess over a limit by rounding of an interpolation or a solution


def figures(arm: Arm) -> dict[str, FloatArray]:
    """Return tensions (tendons,) [N] in figures of the paper by number; empty for other arms."""
    for name, tensions_of in _FIGURES.items():
        preset = _preset(name)
        # The arms of the paper have no density, which an arm that moves needs.
        if preset == arm.with_density(preset.material.density):
            return {figure: np.ravel(tensions) for figure, tensions in tensions_of.items()}
    return {}


def highest_tensions(arm: Arm) -> FloatArray:
    """Return the default limit of each tendon (tendons,) [N].

    It is the larger of `default_highest` and the tensions in figures of the paper.
    """
    highest = default_highest(arm).ravel()
    for tensions in figures(arm).values():
        highest = np.maximum(highest, tensions)
    # Limits are rounded up to two digits, in decimals so that powers of ten are exact.
    exponents = np.floor(np.log10(highest) - 1.0).astype(np.int64)
    digits = np.ceil(highest / 10.0**exponents - 1e-9)
    return np.array([float(f'{digit:.0f}e{power}') for digit, power in zip(digits, exponents)])


def tendon_limits(config: Config) -> FloatArray:
    """Return the largest tension that may be commanded of each tendon (tendons,) [N]."""
    if config.tendon_limits:
        return np.array(config.tendon_limits)
    return highest_tensions(config.arm)


def check_command(arm: Arm, tensions: ArrayLike, limits: FloatArray) -> FloatArray:
    """Return commanded ``tensions``, (tendons,) or of `Arm.tension_shape` [N], as (tendons,).

    Raises:
        TensionError: if they do not fit ``arm``, or one exceeds its limit in ``limits``
            (tendons,) [N]; the message names the tendon.
    """
    shaped = np.asarray(tensions)
    if shaped.shape == (len(arm.tendons),):
        shaped = shaped.reshape(arm.tension_shape)
    checked = check_tensions(arm, shaped)
    if checked.ndim != len(arm.tension_shape):
        raise TensionError(f'tensions have shape {checked.shape}, expected {arm.tension_shape}')
    flat = checked.ravel()
    beyond = np.flatnonzero(flat > limits * (1.0 + _ROUNDING))
    if beyond.size:
        tendon = int(beyond[0])
        raise TensionError(
            f'tension of {arm.tendon_names[tendon]} is {float(flat[tendon])!r} N, expected at '
            f'most its limit {float(limits[tendon])!r} N (tendon_limits)'
        )
    return flat


def check_profile(profile: CommandProfile, arm: Arm, limits: FloatArray) -> None:
    """Check that all rows of ``profile`` are within ``limits`` (tendons,) [N].

    Raises:
        ProfileError: if a row is not; the message names the row.
    """
    # This is the first row beyond a limit, or the first one, of which the shape is checked.
    row = int(np.argmax((profile.tensions > limits * (1.0 + _ROUNDING)).any(axis=1)))
    try:
        check_command(arm, profile.tensions[row], limits)
    except TensionError as error:
        raise ProfileError(str(error), row) from None


@functools.cache
def _preset(name: str) -> Arm:
    return load_config(preset_path(name)).arm


# Commanded tensions have the same topics as measured ones, below this name. Those of JOINTS may be
# of some tendons, or lengths.
TOPIC = 'tendon_commands'
COMMAND_TOPICS = {
    topic.replace('tendon_tensions', TOPIC, 1): kind for topic, kind in TENSION_TOPICS.items()
}
JOINTS = f'{TOPIC}/joint_state'


def read_command(
    topic: str, message: Any, arm: Arm, limits: FloatArray
) -> tuple[dict[str, float], dict[str, float]]:
    """Return tensions [N] and lengths to reel in [m] by tendon that a ``message`` commands.

    Raises:
        TensionError: if it is no command of this ``arm`` on the ``topic`` of `COMMAND_TOPICS`, or
            a tension exceeds its limit in ``limits`` (tendons,) [N].
    """
    names, lengths = arm.tendon_names, dict[str, float]()
    if topic == JOINTS:
        tensions, lengths = read_joint_commands(message, arm)
    else:
        values = COMMAND_TOPICS[topic].read(message, arm).ravel().tolist()
        tensions = dict(zip(names, values, strict=True))
    check_command(arm, [tensions.get(name, 0.0) for name in names], limits)
    return tensions, lengths


def profile_names(arm: Arm) -> dict[str, str]:
    """Return names and descriptions of the movements for ``arm``."""
    return {
        name: movement.description
        for name, movement in MOVEMENTS.items()
        if not movement.objection(arm)
    }


def find_profile(name: str, arm: Arm, highest: ArrayLike | None = None) -> CommandProfile:
    """Return a profile for ``arm``: a built-in movement, or a CSV or YAML file.

    Args:
        name: name of a movement, or path of a file (.csv, .yaml, .yml).
        arm: the arm.
        highest: largest tension [N] of all tendons, or of each as `Arm.tension_shape`; by default
            `default_highest`. Tensions of the paper and of files take none.

    Raises:
        ProfileError: if there is no such profile, it is not for this arm, or the file is invalid;
            the message has the name of the file and the line.
    """
    if name in MOVEMENTS:
        if objection := MOVEMENTS[name].objection(arm):
            raise ProfileError(objection)
        return MOVEMENTS[name].profile(arm, highest)
    if Path(name).suffix in ('.csv', '.yaml', '.yml'):
        if highest is not None:
            raise ProfileError(f'highest does not go with a file such as {name}')
        return read_profile(name, arm)
    known = ', '.join(profile_names(arm))
    raise ProfileError(f'no profile {name!r}, expected a .csv or .yaml file or one of {known}')
