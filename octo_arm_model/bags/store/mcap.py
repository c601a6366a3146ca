"""The MCAP storage of rosbags, with records packed and chunks written at once.

rosbags packs number by number and copies a chunk three times on its way to the file. Otherwise
it is the same, to the last byte of the file.
"""

from __future__ import annotations

import struct
from io import BytesIO
from pathlib import Path

import numpy as np
from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionMode
from rosbags.rosbag2.storage_mcap import McapWriter, PendingChunk

# Records, from their kind and size on: a message (channel, number, times), a chunk (times, size,
# checksum, compression, size again) and where the messages of a channel are in it.
_MESSAGE = struct.Struct('<BQHIQQ')
_CHUNK = struct.Struct('<BQQQQIIQ')
_PLACES = struct.Struct('<BQHI')
_BEFORE = 9  # bytes of a record that its size does not count
# Of the index of a chunk: times, place and size; a channel; size of all places, and sizes again.
_INDEX = struct.Struct('<QQQQI')
_CHANNEL = struct.Struct('<HQ')
_SIZES = struct.Struct('<QIQQ')
_FULL = 2**20  # bytes of a chunk


class QuickMcapWriter(McapWriter):
    """Storage of one bag, not compressed."""

    def __init__(self, path: Path, compression: CompressionMode) -> None:
        """Open a file in the folder ``path``."""
        assert compression == CompressionMode.NONE
        super().__init__(path, compression)

    def write(self, connection: Connection, timestamp: int, data: bytes | memoryview) -> None:
        """Add a message."""
        number, chunk = connection.id, self.chunk
        self.channel_stats[number] += 1
        if timestamp < chunk.message_start_time:
            chunk.message_start_time = timestamp
        if timestamp > chunk.message_end_time:
            chunk.message_end_time = timestamp
        write = chunk.bio.write
        chunk.msgs[number].append((timestamp, chunk.bio.tell()))
        size = _MESSAGE.size - _BEFORE + len(data)
        write(_MESSAGE.pack(5, size, number, 0, timestamp, timestamp))
        write(data)
        if chunk.bio.tell() > _FULL:
            self.close_chunk()

    def close_chunk(self) -> None:
        """Write the chunk."""
        chunk, bio = self.chunk, self.bio
        times, size = (chunk.message_start_time, chunk.message_end_time), chunk.bio.tell()
        self.message_start_time = min(times[0], self.message_start_time)
        self.message_end_time = max(times[1], self.message_end_time)
        place = bio.tell()
        bio.write(_CHUNK.pack(6, _CHUNK.size - _BEFORE + size, *times, size, 0, 0, size))
        with chunk.bio.getbuffer() as content:
            bio.write(content[:size])
        end = bio.tell()
        channels = b''
        for number, messages in chunk.msgs.items():
            channels += _CHANNEL.pack(number, bio.tell())
            places = np.array(messages, '<u8').tobytes()
            bio.write(_PLACES.pack(7, _PLACES.size - _BEFORE + len(places), number, len(places)))
            bio.write(places)
        index = BytesIO()
        index.write(_INDEX.pack(*times, place, end - place, len(channels)))
        index.write(channels + _SIZES.pack(bio.tell() - end, 0, size, size))
        self.chunks.append(index)
        # The next chunk reuses the memory.
        chunk.bio.seek(0)
        chunk.msgs.clear()
        self.chunk = PendingChunk(2**63 - 1, 0, chunk.bio, chunk.msgs)
