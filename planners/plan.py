"""plan(): compute a joint path, its timing and its certificate in one call."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any, overload

from numpy.typing import ArrayLike

from optik.arm.group import Group
from optik.arm.robot import Robot
from optik.check import check_choice, check_count, check_keywords
from optik.errors import InvalidInput, NoSolution
from optik.ik import SolverLike, get_solver
from optik.ik.base import Tolerance, ToleranceLike
from optik.ik.problem import check_start
from optik.registry import label
from optik.scene import Scene
from planners.certificate.violation import LIMIT_WORDS, Allow, check_allow
from planners.choice.first_paths import check_avoid, check_avoidable
from planners.choice.planner import MotionPlanner
from planners.following.follow import DEFAULT_TOLERANCE, read_time_limit
from planners.group.planner import plan_group
from planners.group.result import GroupPlan
from planners.limits import MotionLimits, check_path
from planners.motion import PlanStatus
from planners.paths.base import Path
from planners.paths.goal import WINDINGS, path_to
from planners.planning.planner import PlanOptions, PlanRequest
from planners.planning.result import Plan, PlanSeconds
from planners.program.parts import Program
from planners.program.planner import ProgramPlan, plan_program, reconfigure
from planners.search.base import SearchLike
from planners.timing import LawLike, make_law

__all__ = ["Plan", "PlanSeconds", "PlanStatus", "ProgramPlan", "make_law", "path_to", "plan"]


@overload
def plan(robot: Robot, *arguments: Any, **options: Any) -> Plan: ...
@overload
def plan(robot: Group, *arguments: Any, **options: Any) -> GroupPlan: ...
@check_keywords
def plan(
    robot: Robot | Group, path: Any, q_start: Any = None, *,
    solver: SolverLike = "lm", timing: LawLike = "optimal", limits: Any = None, samples: int = 151,
    branch: str | None = None, rate: float = 1000.0, duration: float | None = None, strict: bool = False,
    tolerance: ToleranceLike = DEFAULT_TOLERANCE, allow: Allow = (), scene: Scene | None = None,
    avoid: bool | SearchLike = False, winding: str = "nearest", resolve: str = "auto", time_limit: float | None = None,
    reconfigurations: int = 0, tool: str | tuple[str, str] | None = None, frame: str | None = None,
) -> Plan | GroupPlan:  # fmt: skip
    """Plan the joint motion that takes the tool along a path, and certify its limits.

    Parameters
    ----------
    robot : Robot, or Group
        Arm, or several mechanisms.
    path : Path, Program, (4, 4) array, or (n,) array
        Path of the tool. A pose stands for the straight line to it, and joints [rad, m] for the straight line in joint space.
        For a group, also a mapping from members to goals: joints, or poses in the world.
    q_start : (n,) array, optional
        Configuration at the path's start [rad, m]; by default the configuration that `plan` chooses (see `branch`).
    solver : str, path, type, or IKSolver
        Method of inverse kinematics: a name, a file, a class, or an object.
    timing : str, path, type, or TimeLaw
        Time law: a name, a file, a class, or an object, such as ``make_law("constant_speed", speed=0.1)``.
    limits : MotionLimits, or mapping of str to MotionLimits, optional
        By default the limits of the robot. Limits that are given, such as ``MotionLimits.of(robot, velocity=1, jerk=50)``, must
        be respected, even if the law does not enforce them, unless `allow` names them. For a group, a mapping from members, and
        ``"path"`` for the speed along the path, to limits.
    samples : int
        Number of equally spaced positions on the path, both ends included, that the method of inverse kinematics solves.
    branch : {"start", "best"}, optional
        "start" stays on the branch of ``q_start``; it is the default if ``q_start`` is given. "best" chooses the branch, and
        the multiples of 2π of joints that allow them.
    rate : float
        Rate of the controller [1/s], for `Certificate.sampled_jerk`.
    duration : float, optional
        Duration [s] of the motion. A motion is stretched to it. It is shortened only if the law enforces no limits.
    strict : bool
        If True, a motion that exceeds a limit enforced by its law is refused. If False, the default, it is stretched in time.
    tolerance : Tolerance, or (2,) tuple of float
        Largest distance [m] and angle [rad] between tool and path of a valid motion.
    allow : {"limits", "jerk"}, or both
        Limits that the motion may exceed if the law does not enforce them: "jerk" for the jerk limits, "limits" for all other
        limits.
    scene : Scene, optional
        Obstacles and the margin to them. The motion is proved to be collision-free at every instant, also between the links.
    avoid : bool, or str, path, type or Search
        Whether to search for a collision-free path around the obstacles: to a goal, along a `PointToPoint`, or by the free
        coordinates of a path. A name, a file, a class or an object chooses the search.
    winding : {"nearest", "exact"}
        "nearest": a joint without limits may end at the goal plus a multiple of 2π. "exact": it ends at the given value.
    resolve : {"auto", "local"}
        If the path cannot be followed from one pose to the next, "auto" searches for another sequence of configurations along
        the path. "local" reports a failure.
    time_limit : float, optional
        Largest computing time [s] of the search that ``resolve="auto"`` makes. The number of configurations of this search is
        always limited.
    reconfigurations : int
        How often the tool may leave the path to continue in another configuration. If it does, the result is a `ProgramPlan`.
    tool : str, or (2,) tuple of str, optional
        Member of a group whose tool follows the path, or both members that carry a workpiece. By default the member other than
        `frame`, or the first member.
    frame : str, optional
        Member of a group in whose tool frame the path is given. By default the member other than `tool`.

    Returns
    -------
    Plan
        ``bool(plan)`` is False if there is no valid motion. `Plan.failure` then has the path parameter, the reason and advice.
        For a `Program` it is a `ProgramPlan`, for a group a `GroupPlan`.

    Raises
    ------
    InvalidInput
        An invalid argument; a limit that the law needs and that is missing; an arm without shapes.
    UnknownName
        An unknown method or law.
    """
    options: dict[str, Any] = {
        "solver": solver, "timing": timing, "samples": samples, "branch": branch, "rate": rate, "duration": duration,
        "strict": strict, "tolerance": Tolerance.of(tolerance), "allow": allow, "scene": scene, "avoid": avoid,
        "winding": winding, "resolve": resolve, "time_limit": time_limit,
    }  # fmt: skip
    if isinstance(robot, Group):
        return plan_group(robot, path, q_start, (frame, tool), limits, options, partial(_plan, most=reconfigurations))
    for name, value in (("tool", tool), ("frame", frame)):
        if value is not None:
            raise InvalidInput(name, repr(value)[:60], "none for one arm: it names a member of an optik.Group")
    return _plan(
        robot,
        path,
        q_start,
        PlanOptions(MotionLimits.of(robot) if limits is None else limits, **options),
        reconfigurations,
    )


def _plan(
    robot: Robot, path: Path | Program | ArrayLike, q_start: ArrayLike | None, options: PlanOptions, most: int
) -> Plan:
    """Return the plan of a program, or of one path with at most ``most`` reconfigurations."""
    check_count(most, "reconfigurations", 0)
    if not isinstance(path, Program):
        return _plan_path(robot, path, q_start, options, most)
    if most:
        raise InvalidInput("reconfigurations", most, "0 for a program: plan the path of a part alone")
    if options.branch is not None or options.avoid is not False:
        which = "avoid" if options.branch is None else "branch"
        got, expected = getattr(options, which), "none for a program: each part chooses for itself (Part.avoid)"
        raise InvalidInput(which, repr(got)[:60], expected)
    return plan_program(robot, path, q_start, _plan_path, options)


def _plan_path(
    robot: Robot, path: Path | ArrayLike, q_start: ArrayLike | None, options: PlanOptions, most: int = 0
) -> Plan:
    """Return the plan along one path, with at most ``most`` reconfigurations."""
    seconds, solver = read_time_limit(options.resolve, options.time_limit), get_solver(robot, options.solver)
    request = _build_request(robot, path, q_start, options, label(solver))
    planner = MotionPlanner(solver, request, options.samples, options.strict, seconds)
    plan = planner.run(q_start, options.branch, options.duration)
    seconds -= 0.0 if plan.resolution is None else plan.resolution.seconds
    if plan or seconds <= 0.0:
        return plan
    q, held = None if q_start is None else check_start(robot, q_start, "q_start"), options.branch != "best"
    without = replace(options, branch=None, avoid=False)
    program = partial(plan_program, robot, plan_path=_plan_path, options=without)
    return reconfigure(plan, plan.path, q, q is not None and held, most, seconds, program)


def _build_request(
    robot: Robot, path: Path | ArrayLike, q_start: ArrayLike | None, options: PlanOptions, solver: str
) -> PlanRequest:
    """Return the request, with defaults filled in, after checking that the arguments are consistent."""
    law, limits = make_law(options.timing), options.limits
    avoid, winding, unreachable = check_avoid(options.avoid), check_choice(options.winding, "winding", WINDINGS), None
    winding = "exact" if isinstance(path, Path) else winding
    if avoid is not False:
        try:
            path = check_avoidable(robot, path, q_start, options.scene, winding)
        except NoSolution as error:  # no configuration reaches a pose as goal: only the straight line remains
            assert not isinstance(path, Path)
            path, unreachable = path_to(robot, path, q_start), error
    elif not isinstance(path, Path):
        path = path_to(robot, path, q_start, winding)
    law.need(limits, robot)
    check_path(limits, path)
    return PlanRequest(
        robot, path, limits, solver, law, options.tolerance, options.rate, scene=options.scene,
        allow=check_allow(options.allow, LIMIT_WORDS), avoid=avoid, winding=winding, unreachable=unreachable,
    )  # fmt: skip
