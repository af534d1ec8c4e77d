"""Motions from a moving state onto chunks, joints, velocities or another plan, and streams of set-points."""

from planners.retarget.answer import retarget
from planners.retarget.chunk import Chunk, JogVelocity
from planners.retarget.result import Retargeted, RetargetStatus
from planners.retarget.stream import Setpoint, Stream, StreamReport, stream

__all__ = [
    "Chunk",
    "JogVelocity",
    "RetargetStatus",
    "Retargeted",
    "Setpoint",
    "Stream",
    "StreamReport",
    "retarget",
    "stream",
]
