"""Progress on a terminal, and elsewhere."""

from __future__ import annotations

import io

import pytest
from command_line import Terminal

from octo_arm_model.cli.files import Bar


def test_a_terminal_shows_a_bar_with_rate_and_remaining_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr('octo_arm_model.terminal._PERIOD', 0.0)
    stream = Terminal()
    with Bar('sets of tensions', stream) as bar:
        for done in (0, 64, 128):
            bar(done, 128)
        bar.leave()
    start, half, end = stream.getvalue().replace('\x1b[K', '').split('\r')[1:]
    assert start == f'[{"." * 30}] 0/128, 0/s, starting'
    assert half.startswith(f'[{"#" * 15}{"." * 15}] 64/128, ')
    assert half.endswith(' s left')
    assert end.startswith('128 sets of tensions in ')
    assert end.count('\n') == 1


def test_elsewhere_progress_is_one_line_at_the_end() -> None:
    stream = io.StringIO()
    with Bar('messages', stream) as bar:
        for done in range(4):
            bar(done, 3)
    assert stream.getvalue().startswith('3 messages in ')
    assert stream.getvalue().count('\n') == 1
