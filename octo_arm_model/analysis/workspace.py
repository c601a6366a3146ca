"""Workspace of the tip: tensions sampled from a box, solved on all cores or on a cluster.

Tensions are a scrambled Sobol sequence, which fills the box more evenly than random numbers, and
are solved in chunks of a fixed size, so that results do not depend on the number of processes.
"""

from __future__ import annotations

import contextlib
import operator
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model.analysis.worker_pool import Solved, on_cluster, on_cores
from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ConfigError, TensionError, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import MAX_PROCESSES, MAX_SAMPLED_TENSIONS, MAX_SAMPLES
from octo_arm_model.config.config import Config
from octo_arm_model.rod.inputs import check_tensions

# Sets in a chunk: enough that calls take little of the time, and few, since a chunk with a refused
# set is solved in parts. Results depend on it by rounding.
CHUNK = 64


@dataclass(frozen=True)
class Workspace:
    """Tips of an arm for ``n`` sets of tensions that have a solution.

    Attributes:
        tensions: sets of tensions [N], (n, *Arm.tension_shape), in the order of the sequence.
        tip: position of the tip of each in base_frame [m], (n, 3).
        direction: unit tangent of the midline at the tip in base_frame [-], (n, 3).
        refused: number of sets without solution; they are not among the n.
        highest: the tensions were drawn from 0 to these [N], `Arm.tension_shape`.
    """

    tensions: FloatArray
    tip: FloatArray
    direction: FloatArray
    refused: int
    highest: FloatArray


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
    """Solve ``samples`` sets of tensions between 0 and ``highest`` [N].

    ``highest`` is one number for all tendons or one for each, of `Arm.tension_shape`. ``samples``
    best is a power of two, where the sequence is balanced; fewer samples of a ``seed`` are the
    first of more. The workspace is somewhat larger than the cloud, as sets with all of many
    tensions near their bounds are rare.

    ``processes`` is the number of worker processes, 1 for none; by default there is one for each
    core, if that takes less time. They import the main module again: a script that starts them
    needs ``if __name__ == '__main__':``. ``scheduler`` is the address of a Dask scheduler, such as
    ``tcp://10.0.0.1:8786``, whose workers have this package and are used instead; results are
    the same on machines of one kind. ``progress`` is called with the numbers of sets done and of
    all sets, first with 0.

    Raises:
        TensionError: if ``highest`` does not fit the arm, or is negative or not finite.
        ConfigError: if ``samples``, ``seed`` or ``processes`` are no such numbers, the model does
            not cover the arm, processes end before their work does, or Dask is missing, does not
            answer or fails.
    """
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
    solved: dict[int, Solved] = {}
    done = 0
    report(done, count)
    # Closing the generator ends the processes it started.
    with contextlib.closing(results):
        for chunk, part in results:
            solved[chunk] = part
            done += len(part.kept)
            report(done, count)
    kept, tip, direction = map(np.concatenate, zip(*(solved[i] for i in range(len(chunks)))))
    arrays = tensions[kept], tip, direction, box
    for array in arrays:
        array.setflags(write=False)
    return Workspace(*arrays[:3], count - len(tip), box)


def _whole(name: str, value: object, low: int, high: int | None = None) -> int:
    limits = f'a whole number >= {low}' + (f' and <= {high}' if high is not None else '')
    try:
        number = operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        number = low - 1
    if isinstance(value, bool) or number < low or (high is not None and number > high):
        raise ConfigError(f'{name} is {shown(value)}, expected {limits}')
    return number


def _box(arm: Arm, highest: ArrayLike) -> FloatArray:
    shape = arm.tension_shape
    if isinstance(highest, (int, float, np.number)) and not isinstance(highest, bool):
        highest = np.full(shape, highest)
    try:
        box = check_tensions(arm, highest)
    except TensionError as error:
        raise TensionError(f'highest: {error}') from error
    if box.shape != shape:
        raise TensionError(f'highest has shape {box.shape}, expected one number or {shape}')
    return box.copy()


def _sobol(dimensions: int, count: int, seed: int) -> FloatArray:
    # Imported here: it takes longer than all other imports together.
    from scipy.stats import qmc

    # SciPy warns unless the number of points is a power of two.
    sequence = qmc.Sobol(dimensions, seed=np.random.default_rng(seed))
    return np.asarray(sequence.random_base2((count - 1).bit_length())[:count])
