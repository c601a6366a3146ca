"""Files and folders that commands write."""

from __future__ import annotations

import argparse
import os
import select
from pathlib import Path

from octo_arm_model.cli.output.files import check_out


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
