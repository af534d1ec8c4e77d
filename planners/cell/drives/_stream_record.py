"""StreamRecord: set-points and measured positions of a stream on a drive."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optik.types import Array
from planners.retarget.stream import Stream, StreamReport


class StreamRecord(NamedTuple):
    """The record of a stream on a drive; it is true if nothing stopped the stream.

    Attributes
    ----------
    t : (k,) array
        Times of the set-points [s].
    setpoints, q : (k, n) arrays
        The set-points, and the measured positions at their times [rad, m].
    report : StreamReport
        What the stream did.
    fault : str
        Why the stream was stopped, for example an exception of its source; empty if it was not stopped.
    """

    t: Array
    setpoints: Array
    q: Array
    report: StreamReport
    fault: str = ""

    def __bool__(self) -> bool:
        return not self.fault

    @property
    def error(self) -> Array:
        """Largest distance of each joint from its set-points (n,) [rad, m]."""
        return np.asarray(np.abs(self.q - self.setpoints).max(axis=0))


def make_record(rows: list[tuple[float, Array, Array]], stream: Stream, fault: str) -> StreamRecord:
    """Return the record of a stream; its fault is that of the arm, or else the exception of the source."""
    t, setpoints, q = (np.array(x) for x in zip(*rows, strict=True))
    if not fault and (error := stream.error):
        fault = f"{type(error).__name__}: {error}"
    return StreamRecord(t, setpoints, q, stream.report(), fault)
