"""Bags for tests, made by rosbags itself."""

from __future__ import annotations

import functools
import hashlib
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer

from octo_arm_model import Arm, Config, load_config
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.bags.tensions import Reading, TensionTopic, read_topic
from octo_arm_model.bags.types import known_types
from octo_arm_model.config.presets import preset_path
from octo_arm_model.wire.tension_messages import TENSION_TOPICS, float32

START = 1_700_000_000 * 10**9  # [ns]
STEP = 10**6  # between messages [ns]
TOPICS = {f'/{topic}': kind.type_name for topic, kind in TENSION_TOPICS.items()}
TENDON_TENSIONS, ARRAY, JOINT_STATE = (
    TOPICS[f'/tendon_tensions{suffix}'] for suffix in ('', '/array', '/joint_state')
)
TYPES = known_types()
CONFIG = load_config(preset_path('renda2012_table4'))
ARM = CONFIG.arm
NAMES = ARM.tendon_names
# Hypothesis has no fixtures that last for all examples.
_FOLDER = tempfile.TemporaryDirectory()


class Sample(NamedTuple):
    """A message to be in a bag."""

    topic: str
    type_name: str
    received_ns: int
    data: bytes


def make(type_name: str, /, **fields: Any) -> Any:
    """A message object of rosbags."""
    return TYPES.types[type_name](**fields)


def header(stamp_ns: int, frame: str = 'of the load cells') -> Any:
    """A std_msgs/Header."""
    sec, nanosec = divmod(stamp_ns, 10**9)
    stamp = make('builtin_interfaces/msg/Time', sec=sec, nanosec=nanosec)
    return make('std_msgs/msg/Header', stamp=stamp, frame_id=frame)


def tensions_data(
    type_name: str, names: Sequence[str], tensions: Any, stamp_ns: int, **changes: Any
) -> bytes:
    """Bytes of a message of tensions [N]."""
    (kind,) = (one for one in TENSION_TOPICS.values() if one.type_name == type_name)
    number = np.float32 if kind.fields[kind.tensions] is float32 else np.float64
    fields: dict[str, Any] = dict.fromkeys(kind.fields, np.zeros(0, number))
    fields[kind.tensions] = np.array(tensions, dtype=number).ravel()
    if kind.has_stamp:
        fields['header'] = header(stamp_ns)
    if kind.names is None:
        fields['layout'] = make('std_msgs/msg/MultiArrayLayout', dim=[], data_offset=0)
    else:
        fields[kind.names] = list(names)
    message = make(type_name, **{**fields, **changes})
    return bytes(TYPES.serialize_cdr(message, type_name))


def samples(
    arm: Arm,
    rows: Iterable[Any],
    topic: str = '/tendon_tensions',
    type_name: str = TENDON_TENSIONS,
) -> list[Sample]:
    """Messages of the tensions ``rows`` of ``arm``, received a little after their stamps."""
    return [
        Sample(
            topic, type_name, START + i * STEP + 1000,
            tensions_data(type_name, arm.tendon_names, row, START + i * STEP),
        )
        for i, row in enumerate(rows)
    ]  # fmt: skip


def text_sample(topic: str, text: str, received_ns: int = START) -> Sample:
    """A std_msgs/String."""
    data = TYPES.serialize_cdr(make('std_msgs/msg/String', data=text), 'std_msgs/msg/String')
    return Sample(topic, 'std_msgs/msg/String', received_ns, bytes(data))


def write_bag(
    path: Path, content: Iterable[Sample], storage: str = 'mcap', version: int = 9
) -> Path:
    """Write a bag."""
    with Writer(path, version=version, storage_plugin=StoragePlugin[storage.upper()]) as writer:
        topics: dict[str, Any] = {}
        for topic, type_name, received_ns, data in content:
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, type_name, typestore=TYPES)
            writer.write(topics[topic], received_ns, data)
    return path


@functools.cache
def bag_of_all() -> Path:
    """A bag of a message of each type of tensions, on its topic, for as long as the tests run."""
    content = [one for topic, kind in TOPICS.items()
               for one in samples(ARM, np.ones((1, len(NAMES))), topic, kind)]  # fmt: skip
    return write_bag(Path(_FOLDER.name) / 'all', content)


def fingerprint(path: Path) -> dict[str, str]:
    """Hash of every file of a bag."""
    return {
        str(file.relative_to(path)): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in sorted(path.rglob('*'))
        if file.is_file()
    }


def random_tensions(arm: Arm, count: int, seed: int = 0, largest: float = 0.3) -> np.ndarray:
    """Sets of tensions [N] within the limits of the paper's arms, some tendons slack."""
    rng = np.random.default_rng(seed)
    rows = rng.uniform(0.0, largest, (count, *arm.tension_shape))
    return rows * (rng.random(rows.shape) < 0.6)


def readings_of(path: Path, topic: str = '/tendon_tensions') -> list[Reading]:
    """Tensions in the messages of a topic, for the arm of Table 4."""
    with BagReader(path) as reader:
        return tensions_in(reader, CONFIG, topic)


def tensions_in(
    reader: BagReader, config: Config, topic: str = '/tendon_tensions'
) -> list[Reading]:
    """Tensions in the messages of a topic."""
    found = read_topic(reader, topic, TensionTopic(reader, config).read)
    return [reading for _, reading in found]
