"""Lockstep as state machines without IO: no ROS, no clock, no threads.

The coupler grants ticks ahead within a window, motion and soil exchange messages tick by tick, a controller
commands a driver at control ticks, and the recorder acknowledges ticks that it has written. In any order of
messages each tick happens exactly once: a message that is missing, repeated, of another run or malformed is a
ProtocolError. The last tick is granted with END. ABORT names the last tick of the record. A paused run stands
at the end of a tick, until it is resumed or steps.
"""

from .coupler import Coupler, FinishedTick
from .handshake import (
    ACK_EVERY_TICKS,
    ACK_LAG_TICKS,
    BATCHES,
    CAPABILITIES,
    CONTROLLER,
    COUPLER,
    MECHANISM,
    RECORDER,
    SOIL,
    external_nodes,
    needed_capabilities,
    participants,
)
from .participant import AnswerStream, Commander, Needs, Participant, Stream, Work
from .record_barrier import RecordBarrier

__all__ = [
    "ACK_EVERY_TICKS",
    "ACK_LAG_TICKS",
    "BATCHES",
    "CAPABILITIES",
    "CONTROLLER",
    "COUPLER",
    "MECHANISM",
    "RECORDER",
    "SOIL",
    "AnswerStream",
    "Commander",
    "Coupler",
    "FinishedTick",
    "Needs",
    "Participant",
    "RecordBarrier",
    "Stream",
    "Work",
    "external_nodes",
    "needed_capabilities",
    "participants",
]
