"""Bags read: rosbag2 folders of any version, and single files of their storages."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

from rosbags.interfaces import Connection
from rosbags.rosbag2.reader import DirectoryReader
from rosbags.typesys.store import Typestore

from octo_arm_model.arm.errors import BagError, OctoArmError, listed, shown
from octo_arm_model.bags.metadata import check_folder
from octo_arm_model.bags.records import Key, Record, count_messages, counts_of, stamp_of
from octo_arm_model.bags.storages import (
    BoundedReader,
    CheckedSqlite3Reader,
    check_size,
    expand_message,
)
from octo_arm_model.bags.types import numeric_fields, types_for
from octo_arm_model.wire.stamp import Stamp

T = TypeVar('T')
_LONGEST = 500  # characters of what a parser complains of, which may be all that it was given


class BagReader:
    """A bag open for reading only.

    Attributes:
        path: where it is.
        topics: type of the messages of each topic; of several types, all of them.
        metadata: custom data of its recording.
        start_ns: when its first message was received [ns].
        duration: from its first message to its last [s].
        notes: remarks on its state.
    """

    def __init__(self, path: str | Path) -> None:
        """Open the bag at ``path``: a folder with metadata.yaml, an .mcap or a .db3 file.

        Raises:
            BagError: if it is none, or is damaged.
        """
        self.path = Path(path)
        if not self.path.exists():
            raise BagError(f'{self.path}: no such bag')
        if self.path.is_dir() and not (self.path / 'metadata.yaml').exists():
            raise BagError(
                f'{self.path}: not a bag, or one whose recording did not end: no metadata.yaml; '
                'where there is a .mcap or .db3 file in it, give that'
            )
        self.metadata: dict[str, str] = {}
        self.notes: list[str] = []
        with self._damage():
            if self.path.is_dir():
                self.metadata = check_folder(self.path)
            self._reader = BoundedReader(self.path)
            self._reader.open()
        try:
            with self._damage():
                self._look()
        except BaseException:
            self.close()
            raise

    def _look(self) -> None:
        """Collect topics and counts; ValueError if the bag and its files do not agree on them."""
        storage = self._reader.storage
        files = storage.storages if isinstance(storage, DirectoryReader) else [storage]
        self._is_each_compressed = storage.metadata.compression_mode == 'message'
        if self._is_each_compressed:
            # `messages` expands them, within bounds.
            storage.metadata = storage.metadata._replace(compression_mode=None)
        self._stores: dict[str, Typestore] = {}
        self._connections = list(self._reader.connections)
        types: dict[str, set[str]] = {}
        for connection in self._connections:
            for name in (connection.topic, connection.msgtype):
                if not name.isprintable():
                    raise ValueError(f'{shown(name)} names a topic or a type')
            types.setdefault(connection.topic, set()).add(connection.msgtype)
        self.topics = {topic: ' or '.join(sorted(types[topic])) for topic in sorted(types)}
        said = count_messages(self._connections)
        self._counts = count_messages(one for file in files for one in file.connections)
        for key in said | self._counts:
            topic, found, expected = key[0], self._counts[key], said[key]
            if found < expected:
                raise ValueError(f'{found} messages found of {expected} on {topic}')
            if found > expected and key not in said:
                raise ValueError(f'{found} messages of {key[1]} on {topic} that it does not list')
            if found > expected:
                self.notes.append(f'{topic}: {found} messages, more than the {expected} it says')
        for file in files:
            found, expected = (
                sum(count_messages(file.connections).values()),
                file.metadata.message_count,
            )
            if found != expected:
                raise ValueError(f'{found} messages found of {expected} that it says it holds')
            if isinstance(file, CheckedSqlite3Reader) and file.missing:
                self.notes.append(
                    f'{file.path.name}: {file.missing} message(s) of {expected + file.missing} '
                    'are not there, by their numbers: deleted or lost'
                )
        count = sum(self._counts.values())
        self.start_ns = self._reader.start_time if count else 0
        # rosbags adds 1 ns.
        self.duration = 1e-9 * max(self._reader.duration - 1, 0)

    def __enter__(self) -> BagReader:
        """Return this, which is open."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close it."""
        self.close()

    def close(self) -> None:
        """Close it."""
        if self._reader.is_open:
            self._reader.close()

    @contextlib.contextmanager
    def _damage(self) -> Iterator[None]:
        """Errors of any type that parsers raise for damaged bytes, as one line."""
        try:
            yield
        except PermissionError:
            raise
        except Exception as error:
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
        return sum(counts_of(self._counts, self.connections(topics)).values())

    def messages(self, topics: Sequence[str] | None = None) -> Iterator[Record]:
        """Messages of ``topics``, of all if None, in the order in which they were received.

        Raises:
            BagError: if there is no such topic, the bag is damaged, or it holds fewer messages
                than it says.
        """
        wanted = self.connections(topics)
        if not wanted:
            return
        expected, found = counts_of(self._counts, wanted), Counter[Key]()
        with self._damage():
            for connection, received_ns, data in self._reader.messages(wanted):
                topic, type_name = key = connection.topic, connection.msgtype
                found[key] += 1
                check_size(len(data), f'a message on {topic}')
                if not 0 <= received_ns < 2**63:
                    raise ValueError(f'a message on {topic} received at {received_ns} ns')
                if self._is_each_compressed:
                    data = expand_message(data)
                yield Record(topic, type_name, received_ns, data)
        for key, count in expected.items():
            if found[key] < count:
                raise BagError(
                    f'{self.path}: {found[key]} messages found of {count} on {key[0]} that the '
                    'bag says it holds'
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
