"""An arm in motion without ROS: along a profile, with pictures, or driven by recorded readings.

Pictures need matplotlib.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from octo_arm_model.analysis.drawing import equal_axes, in_millimetres, obstacle_mesh, set_limits
from octo_arm_model.arm.errors import ConfigError, SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import MAX_PROFILE_ROWS
from octo_arm_model.arm.obstacles import Obstacle
from octo_arm_model.arm.validation import LARGEST, not_negative, positive, within
from octo_arm_model.config.files import tension_columns
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.motion import STEPS, Dynamics
from octo_arm_model.rod.motion_state import Inputs, MotionState
from octo_arm_model.simulation.profiles import CommandProfile

STEP = 2e-3  # step of the integration [s]
LONGEST_GAP = 10.0  # longest time between readings of one motion [s]
_SAME_NS = 1000  # a reading that is later by less than this comes at the same time [ns]


class DrivenMotion:
    """An arm that moves from reading to reading; in between tensions and lengths are linear.

    It begins in the equilibrium of the first reading.

    Attributes:
        dynamics: dynamics of the arm.
        starts: number of times that the motion began at rest.
    """

    def __init__(self, dynamics: Dynamics, step: float = STEP) -> None:
        """Move the arm of ``dynamics`` in steps of at most ``step`` [s]."""
        self.dynamics, self._step = dynamics, positive('step', step, 's')
        self.starts = 0
        self._state: MotionState | None = None
        self._known: Inputs | None = None
        self._time_ns = 0  # stamp of the state
        self._ended = ''
        self._newest_ns: dict[str, int] = {}

    def read(
        self,
        stamp_ns: int,
        tensions: FloatArray | None = None,
        displacements: dict[str, float] | None = None,
    ) -> None:
        """Move on to the stamp [ns] of new ``tensions`` or ``displacements``.

        The motion begins again at rest if the stamps of either go back, and after `LONGEST_GAP`. A
        stamp before the last one of the other source counts as equal to it.

        Raises:
            SolveError: if there is no equilibrium to begin with, or no step succeeds. A motion
                that failed goes on when it begins again.
            OctoArmError: if the readings do not fit the arm; the last readings stay.
        """
        source = 'tensions' if displacements is None else 'displacements'
        goes_back = stamp_ns < self._newest_ns.get(source, stamp_ns)
        last = self._known or Inputs(np.zeros(self.dynamics.solver.arm.tension_shape))
        now = Inputs(
            last.tensions if tensions is None else tensions,
            last.displacements if displacements is None else displacements,
        )
        self.dynamics.checked(now)
        elapsed_ns = stamp_ns - self._time_ns
        begins = self._known is None or goes_back or elapsed_ns > 1e9 * LONGEST_GAP
        self._newest_ns = {**({} if begins else self._newest_ns), source: stamp_ns}
        if begins:
            self._known = None
            self._state = self.dynamics.at_rest(now)
            self._time_ns, self._ended, self._known = stamp_ns, '', now
            self.starts += 1
            return
        self._known = now
        if elapsed_ns >= _SAME_NS:
            self._time_ns = stamp_ns
            if not self._ended:
                try:
                    elapsed = 1e-9 * elapsed_ns
                    self._state = self.dynamics.go_on(self.state, now, elapsed, self._step)
                except SolveError as error:
                    self._ended = str(error)
        if self._ended:
            raise SolveError(self._ended)

    @property
    def is_wound(self) -> bool:
        """Whether some tendons are driven by length."""
        return self._known is not None and bool(self._known.displacements)

    @property
    def state(self) -> MotionState:
        """The state at the last reading; SolveError if there was no reading."""
        if self._state is None:
            raise SolveError('the arm does not move yet')
        return self._state


_STROBES = 25  # number of shapes in a picture
_MOST_FRAMES = 3000
_AXES = 'xyz'


class Moment(NamedTuple):
    """The moving arm at one time."""

    time: float  #: time [s]
    backbone: Backbone  #: shape and tensions
    tip_velocity: FloatArray  #: velocity of the tip in base_frame [m/s], (3,)


def simulate(
    dynamics: Dynamics,
    profile: CommandProfile,
    step: float = STEP,
    rate: float = 50.0,
    hold: float = 0.0,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Iterator[Moment]:
    """Yield moments of the arm of ``dynamics``, from the equilibrium at the start of ``profile``.

    Moments have a ``rate`` [Hz], and the integration equal steps of at most a ``step`` [s]
    between them. After the profile the last tensions act for a time ``hold`` [s].

    Raises:
        ConfigError: if there would be too many moments.
        SolveError: if no step succeeds; the message states the time.
    """
    period = 1.0 / positive('rate', rate, 'Hz')
    longest = min(within('step', step, STEPS[0], LARGEST, 's'), STEPS[1])
    steps = max(math.ceil(period / longest - 1e-9), 1)
    duration = profile.duration + not_negative('hold', hold, 'time', 's')
    moments = math.floor(duration * rate + 1e-9)
    if moments > MAX_PROFILE_ROWS:
        raise ConfigError(f'{moments} moments, expected at most {MAX_PROFILE_ROWS}')
    shape = dynamics.solver.arm.tension_shape

    def inputs(time: float) -> Inputs:
        return Inputs(profile.at(np.array([min(time, profile.duration)])).reshape(shape))

    state = dynamics.at_rest(inputs(0.0))
    for number in range(moments + 1):
        yield Moment(number * period, dynamics.backbone(state), dynamics.velocities(state)[-1])
        progress(number, moments)
        if number < moments:
            for part in range(1, steps + 1):
                now = inputs((number + part / steps) * period)
                state = dynamics.go_on(state, now, period / steps, period)


def write_motion_csv(path: Path, moments: Sequence[Moment], names: Sequence[str]) -> None:
    """Write times, tips and tensions of ``moments`` to a CSV file; ``names`` name the tendons."""
    time, *tensions = tension_columns(names)
    tip = *(f'tip_{one} [m]' for one in _AXES), *(f'tip_velocity_{one} [m/s]' for one in _AXES)
    rows = [
        [one.time, *one.backbone.tip, *one.tip_velocity, *one.backbone.tensions.ravel()]
        for one in moments
    ]
    np.savetxt(path, rows, '%.9g', ',', header=','.join([time, *tip, *tensions]), comments='')


def draw_motion(
    path: Path, moments: Sequence[Moment], title: str, obstacles: Sequence[Obstacle] = ()
) -> None:
    """Draw the tip over time, and shapes between ``obstacles``, into a PNG file."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 5.0), layout='constrained')
    figure.suptitle(title)
    axes = figure.add_subplot(1, 2, 1)
    times = [one.time for one in moments]
    axes.plot(times, [one.backbone.tip for one in moments], label=[f'tip {one}' for one in _AXES])
    axes.set(xlabel='time [s]')
    in_millimetres(axes.yaxis, 'position')
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    space = figure.add_subplot(1, 2, 2, projection='3d')
    numbers = np.unique(np.linspace(0, len(moments) - 1, _STROBES).astype(int))
    colours = ScalarMappable(Normalize(times[0], times[-1]))
    for number in numbers.tolist():
        space.plot(*moments[number].backbone.position.T, color=colours.to_rgba(times[number]))
    figure.colorbar(colours, ax=space, label='time [s]', shrink=0.7)
    _frame(space, moments, obstacles)
    figure.savefig(path, dpi=120, format='png')


def check_animation(frames: float, rate: float) -> None:
    """Raise ConfigError if `animate` does not draw so many ``frames``, or not at a ``rate``."""
    if frames >= _MOST_FRAMES + 1:
        raise ConfigError(f'{frames:.0f} frames, expected at most {_MOST_FRAMES}: a lower rate')
    if not 0.0016 <= rate <= 100.0:
        raise ConfigError(f'rate is {rate:g}, expected 0.0016 to 100 Hz for a GIF')


def animate(
    path: Path,
    moments: Sequence[Moment],
    rate: float,
    title: str,
    obstacles: Sequence[Obstacle] = (),
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> None:
    """Draw ``moments`` one after the other at a ``rate`` [Hz] into a GIF file.

    After every frame ``progress`` gets the number of frames drawn and of all.
    """
    from matplotlib.animation import PillowWriter
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.0, 5.0), layout='constrained')
    space = figure.add_subplot(projection='3d')
    (line,) = space.plot(*moments[0].backbone.position.T, linewidth=3.0)
    _frame(space, moments, obstacles)
    frequency: Any = 1e3 / (10 * round(100 / rate) + 0.5)  # of whole hundredths of a second
    writer = PillowWriter(frequency)  # it rounds milliseconds down
    writer.setup(figure, path, dpi=80)
    for number, moment in enumerate(moments, 1):
        line.set_data_3d(*moment.backbone.position.T)
        space.set_title(f'{title}, {moment.time:.2f} s')
        writer.grab_frame()
        figure.set_layout_engine('none')  # one layout is for all frames
        progress(number, len(moments))
    writer.finish()


def _frame(space: Any, moments: Sequence[Moment], obstacles: Sequence[Obstacle]) -> None:
    """Set equal scales in all directions, and draw the ``obstacles`` within them."""
    points = np.concatenate([one.backbone.position for one in moments])
    ends = equal_axes(points, 0.5)
    half, middle = 0.5 * float(np.ptp(ends[0])), ends.mean(axis=1)
    set_limits(space, ends)
    space.locator_params(nbins=5)
    space.set_box_aspect((1.0, 1.0, 1.0))
    for obstacle in obstacles:
        vertices, triangles = obstacle_mesh(obstacle, middle, half)
        if (np.abs(vertices - middle) < half).all(axis=1).any():
            space.plot_trisurf(*vertices.T, triangles=triangles, color='grey', alpha=0.3)
