"""The line of a terminal that is overwritten, and how often."""

from __future__ import annotations

import errno
import io
import itertools

import pytest
from command_line import Terminal

from octo_arm_model.terminal import StatusLine


@pytest.fixture(autouse=True)
def clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """Time goes on by 0.06 s whenever it is asked for."""
    times = itertools.count(100.0, 0.06)
    monkeypatch.setattr('octo_arm_model.terminal.time.monotonic', lambda: next(times))


def shown(stream: io.StringIO, period: float) -> str:
    with StatusLine(stream, period) as line:
        for number in range(6):
            line.show(lambda: str(number))
        line.show(lambda: 'end', always=True)
    return stream.getvalue()


def test_a_terminal_shows_the_newest_text_every_tenth_of_a_second() -> None:
    assert shown(Terminal(), 99.0) == ''.join(f'\r{text}\x1b[K' for text in '024') + (
        '\rend\x1b[K\n'
    )


def test_elsewhere_there_is_a_line_per_period() -> None:
    assert shown(io.StringIO(), 0.15) == '2\n5\nend\n'


def test_without_a_period_there_is_only_what_is_always_shown() -> None:
    assert shown(io.StringIO(), float('inf')) == 'end\n'


class _Full(io.StringIO):
    """A file on a full disk."""

    def flush(self) -> None:
        raise OSError(errno.ENOSPC, 'No space left on device')


def test_a_line_that_cannot_be_written_does_not_end_the_work() -> None:
    assert shown(_Full(), 0.15) == '2\n5\nend\n'
