"""Files that numba keeps machine code in, each with its checksum beside it."""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any


def kept_files(machine: Any) -> list[Path]:
    """Files in which ``machine`` is kept."""
    folder = machine.stats.cache_path if machine is not None else None
    return list(Path(folder).glob(f'*.{machine.py_func.__qualname__}-*.nb[ci]')) if folder else []


def _checksum_of(kept: Path) -> Path:
    """Where the checksum of the file ``kept`` is."""
    return kept.with_name(f'{kept.name}.sha256')


def is_whole(kept: Path) -> bool:
    """Whether the file ``kept`` is as it was written.

    Numba does not check that: it would run code of which a bit has changed.
    """
    try:
        expected = _checksum_of(kept).read_text()
        return hashlib.sha256(kept.read_bytes()).hexdigest() == expected
    except (OSError, UnicodeDecodeError):
        return False


def write_checksums(machine: Any) -> None:
    """Write the checksum of every file in which ``machine`` has just been kept."""
    with contextlib.suppress(OSError):  # What has none is compiled anew the next time.
        for kept in kept_files(machine):
            digest = hashlib.sha256(kept.read_bytes()).hexdigest()
            # Nobody may read half of it, locked or not.
            written = kept.with_name(f'{kept.name}.{os.getpid()}.tmp')
            written.write_text(digest)
            written.replace(_checksum_of(kept))


def forget(machine: Any) -> None:
    """Remove the files in which ``machine`` is kept, and their checksums."""
    for kept in kept_files(machine):
        kept.unlink(missing_ok=True)
        _checksum_of(kept).unlink(missing_ok=True)


@contextlib.contextmanager
def one_at_a_time(machine: Any) -> Iterator[None]:
    """Wait for other processes that do the same, so that one compiles and the others load."""
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(ImportError, OSError, TypeError):
            fcntl = importlib.import_module('fcntl')
            name = f'{machine.py_func.__name__}.lock'
            lock = stack.enter_context(open(Path(machine.stats.cache_path) / name, 'w'))
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield
