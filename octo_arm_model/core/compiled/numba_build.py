"""The loops of `kernels` as machine code, where numba is installed and works.

Compiling takes some ten seconds, once: numba keeps the result beside this package or, where
nothing can be written there, in the user's cache. Beside every file stands its checksum, and what
could not be kept, has another checksum or cannot be read again is compiled anew. Whatever goes
wrong otherwise is logged, and NumPy solves.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib
import inspect
import logging
import os
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from octo_arm_model.core.compiled import kernels
from octo_arm_model.core.compiled.tables import no_arm

# Divisions by zero give infinity as in NumPy, and what comes out is looked through for it.
_OPTIONS: dict[str, Any] = {'error_model': 'numpy'}
_LOG = logging.getLogger(__name__)


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
    numba = importlib.import_module('numba')
    if numba.config.DISABLE_JIT:
        raise RuntimeError('NUMBA_DISABLE_JIT is set')
    entry = _entry(numba)
    machine: Any = None
    for is_kept in (True, True, False):
        try:
            machine = numba.njit(entry, cache=is_kept, **_OPTIONS)
            _prove(machine)
        except Exception:
            if not is_kept:
                raise
            if getattr(machine, 'signatures', None):
                return machine  # Compiled all right, only not kept.
            _forget(machine)  # Kept by a numba that cannot read it again.
        else:
            return machine
    raise AssertionError  # The last round returns or raises.


def _entry(numba: Any) -> types.FunctionType:
    """`kernels.find_shapes` with all it calls compiled, named after everything it is made from."""
    functions = {
        name: value
        for name, value in vars(kernels).items()
        if isinstance(value, types.FunctionType)
    }
    # Each sees the others compiled, under the names they have in `kernels`.
    scope = dict(vars(kernels))
    for name, function in functions.items():
        plain = types.FunctionType(function.__code__, scope, name)
        scope[name] = numba.njit(plain, **_OPTIONS)
    entry = types.FunctionType(kernels.find_shapes.__code__, scope, 'find_shapes')
    # Numba would look for changes in one file alone.
    digest = hashlib.sha256(f'{numba.__version__} {_processor()}'.encode())
    for file in sources():
        digest.update(Path(file).read_bytes())
    entry.__qualname__ = f'find_shapes_{digest.hexdigest()[:16]}'
    return entry


def sources() -> list[str]:
    """Files of all functions and classes that the machine code is made from."""
    parts = [
        value for value in vars(kernels).values() if isinstance(value, types.FunctionType | type)
    ]
    own = [part for part in parts if part.__module__.startswith('octo_arm_model.')]
    return sorted({__file__, *map(inspect.getfile, own)})


def _processor() -> str:
    binding = importlib.import_module('llvmlite.binding')
    return f'{binding.get_host_cpu_name()} {binding.get_host_cpu_features().flatten()}'


def _prove(machine: Any) -> None:
    """Have ``machine`` solve nothing, for which it has to be there, loaded or compiled."""
    none = np.zeros((0, 0))
    with _one_at_a_time(machine):
        if not all(map(_is_whole, _kept(machine))):
            _forget(machine)
        if not _kept(machine):
            _LOG.info('compiling the models: some ten seconds, once on this machine')
        machine(
            no_arm(), none, np.zeros((4, 0)), np.zeros((4, 0, 0)), np.zeros((0, 0, 3)),
            np.zeros((0, 0, 4)), np.zeros(0), np.zeros(0, np.int64),
        )  # fmt: skip
        if sum(machine.stats.cache_misses.values()):
            _write_checksums(machine)


def _kept(machine: Any) -> list[Path]:
    """Files in which ``machine`` is kept."""
    folder = machine.stats.cache_path if machine is not None else None
    return list(Path(folder).glob(f'*.{machine.py_func.__qualname__}-*.nb[ci]')) if folder else []


def _checksum_of(kept: Path) -> Path:
    """Where the checksum of the file ``kept`` is."""
    return kept.with_name(f'{kept.name}.sha256')


def _is_whole(kept: Path) -> bool:
    """Whether the file ``kept`` is as it was written.

    Numba would run a flipped bit of it.
    """
    try:
        expected = _checksum_of(kept).read_text()
        return hashlib.sha256(kept.read_bytes()).hexdigest() == expected
    except (OSError, UnicodeDecodeError):
        return False


def _write_checksums(machine: Any) -> None:
    """Write the checksum of every file in which ``machine`` has just been kept."""
    with contextlib.suppress(OSError):  # What has none is compiled anew the next time.
        for kept in _kept(machine):
            digest = hashlib.sha256(kept.read_bytes()).hexdigest()
            # Nobody may read half of it, locked or not.
            written = kept.with_name(f'{kept.name}.{os.getpid()}.tmp')
            written.write_text(digest)
            written.replace(_checksum_of(kept))


def _forget(machine: Any) -> None:
    """Remove the files in which ``machine`` is kept, and their checksums."""
    for kept in _kept(machine):
        kept.unlink(missing_ok=True)
        _checksum_of(kept).unlink(missing_ok=True)


@contextlib.contextmanager
def _one_at_a_time(machine: Any) -> Iterator[None]:
    """Wait for other processes that do the same, so that one compiles and the others load."""
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(ImportError, OSError, TypeError):
            fcntl = importlib.import_module('fcntl')
            lock = stack.enter_context(open(Path(machine.stats.cache_path) / 'octo_arm.lock', 'w'))
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield
