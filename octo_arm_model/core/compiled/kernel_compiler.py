"""Compilation of functions by numba, with a cache on disk.

Compiling takes a minute or two, once: numba writes the result beside this package or, where that
is not writable, to the user's cache. Every file has a checksum beside it; what is missing, has
another checksum or cannot be loaded is compiled again.
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

from octo_arm_model.core.compiled.kernel_cache import (
    forget,
    is_whole,
    kept_files,
    one_at_a_time,
    write_checksums,
)
from octo_arm_model.core.compiled.numerics.references import BORROWING, INLINED

# Divisions by zero give infinity as in NumPy; the results are checked for it.
_OPTIONS: dict[str, Any] = {'error_model': 'numpy'}
# Options of LLVM, for all that is compiled in this process from then on. Loops run along tens of
# numbers, of which unrolled and interleaved loops leave a part to slower ones; and without these
# there is a third less machine code, which the processor's caches hold no more than a part of.
_OF_LLVM = '-force-vector-interleave=1', '-unroll-runtime=0'
_LOG = logging.getLogger(__name__)
_SCOPES: dict[str, dict[str, Any]] = {}  # by module, see `_scopes`
_MADE: dict[types.FunctionType, Any] = {}  # functions that entries call, compiled
_ANNOUNCED: set[str] = set()  # entries that were compiled in this process


def compiled(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    """Compile ``function`` for the types of ``arguments``, those of an empty problem.

    Raises:
        ModuleNotFoundError: if numba is not installed.
        RuntimeError: if numba is disabled by its environment variable.
        Exception: any error of a numba that does not work.
    """
    numba = importlib.import_module('numba')
    if numba.config.DISABLE_JIT:
        raise RuntimeError('NUMBA_DISABLE_JIT is set')
    _set_options()
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
                return machine  # Compiled, but not cached.
            forget(machine)  # Cached, but cannot be loaded.
        else:
            return machine
    raise AssertionError  # The last round returns or raises.


@functools.cache
def _set_options() -> None:
    binding = importlib.import_module('llvmlite.binding')
    for option in _OF_LLVM:
        binding.set_option('octo_arm_model', option)


@functools.cache
def entry_point(machine: Any) -> Callable[..., Any]:
    """Entry point of ``machine`` without numba's dispatch on the types of the arguments.

    The types must be those it was compiled for, which is not checked: arrays are C-contiguous and
    writable, see `arm_tables.own`. For the many arguments of a loaded rod dispatch takes as long
    as a Newton step.
    """
    (compiled_once,) = machine.overloads.values()
    run: Callable[..., Any] = compiled_once.entry_point
    return run


def _entry(numba: Any, function: Callable[..., Any]) -> types.FunctionType:
    """Copy of ``function`` that calls compiled functions, named by a digest of all its sources."""
    scopes = _scopes(numba, modules_of(function))
    entry = types.FunctionType(function.__code__, scopes[function.__module__], function.__name__)
    # Numba itself detects changes in one file only.
    digest = hashlib.sha256(f'{numba.__version__} {_processor()}'.encode())
    for file in sources(function):
        digest.update(Path(file).read_bytes())
    for scope in scopes.values():
        constants = {name: x for name, x in scope.items() if isinstance(x, int | float)}
        digest.update(repr(sorted(constants.items())).encode())
    entry.__qualname__ = f'{function.__name__}_{digest.hexdigest()[:16]}'
    return entry


def _scopes(numba: Any, modules: list[str]) -> dict[str, dict[str, Any]]:
    """Globals of each of ``modules``, with compiled functions in place of those of this package.

    All entries of this process share them, so that common functions are compiled once.
    """
    new = [name for name in modules if name not in _SCOPES]
    _SCOPES.update({name: dict(vars(sys.modules[name])) for name in new})
    for scope in map(_SCOPES.__getitem__, new):
        for key, value in scope.items():
            if not _is_own(value, types.FunctionType):
                continue
            if value not in _MADE:
                seen = _SCOPES[value.__module__]
                plain = types.FunctionType(value.__code__, seen, value.__name__)
                _MADE[value] = numba.njit(
                    plain, _nrt=value not in BORROWING, forceinline=value in INLINED, **_OPTIONS
                )
            scope[key] = _MADE[value]
    return {name: _SCOPES[name] for name in modules}


def modules_of(function: Callable[..., Any]) -> list[str]:
    """Names of the modules of ``function`` and of all functions that these import, in order."""
    found, new = set(), {function.__module__}
    while new:
        found |= new
        imported = (value for name in new for value in vars(sys.modules[name]).values())
        new = {x.__module__ for x in imported if _is_own(x, types.FunctionType)} - found
    return sorted(found)


def sources(function: Callable[..., Any]) -> list[str]:
    """Files of all functions and classes that the machine code of ``function`` is made from."""
    modules = [sys.modules[name] for name in modules_of(function)]
    classes = {x for module in modules for x in vars(module).values() if _is_own(x, type)}
    return sorted({__file__, *map(inspect.getfile, [*modules, *classes])})


def _is_own(value: object, kind: type) -> bool:
    return isinstance(value, kind) and value.__module__.startswith('octo_arm_model.')


def _processor() -> str:
    binding = importlib.import_module('llvmlite.binding')
    return f'{binding.get_host_cpu_name()} {binding.get_host_cpu_features().flatten()}'


def _prove(machine: Any, arguments: tuple[Any, ...]) -> None:
    """Call ``machine`` for an empty problem, which loads or compiles it."""
    with one_at_a_time(machine):
        if not all(map(is_whole, kept_files(machine))):
            forget(machine)
        if not kept_files(machine):
            name = machine.__name__
            # Logged once for all entries.
            if not _ANNOUNCED or name in _ANNOUNCED:
                _LOG.info('compiling the models: a minute or two, once on this machine')
            _ANNOUNCED.add(name)
        machine(*arguments)
        if sum(machine.stats.cache_misses.values()):
            write_checksums(machine)


def own(value: Any) -> Any:
    """Copy of an array, or of a tuple of arrays, that is writable and C-contiguous.

    Read-only and other arrays have other types, for which numba would compile a kernel again.
    """
    if isinstance(value, np.ndarray):
        return np.array(value, order='C')
    return type(value)(*map(own, value)) if hasattr(value, '_fields') else value
