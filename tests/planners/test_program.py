"""Programs: corners, waits, gaps, tool speeds, files and replanning, held to numbers of their own."""

from __future__ import annotations

import itertools
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BPoly

import optik
import planners
from optik import se3
from optik.errors import InvalidInput
from optik.scene import contact
from optik.types import Array
from planners import JointLine, Line, MotionLimits, Part, PointToPoint, Polyline, Program
from planners.motion.show import show_motion
from planners.paths.joint_curve import JointCurve
from planners.planning import PlanStatus
from planners.program import Dwell, Move, PathEvent, ToolChange
from planners.program.following import fade_out
from planners.program.joining import ON_CURVE, _round, place_nodes, sharpen

ROBOT = optik.load("ur5e")
START = np.array([0.0, -1.57, 1.57, -1.57, -1.57, 0.0])
HOME = ROBOT.fk(START)
LIMITS = MotionLimits(3.0, 10.0, 100.0)
X, Y = np.array([0.1, 0.0, 0.0]), np.array([0.0, 0.1, 0.0])


def plan(*items, limits=LIMITS, **options):
    return planners.plan(ROBOT, Program(items), START, limits=limits, **options)


def ways(*ends: Array, start=(0.0, 0.0, 0.0)) -> Line | Polyline:
    """A line or polyline through displacements from the first pose."""
    poses = np.array([se3.pose(HOME[:3, :3], HOME[:3, 3] + way) for way in (start, *ends)])
    return Line(*poses) if len(poses) == 2 else Polyline(poses, blend=2e-3, blend_rotation=2e-2)


def samples(motion, order=0):
    """Values at 2 kHz."""
    return motion(np.linspace(0.0, motion.end, int(2000 * motion.end) + 2), order)


def jumps(motion) -> float:
    """Largest jump of a position, by the two polynomials at each knot."""
    c, h = motion.coefficients, np.diff(motion.knots)[:, None]
    ends = sum(c[k] * h ** (len(c) - 1 - k) for k in range(len(c)))
    return float(np.abs(ends[:-1] - c[-1][1:]).max(initial=0.0))


def rest_time(motion) -> float:
    """How long the arm stands still in all [s], by the polynomials of its motion."""
    still = np.abs(motion.coefficients[:-1]).max(axis=(0, 2)) == 0.0
    return float(np.diff(motion.knots)[still].sum())


# ---------------------------------------------------------------- corners
def test_a_corner_stays_in_its_zone_and_the_motion_passes_beside_it():
    found = plan(Part(Move(X, "base"), blend=0.01), Part(Move(Y, "base")))
    corner, (edge,) = HOME[:3, 3] + X, found.corners
    p = ROBOT.fk(samples(found.trajectory))[:, :3, 3]
    first = np.maximum(p[:, 0] - corner[0], 0.0) ** 2 + (p[:, 1] - HOME[1, 3]) ** 2
    second = (p[:, 0] - corner[0]) ** 2 + np.maximum(HOME[1, 3] - p[:, 1], 0.0) ** 2
    off = np.sqrt(np.minimum(first, second) + (p[:, 2] - HOME[2, 3]) ** 2)
    assert 2e-3 < off.max() < edge.deviation[0] + 1e-5 <= 0.01 + 1e-5
    assert found and len(found.sections) == 1
    assert np.linalg.norm(p - corner, axis=1).min() > 2e-3


def test_the_superposition_of_a_corner_has_the_derivatives_of_differences():
    one, two = (
        sharpen(ROBOT, JointLine(ROBOT, a, b), None).curve
        for a, b in ((START, START + 0.3), (START + 0.3, START - 0.1))
    )
    two = sharpen(ROBOT, PointToPoint(ROBOT, START + 0.3, START + np.arange(6) / 9, START - 0.1), None).curve
    u, h = np.linspace(0.05, 0.95, 19), 1e-5
    exact, w = _round(one, two, 0.1, u), 0.2
    for order in range(3):
        slope = (_round(one, two, 0.1, u + h)[:, order] - _round(one, two, 0.1, u - h)[:, order]) / (2.0 * h * w)
        np.testing.assert_allclose(slope, exact[:, order + 1], atol=1e-5 * max(1.0, np.abs(exact[:, order + 1]).max()))
    np.testing.assert_allclose(
        _round(one, two, 0.1, np.array([0.0]))[0, 0], one.coordinates(np.array([one.end - 0.1]))[0, 0]
    )
    np.testing.assert_allclose(_round(one, two, 0.1, np.array([1.0]))[0, 0], two.coordinates(np.array([0.1]))[0, 0])


def test_nodes_of_a_corner_are_those_that_its_quintics_need():
    def wave(s):
        return np.stack(
            [np.stack([3.0**k * np.sin(3.0 * s + 0.5 * np.pi * k) for _ in range(2)], axis=1) for k in range(4)], axis=1
        )

    def fifth(s):
        p = np.polynomial.Polynomial([0.1, -0.3, 0.2, 0.5, -0.4, 0.7])
        return np.stack([np.stack([p.deriv(k)(s)] * 2, axis=1) for k in range(4)], axis=1)

    grid = np.linspace(-0.4, 0.5, 4)
    assert len(place_nodes(fifth, grid, 1e-6)[0]) == len(grid)
    s, q = place_nodes(wave, grid, 1e-6)

    def misses(a, b):
        ends = [wave(np.array([x]))[0, :3, 0] for x in (a, b)]
        return abs(BPoly.from_derivatives([a, b], ends)(0.5 * (a + b)) - np.sin(1.5 * (a + b)))

    assert all(misses(a, b) <= ON_CURVE for a, b in itertools.pairwise(s)) and np.isin(grid, s).all()
    np.testing.assert_allclose(q, wave(s))
    own = [x for x in s if x not in grid]  # each is the middle of an interval that needed it
    assert own and all(
        max(misses(x - h, x + h) for h in (np.diff(grid)[0] / 2.0 ** np.arange(1, 12))) > ON_CURVE for x in own
    )
    assert len(place_nodes(wave, grid, 0.2)[0]) == len(grid)


def test_a_program_without_a_path_in_space_has_no_path_error_but_rounding():
    found = plan(Part(START + 0.2, blend=0.01), Part(START + np.array([0.3, 0.1, 0.0, 0.2, 0.0, 0.0])))
    assert found and len(found.sections) == 1
    assert found.certificate.path_error.distance < 1e-8 and found.certificate.path_error.angle < 5e-8


def check_collinear(seed: int) -> None:
    """One line of a random arm, and the same cut into two to four parts with zones between."""
    rng = np.random.default_rng([31, seed])
    name = ("ur5e", "kr6", "irb120", "gen3lite", "panda", "iiwa14", "fr3")[seed % 7]
    robot, one = optik.load(name), None
    while not one:
        q = robot.limits.middle + np.minimum(robot.limits.half, 2.5) * rng.uniform(-0.7, 0.7, robot.n)
        start, way = robot.fk(q), rng.normal(size=3)
        goal = start.copy()
        goal[:3, 3] += rng.uniform(0.05, 0.3) * way / np.linalg.norm(way)
        goal[:3, :3] = se3.exp_so3(0.3 * rng.normal(size=3) * (rng.random() < 0.5)) @ start[:3, :3]
        line = Line(start, goal)
        one = planners.plan(robot, line, q, limits=LIMITS) if robot.singular_values(q).min() > 0.05 else None
    cuts = np.sort(rng.uniform(0.05, 0.95, rng.integers(1, 4)))
    if seed % 3 == 0:
        cuts = np.append(cuts, cuts[-1] + 2e-4 / line.end)  # a part of 0.2 mm
    poses = [line.pose(f * line.end) for f in (0.0, *cuts, 1.0)]
    parts = [
        Part(Line(a, b), blend=2e-3 if i < len(cuts) else 0.0) for i, (a, b) in enumerate(itertools.pairwise(poses))
    ]
    whole = planners.plan(robot, Program(parts), q, limits=LIMITS)
    assert whole and len(whole.sections) == 1, whole
    assert whole.duration <= 1.002 * one.duration, (name, whole.duration / one.duration)
    polyline = planners.plan(robot, Polyline(poses, blend=2e-3), q, limits=LIMITS)
    assert polyline.duration <= 1.002 * one.duration, (name, polyline.duration / one.duration)


@pytest.mark.parametrize("seed", range(14))
def test_a_line_cut_into_parts_takes_no_longer(seed):
    check_collinear(seed)


@pytest.mark.soak
def test_a_hundred_lines_cut_into_parts_take_no_longer():
    for seed in range(14, 114):
        check_collinear(seed)


def test_a_corner_of_a_cubic_that_goes_on_is_the_cubic():
    c = np.random.default_rng(3).normal(size=(4, 6)) * np.array([0.3, 1.0, 2.0, 9.0])[:, None]

    def cubic(s: Array) -> Array:
        x = s[:, None]
        orders = ((x**3 / 6, x**2 / 2, x, 1), (x**2 / 2, x, 1), (x, 1), (1,))
        return np.stack(
            [
                START * (k == 0) + sum(a * b for a, b in zip(o, c[::-1], strict=False)) + 0 * x
                for k, o in enumerate(orders)
            ],
            axis=1,
        )

    s = np.array([0.0, 0.1, 0.2])
    at = cubic(s)
    one, two = (JointCurve(ROBOT, s[:2], at[k : k + 2, 0], at[k : k + 2, 1:]) for k in (0, 1))
    u = np.linspace(0.0, 1.0, 21)
    np.testing.assert_allclose(_round(one, two, 0.08, u), cubic(0.1 + 0.16 * (u - 0.5)), atol=1e-8)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("zone", [{"blend": 1e-6}, {"blend": 1e-2, "blend_rotation": 1e-9}])
def test_a_zone_within_the_tolerance_is_a_stop_and_says_so(zone):
    found = plan(Part(Move(X, "base"), **zone), Part(Move(Y, "base")))
    assert found and len(found.sections) == 2
    assert found.corners[0].reduced == "its zone is not larger than the tolerance"


@pytest.mark.parametrize("angle", [179.99, 180.0])
def test_a_reversal_is_rounded_or_stops(angle):
    back = 0.1 * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle)), 0.0])
    found = plan(Part(Move(X, "base"), blend=0.01), Part(Move(back, "base")))
    assert found and len(found.sections) == 1 + (angle == 180.0)
    assert (found.corners[0].reduced == "the path reverses its direction there") == (angle == 180.0)


def test_a_part_alone_records_the_path_that_its_plan_chose():
    way = PointToPoint(ROBOT, START, START + np.array([0.1, 0.3, -0.2, 0.4, 0.0, 0.2]), START + 0.4)
    found = plan(Part(way), Part(START))
    first = found.parts[0].path
    q = samples(found.sections[0].trajectory)
    own = first.configurations(ROBOT, np.linspace(0.0, first.end, 4001))
    assert max(np.abs(own - x).max(axis=1).min() for x in q[:: len(q) // 20]) < 1e-3


# ---------------------------------------------------------------- waits
def test_waits_are_counted_and_named_in_times():
    found = plan(Dwell(0.4), Part(START + 0.2), Dwell(0.2), Dwell(0.3), Part(START), Dwell(0.1))
    assert found.waits == (0.4, 0.5, 0.1)
    assert rest_time(found.trajectory) == pytest.approx(1.0)
    first, last = found.times
    assert first.begin == pytest.approx(0.4)
    assert first.end - first.rest == pytest.approx(0.5)
    assert last.end - last.rest == pytest.approx(0.1)
    assert last.end == found.duration
    active = found.certificate.binding
    assert len(active.t) == len(active.limit) + 1 == len(active.ratio) + 1 == len(active.speed) + 1
    at_rest = np.isclose(np.diff(active.t)[:, None], found.waits).any(axis=1)
    assert (active.ratio[at_rest] == 0.0).all() and at_rest.sum() == 3
    assert (active.ratio[~at_rest] > 0.5).all()
    assert str(found).startswith("solved")


def test_a_wait_before_a_closed_path_is_not_its_end():
    found = plan(Dwell(0.5), Part(ways(X, X + Y, (0.0, 0.0, 0.0))), Part(START + 0.1))
    assert found
    assert found.motion.certify().is_valid
    assert found.times[0].rest > 0.6


@pytest.mark.parametrize("zone", [0.0, 0.01])
@pytest.mark.parametrize("gap", [1e-12, 1e-7, 9.9e-7])
def test_a_gap_of_rounding_leaves_no_jump(gap, zone):
    turned = START + 0.2 * np.arange(6)
    step = gap * np.eye(6)[0]
    joints = plan(Part(JointLine(ROBOT, START, turned)), Part(JointLine(ROBOT, turned + step, START + step)))
    lines = plan(Part(ways(X), blend=zone), Part(ways(X + Y, start=X + gap * Y / 0.1)))
    for found in (joints, lines):
        assert found
        assert jumps(found.trajectory) < 1e-13


def test_a_gap_is_refused_with_the_part_and_its_size():
    with pytest.raises(InvalidInput, match=r"part 2 'seam': .* begins 1 mm .* from the end of part 1"):
        plan(Part(ways(X)), Part(ways(X + Y, start=X + Y / 100), name="seam"))


def test_a_small_gap_near_a_singularity_is_refused_with_the_part():
    q = np.array([0.0, -1.57, 1.57, -1.57, 1e-3, 0.0])
    T = ROBOT.fk(q)
    poses = [se3.pose(T[:3, :3], T[:3, 3] + way) for way in ((0.0, 0.0, 0.05), (3e-7, 9e-7, 9e-7))]
    there = planners.follow(optik.ik.get_solver(ROBOT, "lm"), Line(T, poses[0]), q).joint_path.q[-1]
    program = Program([Part(Line(poses[0], T)), Part(Line(poses[1], poses[0]))])
    with pytest.raises(InvalidInput, match=r"part 2: .* from the joints at the end of part 1"):
        planners.plan(ROBOT, program, there, limits=LIMITS)


def test_the_fading_function_has_the_derivatives_of_differences():
    s, h = np.linspace(0.0, 2.0, 41), 1e-5
    for order in range(3):
        inner = np.append(s[1:-1], 2.0)
        up, down = (fade_out(np.append(inner[:-1] + step, 2.0))[:-1, order] for step in (h, -h))
        np.testing.assert_allclose((up - down) / (2.0 * h), fade_out(inner)[:-1, order + 1], atol=1e-8)


# ---------------------------------------------------------------- tool speeds and files
def test_tool_speeds_hold_on_their_parts_and_in_a_file(tmp_path):
    found = plan(
        Part(Move(X, "base"), blend=0.03), Part(Move(Y, "base"), tool_speed=0.06, blend=0.03), Part(Move(-X, "base"))
    )
    t = np.linspace(0.0, found.duration, 20001)
    speed = np.linalg.norm(np.diff(ROBOT.fk(found.trajectory(t))[:, :3, 3], axis=0), axis=1) / t[1]
    s = np.interp(t[1:], found.trajectory.knots, found.certificate.s)
    begin, end = (
        0.5 * (corner.begin + corner.end) for corner in found.corners
    )  # a part's limit holds up to the middle
    middle = (s > begin + 1e-3) & (s < end - 1e-3)
    assert 0.0599 < speed[middle].max() < 0.06 * (1.0 + 1e-6)
    assert speed[~middle].max() > 0.1
    planners.save(found, tmp_path / "program.json")
    read = planners.load_motion(tmp_path / "program.json").certify()
    assert read.is_valid
    assert read.extreme("tool_speed").ratio == pytest.approx(found.certificate.extreme("tool_speed").ratio, abs=1e-13)


def test_a_section_of_a_plan_is_a_part_with_one_tool_speed():
    whole = plan(Part(START + 0.2, blend=0.01), Part(Move(X, "base")))
    found = plan(Part(whole.sections[0].path, tool_speed=0.1), Part(START))
    assert found
    assert [section.limits.tool_speed for section in found.sections] == [0.1, None]


# ---------------------------------------------------------------- replanning
def stops():
    return plan(
        Dwell(0.4),
        Part(START + 0.3, blend=0.01),
        Part(Move(X, "base")),
        Dwell(0.5),
        Part(START + 0.1),
        Part(START),
        Dwell(0.3),
    )


@pytest.mark.parametrize(("t", "left"), [(0.1, 1.1), (0.6, 0.8), (-0.31, 0.3)])
def test_replanning_keeps_the_waits_that_are_left(t, left):
    running = stops()
    when = t if t > 0.0 else running.duration + t
    found = planners.replan(running, when)
    assert found
    assert rest_time(found.trajectory) == pytest.approx(left)
    assert found.duration == pytest.approx(running.duration - when, abs=1e-3)
    np.testing.assert_allclose(found.trajectory(found.duration), START, atol=1e-12)


def test_a_state_measured_in_a_wait_keeps_all_of_it():
    running = stops()
    at = [running.trajectory(running.times[0].end - 0.2, order) for order in range(3)]
    found = planners.replan(running, (at[0] + 1e-8, at[1], at[2]))
    assert found
    assert rest_time(found.trajectory) == pytest.approx(0.5 + 0.3)


def test_there_is_nothing_to_replan_in_the_last_wait():
    running = stops()
    with pytest.raises(InvalidInput, match=r"the end of the program, with a wait of 0.2 s left"):
        planners.replan(running, running.duration - 0.2)
    with pytest.raises(InvalidInput, match=rf"a time in \[0, {running.duration:.9g}\]"):
        planners.replan(running, running.duration + 1.0)


def test_lower_limits_of_a_stop_hold_for_the_sections_behind_it():
    lower = MotionLimits(0.4, 4.0, 40.0)
    stopped = planners.replan(stops(), 0.9, limits=lower, stop=True)
    onward = planners.replan(stopped, stopped.duration)
    assert onward and onward.motion.certify().is_valid
    assert np.abs(samples(onward.trajectory, 1)).max() <= 0.4 * (1.0 + 1e-9)
    np.testing.assert_allclose(onward.trajectory(onward.duration), START, atol=1e-12)


@pytest.mark.parametrize("way", ["spline", "polyline"])
def test_a_motion_goes_on_from_any_stop(way):
    """A sweep's stop interpolates s: its end was taken up to 2e-5 off, and 13 of 27 such motions did not go on."""
    goal = PointToPoint(ROBOT, START, START + np.array([0.1, 0.2, -0.1, 0.3, 0.0, 0.1]), START + 0.4)
    running = planners.plan(ROBOT, goal if way == "spline" else ways(X, X + Y), START, limits=LIMITS)
    for t in np.linspace(0.15, 0.4, 6) * running.trajectory.duration:
        stopped = planners.replan(running, float(t), stop=True)
        assert planners.replan(stopped, stopped.trajectory.duration).status is PlanStatus.SOLVED


def test_free_parts_behind_keep_their_shape_under_lower_limits():
    place = ROBOT.fk(START + 0.1)
    turned = planners.free(Line(place, se3.pose(place[:3, :3], place[:3, 3] + X)), turn=0.4)
    running = plan(Part(START + 0.1), Part(turned), Part(START))
    found = planners.replan(running, 0.1, limits=MotionLimits(3.0, [10.0] * 5 + [0.5], 100.0))
    assert found
    assert jumps(found.trajectory) < 1e-8


def test_a_part_that_cannot_be_replanned_is_named():
    running = plan(Part(START + 0.1), Part(START + 0.1 + np.eye(6)[0], name="over"), Part(START))
    middle = ROBOT.fk(START + 0.1 + 0.5 * np.eye(6)[0])[:3, 3]
    found = planners.replan(running, 0.1, scene=optik.Scene(spheres=[(middle, 0.02)]))
    assert found.status is PlanStatus.CONTACT
    assert found.failure.part == 1
    assert found.failure.reason.startswith("part 2 'over': ")
    assert 0.2 < found.failure.s < 0.5


def test_a_replan_into_a_new_obstacle_says_contact():
    running = plan(Part(START + 0.1), Part(START + 0.1 + np.eye(6)[0]))
    middle = ROBOT.fk(START + 0.1 + 0.5 * np.eye(6)[0])[:3, 3]
    stopped = planners.replan(running, running.times[1].begin + 0.1, stop=True)
    found = planners.replan(stopped, stopped.duration, scene=optik.Scene(spheres=[(middle, 0.02)]))
    assert found.status is PlanStatus.CONTACT
    assert found.failure is None or found.failure.part == 1


# ---------------------------------------------------------------- what it gives, and what it refuses
def test_a_program_of_one_part_is_the_plan_of_that_part():
    for goal in (
        START + 0.3,
        HOME @ se3.pose(p=[0.0, 0.05, 0.05]),
        ways(X, X + Y),
        PointToPoint(ROBOT, START, START + 0.2, START - 0.1),
    ):
        alone, found = planners.plan(ROBOT, goal, START, limits=LIMITS), plan(Part(goal))
        np.testing.assert_array_equal(found.trajectory.coefficients, alone.trajectory.coefficients)
        np.testing.assert_array_equal(found.trajectory.knots, alone.trajectory.knots)


def test_a_move_of_the_joints_to_a_pose_takes_the_configuration_from_which_the_lines_are_followed():
    rng, looked = np.random.default_rng(7), 0
    for k in range(33):
        goal = ROBOT.fk(ROBOT.limits.clip(START + rng.uniform(-1.5, 1.5, 6)))
        lines = [Part(Move(0.25 * rng.normal(size=3), "base")) for _ in range(2)]
        if k % 3 != 2:  # a third of them, with the last, is enough
            continue
        nearest = PointToPoint(ROBOT, START, goal)  # by the least way of the joints
        q = nearest.configurations(ROBOT, np.array([nearest.end]))[0]
        simple = planners.plan(ROBOT, Program(lines), q, limits=LIMITS)
        found = plan(Part(goal, move="joint", name="there"), *lines)
        if found:
            at = found.parts[0].path.q_goal
            np.testing.assert_allclose(ROBOT.fk(at), goal, atol=1e-9)
            looked += not simple
        else:
            assert not simple
            assert f"part {found.failure.part + 1}" in found.failure.reason
    assert looked >= 1  # where the nearest configuration does not follow


def test_the_first_path_without_a_start_chooses_it_and_a_failure_says_what_was_tried():
    seam = ways(X, X + Y)
    found = planners.plan(ROBOT, Program([Part(seam, name="seam"), Part(Move(X, "base"))]), limits=LIMITS)
    assert found
    far = planners.plan(ROBOT, Program([Part(seam), Part(Move([3.0, 0.0, 0.0], "base"), name="far")]), limits=LIMITS)
    assert not far and far.failure.part == 1
    assert re.search(
        r"part 2 'far' \(line\): .*; none of the \d configurations .* follows parts 1 to 2", far.failure.reason
    )
    away = seam.pose(0.0)
    away[:3, 3] += 5.0
    lost = planners.plan(ROBOT, Program([Part(Line(away, away @ se3.pose(p=X)))]), limits=LIMITS)
    assert lost.status == "unreachable" and "no configuration" in lost.failure.reason


def test_a_part_of_no_length_is_nothing_to_do():
    goal = HOME.copy()
    goal[2, 3] -= 0.1
    still = Part(Move([0.0, 0.0, 0.0]))
    moves = [Part(goal, move="joint", blend=0.01), Part(Move(-X, "base"), name="left"), Part(START)]
    plain = plan(*moves)
    cases = {
        (1,): [Part(START), *moves], (2,): [moves[0], Part(goal, blend=0.02), *moves[1:]],
        (3, 4): [*moves[:2], still, replace(still), moves[2]],
        (1, 2, 5): [Part(HOME), Part(HOME, move="joint"), *moves[:2], still, moves[2]],
        (4,): [*moves, Part(START)],
    }  # fmt: skip
    for idle, items in cases.items():
        found = plan(*items)
        assert found and found.duration == pytest.approx(plain.duration, rel=1e-12)
        words = f"part{'s' if len(idle) > 1 else ''} {', '.join(map(str, idle))}"
        assert f"in 2 sections, nothing to do in {words}, lm" in str(found)
        assert len(found.parts) == len(items) and [i + 1 for i, p in enumerate(found.parts) if p.begin == p.end] == [
            *idle
        ]
        assert [p.path.end for p in found.parts if p.path.end > 1e-9] == pytest.approx(
            [p.path.end for p in plain.parts]
        )
        (first, *_), (same, *_) = found.corners, plain.corners
        assert first.begin == pytest.approx(same.begin) and found.parts[first.part].end == plain.parts[0].end
        marked = found.schedule(
            [PathEvent("left", 0.001, "a"), *(PathEvent(i - 1, None, f"{i}", fraction=0.5) for i in idle)]
        )
        (t,) = [event.t for event in plain.schedule([PathEvent("left", 0.001, "a")]).events]
        assert [event.t for event in marked.events if event.signal == "a"] == [pytest.approx(t, abs=1e-9)]
        assert len(marked.events) == 1 + len(idle)


def test_waits_tools_and_speeds_around_a_part_of_no_length():
    items = [
        Dwell(0.1),
        Part(START),
        Dwell(0.2),
        Part(Move(X, "base"), tool_speed=0.05),
        ToolChange(payload=1.0),
        Part(Move([0, 0, 0]), tool_speed=0.01),
        Dwell(0.3),
        Part(Move(Y, "base"), blend=0.01),
        Part(Move([0, 0, 0]), blend=0.001, tool_speed=0.01),
        Part(Move(X, "base"), tool_speed=0.1),
    ]
    found = plan(*items)
    assert (
        found
        and found.waits == pytest.approx((0.3, 0.3, 0.0))
        and [p.section for p in found.parts] == [-1, 0, 0, 1, 1, 1]
    )
    assert found.corners[0].zone == pytest.approx((0.001, 0.01)) and found.corners[0].deviation[0] < 0.001
    assert found.sections[0].certificate.tool_speed.value == pytest.approx(0.05, rel=1e-3)
    assert found.sections[1].certificate.tool_speed.value > 0.1
    alone = planners.certify(ROBOT, found.path, found.trajectory, found.limits, tolerance=(1e-4, 1e-3))
    assert alone.is_valid and [float(x) for x in found.limits.tool_speed] == [0.05, np.inf, 0.1]
    nothing = plan(Part(START), Dwell(0.1), Part(HOME))
    assert nothing.status == "no_length" and nothing.failure.part == 0


def test_a_choice_of_configuration_looks_past_a_part_of_no_length():
    goal = HOME.copy()
    goal[2, 3] -= 0.1
    items = [Part(goal, move="joint"), Part(Move(np.zeros(3))), Part(Move(-6 * X, "base"))]
    with_none, without = plan(*items), plan(items[0], items[2])
    assert with_none.status == without.status
    np.testing.assert_allclose(
        with_none.parts[0].path(np.array([with_none.parts[0].path.end])),
        without.parts[0].path(np.array([without.parts[0].path.end])),
    )


def test_program_of_stops_where_a_polyline_turns_back():
    poses = np.array([se3.pose(HOME[:3, :3], HOME[:3, 3] + way) for way in (0 * X, X, X + Y, X, 2 * X)])
    with pytest.raises(InvalidInput, match=r"waypoints\[2\]: .*planners.Program.of"):
        Polyline(poses)
    found = plan(*Program.of(poses, blend=2e-3).items)
    assert found and len(found.sections) == 2
    stop = ROBOT.fk(found.trajectory(found.times[0].rest))
    np.testing.assert_allclose(stop[:3, 3], poses[2][:3, 3], atol=1e-6)


def test_a_tool_and_a_payload_count_from_their_change_on():
    tool = se3.pose(p=[0.0, 0.0, 0.1])
    found = plan(Part(Move(X, "base")), ToolChange(tool=tool, payload=2.0), Part(Move(Y, "base"), tool_speed=0.1))
    assert found and found.path.robots[0] == ROBOT
    other = found.path.robots[1]
    assert other.payload.mass == 2.0
    np.testing.assert_array_equal(other.tool, tool)
    begin, rest, _ = found.times[1]
    p = other.fk(found.trajectory(np.linspace(begin, rest, 3001)))[:, :3, 3]
    assert np.abs((p - p[0])[:, [0, 2]]).max() < 1e-5  # the new tool is on its line
    speed = np.linalg.norm(np.diff(p, axis=0), axis=1) / ((rest - begin) / 3000)
    assert 0.0999 < speed.max() < 0.1 * (1 + 1e-5)


def test_a_duration_slows_the_motion_and_keeps_waits_shapes_and_speeds():
    moves = PointToPoint(ROBOT, START, START + 0.2, START - 0.1)
    items = Part(moves), Dwell(0.5), Part(Move(X, "base"), blend=0.01), Part(Move(Y, "base"))
    fast, slow = plan(*items), plan(*items, duration=6.0)
    assert slow and slow.duration == pytest.approx(6.0, abs=1e-9)
    assert fast.stretch_factor == 1.0 and slow.stretch_factor == pytest.approx(6.0 / fast.duration, rel=1e-12)
    assert slow.limit_factor == 1.0 and "to meet the limits" not in str(slow)
    assert slow.times[0].end - slow.times[0].rest == pytest.approx(0.5, abs=1e-9)
    for u in np.linspace(0.0, 1.0, 50):
        a, b = (each.trajectory(each.times[0].rest * u) for each in (fast, slow))
        np.testing.assert_allclose(a, b, atol=1e-9)
    with pytest.raises(InvalidInput, match="duration: expected at least"):
        plan(*items, duration=1.0)


@pytest.mark.parametrize(("inwards", "narrower"), [(0.04, True), (0.05, True), (0.12, False)])
def test_a_corner_that_an_obstacle_leaves_no_room_for_is_narrower_and_says_so(inwards, narrower):
    items = Part(Move(2 * X, "base"), blend=0.05), Part(Move(2 * Y, "base"))
    centre = HOME[:3, 3] + 2 * X + inwards * np.array([-1.0, 1.0, 0.0]) / np.sqrt(2.0) + [0.0, 0.0, -0.02]
    scene = optik.Scene(spheres=[(centre, 0.01)])
    found = plan(*items, scene=scene)
    assert found and found.certificate.clearance.proved
    assert (found.corners[0].reduced == "the motion with a wider corner is in contact") == narrower
    q = samples(found.trajectory)[::4]
    assert min(contact.find_contact(ROBOT, scene, each).distance for each in q) > 0.0


def test_a_program_shows_itself_in_a_notebook_and_as_plots():
    found = plan(Part(Move(X, "base"), blend=0.01, tool_speed=0.1), Part(Move(Y, "base")), Dwell(0.1), Part(START))
    card = found._repr_html_()
    assert "program of 3 parts in 2 sections" in card and "tool_speed" in card and "<script" not in card
    assert found.plot().data
    assert len(show_motion(found).zones) == 1
    failed = plan(Part(Move([0.0, 0.0, 3.0], "base"), name="up"))
    assert "part 1 &#39;up&#39;" in failed._repr_html_()
    assert found.seconds.joints > 0.0 and found.to_dict()["corners"][0]["zone"] == (0.01, 0.1)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Program([]), "items: expected a list of Part, Dwell and ToolChange"),
        (lambda: Program([Dwell(1.0)]), "items: expected"), (lambda: Program([START]), "items: expected"),
        (lambda: Program([Part(START, name="a"), Part(START, name="a")]), "name: expected a name for one part"),
        (lambda: Program([Part(START, blend=0.1)]), "blend: expected blend=0.*at the last part"),
        (lambda: Program([Part(START, blend=0.1), Dwell(1.0), Part(START)]), "blend: expected blend=0.*before a Dwell"),
        (lambda: Part(np.zeros((3, 3))), "goal: expected joints"), (lambda: Part("home"), "goal: expected joints"),
        (lambda: Part(START, move="joint"), "move: expected"), (lambda: Part(HOME, move="arc"), "move: expected"),
        (lambda: Part(START, blend=-1.0), "blend: expected"),
        (lambda: Part(START, blend_rotation=0.1), "blend_rotation: expected"),
        (lambda: Part(START, tool_speed=0.0), "tool_speed: expected"), (lambda: Part(Move(X), avoid=True), "avoid: expected"),
        (lambda: Move([1.0, 2.0]), "vector: expected"), (lambda: Move(X, "world"), "frame: expected"),
        (lambda: Dwell(-1.0), "seconds: expected"), (lambda: ToolChange(), "tool: expected"),
        (lambda: ToolChange(payload="heavy"), "payload: expected"), (lambda: ToolChange(payload=0.0), "payload: expected"),
        (lambda: plan(Part(START), branch="best"), "branch: expected none for a program"),
        (lambda: plan(Part(START), avoid=True), "avoid: expected none for a program"),
        (lambda: planners.plan(ROBOT, Program([Part(HOME)])), "q_start: expected where the arm starts: part 1"),
        (lambda: plan(Part(START), limits=MotionLimits(3.0, tool_speed=[0.1, 0.2])), "limits.tool_speed: expected one"),
        (lambda: plan(Part(np.zeros(5))), "part 1: goal: expected"),
        (lambda: Part(plan(Part(START + 0.1), Part(START)).path), "goal: expected the parts of that program"),
    ],
)  # fmt: skip
def test_misuse_is_one_line(make, words):
    with pytest.raises(InvalidInput, match="^" + words) as caught:
        make()
    assert "\n" not in str(caught.value)
