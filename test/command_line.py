"""Run `octo-arm` in tests and read its output and exit status."""

import dataclasses
import json
import shlex
from typing import Any

import numpy as np
import pytest

from octo_arm_model.cli.main import main
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE

TENSIONS = json.dumps(FETCHING_IN_SPACE)
# Highest tensions of the workspaces of table 4 [N].
HIGHEST = np.array([[0.1] * 4, [1.0] * 4, [4.0] * 4])
SOLVE = ('solve', 'renda2012_table4', '--tensions')


def _words(arguments: tuple[object, ...]) -> list[str]:
    words = list(map(str, arguments))
    return shlex.split(words[0]) if len(words) == 1 else words


@dataclasses.dataclass
class Cli:
    """Runs commands of `octo-arm`, see the fixture `cli`.

    A command is given as words, or as one line of a shell.
    """

    capsys: pytest.CaptureFixture[str]

    def __call__(self, *arguments: object) -> tuple[int, str, str]:
        """Run a command; return exit status, output and errors."""
        return main(_words(arguments)), *self.capsys.readouterr()

    def json(self, *arguments: object) -> Any:
        """Run a command that succeeds; return the JSON that it prints."""
        status, out, err = self(*arguments)
        assert status == 0, err
        return json.loads(out)

    def refused(self, *arguments: object, status: int = 2) -> str:
        """Run a command that fails; return its one line of error without the common prefix."""
        actual, out, err = self(*arguments)
        assert (actual, out, err.count('\n')) == (status, '', 1), err
        assert err.startswith('octo-arm: error: ')
        return err.removeprefix('octo-arm: error: ')

    def left(self, *arguments: object) -> tuple[object, str, str]:
        """Run a command that argparse ends; return exit status, output and errors."""
        with pytest.raises(SystemExit) as leave:
            main(_words(arguments))
        return leave.value.code, *self.capsys.readouterr()
