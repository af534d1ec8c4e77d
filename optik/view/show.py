"""Show: the content of a viewer, with the planned and the executed motion, path, scene, laser beam and facts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.card import Bar
from optik.scene import Scene
from optik.types import Array


class Track(NamedTuple):
    """A sampled motion; a viewer interpolates cubics through its positions and velocities.

    Attributes
    ----------
    t : (k,) array
        Times, 0 first [s].
    q, dq : (k, n) arrays
        Configurations [rad, m] and their velocities [rad/s, m/s].
    ddq : (k, n) array or None
        Accelerations [rad/s², m/s²]; None if they are unknown.
    torque : (k, n) array or None
        Measured torques of the motors [N·m, N]; None if there are none.
    jerk : (k, n) array or None
        Jerks [rad/s³, m/s³]; None if they are unknown.
    """

    t: Array
    q: Array
    dq: Array
    ddq: Array | None = None
    torque: Array | None = None
    jerk: Array | None = None


class Beam(NamedTuple):
    """A laser beam: its origin at the unit and its spot, (3,) each, in the arm's base frame [m]."""

    origin: Array
    spot: Array


@dataclass(frozen=True, eq=False)
class Show:
    """The content of a viewer, in the arm's base frame.

    Attributes
    ----------
    robot : Robot
        The arm with its shapes; up is against gravity.
    title, verdict : str
        Title; and the verdict on the motion, or empty.
    good : bool
        Whether the verdict is a success.
    planned : Track
        The planned motion, or the sent one.
    path : (m, 3) array
        Points of the commanded path of the tool [m].
    executed : Track or None
        The executed motion.
    scene : Scene or None
        The obstacles.
    limits : mapping
        Lower and upper limits (n,) of the quantities of its plots, by name: ``dq``, ``ddq``, ``jerk``, ``torque``.
    beam : Beam or None
        The laser beam to the spot.
    facts : tuple of (name, text)
        Rows of a table.
    bars : sequence of Bar
        Peak values as fractions of their limits.
    before : (m, 3) array or None
        Points of the tool along the way around obstacles near which the path began [m].
    zones : tuple of (m, 3) arrays
        Points of the path in its rounded corners [m].
    events : (m, 3) array or None
        Where the tool is at the events of the motion [m].
    """

    robot: Robot
    title: str
    planned: Track
    path: Array
    executed: Track | None = None
    scene: Scene | None = None
    limits: Mapping[str, tuple[Array, Array]] = field(default_factory=dict)
    beam: Beam | None = None
    facts: tuple[tuple[str, str], ...] = ()
    before: Array | None = None
    bars: Sequence[Bar] = ()
    zones: tuple[Array, ...] = ()
    events: Array | None = None
    verdict: str = ""
    good: bool = False

    @property
    def duration(self) -> float:
        """End of the longer of both motions [s]."""
        ends = [track.t[-1] for track in (self.planned, self.executed) if track is not None]
        return float(max(ends))


def thin(track: Track, most: int) -> Track:
    """Return at most so many instants of a motion, both ends included."""
    size = track.t.size
    return select(track, np.unique(np.linspace(0, size - 1, min(size, most)).round().astype(np.int64)))


def select(track: Track, chosen: Any) -> Track:
    """Return some of the instants of a motion."""
    return Track._make(None if column is None else column[chosen] for column in track)
