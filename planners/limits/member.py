"""Limits of one member of a group, on the motion of a chain through several. They are judged in the member's own base."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.plain import read_numbers, read_record
from optik.arm.robot import Robot
from optik.types import Array
from planners.limits.base import Limit
from planners.limits.inputs import Extreme, LimitedMotion, LimitedPath, PathPoints, ToolExtreme
from planners.paths.base import Path


@dataclass(frozen=True)
class MemberValue:
    """A limit of a member: the member in its own base, its joints among those of the chain, and the value of its limit."""

    robot: Robot
    columns: tuple[int, ...]
    value: Any


@dataclass(frozen=True)
class MemberPath:
    """The joint path q(s) of a member."""

    whole: LimitedPath
    robot: Robot
    columns: tuple[int, ...]

    @property
    def path(self) -> Path:
        """The path of the chain."""
        return self.whole.path

    @property
    def end(self) -> float:
        """Path parameter at the end [m, or rad]."""
        return self.whole.end

    def __call__(self, x: ArrayLike, order: int = 0) -> Array:
        """Return q or one of its derivatives in s (k, n)."""
        return np.ascontiguousarray(self.whole(x, order)[:, self.columns])


class MemberPoints(PathPoints):
    """Points of a member's joint path; its tool moves over ground, not along the path of the chain."""

    @property
    def twist(self) -> Array:
        """Twists (k, 6) of the member's tool per unit of s."""
        return np.asarray(np.einsum("kij,kj->ki", self.joint_path.robot.jacobian(self.q()), self.q(1)))


class MemberLimit(Limit):
    """A limit of a member, by the kind of limit of a single arm; its value is a `MemberValue`."""

    def __init__(self, member: str, kind: Limit) -> None:
        self.member, self.kind, self.name = member, kind, f"{member}.{kind.name}"  # type: ignore[misc]
        self.units, self.order, self.homogeneous = kind.units, kind.order, kind.homogeneous  # type: ignore[misc]
        self.subject, self.on_goods = kind.subject and f"{member}/{kind.subject}", kind.on_goods  # type: ignore[misc]

    def check(self, value: Any) -> Any:
        """Return the value unchanged."""
        return value

    def array(self, value: Any, n: int) -> Any:
        """Return the value unchanged."""
        return value

    def to_plain(self, value: MemberValue) -> Any:  # type: ignore[override]
        """Return plain data with the member, its joints and its limit."""
        robot, columns = value.robot.to_dict(), list(value.columns)
        return {"robot": robot, "columns": columns, "value": self.kind.to_plain(value.value)}

    def from_plain(self, data: Any, n: int) -> Any:
        """Return the value from plain data."""
        data = read_record(data, ("robot", "columns", "value"), f"limits.{self.name}")
        robot, columns = (
            Robot.from_dict(data["robot"]),
            read_numbers(data["columns"], (len(data["columns"]),), "columns"),
        )
        return MemberValue(robot, tuple(int(k) for k in columns), self.kind.from_plain(data["value"], robot.n))

    def scaled(self, value: MemberValue, factor: float) -> MemberValue:
        """Return a limit multiplied by a factor."""
        return replace(value, value=self.kind.scaled(value.value, factor))

    def is_given(self, limit: MemberValue) -> bool:
        """Return whether a limit is finite anywhere."""
        return self.kind.is_given(self._own(limit))

    def check_robot(self, robot: Robot, limit: MemberValue) -> None:
        """Raise InvalidInput for a member whose model lacks what the limit needs, such as masses."""
        self.kind.check_robot(limit.robot, self._own(limit))

    def check_still(self, joint_path: LimitedPath, limit: MemberValue) -> None:
        """Raise NoSolution for a joint path on which the limit is exceeded however slowly the member moves."""
        self.kind.check_still(MemberPath(joint_path, limit.robot, limit.columns), self._own(limit))

    def rows(self, at: PathPoints, limit: MemberValue) -> Array:
        """Return the rows at points of a joint path."""
        path = MemberPath(at.joint_path, limit.robot, limit.columns)
        own = tuple(np.ascontiguousarray(at.q(order)[:, limit.columns]) for order in range(4))
        return self.kind.rows(MemberPoints(path, at.s, own), self._own(limit))

    def subjects(self, robot: Robot, limit: MemberValue | None = None) -> tuple[str, ...]:
        """Return the names of the limited joints, or of the limited part."""
        assert limit is not None
        return tuple(f"{self.member}/{one}" for one in self.kind.subjects(limit.robot, self._own(limit)))

    def judge(self, motion: LimitedMotion, limit: MemberValue) -> Extreme | ToolExtreme:
        """Return the peak value over a motion."""
        return self.kind.judge(motion.of_member(limit.robot, limit.columns), self._own(limit))

    def piece_ratios(self, motion: LimitedMotion, limit: MemberValue) -> Array:
        """Return the peak ratio to the limit on each piece of a motion."""
        return self.kind.piece_ratios(motion.of_member(limit.robot, limit.columns), self._own(limit))

    def excess(self, motion: LimitedMotion, limit: MemberValue) -> Array:
        """Return the factors by which the law `optimal` tightens the rows on each piece."""
        return self.kind.excess(motion.of_member(limit.robot, limit.columns), self._own(limit))

    def stretch_factor(self, motion: LimitedMotion, limit: MemberValue) -> float:
        """Return the least factor by which a motion is stretched in time to respect the limit."""
        return self.kind.stretch_factor(motion.of_member(limit.robot, limit.columns), self._own(limit))

    def _own(self, limit: MemberValue) -> Any:
        """Return the limit as the methods of its kind take it."""
        return self.kind.array(limit.value, limit.robot.n)
