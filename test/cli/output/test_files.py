"""Files and folders that commands write."""

from __future__ import annotations

import argparse
import errno
import os
import select
from pathlib import Path

import pytest

from octo_arm_model.cli.output.files import check_out, writing
from octo_arm_model.core.errors import ConfigError


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


def test_what_ends_the_writing_says_what_is_not_whole(tmp_path: Path) -> None:
    path = tmp_path / 'tables'
    with pytest.raises(ConfigError, match='tables: cannot be written whole: Disk is full'):
        with writing(path):
            raise OSError(errno.ENOSPC, 'Disk is full')
    with pytest.raises(KeyboardInterrupt, match='tables is not whole'), writing(path):
        raise KeyboardInterrupt
    # What names its file, and the end of a reader, are said elsewhere.
    with pytest.raises(FileNotFoundError), writing(path):
        (path / 'none').write_text('')
    with pytest.raises(BrokenPipeError), writing(path):
        raise BrokenPipeError(errno.EPIPE, 'nobody reads')
