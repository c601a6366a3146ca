"""The README says what is true."""

import re
from pathlib import Path

import pytest

from octo_arm_model.parameters import PARAMETERS

README = (Path(__file__).resolve().parent.parent / 'README.md').read_text()


@pytest.mark.parametrize('parameter', PARAMETERS, ids=lambda parameter: parameter.name)
def test_readme_lists_every_parameter_as_declared(parameter):
    default = list(parameter.default or ()) if parameter.is_array else parameter.default
    shown = 'empty' if default in ([], '') else f'`{default}`'
    if parameter.default is None:
        shown = f'required, or `{parameter.unless}`' if parameter.unless else 'required'
    row = f'| `{parameter.name}` | {parameter.type_name} | {shown} | {parameter.description} |'
    assert row in README


def test_readme_lists_no_parameter_that_is_not_there():
    table = README.split('### Parameters')[1].split('## ')[0]
    assert re.findall(r'^\| `([\w.]+)`', table, re.MULTILINE) == [p.name for p in PARAMETERS]


def test_python_in_the_readme_runs(monkeypatch, capsys):
    monkeypatch.chdir(Path(__file__).resolve().parent.parent)
    first, *others = re.findall(r'```python\n(.*?)```', README, re.DOTALL)
    names = {}
    exec(first, names)
    assert capsys.readouterr().out.startswith('[ 0.041')
    for code in others:
        exec(code, names)
    assert names['found'].reached
