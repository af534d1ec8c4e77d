"""Chunks of poses: joint targets on the branch of the running motion, each continued from the one before."""

from __future__ import annotations

from math import ceil

import numpy as np

from optik.arm.limits import LIMIT_TOLERANCE
from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.kinematics import Chain, error_of_pose, jacobian_from, workspace
from optik.linear import copy_vector, damped_step, smallest_singular_value
from optik.newton import LEAST_DAMPING
from optik.types import Array
from planners.retarget.chunk import Chunk

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
