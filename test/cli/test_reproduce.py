"""`octo-arm reproduce`: exit statuses, and what it says of claims that fail."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from octo_arm_model import MODELS
from octo_arm_model.cli import reproduce
from octo_arm_model.cli.main import main
from octo_arm_model.reproduce.claims import Claim, Finding


def test_a_claim_that_fails_is_said_and_is_status_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip('matplotlib')
    from octo_arm_model.reproduce import page as content
    from octo_arm_model.reproduce import page as html_page

    claim = Claim(
        'The arm is straight.', 'section 8', '', dict.fromkeys(MODELS, Finding('2 mm', False))
    )
    monkeypatch.setattr(reproduce, 'CLAIMS', (lambda: claim,))
    monkeypatch.setattr(content, 'blocks', lambda claims: [html_page.heading('Title', 1), *claims])
    assert main(['reproduce', str(tmp_path)]) == 1
    out, err = capsys.readouterr()
    assert err == 'octo-arm: does not hold: The arm is straight. (section 8)\n'
    assert 'renda2012 0 of 1' in out
    # A finding is shown, not hidden.
    text = (tmp_path / 'renda2012.html').read_text(encoding='utf-8')
    assert text.count('<span class="fails">fails</span>') == 3


@pytest.mark.parametrize('name', ['file', 'file/below'])
def test_a_folder_that_cannot_be_is_one_line_and_status_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    pytest.importorskip('matplotlib')
    (tmp_path / 'file').write_text('')
    assert main(['reproduce', str(tmp_path / name)]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count('\n')) == ('', 1)
    assert err.startswith(f'octo-arm: error: outdir is {str(tmp_path / name)!r}, ')


def test_without_matplotlib_it_says_what_to_install_and_makes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in list(sys.modules):
        if name.split('.')[0] == 'matplotlib' or name.startswith('octo_arm_model.reproduce.'):
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, 'matplotlib', None)
    assert main(['reproduce', str(tmp_path / 'new')]) == 2
    err = capsys.readouterr().err
    assert re.fullmatch(r'octo-arm: error: needs matplotlib.*; install it with: .*\n', err)
    assert not (tmp_path / 'new').exists()
