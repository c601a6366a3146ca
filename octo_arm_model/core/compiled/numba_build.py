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

from octo_arm_model.core.compiled.friction import sliding_kernels, sliding_rod_kernels
from octo_arm_model.core.compiled.friction.friction_tables import no_friction
from octo_arm_model.core.compiled.kernel_compiler import compiled
from octo_arm_model.core.compiled.loaded import (
    orientation_kernels,
    readout_kernels,
    rod_kernels,
    rod_state,
    sensitivity_kernels,
    system_kernels,
)
from octo_arm_model.core.compiled.loaded.rod_tables import no_parameters, no_rod
from octo_arm_model.core.compiled.models import (
    exact_kernels,
    frame_kernels,
    paper_kernels,
    winding_kernels,
)
from octo_arm_model.core.compiled.models.arm_tables import no_arm, no_grid
from octo_arm_model.core.compiled.numerics import least_squares_kernels, posterior_kernels
from octo_arm_model.core.compiled.section import length_kernels, minimum_kernels, section_kernels
from octo_arm_model.core.compiled.section.section_tables import no_exact
from octo_arm_model.core.sensitivity import tip_curvature

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


# Arguments of an arm without points and tendons.
_NONE, _FOUR, _TABLE, _OF_TENDONS = (
    np.zeros(0), np.zeros((4, 0)), np.zeros((0, 0)), np.zeros((0, 4, 0)),
)  # fmt: skip
_POSITION, _QUATERNION, _DEAD = np.zeros((0, 3)), np.zeros((0, 4)), np.zeros((0, 3, 0))
_STATE, _WRENCH = rod_state.empty_state(0), np.zeros(6)
_SHAPES = (
    _FOUR, np.zeros((4, 0, 0)), np.zeros((0, 0, 3)), np.zeros((0, 0, 4)), _NONE,
    np.zeros(0, np.int64),
)  # fmt: skip

find_shapes = _made(paper_kernels.find_shapes, no_arm(), no_grid(), _TABLE, *_SHAPES)
find_exact_shapes = _made(exact_kernels.find_exact_shapes, no_exact(), no_grid(), _TABLE, *_SHAPES)
find_sliding_shapes = _made(
    sliding_kernels.find_sliding_shapes, no_friction(), no_grid(), _TABLE, _TABLE, *_SHAPES,
    _TABLE, np.zeros((0, 0, 0)), _TABLE, _TABLE,
)  # fmt: skip
slide = _made(sliding_kernels.slide, no_friction(), _NONE, _TABLE, _TABLE, _FOUR)
read_out = _made(frame_kernels.read_out, no_grid(), _FOUR, _FOUR, _POSITION, _QUATERNION)
find_lengths = _made(length_kernels.find_lengths, _OF_TENDONS, _FOUR, False, _FOUR, _NONE)
_WINCHES = (
    winding_kernels.Winches(_OF_TENDONS, _FOUR, False, np.ones((3, 1)), np.zeros(1, np.bool_)),
    winding_kernels.Reeled(np.zeros(1), np.zeros(1), np.ones((1, 1)), np.zeros(1)),
)
wind = _made(
    winding_kernels.wind, no_exact(), no_grid(), *_WINCHES, _FOUR, _FOUR, _POSITION, _QUATERNION
)
first_step = _made(winding_kernels.first_step, *_WINCHES, np.zeros(1))
next_step = _made(winding_kernels.next_step, *_WINCHES, _FOUR, 1.0, 1.0, np.zeros(1))
evaluate_sections = _made(
    section_kernels.evaluate_sections, no_exact().sections, _NONE, _FOUR, _FOUR,
    np.zeros((4, 4, 0)), _FOUR,
)  # fmt: skip
find_minima = _made(minimum_kernels.find_minima, no_exact().sections, _NONE, _FOUR)
find_turn = _made(
    orientation_kernels.find_turn, no_rod().elements, _FOUR, 1.0, _FOUR,
    np.zeros((orientation_kernels.TURN_ROWS, 0)),
)  # fmt: skip
_NO_SYSTEM = system_kernels.system_of(0, 0)
balance = _made(
    rod_kernels.balance, no_rod(), _NONE, _WRENCH, 1.0, 1.0, True, 0, False, _NO_SYSTEM, 0.0,
    0.0, False, np.zeros((2, 0), complex), _STATE, _NO_SYSTEM, np.zeros((6, 6)),
    np.zeros((4, 0, 6)), readout_kernels.empty_readings(0, 0),
)  # fmt: skip
slide_rod = _made(
    sliding_rod_kernels.slide_rod, no_rod(), no_friction(), _NONE, _TABLE, _WRENCH, 1.0, 1.0, True,
    0, False, _NO_SYSTEM, 0.0, 0.0, np.zeros((2, 0), complex), _STATE, _TABLE, _NO_SYSTEM,
    np.zeros((6, 6)), np.zeros((4, 0, 6)), readout_kernels.empty_readings(0, 0),
)  # fmt: skip
# An arm without tendons has 8 columns in the one, and 2 deviations in the other.
differentiate = _made(
    sensitivity_kernels.differentiate, no_rod(), no_parameters(), _NONE, _WRENCH, _STATE, False,
    _NO_SYSTEM, _DEAD, _DEAD, np.zeros((0, 6, 8)), np.zeros((0, 4, 8)), np.zeros((0, 8)),
)  # fmt: skip
add_tip_covariance = _made(
    sensitivity_kernels.add_tip_covariance, no_rod(), no_parameters(), _NONE, _WRENCH, _STATE,
    False, _NO_SYSTEM, np.zeros(2), np.zeros((6, 6)),
)  # fmt: skip
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
        find_shapes()
    except ModuleNotFoundError as error:
        reason = '' if error.name == 'numba' else str(error)
    except Exception as error:  # such as a NumPy newer than numba supports
        reason = f'{type(error).__name__}: {error}'
    else:
        return None
    if reason:
        _LOG.warning('solving without numba, which does not work: %s', reason)
    return reason
