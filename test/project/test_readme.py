"""The code in the README runs, and its links exist."""

import re

from checkout import ROOT

README = (ROOT / 'README.md').read_text()


def test_python_in_the_readme_runs(monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    first, *others = re.findall(r'```python\n(.*?)```', README, re.DOTALL)
    names = {}
    exec(first, names)
    assert capsys.readouterr().out.startswith('[ 0.041')
    for code in others:
        exec(code, names)
    assert names['found'].reached


def test_links_lead_to_files():
    links = re.findall(r'\]\((?!http)([^)#]+)', README)
    assert links
    missing = [link for link in links if not (ROOT / link).exists()]
    assert not missing
