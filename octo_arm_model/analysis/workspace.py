"""The workspace of the tip: tensions sampled from a box, solved on all cores or on a cluster.

The tensions are a scrambled Sobol sequence, which fills the box more evenly than random numbers.
Chunks have a fixed size, so that results do not depend on the number of processes.
"""

import contextlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model.analysis.drawing import Drawing, equal_axes, in_millimetres, set_limits
from octo_arm_model.analysis.worker_pool import Solutions, on_cluster, on_cores
from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ConfigError, TensionError, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import MAX_PROCESSES, MAX_SAMPLED_TENSIONS, MAX_SAMPLES
from octo_arm_model.arm.validation import check_class, is_number
from octo_arm_model.config.config import Config
from octo_arm_model.rod.checks import check_tensions
from octo_arm_model.rod.solver import Solver

# Number of sets in a chunk. Large chunks need few calls; small ones lose less if a set is refused
# and its chunk is solved in parts. Results depend on it by rounding.
CHUNK = 64


@dataclass(frozen=True)
class Workspace:
    """The tips of an arm for the ``n`` sets of tensions that have a solution."""

    #: sets of tensions [N], (n, *Arm.tension_shape), in the order of the sequence
    tensions: FloatArray
    tip: FloatArray  #: positions of the tip in base_frame [m], (n, 3)
    direction: FloatArray  #: unit tangent of the midline at the tip in base_frame [-], (n, 3)
    refused: int  #: number of sets without a solution, which are not among the n
    highest: FloatArray  #: upper bounds of the sampled tensions [N], of `Arm.tension_shape`


def sample_workspace(
    config: Config,
    highest: ArrayLike,
    samples: int = 4096,
    seed: int = 0,
    *,
    processes: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Workspace:
    """Return the workspace by ``samples`` sets of tensions between 0 and ``highest`` [N].

    ``highest`` is one number for all tendons or one for each, of `Arm.tension_shape`. A power of
    two is best for ``samples``, as the sequence is then balanced; fewer samples of a ``seed`` are
    the first ones of more. The workspace is somewhat larger than the cloud of tips, as sets with
    all of many tensions near their bounds are rare.

    ``processes`` is the number of worker processes, 1 for none; by default there is one for each
    core if that takes less time. Workers import the main module again, so a script that starts
    them needs ``if __name__ == '__main__':``. ``scheduler`` is the address of a Dask scheduler,
    such as ``tcp://10.0.0.1:8786``, whose workers solve instead and need this package; results
    are equal on machines of one kind. ``progress`` is called with the numbers of solved and of all
    sets, at first with 0.

    Raises:
        TensionError: if ``highest`` does not fit the arm, or is negative or not finite.
        ConfigError: if ``samples``, ``seed`` or ``processes`` is out of range, the model does not
            cover the arm, a worker ends before its work does, or Dask is missing, does not answer
            or fails.
    """
    check_class('config', config, Config)
    most = min(MAX_SAMPLES, MAX_SAMPLED_TENSIONS // len(config.arm.tendons))
    count = _whole('samples', samples, 1, most)
    number = _whole('seed', seed, 0)
    if processes is not None:
        processes = _whole('processes', processes, 1, MAX_PROCESSES)
        if scheduler is not None:
            raise ConfigError(
                f'processes is {processes} and scheduler is {scheduler!r}, expected one of them'
            )
    solver = config.solver()
    box = _box(config.arm, highest)
    tensions = box * _sobol(box.size, count, number).reshape(-1, *box.shape)
    chunks = [tensions[first : first + CHUNK] for first in range(0, count, CHUNK)]
    if scheduler is None:
        results = on_cores(solver, config, chunks, processes)
    else:
        results = on_cluster(config, chunks, scheduler)
    report = progress or (lambda done, total: None)
    solved: dict[int, Solutions] = {}
    done = 0
    report(done, count)
    # Closing the generator ends the processes that it started.
    with contextlib.closing(results):
        for chunk, part in results:
            solved[chunk] = part
            done += len(part.is_solved)
            report(done, count)
    is_solved, tip, direction = map(np.concatenate, zip(*(solved[i] for i in range(len(chunks)))))
    arrays = tensions[is_solved], tip, direction, box
    for array in arrays:
        array.setflags(write=False)
    return Workspace(*arrays[:3], count - len(tip), box)


def _whole(name: str, value: object, low: int, high: float = math.inf) -> int:
    number = int(value) if isinstance(value, (int, np.integer)) else low - 1
    if isinstance(value, bool) or not low <= number <= high:
        limits = f'a whole number >= {low}' + (f' and <= {high}' if high < math.inf else '')
        raise ConfigError(f'{name} is {shown(value)}, expected {limits}')
    return number


def _box(arm: Arm, highest: ArrayLike) -> FloatArray:
    shape = arm.tension_shape
    if is_number(highest):
        highest = np.full(shape, highest)
    try:
        box = check_tensions(arm, highest)
    except TensionError as error:
        raise TensionError(f'highest: {error}') from error
    if box.shape != shape:
        raise TensionError(f'highest has shape {box.shape}, expected one number or {shape}')
    return box.copy()


def _sobol(dimensions: int, count: int, seed: int) -> FloatArray:
    # This import takes longer than all others together.
    from scipy.stats import qmc

    # SciPy warns unless the number of points is a power of two.
    sequence = qmc.Sobol(dimensions, seed=np.random.default_rng(seed))
    return np.asarray(sequence.random_base2((count - 1).bit_length())[:count])


# The orthographic views: panel, axis to the right, axis up. Neighbours share an axis.
_VIEWS = ((1, 0, 2), (2, 1, 2), (3, 0, 1))
_ARM_COLOUR = '0.65'
_SIDES = 24  # number of corners of the polygons for cross sections


def draw_workspace(workspace: Workspace, solver: Solver, path: Path | str) -> None:
    """Draw ``workspace`` of the arm of ``solver`` into the PNG file ``path``.

    The colour of a tip is the sum of its tensions. The arm without tensions is drawn to scale.

    Raises:
        SolveError: if there is no solution without tensions under the loads of ``solver``.
        OSError: if the file cannot be written.
    """
    # Matplotlib is optional.
    from matplotlib.figure import Figure

    arm = solver.solve(np.zeros(solver.arm.tension_shape))
    body = Drawing(solver.arm, arm.s, sides=_SIDES)
    skin = body.draw(arm.position, arm.quaternion, arm.q).vertices[body.triangles]
    limits = equal_axes(np.concatenate([workspace.tip, skin.reshape(-1, 3)]))
    figure = Figure(figsize=(11.0, 10.0), layout='constrained')
    reached, refused = len(workspace.tip), workspace.refused
    figure.suptitle(
        f'Tips for {reached} of {reached + refused} sets of tensions, {refused} refused '
        f'(model {arm.model})'
    )
    views = []
    for place, across, up in _VIEWS:
        axes = figure.add_subplot(2, 2, place)
        _draw_view(axes, workspace, skin, [across, up], limits)
        views.append(axes)
    in_space = figure.add_subplot(2, 2, 4, projection='3d')
    cloud = _draw_in_space(in_space, workspace, skin, limits)
    bar = figure.colorbar(cloud, ax=[*views, in_space], shrink=0.6, aspect=40, pad=0.02)
    bar.set_label('sum of tensions [N]')
    # The file is a PNG for any suffix.
    figure.savefig(path, dpi=120, format='png')


def _style(workspace: Workspace) -> dict[str, Any]:
    """Return the colours of the dots, and their size, which is smaller for more dots."""
    total = workspace.tensions.sum(axis=tuple(range(1, workspace.tensions.ndim)))
    # The limits of a colour bar must differ, even for one tip or none.
    low, high = (total.min(), total.max()) if total.size else (0.0, workspace.highest.sum())
    return {
        'c': total,
        's': float(np.clip(2e4 / max(len(total), 1), 1.0, 16.0)),
        'cmap': 'viridis',
        'linewidths': 0.0,
        'vmin': low,
        'vmax': high if high > low else low + 1.0,
    }


def _draw_view(
    axes: Any, workspace: Workspace, skin: FloatArray, pair: list[int], limits: FloatArray
) -> None:
    """Draw tips and ``skin`` [m], (triangles, 3, 3), in the plane of a ``pair`` of axes."""
    from matplotlib.collections import PolyCollection

    faces = list(skin[:, :, pair])
    axes.add_collection(PolyCollection(faces, color=_ARM_COLOUR, linewidth=0.4, zorder=1))
    axes.scatter(*workspace.tip[:, pair].T, zorder=2, **_style(workspace))
    axes.set(xlim=limits[pair[0]], ylim=limits[pair[1]], aspect='equal')
    for axis, number in zip((axes.xaxis, axes.yaxis), pair):
        in_millimetres(axis, 'xyz'[number])
    axes.grid(alpha=0.3)
    axes.set_axisbelow(True)


def _draw_in_space(axes: Any, workspace: Workspace, skin: FloatArray, limits: FloatArray) -> Any:
    """Draw tips and ``skin`` in space, and return the drawn tips."""
    triangles = np.arange(3 * len(skin)).reshape(-1, 3)
    axes.plot_trisurf(*skin.reshape(-1, 3).T, triangles=triangles, color=_ARM_COLOUR, shade=True)
    cloud = axes.scatter(*workspace.tip.T, depthshade=False, **_style(workspace))
    set_limits(axes, limits)
    axes.set_box_aspect((1, 1, 1), zoom=1.0)
    axes.view_init(24.0, -60.0)
    axes.locator_params(nbins=5)
    return cloud
