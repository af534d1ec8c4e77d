"""What stands around an arm that follows a path: which configurations and joint paths are free of contact, and where not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optik.arm.robot import Robot
from optik.arm.shapes.contact import Contact, check_scene, find_contact, find_nearest_pairs
from optik.scene import Scene
from optik.types import Array, Flags
from planners.certificate.clearance import Clearance, clearance
from planners.following.joint_path import JointPath
from planners.following.stop import FollowStatus, Stop
from planners.following.track import Track
from planners.hermite import through
from planners.trajectory import Trajectory

PLACES = 401
"""Places of a path at which the first contact is looked for, once one is known: each 0.25 % of the path."""


@dataclass(frozen=True)
class Around:
    """A scene around an arm; checked by `around`."""

    robot: Robot
    scene: Scene

    def free(self, q: Array) -> Flags:
        """At which configurations no links touch, and the scene is farther away than the margin."""
        return np.asarray(find_nearest_pairs(self.robot, self.scene, q)[0] > 0.0)

    def keeps(self, way: Track) -> bool:
        """Whether the quintics through a tracked branch are proved to be free."""
        if len(way.s) < 2 or not self.free(way.q).all():
            return False
        return self._along(through(way.s, way.q, way.dq[:, 0], way.dq[:, 1])).proved

    def start(self, q: Array) -> Stop | None:
        """Why a motion cannot start at a configuration."""
        near = find_contact(self.robot, self.scene, q)
        if near.room > 0.0:
            return None
        reason = f"the start configuration is not free: {self._words(near)}"
        advice = "a start away from it, or a smaller margin; or this pair in scene.allow, where they may touch"
        return Stop(FollowStatus.CONTACT, 0.0, None, reason, advice)

    def stop(self, joints: JointPath) -> Stop | None:
        """Where and why a joint path touches."""
        found = self._along(joints.polynomial)
        if not found.touches:
            return None
        s = np.append(np.linspace(0.0, joints.end, PLACES), found.time)
        touching = ~self.free(joints(s))
        k = int(np.argmax(touching)) if touching[:-1].any() else PLACES
        reason = f"{self._words(find_contact(self.robot, self.scene, joints(s[k])))} at s = {s[k]:.6g}"
        return Stop(FollowStatus.CONTACT, float(s[k]), None, reason, "")

    def _along(self, polynomial: object) -> Clearance:
        """The clearance of a joint path: a motion with s as its time."""
        return clearance(self.robot, Trajectory(polynomial), self.scene)

    def _words(self, near: Contact) -> str:
        first, second = near.pair
        if near.distance <= 0.0:
            return f"{first} and {second} are in contact"
        distance, margin = 1e3 * near.distance, 1e3 * self.scene.margin
        return f"{first} and {second} are {distance:.4g} mm apart, and the margin is {margin:.4g} mm"


def around(robot: Robot, scene: Scene | None) -> Around | None:
    """Return what stands around an arm; None without a scene."""
    check_scene(robot, scene)
    return None if scene is None else Around(robot, scene)
