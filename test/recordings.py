"""Write bags for tests with rosbags, and read them with the package."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

pytest.importorskip('rosbags', reason='needs rosbags')
from rosbags.rosbag2 import StoragePlugin, Writer

from octo_arm_model import Arm, Config, load_config
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.bags.topics import Reading, Source
from octo_arm_model.bags.types import known_types
from octo_arm_model.wire.tensions import TENSION_TOPICS

START = 1_700_000_000 * 10**9  # [ns]
STEP = 10**6  # time between messages [ns]
TOPICS = {f'/{topic}': kind.type_name for topic, kind in TENSION_TOPICS.items()}
TENDON_TENSIONS, ARRAY, JOINT_STATE = (
    TOPICS[f'/tendon_tensions{suffix}'] for suffix in ('', '/array', '/joint_state')
)
TYPES = known_types()
CONFIG = load_config('renda2012_table4')
ARM = CONFIG.arm
NAMES = ARM.tendon_names


class Sample(NamedTuple):
    """A message in a bag."""

    topic: str
    type_name: str
    received_ns: int
    data: bytes


def make(type_name: str, /, **fields: Any) -> Any:
    """Return a message object of rosbags."""
    return TYPES.types[type_name](**fields)


def header(stamp_ns: int, frame: str = 'load_cells') -> Any:
    """Return a std_msgs/Header."""
    sec, nanosec = divmod(stamp_ns, 10**9)
    stamp = make('builtin_interfaces/msg/Time', sec=sec, nanosec=nanosec)
    return make('std_msgs/msg/Header', stamp=stamp, frame_id=frame)


def tensions_data(
    type_name: str, names: Sequence[str], tensions: Any, stamp_ns: int, **changes: Any
) -> bytes:
    """Return the bytes of a message of tensions [N]."""
    (kind,) = (each for each in TENSION_TOPICS.values() if each.type_name == type_name)
    number = '<f4' if 'Float32' in type_name else '<f8'
    field_names = TYPES.types[type_name].__dataclass_fields__
    fields: dict[str, Any] = dict.fromkeys(field_names, np.zeros(0, number))
    fields[kind.tensions] = np.array(tensions, dtype=number).ravel()
    if kind.names is None:
        fields['layout'] = make('std_msgs/msg/MultiArrayLayout', dim=[], data_offset=0)
    else:
        fields['header'], fields[kind.names] = header(stamp_ns), list(names)
    fields.pop('__msgtype__', None)
    message = make(type_name, **{**fields, **changes})
    return bytes(TYPES.serialize_cdr(message, type_name))


def samples(
    arm: Arm,
    rows: Iterable[Any],
    topic: str = '/tendon_tensions',
    type_name: str = TENDON_TENSIONS,
) -> list[Sample]:
    """Return messages of the tensions ``rows`` of ``arm``, received shortly after their stamps."""
    return [
        Sample(
            topic,
            type_name,
            START + i * STEP + 1000,
            tensions_data(type_name, arm.tendon_names, row, START + i * STEP),
        )
        for i, row in enumerate(rows)
    ]


def message(topic: str, kind: str, received_ns: int, **fields: Any) -> Sample:
    """Return a sample with a message of a ``kind``."""
    return Sample(topic, kind, received_ns, bytes(TYPES.serialize_cdr(make(kind, **fields), kind)))


def point(at: Sequence[float], kind: str = 'Point') -> Any:
    """Return a geometry_msgs/Point, or another ``kind`` with x, y and z."""
    x, y, z = map(float, at)
    return make(f'geometry_msgs/msg/{kind}', x=x, y=y, z=z)


def quaternion(turned: Sequence[float]) -> Any:
    """Return a geometry_msgs/Quaternion."""
    x, y, z, w = map(float, turned)
    return make('geometry_msgs/msg/Quaternion', x=x, y=y, z=z, w=w)


def pose(at: Sequence[float], turned: Sequence[float] = (0.0, 0.0, 0.0, 1.0)) -> Any:
    """Return a geometry_msgs/Pose."""
    return make('geometry_msgs/msg/Pose', position=point(at), orientation=quaternion(turned))


def displacement_sample(
    names: Sequence[str],
    displacements: Any,
    stamp_ns: int,
    topic: str = '/tendon_displacements',
    delay: int = 0,
) -> Sample:
    """Return a reading of encoders, received a ``delay`` [ns] after its stamp."""
    empty = np.zeros(0)
    return message(
        topic,
        JOINT_STATE,
        stamp_ns + delay,
        header=header(stamp_ns),
        name=list(names),
        position=np.array(displacements, float),
        velocity=empty,
        effort=empty,
    )


def text_sample(topic: str, text: str, received_ns: int = START) -> Sample:
    """Return a std_msgs/String."""
    return message(topic, 'std_msgs/msg/String', received_ns, data=text)


def write_bag(
    path: Path, content: Iterable[Sample], storage: str = 'mcap', silent: Mapping[str, str] = {}
) -> Path:
    """Write a bag; ``silent`` has the types of further topics without messages."""
    with Writer(path, version=9, storage_plugin=StoragePlugin[storage.upper()]) as writer:
        topics: dict[str, Any] = {}
        for topic, type_name in silent.items():
            writer.add_connection(topic, type_name, typestore=TYPES)
        for topic, type_name, received_ns, data in content:
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, type_name, typestore=TYPES)
            writer.write(topics[topic], received_ns, data)
    return path


def random_tensions(arm: Arm, count: int) -> np.ndarray:
    """Return sets of tensions [N] within the limits of the paper's arms, some of them 0."""
    rng = np.random.default_rng(0)
    rows = rng.uniform(0.0, 0.3, (count, *arm.tension_shape))
    return rows * (rng.random(rows.shape) < 0.6)


def readings_of(path: Path, topic: str = '/tendon_tensions') -> list[Reading]:
    """Read the tensions in the messages of a topic, for the arm of Table 4."""
    with BagReader(path) as reader:
        return tensions_in(reader, CONFIG, topic)


def tensions_in(
    reader: BagReader, config: Config, topic: str = '/tendon_tensions'
) -> list[Reading]:
    """Read the tensions in the messages of a topic."""
    return [Source(topic).read(reader, config, each) for each in reader.messages([topic])]


def assert_alike(actual: Sequence[bytes], expected: Sequence[bytes]) -> None:
    """Check that messages are equal except for the rounding of their numbers."""
    for data, other in zip(actual, expected, strict=True):
        assert len(data) == len(other) and data[:12] == other[:12]  # the stamp too
        # Reads everything after the encapsulation as numbers; other fields are equal anyway.
        numbers = [np.frombuffer(each, '<f8', (len(each) - 4) // 8, 4) for each in (data, other)]
        np.testing.assert_allclose(*numbers, rtol=1e-9, atol=1e-9)
