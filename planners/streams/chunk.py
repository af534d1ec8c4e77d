"""Chunk: joint targets or poses at a fixed rate, as learned policies emit them, and joint velocities that jog an arm."""

from __future__ import annotations

import os
from dataclasses import dataclass
from math import ceil
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.limits import LARGEST_LIMIT, LIMIT_TOLERANCE, ask_for_degrees
from optik.arm.robot import Robot
from optik.check import check_number, real_array
from optik.compiled import compiled
from optik.errors import InvalidInput
from optik.kinematics import Chain, error_of_pose, jacobian_from, workspace
from optik.linear import copy_vector, damped_step, smallest_singular_value
from optik.newton import LEAST_DAMPING
from optik.se3 import check_pose
from optik.tables import Names, read_table
from optik.types import Array, Flags
from planners.certificate.analysis import check_rate

# ---------------- jogging


class Jog(NamedTuple):
    """Joint velocities (n,) [rad/s, m/s], and the time [s] after which the arm stops."""

    velocity: Array
    hold: float


class JogVelocity:
    """A source of `planners.stream` that commands joint velocities.

    Parameters
    ----------
    velocity : (n,) array, optional
        The first command [rad/s, m/s].
    timeout : float
        Time after a command at which the arm stops, if no other has come [s].

    Raises
    ------
    InvalidInput
        A time-out that is not above 0.
    """

    def __init__(self, velocity: ArrayLike | None = None, timeout: float = 0.2) -> None:
        self.timeout = check_number(timeout, "timeout", "seconds above 0", above=0.0)
        self._next: Jog | None = None
        if velocity is not None:
            self.set(velocity)

    def set(self, velocity: ArrayLike) -> None:
        """Command velocities.

        Parameters
        ----------
        velocity : (n,) array
            [rad/s, m/s]; the stream reduces them to the limits.
        """
        self._next = Jog(real_array(velocity, "velocity", "finite joint velocities", (...,)), self.timeout)

    def __call__(self, now: object) -> Jog | None:
        """Return the command that came since the last call."""
        command, self._next = self._next, None
        return command


# ---------------- chunk


FEWEST, MOST = 4, 1000
"""Points of a reference: a chunk with fewer is divided; and the largest number of a chunk."""
OUTSIDE = (0.005, 0.1)
"""Distances beyond the ranges up to which targets are clipped to them: prismatic joints [m], revolute ones [rad]."""


@dataclass(frozen=True, eq=False)
class Chunk:
    """Joint targets or tool poses at a fixed rate, the first at the time of the observation.

    Parameters
    ----------
    points : (m, n) or (m, 4, 4) array
        Targets, at least two: joints [rad, m], or poses of the tool in the base frame [1, m], which `retarget` follows on the
        branch of the running motion.
    rate : float
        Targets per second, in [10⁻⁶, 10⁹] [1/s].
    observed : float
        Time of the first target [s], on the clock of the running motion: the instant at which a policy observed the robot.

    Raises
    ------
    InvalidInput
        Points that are not finite or fewer than two, a rate out of range, or a time that is not finite.
    """

    points: ArrayLike
    rate: float
    observed: float = 0.0

    def __post_init__(self) -> None:
        expected = f"an (m, n) array of 2 to {MOST} finite joint targets, or (m, 4, 4) of poses"
        points = real_array(self.points, "points", expected).copy()
        poses = points.shape[1:] == (4, 4)
        if not (poses or points.ndim == 2) or not 2 <= len(points) <= MOST:
            raise InvalidInput("points", f"an array of shape {points.shape}", expected)
        for k, pose in enumerate(points if poses else ()):
            check_pose(pose, f"points[{k}]")
        if not poses and not (finite := np.isfinite(points).all(axis=1)).all():
            got = "NaN" if np.isnan(points[k := int(finite.argmin())]).any() else "an infinite number"
            raise InvalidInput("points", f"{got} in row {k}", "finite numbers")
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "rate", check_rate(self.rate))
        object.__setattr__(self, "observed", check_number(self.observed, "observed", "a time [s]"))


def read_targets(chunk: Chunk, robot: Robot, free: Flags, ranges: Array) -> tuple[Array, float, int, int, int]:
    """Return the repaired targets (m, n), their rate [1/s], and the numbers of repaired targets, clipped targets and jumps.

    Joints without limits (`free`) take the shortest way from target to target, from half a turn around 0 on. A target that
    equals the one before in all joints, but not the next one, stands for a missing one. It becomes the mean of its neighbours.
    Targets outside ranges (n, 2) are clipped to them. Joints with limits that jump by more than π are counted.
    """
    P, rate = np.array(chunk.points), chunk.rate
    P[:, free] = np.unwrap(P[:, free] - 2.0 * np.pi * np.round(P[0, free] / (2.0 * np.pi)), axis=0)
    jumps = np.abs(np.diff(P, axis=0)) > np.where(free | robot.prismatic, np.inf, np.pi)
    given, P = P, np.minimum(np.maximum(P, ranges[:, 0]), ranges[:, 1])
    clipped, same = (given != P).any(axis=1), (P[1:] == P[:-1]).all(axis=1)
    changed = clipped.copy()
    for i in np.flatnonzero(same[:-1] & ~same[1:]) + 1:
        P[i], changed[i] = 0.5 * (P[i - 1] + P[i + 1]), True
    while len(P) < FEWEST:
        P, rate = np.insert(P, range(1, len(P)), 0.5 * (P[1:] + P[:-1]), axis=0), 2.0 * rate
    return P, rate, int(changed.sum()), int(clipped.sum()), int(jumps.any(axis=1).sum())


def refuse_targets(P: Array, robot: Robot) -> str:
    """Return why targets (m, n) are too far outside the ranges to be followed, or an empty text."""
    lower, upper = np.maximum(robot.limits.lower, -LARGEST_LIMIT), np.minimum(robot.limits.upper, LARGEST_LIMIT)
    grace, beyond = np.where(robot.prismatic, *OUTSIDE), np.maximum(lower - P, P - upper)
    excess = beyond.max(axis=0)
    if (excess <= grace).all():
        return ""
    i = int((np.minimum(excess, LARGEST_LIMIT) / grace).argmax())
    k = int(beyond[:, i].argmax())
    unit = "m" if robot.prismatic[i] else "rad"
    reach = f"its range [{robot.limits.lower[i]:.6g}, {robot.limits.upper[i]:.6g}] {unit}"
    if np.isinf((robot.limits.lower if P[k, i] < lower[i] else robot.limits.upper)[i]):
        reach = f"±{LARGEST_LIMIT:g} {unit}, the largest position that is computed with"
    words = f"{P[k, i]:.6g} {unit}, {excess[i]:.3g} {unit} outside {reach}"
    asked = ask_for_degrees(robot.limits, ~robot.prismatic, P)
    return f"target {k} of {robot.joint_names[i]} is {words}{': ' if asked else ''}{asked}"


def load_chunks(
    file: str | os.PathLike[str], robot: Robot, rate: float, *, columns: Names = None, ignore: Names = None
) -> list[Chunk]:  # fmt: skip
    """Read the chunks of a table with the columns observed, index, and the joints in the robot's order.

    Parameters
    ----------
    file : str or path
        A table with a header, such as ``observed,index,q1_deg,q2_deg,…``. Rows with the same time of observation are one
        chunk, in the order of their index.
    robot : Robot
        The arm.
    rate : float
        Targets per second [1/s].
    columns : str or sequence of str, optional
        Names of the columns of a file without a header, or new names.
    ignore : str or sequence of str, optional
        Columns that are left out.

    Returns
    -------
    list of Chunk
        By time of observation.

    Raises
    ------
    InvalidInput
        Missing or other columns, cells that are not numbers, a chunk with fewer than two targets.
    """
    joints = {f"q{i + 1}": "m" if slides else "rad" for i, slides in enumerate(robot.prismatic)}
    expected = f"columns observed,index,q1,…,q{robot.n} (or q1_deg,… or joint names)"
    table = read_table(file, columns, ignore)
    names = dict(zip(robot.joint_names, joints, strict=True))
    table = table._replace(columns={names.get(name, name): column for name, column in table.columns.items()})
    table = table.resolve(joints | {"observed": "s", "index": ""})
    if not {"observed", "index", *joints} <= {*table.columns}:
        advice = f"of another arm than {robot.name}: robot=; other names: columns="
        raise table.make_header_error(expected, advice)
    table.refuse_others(["observed", "index", *joints], expected)
    observed, index = table.read_numbers(["observed"])[:, 0], table.read_numbers(["index"])[:, 0]
    q, chunks = table.read_numbers(list(joints)), []
    if asked := ask_for_degrees(robot.limits, ~robot.prismatic, q):
        raise InvalidInput(table.locate(), f"q up to {np.abs(q).max():.4g}", "angles [rad]", advice=asked)
    for t in np.unique(observed):
        rows = np.flatnonzero(observed == t)
        if rows.size < 2:
            raise InvalidInput(table.locate(int(rows[0])), f"one target observed at {t:g} s", "at least two")
        chunks.append(Chunk(q[rows[np.argsort(index[rows], kind="stable")]], rate, float(t)))
    return chunks


# ---------------- chunks of poses


LEAST_SINGULAR, LARGEST_RATIO = 2e-3, 10.0
"""Least singular value of the Jacobian at a pose [m/rad, 1], and largest ratio of joint motion to tool motion [rad/m, 1]:
beyond them a pose counts as singular or as reached past a singular configuration."""
LARGEST_MOVE, MOST_MOVES = 0.05, 200
"""Largest motion of a joint in one step towards a pose [rad, m], and the largest number of steps."""
REACHED, SAME = 1e-11, 1e-6
"""Largest distance of the tool from a reached pose [m, rad], and of equal configurations [rad, m]."""
UNEVEN, SWEEPS = 2.0, 20
"""Ratio of the largest to the mean step of redundant joints above which the steps are evened out, and the number of sweeps."""
FOUND, MISSED, SINGULAR, LEAVES = range(4)
"""Results of a pose: found; not reached; singular, or next to one; LEAVES + i: joint i leaves its range."""
WORDS = "", "is not reached on the arm's branch", "is singular, or the joints pass a singular configuration on the way"
"""The first three results in words."""


@compiled
def _approach(chain: Chain, target: Array, ranges: Array, q: Array) -> int:
    """Move a configuration q (n,) to a pose by short steps of least norm; redundant joints stay in their ranges."""
    n, spare, whole = q.size, max(q.size - 6, 0), 0.0
    frame, T, J = workspace(chain, n)
    e, dq, A, y, start, free = np.empty(6), np.empty(n), np.empty((6, 6)), np.empty(6), q.copy(), np.ones(n)
    for _ in range(MOST_MOVES):
        p2, r2 = error_of_pose(chain, target, q, frame, T, e)
        jacobian_from(chain, frame, T, J)
        whole = max(whole, p2 + r2)
        if np.abs(e).max() <= REACHED:
            over = np.maximum(ranges[0] - q, q - ranges[1])
            if over.max() > LIMIT_TOLERANCE:
                return LEAVES + int(over.argmax())
            around = ((q - start) ** 2).sum() > LARGEST_RATIO * LARGEST_RATIO * whole + SAME * SAME
            return SINGULAR if around or smallest_singular_value(J, LEAST_SINGULAR) < LEAST_SINGULAR else FOUND
        J *= free
        if not damped_step(J, e, LEAST_DAMPING, A, y, dq):
            break
        q += dq * min(1.0, LARGEST_MOVE / np.abs(dq).max())
        for i in range(n):
            if spare > 0 and not ranges[0, i] <= q[i] <= ranges[1, i]:
                q[i], free[i], spare = min(max(q[i], ranges[0, i]), ranges[1, i]), 0.0, spare - 1
    return MISSED


@compiled
def continue_poses(chain: Chain, poses: Array, ranges: Array, ahead: Array, q: Array) -> tuple[int, int]:
    """Write the configurations of poses (m, 4, 4) into q (m + 1, n), each continued from the row before.

    An arm with up to six joints must reach the same configuration from the extrapolated one; for the first two poses this is
    the row before plus `ahead` (2, n) [rad, m]. Returns the number of poses that were found, and the result of the next one.
    """
    n, x, count, result = q.shape[1], np.empty(q.shape[1]), 0, FOUND
    for k in range(poses.shape[0]):
        copy_vector(q[k], q[k + 1])
        result = _approach(chain, poses[k], ranges, q[k + 1])
        if result == FOUND and n <= 6:
            x[:] = q[k] + (ahead[k] if k < 2 else q[k] - q[k - 1])
            if k > 2:
                x += q[k] - 2.0 * q[k - 1] + q[k - 2]
            if _approach(chain, poses[k], ranges, x) != FOUND or np.abs(x - q[k + 1]).max() > SAME:
                result = SINGULAR
        if result != FOUND:
            break
        count = k + 1
    steps = ((q[2 : count + 1] - q[1:count]) ** 2).sum(axis=1) if count > 1 else np.zeros(1)
    for _ in range(SWEEPS if n > 6 and np.sqrt(steps.max()) > UNEVEN * np.sqrt(steps).mean() else 0):
        for k in range(1, count + 1):
            x[:] = 0.5 * (q[k - 1] + q[min(k + 1, count)])
            if _approach(chain, poses[k - 1], ranges, x) == FOUND:
                copy_vector(x, q[k])
    return count, result


def resolve_poses(robot: Robot, chunk: Chunk, state: Array, at: float) -> tuple[Chunk | None, str]:
    """Return a chunk of poses as a chunk of joints on the branch of a state (3, n) at a time [s], and why it ends early.

    It is continued to both sides from the pose that is nearest to the tool, but not later than by the clock.
    """
    poses, (q, dq) = np.asarray(chunk.points), state[:2]
    if poses.ndim == 2:
        return chunk, ""
    latest = ceil(min(max((at - chunk.observed) * chunk.rate, 0.0), len(poses) - 1.0))
    i = int(np.abs(poses[: latest + 1] - robot.fk(q)).sum(axis=(1, 2)).argmin())
    lead, step = np.clip(chunk.observed + i / chunk.rate - at, -1.0, 1.0) * dq, dq / chunk.rate
    later, why = _continue(robot, poses[i:], q, np.stack([lead, step]))
    earlier, _ = _continue(robot, poses[:i][::-1], later[0] if len(later) else q, -np.stack([step, step]))
    points, end = np.concatenate([earlier[::-1], later]), i + len(later)
    cut = f"the chunk of {len(poses)} poses ends before pose {end} (counted from 0), which {why}" if why else ""
    if not len(later) or len(points) < 2:
        return None, cut
    return Chunk(points, chunk.rate, chunk.observed + (i - len(earlier)) / chunk.rate), cut


def _continue(robot: Robot, poses: Array, start: Array, ahead: Array) -> tuple[Array, str]:
    """Return the configurations (k, n) of the first poses, continued from a start (n,), and what is wrong with the next one."""
    q, ranges = np.tile(start, (len(poses) + 1, 1)), np.stack([robot.limits.lower, robot.limits.upper])
    count, result = continue_poses(robot.chain, np.ascontiguousarray(poses), ranges, ahead, q)
    names = (f"takes {name} out of its range" for name in robot.joint_names)
    return q[1 : count + 1], (*WORDS, *names)[result]
