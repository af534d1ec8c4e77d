"""The parts of a program: moves to goals, waits, and changes of the tool."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.inertia import Payload
from optik.arm.robot import Robot
from optik.check import check_choice, check_keywords, check_kind, check_number, finite_array, real_array
from optik.errors import InvalidInput
from optik.se3 import check_pose, nearest_pose
from optik.types import Array
from planners.choice.first_paths import check_avoid
from planners.paths.base import Path
from planners.paths.line import Line
from planners.paths.polyline import Polyline, find_reversals
from planners.paths.program import ProgramPath
from planners.search.base import SearchLike

FRAMES = ("tool", "base")
"""Frames of the vector of a `Move`."""
TURN_PER_METRE = 10.0
"""Rotation that a zone allows by default [rad/m], as `Polyline`: 1 mm with 10 mrad."""
MOVES = ("line", "joint")
"""Kinds of moves to a pose: a straight line of the tool, or one of the joints to a configuration that is chosen."""


class Keep:
    """What a `ToolChange` does not change."""

    def __repr__(self) -> str:
        return "kept"


KEEP = Keep()
"""The default of a `ToolChange`: no change."""


@dataclass(frozen=True, eq=False)
class Move:
    """A straight move of the tool by a vector, without rotation, as a goal of a `Part`.

    Parameters
    ----------
    vector : (3,) array
        Displacement of the tool's point [m].
    frame : {"tool", "base"}
        The frame of the vector: that of the tool where the move begins, or the base.
    """

    vector: ArrayLike
    frame: str = "tool"

    def __post_init__(self) -> None:
        object.__setattr__(self, "vector", finite_array(self.vector, "vector", "three numbers [m]", (3,)))
        check_choice(self.frame, "frame", FRAMES)


@check_keywords
@dataclass(frozen=True, eq=False)
class Part:
    """A move of a program. It starts where the part before ended.

    Parameters
    ----------
    goal : (n,) or (4, 4) array, Move or Path
        Joints [rad, m], a pose T_base_tool [m], a displacement, or a whole path.
    move : {"line", "joint"}, optional
        The way to a pose: a straight line, by default, or a line of the joints to a configuration that is chosen with the
        parts behind in view. Joints are reached by a line of the joints.
    name : str, optional
        Name for messages and events; unique in a program.
    blend : float
        Largest distance of the tool from the sharp corner at the end of this part [m]; 0 is a stop.
    blend_rotation : float, optional
        Largest rotation of the tool against the sharp corner there [rad]; by default 10 rad for each metre of `blend`.
    tool_speed, rotation_speed : float, optional
        Greatest speed of the tool's point [m/s] and of its rotation [rad/s] on this part.
    avoid : bool, or str, path, type or Search
        Search a way around the obstacles of the scene, as `planners.plan` does.
    """

    goal: Any
    move: str | None = None
    name: str | None = None
    blend: float = 0.0
    blend_rotation: float | None = None
    tool_speed: float | None = None
    rotation_speed: float | None = None
    avoid: bool | SearchLike = False

    def __post_init__(self) -> None:
        if isinstance(self.goal, ProgramPath):
            raise InvalidInput("goal", "the path of a program", "the parts of that program, or the path of one section")
        if not isinstance(self.goal, Path | Move):
            expected = "joints (n,), a pose (4, 4), a Move or a Path"
            goal = finite_array(self.goal, "goal", expected)
            if goal.ndim != 1 and goal.shape != (4, 4):
                raise InvalidInput("goal", f"shape {goal.shape}", expected)
            object.__setattr__(self, "goal", check_pose(goal, "goal") if goal.ndim == 2 else goal.copy())
        is_pose = isinstance(self.goal, np.ndarray) and self.goal.ndim == 2
        if self.move is not None and (self.move not in MOVES or not is_pose):
            raise InvalidInput("move", repr(self.move)[:60], '"line" or "joint", for a pose; or None')
        if self.name is not None and (not isinstance(self.name, str) or not self.name):
            raise InvalidInput("name", repr(self.name)[:60], "a text, or None")
        check_number(self.blend, "blend", "a distance [m], at least 0", least=0.0)
        for argument in ("blend_rotation", "tool_speed", "rotation_speed"):
            if (value := getattr(self, argument)) is not None:
                check_number(value, argument, "a number above 0, or None", above=0.0)
        if self.blend_rotation is not None and self.blend == 0.0:
            raise InvalidInput("blend_rotation", f"{self.blend_rotation:g}, with blend=0", "None, or a blend above 0")
        check_avoid(self.avoid)
        if self.avoid is not False and isinstance(self.goal, Move):
            raise InvalidInput("avoid", repr(self.avoid)[:60], "False for a Move, which is a straight line")

    @property
    def is_cartesian(self) -> bool:
        """Whether it moves the tool along a path in space."""
        goal = self.goal
        if isinstance(goal, Path):
            return not goal.in_joints
        return isinstance(goal, Move) or (goal.ndim == 2 and self.move != "joint")

    @property
    def zone(self) -> Array:
        """Largest distance [m] and rotation [rad] from the sharp corner at the end (2,)."""
        turn = TURN_PER_METRE * self.blend if self.blend_rotation is None else self.blend_rotation
        return np.array([self.blend, turn])


@dataclass(frozen=True)
class Dwell:
    """A wait at rest.

    Parameters
    ----------
    seconds : float
        Its duration [s]; 0 is a stop without a wait.
    """

    seconds: float

    def __post_init__(self) -> None:
        check_number(self.seconds, "seconds", "a duration [s], at least 0", least=0.0)


@dataclass(frozen=True, eq=False)
class ToolChange:
    """A change of the tool or the payload, at rest. A tool or a payload that is not given stays as it is.

    Parameters
    ----------
    tool : (4, 4) array, optional
        The tool's pose in the last link, as of `Robot.with_tool`.
    payload : Payload, float or None, optional
        The body in the tool, or its mass [kg] at the tool's point; None for no body.
    shapes : sequence, optional
        Shapes of the body in the tool's frame, for collisions; as of `Robot.with_payload`.
    """

    tool: ArrayLike | Keep = KEEP
    payload: Payload | float | Keep | None = KEEP
    shapes: Sequence[Any] | Keep = KEEP

    def __post_init__(self) -> None:
        if all(isinstance(x, Keep) for x in (self.tool, self.payload, self.shapes)):
            raise InvalidInput("tool", "nothing to change", "a tool, a payload, or shapes")
        if not isinstance(self.tool, Keep):
            object.__setattr__(self, "tool", check_pose(self.tool, "tool"))
        if isinstance(self.payload, Keep | Payload) or self.payload is None:
            if not isinstance(self.shapes, Keep) and not isinstance(self.payload, Payload):
                raise InvalidInput("shapes", "shapes without a payload", "the shapes of the payload that is given")
        else:
            check_number(self.payload, "payload", "a Payload, a mass above 0 [kg], or None", above=0.0)

    def apply(self, robot: Robot) -> Robot:
        """Return an arm with the changes.

        Parameters
        ----------
        robot : Robot
            The arm before.

        Returns
        -------
        Robot
            The arm after.
        """
        if not isinstance(self.tool, Keep):
            robot = robot.with_tool(self.tool)
        if isinstance(self.payload, Keep):
            return robot
        payload = self.payload if isinstance(self.payload, Payload) or self.payload is None else Payload(self.payload)
        if payload is None:
            return robot.with_payload(None)
        shapes = None if isinstance(self.shapes, Keep) else self.shapes
        return robot.with_payload(payload.mass, payload.com, payload.inertia, shapes)


Item = Part | Dwell | ToolChange


class Program:
    """A motion of many parts: moves with zones or stops between them, waits and changes of the tool.

    Parameters
    ----------
    items : sequence of Part, Dwell and ToolChange
        In their order; at least one `Part`.

    Raises
    ------
    InvalidInput
        No part, a name that two parts have, or a zone at the last part or beside a `Dwell` or a `ToolChange`, which are stops.
    """

    def __init__(self, items: Iterable[Item]) -> None:
        expected = "a list of Part, Dwell and ToolChange, with at least one Part"
        if isinstance(items, str | Path) or not isinstance(items, Iterable):
            raise InvalidInput("items", repr(items)[:60], expected)
        given = tuple(items)
        for item in given:
            check_kind(item, "items", Part | Dwell | ToolChange, expected)
        self.items: tuple[Item, ...] = tuple(copy(item) for item in given)  # one item may be given twice
        self.parts = tuple(item for item in self.items if isinstance(item, Part))
        if not self.parts:
            raise InvalidInput("items", "no Part", expected)
        for i, part in enumerate(self.parts):
            if part.name is not None and part.name in [other.name for other in self.parts[:i]]:
                raise InvalidInput("name", f"{part.name!r} for two parts", "a name for one part")
        for item, after in zip(self.items, (*self.items[1:], None), strict=True):
            if isinstance(item, Part) and item.blend > 0.0 and not isinstance(after, Part):
                where = "at the last part" if after is None else f"before a {type(after).__name__}"
                label = self.label(self.parts.index(item))
                raise InvalidInput("blend", f"{item.blend:g} m {where} ({label})", "blend=0: the arm stops there")

    def __repr__(self) -> str:
        return f"Program({len(self.parts)} parts)"

    def label(self, index: int) -> str:
        """Return the number and the name of a part, for messages.

        Parameters
        ----------
        index : int
            From 0.

        Returns
        -------
        str
            Such as ``part 3 'seam'``.
        """
        name = self.parts[index].name
        return f"part {index + 1}" + (f" {name!r}" if name else "")

    @classmethod
    def of(cls, waypoints: ArrayLike, *, blend: float = 1e-3, blend_rotation: float = 1e-2) -> Self:
        """Return the program of a polyline that reverses its direction: a `Polyline` up to each reversal, with a stop there.

        Parameters
        ----------
        waypoints : (k, 4, 4) array
            T_base_tool [m].
        blend, blend_rotation : float
            As of `Polyline` [m, rad].

        Returns
        -------
        Program
            One part without reversals.
        """
        poses = real_array(waypoints, "waypoints", "poses (k, 4, 4)", (..., 4, 4))
        ends = [0, *find_reversals(poses, blend, blend_rotation), len(poses) - 1]
        pieces = [poses[a : b + 1] for a, b in itertools.pairwise(ends)]
        return cls([Part(Polyline(piece, blend=blend, blend_rotation=blend_rotation)) for piece in pieces])


def displace(pose: Array, goal: Any) -> Array:
    """Return the goal of a line from a pose: itself, or the pose moved by a vector."""
    if not isinstance(goal, Move):
        return np.asarray(goal)
    moved, vector = pose.copy(), np.asarray(goal.vector)
    moved[:3, 3] += pose[:3, :3] @ vector if goal.frame == "tool" else vector
    return nearest_pose(moved)


def make_part_path(part: Part, pose: Array | None) -> Path | None:
    """Return the path in space of a part that begins at a pose; None for a part in joint space, or if it is not known."""
    if not part.is_cartesian:
        return None
    if isinstance(part.goal, Path):
        return part.goal
    if isinstance(part.goal, Move) and pose is None:
        pose = np.eye(4)  # its length is known
    return None if pose is None else Line(pose, displace(pose, part.goal))
