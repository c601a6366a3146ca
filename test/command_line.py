"""`octo-arm` for tests: arguments, output and exit status."""

from __future__ import annotations

import io
import json
from typing import Any

import pytest

from octo_arm_model.cli.main import main
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE

TENSIONS = json.dumps(FETCHING_IN_SPACE)
SOLVE = ('solve', 'renda2012_table4', '--tensions')


class Terminal(io.StringIO):
    """A stream that passes for a terminal."""

    def isatty(self) -> bool:
        return True


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    """Exit status, output and errors of a command."""
    status = main(arguments)
    return status, *capsys.readouterr()


def printed(capsys: pytest.CaptureFixture[str], *arguments: str) -> Any:
    """The JSON that a command prints which is done."""
    assert main(arguments) == 0
    return json.loads(capsys.readouterr().out)
