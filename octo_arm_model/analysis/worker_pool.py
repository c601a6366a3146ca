"""Batches of tensions solved in this process, on all cores or on a Dask cluster."""

import contextlib
import multiprocessing
import os
import pickle
import signal
import threading
import time
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.errors import ConfigError, SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import Config
from octo_arm_model.rod.rotations import axes_of
from octo_arm_model.rod.solver import Solver

_POOL_START = 1.5  # typical time in which a pool starts [s]
_CONNECT = 5.0  # timeout of the connection to a scheduler [s]


class Solutions(NamedTuple):
    """The solutions of a chunk: whether each set has one (sets,), tips and tangents (n, 3)."""

    is_solved: np.ndarray
    tip: FloatArray
    direction: FloatArray


# Chunks by number, in any order; closing the generator ends the workers it started.
Results = Generator[tuple[int, Solutions], None, None]


def _solve(solver: Solver, tensions: FloatArray) -> Solutions:
    """Return the tips of a chunk, which is halved down to the sets that have no solution."""
    try:
        shapes = solver.solve(tensions)
    except SolveError:
        half, nowhere = len(tensions) // 2, np.empty((0, 3))
        if not half:
            return Solutions(np.zeros(1, bool), nowhere, nowhere)
        parts = (_solve(solver, part) for part in (tensions[:half], tensions[half:]))
        return Solutions(*map(np.concatenate, zip(*parts)))
    directions = axes_of(shapes.quaternion[:, -1])[:, 0].T
    # Copies, because views would keep whole backbones in memory.
    return Solutions(np.ones(len(tensions), bool), shapes.tip.copy(), directions.copy())


def on_cores(
    solver: Solver, config: Config, chunks: Sequence[FloatArray], processes: int | None
) -> Results:
    """Solve in ``processes``; None for one for each core if that takes less time.

    ``solver`` is the solver of ``config``.

    Raises:
        ConfigError: if the arm cannot be sent to processes, or they end before their work does.
    """
    numbered = list(enumerate(chunks))
    if processes is None:
        has_affinity = hasattr(os, 'sched_getaffinity')
        processes = len(os.sched_getaffinity(0)) if has_affinity else os.cpu_count() or 1
        # The time of the first chunk decides.
        began = time.monotonic()
        yield 0, _solve(solver, chunks[0])
        del numbered[0]
        duration = (time.monotonic() - began) * len(numbered)
        if duration * (1.0 - 1.0 / processes) < _POOL_START:
            processes = 1
    processes = min(processes, len(numbered))
    if processes < 2:
        yield from ((number, _solve(solver, part)) for number, part in numbered)
    else:
        yield from _in_pool(config, numbered, processes)


_own = threading.local()  # the last configuration of a thread, and its solver


def _solver_of(pickled: bytes) -> Solver:
    """Return the solver of this thread, which is built once: threads cannot share one."""
    if getattr(_own, 'pickled', None) != pickled:
        config: Config = pickle.loads(pickled)
        _own.pickled, _own.solver = pickled, config.solver()
    solver: Solver = _own.solver
    return solver


def _solve_pickled(tensions: FloatArray, config: bytes) -> Solutions:
    return _solve(_solver_of(config), tensions)


def _in_pool(config: Config, chunks: Sequence[tuple[int, FloatArray]], processes: int) -> Results:
    try:
        pickled = pickle.dumps(config)
    except (AttributeError, TypeError, pickle.PicklingError) as error:
        raise ConfigError(
            f'the arm cannot be sent to other processes ({error}): expected functions with a name '
            'in a module, or processes=1'
        ) from error
    # A fork of a process with threads, such as those of BLAS or ROS, may deadlock; spawn does not.
    context = multiprocessing.get_context('spawn')
    lifeline, held = context.Pipe(duplex=False)
    pool = ProcessPoolExecutor(processes, context, _start_worker, (pickled, lifeline))
    others, workers = set(multiprocessing.active_children()), set[BaseProcess]()
    try:
        with _no_interrupts():
            futures = {pool.submit(_solve_pickled, part, pickled): i for i, part in chunks}
        workers = set(multiprocessing.active_children()) - others
        for future in as_completed(futures):
            yield futures[future], future.result()
    except BrokenProcessPool as error:
        raise ConfigError(
            'a worker process ended before its work did: out of memory, or a script without '
            "if __name__ == '__main__': around what it runs; processes=1 starts none"
        ) from error
    except BaseException:
        for worker in workers:
            worker.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
        held.close()
        lifeline.close()


@contextlib.contextmanager
def _no_interrupts() -> Iterator[None]:
    """Block SIGINT, which a terminal sends to all, in processes started within the context.

    They inherit the mask, so that they print no traceback; `_in_pool` ends them.
    """
    if not hasattr(signal, 'pthread_sigmask'):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _start_worker(config: bytes, lifeline: Connection) -> None:
    """Build the solver, and start a thread that ends the process when ``lifeline`` is closed.

    The operating system closes its other end when the parent process ends.
    """

    def watch() -> None:
        with contextlib.suppress(EOFError, OSError):
            lifeline.recv_bytes()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    _solver_of(config)


def on_cluster(config: Config, chunks: Sequence[FloatArray], scheduler: str) -> Results:
    """Solve on the workers of the Dask ``scheduler`` at an address.

    Raises:
        ConfigError: if Dask is missing, does not answer or fails.
    """
    try:
        import asyncio  # the import takes long, and nothing else needs it

        import cloudpickle
        from dask import distributed
        from distributed import comm
    except ImportError as error:
        raise ConfigError(
            f'scheduler is {scheduler!r}, which needs Dask; install it with: '
            "pip install 'octo_arm_model[cluster]'"
        ) from error

    async def connect_once() -> None:
        await (await comm.connect(scheduler, timeout=_CONNECT)).close()

    try:
        # A client alone would also log two errors. This is another thread, as that of a notebook
        # already runs an event loop.
        with ThreadPoolExecutor(1) as thread:
            thread.submit(asyncio.run, connect_once()).result()
    except Exception as error:
        raise ConfigError(
            f'scheduler is {scheduler!r}, expected the address of a running Dask scheduler such '
            f"as 'tcp://127.0.0.1:8786': {' '.join(str(error).split())}"
        ) from error
    try:
        with distributed.Client(scheduler, timeout=_CONNECT, set_as_default=False) as client:
            futures = client.map(
                _solve_pickled, chunks, config=cloudpickle.dumps(config), pure=False
            )
            numbers = {future.key: number for number, future in enumerate(futures)}
            for future in distributed.as_completed(futures, loop=client.loop):
                yield numbers[future.key], future.result()
    except Exception as error:
        problem = ' '.join(f'{type(error).__name__}: {error}'.split())
        raise ConfigError(f'the cluster of scheduler {scheduler!r} failed: {problem}') from error
