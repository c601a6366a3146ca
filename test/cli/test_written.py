"""What commands write: whole or as it was, also on a disk that is full; and their progress."""

import contextlib
import resource
from collections.abc import Iterator
from pathlib import Path

import pytest
from experiments import midline, one_tendon, path_sample, staircase_bag

from octo_arm_model.cli.files import writing

pytest.importorskip('matplotlib', reason='needs matplotlib')


def test_links_are_followed_and_devices_are_written_to(tmp_path):
    (tmp_path / 'there').mkdir()
    link = tmp_path / 'link.csv'
    link.symlink_to(tmp_path / 'there' / 'table.csv')
    with writing(link) as place:
        place.write_text('all')
    assert link.is_symlink() and (tmp_path / 'there' / 'table.csv').read_text() == 'all'
    with writing(Path('/dev/null')) as place:
        place.write_text('nothing')
    assert Path('/dev/null').is_char_device()


QUICK = '--clock-offset 0'
FITTED = f'identify BAG --model closed_form {QUICK}'
ESTIMATED = f'estimate BAG --contact none {QUICK}'
FILES = [
    'play fetching --csv OUT',
    'play fetching --plot OUT',
    'workspace renda2012_prototype --samples 64 --out OUT',
    f'{FITTED} --out OUT',
    f'{ESTIMATED} --plot OUT',
]
FOLDERS = [
    'reproduce OUT',
    f'compare BAG {QUICK} --out OUT',
    f'{FITTED} --csv OUT',
    f'{FITTED} --pictures OUT',
    'replay BAG NEW --csv OUT',
    f'{ESTIMATED} --csv OUT',
]
BAGS = [
    'replay BAG OUT',
    'replay BAG OUT --storage sqlite3',
    f'{ESTIMATED} --out OUT',
    'record-demo OUT',
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
def bag(tmp_path_factory):
    """A bag of three steps."""

    def see(tension, stamp_ns):
        return path_sample(midline('closed_form', one_tendon(tension), 21), stamp_ns)

    return staircase_bag(tmp_path_factory.mktemp('bags') / 'bag', (0.0, 1.09, 3.06), see)


def tree(folder: Path) -> dict[str, str]:
    """What is in a ``folder``: texts of files by their paths."""
    return {
        str(path.relative_to(folder)): path.read_text() if path.is_file() else ''
        for path in folder.rglob('*')
    }


def at(command: str, bag: Path, out: Path, new: Path) -> str:
    """A ``command`` with its paths."""
    return command.replace('BAG', str(bag)).replace('OUT', str(out)).replace('NEW', str(new))


@pytest.mark.parametrize('command', [*FILES, *FOLDERS, *BAGS])
def test_what_does_not_fit_is_not_there(command, bag, tmp_path, cli):
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
        with no_file_beyond(300):
            status, _, err = cli(at(command, bag, out, folder / 'bag'))
        assert status == 2 and ': cannot be written: ' in err.splitlines()[-1]
        assert tree(folder) == before


@pytest.mark.skipif(not Path('/dev/full').exists(), reason='needs a device that is full')
def test_a_device_that_is_full_is_named(cli):
    line = cli.refused('play', 'fetching', '--csv', '/dev/full')
    assert line.startswith('/dev/full: cannot be written: ')


@pytest.mark.parametrize('command', [FILES[0], FILES[2], FOLDERS[1], FOLDERS[4]])
def test_what_fits_takes_the_place_of_what_was_there(command, bag, tmp_path, cli):
    out = tmp_path / 'out'
    if command in FOLDERS:
        out.mkdir()
        (out / 'other').write_text('mine')
    else:
        out.write_text('before')
    assert cli(at(command, bag, out, tmp_path / 'new'))[0] == 0
    assert not [path for path in tmp_path.rglob('*') if path.name.startswith('.')]
    if command in FOLDERS:
        assert (out / 'other').read_text() == 'mine' and len(list(out.iterdir())) > 1
    else:
        assert b'before' not in out.read_bytes() and out.stat().st_mode & 0o444 == 0o444


@pytest.mark.parametrize(
    'command',
    [
        'compare BAG --out BAG/new',
        *(f'identify BAG {option} BAG/new' for option in ('--out', '--csv')),
        *(f'estimate BAG {out}' for out in ('--out BAG', '--out BAG/new', '--csv BAG')),
        'estimate BAG --plot BAG/touch.png',
        'replay BAG BAG/new',
        *(f'replay BAG FOLDER/new --csv {out}' for out in ('BAG', 'BAG/new')),
        'compare READ --out FOLDER',
        'compare --pose-csv FOLDER/midlines.csv --out FOLDER',
        'identify READ --csv FOLDER',
        'identify READ --out FOLDER/tensions.csv',
        'replay FOLDER/tensions.csv FOLDER/new --csv FOLDER',
        'estimate FOLDER/estimate.csv --csv FOLDER',
        'play FOLDER/turn.csv --csv FOLDER/turn.csv',
        'simulate renda2012_table4 FOLDER/turn.csv --density 1 --plot FOLDER/turn.csv',
    ],
)
def test_nothing_is_written_over_or_into_what_is_read(command, bag, tmp_path, cli):
    for name in ('tensions.csv', 'midlines.csv', 'estimate.csv', 'turn.csv'):
        (tmp_path / name).write_text('what was measured')
    before = tree(tmp_path), sorted(bag.iterdir())
    read = '--tension-csv FOLDER/tensions.csv --midline-csv FOLDER/midlines.csv'
    command = command.replace('READ', read).replace('BAG', str(bag))
    kept = bag if str(bag) in command else '.csv'
    said = cli.refused(command.replace('FOLDER', str(tmp_path)))
    assert f'{kept}, which stays as it is' in said
    assert (tree(tmp_path), sorted(bag.iterdir())) == before


def test_a_command_that_fails_leaves_no_empty_folder(cli, tmp_path):
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
