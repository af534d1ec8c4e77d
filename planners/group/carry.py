"""Joint paths of two arms that carry a workpiece along one path, for one pair of their branches."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import product

import numpy as np

from optik import newton
from optik.arm.robot import Robot
from optik.ik import IKSolver
from optik.scene import Scene
from optik.scene.contact import find_nearest_pairs
from optik.types import Array
from planners.following.branches import find_branches
from planners.following.follow import FollowResult
from planners.following.joint_path import LEAST_SPACING, IKRecord, JointPath
from planners.paths.base import Path
from planners.paths.joint_curve import JointCurve, tool_twists

Follow = Callable[[IKSolver, Array | None], FollowResult]
"""Returns the joint path of an arm, from a start if one is given."""
POLISHING_STEPS = 8
"""Largest number of Newton steps that correct the spline's configuration at a new node."""
MOST_BRANCHES = 8
"""Most branches of an arm that are tried."""
CHECKED = 60
"""Positions along the path at which a pair of branches is checked for contact before it is timed."""


def find_derivatives(robot: Robot, path: Path, joints: JointPath, s: Array) -> tuple[Array, Array]:
    """Return configurations on a path (k, n) and their first three derivatives (k, 3, n) at positions, near a joint path.

    At the nodes, the stored values are returned. Between the nodes, Newton steps correct the configuration of the spline. Its
    derivatives of orders m = 1, 2, 3 are then corrected by δq⁽ᵐ⁾ with J δq⁽ᵐ⁾ = residual of the tool's derivative of order m.
    This keeps the null-space motion of a redundant arm.
    """
    place = np.clip(np.searchsorted(joints.nodes, s), 0, len(joints.nodes) - 1)
    same = joints.nodes[place] == s
    rows = np.stack([joints(s, order) for order in range(4)], axis=1)
    rows[same] = joints.at_nodes[place[same]]
    if (~same).any():
        at, new = s[~same], rows[~same]
        q = new[:, 0].copy()
        newton.polish_batch(robot.chain, q, np.ascontiguousarray(path.pose(at)), POLISHING_STEPS)
        new[:, 0] = q
        inverse = np.linalg.pinv(robot.jacobian(q))
        for order in (1, 2, 3):
            lacking = path.twist(at, order) - tool_twists(robot, new)[:, order - 1]
            new[:, order] += np.einsum("kij,kj->ki", inverse, lacking)
        rows[~same] = new
    return rows[:, 0], rows[:, 1:]


def merge_joint_paths(chain: Robot, path: Path, each: Sequence[JointPath]) -> JointPath:
    """Return the joint path of a chain from those of its members along one path, at the nodes of both."""
    nodes = np.union1d(each[0].nodes, each[1].nodes)
    kept = [0]
    for i in range(1, len(nodes)):
        if nodes[i] - nodes[kept[-1]] >= LEAST_SPACING:
            kept.append(i)
    kept[-1] = len(nodes) - 1
    s = nodes[kept]
    parts = [find_derivatives(one.robot, path, one, s) for one in each]
    q, derivatives = (np.concatenate([x[..., ::-1], y], axis=-1) for x, y in zip(*parts, strict=True))
    still, curve = np.zeros(len(s)), JointCurve(chain, s, q, derivatives)
    curve.unit = path.unit
    return JointPath(chain, curve, s, q, derivatives, IKRecord(still, still, still.astype(np.int64), s))


def follow_branch_pairs(
    solvers: Sequence[IKSolver], path: Path, chain: Robot, scene: Scene | None, follow: Follow,
    starts: Sequence[Array | None],
) -> Iterator[JointPath | FollowResult]:  # fmt: skip
    """Yield joint paths of the chain for pairs of branches of both arms; or the failure of an arm that cannot follow the path.

    The first pair consists of the branches that each arm would choose alone. If there is a scene, the other collision-free
    pairs follow in order of increasing cost.
    """
    each = []
    for solver, q in zip(solvers, starts, strict=True):
        result = follow(solver, q)
        if not result or result.joint_path is None:
            yield result
            return
        each.append([(0.0, result.joint_path)])
    yield merge_joint_paths(chain, path, [paths[0][1] for paths in each])
    if scene is None:
        return
    for solver, q, paths in zip(solvers, starts, each, strict=True):
        if q is None and solver.robot.n <= 6:
            branches = [one for one in find_branches(solver.robot, path) if one.ended is None]
            others = [(one.cost, follow(solver, one.q)) for one in branches[1:MOST_BRANCHES]]
            paths += [(cost, one.joint_path) for cost, one in others if one and one.joint_path is not None]
            paths[0] = (min([0.0, *(one.cost for one in branches)]), paths[0][1])
    for (_, one), (_, other) in sorted(product(*each), key=lambda pair: pair[0][0] + pair[1][0])[1:]:
        joints = merge_joint_paths(chain, path, (one, other))
        if find_nearest_pairs(chain, scene, joints(np.linspace(0.0, joints.end, CHECKED)))[0].min() > 0.0:
            yield joints
