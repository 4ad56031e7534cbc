"""Lockstep as state machines without IO: no ROS, no clock, no threads.

The coupler grants ticks ahead within a window, mover and soil answer each other tick by tick, and the
recorder acknowledges what it has written. Whatever the interleaving, each tick happens exactly once:
a message that is missing, repeated, foreign or malformed is a ProtocolError. The last tick is granted
with END. ABORT names the last tick of the record.
"""

from .coupler import Coupler, FinishedTick
from .names import ACK_EVERY_TICKS, ACK_LAG_TICKS, COUPLER, MECHANISM, RECORDER, SOIL, participants
from .participant import Needs, Participant, Work
from .record_barrier import RecordBarrier
from .streams import AnswerStream, Stream

__all__ = [
    "ACK_EVERY_TICKS",
    "ACK_LAG_TICKS",
    "COUPLER",
    "MECHANISM",
    "RECORDER",
    "SOIL",
    "AnswerStream",
    "Coupler",
    "FinishedTick",
    "Needs",
    "Participant",
    "RecordBarrier",
    "Stream",
    "Work",
    "participants",
]
