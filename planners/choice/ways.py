"""The fastest plan over the freedoms of a path, and the fastest around obstacles, in rounds from several initial paths."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from optik.arm.robot import Robot
from optik.registry import label, short_name
from optik.scene import Scene
from optik.scene.contact import bodies_of, find_pairs
from optik.types import Array, Indices
from planners.choice import choose
from planners.choice.choose import CHOSEN, FIXED, Choice, ChoiceReport, make_choice, report
from planners.choice.columns import joint_changes
from planners.choice.first_paths import DEFAULT_SEARCH, MOST_WAYS, SEARCHES, advise_elbow, find_easy, find_first_paths
from planners.choice.programme import FreeProgramme
from planners.choice.rows import ClearanceLimits, NearPairs, pair_rooms
from planners.choice.solve import solve_coefficients
from planners.following.follow import FollowResult, PlanFailure
from planners.following.resolve.freedoms import FreeWay
from planners.motion import PlanStatus
from planners.paths.control_curve import DEGREE
from planners.paths.free_path import FreePath
from planners.paths.point_to_point import PointToPoint
from planners.planning.planner import PathPlanner
from planners.planning.result import Plan, SearchReport
from planners.search.base import Search, SearchLike
from planners.search.rrt_connect import RRTConnect
from planners.timing.optimal import Optimal

# ---------------- rounds of the choice around obstacles


NEAR_ROOM, NEAREST_PAIRS = 0.12, 4
"""Clearance [m] below which the first round limits pairs on the initial path, and how many at each grid point."""
REQUIRED_ROOM, FURTHER_ROOM = 2e-3, 3e-3
"""Least clearance [m] at grid points, and what is added to it where the motion came too near beside one."""
SPARE_SLOTS = 4
"""Pairs at each grid point that may be limited besides, when they come near."""
OF_INITIAL, MORE_OF_INITIAL = 0.5, 0.9
"""Largest fractions of the initial path's clearance that a limit requires, so that the initial path meets it: `OF_INITIAL` at
first, `MORE_OF_INITIAL` if the motion comes too near in spite of it. After that there is no such bound."""
EXAMINED_BETWEEN = 4
"""Configurations in each interval that are examined before a motion is certified."""
TOUCHING_ROOM = 2e-5
"""Clearance [m] below which a pair is limited in the next round."""
PUSHES, PUSH_ROOM, PUSH_DAMPING, LONGEST_PUSH = 60, 5e-3, 1e-3, 0.1
"""An initial path is moved out of contact in at most `PUSHES` steps, until the clearance is `PUSH_ROOM` [m]. `PUSH_DAMPING` is
a fraction of the largest curvature, `LONGEST_PUSH` the longest step of a coefficient [rad, m]."""
ENOUGH_GUESSES = 3
"""Initial guesses after which none is tried once a motion is found."""
UNKNOWN = (np.inf, np.nan, OF_INITIAL)
"""The initial clearance [m] of a pair that was not near, the required one, and the fraction of the initial clearance."""
MOST_CUTS = 6
"""Most rounds from one initial path."""


def push_out(
    choice: Choice, scene: Scene, p: Array, near: Array, pairs: NearPairs | None = None
) -> tuple[Array, Array] | None:
    """Return coefficients near p whose path is free of contact at the grid points, and their joints; None if none are found.

    Least squares of the missing clearances, by the method of Levenberg and Marquardt. No timing is involved.
    """
    robot, programme, bodies = choice.robot, choice.programme, bodies_of(choice.robot, scene)
    basis, free, K, D = choice.parts[0], programme.window.free, programme.K, programme.D
    pairs = pairs or NearPairs(robot, scene, K + 1)
    for _ in range(PUSHES):
        place = programme.place(p, near)
        if place is None:
            return None
        near = place.path
        k, pair, rooms = pairs.find(near[0], PUSH_ROOM)
        if (rooms > 0.0).all() and robot.limits.contains(near[0]).all():
            return p, near
        slot = np.arange(k.size) - np.searchsorted(k, k)
        slots = np.full((K + 1, int(slot.max(initial=-1)) + 1), -1)
        slots[k, slot] = pair
        room, slope = np.empty(slots.shape), np.empty((*slots.shape, robot.n))
        pair_rooms(robot.chain, bodies, near[0], scene.margin, slots, room, slope)
        missing, rows = PUSH_ROOM - rooms, slope[k, slot]
        over = np.maximum(near[0] - robot.limits.upper, 0.0) - np.maximum(robot.limits.lower - near[0], 0.0)
        outside = np.nonzero(over)
        missing = np.concatenate([missing, -over[outside]])
        rows, k = np.concatenate([rows, np.eye(robot.n)[outside[1]]]), np.concatenate([k, outside[0]])
        if programme.tool is not None:
            joints = np.empty((K + 1, 4, D, robot.n))
            joint_changes(robot.chain, programme.tool.rows, place.fields, near, joints)
            rows = np.einsum("rj,rdj->rd", rows, joints[k, 0])
        window = (basis.first[k, None] + np.arange(DEGREE + 1))[:, :, None] * D + np.arange(D)
        spread = basis.values[k, 0][:, :, None] * rows[:, None]
        J = np.zeros((len(k), free.size))
        np.put_along_axis(J, window.reshape(len(k), -1), spread.reshape(len(k), -1), axis=1)
        J *= free
        H = J.T @ J
        step = np.linalg.solve(H + PUSH_DAMPING * max(float(H.max()), 1e-12) * np.eye(free.size), J.T @ missing)
        step *= min(1.0, LONGEST_PUSH / max(float(np.abs(step).max()), 1e-12))
        p = choice.bounds.clip(p + step.reshape(p.shape))
    return None


class Cuts:
    """Requirements of clearance of pairs at grid points: table (K + 1, C) [m], NaN where there is none.

    Its columns are the pairs (C,) that were near; `initial` (K + 1, C) are their clearances on the initial path, infinite
    beyond `NEAR_ROOM`.
    """

    def __init__(self, robot: Robot, scene: Scene, q: Array, pairs: NearPairs | None = None) -> None:
        self._near = pairs or NearPairs(robot, scene, len(q))
        self._robot, self._scene, self._count = robot, scene, len(find_pairs(robot, scene).bodies)
        k, pair, room = self._near.find(q, NEAR_ROOM)
        self.pairs, column = np.unique(pair, return_inverse=True)
        self.initial, self.table, self.share = (np.full((len(q), self.pairs.size), x) for x in UNKNOWN)
        self.initial[k, column] = room
        nearest = np.argsort(self.initial, axis=1)[:, :NEAREST_PAIRS]
        near = np.isfinite(np.take_along_axis(self.initial, nearest, axis=1))
        np.put_along_axis(self.table, nearest, np.where(near, REQUIRED_ROOM, np.nan), axis=1)

    def limits(self, choice: Choice) -> ClearanceLimits:
        """Return the limits of all grid points but the ends that are given."""
        chosen = np.isfinite(self.table)
        required = np.where(chosen, self.table, REQUIRED_ROOM)
        required = np.where(self.initial > 0.0, np.minimum(required, self.share * self.initial), required)
        required = np.column_stack([required, np.full(len(required), REQUIRED_ROOM)])  # of all other pairs
        free, D = choice.parts[1], choice.p.shape[1]
        for end, coefficients in ((0, free[:D]), (-1, free[-D:])):
            if not coefficients.any():
                chosen[end], required[end] = False, -np.inf
        slots = np.full((len(chosen), int(chosen.sum(axis=1).max()) + SPARE_SLOTS), -1)
        k, at = np.nonzero(chosen)
        slots[k, np.arange(k.size) - np.searchsorted(k, k)] = self.pairs[at]
        column = np.full(self._count + 1, self.pairs.size)  # the last one is that of no pair
        column[self.pairs] = np.arange(self.pairs.size)
        return ClearanceLimits(self._robot, self._scene, *choice.parts[:2], slots, required, column, self._near)

    def add_touched(self, q: Array) -> bool:
        """Add the pairs in contact at configurations, several in each interval; return whether there are any."""
        at, pairs, _rooms = NearPairs(self._robot, self._scene, len(q)).find(q, TOUCHING_ROOM)
        inside = (at > 0) & (at < len(q) - 1)
        ends = np.concatenate([at[inside] // EXAMINED_BETWEEN, -(-at[inside] // EXAMINED_BETWEEN)])
        self._add(ends, np.tile(pairs[inside], 2))
        return bool(inside.any())

    def add_failed(self, q: Array, s: float, grid: Array) -> None:
        """Add the pair with the least clearance at a configuration, near its path parameter s."""
        _k, pairs, rooms = NearPairs(self._robot, self._scene, 1).find(q[None], np.inf)
        pair, k = int(pairs[rooms.argmin()]), int(np.searchsorted(grid, s))
        around = np.unique(np.clip(np.arange(k - 2, k + 2), 0, len(grid) - 1))
        self._add(around, np.full(around.size, pair))

    def _add(self, k: Indices, pairs: Indices) -> None:
        """Require clearance of pairs at grid points, and more where some was required."""
        k, pairs = np.unique(np.stack([k, pairs]), axis=1)
        before, self.pairs = self.pairs, np.union1d(self.pairs, pairs)
        place, at = np.searchsorted(self.pairs, before), np.searchsorted(self.pairs, pairs)
        old = self.initial, self.table, self.share
        new = (np.full((len(x), self.pairs.size), y) for x, y in zip(old, UNKNOWN, strict=True))
        self.initial, self.table, self.share = new
        self.initial[:, place], self.table[:, place], self.share[:, place] = old
        required, share = self.table[k, at], self.share[k, at]
        again = np.where(share < MORE_OF_INITIAL, MORE_OF_INITIAL, np.inf)
        self.share[k, at] = np.where(np.isnan(required), OF_INITIAL, again)
        self.table[k, at] = np.where(np.isnan(required), REQUIRED_ROOM, required + FURTHER_ROOM)


def _between(path: Array, s: Array) -> Array:
    """Return configurations, `EXAMINED_BETWEEN` in each interval, by cubic interpolation of those at the grid points s."""
    h, (q, q1) = np.diff(s)[:, None, None], path[:2]
    u = (np.arange(EXAMINED_BETWEEN) / EXAMINED_BETWEEN)[:, None]
    a, b = q[:-1, None], q[1:, None]
    v, w = h * q1[:-1, None], h * q1[1:, None]
    inner = a + u * (v + u * (3.0 * (b - a) - 2.0 * v - w + u * (2.0 * (a - b) + v + w)))
    return np.concatenate([inner.reshape(-1, q.shape[1]), q[-1:]])


def choose_in_scene(
    choice: Choice, scene: Scene, fixed: Plan, plan_along: Callable[..., Plan], enough: float, most: float
) -> tuple[Plan, int]:
    """Return the fastest plan that is valid in a scene, or the one along the initial path; and the rounds.

    Every round starts from the same collision-free guess, because the iteration cannot leave an obstacle. An iteration ends at
    a duration of `enough` [s]. Above `most` [s] a guess is given up: further rounds add limits. If no plan is valid and the
    number of coefficients was not given, more coefficients are tried. A joint move between `enough` and `most` is timed again
    on the finer grid, as is the one along the initial path.
    """
    best, tried, rounds, steps = fixed, 0, 0, 0
    pairs = NearPairs(choice.robot, scene, choice.programme.K + 1)
    for finer in itertools.chain([choice], choice.refine()):
        before = tried
        for p, near in finer.guesses():
            if best and tried - before >= ENOUGH_GUESSES:
                break
            tried, pushed = tried + 1, push_out(finer, scene, p, near, pairs)
            if pushed is None:
                continue
            plan, counts = _clear(finer, scene, pushed, plan_along, (enough, most), pairs)
            rounds, steps = rounds + counts[0], steps + counts[1]
            if not (best or plan):
                plan = plan_along(finer.path_of(pushed[0]), pushed[1][0, 0])
            if plan and (not best or plan.trajectory.duration < best.trajectory.duration):
                best = plan
        if best:
            break
    outcome = "the initial path: no other is proved and shorter in time" if best is fixed else CHOSEN
    if best and isinstance(best.path, PointToPoint) and enough < best.trajectory.duration <= most:
        fixed, best = (
            one and (plan_along(one.path, one.joint_path(0.0), DENSITIES[-1]) or one) for one in (fixed, best)
        )
    duration = fixed.trajectory.duration if fixed else best.trajectory.duration
    return replace(best, freedom=report(best, ChoiceReport(outcome, np.nan, tried, steps), duration)), rounds


def _clear(
    choice: Choice, scene: Scene, first: tuple[Array, Array], plan_along: Callable[..., Plan], wanted: tuple[float, float],
    pairs: NearPairs,
) -> tuple[Plan | None, tuple[int, int]]:  # fmt: skip
    """Return the first valid plan from a collision-free guess, or None; and the numbers of rounds and Newton steps."""
    (p, near), (enough, most), s, steps = first, wanted, choice.optimum.programme.s, 0
    cuts = Cuts(choice.robot, scene, near[0], pairs)
    for rounds in range(1, MOST_CUTS + 1):
        programme = FreeProgramme(choice.optimum.programme, *choice.parts, *choice.statics, cuts.limits(choice))
        solution = solve_coefficients(programme, p, choice.bounds, near, damping=choice.damping, enough=enough)
        if solution is None:
            break
        steps += solution.steps
        if solution.duration > most:
            break
        if cuts.add_touched(_between(solution.path, s)):
            continue
        plan = plan_along(choice.path_of(solution.p), solution.path[0, 0])
        if plan:
            return plan, (rounds, steps)
        if not plan.has_motion or plan.certificate.clearance is None or plan.certificate.clearance.proved:
            break
        proof, t = plan.certificate, plan.certificate.clearance.nearest.time
        cuts.add_failed(plan.trajectory(t), proof.s_at(t), s)
    return None, (rounds, steps)


# ---------------- the fastest plan over the freedoms of a path, and the fastest around obstacles from several initial paths


FEW_SEGMENTS = 20
"""Segments of a path up to which several sequences are initial guesses, and up to which a path in a scene is optimised without
`avoid`: on a seam of 400 segments one optimisation takes 2 to 6 s, and does not know the obstacles."""
ENOUGH_GAIN = 0.01
"""Least fraction by which a chosen motion is shorter than a valid one along its initial path, to count as shortened."""
DENSITIES = (1.0, 2.0)
"""Grid intervals around obstacles, as multiples of the law's default. Joint moves are optimised on the first, and on the
second if none is valid: between few grid points, bent paths exceed limits. Paths with freedoms are optimised on the second."""
ENOUGH_NEAR, FAST, NOT_FAR = 1.005, 1.01, 1.1
"""Ratios of a duration to the least one of a joint move. Up to `ENOUGH_NEAR`, no other initial path is tried. Up to `FAST`, an
iteration ends, and the law shortens the motion along its path. Up to `NOT_FAR`, one motion that was shortened is enough."""
MOST_OPTIMISED_PAIRS = 1000
"""Pairs of shapes of a chain through several mechanisms up to which the way around obstacles is optimised: of two arms with 40
capsules each in a shelf, this takes 2 to 20 s, and the motion along the first path 0.5 s."""
EARLY_RESTART = 1000
"""Samples before the first restart of the search there, from which on every second sample is local: half the time of 5,000."""
MAY_GAIN = 1.02
"""Largest ratio of the duration in a round to the best one along other initial paths: above it, a path is given up."""


def choose_on_path(
    planner: PathPlanner, path: FreePath | PointToPoint, followed: FollowResult, ways: Sequence[FreeWay], *, held: bool,
    retime: Callable[[Plan], Plan] | None,
) -> Plan:  # fmt: skip
    """Return the plan over the freedoms of a path with the least joint travel among the nearly fastest ones.

    The planner chooses paths by the law optimal. If `retime` is given, the plans are compared after retiming with its law.
    """
    scene = planner.request.scene

    def plan_along(chosen: FreePath | PointToPoint, q: Array) -> Plan | None:
        return planner.time(chosen, planner.follow_from(chosen, q, scene), None)[0] or None

    fixed, optimum = planner.time(path, followed, None)
    if not fixed:
        return fixed
    timed, easy = [fixed], list[FreeWay]()
    choice = ChoiceReport("the initial path: avoid=True optimises it in the scene")
    if isinstance(path, FreePath):
        easy = find_easy(path, fixed.joint_path, ways, held=held)
        timed += [one for way in easy if (one := plan_along(path.with_coefficients(way.fit(path), None), way.q[0]))]
    if scene is None or path.segments <= FEW_SEGMENTS:
        ways = [*easy, *ways]
        more, choice = choose.choose_coefficients(
            path, fixed.joint_path, optimum, fixed, held=held, plan_along=plan_along, ways=ways
        )
        timed += more
    plans = timed if retime is None else [retime(plan) for plan in timed]
    best, before = choose.pick_plan([plan for plan in plans if plan] or plans[:1]), plans[0]
    if not best:
        return best
    duration = (before if before else best).trajectory.duration
    if best is not before:
        outcome = CHOSEN if best.law == fixed.law else f"{CHOSEN} by the law optimal"
        choice = choice._replace(
            outcome=outcome + ("" if best.trajectory.duration < duration else ": the joints move less")
        )
    elif choice.outcome == CHOSEN:
        choice = choice._replace(outcome="the initial path: no other is shorter in time or in joint travel")
    return replace(best, freedom=report(best, choice, duration))


def choose_searched(
    planner: PathPlanner, path: FreePath | PointToPoint, followed: FollowResult, ways: Sequence[FreeWay], *, held: bool
) -> Plan:
    """Return the fastest collision-free plan from the initial paths that are searched, or why there is no initial path."""
    samples, rounds, tried, plans, request = 0, 0, 0, list[Plan](), planner.request
    scene = request.scene
    assert scene is not None
    paths = 1 if isinstance(path, PointToPoint) and _is_first_enough(request.robot, scene) else SEARCHES
    usual: SearchLike = RRTConnect(restart=EARLY_RESTART) if paths == 1 else DEFAULT_SEARCH
    search = usual if isinstance(request.avoid, bool) else request.avoid
    grids = DENSITIES if isinstance(path, PointToPoint) else DENSITIES[1:]
    initial = (
        find_first_paths(path, scene, search, request.winding, paths) if isinstance(path, PointToPoint) else [None]
    )
    firsts = list[tuple[FreePath | PointToPoint, FollowResult]]()
    for first in itertools.islice(initial, MOST_WAYS):
        tried += 1
        if first is not None:
            samples += first.samples
            if isinstance(first.found, PlanFailure):
                plans = plans or [request.fail(PlanStatus(first.found.status), None, first.found)]
                break
            followed, path = planner.follow(first.found, None, None, None), first.found
        before = min((one.trajectory.duration for one in plans if one), default=np.inf)
        plan, more = _plan_around(planner, path, followed, grids[0], before, ways, held=held, optimise=paths > 1)
        plans, rounds = [*plans, plan], rounds + more
        firsts.append((path, followed))
        if plan and (paths == 1 or not isinstance(request.law, Optimal) or _is_enough(plans)):
            break
    for (path, followed), density in itertools.product(firsts, grids if paths == 1 else grids[1:]):
        if any(plans) or not isinstance(request.law, Optimal):
            break
        plan, more = _plan_around(planner, path, followed, density, np.inf, ways, held=held, optimise=True)
        plans, rounds = [*plans, plan], rounds + more
    best = min(plans, key=lambda one: (not one, one.trajectory.duration if one else 0.0))
    summary = SearchReport(label(search) if isinstance(search, Search) else short_name(search), samples, rounds, tried)
    return replace(best, search=summary, failure=advise_elbow(best.failure, best.path, request.robot))


def _is_first_enough(robot: Robot, scene: Scene) -> bool:
    """Return whether the first valid motion around obstacles is taken: of several mechanisms with many shapes."""
    assert robot.shapes is not None
    return bool(robot.shapes.mechanism) and len(find_pairs(robot, scene).bodies) > MOST_OPTIMISED_PAIRS


def _is_enough(plans: list[Plan]) -> bool:
    """Return whether no other initial path need be tried.

    The last motion is nearly the fastest; or one is chosen that is shorter or replaces an invalid one, and the last one is not
    the first or takes at most `NOT_FAR` of the least duration.
    """
    over = plans[-1].trajectory.duration / (plans[-1].least_duration or np.inf)
    made = [one.freedom for one in plans if one and one.freedom is not None]
    # the gain is 0 if the motion along the initial path is not valid
    gained = any(one.outcome == CHOSEN and (one.gain == 0.0 or one.gain > ENOUGH_GAIN) for one in made)
    return 0.0 < over <= ENOUGH_NEAR or (gained and (len(plans) > 1 or over <= NOT_FAR))


def _plan_around(
    planner: PathPlanner, path: FreePath | PointToPoint, followed: FollowResult, density: float, before: float,
    ways: Sequence[FreeWay], *, held: bool, optimise: bool,
) -> tuple[Plan, int]:  # fmt: skip
    """Return the fastest plan from one initial path on a grid, and the rounds; `before` [s] is the best along earlier ones."""
    scene = planner.request.scene
    assert scene is not None

    def plan_along(chosen: FreePath | PointToPoint, q: Array, density: float = density) -> Plan:
        return planner.time(chosen, planner.follow_from(chosen, q, None), None, density)[0]

    fixed, optimum = planner.time(path, followed, None, density)
    if optimum is None or not optimise:
        made = FIXED if optimum is None else ChoiceReport("the first path, which is not optimised")
        return replace(fixed, freedom=report(fixed, made)) if fixed.has_motion else fixed, 0
    choice, least = make_choice(path, fixed.joint_path, optimum, held=held, ways=ways), fixed.least_duration or 0.0
    return choose_in_scene(choice, scene, fixed, plan_along, FAST * least, MAY_GAIN * before)
