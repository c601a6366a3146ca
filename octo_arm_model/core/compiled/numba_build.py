"""The loops of `kernels` as machine code, where numba is installed and works.

Compiling takes a minute or two, once: numba keeps the result beside this package or, where
nothing can be written there, in the user's cache. Beside every file stands its checksum, and what
could not be kept, has another checksum or cannot be read again is compiled anew. Whatever goes
wrong otherwise is logged, and NumPy solves.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import inspect
import logging
import sys
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from octo_arm_model.core.compiled import (
    dense_kernels,
    exact_kernels,
    frame_kernels,
    friction_kernels,
    kernels,
    length_kernels,
    minimum_kernels,
    products,
    readout_kernels,
    response_kernels,
    rod_kernels,
    section_kernels,
    section_rows,
    sensitivity_kernels,
    sheath_kernels,
    sliding_kernels,
    stability_kernels,
    start_kernels,
    state_kernels,
    step_kernels,
    system_kernels,
    winding_kernels,
)
from octo_arm_model.core.compiled.friction_tables import no_friction
from octo_arm_model.core.compiled.kernel_cache import (
    forget,
    is_whole,
    kept_files,
    one_at_a_time,
    write_checksums,
)
from octo_arm_model.core.compiled.rod_tables import no_parameters, no_rod
from octo_arm_model.core.compiled.section_tables import no_exact
from octo_arm_model.core.compiled.tables import no_arm, no_grid

# Divisions by zero give infinity as in NumPy, and what comes out is looked through for it.
_OPTIONS: dict[str, Any] = {'error_model': 'numpy'}
_LOG = logging.getLogger(__name__)
_ANNOUNCED: set[str] = set()  # entries that were compiled in this process
_OWN = 'octo_arm_model.'
_KERNELS = (
    kernels, frame_kernels, exact_kernels, section_rows, section_kernels, sheath_kernels,
    start_kernels, minimum_kernels, rod_kernels, system_kernels, state_kernels, response_kernels,
    dense_kernels, readout_kernels, products, friction_kernels, sliding_kernels, length_kernels,
    winding_kernels, sensitivity_kernels, step_kernels, stability_kernels,
)  # fmt: skip


def is_available() -> bool:
    """Whether there is machine code; it is made if it is not kept from before."""
    return fault() is None


@functools.cache
def fault() -> str | None:
    """Why there is no machine code: '' without numba, else what is wrong with it; or None."""
    try:
        find_shapes()
    except ModuleNotFoundError as error:
        reason = '' if error.name == 'numba' else str(error)
    except Exception as error:  # as with a NumPy that is newer than numba knows
        reason = f'{type(error).__name__}: {error}'
    else:
        return None
    if reason:
        _LOG.warning('solving without numba, which does not work: %s', reason)
    return reason


@functools.cache
def find_shapes() -> Callable[..., int]:
    """`kernels.find_shapes`, compiled.

    Raises:
        ModuleNotFoundError: if numba is not installed.
        Exception: whatever a numba that does not work raises.
    """
    return _made(_entry, (no_arm(), *_no_shapes()))


@functools.cache
def find_exact_shapes() -> Callable[..., int]:
    """`exact_kernels.find_exact_shapes`, compiled; raises as `find_shapes`."""
    return _made(
        functools.partial(_entry, function=exact_kernels.find_exact_shapes),
        (no_exact(), *_no_shapes()),
    )


@functools.cache
def find_sliding_shapes() -> Callable[..., int]:
    """`sliding_kernels.find_sliding_shapes`, compiled; raises as `find_shapes`."""
    table = np.zeros((0, 0))
    grid, tensions, *shapes = _no_shapes()
    return _made(
        functools.partial(_entry, function=sliding_kernels.find_sliding_shapes),
        (no_friction(), grid, tensions, table, False, *shapes, table, np.zeros((0, 0, 0))),
    )


@functools.cache
def find_lengths() -> Callable[..., None]:
    """`length_kernels.find_lengths`, compiled; raises as `find_shapes`."""
    none = np.zeros((4, 0))
    return _made(
        functools.partial(_entry, function=length_kernels.find_lengths),
        (np.zeros((0, 4, 0)), none, False, none, np.zeros(0)),
    )


@functools.cache
def wind() -> Callable[..., tuple[float, int]]:
    """`winding_kernels.wind`, compiled; raises as `find_shapes`."""
    four = np.zeros((4, 0))
    return _made(
        functools.partial(_entry, function=winding_kernels.wind),
        (
            no_exact(), no_grid(), np.zeros((0, 4, 0)), four, False, np.ones((3, 1)),
            np.zeros(1, np.bool_), np.zeros(1), np.ones((1, 1)), np.zeros(1), four, four,
            np.zeros((0, 3)), np.zeros((0, 4)),
        ),
    )  # fmt: skip


def _no_shapes() -> tuple[Any, ...]:
    """Other arguments of both, of no arm."""
    return (
        no_grid(), np.zeros((0, 0)), np.zeros((4, 0)), np.zeros((4, 0, 0)), np.zeros((0, 0, 3)),
        np.zeros((0, 0, 4)), np.zeros(0), np.zeros(0, np.int64),
    )  # fmt: skip


@functools.cache
def evaluate_sections() -> Callable[..., None]:
    """`section_kernels.evaluate_sections`, compiled; raises as `find_shapes`."""
    none = np.zeros((4, 0))
    sections = no_exact().sections
    return _made(
        functools.partial(_entry, function=section_kernels.evaluate_sections),
        (sections, np.zeros(0), none, none, np.zeros((4, 4, 0)), none),
    )


@functools.cache
def balance() -> Callable[..., rod_kernels.Outcome]:
    """`rod_kernels.balance`, compiled; raises as `find_shapes`."""
    no_system = system_kernels.system_of(0, 0)
    return _made(
        functools.partial(_entry, function=rod_kernels.balance),
        (
            no_rod(), np.zeros(0), np.zeros(6), 1.0, 1.0, True, 0, False, no_system,
            np.zeros((2, 0), complex), state_kernels.empty_state(0), no_system, np.zeros((6, 6)),
            np.zeros((4, 0, 6)), readout_kernels.empty_readings(0, 0),
        ),
    )  # fmt: skip


@functools.cache
def find_turn() -> Callable[..., None]:
    """`state_kernels.find_turn`, compiled; raises as `find_shapes`."""
    none = np.zeros((4, 0))
    return _made(
        functools.partial(_entry, function=state_kernels.find_turn), (no_rod(), none, none)
    )


@functools.cache
def find_minima() -> Callable[..., tuple[float, int]]:
    """`minimum_kernels.find_minima`, compiled; raises as `find_shapes`."""
    return _made(
        functools.partial(_entry, function=minimum_kernels.find_minima),
        (no_exact().sections, np.zeros(0), np.zeros((4, 0))),
    )


@functools.cache
def differentiate() -> Callable[..., int]:
    """`sensitivity_kernels.differentiate`, compiled; raises as `find_shapes`."""
    columns = 8  # of an arm without tendons
    dead = np.zeros((0, 3, 0))
    return _made(
        functools.partial(_entry, function=sensitivity_kernels.differentiate),
        (
            no_rod(), no_parameters(), np.zeros(0), np.zeros(6), state_kernels.empty_state(0),
            dead, dead, np.zeros((0, 6, columns)), np.zeros((0, 4, columns)),
            np.zeros((0, columns)),
        ),
    )  # fmt: skip


@functools.cache
def differentiate_tip() -> Callable[..., int]:
    """`sensitivity_kernels.differentiate_tip`, compiled; raises as `find_shapes`."""
    return _made(
        functools.partial(_entry, function=sensitivity_kernels.differentiate_tip),
        (
            no_rod(), no_parameters(), np.zeros(0), np.zeros(6), state_kernels.empty_state(0),
            np.zeros((6, 2)),
        ),
    )  # fmt: skip


@functools.cache
def read_out() -> Callable[..., bool]:
    """`frame_kernels.read_out`, compiled; raises as `find_shapes`."""
    none = np.zeros((4, 0))
    return _made(
        functools.partial(_entry, function=frame_kernels.read_out),
        (no_grid(), none, none, np.zeros((0, 3)), np.zeros((0, 4))),
    )


def make_all() -> dict[str, Any]:
    """Every kernel that Python calls, by its name; empty where there is no machine code."""
    if not is_available():
        return {}
    made = (
        find_shapes, find_exact_shapes, read_out, find_sliding_shapes, find_lengths, wind, balance,
        find_turn, find_minima, evaluate_sections, differentiate, differentiate_tip,
    )  # fmt: skip
    return {one.__name__: one() for one in made}


def _made(entry: Callable[[Any], types.FunctionType], arguments: tuple[Any, ...]) -> Any:
    """An ``entry`` compiled for the types of ``arguments``, which are nothing to be solved."""
    numba = importlib.import_module('numba')
    if numba.config.DISABLE_JIT:
        raise RuntimeError('NUMBA_DISABLE_JIT is set')
    function = entry(numba)
    machine: Any = None
    for is_kept in (True, True, False):
        try:
            machine = numba.njit(function, cache=is_kept, **_OPTIONS)
            _prove(machine, arguments)
        except Exception:
            if not is_kept:
                raise
            if getattr(machine, 'signatures', None):
                return machine  # Compiled all right, only not kept.
            forget(machine)  # Kept by a numba that cannot read it again.
        else:
            return machine
    raise AssertionError  # The last round returns or raises.


def _entry(numba: Any, function: Callable[..., Any] = kernels.find_shapes) -> types.FunctionType:
    """A ``function`` with all it calls compiled, named after everything it is made from."""
    scopes: dict[str, dict[str, Any]] = {}
    compiled: dict[types.FunctionType, Any] = {}

    def scope_of(name: str) -> dict[str, Any]:
        """What functions of the module ``name`` see: each other and what is imported, compiled."""
        if name not in scopes:
            scope = scopes[name] = dict(vars(sys.modules[name]))
            for key, value in list(scope.items()):
                if isinstance(value, types.FunctionType) and value.__module__.startswith(_OWN):
                    scope[key] = compiled_of(value)
        return scopes[name]

    def compiled_of(function: types.FunctionType) -> Any:
        if function not in compiled:
            scope = scope_of(function.__module__)
            plain = types.FunctionType(function.__code__, scope, function.__name__)
            compiled.setdefault(function, numba.njit(plain, **_OPTIONS))
        return compiled[function]

    scope = scope_of(function.__module__)
    entry = types.FunctionType(function.__code__, scope, function.__name__)
    # Numba would look for changes in one file alone.
    digest = hashlib.sha256(f'{numba.__version__} {_processor()}'.encode())
    for file in sources():
        digest.update(Path(file).read_bytes())
    for module in _KERNELS:
        constants = {name: x for name, x in vars(module).items() if isinstance(x, int | float)}
        digest.update(repr(sorted(constants.items())).encode())
    entry.__qualname__ = f'{function.__name__}_{digest.hexdigest()[:16]}'
    return entry


def sources() -> list[str]:
    """Files of all functions and classes that the machine code is made from."""
    parts = [
        value
        for module in _KERNELS
        for value in vars(module).values()
        if isinstance(value, types.FunctionType | type)
    ]
    own = [part for part in parts if part.__module__.startswith(_OWN)]
    return sorted({__file__, *map(inspect.getfile, own)})


def _processor() -> str:
    binding = importlib.import_module('llvmlite.binding')
    return f'{binding.get_host_cpu_name()} {binding.get_host_cpu_features().flatten()}'


def _prove(machine: Any, arguments: tuple[Any, ...]) -> None:
    """Have ``machine`` solve nothing, for which it has to be there, loaded or compiled."""
    with one_at_a_time(machine):
        if not all(map(is_whole, kept_files(machine))):
            forget(machine)
        if not kept_files(machine):
            name = machine.__name__
            # One line for all entries together.
            if not _ANNOUNCED or name in _ANNOUNCED:
                _LOG.info('compiling the models: a minute or two, once on this machine')
            _ANNOUNCED.add(name)
        machine(*arguments)
        if sum(machine.stats.cache_misses.values()):
            write_checksums(machine)
