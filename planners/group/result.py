"""The plan of a group: the motion of a chain through its members, that of each member, and what is proved between them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, combinations_with_replacement
from typing import Any

import numpy as np

from optik.arm.group import Group
from optik.errors import InvalidInput
from optik.scene import Scene
from optik.view.page import Page, show_page
from planners.certificate.certificate import Certificate
from planners.certificate.clearance import Clearance, clearance
from planners.certificate.held import HeldPose, prove_held
from planners.files import save
from planners.following.failure import PlanFailure
from planners.group.limits import join_member_limits
from planners.limits import DERIVATIVES, MotionLimits
from planners.motion import Motion, PlanStatus
from planners.motion.motion import World
from planners.motion.show import show_motion, show_trajectory
from planners.paths.base import Path
from planners.paths.joint_curve import JointCurve
from planners.paths.program import ProgramPath
from planners.planning.result import Plan
from planners.ros.export import RosExport
from planners.trajectory import Trajectory, map_joints

OF_MEMBER = "both links belong to one member"
"""Reason why a pair is left out of the distance between two members."""


@dataclass(frozen=True, repr=False)
class GroupPlan:
    """The plan of a group.

    ``bool(plan)`` is True if there is a motion and its certificate is valid. If two arms carry a workpiece, their own
    certificates must also be valid.

    Attributes
    ----------
    group, limits, scene
        The arguments of `plan`. `limits` maps each member to its limits, and ``"path"`` to the limits along the path.
    frame, tool : str
        The member whose tool is the base of the chain, and the member whose tool is its end.
    chain_plan : Plan, or CombinedMotion
        The plan of the chain, with the joints in the order of the chain. For `combine`, the combined motion of both members.
        The certificate has the limits of all members: ``"arm.torque"`` is judged in the arm's own base.
    paths : mapping of str to Path
        Paths in the world of the members that carry a workpiece; else empty.
    member_motions : mapping of str to Motion, optional
        The motions of the members, if they were given (`planners.combine`).
    """

    group: Group
    frame: str
    tool: str
    limits: Mapping[str, MotionLimits]
    scene: Scene | None
    chain_plan: Plan
    paths: Mapping[str, Path]
    member_motions: Mapping[str, Motion] | None = None

    def __bool__(self) -> bool:
        return bool(self.chain_plan) and all(motion.certificate.is_valid for motion in self._along.values())

    def __repr__(self) -> str:
        return str(self)

    def __str__(self) -> str:
        return "\n".join([str(self.chain_plan), *self.remarks])

    @property
    def remarks(self) -> list[str]:
        """Text lines on the proofs that the certificate of the chain does not contain.

        They state path errors in the world, the relative pose of two tools, and distances between members.
        """
        lines = list[str]()
        if self.chain_plan.has_motion:
            for name, motion in self._along.items():
                lines += [f"{name}: {line}" for line in str(motion.certificate).splitlines()]
            lines += [] if self.held is None else [f"held: {self.held}"]
            for name, one in self.clearances.items() if self.scene is not None else ():
                lines += [f"clearance of {name} {words} {kind.describe()}" for words, kind in one.kinds.items()]
        return lines

    def _repr_html_(self) -> str:
        """Return verdict, peaks and plots for a notebook."""
        return self.chain_plan._repr_html_() if isinstance(self.chain_plan, Plan) else self.certificate._repr_html_()

    @property
    def _plan(self) -> Plan:
        """The plan of the chain; raises InvalidInput for given motions, which have no common path."""
        if not isinstance(self.chain_plan, Plan):
            raise InvalidInput("plan", "two given motions, without a common path", "one of plan.members, by its name")
        return self.chain_plan

    @property
    def status(self) -> PlanStatus:
        """Status of the plan."""
        return self.chain_plan.status

    @property
    def failure(self) -> PlanFailure | None:
        """Where and why it failed."""
        return self.chain_plan.failure

    @property
    def certificate(self) -> Certificate:
        """The certificate of the chain's motion; raises `NoSolution` if there is no motion."""
        return self.chain_plan.certificate

    @property
    def motion(self) -> Motion:
        """The motion of the chain, for files, messages and viewers; raises `NoSolution` if there is none.

        A result of `combine` has no such motion and raises InvalidInput; use `members`.
        """
        return replace(self._plan.motion, world=World(self.group, self.scene))

    @property
    def duration(self) -> float:
        """Duration of the motion [s]; raises `NoSolution` if there is no motion."""
        return self.chain_plan.duration

    @cached_property
    def trajectory(self) -> Trajectory:
        """The motion of all joints, in the order of the group; raises `NoSolution` if there is no motion."""
        return map_joints(self.chain_plan.trajectory, np.eye(self.group.n)[self.group.places(self.chain_plan.robot)])

    @cached_property
    def members(self) -> dict[str, Motion]:
        """The motion of each member with its limits and the scene; raises `NoSolution` if there is no motion."""
        return (
            dict(self.member_motions)
            if self.member_motions
            else {name: self._make_motion(name) for name in self.group.members}
        )

    @property
    def _along(self) -> dict[str, Motion]:
        """The motions of members that follow a path in the world."""
        return {name: self.members[name] for name in self.paths}

    def _make_motion(self, name: str) -> Motion:
        """Return the motion of a member."""
        plan, robot, limits, proof = self.chain_plan, self.group.members[name], self.limits[name], self.certificate
        columns, sections = self.group.places(plan.robot)[self.group.columns(name)], getattr(plan, "sections", ())
        curves = []
        for joints in [one.joint_path for one in sections or (plan,)]:
            rows = joints.at_nodes[:, :, columns]
            curves.append(JointCurve(robot, joints.nodes, rows[:, 0], rows[:, 1:]))
        whole = ProgramPath(curves, [robot] * len(curves)) if sections else curves[0]
        path, moved = self.paths.get(name) or whole, map_joints(plan.trajectory, np.eye(self.group.n)[columns])
        kinds = {one: one if one in DERIVATIVES else f"{name}.{one}" for one in limits.names}
        enforced, scene = tuple(one for one, kind in kinds.items() if kind in proof.enforced), self._find_scene(name)
        return Motion(robot, path, limits, moved, plan.law, enforced, proof.tolerance, scene=scene)

    def _find_scene(self, member: str) -> Scene | None:
        """Return the scene for one member, with its links in ``allow`` named without the prefix ``MEMBER/``."""
        if self.scene is None:
            return None
        parts = [(link.partition("/"), other) for link, other in self.scene.allow]
        return replace(self.scene, allow=tuple((own, other) for (name, _, own), other in parts if name == member))

    @cached_property
    def held(self) -> HeldPose | None:
        """Bounds on the distance and the angle between two tools that carry a workpiece; None if they carry none."""
        if len(self.paths) < 2:
            return None
        speeds = [self.members[name].certificate.analysis.tool_speed[0] for name in self.paths]
        chain = self.group.chain(self.frame, self.tool)
        return prove_held(chain, self.chain_plan.trajectory, np.max(speeds, axis=0))

    @cached_property
    def clearances(self) -> dict[str, Clearance]:
        """Proved minimum distances over the motion: of each member to the scene, between its own links, and between members."""
        own = {
            name: clearance(motion.robot, motion.trajectory, motion.scene or Scene())
            for name, motion in self.members.items()
        }
        return own | {f"{one} and {other}": self._find_clearance(one, other) for one, other in combinations(own, 2)}

    def _find_clearance(self, *pair: str) -> Clearance:
        """Return the proved distances between two members."""
        chain, moved = self.group.chain(*pair), np.eye(self.group.n)[self.group.order(*pair)]
        assert chain.shapes is not None
        each = [[one for one in dict.fromkeys(chain.shapes.names) if one.startswith(f"{name}/")] for name in pair]
        apart = [(one, other, OF_MEMBER) for names in each for one, other in combinations_with_replacement(names, 2)]
        between = chain.with_shapes(chain.shapes.with_apart(apart))
        return clearance(between, map_joints(self.trajectory, moved), Scene())

    def show(self) -> Page:
        """Show all members and the obstacles in the world: in the cell of a notebook, else in the browser."""
        plan: Any = self.chain_plan
        if isinstance(plan, Plan):
            return show_page(show_motion(self)) if plan.has_motion else plan.show()
        limits, world = join_member_limits(self.group, plan.robot, self.limits), World(self.group, self.scene)
        return show_page(show_trajectory(plan.robot, plan.trajectory, self.certificate, limits, None, world))

    def plot(self) -> Any:
        """Plot the joints over time against their limits, as `Plan.plot`.

        A result of `combine` raises InvalidInput; use `members`.
        """
        return self._plan.plot()

    def save(self, file: str | os.PathLike[str], **options: Any) -> RosExport | None:
        """Save the motion of the chain and the members in the world; `members` save those of each member.

        Parameters
        ----------
        file : str or path
            Its suffix chooses the format, as of `planners.save`. In a ROS format, one file is written for each member (see
            `planners.to_ros`).
        **options
            As for `planners.save`.

        Returns
        -------
        RosExport or None
            For messages, the result of `to_ros`.
        """
        return save(self, file, **options)
