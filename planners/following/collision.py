"""Collision checks of configurations and joint paths against a scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optik.arm.robot import Robot
from optik.scene import Scene
from optik.scene.contact import Contact, advise_contact, check_scene, find_contact, find_nearest_pairs
from optik.types import Array
from planners.certificate.clearance import Clearance, clearance
from planners.following.failure import FollowStatus, PlanFailure, format_position
from planners.following.joint_path import JointPath
from planners.following.track import FollowedTrack
from planners.trajectory import Trajectory
from planners.trajectory.curve import quintic_through

CONTACT_SAMPLES = 401
"""Samples of a path among which the first contact is searched, once a contact is known: one every 0.25 % of the path."""


@dataclass(frozen=True)
class CollisionCheck:
    """A robot, and the scene from which it must keep the margin; its joints are the first of a configuration."""

    robot: Robot
    scene: Scene

    def __post_init__(self) -> None:
        check_scene(self.robot, self.scene)

    def find_rooms(self, q: Array) -> Array:
        """Return the rooms of configurations (k, n) [m]: a configuration whose room is above 0 is collision-free."""
        return find_nearest_pairs(self.robot, self.scene, np.ascontiguousarray(q[:, : self.robot.n]))[0]

    def name_pair(self, q: Array) -> str:
        """Return the two nearest parts at a configuration."""
        return " and ".join(find_contact(self.robot, self.scene, q[: self.robot.n]).pair)

    def proves_free(self, way: FollowedTrack) -> bool:
        """Return whether the quintics through a tracked branch are proved to be collision-free."""
        if len(way.s) < 2 or self.find_rooms(way.q).min() <= 0.0:
            return False
        q, dq = way.q[:, : self.robot.n], way.dq[:, :, : self.robot.n]
        return self._clearance(quintic_through(way.s, q, dq[:, 0], dq[:, 1])).proved

    def check_start(self, q: Array) -> PlanFailure | None:
        """Return the failure of a start configuration in collision, or None."""
        near = find_contact(self.robot, self.scene, q)
        if near.room > 0.0:
            return None
        reason = f"the start configuration is in collision: {self._describe(near)}"
        advice = advise_contact(self.robot, self.scene, near.pair, "another start")
        return PlanFailure(FollowStatus.CONTACT, 0.0, None, reason, advice)

    def check_path(self, joints: JointPath) -> PlanFailure | None:
        """Return the failure of a joint path at its first collision, or None."""
        found = self._clearance(joints.polynomial)
        if not found.touches:
            return None
        s = np.append(np.linspace(0.0, joints.end, CONTACT_SAMPLES), found.nearest.time)
        touching = self.find_rooms(joints(s)) <= 0.0
        k = int(np.argmax(touching)) if touching[:-1].any() else CONTACT_SAMPLES
        near = self._describe(find_contact(self.robot, self.scene, joints(s[k])))
        reason = f"{near} at {format_position(joints.path, s[k])}"
        return PlanFailure(FollowStatus.CONTACT, float(s[k]), None, reason, "")

    def _clearance(self, polynomial: object) -> Clearance:
        """Return the clearance of a joint path, which is certified as a motion with s as its time."""
        return clearance(self.robot, Trajectory(polynomial), self.scene)

    def _describe(self, near: Contact) -> str:
        first, second = near.pair
        if near.distance <= 0.0:
            return f"{first} and {second} are in contact"
        distance, margin = 1e3 * near.distance, 1e3 * self.scene.margin
        return f"{first} and {second} are {distance:.4g} mm apart, and the margin is {margin:.4g} mm"
