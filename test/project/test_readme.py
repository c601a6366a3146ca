"""The README says what is true."""

import re

from checkout import ROOT

from octo_arm_model.config.parameters import PARAMETERS, as_markdown

README = (ROOT / 'README.md').read_text()


def test_readme_has_the_table_of_parameters():
    assert as_markdown(PARAMETERS) in README


def test_python_in_the_readme_runs(monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    first, *others = re.findall(r'```python\n(.*?)```', README, re.DOTALL)
    names = {}
    exec(first, names)
    assert capsys.readouterr().out.startswith('[ 0.041')
    for code in others:
        exec(code, names)
    assert names['found'].reached
