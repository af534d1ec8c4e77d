"""A solution that is free of contact: the method's answers from one start after another, each judged by the arm's shapes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from optik.arm.shapes.contact import check_scene, contact
from optik.ik._problem import check_problem, restart_configuration
from optik.ik._result import IKResult
from optik.ik._status import IKStatus
from optik.scene import Scene

if TYPE_CHECKING:
    from optik.ik.base import IKSolver

STARTS = 100
"""Starts that are tried at least: calls of `lm` take microseconds, and six joints have eight branches as a rule."""


def solve_free(
    solver: IKSolver, target: ArrayLike, q0: ArrayLike, scene: Scene, margin: float, trace: bool = False
) -> IKResult:
    """Find a configuration whose tool pose is the target, and which touches neither a scene nor itself.

    Parameters
    ----------
    solver : IKSolver
        The method, built for an arm with shapes.
    target : (4, 4) array
        T_base_tool [1, m].
    q0 : (n,) array
        First start, inside the limits [rad, m].
    scene : Scene
        What must not be touched.
    margin : float
        What all distances must exceed [m].
    trace : bool
        Whether to keep the error of every iteration.

    Returns
    -------
    IKResult
        The first free solution; else IN_CONTACT, with the solution that is farthest from contact, or the failure to find any.

    Raises
    ------
    InvalidInput
        An arm without shapes, no scene, a margin below 0, or as `IKSolver.solve`.
    UnknownName
        A link in ``scene.allow`` that the arm does not have.
    """
    robot = solver.robot
    margin = check_scene(robot, scene, margin)
    first = best = solver.solve(target, q0, trace=trace)
    pose, start = check_problem(robot, target, q0)
    iterations, found, least, pair = 0, 0, -float("inf"), ("", "")
    for restart in range(max(STARTS, solver.max_restarts) + 1):
        result = (
            first
            if restart == 0
            else solver.solve(pose, restart_configuration(robot, pose, start, restart), trace=trace)
        )
        iterations += result.iterations
        if not result:
            if result.status is IKStatus.UNREACHABLE:
                break
            continue
        near = contact(robot, scene, result.q)
        if near.distance > margin:
            return result._replace(iterations=iterations, restarts=max(restart, result.restarts))
        found += 1
        if near.distance > least:
            best, least, pair = result, near.distance, near.pair
    if not found:
        return first
    words = (
        f"all {found} solutions found touch; in the best one, {pair[0]} and {pair[1]} are {1e3 * least:.4g} mm apart"
    )
    return best._replace(status=IKStatus.IN_CONTACT, iterations=iterations, message=words)
