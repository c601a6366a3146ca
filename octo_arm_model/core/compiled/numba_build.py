"""All kernels that Python calls, in machine code where numba is installed and works.

A kernel is loaded or compiled at its first use; see `kernel_compiler`. Where that fails, the error
is logged and NumPy solves.
"""

from __future__ import annotations

import functools
import logging
import multiprocessing
import os
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from octo_arm_model.core.compiled.kernel_compiler import compiled
from octo_arm_model.core.compiled.numerics import least_squares_kernels, posterior_kernels
from octo_arm_model.rod import tip_curvature

_LOG = logging.getLogger(__name__)
_R = TypeVar('_R')
_MOST_PROCESSES = 4
# Functions that return the kernels, by the names of these.
KERNELS: dict[str, Callable[[], Any]] = {}


def _made(
    kernel: Callable[..., _R], *arguments: Any
) -> functools._lru_cache_wrapper[Callable[..., _R]]:
    """Function that returns ``kernel`` in machine code, for the types of ``arguments``.

    Its first call compiles and raises as `compiled`.
    """
    made = functools.cache(functools.partial(compiled, kernel, arguments))
    KERNELS[kernel.__name__] = made
    return made


add_up_curvature = _made(
    tip_curvature.add_up, np.ones((3, 2)), np.ones((6, 2, 3)), np.ones(3), np.ones((6, 3, 3))
)
_ONE, _SQUARE, _SECOND = np.ones(1), np.ones((1, 1)), np.ones((1, 1, 1))
# A belief; a state, with what is left there and its derivatives, and the slope of what is least.
_BELIEF, _LOCAL = (_ONE, _SQUARE), (_ONE, _ONE, _SQUARE, _SECOND)
second_order_step = _made(
    least_squares_kernels.second_order_step, *_BELIEF, _ONE, *_LOCAL, _ONE, 0.5, 1, _ONE
)
find_posterior = _made(
    posterior_kernels.find_posterior, *_BELIEF, _SQUARE, _SQUARE, _SQUARE, 1.0, *_LOCAL, 0.5, 1,
    _SQUARE, _SQUARE, _SQUARE, *_LOCAL, _ONE, _ONE,
)  # fmt: skip
second_order_mean = _made(
    posterior_kernels.second_order_mean, *_BELIEF, *_LOCAL, _ONE, 0.5, 1, 0, 1, 1, 1.0, 1, _ONE,
    1.0, 1.0, _ONE,
)  # fmt: skip
conclude = _made(
    posterior_kernels.conclude, _ONE, _SQUARE, *_LOCAL, _SQUARE, _SQUARE, _SQUARE, _ONE, _SQUARE
)


def make_side_by_side() -> None:
    """Compile and cache every kernel, in parallel processes.

    Each process compiles the functions common to its kernels once. LLVM takes about 1 GB in each.
    """
    if not is_available():
        return
    processes = min(_MOST_PROCESSES, os.cpu_count() or 1)
    with multiprocessing.get_context('spawn').Pool(processes) as pool:
        # The last ones take longest.
        for _ in pool.imap_unordered(_make, reversed(KERNELS)):
            pass


def _make(name: str) -> None:
    KERNELS[name]()


def is_available() -> bool:
    """Whether kernels can be compiled; compiles one if it is not cached."""
    return fault() is None


@functools.cache
def fault() -> str | None:
    """Why kernels cannot be compiled: '' without numba, else its error; None if they can."""
    try:
        add_up_curvature()
    except ModuleNotFoundError as error:
        reason = '' if error.name == 'numba' else str(error)
    except Exception as error:  # such as a NumPy newer than numba supports
        reason = f'{type(error).__name__}: {error}'
    else:
        return None
    if reason:
        _LOG.warning('solving without numba, which does not work: %s', reason)
    return reason
