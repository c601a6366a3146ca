"""Files and folders that commands write, checked before the work, and progress of the work."""

import argparse
import contextlib
import errno
import itertools
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO

from octo_arm_model.arm.errors import BagError, ConfigError
from octo_arm_model.terminal import StatusLine

_WIDTH = 30  # of the bar, in characters


class Bar(StatusLine):
    """A bar on a terminal with rate and remaining time; elsewhere one line at the end."""

    def __init__(self, things: str, stream: TextIO | None = None) -> None:
        """Count ``things`` on ``stream``, by default standard error."""
        super().__init__(stream or sys.stderr)
        self._things, self._began = things, time.monotonic()

    def __enter__(self) -> 'Bar':
        # How many there are may take a while to find out, as of a long table.
        if self.is_terminal:
            self.show(lambda: f'{self._things}: starting', always=True)
        return self

    def __call__(self, done: int, total: int) -> None:
        """Show that ``done`` of ``total`` are done."""
        self.show(lambda: self._state(done, total), always=done == total)

    def on_terminal(self, done: int, total: int) -> None:
        """The same, on a terminal alone."""
        if self.is_terminal:
            self(done, total)

    def _state(self, done: int, total: int) -> str:
        elapsed = max(time.monotonic() - self._began, 1e-9)
        rate = done / elapsed
        if done == total:
            return f'{total} {self._things} in {elapsed:.1f} s, {rate:.4g} a second'
        full = _WIDTH * done // total
        left = f'{(total - done) / rate:.0f} s left' if done else 'starting'
        return f'[{"#" * full}{"." * (_WIDTH - full)}] {done}/{total}, {rate:.4g}/s, {left}'


_HIDDEN = '.octo_arm.'  # and eight letters: folders of what is being written


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
    if path.exists() and not os.access(path, os.W_OK):
        problem = os.strerror(errno.EACCES)
    elif not path.exists() or path.is_file() or folder:  # a pipe is not opened: it would end
        try:
            tempfile.TemporaryFile(dir=path if folder else path.resolve().parent).close()
        except OSError as error:
            problem = error.strerror
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
def writing(path: Path, *, folder: bool = False) -> Iterator[Path]:
    """Where to write ``path`` in the block, a ``folder`` or a file: all of it or nothing is there.

    That is in a hidden folder, on the same disk, whose files take their places at the end of the
    block; after an error ``path`` is as it was. A device or a pipe is written to as it is.

    Raises:
        ConfigError: for an error of these files, or of none that is named, as of a full disk.
    """
    try:
        if path.exists() and not (path.is_file() or path.is_dir()):
            yield path
            return
        place = path if folder else path.resolve().parent
        with unwritten(path), tempfile.TemporaryDirectory(prefix=_HIDDEN, dir=place) as name:
            hidden = Path(name)
            yield hidden if folder else hidden / path.resolve().name
            for one in hidden.iterdir():
                one.replace(place / one.name)
    except BrokenPipeError:
        raise
    except OSError as error:
        if error.filename is not None and _HIDDEN not in str(error.filename):
            raise
        raise ConfigError(f'{path}: cannot be written: {error.strerror}') from error


@contextlib.contextmanager
def unwritten(out: Path) -> Iterator[None]:
    """Add to a KeyboardInterrupt that ``out`` is not written."""
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f'no {out} written') from None
