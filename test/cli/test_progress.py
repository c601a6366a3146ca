"""Progress on a terminal, and elsewhere."""

from __future__ import annotations

import io

import pytest

from octo_arm_model.cli import progress


class Terminal(io.StringIO):
    """Something that takes itself for a terminal."""

    def isatty(self) -> bool:
        return True


def test_a_terminal_shows_a_bar_with_rate_and_remaining_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(progress, '_REFRESH', 0.0)
    terminal = Terminal()
    bar = progress.Bar(terminal, 'sets of tensions')
    for done in (0, 64, 128):
        bar(done, 128)
    bar.leave()
    bar.leave()
    start, half, end = terminal.getvalue().replace('\x1b[K', '').split('\r')[1:]
    assert start == f'[{"." * 30}] 0/128, 0/s, starting'
    assert half.startswith(f'[{"#" * 15}{"." * 15}] 64/128, ')
    assert half.endswith(' s left')
    assert end.startswith('128 sets of tensions in ')
    assert end.count('\n') == 1
