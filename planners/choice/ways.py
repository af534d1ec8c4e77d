"""The fastest plan over the freedoms of a path, and the fastest around obstacles from several initial paths."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, ClassVar, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from optik.registry import label, short_name
from optik.scene import Scene
from optik.types import Array
from planners.choice.avoid import choose_around, find_guess
from planners.choice.choose import CHOSEN, ChoiceReport, FreedomResult, Timed, choice_for, choose, pick_plan, report
from planners.choice.first_paths import MOST_WAYS, SearchReport, find_first_paths
from planners.choice.orientations import find_easy
from planners.following.follow import FollowResult, PlanFailure
from planners.following.resolve.freedoms import FreeWay
from planners.paths.base import Path
from planners.paths.free_path import FreePath
from planners.paths.point_to_point import PointToPoint
from planners.search.base import Search, SearchLike
from planners.timing.optimal import Optimum

FEW_SEGMENTS = 20
"""Segments of a path up to which several sequences are initial guesses, and up to which a path in a scene is optimised without
`avoid`: on a seam of 400 segments one optimisation takes 2 to 6 s, and does not know the obstacles."""
ENOUGH_GAIN = 0.01
"""If the chosen motion is shorter by less than this fraction than the motion along its initial path, another initial path is
tried."""
DENSITIES = (1.0, 2.0)
"""Grid intervals around obstacles, as multiples of the law's default: between few grid points, bent paths exceed limits."""
ENOUGH_NEAR, FAST, NOT_FAR = 1.005, 1.01, 1.1
"""Ratios of a duration to the least one of a joint move. Up to `ENOUGH_NEAR`, the coarse grid suffices. Up to `FAST`, an
iteration ends, and the law shortens the motion along its path. Up to `NOT_FAR`, the fine grid starts from the coarse result."""
MAY_GAIN = 1.05
"""Largest ratio of the duration on the coarse grid to the best one of other initial paths for which the fine grid is tried."""


class TimedPlan(Timed, Protocol):
    """A plan, as far as the choice among several needs it."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    def __bool__(self) -> bool:
        """Whether the plan is valid."""

    @property
    def law(self) -> str:
        """Name of its time law."""

    @property
    def freedom(self) -> FreedomResult | None:
        """What was done with the freedoms of its path."""

    @property
    def least_duration(self) -> float | None:
        """Duration of the slowest joint alone, for a joint move [s]."""


Q = TypeVar("Q", bound=TimedPlan)
"""Type of the plans that are compared."""
R = TypeVar("R", bound=TimedPlan, covariant=True)
"""Type of the plans that a planner makes."""


class PathPlanner(Protocol[R]):
    """Follows paths and times them; see `planners.planning.planner.MotionPlanner`."""

    def follow(self, path: Path, q: ArrayLike | None, branch: str | None, scene: Scene | None) -> FollowResult:
        """Return the joint path along a path."""

    def follow_from(self, path: Path, q: Array, scene: Scene | None) -> FollowResult:
        """Return the joint path from a computed start."""

    def time(
        self, path: Path, followed: FollowResult, duration: float | None, density: float = 1.0
    ) -> tuple[R, Optimum | None]:
        """Return the plan of a joint path, and the optimum if the law has one."""


def choose_path(
    planner: PathPlanner[Q], path: FreePath | PointToPoint, followed: FollowResult, scene: Scene | None,
    ways: Sequence[FreeWay] = (), *, held: bool, retime: Callable[[Q], Q] | None = None,
) -> Q:  # fmt: skip
    """Return the plan over the freedoms of a path with the least joint travel among the nearly fastest ones.

    The planner chooses paths by the law optimal. If `retime` is given, the plans are compared after retiming with its law.
    """

    def plan_along(chosen: FreePath | PointToPoint, q: Array) -> Q | None:
        return planner.time(chosen, planner.follow_from(chosen, q, scene), None)[0] or None

    fixed, optimum = planner.time(path, followed, None)
    if not fixed:
        return fixed
    found, easy = [fixed], list[FreeWay]()
    made = ChoiceReport("the initial path: avoid=True optimises it in the scene")
    if isinstance(path, FreePath):
        easy = find_easy(path, fixed.joint_path, ways, held=held)
        found += [one for way in easy if (one := plan_along(path.with_coefficients(way.fit(path), None), way.q[0]))]
    if scene is None or path.segments <= FEW_SEGMENTS:
        ways = [*easy, *ways]
        more, made = choose(path, fixed.joint_path, optimum, fixed, held=held, plan_along=plan_along, ways=ways)
        found += more
    plans = found if retime is None else [retime(plan) for plan in found]
    best, before = pick_plan([plan for plan in plans if plan] or plans[:1]), plans[0]
    if not best:
        return best
    duration = (before if before else best).trajectory.duration
    if best is not before:
        outcome = CHOSEN if best.law == fixed.law else f"{CHOSEN} by the law optimal"
        made = made._replace(
            outcome=outcome + ("" if best.trajectory.duration < duration else ": the joints move less")
        )
    elif made.outcome == CHOSEN:
        made = made._replace(outcome="the initial path: no other is shorter in time or in joint travel")
    return replace(best, freedom=report(best, made, duration))


def choose_way(
    planner: PathPlanner[Q], path: FreePath | PointToPoint, followed: FollowResult, scene: Scene,
    search: SearchLike, winding: str, ways: Sequence[FreeWay] = (), *, held: bool, optimal: bool,
) -> tuple[Q | PlanFailure, SearchReport]:  # fmt: skip
    """Return the fastest collision-free plan from the initial paths that are searched, or why there is no initial path."""
    samples, rounds, tried, plans, failure = 0, 0, 0, list[Q](), None
    given = find_first_paths(path, scene, search, winding) if isinstance(path, PointToPoint) else [None]
    for first in itertools.islice(given, MOST_WAYS):
        tried += 1
        if first is not None:
            samples += first.samples
            if isinstance(first.found, PlanFailure):
                failure = first.found
                break
            followed, path = planner.follow(first.found, None, None, None), first.found
        before = min((one.trajectory.duration for one in plans if one), default=np.inf)
        found, spent = _plan_around(planner, path, scene, followed, before, ways, held=held)
        plans, rounds = [*plans, found], rounds + spent
        if found and (not optimal or _is_enough(plans)):
            break
    made = SearchReport(label(search) if isinstance(search, Search) else short_name(search), samples, rounds, tried)
    if not plans:
        assert failure is not None
        return failure, made
    return min(plans, key=lambda one: (not one, one.trajectory.duration if one else 0.0)), made


def _is_enough(plans: list[Q]) -> bool:
    """Return whether no other initial path need be tried: the last motion is nearly the fastest, or one was shortened."""
    over = plans[-1].trajectory.duration / (plans[-1].least_duration or np.inf)
    gained = any(one.freedom is not None and one.freedom.gain > ENOUGH_GAIN for one in plans if one)
    return 0.0 < over <= ENOUGH_NEAR or (gained and (len(plans) > 1 or over <= NOT_FAR))


def _plan_around(
    planner: PathPlanner[Q], path: FreePath | PointToPoint, scene: Scene, followed: FollowResult, before: float,
    ways: Sequence[FreeWay], *, held: bool,
) -> tuple[Q, int]:  # fmt: skip
    """Return the fastest plan from one initial path, and the rounds.

    A move of joints is planned on the coarse grid first. The fine one is left out if the motion is nearly the fastest
    possible, or clearly slower than that from another initial path, `before` [s].
    """
    rounds, best = 0, None
    for density in DENSITIES if isinstance(path, PointToPoint) else DENSITIES[1:]:

        def plan_along(chosen: FreePath | PointToPoint, q: Array, density: float = density) -> Q:
            return planner.time(chosen, planner.follow_from(chosen, q, None), None, density)[0]

        fixed, optimum = planner.time(path, followed, None, density)
        if optimum is None:
            made = replace(fixed, freedom=report(fixed)) if fixed.has_motion else fixed
            return best or made, rounds
        choice, least = choice_for(path, fixed.joint_path, optimum, held=held, ways=ways), fixed.least_duration or 0.0
        guess = find_guess(best, NOT_FAR * least, optimum.programme.s)
        made, result, spent = choose_around(choice, scene, fixed, plan_along, guess, FAST * least)
        made, rounds = replace(made, freedom=result), rounds + spent
        best = made if made and (best is None or made.trajectory.duration < best.trajectory.duration) else best
        if made and not ENOUGH_NEAR * least < made.trajectory.duration <= MAY_GAIN * before:
            break
    return best or made, rounds
