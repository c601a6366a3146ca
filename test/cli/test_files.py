"""Files and folders that commands write."""

from __future__ import annotations

import argparse
import errno
import os
import select
from pathlib import Path

import pytest

from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.cli.files import check_out, writing


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
