"""Random plans over robots, paths, laws and limits: no certificate is contradicted, and every failure's reason is true."""

from dataclasses import fields, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import optik
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.types import Array
from planners import Arc, JointLine, Line, MotionLimits, Path, Plan, Polyline, laws, plan, replan
from planners.planning import PlanStatus
from tests import oracles
from tests.robots import marked

ROBOTS = ("paper6r", "ur5e", "puma560", "panda", "irb120", "kr6", "gen3lite", "iiwa14", "irb910sc", "wx200")
PATHS = ("line", "arc", "polyline", "joint_line")
SHORT, LONG = 40, 410


class Problem(NamedTuple):
    """Arguments of `plan`."""

    robot: Robot
    path: Path
    q_start: Array | None
    options: dict[str, Any]

    def planned(self, **other: Any) -> Plan:
        return plan(self.robot, self.path, self.q_start, **self.options | other)


@cache
def arm(name: str) -> Robot:
    return optik.load(name)


# ---------------------------------------------------------------- draws
def moved(robot: Robot, T: Array, q: Array, size: float, rng: np.random.Generator) -> Array:
    """A pose some way off; for arms of fewer joints mostly one that they can have."""
    step, turn = rng.normal(size=3), rng.normal(size=3)
    if robot.n < 6 and rng.random() < 0.9:
        if robot.n == 4:
            turn[:2] = 0.0
        else:
            out = np.array([np.cos(q[0]), np.sin(q[0]), 0.0])
            step = rng.normal() * out + rng.normal() * np.array([0.0, 0.0, 1.0])
            turn = rng.normal() * np.cross([0.0, 0.0, 1.0], out)
    kind = rng.random()
    step = 0.0 * step if kind < 0.1 else step / np.linalg.norm(step) * size
    turn = 0.0 * turn if kind > 0.6 else turn / np.linalg.norm(turn) * rng.uniform(0.02, 1.5) * min(1.0, 4.0 * size)
    out_pose = T.copy()
    out_pose[:3, 3] += step
    out_pose[:3, :3] = Rotation.from_rotvec(turn).as_matrix() @ T[:3, :3]
    return out_pose


def path_from(robot: Robot, q: Array, kind: str, rng: np.random.Generator) -> Path:
    start = robot.fk(q)
    reach = float(np.linalg.norm(robot.fixed[:, :3, 3], axis=1).sum())
    size = reach * 10.0 ** rng.uniform(-2.0, -0.2)
    if kind == "joint_line":
        share = rng.choice([0.01, 0.1, 1.0])
        goal = q + share * (rng.uniform(robot.limits.lower, robot.limits.upper) - q)
        return JointLine(robot, q, np.where(rng.random(robot.n) < 0.2, q, goal) if rng.random() < 0.5 else goal)
    if kind == "line":
        return Line(start, moved(robot, start, q, size, rng))
    if kind == "polyline":
        poses = [start]
        for _ in range(rng.integers(1, 5)):
            poses.append(moved(robot, poses[-1], q, size * rng.uniform(0.1, 1.0), rng))
        blends = {"blend": 10.0 ** rng.uniform(-4.0, -1.7), "blend_rotation": 10.0 ** rng.uniform(-3.0, -1.0)}
        try:
            return Polyline(poses, **blends)
        except InvalidInput as error:  # arms of few joints often have but one way to turn, and come back on it
            assert "reversal" in error.got
            return Polyline(poses[:2], **blends)
    flat = robot.n < 6
    axis = np.array([0.0, 0.0, 1.0]) if robot.n == 4 else rng.normal(size=3)
    if robot.n == 5:
        axis = np.cross([0.0, 0.0, 1.0], [np.cos(q[0]), np.sin(q[0]), 0.0])
    if flat or rng.random() < 0.5:
        across = np.cross(axis, rng.normal(size=3))
        centre = start[:3, 3] + 0.5 * size * across / np.linalg.norm(across)
        how: Any = ("fixed", "arc")[rng.integers(2)]
        return Arc.about(start, centre, axis, rng.uniform(-1.0, 1.0) * rng.choice([1.0, 6.0, 14.0]), orientation=how)
    goal = moved(robot, start, q, size, rng)
    goal[:3, 3] += 1e-3 * size
    return Arc.through(start, start[:3, 3] + rng.normal(size=3) * 0.5 * size, goal)


def limits_of(robot: Robot, rng: np.random.Generator) -> MotionLimits:
    """Limits over two decades; some per joint, some of the tool."""
    given: dict[str, Any] = {}
    for field, usual in (("velocity", 2.0), ("acceleration", 10.0), ("jerk", 100.0)):
        size: Any = usual * 10.0 ** rng.uniform(-1.0, 1.0)
        if rng.random() < 0.4:
            size = size * 10.0 ** rng.uniform(-0.5, 0.5, robot.n)
        given[field] = size
    if rng.random() < 0.3:
        given["tool_speed"] = 10.0 ** rng.uniform(-1.5, 0.3)
    if rng.random() < 0.2:
        given["rotation_speed"] = 10.0 ** rng.uniform(-1.0, 0.5)
    return MotionLimits(**given)


def problem(seed: int) -> Problem:
    rng = np.random.default_rng([4, seed])
    robot = arm(ROBOTS[seed % len(ROBOTS)])
    kind = PATHS[rng.choice(4, p=(0.35, 0.2, 0.3, 0.15))]
    law = laws()[(seed // len(ROBOTS)) % len(laws())]
    middle, half = 0.5 * (robot.limits.lower + robot.limits.upper), 0.5 * (robot.limits.upper - robot.limits.lower)
    q = middle + rng.uniform(-0.9, 0.9, robot.n) * half
    path = path_from(robot, q, kind, rng)
    how = rng.random()
    start, branch = (q, None) if how < 0.7 else (q, "best") if how < 0.85 else (None, None)
    options = {
        "timing": law,
        "limits": limits_of(robot, rng),
        "branch": branch,
        "samples": int(rng.choice([2, 21, 151, 151, 151])),
        "solver": str(rng.choice(["lm", "lm", "lm", "lm", "dls"])),
        "allow": ("limits", "jerk"),  # a plan is judged here by what its law enforces
    }
    return Problem(robot, path, start, options)


# ---------------------------------------------------------------- failures
def untrue(one: Problem, result: Plan, seed: int) -> list[str]:
    """What of a failure's reason and advice is not so."""
    failure, robot, path = result.failure, one.robot, one.path
    words = []
    rng = np.random.default_rng([5, seed])
    if not (0.0 <= failure.s <= path.end and failure.reason and failure.advice):
        words.append(f"stops at s = {failure.s} of {path.end}: {failure.reason!r}, {failure.advice!r}")
    last = one.q_start if result.prefix is None else result.prefix.q[-1]
    beyond = min(
        failure.s + (2e-3 if robot.n >= 6 else 2e-2) * path.end, path.end
    )  # five joints leave a path by and by
    if result.status is PlanStatus.OUTSIDE_LIMITS and failure.joint is not None and last is not None:
        i = robot.joint_names.index(failure.joint)
        low, high = robot.limits.lower[i], robot.limits.upper[i]
        at = result.prefix.end if result.prefix is not None else 0.0
        room = min(last[i] - low, high - last[i])
        rate = 1.0 if result.prefix is None else abs(result.prefix.derivatives[-1, 0, i])
        if room > 2.0 * rate * (failure.s - at) + 1e-5:
            words.append(f"{failure.joint} has {room:.3g} to its limit at s = {at:.6g}; it ends at {failure.s:.6g}")
        if robot.n == 6 and result.prefix is not None:
            x, off = oracles.newton(robot, path.pose(beyond), last)
            if off < 1e-9 and np.abs(x - last).max() < 0.2 and low <= x[i] <= high:
                words.append(f"{failure.joint} is inside its range just beyond")
    elif result.status is PlanStatus.SINGULAR and last is not None:
        sigma = float(oracles.smallest(robot, last[None])[0])
        if sigma > 2e-2:
            words.append(f"singular with a smallest singular value of {sigma:.3g}")
    elif result.status in (PlanStatus.UNREACHABLE, PlanStatus.OUTSIDE_LIMITS):
        found = oracles.cold(robot, path.pose(beyond), rng, 8)
        if found is not None:
            words.append(f"{result.status}, but {found} is at s = {beyond:.6g}")
    elif result.status is PlanStatus.TIMING_INFEASIBLE:
        if result.law != "constant_speed" or np.linalg.norm(path.twist(failure.s)[:3]) > 1e-6:
            words.append("a motion from rest to rest is always slow enough")
    elif result.status is PlanStatus.BRANCH_JUMP:  # of the method, near a singularity and nowhere else
        if failure.s == 0.0 or not failure.singular_value < 0.1:
            words.append(f"jumps at a singular value of {failure.singular_value:.3g}")
    elif result.status is PlanStatus.LIMITS_EXCEEDED or one.options["solver"] == "lm":
        words.append("not to be expected")
    words += bad_advice(one, result)
    return words


def goes(result: Plan) -> bool:
    """Whether the joints follow the path to its end; the paper's quintic promises no more than that."""
    return bool(result) or (result.status is PlanStatus.NOT_PROVED and result.law == "quintic")


def bad_advice(one: Problem, result: Plan) -> list[str]:
    """Advice that can be followed, followed."""
    failure, path = result.failure, one.path
    words = []
    if "reaches the end of the path" in failure.advice and "no branch" not in failure.advice:
        again = one.planned(branch="best")
        if (
            not goes(again) and again.status is not PlanStatus.BRANCH_JUMP
        ):  # the branch goes on, the method may still jump
            words.append(f"branch='best' does not reach the end of the path: {again.status}, {again.failure}")
    # the free motion of a redundant arm is chosen for the whole path: that of a shorter one may be another
    if (
        "a path that ends before" in failure.advice
        and one.robot.n <= 6
        and isinstance(path, Line)
        and failure.s > 1e-3 * path.end
    ):
        shorter = Problem(one.robot, Line(path.start, path.pose(0.98 * failure.s)), one.q_start, one.options)
        again = shorter.planned()
        if not goes(again) and not (
            one.options["solver"] == "dls" and again.status is PlanStatus.NO_IK
        ):  # that is dls's own limit
            words.append(f"a line to 0.98 s does not work: {again.status}, {again.failure}")
    return words


def findings(one: Problem, result: Plan, seed: int, rate: float, most: int) -> list[str]:
    """All that is wrong with a plan."""
    if not result and result.status is not PlanStatus.NOT_PROVED:
        return untrue(one, result, seed)
    start = one.q_start if one.options["branch"] is None else None
    unproved = [] if result or result.law == "quintic" else [f"not proved: {result.certificate.reasons}"]
    return unproved + oracles.contradictions(result, start, rate, most, seed)


@pytest.mark.parametrize("seed", [marked(ROBOTS[seed % len(ROBOTS)], seed) for seed in range(SHORT)])
def test_no_plan_is_contradicted_and_every_failure_is_true(seed: int) -> None:
    one = problem(seed)
    assert not findings(one, one.planned(), seed, 1e5, 6_000)


@pytest.mark.soak
@pytest.mark.parametrize("chunk", range(20))
def test_no_plan_is_contradicted_and_every_failure_is_true_at_length(chunk: int) -> None:
    wrong, solved = {}, 0
    for seed in range(SHORT + chunk, SHORT + LONG, 20):
        one = problem(seed)
        result = one.planned()
        solved += bool(result)
        if found := findings(one, result, seed, 1e5, 100_000):
            wrong[seed] = found
    assert not wrong
    assert solved > LONG // 20 // 3


@pytest.mark.parametrize(
    "seed",
    [71, 553, 659, 853],
    ids=["ends at rest", "redundant, best near a start", "five joints", "redundant, at a limit"],
)
def test_what_was_wrong_once_is_not(seed: int) -> None:
    one = problem(seed)
    assert not findings(one, one.planned(), seed, 1e5, 10_000)


@cache
def sound(law: str) -> tuple[Plan, Array | None]:
    one = problem(41)  # it turns; the quintic leaves the path by a tenth of a millimetre
    result = one.planned(timing=law, samples=21)
    assert not oracles.contradictions(result, one.q_start, 1e5, 10_000)
    return result, one.q_start


@pytest.mark.parametrize("field", ["velocity", "acceleration", "jerk", "tool_speed", "rotation_speed"])
def test_the_oracle_sees_an_extreme_that_is_a_hair_too_small(field: str) -> None:
    result, q = sound("optimal")
    said = getattr(result.certificate, field)
    proof = replace(result.certificate, **{field: said._replace(value=said.value * (1.0 - 1e-4))})
    assert oracles.contradictions(replace(result, _certificate=proof), q, 1e5, 10_000)


def test_the_oracle_sees_every_other_figure_that_is_not_so() -> None:
    result, q = sound("quintic")
    proof = result.certificate
    off, names = proof.path_error, [field.name for field in fields(proof)]
    wrong: tuple[dict[str, Any], ...] = (
        {"position_margin": proof.position_margin + 1e-6},
        {"path_error": off._replace(distance=0.5 * off.found_distance, angle=0.5 * off.found_angle)},
        {"_singular": (1.1 * proof.singular_value, proof.t_singular_value)},
        {"continuous": proof.continuous + 1 if proof.continuous < 3 else 1},
        {"rest": (True, False)},
        {"binding": proof.binding._replace(ratio=0.9 * proof.binding.ratio)},
        {"binding": proof.binding._replace(s=0.9 * proof.binding.s)},
    )
    for change in wrong:
        changed = replace(proof, **{name: value for name, value in change.items() if name in names})
        vars(changed).update(change)  # also what is computed when it is read
        bad = replace(result, _certificate=changed)
        assert oracles.contradictions(bad, q, 1e5, 4_000), change
    slower = replace(result, _trajectory=result.trajectory.stretched(1.001))
    assert oracles.contradictions(slower, q, 1e5, 4_000)
    assert oracles.contradictions(result, q + 1e-6 if q is not None else np.zeros(6), 1e5, 4_000)


# ---------------------------------------------------------------- replanning
@pytest.mark.parametrize("seed", range(0, 60, 6))
@pytest.mark.parametrize("stop", [False, True])
def test_a_replanned_motion_starts_at_the_state_and_ends_at_rest_on_the_path(seed: int, stop: bool) -> None:
    tried = ((one, one.planned(timing="optimal")) for one in map(problem, range(seed, seed + 6)))
    one, first = next(pair for pair in tried if pair[1])
    t = float(np.random.default_rng([6, seed]).uniform(0.0, first.trajectory.duration))
    state = tuple(first.trajectory(t, order) for order in range(3))
    again = replan(first, t if stop else state, stop=stop)
    assert again, again.failure
    joints = oracles.Joints(again.trajectory)
    for order, value in enumerate(state):
        assert np.abs(joints.ends(order)[0][0] - value).max() <= (1e-12, 1e-9, 1e-6)[order]
    assert np.abs(joints.ends(1)[1][-1]).max() <= 1e-9
    end = joints.ends(0)[1][-1:]
    s = again.path.nearest(oracles.fk(one.robot, end))
    distance, angle = oracles.off_by(oracles.fk(one.robot, end), again.path.pose(s))
    assert max(distance[0], angle[0]) <= 1e-8
    if not stop:
        np.testing.assert_allclose(end[0], first.joint_path.q[-1], rtol=0.0, atol=1e-9)
    at = np.sort(np.random.default_rng(seed).uniform(0.0, joints.t[-1], 3000))
    assert not [*oracles.joint_extremes(again, joints, at), *oracles.tool_speeds(again, joints, at)]
