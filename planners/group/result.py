"""The plan of a group: that of a chain through its members, and its motion by member."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations_with_replacement
from typing import Any

import numpy as np

from optik.arm.group import Group
from optik.scene import Scene
from optik.view.page import Page
from planners.certificate.certificate import Certificate
from planners.certificate.clearance import Clearance, clearance
from planners.files import save
from planners.following.failure import PlanFailure
from planners.limits import DERIVATIVES, MotionLimits
from planners.motion import Motion, PlanStatus
from planners.paths.joint_curve import JointCurve
from planners.planning.result import Plan
from planners.trajectory import Trajectory, map_joints

OF_MEMBER = "of one member"
"""Reason why a pair is left out of the distance between two members."""


@dataclass(frozen=True, repr=False)
class GroupPlan:
    """The plan of a group. ``bool(plan)`` is success: there is a motion, and its certificate is valid.

    Attributes
    ----------
    group, frame, tool, limits, scene
        The arguments of the plan; limits by member, and of ``"path"`` those along the path.
    view : Plan
        The plan of the chain from the tool of `frame` to that of `tool`, whose joints are in the chain's order. Its certificate
        has the limits of all members: ``"arm.torque"`` is judged in the arm's own base.
    """

    group: Group
    frame: str
    tool: str
    limits: Mapping[str, MotionLimits]
    scene: Scene | None
    view: Plan

    def __bool__(self) -> bool:
        return bool(self.view)

    def __repr__(self) -> str:
        return str(self)

    def __str__(self) -> str:
        lines = [str(self.view)]
        for name, one in self.clearances.items() if self.scene is not None and self.view.has_motion else ():
            lines += [f"  clearance of {name}: {words} {kind.describe()}" for words, kind in one.kinds.items()]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """Return verdict, peaks and plots for a notebook."""
        return self.view._repr_html_()

    @property
    def status(self) -> PlanStatus:
        """How planning ended."""
        return self.view.status

    @property
    def failure(self) -> PlanFailure | None:
        """Where and why it failed."""
        return self.view.failure

    @property
    def certificate(self) -> Certificate:
        """The certificate of the chain's motion; raises `NoSolution` if there is no motion."""
        return self.view.certificate

    @property
    def duration(self) -> float:
        """Duration of the motion [s]; raises `NoSolution` if there is no motion."""
        return self.view.duration

    @cached_property
    def trajectory(self) -> Trajectory:
        """The motion of all joints, in the order of the group; raises `NoSolution` if there is no motion."""
        return map_joints(self.view.trajectory, np.eye(self.group.n)[:, self.group.order(self.frame, self.tool)])

    @cached_property
    def members(self) -> dict[str, Motion]:
        """The motion of each member, along its own joints, with its limits and the scene; raises `NoSolution` if there is none."""
        return {name: self._make_motion(name) for name in self.group.members}

    def _make_motion(self, name: str) -> Motion:
        """Return the motion of a member."""
        robot, limits, joints = self.group.members[name], self.limits[name], self.view.joint_path
        columns = [list(self.group.order(self.frame, self.tool)).index(k) for k in self.group.columns(name)]
        rows = joints.at_nodes[:, :, columns]
        path = JointCurve(robot, joints.nodes, rows[:, 0], rows[:, 1:])
        moved = map_joints(self.view.trajectory, np.eye(self.group.n)[columns])
        enforced = tuple(one for one in limits.names if one in DERIVATIVES or limits.value(one) is not None)
        enforced = tuple(one for one in enforced if self._is_enforced(name, one))
        return Motion(robot, path, limits, moved, self.view.law, enforced, scene=self._find_scene(name))

    def _is_enforced(self, member: str, limit: str) -> bool:
        """Return whether the motion must respect a limit of a member."""
        return (limit if limit in DERIVATIVES else f"{member}.{limit}") in self.certificate.enforced

    def _find_scene(self, member: str) -> Scene | None:
        """Return the scene of a member alone, whose links in ``allow`` have its own names."""
        if self.scene is None:
            return None
        parts = [(link.partition("/"), other) for link, other in self.scene.allow]
        return replace(self.scene, allow=tuple((own, other) for (name, _, own), other in parts if name == member))

    @cached_property
    def clearances(self) -> dict[str, Clearance]:
        """Proved distances over the motion: of each member to the scene and of its own links, and between the members."""
        scene = Scene() if self.scene is None else self.scene
        own = {
            name: clearance(motion.robot, motion.trajectory, motion.scene or Scene())
            for name, motion in self.members.items()
        }
        chain = self.group.chain(self.frame, self.tool)
        assert chain.shapes is not None
        each = [[one for one in dict.fromkeys(chain.shapes.names) if one.startswith(f"{name}/")] for name in own]
        apart = [(one, other, OF_MEMBER) for names in each for one, other in combinations_with_replacement(names, 2)]
        between = chain.with_shapes(chain.shapes.with_apart(apart))
        return own | {
            " and ".join(own): clearance(between, self.view.trajectory, replace(Scene(), margin=scene.margin))
        }

    def show(self) -> Page:
        """Show the motion of the tool in its frame: in the cell of a notebook, else in the browser."""
        return self.view.show()

    def plot(self) -> Any:
        """Plot the joints over time against their limits, as `Plan.plot`."""
        return self.view.plot()

    def save(self, file: str | os.PathLike[str]) -> None:
        """Save the motion of the chain, in the format of the file's suffix; `members` save those of each member."""
        save(self.view, file)
