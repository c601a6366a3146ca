"""How many times faster than it was recorded a bag of tensions at 1 kHz is replayed.

On one core, for the arm of Table 4. Every message of the recording is another set of tensions.
Written is the answer of the node: path, poses, strains and tip pose of 101 stations, 19 kB for
every message, beside a copy of the message itself.

    python benchmarks/bags.py [--brief] [--seconds 60] [--folder /dev/shm]
"""

from __future__ import annotations

import functools
import os
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

# One thread of BLAS too, which reads this when it is loaded.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import numpy as np
from brief import IS_BRIEF, make_parser

from octo_arm_model import Config, load_config
from octo_arm_model.bags.arms import find_arms
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.bags.replay import replay
from octo_arm_model.bags.tensions import TYPES, read_tensions
from octo_arm_model.bags.types import known_types
from octo_arm_model.bags.writer import STORAGES, BagWriter
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.config.parameter_files import load_parameters, preset_path

RATE = 1000.0  # [Hz]
WANTED = 10.0  # times real time
NOISE = 0.01  # of the tensions [N]
PRESET = preset_path('renda2012_table4')


def record(path: Path, config: Config, count: int, storage: str) -> None:
    """Write a bag of ``count`` messages: fetching movements, with noise."""
    types, rng, name = known_types(), np.random.default_rng(0), TYPES[0]
    make = types.types
    names = list(config.arm.tendon_names)
    pulled = np.array(FETCHING_IN_SPACE).ravel()
    with BagWriter(path, storage) as writer:
        topic = writer.add('/tendon_tensions', name)

        def message(number: int) -> tuple[Any, int, bytes]:
            time_ns = 10**18 + round(number * 1e9 / RATE)
            stamp = make['builtin_interfaces/msg/Time'](*divmod(time_ns, 10**9))
            header = make['std_msgs/msg/Header'](stamp=stamp, frame_id='arm_base')
            part = 0.5 - 0.5 * np.cos(2.0 * np.pi * number / (5.0 * RATE))
            tension = np.abs(part * pulled + NOISE * rng.standard_normal(pulled.size))
            sample = make[name](header=header, name=names, tension=tension)
            return topic, time_ns, bytes(types.serialize_cdr(sample, name))

        writer.write(message(number) for number in range(count))


def clock(work: Callable[[], object]) -> tuple[float, float]:
    """Seconds that ``work`` takes, and the processor time of it [s]."""
    began, worked = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - began, time.process_time() - worked


def replay_all(source: Path, out: Path, storage: str, model: str) -> None:
    """Replay with copies."""
    with BagReader(source) as reader:
        arms = find_arms(reader, parameters=load_parameters(PRESET), model=model)
        with BagWriter(out, storage) as writer:
            replay(reader, writer, arms)


def read_all(source: Path, config: Config) -> None:
    """Read all tensions."""
    with BagReader(source) as reader:
        for record in reader.messages(['/tendon_tensions']):
            read_tensions(reader, config, '', record)


def main() -> None:
    """Record, replay and print a table."""
    parser = make_parser(__doc__)
    length = 0.1 if IS_BRIEF else 20.0
    parser.add_argument('--seconds', type=float, default=length, help='of the recording')
    parser.add_argument('--folder', type=Path, help='where to write (default: that of temp files)')
    options = parser.parse_args()
    if hasattr(os, 'sched_setaffinity'):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    config = load_config(PRESET)
    count = round(options.seconds * RATE)
    print(f'{count} messages at {RATE:g} Hz, load of the machine {os.getloadavg()[0]:.1f}\n')
    print('| storage | model | us a message: wall, CPU | times real time: wall, CPU |')
    print('| --- | --- | --- | --- |')
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        for storage in STORAGES:
            source, out = Path(folder) / f'in_{storage}', Path(folder) / 'out'
            record(source, config, count, storage)
            taken = clock(functools.partial(read_all, source, config))
            row(storage, 'none, read alone', taken, count)
            for model in ('renda2012', 'closed_form'):
                taken = clock(functools.partial(replay_all, source, out, storage, model))
                shutil.rmtree(out)
                row(storage, model, taken, count)


def row(storage: str, what: str, taken: tuple[float, float], count: int) -> None:
    """Print a line of the table."""
    times = ', '.join(f'{1e6 * seconds / count:.1f}' for seconds in taken)
    ratios = ', '.join(f'{count / RATE / seconds:.1f}' for seconds in taken)
    print(f'| {storage} | {what} | {times} | {ratios} (wanted {WANTED:g}) |')


if __name__ == '__main__':
    main()
