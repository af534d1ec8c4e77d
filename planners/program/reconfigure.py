"""A path that needs reconfigurations: stretches of it; between two, the tool leaves, the arm moves, and the tool returns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from optik import newton
from optik.arm.robot import Robot
from optik.errors import NoSolution
from optik.ik import solve_ik
from optik.types import Array
from planners.following.collision import CollisionCheck
from planners.following.resolve.freedoms import FreeWay, Resolver, can_resolve
from planners.motion import PlanStatus
from planners.paths.base import Path
from planners.paths.free_path import FreePath
from planners.paths.stretch import Stretch
from planners.planning.result import Plan
from planners.program.parts import Item, Move, Part, Program

MOST_ADVISED = 8
"""Most reconfigurations of which a refusal speaks."""
RETREATS = (0.1, 0.05, 0.02, 0.0)
"""Distances [m] by which the tool leaves the path along its axis z before the arm moves: the longest that is possible."""
POLISHING_STEPS = 8
"""Newton steps after which the tool comes back exactly where it left."""
CHANGEABLE = tuple(
    PlanStatus[name]
    for name in ("OUTSIDE_LIMITS", "BRANCH_JUMP", "SINGULAR", "CONTACT", "NO_PATH_FOUND", "UNREACHABLE")
)
"""Failures that a reconfiguration can change."""

PlanProgram = Callable[[Program, Array], Plan]
"""`planners.plan` of a program from a start, with all other arguments given."""


def reconfigure(
    failed: Plan, path: Path, q: Array | None, held: bool, most: int, time_limit: float, plan_program: PlanProgram
) -> Plan:
    """Return the plan of a path with at most so many reconfigurations; with none, the refusal that says how many help."""
    fixed = path.asked != "pose" or (isinstance(path, FreePath) and len(path.screws) > 0 and not can_resolve(path))
    if failed.status not in CHANGEABLE or path.in_joints or fixed or failed.robot.n < 6:
        return failed
    collision = None if failed.scene is None else CollisionCheck(failed.robot, failed.scene)
    resolver = Resolver(failed.robot, path, collision, time_limit)
    found, made = resolver.find(q, held=held, many=True, cuts=max(most, MOST_ADVISED))
    if not found or not made.cuts:
        return failed
    assert failed.failure is not None
    count = len(made.cuts)
    if count > most:
        at = ", ".join(f"{s:.4g}" for s in made.cuts)
        some = f"{count} reconfiguration{'s' if count > 1 else ''}, at s = {at} {path.unit}"
        advice = (
            f"reconfigurations={count} (--reconfigurations {count}): a way with {some}, was found, which stops there"
        )
        return replace(failed, failure=replace(failed.failure, advice=f"{advice}; or {failed.failure.advice}"))
    ways = resolver.relax([part for part in found[0] if len(part.s) > 1])
    last = failed
    for retreat in RETREATS:
        try:
            items = list_items(failed.robot, path, ways, retreat, avoid=failed.scene is not None)
        except NoSolution:
            continue
        last = plan_program(Program(items), ways[0].q[0])
        if last:
            break
    return replace(last, resolution=made)


def list_items(robot: Robot, path: Path, ways: list[FreeWay], retreat: float, *, avoid: bool) -> list[Item]:
    """Return the parts of a program: each stretch of the path, and the moves from one to the next.

    The tool leaves the path against its axis z, the arm moves, and the tool comes back. Raises NoSolution if the arm cannot
    be where it comes back from.
    """
    items: list[Item] = []
    for i, way in enumerate(ways):
        if i:
            begin = robot.fk(way.q[0])
            begin[:3, 3] -= retreat * begin[:3, 2]
            above = solve_ik(robot, begin, way.q[0])
            if not above:
                raise NoSolution("the tool cannot leave the path there")
            newton.polish_batch(robot.chain, above.q[None], begin[None], POLISHING_STEPS)
            moves = [Part(Move([0.0, 0.0, -retreat])), Part(above.q, avoid=avoid), Part(Move([0.0, 0.0, retreat]))]
            items += moves if retreat else [Part(way.q[0], avoid=avoid)]
        whole = path.given if isinstance(path, FreePath) else path
        part: Path = Stretch(whole, way.s[0], way.s[-1])
        if isinstance(path, FreePath):
            freed = FreePath(part, path.bounds, starts=1)
            part = freed.with_coefficients(way._replace(s=way.s - way.s[0]).fit(freed), None)
        items.append(Part(part, name=f"stretch {i + 1}"))
    return items
