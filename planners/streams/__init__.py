"""Motions from a moving state onto chunks, joints, velocities or another plan, and streams of set-points."""

from planners.streams.chunk import Chunk, JogVelocity
from planners.streams.result import Retargeted, RetargetStatus
from planners.streams.stream import Setpoint, Stream, StreamReport, retarget, stream

__all__ = [
    "Chunk", "JogVelocity", "RetargetStatus", "Retargeted", "Setpoint", "Stream", "StreamReport", "retarget",
    "stream",
]  # fmt: skip
