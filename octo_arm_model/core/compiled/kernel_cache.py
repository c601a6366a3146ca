"""Numba's cache files of machine code, each with a checksum beside it."""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any


def kept_files(machine: Any) -> list[Path]:
    """Cache files of the compiled function ``machine``."""
    folder = machine.stats.cache_path if machine is not None else None
    return list(Path(folder).glob(f'*.{machine.py_func.__qualname__}-*.nb[ci]')) if folder else []


def _checksum_of(kept: Path) -> Path:
    """Path of the checksum of the file ``kept``."""
    return kept.with_name(f'{kept.name}.sha256')


def is_whole(kept: Path) -> bool:
    """Whether the file ``kept`` has its checksum.

    Numba does not check that, and would run corrupted code.
    """
    try:
        expected = _checksum_of(kept).read_text()
        return hashlib.sha256(kept.read_bytes()).hexdigest() == expected
    except (OSError, UnicodeDecodeError):
        return False


def write_checksums(machine: Any) -> None:
    """Write the checksums of the cache files of ``machine``, which have just been written."""
    with contextlib.suppress(OSError):  # Without a checksum it is compiled again next time.
        for kept in kept_files(machine):
            digest = hashlib.sha256(kept.read_bytes()).hexdigest()
            # Replaced atomically: readers may not hold the lock.
            written = kept.with_name(f'{kept.name}.{os.getpid()}.tmp')
            written.write_text(digest)
            written.replace(_checksum_of(kept))


def forget(machine: Any) -> None:
    """Remove the cache files of ``machine`` and their checksums."""
    for kept in kept_files(machine):
        kept.unlink(missing_ok=True)
        _checksum_of(kept).unlink(missing_ok=True)


@contextlib.contextmanager
def one_at_a_time(machine: Any) -> Iterator[None]:
    """Lock ``machine`` between processes, so that one compiles and the others load."""
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(ImportError, OSError, TypeError):
            fcntl = importlib.import_module('fcntl')
            name = f'{machine.py_func.__name__}.lock'
            lock = stack.enter_context(open(Path(machine.stats.cache_path) / name, 'w'))
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield
