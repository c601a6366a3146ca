"""The reader of bags: rosbag2 folders of any version, and single files of their storages."""

import contextlib
import functools
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any, NamedTuple, TypeVar

import yaml
from rosbags.interfaces import Connection, MessageDefinitionFormat
from rosbags.typesys.store import Typestore

from octo_arm_model.arm.errors import BagError, MessageError, OctoArmError, listed, shown
from octo_arm_model.arm.limits import MAX_YAML_BYTES
from octo_arm_model.bags import storages
from octo_arm_model.bags.storages import check_file, checked_yaml
from octo_arm_model.bags.types import numeric_fields, types_for
from octo_arm_model.wire.messages import Stamp, time_of

METADATA = 'metadata.yaml'
_ROOT = 'rosbag2_bagfile_information'
_KINDS: dict[type, str] = {int: 'an integer', str: 'text', list: 'a list', dict: 'a map'}
_MODES = ('', 'none', 'file', 'message')
# Most bytes behind a message: `rclpy.serialize_message` leaves 4 for an empty array of doubles.
_SURPLUS = 12
Key = tuple[str, str]  # a topic and the type of messages on it


def read_metadata(folder: Path) -> tuple[list[Path], Counter[Key], bool, dict[str, str]]:
    """Read the metadata of the bag in ``folder``.

    Return its files, the number of messages by topic and type, whether each message is compressed
    by zstd, and custom data of the recording.

    Raises:
        BagError: if the metadata is not YAML, or too large.
        ValueError: if a field is missing or of another type, or a file is named twice.
        OSError: if it cannot be read.
    """
    path = folder / METADATA
    check_file(path)
    if (size := path.stat().st_size) > MAX_YAML_BYTES:
        raise ValueError(f'{METADATA} has {size} bytes, at most {MAX_YAML_BYTES} are read')
    text = path.read_text(encoding='utf-8')
    info = _take(_checked(checked_yaml(text, METADATA), dict, _ROOT), _ROOT, dict)
    # The folder may have been moved or renamed, so only the names of files count.
    files = [
        folder / PurePath(_checked(entry, str, f'relative_file_paths[{number}]')).name
        for number, entry in enumerate(_take(info, 'relative_file_paths', list))
    ]
    for number, file in enumerate(files):
        if file in files[:number]:
            where = f'relative_file_paths[{number}]'
            raise ValueError(f'{METADATA}: {where} is {shown(file.name)}, expected each file once')
    counts = Counter[Key]()
    for number, entry in enumerate(_take(info, 'topics_with_message_count', list)):
        where = f'topics_with_message_count[{number}]'
        count = _take(_checked(entry, dict, where), 'message_count', int, where)
        if not 0 <= count < 2**63:
            raise ValueError(
                f'{METADATA}: {where}.message_count is {count}, expected 0 to {2**63 - 1}'
            )
        topic, where = _take(entry, 'topic_metadata', dict, where), f'{where}.topic_metadata'
        counts[_take(topic, 'name', str, where), _take(topic, 'type', str, where)] += count
    mode = _take({'compression_mode': '', **info}, 'compression_mode', str).lower()
    if mode not in _MODES:
        expected = ', '.join(_MODES[1:])
        raise ValueError(
            f'{METADATA}: compression_mode is {shown(mode)}, expected one of {expected}'
        )
    if mode in _MODES[2:] and _take(info, 'compression_format', str) != 'zstd':
        given = shown(info['compression_format'])
        raise ValueError(f'{METADATA}: compression_format is {given}, expected zstd')
    return files, counts, mode == 'message', _custom_data(info, text)


def _take(values: Mapping[str, Any], field: str, kind: type, where: str = '') -> Any:
    """Return the ``field`` at ``where``; raise ValueError if missing or not of the ``kind``."""
    place = f'{where}.{field}'.removeprefix('.')
    if field not in values:
        raise ValueError(f'{METADATA}: {place} is missing')
    return _checked(values[field], kind, place)


def _checked(value: Any, kind: type, place: str) -> Any:
    if not isinstance(value, kind) or isinstance(value, bool):
        is_plain = isinstance(value, str | int | float | None)
        given = shown(value) if is_plain else type(value).__name__
        raise ValueError(f'{METADATA}: {place} is {given}, expected {_KINDS[kind]}')
    return value


def _custom_data(info: Mapping[str, Any], text: str) -> dict[str, str]:
    """Return custom data as text: the recorder puts no quotes around entries as 007 or true."""
    if info.get('custom_data') is None:
        return {}
    _take(info, 'custom_data', dict)
    texts: dict[str, str] = yaml.load(text, yaml.BaseLoader)[_ROOT]['custom_data']
    for key in texts:
        _take(texts, key, str, 'custom_data')
    return texts


class Record(NamedTuple):
    """A message as it is stored in a bag."""

    topic: str  #: topic on which it was published
    type_name: str  #: type of the message, such as 'nav_msgs/msg/Path'
    received_ns: int  #: time at which the recorder received it [ns]
    data: bytes  #: serialised message, as ROS 2 sends it


def stamp_of(message: Any, received_ns: int) -> Stamp:
    """Return the stamp of the header of a decoded message, as the node does.

    If there is no header or its stamp is not set, return the time of receipt.

    Raises:
        MessageError: if that is no valid stamp.
    """
    header = getattr(message, 'header', None)
    if header is not None and (stamp := time_of(Stamp.of(header.stamp))) is not None:
        return stamp
    stamp = Stamp.from_ns(received_ns)
    if not -(2**31) <= stamp.sec < 2**31:
        raise MessageError(f'received at {stamp.sec} s, which no stamp can hold')
    return stamp


T = TypeVar('T')
_MOST_TOGETHER = 8  # files of a bag that are read at the same time
_LONGEST = 500  # characters of a parser's message, which may quote all of its input


class BagReader(contextlib.AbstractContextManager['BagReader']):
    """A bag open for reading only.

    Attributes:
        path: path of the bag, or of what it was made from.
        topics: type of the messages of each topic, or all types if there are several.
        metadata: custom data of the recording.
        start_ns: time at which the first message was received [ns].
        duration: time from the first message to the last [s].
        notes: remarks on the state of the bag.
    """

    def __init__(
        self, path: str | Path, origin: Path | None = None, notes: Iterable[str] = ()
    ) -> None:
        """Open the bag at ``path``: a folder, an .mcap or a .db3 file.

        A folder without metadata.yaml is read if it has files of bags. Errors name the ``origin``
        of a bag that was made from another file, with ``notes`` on how.

        Raises:
            BagError: if there is no bag, or it is damaged.
        """
        place = Path(path)
        self.path = origin or place
        if not place.exists():
            raise BagError(f'{self.path}: no such bag')
        self.metadata: dict[str, str] = {}
        self.notes = [*notes]
        self._stores: dict[str, Typestore] = {}
        self._is_each_compressed = False
        with contextlib.ExitStack() as resources, self._damage_errors():
            counts = None
            paths = [place]
            if place.is_dir() and (place / METADATA).exists():
                paths, counts, self._is_each_compressed, self.metadata = read_metadata(place)
            elif place.is_dir():
                paths = self._files_without_metadata(place)
            self._files = [storages.open_file(part, resources) for part in paths]
            self._scan(counts)
            self._resources = resources.pop_all()

    def _files_without_metadata(self, folder: Path) -> list[Path]:
        """Return the files of a ``folder`` without metadata, as left by an aborted recording."""
        names = '*.mcap', '*.db3', '*.mcap.zstd', '*.db3.zstd'
        paths = sorted(file for name in names for file in folder.glob(name))
        if not paths:
            raise BagError(
                f'{self.path}: not a bag: neither {METADATA} nor .mcap or .db3 files in it'
            )
        self.notes.append(
            f'no {METADATA}: {len(paths)} file(s) are read, and nothing says whether there were '
            'more; `ros2 bag reindex` writes it'
        )
        return paths

    def _scan(self, expected: Counter[Key] | None) -> None:
        """Collect topics and counts; ValueError if files lack messages that are ``expected``."""
        unique: dict[Key, Connection] = {}
        for file in self._files:
            for c in file.connections:
                if not (c.topic.isprintable() and c.msgtype.isprintable()):
                    raise ValueError(f'{shown(c.topic)} names a topic or a type')
                first = unique.get((c.topic, c.msgtype), c._replace(msgcount=0))
                is_defined = first.msgdef.format != MessageDefinitionFormat.NONE
                count = first.msgcount + c.msgcount
                unique[c.topic, c.msgtype] = (first if is_defined else c)._replace(msgcount=count)
            if file.missing:
                count = sum(c.msgcount for c in file.connections) + file.missing
                self.notes.append(
                    f'{file.path.name}: {file.missing} message(s) of {count} are not there, by '
                    'their numbers: deleted or lost'
                )
        self._connections = list(unique.values())
        self.topics = {
            topic: ' or '.join(sorted(kind for name, kind in unique if name == topic))
            for topic in sorted(topic for topic, _ in unique)
        }
        if expected is not None:
            self._compare(Counter({key: c.msgcount for key, c in unique.items()}), expected)
        filled = [file for file in self._files if any(c.msgcount for c in file.connections)]
        self.start_ns = min((file.start_ns for file in filled), default=0)
        self.duration = 1e-9 * (max((file.stop_ns for file in filled), default=0) - self.start_ns)

    def _compare(self, counts: Counter[Key], expected: Counter[Key]) -> None:
        """Compare ``counts`` with the ``expected`` ones of the metadata; ValueError if fewer."""
        for key in counts | expected:
            topic, count, stated = key[0], counts[key], expected[key]
            if count < stated:
                raise ValueError(f'{count} messages found of {stated} on {topic}')
            if count > stated and key not in expected:
                raise ValueError(f'{count} messages of {key[1]} on {topic} that it does not list')
            if count > stated:
                self.notes.append(f'{topic}: {count} messages, more than the {stated} it says')

    def __exit__(self, *_: object) -> None:
        """Close the files of the bag."""
        self._resources.close()

    @contextlib.contextmanager
    def _damage_errors(self) -> Iterator[None]:
        """Turn the errors of any type that parsers raise for damaged bytes into BagError."""
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
        """Return the connections of ``topics``, or of all if None, with definitions and counts.

        Raises:
            BagError: if there is no such topic; the message lists the existing ones.
        """
        if topics is None:
            return self._connections
        for topic in topics:
            if topic not in self.topics:
                raise BagError(f'{self.path}: no topic {topic}; {self.listing}')
        return [connection for connection in self._connections if connection.topic in topics]

    def full_name(self, topic: str) -> str:
        """Return ``topic``, with a slash in front if it was named without one."""
        return topic if topic in self.topics else f'/{topic}'

    def count(self, topics: Sequence[str] | None = None) -> int:
        """Return the number of messages of ``topics``, or of all if None.

        Raises:
            BagError: if there is no such topic.
        """
        return sum(c.msgcount for c in self.connections(topics))

    def messages(self, topics: Sequence[str] | None = None) -> Iterator[Record]:
        """Iterate over messages of ``topics``, or of all if None, in the order of receipt.

        Raises:
            BagError: if there is no such topic, the bag is damaged, or it holds fewer messages
                than it says.
        """
        connections, read = self.connections(topics), Counter[Key]()
        selected = {c.topic for c in connections}
        with self._damage_errors():
            sources = (
                (file.start_ns, functools.partial(file.messages, selected)) for file in self._files
            )
            for connection, received_ns, data in storages.in_order(sources, _MOST_TOGETHER):
                topic, type_name = key = connection.topic, connection.msgtype
                read[key] += 1
                storages.check_size(len(data), f'a message on {topic}')
                if not 0 <= received_ns < 2**63:
                    raise ValueError(f'a message on {topic} received at {received_ns} ns')
                if self._is_each_compressed:
                    data = storages.expand_message(data)
                yield Record(topic, type_name, received_ns, data)
        for c in connections:
            if (count := read[c.topic, c.msgtype]) < c.msgcount:
                raise BagError(
                    f'{self.path}: {count} messages found of {c.msgcount} on {c.topic} that the '
                    'bag says it holds'
                )

    def decode(self, record: Record) -> Any:
        """Return the message of a ``record``, an object of rosbags.

        Raises:
            BagError: if its type is not known, or its bytes are not a message of this type.
        """
        store, data = self.types_of(record.type_name), record.data
        for surplus in range(0, _SURPLUS + 1, 4):
            # The generated code raises errors of several types for invalid bytes.
            with contextlib.suppress(Exception):
                return store.deserialize_cdr(data[: len(data) - surplus], record.type_name)
        raise BagError(f'{record.topic}: {len(data)} bytes that are no {record.type_name}')

    def read(self, record: Record, read: Callable[[Any], T]) -> tuple[Stamp, T | None, str]:
        """Return the stamp of a ``record``, the value of ``read`` for its message, and a reason.

        If the message cannot be decoded or has no valid stamp, ``read`` refuses it by an
        OctoArmError, or it does not have the fields that ``read`` takes, the value is None with
        the reason; else that is ''. The stamp is the time of receipt if no other is known.
        """
        stamp = Stamp.from_ns(record.received_ns)
        try:
            message = self.decode(record)
            stamp = stamp_of(message, record.received_ns)
            return stamp, read(message), ''
        except OctoArmError as error:
            return stamp, None, str(error)
        except (AttributeError, TypeError, ValueError) as error:
            # The bag defines the type differently: fields are missing or of other types.
            return stamp, None, f'{record.type_name} of another kind: {error}'

    def types_of(self, type_name: str) -> Typestore:
        """Return the types that decode messages of a type: the bag's definition, or else ours.

        Raises:
            BagError: if the bag has no definition and the type is not known, or the definition is
                invalid.
        """
        if type_name not in self._stores:
            definitions = [c.msgdef for c in self._connections if c.msgtype == type_name]
            try:
                self._stores[type_name] = types_for(type_name, definitions)
            except BagError as error:
                raise BagError(f'{self.path}: {error}') from error
        return self._stores[type_name]

    def numeric_fields(self, type_name: str) -> list[str]:
        """Return the numeric fields of a type, e.g. 'wrench.force.x'; none if it is undefined."""
        try:
            return numeric_fields(self.types_of(type_name), type_name)
        except BagError:
            return []

    @property
    def listing(self) -> str:
        """The topics of the bag and their types for an error message, at most a few."""
        if not self.topics:
            return 'it has no topics'
        topics = [f'{topic} ({type_name})' for topic, type_name in self.topics.items()]
        return f'it has {listed(topics)}'
