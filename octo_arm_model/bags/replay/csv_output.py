"""Answers of a replay as tidy CSV files, units in their headers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from octo_arm_model.bags.replay.answers import Answer
from octo_arm_model.bags.store.types import known_types
from octo_arm_model.bags.tensions import Reading
from octo_arm_model.bags.topics import ANSWERS
from octo_arm_model.config.csv_files import STATION_COLUMNS, CsvFiles, tension_columns
from octo_arm_model.wire.cdr.backbone import read_poses

STATIONS = ('topic', 'stamp [ns]', 'time [s]', *STATION_COLUMNS)


class CsvAnswers(CsvFiles):
    """Writes stations.csv, a row for each station of each answer, and tensions, a file a topic.

    The tensions are as `octo-arm play` reads them. Times count from the first answer.
    """

    def __init__(self, folder: Path, topics: Sequence[str]) -> None:
        """Write into ``folder`` the answers to tensions on ``topics``.

        Raises:
            OSError: if a file cannot be written.
        """
        super().__init__()
        self._stations = self.open(folder / 'stations.csv')
        self._stations.writerow(STATIONS)
        names = ['tensions.csv'] if len(topics) == 1 else [
            f'tensions{re.sub("[^A-Za-z0-9_]", "_", topic)}.csv' for topic in topics
        ]  # fmt: skip
        self._tensions = {topic: self.open(folder / name) for topic, name in zip(topics, names)}
        self._begun: set[str] = set()
        self._origin: int | None = None

    def write(
        self, topic: str, reading: Reading, answer: Answer, topics: Sequence[str],
        tendons: Sequence[str],
    ) -> None:  # fmt: skip
        """Write the ``answer`` to a ``reading``, whose messages are those on ``topics``.

        Raises:
            OSError: if it cannot be written.
        """
        if not answer.messages:
            return
        if self._origin is None:
            self._origin = reading.stamp_ns
        time = 1e-9 * (reading.stamp_ns - self._origin)
        if topic not in self._begun:
            self._begun.add(topic)
            self._tensions[topic].writerow(tension_columns(tendons))
        tensions = reading.tensions if answer.tensions is None else answer.tensions
        assert tensions is not None
        self._tensions[topic].writerow([round(time, 9), *tensions.ravel().tolist()])
        data = {name: bytes(one) for name, one in zip(topics, answer.messages) if one is not None}
        _, poses = read_poses(data['backbone/poses'])
        one: Any = known_types().deserialize_cdr(data['strains'], ANSWERS['strains'])
        table = np.column_stack([one.s, poses[:, :3], one.tau, one.xi, one.k, one.q])
        head = (topic, reading.stamp_ns, round(time, 9))
        self._stations.writerows([*head, *row] for row in table.tolist())
