"""The command line of tests."""

from __future__ import annotations

import pytest
from command_line import Cli


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str]) -> Cli:
    """Runs `octo-arm`."""
    return Cli(capsys)
