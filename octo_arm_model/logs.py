"""Log records of this package, passed to the program that runs it."""

from __future__ import annotations

import logging
from collections.abc import Callable


class _Shown(logging.Handler):
    """Calls a function for every record."""

    def __init__(self, show: Callable[[str, bool], object]) -> None:
        super().__init__(logging.INFO)
        self._show = show

    def emit(self, record: logging.LogRecord) -> None:
        self._show(record.getMessage(), record.levelno >= logging.WARNING)


def show_logs(show: Callable[[str, bool], object]) -> None:
    """Call ``show`` with the text of each record, and whether it is a warning or an error."""
    logger = logging.getLogger('octo_arm_model')
    logger.handlers = [_Shown(show)]
    logger.setLevel(logging.INFO)
    logger.propagate = False
