"""The line of a terminal that is overwritten, and how often."""

import ast
import io
import os
import re
import sys
from pathlib import Path

import pytest
from checkout import ROOT

from octo_arm_model.cli.files import Bar
from octo_arm_model.terminal import StatusLine, missing, status_of

# What setup.py installs always, and a module of Python from 3.14 on.
BASE = {'numpy', 'scipy', 'yaml', 'octo_arm_model', 'compression'}


def imports(path: Path) -> set[str]:
    """First names of the modules that the file at ``path`` imports."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add(node.module or '')
    return {name.split('.')[0] for name in found}


def test_every_module_of_an_extra_is_known_with_its_extra():
    tree = ast.parse((ROOT / 'setup.py').read_text())
    (extras,) = [
        ast.literal_eval(word.value)
        for word in ast.walk(tree)
        if isinstance(word, ast.keyword) and word.arg == 'extras_require'
    ]
    package = ROOT / 'octo_arm_model'
    for path in package.rglob('*.py'):
        for module in imports(path) - BASE - sys.stdlib_module_names:
            hint = missing(ModuleNotFoundError(name=f'{module}.some'))
            if found := re.search(r"octo_arm_model\[(\w+)\]'$", hint):
                assert extras[found[1]]
            else:  # a module of ROS, which comes with nodes and their clients
                assert 'needs ROS 2' in hint
                folder = path.relative_to(package).parts[0]
                assert folder in ('apps', 'ros', 'viewer'), f'{module} in {path}'


def test_a_module_missing_in_the_package_itself_is_no_matter_of_installing():
    with pytest.raises(ModuleNotFoundError):
        missing(ModuleNotFoundError(name='octo_arm_model.nothing'))


def test_a_program_ends_quietly_with_the_reader_of_its_output(monkeypatch):
    reader, writer = os.pipe()
    os.close(reader)  # as `head` does
    with os.fdopen(writer, 'w') as stream:
        monkeypatch.setattr(sys, 'stdout', stream)

        def run():
            with StatusLine(sys.stdout) as line:
                line.show(lambda: 'a line', always=True)
            return 0

        assert status_of('program', run) == 141
        print('what Python has left to write at exit', flush=True)


def test_a_bar_on_a_terminal_says_something_before_it_is_known_how_much_there_is(monkeypatch):
    stream = io.StringIO()
    with Bar('messages', stream):
        assert not stream.getvalue()
    monkeypatch.setattr(stream, 'isatty', lambda: True)
    with Bar('messages', stream):
        assert 'messages: starting' in stream.getvalue()
