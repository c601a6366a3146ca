"""Output files and folders of commands, which are checked before the work, and progress bars."""

import argparse
import contextlib
import errno
import itertools
import os
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO

from octo_arm_model.arm.errors import BagError, ConfigError
from octo_arm_model.simulation.movements import MOVEMENTS
from octo_arm_model.terminal import StatusLine

_WIDTH = 30  # of the bar, in characters
_PERIOD = 1.0  # [s] between two updates while nothing new is done


class Bar(StatusLine):
    """A bar on a terminal with rate and remaining time; elsewhere one line at the end."""

    def __init__(self, things: str, stream: TextIO | None = None) -> None:
        """Count ``things`` on ``stream``, by default standard error."""
        super().__init__(stream or sys.stderr)
        self._things, self._start = things, time.monotonic()
        self._counts: tuple[int, int] | None = None
        self._has_ended = threading.Event()
        self._clock = threading.Thread(target=self._count_seconds, daemon=True)

    def __enter__(self) -> 'Bar':
        # It may take a while to count the things, for example the rows of a long table.
        if self.is_terminal:
            self.show(self._state, always=True)
            self._clock.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._has_ended.set()
        if self.is_terminal:
            self._clock.join()
        super().__exit__(*error)

    def _count_seconds(self) -> None:
        """Show the time while one thing takes long, such as a fit."""
        with contextlib.suppress(BrokenPipeError):  # The next thing done raises it.
            while not self._has_ended.wait(_PERIOD):
                if self._counts is None or self._counts[0] < self._counts[1]:
                    self.show(self._state)

    def __call__(self, done: int, total: int) -> None:
        """Show that ``done`` of ``total`` things are done."""
        self._counts = done, total
        self.show(self._state, always=done == total)

    def on_terminal(self, done: int, total: int) -> None:
        """Show that ``done`` of ``total`` things are done, but only on a terminal."""
        if self.is_terminal:
            self(done, total)

    def _state(self) -> str:
        elapsed = max(time.monotonic() - self._start, 1e-9)
        if self._counts is None:
            return f'{self._things}: {elapsed:.0f} s'
        done, total = self._counts
        rate = done / elapsed
        if done == total:
            return f'{total} {self._things} in {elapsed:.1f} s, {rate:.4g} a second'
        full = _WIDTH * done // total
        pace = f'{elapsed:.0f} s'
        if done:
            pace = f'{rate:.4g}/s, {(total - done) / rate:.0f} s left'
        return f'[{"#" * full}{"." * (_WIDTH - full)}] {done}/{total}, {pace}'


_HIDDEN = '.octo_arm.'  # prefix of the temporary folders of unfinished output


def check_out(
    options: argparse.Namespace,
    name: str,
    *,
    folder: bool,
    draws: bool = False,
    usual: Path | None = None,
) -> Path | None:
    """Make the folder for the output option ``name``, and return its value.

    ``folder`` says whether the option names a folder or a file, ``usual`` is its value if it is
    not given. New folders are added to ``options.made``, as `folders_made` needs them.

    Raises:
        ConfigError: if the option names a file instead of a folder or the other way round, or the
            output cannot be made or written.
        ModuleNotFoundError: if a command that ``draws`` pictures there lacks matplotlib.
    """
    path: Path | None = getattr(options, name.removeprefix('--')) or usual
    if path is None:
        return None
    if draws:
        import matplotlib  # noqa: F401
    if path.exists() and path.is_dir() != folder:
        kind, expected = ('a folder', 'a file') if path.is_dir() else ('a file', 'a folder')
        raise ConfigError(f'{name} is {str(path)!r}, {kind}, expected {expected}')
    place = path if folder else path.parent
    options.made += itertools.takewhile(lambda path: not path.exists(), (place, *place.parents))
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f'{name} is {str(path)!r}, cannot be made: {error.strerror}') from error
    problem = None
    if path.exists() and not os.access(path, os.W_OK):
        problem = os.strerror(errno.EACCES)
    elif not path.exists() or path.is_file() or folder:  # opening a pipe would end its reader
        try:
            tempfile.TemporaryFile(dir=path if folder else path.resolve().parent).close()
        except OSError as error:
            problem = error.strerror
    if problem is not None:
        raise ConfigError(f'{name} is {str(path)!r}, cannot be written: {problem}')
    return path


@contextlib.contextmanager
def folders_made() -> Iterator[list[Path]]:
    """Yield a list for the folders made within the block, each in front of its parents.

    After an error the empty ones among them are removed.
    """
    made: list[Path] = []
    try:
        yield made
    except BaseException:
        for folder in made:
            with contextlib.suppress(OSError):
                folder.rmdir()
        raise


_INPUTS = 'bag', 'profile', 'pose_csv', 'tension_csv', 'midline_csv', 'displacement_csv'
_OUTPUTS = 'out', 'csv', 'plot', 'animate', 'pictures'
# Tables that commands write into folders.
_TABLES = 'compare', 'estimate', 'innovations', 'midlines', 'stations', 'tensions'


def refuse_overwriting(options: argparse.Namespace) -> None:
    """Check that no output of a command is its input, in it, or a folder for a table over it.

    Raises:
        BagError: if one is.
    """
    given = vars(options)
    inputs = {given[name] for name in _INPUTS if name in given} - {None, *MOVEMENTS}
    outputs = {given[name] for name in _OUTPUTS if name in given} - {None}
    for kept, out in itertools.product(inputs, outputs):
        place = out.resolve()
        tables = (place / f'{name}.csv' for name in _TABLES)
        if Path(kept).resolve() in (place, *place.parents, *tables):
            raise BagError(f'{out}: would be written into or over {kept}, which stays as it is')


@contextlib.contextmanager
def writing(path: Path, *, folder: bool = False) -> Iterator[Path]:
    """Yield a temporary path to write to in place of ``path``, a ``folder`` or a file.

    It is in a hidden folder on the same disk, whose files are moved to their places at the end of
    the block; after an error ``path`` is unchanged. A device or a pipe is written to directly.

    Raises:
        ConfigError: for an error of these files, or one without a file name, as of a full disk.
    """
    try:
        if path.exists() and not (path.is_file() or path.is_dir()):
            yield path
            return
        place = path if folder else path.resolve().parent
        with unwritten(path), tempfile.TemporaryDirectory(prefix=_HIDDEN, dir=place) as name:
            hidden = Path(name)
            yield hidden if folder else hidden / path.resolve().name
            for file in hidden.iterdir():
                file.replace(place / file.name)
    except BrokenPipeError:
        raise
    except OSError as error:
        if error.filename is not None and _HIDDEN not in str(error.filename):
            raise
        raise ConfigError(f'{path}: cannot be written: {error.strerror}') from error


@contextlib.contextmanager
def unwritten(out: Path) -> Iterator[None]:
    """Add the message that ``out`` is not written to a KeyboardInterrupt within the block."""
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f'no {out} written') from None
