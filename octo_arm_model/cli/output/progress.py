"""Progress of a command that takes long."""

from __future__ import annotations

import sys
import time
from typing import TextIO

from octo_arm_model.terminal import StatusLine

_WIDTH = 30  # of the bar, in characters


class Bar(StatusLine):
    """A bar on a terminal with rate and remaining time; elsewhere one line at the end."""

    def __init__(self, things: str, stream: TextIO | None = None) -> None:
        """Count ``things`` on ``stream``, by default standard error."""
        super().__init__(stream or sys.stderr)
        self._things, self._began = things, time.monotonic()

    def __enter__(self) -> Bar:
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
