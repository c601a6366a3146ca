"""The README and the manual: blocks of code print what the pages state, and links work.

The convention: a block of `python` or `sh` (commands of `octo-arm`) that prints is followed by a
block of `output`. It has the printed words, and numbers to the digits that it states; `...` stands
for longer parts or parts that differ by machine. Blocks of `yaml` are parameter files of arms.
Blocks of `text` are not run: diagrams, and commands that do not end, take minutes, or need an
installed ROS or files of the reader.
"""

import re
import shlex
from itertools import pairwise

import pytest
from checkout import ROOT

from octo_arm_model import load_config
from octo_arm_model.cli.main import build_parser, main

PAGES = [ROOT / 'README.md', *sorted((ROOT / 'docs').glob('*.md'))]
LANGUAGES = {'python', 'sh', 'yaml', 'text', 'output'}
# Pages with commands that fit experiments; `make test` checks only their options.
LONG = {'README', 'bags', 'effects'}
NUMBER = r'[-+]?\d+(?:\.\d*)?(?:e[-+]?\d+)?'


def blocks(page, *languages):
    """Return blocks of code of a page with their stated output."""
    fenced = re.findall(r'^```(\S+)\n(.*?)^```', page.read_text(), re.DOTALL | re.MULTILINE)
    fenced = [(name, code) for name, code in fenced if not name.startswith('{')]
    names = {name for name, _ in fenced}
    assert names <= LANGUAGES, f'{page.name} has blocks in {names - LANGUAGES}'
    return [
        (code, after[1] if after[0] == 'output' else '')
        for (name, code), after in pairwise([*fenced, ('', '')])
        if name in languages
    ]


def commands(script):
    """Return the commands of a script as lists of words."""
    lines = script.replace('\\\n', ' ').splitlines()
    return [words for line in lines if (words := shlex.split(line, comments=True))]


def pages_with(*languages, long=()):
    return [
        pytest.param(
            page, id=page.stem, marks=[pytest.mark.endurance] if page.stem in long else []
        )
        for page in PAGES
        if blocks(page, *languages)
    ]


def assert_prints(printed, stated):
    """Compare ``printed`` with ``stated`` output by the convention above."""
    both = f'stated:\n{stated}\nprinted:\n{printed}'
    # Arrays are aligned by spaces.
    printed, stated = (re.sub(r'(?<=\[) +| +(?=\])', '', x.strip()) for x in (printed, stated))
    numbers, pattern = [], ''
    for part in re.split(rf'({NUMBER}|\.\.\.|\s+)', stated):
        if re.fullmatch(NUMBER, part):
            numbers.append(part)
            pattern += f'({NUMBER})'
        else:
            pattern += '.*?' if part == '...' else r'\s+' if part.isspace() else re.escape(part)
    match = re.fullmatch(pattern, printed, re.DOTALL)
    assert match, both
    for number, expected in zip(match.groups(), numbers, strict=True):
        mantissa, _, exponent = expected.partition('e')
        digits = len(mantissa.partition('.')[2]) - int(exponent or 0)
        # Whole numbers are exact; the last digit of others may be rounded differently.
        atol = 0.0 if expected.lstrip('+-').isdigit() else 1.01 * 10.0**-digits
        assert abs(float(number) - float(expected)) <= atol, f'{number}, not {expected}; {both}'


@pytest.mark.parametrize('page', pages_with('python'))
def test_python_prints_the_stated_output(page, monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    names = {}
    for code, stated in blocks(page, 'python'):
        exec(code, names)
        assert_prints(capsys.readouterr().out, stated)


@pytest.mark.parametrize('page', pages_with('sh', long=LONG))
def test_commands_print_the_stated_output(page, monkeypatch, tmp_path, capsys):
    (tmp_path / 'config').symlink_to(ROOT / 'config')
    monkeypatch.chdir(tmp_path)
    for script, stated in blocks(page, 'sh'):
        for program, *arguments in commands(script):
            assert program == 'octo-arm', f'{program} is not run: that is a block of text'
            assert main(arguments) == 0, (arguments, capsys.readouterr().err)
        assert_prints(capsys.readouterr().out, stated)


@pytest.mark.parametrize('page', pages_with('sh', 'text'))
def test_options_of_commands_exist(page):
    for script, _ in blocks(page, 'sh', 'text'):
        if 'octo-arm ' in script:
            for words in commands(script):
                if 'octo-arm' in words:
                    build_parser().parse_args(words[words.index('octo-arm') + 1 :])


@pytest.mark.parametrize('page', pages_with('yaml'))
def test_configurations_are_valid(page, tmp_path):
    for number, (text, _) in enumerate(blocks(page, 'yaml')):
        file = tmp_path / f'{number}.yaml'
        file.write_text(text)
        load_config(file).solver()


def test_links_of_the_readme_exist():
    links = re.findall(r'\]\((?!http)([^)#]+)', PAGES[0].read_text())
    assert links
    missing = [link for link in links if not (ROOT / link).exists()]
    assert not missing
