"""Files and folders that commands write, checked before the work."""

from __future__ import annotations

import argparse
import contextlib
import errno
import itertools
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

from octo_arm_model.core.errors import BagError, ConfigError


def check_out(
    options: argparse.Namespace, name: str, *, folder: bool, draws: bool = False
) -> None:
    """Make the folder for the option ``name``, a ``folder`` or a file; nothing if it is None.

    It is added to ``options.made``, see `folders_made`.

    Raises:
        ConfigError: if it is the other of the two, or cannot be made or written.
        ModuleNotFoundError: if a command that ``draws`` pictures there lacks matplotlib, which is
            said before the work.
    """
    path: Path | None = getattr(options, name.removeprefix('--'))
    if path is None:
        return
    if draws:
        import matplotlib  # noqa: F401
    if path.exists() and path.is_dir() != folder:
        is_what, expected = ('a folder', 'a file') if path.is_dir() else ('a file', 'a folder')
        raise ConfigError(f'{name} is {str(path)!r}, {is_what}, expected {expected}')
    place = path if folder else path.parent
    options.made += itertools.takewhile(lambda one: not one.exists(), (place, *place.parents))
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f'{name} is {str(path)!r}, cannot be made: {error.strerror}') from error
    problem = None
    if folder or not path.exists():
        try:
            tempfile.TemporaryFile(dir=place).close()
        except OSError as error:
            problem = error.strerror
    elif not os.access(path, os.W_OK):  # not opened: the reader of a pipe would see its end
        problem = os.strerror(errno.EACCES)
    if problem is not None:
        raise ConfigError(f'{name} is {str(path)!r}, cannot be written: {problem}')


@contextlib.contextmanager
def folders_made() -> Iterator[list[Path]]:
    """Folders made within the block, each before those that hold it.

    After an error those that are empty are removed.
    """
    made: list[Path] = []
    try:
        yield made
    except BaseException:
        for folder in made:
            with contextlib.suppress(OSError):
                folder.rmdir()
        raise


def refuse_inside(bag: Path | None, *outputs: Path | None) -> None:
    """Refuse to write ``outputs`` into a ``bag`` that is read, if one is.

    Raises:
        BagError: if one is inside, or the folder of the bag.
    """
    for out in outputs:
        if bag and out and bag.resolve() in (out.resolve(), *out.resolve().parents):
            raise BagError(f'{out}: inside {bag}, which stays as it is')


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Say of what ends the block that ``path``, a file or folder written in it, is not whole.

    Raises:
        ConfigError: for an error that names no file, such as that of a full disk.
    """
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f'{path} is not whole') from None
    except BrokenPipeError:
        raise
    except OSError as error:
        if error.filename is not None:
            raise
        raise ConfigError(f'{path}: cannot be written whole: {error.strerror}') from error


@contextlib.contextmanager
def unwritten(out: Path) -> Iterator[None]:
    """Add to a KeyboardInterrupt that ``out`` is not written."""
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f'no {out} written') from None
