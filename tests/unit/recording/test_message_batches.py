"""Batches of messages: the bytes that rosbags makes of MessageBatch.msg."""

import numpy as np
import pytest

from subsoil_ros.errors import ProtocolError
from subsoil_ros.recording.message_batches import packed, unpacked
from subsoil_ros.recording.types import BATCH, deserialize, message_class, serialize, typestore

MESSAGES = [b"\0\1\0\0abc", b"", b"\0\1\0\0" + bytes(range(200))]


@pytest.mark.parametrize("messages", [MESSAGES, MESSAGES[:1], []])
def test_bytes_are_those_of_the_message(messages):
    """There and back, also by rosbags, in either order of bytes."""
    batch = packed(messages)
    assert list(unpacked(batch)) == messages
    for cut in (6, 10, len(batch) - 1):
        if messages:
            with pytest.raises(ProtocolError, match="a batch of"):
                unpacked(batch[:cut])
    data = np.frombuffer(b"".join(messages), np.uint8)
    message = message_class(BATCH)(np.array([len(one) for one in messages], np.uint32), data)
    assert batch.rstrip(b"\0") == serialize(message).rstrip(b"\0")
    assert deserialize(batch, BATCH).data.tobytes() == data.tobytes()
    big = bytes(typestore().serialize_cdr(message, BATCH, little_endian=False))
    assert list(unpacked(big)) == messages
