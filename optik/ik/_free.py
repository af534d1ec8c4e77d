"""A solution that is free of contact: the method's answers from one start after another, each judged by the arm's shapes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from optik.arm.shapes.contact import Contact, check_scene, find_contact
from optik.ik._problem import check_problem, restart_configuration
from optik.ik._result import IKResult
from optik.ik._status import IKStatus
from optik.scene import Scene

if TYPE_CHECKING:
    from optik.ik.base import IKSolver

STARTS = 100
"""Starts that are tried at least: calls of `lm` take microseconds, and six joints have eight branches as a rule."""


def solve_free(solver: IKSolver, target: ArrayLike, q0: ArrayLike, scene: Scene, trace: bool = False) -> IKResult:
    """Find a configuration whose tool pose is the target, and which touches neither a scene nor itself."""
    robot = solver.robot
    check_scene(robot, scene)
    first = best = solver.solve(target, q0, trace=trace)
    pose, start = check_problem(robot, target, q0)
    iterations, found, least = 0, 0, Contact(-float("inf"), 0.0, ("", ""))
    for restart in range(max(STARTS, solver.max_restarts) + 1):
        again = restart_configuration(robot, pose, start, restart) if restart else start
        result = solver.solve(pose, again, trace=trace) if restart else first
        iterations += result.iterations
        if not result:
            if result.status is IKStatus.UNREACHABLE:
                break
            continue
        near = find_contact(robot, scene, result.q)
        if near.room > 0.0:
            return result._replace(iterations=iterations, restarts=max(restart, result.restarts))
        found += 1
        if near.room > least.room:
            best, least = result, near
    if not found:
        return first
    one, other = least.pair
    words = f"all {found} solutions found touch; the best has {1e3 * least.distance:.4g} mm between {one} and {other}"
    return best._replace(status=IKStatus.IN_CONTACT, iterations=iterations, message=words)
