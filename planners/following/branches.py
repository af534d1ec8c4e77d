"""Choose branch and winding for a whole path: track every configuration at its start, check for contact, compare."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.limits import LIMIT_TOLERANCE
from optik.arm.motors import ranges_of
from optik.arm.robot import Robot
from optik.ik import Tolerance
from optik.scene import Scene
from optik.scene.contact import Contact, advise_contact, check_scene, find_contact, find_nearest_pairs
from optik.types import Array
from planners.certificate.clearance import Clearance, clearance
from planners.following import march
from planners.following.failure import FollowStatus, PlanFailure, format_position
from planners.following.joint_path import Course, JointPath, make_empty_guide, smallest_singular_values
from planners.following.track import FollowedTrack, TrackEnd, cut_at_motors, find_departures, find_regular_roots, track
from planners.paths.base import Path
from planners.trajectory import Trajectory
from planners.trajectory.curve import quintic_through

# ---------------- collision checks of configurations and joint paths against a scene


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


# ---------------- choose branch and winding for a whole path


Rooms = Callable[[Array], Array]
"""Function that returns the rooms of configurations (k, n) [m]: the least distance to a scene, less its margin, or of links."""
BRANCH_STATIONS = 31
"""Equally spaced samples at which branches are compared: steps are below 0.25 rad on most paths; tracking adds more."""
SAME_CONFIGURATION = 1e-4
"""Configurations nearer than this on every joint [rad or m], modulo whole turns, are the same."""
MOTION_WEIGHT = 1.0
"""Weight in a branch's cost of its length in joint space [rad or m]: the unit of the other weights."""
LIMITS_WEIGHT = 0.5
"""Weight of the mean over the path of Σ ((q − middle) / half)²: half a radian for a joint that stays at its limit."""
SINGULAR_WEIGHT = 0.2
"""Weight of −ln of the smallest singular value along the path: half a radian for one that is ten times as small."""
START_WEIGHT = 1.0
"""Weight of the distance from a given start [rad or m]."""
CLEARANCE_WEIGHT, ENOUGH_ROOM, SMALLEST_ROOM = 0.2, 0.05, 1e-4
"""Weight of −ln of the room: half a radian for one that is a tenth. Rooms above the second number [m] count as equal, and those
below the third."""


class Branch(NamedTuple):
    """One branch of configurations along a path.

    Attributes
    ----------
    q : (n,) array
        Configuration at the path's start [rad, m], with the winding that goes farthest, and of those the cheapest.
    cost : float
        Sum with the weights of this module [rad]; lower is better. Infinite if it cannot be followed or starts in collision.
    s : float
        Path parameter at its end [m, or rad].
    ended : Ended or None
        Its end before the end of the path, or None.
    """

    q: Array
    cost: float
    s: float
    ended: TrackEnd | None


def find_branches(robot: Robot, path: Path, near: Array | None = None, rooms: Rooms | None = None) -> list[Branch]:
    """Return the branches of all configurations at the path's start: the best first, then those that end early.

    The rooms are those of configurations in a scene: a start in collision comes last.

    For an arm of up to six joints a configuration that is not singular has exactly one continuation, so these are
    all branches. A winding of a joint is possible if the joint, shifted by these whole turns, stays inside its limits on the
    whole path. Windings are chosen joint by joint, since neither motion nor cost couples them.
    """
    tolerance, course = Tolerance(1e-5, 1e-5), Course(path, make_empty_guide(robot.n))
    nodes = course.nodes(course.spread(np.linspace(0.0, path.end, BRANCH_STATIONS), tolerance))
    open_ended = np.full(robot.n, np.inf)
    branches = []
    for root in _find_starts(robot, course, nodes.poses[0], near):
        way = track(robot, course, nodes, root, tolerance, (-open_ended, open_ended))
        if len(way.s) > 1:
            branch = _choose_winding(robot, path, way, near)
            cost = branch.cost + (0.0 if rooms is None else _measure_rooms(rooms(way.q)))
            branches.append(branch._replace(cost=cost))
        else:
            branches.append(Branch(root, np.inf, 0.0, way.ended))
    return sorted(branches, key=lambda branch: (-branch.s, branch.cost))


def _measure_rooms(room: Array) -> float:
    """Return the cost of the rooms (k,) along a branch; infinite for a start in collision."""
    return float(clearance_costs(room).max()) if room[0] > 0.0 else np.inf


def clearance_costs(room: Array) -> Array:
    """Return the costs (k,) of configurations by their rooms [m]."""
    return -CLEARANCE_WEIGHT * np.log(np.clip(room, SMALLEST_ROOM, ENOUGH_ROOM) / ENOUGH_ROOM)


def _find_starts(robot: Robot, course: Course, pose: Array, near: Array | None) -> Array:
    """Return configurations (k, n) inside the limits at the path's start, each with one winding."""
    # All regular ones; and of singular ones, which are curves of solutions, those from which a smooth motion starts.
    start = near if near is not None and robot.limits.contains(near) else None
    found, singular = find_regular_roots(robot, pose, march.REGULAR, start)
    if singular:
        singular_starts = [left.q for left, _ in find_departures(robot, course)]
        found = np.concatenate([found, np.array(singular_starts).reshape(-1, robot.n)])
    return keep_different(found, SAME_CONFIGURATION, 2.0 * np.pi * robot.turning)


def keep_different(q: Array, apart: float, turn: ArrayLike) -> Array:
    """Return configurations (k, n) that differ by more than a distance [rad, m], modulo a turn of each joint, or 0."""
    kept: list[Array] = []
    for x in q:
        away = (x - known for known in kept)
        if all(np.abs(d - turn * np.round(d / (2.0 * np.pi))).max() > apart for d in away):
            kept.append(x)
    return np.array(kept).reshape(-1, q.shape[1])


def _choose_winding(robot: Robot, path: Path, way: FollowedTrack, near: Array | None) -> Branch:
    """Return the branch with the winding of every joint that goes farthest, and of those the cheapest."""
    turns, ends, joint, posture = np.zeros(robot.n), np.inf, -1, 0.0
    for i in range(robot.n):
        leaves, _, cost, k = min(_list_windings(robot, way, i, near), key=lambda w: (-w[0], w[1]))
        turns[i], posture = 2.0 * np.pi * k, posture + cost
        if leaves < ends:
            ends, joint = leaves, i
    end, ended = float(way.s[-1]), way.ended
    if ends < end:
        end, ended = ends, TrackEnd(march.LIMIT, ends, 0.0, ranges_of(robot).find(joint))
    if robot.motors is not None:
        cut = cut_at_motors(robot, way, turns).ended
        if cut is not None and cut.s < end:
            end, ended = cut.s, cut
    motion = float(np.linalg.norm(np.diff(way.q, axis=0), axis=1).sum())
    q = way.q[0] + turns
    sigma = smallest_singular_values(robot, way.q)
    regular = float(np.log(np.maximum(sigma.min(), march.SMALLEST_SINGULAR_VALUE)))
    cost = MOTION_WEIGHT * motion + posture - SINGULAR_WEIGHT * regular
    if near is not None:
        cost += START_WEIGHT * float(np.linalg.norm(q - near))
    return Branch(q, cost, path.end if ended is None else end, ended)


def _list_windings(
    robot: Robot, way: FollowedTrack, i: int, near: Array | None
) -> list[tuple[float, float, float, int]]:
    """Return the windings of joint i that start inside its limits: path parameter where each leaves them, two costs, turns."""
    # s is infinite if it stays inside. The first cost includes the distance from a given start.
    low, high = robot.limits.lower[i], robot.limits.upper[i]
    q, turn = way.q[0, i], 2.0 * np.pi
    if not robot.turning[i] or low == high:
        first = last = 0
    elif np.isinf(low) or np.isinf(high):  # nearest to the start, or to the finite limit
        goal = near[i] if near is not None else np.clip(0.0, low, high)
        first = last = int(np.round((goal - q) / turn))
        if not low <= q + turn * first <= high:
            first = last = int(np.ceil((low - q) / turn) if np.isinf(high) else np.floor((high - q) / turn))
    else:
        first, last = int(np.ceil((low - 1e-9 - q) / turn)), int(np.floor((high + 1e-9 - q) / turn))
    steps = np.gradient(way.s) / (way.s[-1] - way.s[0])
    out = []
    for k in range(first, last + 1):
        shift = np.zeros(robot.n)
        shift[i] = k * turn
        lower, upper = robot.limits.lower - shift - LIMIT_TOLERANCE, robot.limits.upper - shift + LIMIT_TOLERANCE
        leaves = march.find_limit_exit(way.s, way.q, way.dq, lower, upper, i)
        x = robot.limits.normalise(way.q + shift)[:, i]
        cost = LIMITS_WEIGHT * float(x**2 @ steps)
        away = START_WEIGHT * abs(q + k * turn - near[i]) if near is not None else 0.0
        out.append((leaves, cost + away, cost, k))
    return out or [(0.0, 0.0, 0.0, 0)]
