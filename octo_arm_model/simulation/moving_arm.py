"""The arm in motion while its tendons are pulled along a profile, without ROS, and pictures of it.

Pictures need matplotlib.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from octo_arm_model.analysis.drawing import obstacle_mesh
from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import MAX_PROFILE_ROWS
from octo_arm_model.arm.obstacles import Obstacle
from octo_arm_model.arm.validation import not_negative, positive
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.motion import Dynamics
from octo_arm_model.rod.motion_state import Inputs
from octo_arm_model.simulation.profiles.profile import CommandProfile

_STROBES = 25  # shapes in a picture
_MOST_FRAMES = 3000
_AXES = 'xyz'


class Course(NamedTuple):
    """When a simulation writes what, and how long it steps.

    Attributes:
        step: of the integration [s].
        rate: of the moments [Hz].
        hold: time after the end of the profile, whose last tensions are held [s].
    """

    step: float = 2e-3
    rate: float = 50.0
    hold: float = 0.0


class Moment(NamedTuple):
    """The arm at one time.

    Attributes:
        time: [s].
        backbone: its shape and tensions.
        tip_velocity: in base_frame [m/s], (3,).
    """

    time: float
    backbone: Backbone
    tip_velocity: FloatArray


def simulate(
    dynamics: Dynamics, profile: CommandProfile, course: Course = Course(),
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Iterator[Moment]:  # fmt: skip
    """Moments of the arm of ``dynamics``, from its equilibrium at the start of ``profile``.

    Raises:
        ConfigError: if there would be too many moments, or a rate beyond that of the steps.
        SolveError: if there is no step that succeeds; the message states the time.
    """
    step = positive('step', course.step, 's')
    every = round(1.0 / (step * positive('rate', course.rate, 'Hz')))
    duration = profile.duration + not_negative('hold', course.hold, 'time', 's')
    if every < 1:
        raise ConfigError(f'rate is {course.rate:g} Hz, expected at most one moment for each step')
    moments = math.floor(duration / (every * step) + 1e-9)
    if moments > MAX_PROFILE_ROWS:
        raise ConfigError(f'{moments} moments, expected at most {MAX_PROFILE_ROWS}')
    shape = dynamics.solver.arm.tension_shape

    def inputs(time: float) -> Inputs:
        return Inputs(profile.at(np.array([min(time, profile.duration)])).reshape(shape))

    state = dynamics.at_rest(inputs(0.0))
    for number in range(moments + 1):
        yield Moment(
            number * every * step, dynamics.backbone(state), dynamics.velocities(state)[-1]
        )
        progress(number, moments)
        if number < moments:
            for part in range(1, every + 1):
                state = dynamics.step(state, inputs((number * every + part) * step), step)


def write_motion_csv(path: Path, moments: Sequence[Moment], names: Sequence[str]) -> None:
    """Write times, tip and tensions of ``moments`` to a CSV file; ``names`` are the tendons'."""
    tip = [f'tip_{axis}' for axis in _AXES] + [f'tip_velocity_{axis}' for axis in _AXES]
    rows = [
        [one.time, *one.backbone.tip, *one.tip_velocity, *one.backbone.tensions.ravel()]
        for one in moments
    ]
    np.savetxt(path, rows, '%.9g', ',', header=','.join(['time', *tip, *names]), comments='')


def draw_motion(
    path: Path, moments: Sequence[Moment], title: str, obstacles: Sequence[Obstacle] = ()
) -> None:
    """Draw the tip over time, and shapes on the way past ``obstacles``, into a PNG file."""
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 5.0), layout='constrained')
    figure.suptitle(title)
    axes = figure.add_subplot(1, 2, 1)
    times = [one.time for one in moments]
    for axis, name in enumerate(_AXES):
        axes.plot(times, [one.backbone.tip[axis] for one in moments], label=f'tip {name}')
    axes.set(xlabel='time [s]', ylabel='position [m]')
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    space = figure.add_subplot(1, 2, 2, projection='3d')
    numbers = np.unique(np.linspace(0, len(moments) - 1, _STROBES).astype(int))
    for number in numbers.tolist():
        colour = colormaps['viridis'](number / max(len(moments) - 1, 1))
        space.plot(*moments[number].backbone.position.T, color=colour)
    _frame(space, moments, obstacles)
    figure.savefig(path, dpi=120, format='png')


def animate(
    path: Path, moments: Sequence[Moment], rate: float, title: str,
    obstacles: Sequence[Obstacle] = (),
) -> None:  # fmt: skip
    """Draw ``moments`` one after the other, ``rate`` of them a second, into a GIF file."""
    from matplotlib.animation import FuncAnimation, PillowWriter
    from matplotlib.figure import Figure

    if len(moments) > _MOST_FRAMES:
        raise ConfigError(f'{len(moments)} frames, expected at most {_MOST_FRAMES}: a lower rate')
    figure = Figure(figsize=(5.0, 5.0), layout='constrained')
    space = figure.add_subplot(projection='3d')
    (line,) = space.plot(*moments[0].backbone.position.T, linewidth=3.0)
    _frame(space, moments, obstacles)

    def show(number: int) -> None:
        line.set_data_3d(*moments[number].backbone.position.T)
        space.set_title(f'{title}, {moments[number].time:.2f} s')

    FuncAnimation(figure, show, len(moments)).save(path, PillowWriter(round(rate)), dpi=80)


def _frame(space: Any, moments: Sequence[Moment], obstacles: Sequence[Obstacle]) -> None:
    """Equal scales in all directions, and what of ``obstacles`` is there."""
    points = np.concatenate([one.backbone.position for one in moments])
    low, high = points.min(axis=0), points.max(axis=0)
    half, middle = 0.5 * float((high - low).max()), 0.5 * (low + high)
    limits = {f'{name}lim': (c - half, c + half) for name, c in zip(_AXES, middle)}
    labels = {f'{name}label': f'{name} [m]' for name in _AXES}
    space.set(**limits, **labels, box_aspect=(1.0, 1.0, 1.0))
    for obstacle in obstacles:
        vertices, triangles = obstacle_mesh(obstacle, middle, half)
        if (np.abs(vertices - middle) < half).all(axis=1).any():
            space.plot_trisurf(*vertices.T, triangles=triangles, color='grey', alpha=0.3)
