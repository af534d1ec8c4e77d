"""Gripper at the arm's tool: its grasp point becomes the tool, and the held object becomes part of the payload."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optik import se3
from optik.arm.inertia import Body, check_body, check_shape, join_bodies, transform_body
from optik.arm.robot import Robot
from optik.check import check_number
from optik.errors import InvalidInput
from optik.types import Array

PARTS = ("gripper", "held")
"""Names of the capsules of the gripper and of a held object in ``robot.shapes``."""


@dataclass(frozen=True, eq=False)
class HeldObject:
    """An object between the fingers, as a rigid body in the grasp's frame.

    Parameters
    ----------
    mass : float
        Mass [kg].
    com : (3,) array
        Centre of mass [m]; by default the grasp point.
    inertia : (3, 3) array, optional
        Inertia about the centre of mass [kg·m²]; by default a point mass.
    shapes : sequence of (T, edges), (centre, radius) or (a, b, radius)
        Its collision shapes, as for `Robot.with_payload` [m].

    Raises
    ------
    InvalidInput
        Values that no body has.
    """

    mass: float
    com: ArrayLike = (0.0, 0.0, 0.0)
    inertia: ArrayLike | None = None
    shapes: Sequence[Any] = ()

    def __post_init__(self) -> None:
        _body(self.mass, self.com, self.inertia, "the held object")

    @property
    def body(self) -> Body:
        """The rigid body, in the grasp's frame."""
        return _body(self.mass, self.com, self.inertia, "the held object")


@dataclass(frozen=True, eq=False)
class Gripper:
    """A gripper of two parallel fingers on the arm's tool.

    Parameters
    ----------
    grasp : (4, 4) array
        Pose of the grasp point in the frame of the arm's tool [1, m].
    opening : float
        Largest distance of the fingers [m].
    mass : float
        Mass [kg].
    com : (3,) array, optional
        Centre of mass in the frame of the arm's tool [m]; by default halfway to the grasp point.
    inertia : (3, 3) array, optional
        Inertia about the centre of mass, in the axes of the arm's tool [kg·m²]; by default a point mass.
    shapes : sequence of (T, edges), (centre, radius) or (a, b, radius)
        Its collision shapes for all finger positions, in the frame of the arm's tool, as for `Robot.with_payload` [m].

    Raises
    ------
    InvalidInput
        A grasp that is no pose, an opening below 0, or values that no body has.
    """

    grasp: ArrayLike
    opening: float
    mass: float = 0.0
    com: ArrayLike | None = None
    inertia: ArrayLike | None = None
    shapes: Sequence[Any] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "grasp", se3.check_pose(self.grasp, "grasp"))
        object.__setattr__(
            self, "opening", check_number(self.opening, "opening", "a distance of 0 or more [m]", least=0.0)
        )
        _ = self.body

    @property
    def body(self) -> Body:
        """The rigid body, in the frame of the arm's tool."""
        com = 0.5 * self._grasp[:3, 3] if self.com is None else self.com
        return _body(self.mass, com, self.inertia, "the gripper")

    @property
    def _grasp(self) -> Array:
        assert isinstance(self.grasp, np.ndarray)
        return self.grasp

    def mount(self, robot: Robot, held: HeldObject | None = None) -> Robot:
        """Return an arm with the gripper: its tool is the grasp point, and masses and shapes include gripper and object.

        The previous payload of the arm is included in the new one. Joints, limits and names do not change.

        Parameters
        ----------
        robot : Robot
            The arm without the gripper.
        held : HeldObject, optional
            The object between the fingers.

        Returns
        -------
        Robot
            The arm with the gripper. If its own masses are unknown, it has no payload.

        Raises
        ------
        InvalidInput
            An arm whose payload is an interval, or shapes for an arm that has none.
        """
        to_grasp = se3.inverse(self._grasp)
        bodies = [transform_body(self.body, to_grasp)]
        if held is not None:
            bodies.append(held.body)
        if robot.payload is not None:
            if len(robot.payload.bodies) > 1:
                wanted = "an arm whose payload has one mass, to which the gripper's is added"
                raise InvalidInput("robot", f"a payload of {robot.payload}", wanted)
            bodies.append(transform_body(robot.payload.bodies[0], to_grasp))
        arm = robot.with_tool(self._grasp, add=True)
        mass, com, inertia = join_bodies(bodies)
        if robot.inertia is not None:
            arm = arm.with_payload(mass, com, inertia)
        return arm.with_shapes(self._shapes(robot, arm.tool, held))

    def _shapes(self, robot: Robot, grasp: Array, held: HeldObject | None) -> Any:
        """Return the arm's shapes with those of gripper and object."""
        shapes, parts = robot.shapes, ((self.shapes, robot.tool), (() if held is None else held.shapes, grasp))
        for name, (objects, T) in zip(PARTS, parts, strict=True):
            if not len(objects):
                continue
            if shapes is None:
                raise InvalidInput(
                    "robot",
                    f"{robot.name!r}, which has no shapes",
                    f"an arm with shapes, because the {name} has shapes",
                )
            shapes = shapes.with_part(name, len(robot.fixed), objects, T)
        return shapes


def check_width(gripper: Gripper, width: float) -> float:
    """Return a distance of the fingers [m], checked to be at most the opening."""
    expected = f"a distance of the fingers from 0 to {gripper.opening:g} m, the gripper's opening"
    if check_number(width, "width", expected, least=0.0) > gripper.opening:
        raise InvalidInput("width", f"{width:g} m", expected)
    return float(width)


def _body(mass: float, com: ArrayLike, inertia: ArrayLike | None, where: str) -> Body:
    """Return a checked rigid body."""
    mass = check_number(mass, f"mass of {where}", "a finite mass ≥ 0 [kg]", least=0.0)
    tensor = np.zeros((3, 3)) if inertia is None else check_shape(inertia, (3, 3), f"inertia of {where}")
    return check_body((mass, check_shape(com, (3,), f"centre of mass of {where}"), tensor), where)
