"""Files that commands write on a disk that is full: one line, and each is whole or as it was."""

from __future__ import annotations

import contextlib
import resource
from collections.abc import Iterator
from pathlib import Path

import pytest
from command_line import run

pytest.importorskip('rosbags', reason='needs rosbags')
pytest.importorskip('matplotlib')
from experiments import midline, one_tendon, path_sample, staircase_bag
from recordings import Sample

QUICK = ['--clock-offset', '0']
FITTED = ['identify', 'BAG', '--model', 'closed_form', *QUICK]
ESTIMATED = ['estimate', 'BAG', '--contact', 'none', *QUICK]
FILES = [
    ['play', 'fetching', '--csv', 'OUT'],
    ['play', 'fetching', '--plot', 'OUT'],
    ['workspace', 'renda2012_prototype', '--samples', '64', '--out', 'OUT'],
    [*FITTED, '--out', 'OUT'],
    [*ESTIMATED, '--plot', 'OUT'],
]
FOLDERS = [
    ['reproduce', 'OUT'],
    ['compare', 'BAG', *QUICK, '--out', 'OUT'],
    [*FITTED, '--csv', 'OUT'],
    [*FITTED, '--pictures', 'OUT'],
    ['replay', 'BAG', 'NEW', '--csv', 'OUT'],
    [*ESTIMATED, '--csv', 'OUT'],
]
BAGS = [
    ['replay', 'BAG', 'OUT'],
    ['replay', 'BAG', 'OUT', '--storage', 'sqlite3'],
    [*ESTIMATED, '--out', 'OUT'],
    ['record-demo', 'OUT'],
]

# One of each also where nothing is yet.
BOTH = [FILES[0], FOLDERS[1], BAGS[0]]


@contextlib.contextmanager
def no_file_beyond(size: int) -> Iterator[None]:
    """No file of this process grows beyond ``size`` bytes meanwhile."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A bag of three steps."""

    def see(tension: float, stamp_ns: int) -> Sample:
        return path_sample(midline('closed_form', one_tendon(tension), 21), stamp_ns)

    return str(staircase_bag(tmp_path_factory.mktemp('bags') / 'bag', (0.0, 1.09, 3.06), see))


def tree(folder: Path) -> dict[str, str]:
    """What is in a ``folder``: texts of files by their paths."""
    return {
        str(path.relative_to(folder)): path.read_text() if path.is_file() else ''
        for path in folder.rglob('*')
    }


@pytest.mark.parametrize('command', [*FILES, *FOLDERS, *BAGS], ids=' '.join)
def test_what_does_not_fit_is_not_there(
    command: list[str], bag: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    new, old = tmp_path / 'new', tmp_path / 'old'
    for folder in (new, old) if command in BOTH else (old,):
        out = folder / 'deep' / 'out'
        folder.mkdir()
        if command in BAGS or folder.name == 'old':
            out.parent.mkdir()
        if command in FILES and folder.name == 'old':
            out.write_text('before')
        if command in FOLDERS and folder.name == 'old':
            out.mkdir()
            for name in ('compare.csv', 'stations.csv', 'estimate.csv', 'renda2012.html'):
                (out / name).write_text('before')
        before = tree(folder)
        places = {'BAG': bag, 'OUT': str(out), 'NEW': str(folder / 'bag')}
        with no_file_beyond(300):
            status, _, err = run(capsys, *(places.get(word, word) for word in command))
        assert status == 2
        assert ': cannot be written: ' in err.splitlines()[-1]
        assert tree(folder) == before


@pytest.mark.parametrize('command', [FILES[0], FILES[2], FOLDERS[1], FOLDERS[4]], ids=' '.join)
def test_what_fits_takes_the_place_of_what_was_there(
    command: list[str], bag: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / 'out'
    places = {'BAG': bag, 'OUT': str(out), 'NEW': str(tmp_path / 'new')}
    if command in FOLDERS:
        out.mkdir()
        (out / 'other').write_text('mine')
    else:
        out.write_text('before')
    assert run(capsys, *(places.get(word, word) for word in command))[0] == 0
    assert not [path for path in tmp_path.rglob('*') if path.name.startswith('.')]
    if command in FOLDERS:
        assert (out / 'other').read_text() == 'mine' and len(list(out.iterdir())) > 1
    else:
        assert b'before' not in out.read_bytes() and out.stat().st_mode & 0o444 == 0o444
