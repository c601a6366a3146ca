"""How far long work is, for whoever waits in front of a terminal."""

from __future__ import annotations

import math
import time
from typing import TextIO

_REFRESH = 0.1  # of the bar [s]
_WIDTH = 30  # characters


class Bar:
    """Progress on a terminal as it goes, elsewhere one line at the end."""

    def __init__(self, stream: TextIO, things: str) -> None:
        """Show on ``stream`` how many ``things`` are done."""
        self._stream, self._things, self._is_terminal = stream, things, stream.isatty()
        self._began = time.monotonic()
        self._shown, self._is_open = -math.inf, False

    def __call__(self, done: int, total: int) -> None:
        """Show that ``done`` of ``total`` are done."""
        now = time.monotonic()
        elapsed = max(now - self._began, 1e-9)
        rate = done / elapsed
        if done == total:
            line = f'{total} {self._things} in {elapsed:.1f} s, {rate:.4g} a second'
        elif not self._is_terminal or now - self._shown < _REFRESH:
            return
        else:
            full = _WIDTH * done // total
            left = f'{(total - done) / rate:.0f} s left' if done else 'starting'
            line = f'[{"#" * full}{"." * (_WIDTH - full)}] {done}/{total}, {rate:.4g}/s, {left}'
        self._shown = now
        if self._is_terminal:
            # Back to the first column, and nothing left of a longer line before.
            line, self._is_open = f'\r{line}\x1b[K', True
        self._stream.write(line if self._is_terminal else f'{line}\n')
        self._stream.flush()

    def leave(self) -> None:
        """Go on below the bar."""
        if self._is_open:
            self._stream.write('\n')
            self._is_open = False
