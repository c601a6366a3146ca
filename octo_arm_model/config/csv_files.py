"""CSV files as they are written, and what those read and written share."""

from __future__ import annotations

import contextlib
import csv
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

# As in JSON and YAML; Python would also read 1_000 and the digits of other scripts.
NUMBER = re.compile(r'\s*[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?\s*$')
# Of the stations of a backbone.
STATION_COLUMNS = (
    's [m]', 'x [m]', 'y [m]', 'z [m]', 'tau [1/m]', 'xi [1/m]', 'k [1/m]', 'q [-]'
)  # fmt: skip


class CsvFiles(contextlib.ExitStack):
    """Files that are open together, until the block ends."""

    def open(self, path: Path) -> Any:
        """Writer of a new file.

        Raises:
            OSError: if it cannot be written.
        """
        file = self.enter_context(path.open('w', encoding='utf-8', newline=''))
        return csv.writer(file, lineterminator='\n')


def tension_columns(tendons: Sequence[str]) -> tuple[str, ...]:
    """Columns of tensions over time, as a command profile has them."""
    return ('time [s]', *(f'{name} [N]' for name in tendons))
