"""Messages of one topic as one message, and back: bytes (CDR) of MessageBatch.msg."""

import itertools
import struct
from collections.abc import Sequence

from ..errors import ProtocolError


def packed(messages: Sequence[bytes]) -> bytes:
    """The batch of some messages."""
    data = b"".join(messages)
    count = len(messages)
    sizes = struct.pack(f"<4s{count + 2}I", b"\0\1\0\0", count, *map(len, messages), len(data))
    return sizes + data


def unpacked(batch: bytes) -> tuple[bytes, ...]:
    """The messages of a batch, in order. Raises ProtocolError if it is not one."""
    order = "<" if batch[1] & 1 else ">"
    try:
        (count,) = struct.unpack_from(f"{order}I", batch, 4)
        sizes = struct.unpack_from(f"{order}{count}I", batch, 8)
    except struct.error as error:
        raise ProtocolError(f"a batch of {len(batch)} bytes ends before its messages") from error
    ends = tuple(itertools.accumulate(sizes, initial=12 + 4 * count))
    if ends[-1] > len(batch):
        raise ProtocolError(f"a batch of {len(batch)} bytes has messages up to byte {ends[-1]}")
    return tuple(batch[begin:end] for begin, end in itertools.pairwise(ends))
