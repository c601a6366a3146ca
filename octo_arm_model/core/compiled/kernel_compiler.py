"""Functions as machine code, compiled by numba and kept.

Compiling takes a minute or two, once: numba keeps the result beside this package or, where
nothing can be written there, in the user's cache. Beside every file stands its checksum, and what
could not be kept, has another checksum or cannot be read again is compiled anew.
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

from octo_arm_model.core.compiled import (
    coupling_kernels,
    dense_kernels,
    exact_kernels,
    frame_kernels,
    friction_kernels,
    kernels,
    length_kernels,
    minimum_kernels,
    orientation_kernels,
    products,
    readout_kernels,
    resolution_kernels,
    response_kernels,
    rod_kernels,
    section_kernels,
    section_rows,
    sensitivity_kernels,
    sheath_kernels,
    sliding_kernels,
    sliding_rod_kernels,
    stability_kernels,
    start_kernels,
    state_kernels,
    step_kernels,
    system_kernels,
    winding_kernels,
)
from octo_arm_model.core.compiled.kernel_cache import (
    forget,
    is_whole,
    kept_files,
    one_at_a_time,
    write_checksums,
)

# Divisions by zero give infinity as in NumPy, and what comes out is looked through for it.
_OPTIONS: dict[str, Any] = {'error_model': 'numpy'}
_LOG = logging.getLogger(__name__)
_ANNOUNCED: set[str] = set()  # entries that were compiled in this process
_OWN = 'octo_arm_model.'
# Modules of functions that are compiled, and of what they are made from.
_KERNELS = (
    kernels, frame_kernels, exact_kernels, section_rows, section_kernels, sheath_kernels,
    start_kernels, minimum_kernels, rod_kernels, system_kernels, state_kernels,
    orientation_kernels, response_kernels, dense_kernels, readout_kernels, products,
    friction_kernels, sliding_kernels, length_kernels, sliding_rod_kernels, winding_kernels,
    sensitivity_kernels, step_kernels, stability_kernels, resolution_kernels, coupling_kernels,
)  # fmt: skip


def compiled(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    """A ``function`` compiled for the types of ``arguments``, which are nothing to be solved.

    Raises:
        ModuleNotFoundError: if numba is not installed.
        RuntimeError: if it is told not to compile.
        Exception: whatever a numba that does not work raises.
    """
    numba = importlib.import_module('numba')
    if numba.config.DISABLE_JIT:
        raise RuntimeError('NUMBA_DISABLE_JIT is set')
    entry = _entry(numba, function)
    machine: Any = None
    for is_kept in (True, True, False):
        try:
            machine = numba.njit(entry, cache=is_kept, **_OPTIONS)
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


@functools.cache
def entry_point(machine: Any) -> Callable[..., Any]:
    """What runs ``machine`` without looking at the types of its arguments first.

    These have to be those that it was compiled for, as nobody compares them: all arrays are
    `tables.own`, or made in order. A loaded rod has so many of them that to look at all takes
    as long as a step of Newton's method.
    """
    (compiled_once,) = machine.overloads.values()
    run: Callable[..., Any] = compiled_once.entry_point
    return run


def _entry(numba: Any, function: Callable[..., Any]) -> types.FunctionType:
    """A ``function`` with all it calls compiled, named after everything it is made from."""
    scopes: dict[str, dict[str, Any]] = {}
    made: dict[types.FunctionType, Any] = {}

    def scope_of(name: str) -> dict[str, Any]:
        """What functions of the module ``name`` see: each other and what is imported, compiled."""
        if name not in scopes:
            scope = scopes[name] = dict(vars(sys.modules[name]))
            for key, value in list(scope.items()):
                if isinstance(value, types.FunctionType) and value.__module__.startswith(_OWN):
                    scope[key] = made_of(value)
        return scopes[name]

    def made_of(function: types.FunctionType) -> Any:
        if function not in made:
            scope = scope_of(function.__module__)
            plain = types.FunctionType(function.__code__, scope, function.__name__)
            made.setdefault(function, numba.njit(plain, **_OPTIONS))
        return made[function]

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
