"""Bags read: rosbag2 folders of any version, and single files of their storages."""

import contextlib
import functools
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any, NamedTuple, TypeVar

import yaml
from rosbags.interfaces import Connection, MessageDefinitionFormat
from rosbags.typesys.store import Typestore

from octo_arm_model.arm.errors import BagError, OctoArmError, listed, shown
from octo_arm_model.arm.limits import MAX_YAML_BYTES
from octo_arm_model.bags import storages
from octo_arm_model.bags.storages import check_file, checked_yaml
from octo_arm_model.bags.types import numeric_fields, types_for
from octo_arm_model.wire.messages import Stamp

METADATA = 'metadata.yaml'
_ROOT = 'rosbag2_bagfile_information'
_KINDS: dict[type, str] = {int: 'an integer', str: 'text', list: 'a list', dict: 'a map'}
_MODES = ('', 'none', 'file', 'message')
Key = tuple[str, str]  # a topic and the type of messages on it


def read_metadata(folder: Path) -> tuple[list[Path], Counter[Key], bool, dict[str, str]]:
    """What the bag in ``folder`` says of itself.

    Its files, the messages of each topic and type, whether each is compressed by zstd, and data of
    its recording.

    Raises:
        BagError: if it is no YAML, or too large.
        ValueError: if a field is missing or of another type, or a file is named twice.
        OSError: if it cannot be read.
    """
    path = folder / METADATA
    check_file(path)
    if (size := path.stat().st_size) > MAX_YAML_BYTES:
        raise ValueError(f'{METADATA} has {size} bytes, at most {MAX_YAML_BYTES} are read')
    text = path.read_text(encoding='utf-8')
    about = _take(_checked(checked_yaml(text, METADATA), dict, _ROOT), _ROOT, dict)
    # The folder may have been moved, whatever it was called.
    files = [
        folder / PurePath(_checked(one, str, f'relative_file_paths[{number}]')).name
        for number, one in enumerate(_take(about, 'relative_file_paths', list))
    ]
    for number, file in enumerate(files):
        if file in files[:number]:
            where = f'relative_file_paths[{number}]'
            raise ValueError(f'{METADATA}: {where} is {shown(file.name)}, expected each file once')
    counts = Counter[Key]()
    for number, one in enumerate(_take(about, 'topics_with_message_count', list)):
        where = f'topics_with_message_count[{number}]'
        count = _take(_checked(one, dict, where), 'message_count', int, where)
        if not 0 <= count < 2**63:
            raise ValueError(
                f'{METADATA}: {where}.message_count is {count}, expected 0 to {2**63 - 1}'
            )
        topic, where = _take(one, 'topic_metadata', dict, where), f'{where}.topic_metadata'
        counts[_take(topic, 'name', str, where), _take(topic, 'type', str, where)] += count
    mode = _take({'compression_mode': '', **about}, 'compression_mode', str).lower()
    if mode not in _MODES:
        wanted = ', '.join(_MODES[1:])
        raise ValueError(
            f'{METADATA}: compression_mode is {shown(mode)}, expected one of {wanted}'
        )
    if mode in _MODES[2:] and _take(about, 'compression_format', str) != 'zstd':
        found = shown(about['compression_format'])
        raise ValueError(f'{METADATA}: compression_format is {found}, expected zstd')
    return files, counts, mode == 'message', _custom_data(about, text)


def _take(values: Mapping[str, Any], field: str, kind: type, where: str = '') -> Any:
    """The ``field`` at ``where``, of a ``kind``; ValueError if it is missing or of another."""
    place = f'{where}.{field}'.removeprefix('.')
    if field not in values:
        raise ValueError(f'{METADATA}: {place} is missing')
    return _checked(values[field], kind, place)


def _checked(value: Any, kind: type, place: str) -> Any:
    if not isinstance(value, kind) or isinstance(value, bool):
        is_plain = isinstance(value, str | int | float | None)
        found = shown(value) if is_plain else type(value).__name__
        raise ValueError(f'{METADATA}: {place} is {found}, expected {_KINDS[kind]}')
    return value


def _custom_data(about: Mapping[str, Any], text: str) -> dict[str, str]:
    """Custom data, each entry as it is written: the recorder puts no quotes around 007 or true."""
    if about.get('custom_data') is None:
        return {}
    _take(about, 'custom_data', dict)
    written: dict[str, str] = yaml.load(text, yaml.BaseLoader)[_ROOT]['custom_data']
    for key in written:
        _take(written, key, str, 'custom_data')
    return written


class Record(NamedTuple):
    """A message as it is stored in a bag.

    Attributes:
        topic: where it was published.
        type_name: its type, such as 'nav_msgs/msg/Path'.
        received_ns: when the recorder received it [ns].
        data: its bytes, as ROS 2 sends them.
    """

    topic: str
    type_name: str
    received_ns: int
    data: bytes


def stamp_of(message: Any, received_ns: int) -> Stamp:
    """Stamp of a decoded message: that of its header, as the node takes it.

    The time of receipt where it has no header, or an unset stamp.
    """
    header = getattr(message, 'header', None)
    if header is not None and (header.stamp.sec or header.stamp.nanosec):
        return Stamp.of(header.stamp)
    return Stamp.from_ns(received_ns)


T = TypeVar('T')
_MOST_TOGETHER = 8  # files of a bag that are read at once
_LONGEST = 500  # characters of what a parser complains of, which may be all that it was given


class BagReader(contextlib.AbstractContextManager['BagReader']):
    """A bag open for reading only.

    Attributes:
        path: where it is.
        topics: type of the messages of each topic; of several types, all of them.
        offered: those of them that what is not named is read from.
        metadata: custom data of its recording.
        start_ns: when its first message was received [ns].
        duration: from its first message to its last [s].
        notes: remarks on its state.
    """

    def __init__(self, path: str | Path) -> None:
        """Open the bag at ``path``: a folder, an .mcap or a .db3 file.

        A folder without metadata.yaml is read if it has files of bags.

        Raises:
            BagError: if it is none, or is damaged.
        """
        self.path = Path(path)
        if not self.path.exists():
            raise BagError(f'{self.path}: no such bag')
        self.metadata: dict[str, str] = {}
        self.notes: list[str] = []
        self._stores: dict[str, Typestore] = {}
        self._is_each_compressed = False
        with contextlib.ExitStack() as opened, self._damage():
            said = None
            paths = [self.path]
            if self.path.is_dir() and (self.path / METADATA).exists():
                paths, said, self._is_each_compressed, self.metadata = read_metadata(self.path)
            elif self.path.is_dir():
                paths = self._alone()
            folder = Path(opened.enter_context(tempfile.TemporaryDirectory()))
            self._files: list[storages.File] = []
            for one in paths:
                self._files.append(storages.open_file(one, folder))
                opened.callback(self._files[-1].close)
            self._look(said)
            self._opened = opened.pop_all()

    def _alone(self) -> list[Path]:
        """Files of a folder without metadata, as a recording leaves them that did not end."""
        names = '*.mcap', '*.db3', '*.mcap.zstd', '*.db3.zstd'
        paths = sorted(file for name in names for file in self.path.glob(name))
        if not paths:
            raise BagError(
                f'{self.path}: not a bag: neither {METADATA} nor .mcap or .db3 files in it'
            )
        self.notes.append(
            f'no {METADATA}: {len(paths)} file(s) are read, and nothing says whether there were '
            'more; `ros2 bag reindex` writes it'
        )
        return paths

    def _look(self, said: Counter[Key] | None) -> None:
        """Collect topics and counts; ValueError if files do not have what the bag ``said``."""
        self._counts = Counter[Key]()
        found: dict[Key, Connection] = {}
        for file in self._files:
            for one in file.connections:
                key = one.topic, one.msgtype
                if not (one.topic.isprintable() and one.msgtype.isprintable()):
                    raise ValueError(f'{shown(one.topic)} names a topic or a type')
                self._counts[key] += one.msgcount
                if key not in found or found[key].msgdef.format == MessageDefinitionFormat.NONE:
                    found[key] = one
            if file.missing:
                count = sum(one.msgcount for one in file.connections) + file.missing
                self.notes.append(
                    f'{file.path.name}: {file.missing} message(s) of {count} are not there, by '
                    'their numbers: deleted or lost'
                )
        self._connections = list(found.values())
        self.topics = {
            topic: ' or '.join(sorted(kind for name, kind in found if name == topic))
            for topic in sorted(topic for topic, _ in found)
        }
        self.offered = self.topics
        if said is not None:
            self._compare(said)
        some = [file for file in self._files if any(one.msgcount for one in file.connections)]
        self.start_ns = min((file.start_ns for file in some), default=0)
        self.duration = 1e-9 * (max((file.stop_ns for file in some), default=0) - self.start_ns)

    def _compare(self, said: Counter[Key]) -> None:
        """Check counts against those that the metadata ``said``; ValueError if some are lost."""
        for key in self._counts | said:
            topic, count, expected = key[0], self._counts[key], said[key]
            if count < expected:
                raise ValueError(f'{count} messages found of {expected} on {topic}')
            if count > expected and key not in said:
                raise ValueError(f'{count} messages of {key[1]} on {topic} that it does not list')
            if count > expected:
                self.notes.append(f'{topic}: {count} messages, more than the {expected} it says')

    def __exit__(self, *_: object) -> None:
        """Close it."""
        self.close()

    def close(self) -> None:
        """Close it."""
        self._opened.close()

    @contextlib.contextmanager
    def _damage(self) -> Iterator[None]:
        """Errors of any type that parsers raise for damaged bytes, as one line."""
        try:
            yield
        except PermissionError:
            raise
        except Exception as error:
            if isinstance(error, BagError) and str(error).startswith(f'{self.path}: '):
                raise
            problem = ' '.join(str(error)[:_LONGEST].split()) or type(error).__name__
            raise BagError(f'{self.path}: not a bag, cut short or damaged: {problem}') from error

    def connections(self, topics: Sequence[str] | None = None) -> list[Connection]:
        """Connections of rosbags of ``topics``, of all if None: definitions, policies.

        Raises:
            BagError: if there is no such topic; the message lists those there are.
        """
        if topics is None:
            return self._connections
        for topic in topics:
            if topic not in self.topics:
                raise BagError(f'{self.path}: no topic {topic}; {self.listing}')
        return [connection for connection in self._connections if connection.topic in topics]

    def full_name(self, topic: str) -> str:
        """The ``topic``, with the slash that it may have been named without."""
        return topic if topic in self.topics else f'/{topic}'

    def count(self, topics: Sequence[str] | None = None) -> int:
        """How many messages of ``topics`` there are, of all if None.

        Raises:
            BagError: if there is no such topic.
        """
        return sum(self._counts[key] for key in self._keys(topics))

    def _keys(self, topics: Sequence[str] | None) -> set[Key]:
        return {(one.topic, one.msgtype) for one in self.connections(topics)}

    def messages(self, topics: Sequence[str] | None = None) -> Iterator[Record]:
        """Messages of ``topics``, of all if None, in the order in which they were received.

        Raises:
            BagError: if there is no such topic, the bag is damaged, or it holds fewer messages
                than it says.
        """
        keys, found = self._keys(topics), Counter[Key]()
        wanted = {topic for topic, _ in keys}
        with self._damage():
            sources = [
                storages.Source(file.start_ns, functools.partial(file.messages, wanted))
                for file in self._files
            ]
            for connection, received_ns, data in storages.in_order(sources, _MOST_TOGETHER):
                topic, type_name = key = connection.topic, connection.msgtype
                found[key] += 1
                storages.check_size(len(data), f'a message on {topic}')
                if not 0 <= received_ns < 2**63:
                    raise ValueError(f'a message on {topic} received at {received_ns} ns')
                if self._is_each_compressed:
                    data = storages.expand_message(data)
                yield Record(topic, type_name, received_ns, data)
        for key in keys:
            if found[key] < self._counts[key]:
                raise BagError(
                    f'{self.path}: {found[key]} messages found of {self._counts[key]} on {key[0]} '
                    'that the bag says it holds'
                )

    def decode(self, record: Record) -> Any:
        """The message of a ``record``, an object of rosbags.

        Raises:
            BagError: if its type is not known or its bytes are no message of it.
        """
        store = self.types_of(record.type_name)
        try:
            return store.deserialize_cdr(record.data, record.type_name)
        except Exception as error:
            # The generated code raises errors of several types for bytes that are no message.
            raise BagError(
                f'{record.topic}: {len(record.data)} bytes that are no {record.type_name}'
            ) from error

    def read(self, record: Record, read: Callable[[Any], T]) -> tuple[Stamp, T | None, str]:
        """Stamp of a ``record``, what ``read`` makes of its message, and why it makes nothing.

        A message that cannot be decoded, that ``read`` refuses by an OctoArmError, or that has
        other fields than it takes, is None with the reason; the reason of all others is ''.
        """
        stamp = Stamp.from_ns(record.received_ns)
        try:
            message = self.decode(record)
            stamp = stamp_of(message, record.received_ns)
            return stamp, read(message), ''
        except OctoArmError as error:
            return stamp, None, str(error)
        except (AttributeError, TypeError, ValueError) as error:
            # The bag defines the type otherwise: fields are missing or of other types.
            return stamp, None, f'{record.type_name} of another kind: {error}'

    def types_of(self, type_name: str) -> Typestore:
        """Types to decode messages of a type with: the bag's definition, or else ours.

        Raises:
            BagError: if the bag has no definition and the type is not known here either, or what
                it has makes no sense.
        """
        if type_name not in self._stores:
            found = [one.msgdef for one in self._connections if one.msgtype == type_name]
            try:
                self._stores[type_name] = types_for(type_name, found)
            except BagError as error:
                raise BagError(f'{self.path}: {error}') from error
        return self._stores[type_name]

    def numeric_fields(self, type_name: str) -> list[str]:
        """Numeric fields of a type, such as 'wrench.force.x'; none where nothing defines it."""
        try:
            return numeric_fields(self.types_of(type_name), type_name)
        except BagError:
            return []

    @property
    def listing(self) -> str:
        """Its topics and their types, of many not all, for an error message."""
        if not self.topics:
            return 'it has no topics'
        topics = [f'{topic} ({type_name})' for topic, type_name in self.topics.items()]
        return f'it has {listed(topics)}'
