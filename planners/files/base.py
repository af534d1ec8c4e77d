"""Base class of the file formats, and the plain data of a motion file."""

from __future__ import annotations

import hashlib
import json
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import scipy

from optik.arm.group import Group
from optik.arm.plain import read_numbers, read_record, read_word, read_words
from optik.arm.robot import Robot
from optik.check import check_kind
from optik.errors import InvalidInput
from optik.ik import Tolerance
from optik.scene import Scene
from optik.types import Array
from planners.limits import MotionLimits
from planners.motion import Motion
from planners.motion.motion import World, events_to_plain, read_events
from planners.paths import path_of
from planners.trajectory import Trajectory

CONTENT = "optik-motion/2"
"""Value of the key ``format`` in every motion file; a change of the keys needs another number."""
HEADER = ("format", "robot", "path", "limits", "law", "enforced", "tolerance")
"""Keys that every motion file has, beside the knots and coefficients."""
OPTIONAL = ("span", "speed", "scene", "before", "events", "world")
"""Keys that a file has only if the motion has them."""
HIGHEST_DEGREE = 5
"""Trajectories are piecewise polynomials of at most this degree."""


class Format(ABC):
    """A file format for motions: a motion to bytes and back, equal to the last bit.

    A format is one module with a subclass of `Format` that has two methods, and the line ``METHOD = <the class>``. The name
    of the module is the name of the format and the suffix of its files: ``npz.py`` reads and writes ``.npz``. A file with
    another suffix needs ``format=``; a second suffix of the same format is a second module that imports the class and says
    ``METHOD = <the class>`` again. ``examples/plugins/tsv.py`` is a whole format.
    """

    @abstractmethod
    def to_bytes(self, motion: Motion) -> bytes:
        """Return the content of the file.

        Parameters
        ----------
        motion : Motion
            The motion to write.

        Returns
        -------
        bytes
            The whole content.
        """

    @abstractmethod
    def from_bytes(self, content: bytes) -> Motion:
        """Return the motion that `to_bytes` wrote.

        Parameters
        ----------
        content : bytes
            The whole content of a file, which others may have changed.

        Returns
        -------
        Motion
            Equal to the last bit. Reading never runs code from the file.

        Raises
        ------
        InvalidInput
            Damaged content; the argument names what is wrong.
        """


class Parts(NamedTuple):
    """Content of every format: the header as plain data, knots (m + 1,) and coefficients (d, m, n), highest power first."""

    header: dict[str, Any]
    knots: Array
    coefficients: Array

    @property
    def digest(self) -> str:
        """SHA-256 of header and arrays, which detects changed digits."""
        digest = hashlib.sha256(json.dumps(self.header, sort_keys=True).encode())
        for array in (self.knots, self.coefficients):
            digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
        return digest.hexdigest()


def to_plain(motion: Motion) -> dict[str, Any]:
    """Return a motion as plain data that JSON can hold."""
    parts = to_parts(motion)
    arrays = {"knots": parts.knots.tolist(), "coefficients": parts.coefficients.tolist()}
    return parts.header | arrays | {"sha256": parts.digest}


def from_plain(data: Any) -> Motion:
    """Return the motion that `to_plain` wrote, after checking every entry."""
    check_kind(data, "content", dict, f"a mapping with {', '.join(HEADER)}")
    header = {k: v for k, v in data.items() if k not in ("knots", "coefficients", "sha256")}
    check_header(header)
    for key in ("knots", "coefficients"):
        check_kind(data.get(key), key, list)
    knots, powers = data["knots"], data["coefficients"]
    pieces = powers[0] if powers and isinstance(powers[0], list) else []
    joints = pieces[0] if pieces and isinstance(pieces[0], list) else []
    shape = (len(powers), len(pieces), len(joints))
    parts = Parts(header, read_numbers(knots, (len(knots),), "knots"), read_numbers(powers, shape, "coefficients"))
    return from_parts(parts, data.get("sha256"))


def to_parts(motion: Motion) -> Parts:
    """Return the header and the arrays of a motion, for a format that stores arrays as they are."""
    header: dict[str, Any] = {
        "format": CONTENT,
        "robot": motion.robot.to_dict(),
        "path": motion.path.to_dict(),
        "limits": motion.limits.to_plain(),
        "law": motion.law,
        "enforced": list(motion.enforced),
        "tolerance": None if motion.tolerance is None else list(motion.tolerance),
    }
    if motion.span is not None:
        header["span"] = list(motion.span)
    if motion.speed is not None:
        header["speed"] = motion.speed
    if motion.scene is not None:
        header["scene"] = motion.scene.to_dict()
    if motion.before is not None:
        header["before"] = [motion.before[0].to_plain(), motion.before[1]]
    if motion.events:
        header["events"] = events_to_plain(motion.events)
    if motion.world is not None:
        scene = motion.world.scene
        header["world"] = {"group": motion.world.group.to_dict(), "scene": None if scene is None else scene.to_dict()}
    return Parts(header, motion.trajectory.knots, motion.trajectory.coefficients)


def from_parts(parts: Parts, digest: Any) -> Motion:
    """Return the motion of a header and arrays that were read from a file, after checking them."""
    check_header(parts.header)
    if digest is not None and digest != parts.digest:
        raise InvalidInput("sha256", "a digest that differs from the content", "an unchanged file")
    header = parts.header
    robot = Robot.from_dict(header["robot"])
    return Motion(
        robot,
        path_of(header["path"], robot),
        MotionLimits.from_plain(header["limits"], robot.n),
        _trajectory(parts.knots, parts.coefficients, robot.n),
        read_word(header["law"], "law"),
        read_words(header["enforced"], "enforced"),
        None if header["tolerance"] is None else Tolerance(*_pair(header["tolerance"], "tolerance")),
        None if header.get("span") is None else _pair(header["span"], "span"),
        None if header.get("speed") is None else float(read_numbers(header["speed"], (), "speed")),
        None if header.get("scene") is None else Scene.from_dict(header["scene"]),
        _before(header.get("before"), robot.n),
        read_events(header.get("events", [])),
        _read_world(header.get("world")),
    )


def _read_world(data: Any) -> World | None:
    """Return what stands in the world around a motion of a group."""
    if data is None:
        return None
    read_record(data, ("group", "scene"), "world")
    return World(Group.from_dict(data["group"]), None if data["scene"] is None else Scene.from_dict(data["scene"]))


def _before(data: Any, n: int) -> tuple[MotionLimits, float] | None:
    """Return the limits that hold until a time [s], and that time."""
    if data is None:
        return None
    if not isinstance(data, list) or len(data) != 2:
        raise InvalidInput("before", repr(data)[:60], "limits and a time [s]")
    return MotionLimits.from_plain(data[0], n), float(read_numbers(data[1], (), "before"))


def check_header(header: Mapping[str, Any]) -> None:
    """Raise InvalidInput unless a header has the keys of a motion."""
    found = header.get("format")
    if found != CONTENT:
        raise InvalidInput("format", repr(found)[:60], repr(CONTENT))
    read_record(header, (*HEADER, *(key for key in OPTIONAL if key in header)), "header")


def _pair(value: Any, argument: str) -> tuple[float, float]:
    first, second = read_numbers(value, (2,), argument).tolist()
    return first, second


def _trajectory(knots: Array, coefficients: Array, n: int) -> Trajectory:
    if knots.ndim != 1 or knots.size < 2:
        raise InvalidInput("knots", f"shape {knots.shape}", "at least two times")
    if not np.isfinite(knots).all() or knots[0] != 0.0 or not (np.diff(knots) > 0.0).all():
        wrong = int(np.argmin(np.append(knots[0] == 0.0, np.diff(knots) > 0.0)))
        raise InvalidInput("knots", f"knot {wrong} at {knots[wrong]:.9g} s", "finite times that increase from 0")
    wanted = (knots.size - 1, n)
    if coefficients.ndim != 3 or not 1 <= len(coefficients) <= 1 + HIGHEST_DEGREE or coefficients.shape[1:] != wanted:
        expected = f"shape (1 to {1 + HIGHEST_DEGREE}, {wanted[0]}, {wanted[1]})"
        raise InvalidInput("coefficients", f"shape {coefficients.shape}", expected)
    if not np.isfinite(coefficients).all():
        power, piece, joint = np.argwhere(~np.isfinite(coefficients))[0]
        raise InvalidInput("coefficients", f"{coefficients[power, piece, joint]} in piece {piece}", "finite numbers")
    return Trajectory(scipy.interpolate.PPoly(coefficients, knots))


METHOD_BASE = Format
"""Base class of the METHOD of every module here and of every plug-in."""
