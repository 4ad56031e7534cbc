"""Messages of one topic as one message, and back: bytes (CDR) of MessageBatch.msg."""

import struct
from collections.abc import Iterator, Sequence


def packed(messages: Sequence[bytes]) -> bytes:
    """The batch of some messages."""
    data = b"".join(messages)
    count = len(messages)
    sizes = struct.pack(f"<4s{count + 2}I", b"\0\1\0\0", count, *map(len, messages), len(data))
    return sizes + data


def unpacked(batch: bytes) -> Iterator[bytes]:
    """The messages of a batch, in order."""
    order = "<" if batch[1] & 1 else ">"
    (count,) = struct.unpack_from(f"{order}I", batch, 4)
    sizes = struct.unpack_from(f"{order}{count}I", batch, 8)
    begin = 12 + 4 * count
    for size in sizes:
        yield batch[begin : begin + size]
        begin += size
