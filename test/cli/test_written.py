"""What commands write: whole or as it was, also on a disk that is full; and their progress."""

from __future__ import annotations

import argparse
import contextlib
import errno
import io
import os
import resource
import select
from collections.abc import Iterator
from pathlib import Path

import pytest
from command_line import Cli, Terminal

from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.cli.files import Bar, check_out, writing

pytest.importorskip('rosbags', reason='needs rosbags')
pytest.importorskip('matplotlib')

from experiments import midline, one_tendon, path_sample, staircase_bag
from recordings import Sample


def test_a_pipe_is_not_opened_before_the_work(tmp_path: Path) -> None:
    pipe = tmp_path / 'pipe'
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        check_out(argparse.Namespace(out=pipe, made=[]), '--out', folder=False)
        heard = select.poll()
        heard.register(reader, select.POLLIN)
        # After a writer that has come and gone a pipe is at its end.
        assert not heard.poll(0)
    finally:
        os.close(reader)


def test_a_file_is_there_whole_or_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / 'table.csv'
    path.write_text('before')
    with pytest.raises(ConfigError, match=r'table\.csv: cannot be written: Disk is full'):
        with writing(path) as place:
            place.write_text('half')
            assert path.read_text() == 'before' and place.suffix == '.csv'
            raise OSError(errno.ENOSPC, 'Disk is full')
    with pytest.raises(KeyboardInterrupt, match=r'no .*table\.csv written'), writing(path):
        raise KeyboardInterrupt
    with pytest.raises(BrokenPipeError), writing(path):
        raise BrokenPipeError(errno.EPIPE, 'nobody reads')
    with pytest.raises(FileNotFoundError), writing(path):  # of another file, which it names
        (tmp_path / 'none').read_text()
    assert [one.name for one in tmp_path.iterdir()] == ['table.csv']
    assert path.read_text() == 'before'
    with writing(path) as place:
        place.write_text('after')
    assert path.read_text() == 'after'


def test_a_folder_has_all_files_or_those_it_had(tmp_path: Path) -> None:
    folder = tmp_path / 'tables'
    folder.mkdir()
    (folder / 'a.csv').write_text('before')
    with pytest.raises(ConfigError, match='tables: cannot be written: Disk is full'):
        with writing(folder, folder=True) as place:
            (place / 'a.csv').write_text('half')
            raise OSError(errno.ENOSPC, 'Disk is full')
    assert [one.read_text() for one in folder.iterdir()] == ['before']
    with writing(folder, folder=True) as place:
        for name in ('a.csv', 'b.csv'):
            (place / name).write_text('after')
    assert {one.name: one.read_text() for one in folder.iterdir()} == {
        'a.csv': 'after', 'b.csv': 'after',
    }  # fmt: skip


def test_links_are_followed_and_devices_are_written_to(tmp_path: Path) -> None:
    (tmp_path / 'there').mkdir()
    link = tmp_path / 'link.csv'
    link.symlink_to(tmp_path / 'there' / 'table.csv')
    with writing(link) as place:
        place.write_text('all')
    assert link.is_symlink() and (tmp_path / 'there' / 'table.csv').read_text() == 'all'
    with writing(Path('/dev/null')) as place:
        place.write_text('nothing')
    assert Path('/dev/null').is_char_device()


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
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag of three steps."""

    def see(tension: float, stamp_ns: int) -> Sample:
        return path_sample(midline('closed_form', one_tendon(tension), 21), stamp_ns)

    return staircase_bag(tmp_path_factory.mktemp('bags') / 'bag', (0.0, 1.09, 3.06), see)


def tree(folder: Path) -> dict[str, str]:
    """What is in a ``folder``: texts of files by their paths."""
    return {
        str(path.relative_to(folder)): path.read_text() if path.is_file() else ''
        for path in folder.rglob('*')
    }


@pytest.mark.parametrize('command', [*FILES, *FOLDERS, *BAGS], ids=' '.join)
def test_what_does_not_fit_is_not_there(
    command: list[str], bag: Path, tmp_path: Path, cli: Cli
) -> None:
    for name in ('new', 'old') if command in BOTH else ('old',):
        folder = tmp_path / name
        out = folder / 'deep' / 'out'
        folder.mkdir()
        if command in BAGS or name == 'old':
            out.parent.mkdir()
        if command in FILES and name == 'old':
            out.write_text('before')
        if command in FOLDERS and name == 'old':
            out.mkdir()
            for table in ('compare.csv', 'stations.csv', 'estimate.csv', 'renda2012.html'):
                (out / table).write_text('before')
        before = tree(folder)
        places = {'BAG': bag, 'OUT': out, 'NEW': folder / 'bag'}
        with no_file_beyond(300):
            status, _, err = cli(*(places.get(word, word) for word in command))
        assert status == 2 and ': cannot be written: ' in err.splitlines()[-1]
        assert tree(folder) == before


@pytest.mark.skipif(not Path('/dev/full').exists(), reason='needs a device that is full')
def test_a_device_that_is_full_is_named(cli: Cli) -> None:
    line = cli.refused('play', 'fetching', '--csv', '/dev/full')
    assert line.startswith('/dev/full: cannot be written: ')


@pytest.mark.parametrize('command', [FILES[0], FILES[2], FOLDERS[1], FOLDERS[4]], ids=' '.join)
def test_what_fits_takes_the_place_of_what_was_there(
    command: list[str], bag: Path, tmp_path: Path, cli: Cli
) -> None:
    out = tmp_path / 'out'
    if command in FOLDERS:
        out.mkdir()
        (out / 'other').write_text('mine')
    else:
        out.write_text('before')
    places = {'BAG': bag, 'OUT': out, 'NEW': tmp_path / 'new'}
    assert cli(*(places.get(word, word) for word in command))[0] == 0
    assert not [path for path in tmp_path.rglob('*') if path.name.startswith('.')]
    if command in FOLDERS:
        assert (out / 'other').read_text() == 'mine' and len(list(out.iterdir())) > 1
    else:
        assert b'before' not in out.read_bytes() and out.stat().st_mode & 0o444 == 0o444


def test_nothing_is_written_over_or_into_the_bag(bag: Path, cli: Cli) -> None:
    before = sorted(bag.iterdir())
    new = bag / 'new'
    for command, option, path in (
        ('compare', '--out', new), ('identify', '--out', new), ('identify', '--csv', new),
        ('estimate', '--out', bag), ('estimate', '--out', new), ('estimate', '--csv', bag),
        ('estimate', '--plot', bag / 'touch.png'),
    ):  # fmt: skip
        line = cli.refused(command, bag, option, path)
        assert f'{bag}, which stays as it is' in line
    assert sorted(bag.iterdir()) == before


def test_a_command_that_fails_leaves_no_empty_folder(cli: Cli, tmp_path: Path) -> None:
    kept, new, file = tmp_path / 'kept', tmp_path / 'new', tmp_path / 'file'
    kept.mkdir()
    file.touch()
    for command in ('compare', 'identify', 'replay', 'estimate'):
        given = [command, tmp_path / 'nowhere', *([tmp_path / 'out'] * (command == 'replay'))]
        option = '--out' if command == 'compare' else '--csv'
        for folder in (kept / 'deep' / 'tables', new / 'tables'):
            assert 'no such bag' in cli.refused(*given, option, folder)
        assert f'{option} is ' in cli.refused(*given, option, file)
    assert kept.exists() and not list(kept.iterdir()) and not new.exists()


def test_a_terminal_shows_a_bar_with_rate_and_remaining_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr('octo_arm_model.terminal._PERIOD', 0.0)
    stream = Terminal()
    with Bar('sets of tensions', stream) as bar:
        for done in (0, 64, 128):
            bar(done, 128)
        bar.leave()
    start, half, end = stream.getvalue().replace('\x1b[K', '').split('\r')[1:]
    assert start == f'[{"." * 30}] 0/128, 0/s, starting'
    assert half.startswith(f'[{"#" * 15}{"." * 15}] 64/128, ')
    assert half.endswith(' s left')
    assert end.startswith('128 sets of tensions in ')
    assert end.count('\n') == 1


def test_elsewhere_progress_is_one_line_at_the_end() -> None:
    stream = io.StringIO()
    with Bar('messages', stream) as bar:
        for done in range(4):
            bar(done, 3)
    assert stream.getvalue().startswith('3 messages in ')
    assert stream.getvalue().count('\n') == 1
