"""Where the tip can go: tensions drawn from a box, solved on all cores or on a cluster.

Tensions are a scrambled Sobol sequence, which fills the box more evenly than random numbers do,
and are solved in chunks of a fixed size. A set's last bits depend on the sets it is solved beside
but never on who solves them, so results do not depend on the number of processes.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import multiprocessing
import operator
import os
import pickle
import signal
import threading
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model.arm import Arm
from octo_arm_model.config import Config
from octo_arm_model.errors import ConfigError, SolveError, TensionError
from octo_arm_model.hints import FloatArray
from octo_arm_model.rotation import Quaternions
from octo_arm_model.solver import Solver
from octo_arm_model.tendons import check_tensions

# Large enough to hide the cost of a call, small enough for one refused set, after which a chunk
# is solved set by set, to cost little. Other chunks would change the last bits of results.
CHUNK = 64
_MOST_SAMPLES = 2**30  # points of the Sobol sequence
_POOL_START = 1.5  # what it takes to start a pool, about [s]
_CONNECT = 5.0  # how long a scheduler may take to answer [s]


@dataclass(frozen=True)
class Workspace:
    """Tips that an arm reaches; ``n`` sets of tensions have an answer.

    Attributes:
        tensions: sets of tensions [N], (n, *Arm.tension_shape), in the order of the sequence.
        tip: position of the tip of each in base_frame [m], (n, 3).
        direction: unit tangent of the midline at the tip in base_frame [-], (n, 3).
        refused: number of sets that the model has no answer for; they are not among the n.
        highest: the tensions were drawn from 0 to these [N], `Arm.tension_shape`.
    """

    tensions: FloatArray
    tip: FloatArray
    direction: FloatArray
    refused: int
    highest: FloatArray


class _Solved(NamedTuple):
    """Of a chunk: which sets have an answer (sets,), their tips and directions (answers, 3)."""

    kept: np.ndarray
    tip: FloatArray
    direction: FloatArray


_Job = tuple[Config, str | None, int | None]  # the arguments of `Config.solver` and itself
# By number of the chunk, in any order; closed, it ends what it started.
_Results = Generator[tuple[int, _Solved], None, None]


def sample_workspace(
    config: Config,
    highest: ArrayLike,
    samples: int = 4096,
    seed: int = 0,
    *,
    model: str | None = None,
    stations: int | None = None,
    processes: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Workspace:
    """Solve ``samples`` sets of tensions between 0 and ``highest`` [N].

    ``highest`` is one number for all tendons or one for each, of `Arm.tension_shape`. ``samples``
    best is a power of two, where the sequence is balanced; fewer samples of a ``seed`` are the
    first of more. ``model`` and ``stations`` are used instead of those of the ``config``.

    ``processes`` is the number of worker processes, 1 for none; by default there is one for each
    core, if that is quicker. They import the main module anew: a script that starts them needs
    ``if __name__ == '__main__':``. ``scheduler`` is the address of a Dask scheduler, such as
    ``tcp://10.0.0.1:8786``, whose workers have this package and are used instead; results are
    the same on machines of one kind. ``progress`` is called with the numbers of sets done and of
    all sets, first with 0.

    Raises:
        TensionError: if ``highest`` does not fit the arm, or is negative or not finite.
        ConfigError: if ``samples``, ``seed`` or ``processes`` are no such numbers, the model does
            not cover the arm, processes end before their work does, or Dask is missing, does not
            answer or fails.
    """
    count = _whole('samples', samples, 1, _MOST_SAMPLES)
    number = _whole('seed', seed, 0)
    if processes is not None:
        processes = _whole('processes', processes, 1)
        if scheduler is not None:
            raise ConfigError(
                f'processes is {processes} and scheduler is {scheduler!r}, expected one of them'
            )
    solver = config.solver(model, stations)
    box = _box(config.arm, highest)
    tensions = box * _sobol(box.size, count, number).reshape(-1, *box.shape)
    chunks = [tensions[first : first + CHUNK] for first in range(0, count, CHUNK)]
    job = config, model, stations
    if scheduler is None:
        results = _on_cores(solver, job, chunks, processes)
    else:
        results = _on_cluster(job, chunks, scheduler)
    report = progress or (lambda done, total: None)
    solved: dict[int, _Solved] = {}
    done = 0
    report(done, count)
    # Closed at once, whatever happens: with it end the processes.
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
        raise ConfigError(f'{name} is {value!r}, expected {limits}')
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
    # Takes longer to import than everything else.
    from scipy.stats import qmc

    # All of a power of two are drawn, or SciPy warns of balance: its points are the first alike.
    sequence = qmc.Sobol(dimensions, seed=np.random.default_rng(seed))
    return np.asarray(sequence.random_base2((count - 1).bit_length())[:count])


def _solve(solver: Solver, tensions: FloatArray) -> _Solved:
    """Answers to a chunk, without those sets that have none."""
    try:
        backbone = solver.solve(tensions)
    except SolveError:
        if len(tensions) == 1:
            return _Solved(np.zeros(1, bool), np.empty((0, 3)), np.empty((0, 3)))
        parts = [_solve(solver, tensions[i : i + 1]) for i in range(len(tensions))]
        return _Solved(*map(np.concatenate, zip(*parts)))
    tangent = Quaternions.from_xyzw(backbone.quaternion[:, -1]).matrix()[:, 0].T
    # Views would keep whole backbones.
    return _Solved(np.ones(len(tensions), bool), backbone.tip.copy(), tangent.copy())


def _here(solver: Solver, chunks: Sequence[FloatArray]) -> _Results:
    for number, tensions in enumerate(chunks):
        yield number, _solve(solver, tensions)


def _on_cores(
    solver: Solver, job: _Job, chunks: Sequence[FloatArray], processes: int | None
) -> _Results:
    """In so many processes, or in one for each core where that is worth starting them."""
    first = 0
    if processes is None:
        has_affinity = hasattr(os, 'sched_getaffinity')
        processes = len(os.sched_getaffinity(0)) if has_affinity else os.cpu_count() or 1
        # The first chunk tells.
        began = time.monotonic()
        yield 0, _solve(solver, chunks[0])
        first = 1
        alone = (time.monotonic() - began) * (len(chunks) - first)
        if alone * (1.0 - 1.0 / processes) < _POOL_START:
            processes = 1
    rest = chunks[first:]
    processes = min(processes, len(rest))
    results = _here(solver, rest) if processes < 2 else _in_pool(job, rest, processes)
    with contextlib.closing(results):
        for number, part in results:
            yield first + number, part


@functools.lru_cache(maxsize=4)
def _solver_of(job: bytes) -> Solver:
    """Solver of a worker, built once."""
    config, model, stations = pickle.loads(job)
    return config.solver(model, stations)


def _solve_job(tensions: FloatArray, job: bytes) -> _Solved:
    return _solve(_solver_of(job), tensions)


def _in_pool(job: _Job, chunks: Sequence[FloatArray], processes: int) -> _Results:
    try:
        pickled = pickle.dumps(job)
    except (AttributeError, TypeError, pickle.PicklingError) as error:
        raise ConfigError(
            f'the arm cannot be sent to other processes ({error}): expected functions with a name '
            'in a module, or processes=1'
        ) from error
    # Fresh processes: a fork beside threads, such as those of BLAS or ROS, may hang.
    context = multiprocessing.get_context('spawn')
    lifeline, held = context.Pipe(duplex=False)
    pool = ProcessPoolExecutor(processes, context, _start_worker, (pickled, lifeline))
    try:
        with _no_interrupts():
            futures = {pool.submit(_solve_job, part, pickled): i for i, part in enumerate(chunks)}
        for future in as_completed(futures):
            yield futures[future], future.result()
    except BrokenProcessPool as error:
        raise ConfigError(
            'a worker process ended before its work did: out of memory, or a script without '
            "if __name__ == '__main__': around what it runs; processes=1 starts none"
        ) from error
    except BaseException:
        held.close()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
        held.close()
        lifeline.close()


@contextlib.contextmanager
def _no_interrupts() -> Iterator[None]:
    """Processes started herein ignore Ctrl-C, which a terminal sends to all; see `_start_worker`.

    From their first instruction on, so that none prints where it was.
    """
    if not hasattr(signal, 'pthread_sigmask'):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _start_worker(job: bytes, lifeline: Connection) -> None:
    """Build the solver, and end when the process that holds the other end of ``lifeline`` does.

    However it ends, and in the middle of a chunk.
    """

    def watch() -> None:
        with contextlib.suppress(EOFError, OSError):
            lifeline.recv_bytes()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    _solver_of(job)


def _on_cluster(job: _Job, chunks: Sequence[FloatArray], scheduler: str) -> _Results:
    try:
        import cloudpickle
        from dask import distributed
    except ImportError as error:
        raise ConfigError(
            f'scheduler is {scheduler!r}, which needs Dask; install it with: '
            "pip install 'octo_arm_model[cluster]'"
        ) from error
    _find_scheduler(scheduler)
    try:
        with distributed.Client(scheduler, timeout=_CONNECT, set_as_default=False) as client:
            futures = client.map(_solve_job, chunks, job=cloudpickle.dumps(job), pure=False)
            numbers = {future.key: number for number, future in enumerate(futures)}
            for future in distributed.as_completed(futures, loop=client.loop):
                yield numbers[future.key], future.result()
    except Exception as error:
        problem = ' '.join(f'{type(error).__name__}: {error}'.split())
        raise ConfigError(f'the cluster of scheduler {scheduler!r} failed: {problem}') from error


def _find_scheduler(address: str) -> None:
    """Knock before a client is made: one that finds nobody says so at length, and twice.

    Raises:
        ConfigError: if nobody answers.
    """
    from distributed.comm import connect

    async def knock() -> None:
        comm = await connect(address, timeout=_CONNECT)
        await comm.close()

    try:
        # In a thread, as a notebook's has a running loop.
        with ThreadPoolExecutor(1) as thread:
            thread.submit(lambda: asyncio.run(knock())).result()
    except Exception as error:
        problem = ' '.join(str(error).split())
        raise ConfigError(
            f'scheduler is {address!r}, expected the address of a running Dask scheduler such as '
            f"'tcp://127.0.0.1:8786': {problem}"
        ) from error
