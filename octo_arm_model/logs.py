"""What this package logs, shown by whatever program runs it."""

from __future__ import annotations

import logging
from collections.abc import Callable


class _Shown(logging.Handler):
    """Hands on every record to a function."""

    def __init__(self, show: Callable[[str, bool], object]) -> None:
        super().__init__(logging.INFO)
        self._show = show

    def emit(self, record: logging.LogRecord) -> None:
        self._show(record.getMessage(), record.levelno >= logging.WARNING)


def show_logs(show: Callable[[str, bool], object]) -> None:
    """Call ``show`` with the text of whatever is logged, and whether it is a warning."""
    logger = logging.getLogger('octo_arm_model')
    logger.handlers = [_Shown(show)]
    logger.setLevel(logging.INFO)
    logger.propagate = False
