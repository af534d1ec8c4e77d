"""Collision-free solutions: a method is run from many initial guesses, and each solution is checked for collisions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from optik.ik.problem import IKResult, IKStatus, check_problem, sample_restart
from optik.scene import Scene
from optik.scene.contact import Contact, check_scene, find_contact

if TYPE_CHECKING:
    from optik.ik.base import IKSolver

COLLISION_FREE_SEEDS = 100
"""Least number of additional initial guesses. A call of `lm` takes microseconds, and a 6R arm usually has eight branches."""


def solve_collision_free(
    solver: IKSolver, target: ArrayLike, q0: ArrayLike, scene: Scene, trace: bool = False
) -> IKResult:
    """Find a configuration whose tool pose is the target and which collides neither with a scene nor with itself."""
    robot = solver.robot
    check_scene(robot, scene)
    first = best = solver.solve(target, q0, trace=trace)
    pose, start = check_problem(robot, target, q0)
    iterations, found, least = 0, 0, Contact(-float("inf"), 0.0, ("", ""))
    for restart in range(max(COLLISION_FREE_SEEDS, solver.max_restarts) + 1):
        again = sample_restart(robot, pose, start, restart) if restart else start
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
    gap = f"the best has {1e3 * least.distance:.3g} mm between {one} and {other}"
    words = f"all {found} solutions found are closer than the margin or in contact; {gap}"
    return best._replace(status=IKStatus.IN_CONTACT, iterations=iterations, message=words)
