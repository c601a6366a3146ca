"""The manual builds without a warning, and its code blocks run."""

import re
import subprocess
import sys

import pytest
from checkout import ROOT

from octo_arm_model import load_config
from octo_arm_model.config.parameters import PARAMETERS

pytestmark = pytest.mark.slow

PAGES = sorted((ROOT / 'docs').glob('*.md'))
# Text blocks are not run: diagrams, and commands that do not end or need an installed ROS.
LANGUAGES = {'python', 'sh', 'yaml', 'text'}


def blocks(page, language):
    fenced = re.findall(r'^```(\S+)\n(.*?)^```', page.read_text(), re.DOTALL | re.MULTILINE)
    found = {name for name, _ in fenced if not name.startswith('{')}
    assert found <= LANGUAGES, f'{page.name} has blocks in {found - LANGUAGES}'
    return [code for name, code in fenced if name == language]


def pages_with(language):
    return [pytest.param(page, id=page.stem) for page in PAGES if blocks(page, language)]


@pytest.mark.parametrize('page', pages_with('python'))
def test_python_runs(page, monkeypatch):
    monkeypatch.chdir(ROOT)
    names = {}
    for code in blocks(page, 'python'):
        exec(code, names)


@pytest.mark.parametrize('page', pages_with('yaml'))
def test_configurations_are_arms(page, tmp_path):
    for number, text in enumerate(blocks(page, 'yaml')):
        file = tmp_path / f'{number}.yaml'
        file.write_text(text)
        load_config(file).solver()


@pytest.mark.parametrize('page', pages_with('sh'))
def test_commands_run(page, tmp_path):
    (tmp_path / 'config').symlink_to(ROOT / 'config')
    for script in blocks(page, 'sh'):
        ran = subprocess.run(
            ['bash', '-euo', 'pipefail', '-c', script],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=300,
        )
        assert ran.returncode == 0, f'{script}\n{ran.stderr}'


def test_manual_builds_without_a_warning(tmp_path):
    pytest.importorskip('sphinx', reason='needs sphinx')
    pytest.importorskip('myst_parser', reason='needs myst-parser')
    command = [sys.executable, '-m', 'sphinx', '-q', '-W', '--keep-going', '-b', 'html']
    ran = subprocess.run(
        [*command, '-d', tmp_path / 'trees', ROOT / 'docs', tmp_path / 'html'],
        capture_output=True,
        text=True,
    )
    assert ran.returncode == 0, ran.stderr
    page = (tmp_path / 'html' / 'node.html').read_text()
    missing = [parameter.name for parameter in PARAMETERS if parameter.name not in page]
    assert not missing
