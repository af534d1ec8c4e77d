"""Replanning from a plan's own motion: there is always an answer that keeps the limits, and it begins exactly there.

Interruptions of drawn plans, at any time: just after the start, at knots, just before the end. The judge evaluates the
coefficients by Horner's rule and the arm by its fixed transforms.
"""

import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import optik
import planners
from optik.errors import InvalidInput
from optik.types import Array
from planners import Arc, JointLine, MotionLimits, Plan, Trajectory, certify, load_motion, make_law, plan, replan
from planners.following.joint_path import JointPath
from planners.timing.base import PathState, StopKind
from planners.timing.optimal import Optimal
from planners.trajectory import cut_after, cut_before, join
from planners.trajectory.curve import quintic
from tests import oracles
from tests.planners.cases import START, default_line, paper6r
from tests.planners.stops import path_of

ROBOTS = ("iiwa14", "panda", "ur5e", "paper6r", "kr6", "irb120")
LAWS = ("optimal", "optimal", "ruckig", "smooth")
EACH = 10
"""Interruptions of every plan."""
EXACT = (1e-12, 1e-9, 1e-6)
"""How far the start may be from the running motion's state [rad or m, per s, per s²]."""
LIMITS = MotionLimits(2.0, 10.0, 100.0)


def drawn(seed: int) -> Iterator[Plan]:
    """Plans that hold, of many arms, paths, laws and limits."""
    rng = np.random.default_rng([11, seed])
    while True:
        robot = optik.load(str(rng.choice(ROBOTS)))
        low, high = np.maximum(robot.limits.lower, -3.0), np.minimum(robot.limits.upper, 3.0)
        q = low + (high - low) * rng.uniform(0.3, 0.7, robot.n)
        speed = float(rng.uniform(0.05, 0.5)) if rng.random() < 0.3 else None
        limits = MotionLimits(*(np.array([2.0, 10.0, 100.0]) * 10.0 ** rng.uniform(-0.5, 0.5, 3)), tool_speed=speed)
        path, law = path_of(robot, q, rng), str(rng.choice(LAWS))
        found = plan(robot, path, q, limits=limits, timing=law)
        if found and found.certificate.is_valid:
            yield found


def times(running: Plan, rng: np.random.Generator) -> Array:
    """When it is interrupted: anywhere, at a knot, soon after the start and shortly before the end."""
    end = running.trajectory.end
    anywhere = rng.uniform(0.0, end, EACH - 3)
    return np.concatenate(
        [anywhere, rng.choice(running.trajectory.knots[1:-1], 1), end * 10.0 ** rng.uniform(-4.5, -2, 1),
         end * (1.0 - 10.0 ** rng.uniform(-4, -2, 1))]
    )  # fmt: skip


def wrong_with(running: Plan, t: float, again: Plan, stop: bool) -> list[str]:
    """What is not as it should be of a motion replanned from a time of a plan's own."""
    if not again:
        return [f"none: {again.failure}"]
    words = [*again.certificate.reasons]
    before, after = oracles.Joints(running.trajectory), oracles.Joints(again.trajectory)
    for order, most in enumerate(EXACT):
        off = float(np.abs(after.ends(order)[0][0] - before(np.array([t]), order)[0]).max())
        if off > most:
            words.append(f"begins {off} off in order {order}")
    speed = float(np.abs(after.ends(1)[1][-1]).max())
    if speed > 1e-9:
        words.append(f"ends at a speed of {speed}")
    last = oracles.fk(again.robot, after.ends(0)[1][-1:])
    place = again.path.nearest(last) if stop else np.array([again.path.end])
    # A stop ends anywhere on the path, and the motion leaves the path by at most what its certificate proves.
    proved = again.certificate.path_error if stop else None
    allowed = (1e-8, 1e-8) if proved is None else (max(1e-8, proved.distance), max(1e-8, proved.angle))
    off = oracles.off_by(last, again.path.pose(place))
    if off[0][0] > allowed[0] or off[1][0] > allowed[1]:
        words.append("ends off the path, or not at its end")
    if again.trajectory.duration > running.trajectory.end - t + 1e-9:
        words.append(f"takes {again.trajectory.duration} s, and {running.trajectory.end - t} s were left")
    at = np.sort(np.random.default_rng(0).uniform(0.0, after.t[-1], 300))
    words += [*oracles.joint_extremes(again, after, at), *oracles.tool_speeds(again, after, at)]
    if not 0.0 <= again.span[0] <= again.span[1] <= again.path.end * (1.0 + 1e-9):
        words.append(f"covers {again.span}")
    return words


def interrupted(count: int, seed: int, stop: bool) -> tuple[int, list[str]]:
    """Interrupt drawn plans so many times: how often, and all that was wrong."""
    rng, done, wrong = np.random.default_rng([12, seed]), 0, []
    for running in drawn(seed):
        for t in times(running, rng):
            try:
                words = wrong_with(running, float(t), replan(running, float(t), stop=stop), stop)
            except InvalidInput as error:
                words = [f"refused: {error}"]
            left = running.trajectory.end - t
            wrong += [f"{running.robot.name}, {running.law}, t = {t!r}, {left:.3g} s left: {word}" for word in words]
            done += 1
        if done >= count:
            return done, wrong
    raise AssertionError("no plans")


@pytest.mark.parametrize("stop", [False, True])
def test_interruptions_have_an_answer_that_begins_exactly_there(stop: bool) -> None:
    _, wrong = interrupted(20, 1 + stop, stop)
    assert not wrong


@pytest.mark.soak
@pytest.mark.parametrize("stop", [False, True])
def test_interruptions_have_an_answer_that_begins_exactly_there_at_length(stop: bool) -> None:
    done, wrong = interrupted(1000, 101 + stop, stop)
    print(f"{done} interruptions, stop={stop}: {len(wrong)} wrong")
    assert not wrong


# ---------------------------------------------------------------- chosen states
@pytest.fixture(scope="module")
def running() -> Plan:
    return plan(paper6r(), default_line(), START, limits=LIMITS)


@pytest.mark.parametrize("stop", [False, True])
@pytest.mark.parametrize("before", [1e-1, 1e-3, 1e-4])
def test_near_the_end_what_is_left_is_the_answer(running: Plan, before: float, stop: bool) -> None:
    again = replan(running, running.trajectory.end - before, stop=stop)
    assert again.certificate.is_valid
    assert again.trajectory.duration <= before * (1.0 + 1e-9)


@pytest.mark.parametrize("before", [0.0, 1e-12])
def test_at_its_end_a_motion_has_ended(running: Plan, before: float) -> None:
    with pytest.raises(InvalidInput, match=r"^state: "):
        replan(running, running.trajectory.end - before)


@pytest.mark.parametrize("t", [1e-8, 1e-6, 1e-4, 1e-2])
def test_a_stop_soon_after_the_start_takes_as_long_as_the_start_did(running: Plan, t: float) -> None:
    again = replan(running, t, stop=True)
    assert again.certificate.is_valid
    assert again.trajectory.duration <= 3.3 * t  # at the jerk limit: t up, 2 t down and back
    assert again.span[1] - again.span[0] <= LIMITS.jerk * t**3


def test_a_replanned_motion_is_replanned_again(running: Plan) -> None:
    on = running
    for k in range(5):
        t = 0.3 * on.trajectory.end
        on, before = replan(on, t), on
        assert not wrong_with(before, t, on, False), k


def test_from_a_stop_the_motion_goes_on_to_the_end(running: Plan) -> None:
    stopping = replan(running, 0.1, stop=True)
    for part in (0.0, 0.5, 0.99, 1.0):
        t = part * stopping.trajectory.end
        again = replan(stopping, t)
        assert again.certificate.is_valid
        np.testing.assert_allclose(again.trajectory(0.0), stopping.trajectory(t), rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(again.trajectory(again.trajectory.end), running.joint_path.q[-1], atol=1e-9)
        assert again.span == (pytest.approx(again.span[0]), running.joint_path.end)
    with pytest.raises(InvalidInput):
        replan(stopping, stopping.trajectory.end, stop=True)


@pytest.mark.parametrize("as_time", [True, False])
@pytest.mark.parametrize("part", [2e-3, 0.4, 1.0 - 2e-3])
def test_on_a_closed_path_the_place_is_that_of_the_running_motion(part: float, as_time: bool) -> None:
    """Start and end are one configuration: nanometres from it, only the motion tells which of them the state is near."""
    T = paper6r().fk(START)
    circle = Arc.about(T, T[:3, 3] + 0.04 * T[:3, 0], T[:3, 2], 2.0 * np.pi)
    around = plan(paper6r(), circle, START, limits=LIMITS)
    t = part * around.trajectory.end
    again = replan(around, t if as_time else tuple(around.trajectory(t, order) for order in range(3)))
    assert again.certificate.is_valid
    assert again.trajectory.duration == pytest.approx(around.trajectory.end - t, rel=2e-3)
    assert again.span[0] == pytest.approx({2e-3: 0.0, 0.4: 0.35}.get(part, 1.0) * circle.end, abs=0.1 * circle.end)


@pytest.mark.parametrize("stop", [False, True])
@pytest.mark.parametrize("part", [0.1, 0.45, 0.8])
def test_a_measured_state_near_the_motion_is_replaced_by_its_own(running: Plan, part: float, stop: bool) -> None:
    rng = np.random.default_rng(5)
    t = part * running.trajectory.end
    noise = [rng.normal(0.0, size, 6) for size in (1e-7, 1e-7, 1e-6)]
    again = replan(running, tuple(running.trajectory(t, order) + x for order, x in enumerate(noise)), stop=stop)
    assert again
    for order, x in enumerate(noise):
        off = np.abs(again.trajectory(0.0, order) - running.trajectory(t, order)).max()
        assert off <= 20.0 * np.abs(x).max()
        assert again.start_error[order] == pytest.approx(np.abs(x).max(), abs=20.0 * np.abs(x).max())
    assert replan(running, t, stop=stop).start_error is None


def test_a_measured_state_that_noise_hides_from_the_end_is_continued() -> None:
    """Near the end of a slow motion, noise of 1e-7 exceeds all that is left; the arm may be moving still."""
    slow = plan(paper6r(), default_line(), START, limits=LIMITS, timing="smooth", duration=20.0)
    noise = np.random.default_rng(6).normal(0.0, 1e-7, (8, 3, 6))
    for each in noise:
        state = tuple(slow.trajectory(slow.trajectory.end - 5e-6, order) + each[order] for order in range(3))
        assert replan(slow, state)
    end = slow.trajectory(slow.trajectory.end)
    assert replan(slow, (end, np.array([0.0, 1e-9, 0.0, 0.0, 0.0, 0.0]), np.zeros(6)))  # one joint's noise is enough
    still = tuple(end * (order == 0) for order in range(3))
    with pytest.raises(InvalidInput, match="path's end"):
        replan(slow, still)


@pytest.mark.parametrize("stop", [False, True])
@pytest.mark.parametrize("factor", [0.8, 0.97])
def test_a_measured_state_on_the_path_but_off_the_motion_is_begun_exactly(
    running: Plan, factor: float, stop: bool
) -> None:
    slower = running.trajectory.stretched(1.0 / factor)
    state = tuple(slower(0.5 * slower.end, order) for order in range(3))
    again = replan(running, state, stop=stop)
    assert again
    assert again.start_error is None
    for order, value in enumerate(state):
        np.testing.assert_array_equal(again.trajectory(0.0, order), value)


def test_an_exact_state_given_as_arrays_is_answered_like_its_time(running: Plan) -> None:
    t = 0.62 * running.trajectory.end
    state = tuple(running.trajectory(t, order) for order in range(3))
    by_time, by_state = replan(running, t), replan(running, state)
    assert by_state.certificate.is_valid
    assert by_state.trajectory.duration == pytest.approx(by_time.trajectory.duration, rel=1e-9)


# ---------------------------------------------------------------- other limits
@pytest.mark.parametrize("part", [0.1, 0.35, 0.6, 0.9])
@pytest.mark.parametrize(
    "limits", [MotionLimits(0.5, 10.0, 100.0), MotionLimits(2.0, 4.0, 40.0)], ids=["slow", "gentle"]
)
def test_lower_limits_hold_from_an_instant_on_and_the_old_ones_before(
    running: Plan, limits: MotionLimits, part: float, tmp_path: Any
) -> None:
    again = replan(running, part * running.trajectory.end, limits=limits)
    assert again
    motion, since = oracles.Joints(again.trajectory), again.within_limits_from
    for begin, end, bound in ((0.0, since, LIMITS), (since, again.trajectory.end, limits)):
        t = np.linspace(begin, end, 2001)[1:-1] if end > begin else np.empty(0)
        for order, most in enumerate((bound.velocity, bound.acceleration, bound.jerk), start=1):
            assert np.abs(motion(t, order)).max(initial=0.0) <= float(most) * (1.0 + 1e-9)
    again.save(tmp_path / "slower.json")
    stored = load_motion(tmp_path / "slower.json")
    assert stored.before == again.before
    assert stored.certify().is_valid
    if since > 0.0:  # the new limits alone are exceeded before
        assert not replace(stored, before=None).certify().is_valid


@pytest.mark.parametrize(
    ("factor", "part", "lower"), [(0.9, 0.8, MotionLimits(1.5, 7.0, 15.0)), (0.96, 0.6, MotionLimits(0.6, 3.0, 50.0))]
)
def test_lower_limits_are_met_after_a_delay_from_a_measured_state_too(
    running: Plan, factor: float, part: float, lower: MotionLimits
) -> None:
    """The arm is slower than its plan and cannot slow down at once; it does before its end."""
    slower = running.trajectory.stretched(1.0 / factor)
    again = replan(running, tuple(slower(part * slower.end, order) for order in range(3)), limits=lower)
    assert again
    assert 0.0 < again.within_limits_from < 0.95 * again.trajectory.end


@pytest.mark.parametrize("new", [True, False])
def test_a_limit_of_one_part_only_is_judged_there(running: Plan, new: bool) -> None:
    """The acceleration is limited in one part only, and exceeded there."""
    t = float(running.trajectory.knots[running.trajectory.knots.size // 3])
    tight, free = MotionLimits(3.0, 5.0, 300.0), MotionLimits(3.0, None, 300.0)
    limits, old = (tight, free) if new else (free, tight)
    proof = certify(running.robot, running.path, running.trajectory, limits, before=(old, t))
    part = slice(t, None) if new else slice(None, t)
    at = np.linspace(part.start or 0.0, part.stop or running.trajectory.end, 3001)
    assert np.nanmax(proof.acceleration.ratio) >= np.abs(running.trajectory(at, 2)).max() / 5.0 - 1e-9 > 1.0
    assert not proof.is_valid


def test_a_jump_of_the_acceleration_where_the_limits_change_is_no_finite_rate(running: Plan) -> None:
    motion = running.trajectory
    t, still = float(motion.knots[motion.knots.size // 3]), np.zeros((1, 6))
    at = tuple(motion(t, order)[None] for order in range(3))
    onward = quintic(np.array([0.0, 1.0]), (at[0], at[1], at[2] + 5.0), (at[0] + 0.1, still, still))
    jumping = join(cut_after(motion, t), Trajectory(onward))
    torque = MotionLimits(1e3, 1e6, 1e9, torque=1e9, torque_rate=1e12)
    proof = certify(running.robot, running.path, jumping, torque, before=(torque, t))
    assert np.isinf(proof.jerk.ratio).any()
    assert np.isinf(proof.torque_rate.ratio).all()


@pytest.mark.parametrize("law", ["optimal", "ruckig", "smooth"])
def test_a_motion_to_the_zero_of_its_joints_can_be_stopped_just_before_its_end(law: str) -> None:
    robot = paper6r()
    home = plan(robot, JointLine(robot, [0.9, -0.3, 0.4, 0.2, 0.5, 0.1], np.zeros(6)), [0.9, -0.3, 0.4, 0.2, 0.5, 0.1],
                limits=LIMITS, timing=law)  # fmt: skip
    for left in 10.0 ** -np.arange(2.0, 6.5, 0.5):
        for stop in (False, True):
            assert replan(home, home.trajectory.end - left, stop=stop), (left, stop)


def test_a_motion_that_meets_lower_limits_later_can_be_stopped_before_and_after(running: Plan) -> None:
    slower = replan(running, 0.35 * running.trajectory.end, limits=MotionLimits(2.0, 4.0, 40.0))
    assert slower.within_limits_from > 0.0
    for t in (0.02, 0.5 * slower.within_limits_from, 0.5 * (slower.within_limits_from + slower.trajectory.end)):
        if t < slower.trajectory.end - 1e-3:
            assert replan(slower, t, stop=True)
            assert replan(slower, t)


def test_limits_of_other_kinds_and_times_off_the_knots_are_refused(running: Plan) -> None:
    for before in ((LIMITS, -1.0), (LIMITS, 0.123456), LIMITS, ("x", 0.1), (LIMITS, float("nan"))):
        with pytest.raises(InvalidInput, match=r"^before: "):
            certify(running.robot, running.path, running.trajectory, LIMITS, before=before)


@pytest.mark.parametrize("law", ["optimal", "ruckig", "smooth", "toppra", "quintic"])
def test_plans_of_every_law_are_stopped_under_what_their_law_enforces(law: str) -> None:
    made = plan(paper6r(), default_line(), START, limits=LIMITS, timing=law, allow=("limits", "jerk"))
    for part in (0.05, 0.3, 0.5, 0.77, 0.999):
        t = part * made.trajectory.end
        stop, on = replan(made, t, stop=True), replan(made, t)
        assert stop and on
        assert stop.certificate.enforced == on.certificate.enforced == made.certificate.enforced
        assert stop.stop_kind in StopKind and on.stop_kind is None
        assert stop.trajectory.duration <= made.trajectory.end - t + 1e-9
        assert on.trajectory.duration <= made.trajectory.end - t + 1e-9
    assert stop.stop_kind is StopKind.END


def test_a_stop_without_refinement_is_the_sweeps(running: Plan) -> None:
    t = 0.2 * running.trajectory.end
    sweep, better = replan(running, t, stop=True, time_limit=0.0), replan(running, t, stop=True, time_limit=10.0)
    assert sweep.stop_kind is StopKind.SWEEP
    assert better.stop_kind is StopKind.OPTIMUM
    assert 0.85 * sweep.trajectory.duration < better.trajectory.duration < sweep.trajectory.duration


def test_a_stop_within_a_polyline_is_early_and_looks_at_its_own_part() -> None:
    """A stop does not run on to the path's end, and its sweep reads nothing of the path behind it."""
    robot = paper6r()
    rng, poses = np.random.default_rng(3), [robot.fk(START)]
    for _ in range(29):
        poses.append(poses[-1].copy())
        poses[-1][:3, 3] += 0.01 * np.array([0.5, 0.0, 1.0]) + 0.004 * rng.uniform(-1.0, 1.0, 3)
    made = plan(robot, planners.Polyline(np.array(poses), blend=0.001), START, limits=LIMITS)
    for t in rng.uniform(0.1, 0.9, 8) * made.trajectory.end:
        stop = replan(made, float(t), stop=True, time_limit=0.0)
        assert stop.stop_kind is StopKind.SWEEP
        assert stop.trajectory.duration < 0.7 * (made.trajectory.end - t)


@pytest.mark.parametrize("stop", [False, True])
@pytest.mark.parametrize("field", ["velocity", "acceleration", "jerk"])
@pytest.mark.parametrize("size", [1e-9, 1e-300, 1e300])
def test_limits_of_any_size_are_answered(running: Plan, field: str, size: float, stop: bool) -> None:
    limits: dict[str, Any] = {"velocity": 2.0, "acceleration": 10.0, "jerk": 100.0, field: size}
    again = replan(running, 0.2, limits=MotionLimits(**limits), stop=stop)
    assert again
    assert (again.within_limits_from > 0.0) == (size < 1.0)


def test_a_faster_law_gains_what_is_left_to_gain() -> None:
    slow = plan(paper6r(), default_line(), START, limits=LIMITS, timing="smooth")
    again = replan(slow, 0.1)
    assert again.certificate.is_valid
    assert again.trajectory.duration < 0.9 * (slow.trajectory.end - 0.1)
    fast = plan(paper6r(), default_line(), START, limits=LIMITS)
    assert again.trajectory.duration > 0.7 * fast.trajectory.end


class Unaware(Optimal):
    """A law that knows nothing of the exact state."""

    def run_from(self, joint_path: JointPath, limits: MotionLimits, state: PathState) -> Trajectory:
        return super().run_from(joint_path, limits, state._replace(joints=None))


def test_a_law_that_starts_on_the_path_is_begun_at_the_state_too(running: Plan) -> None:
    t = 0.3 * running.trajectory.end
    again = replan(running, t, limits=LIMITS.scale(1.3), timing=Unaware())
    assert again.certificate.is_valid
    for order in range(3):
        np.testing.assert_array_equal(again.trajectory(0.0, order), running.trajectory(t, order))


# ---------------------------------------------------------------- files
@pytest.mark.parametrize("suffix", [".npz", ".json", ".csv"])
def test_files_hold_the_part_of_the_path_and_the_speed_that_was_asked(
    running: Plan, suffix: str, tmp_path: Any
) -> None:
    stopping = replan(running, 0.2, stop=True)
    stopping.save(tmp_path / f"stop{suffix}")
    assert load_motion(tmp_path / f"stop{suffix}").span == stopping.span
    running.save(tmp_path / f"whole{suffix}")
    whole = load_motion(tmp_path / f"whole{suffix}")
    assert whole.span is None
    assert whole.speed is None
    weld = plan(paper6r(), default_line(), START, limits=LIMITS, timing=make_law("constant_speed", speed=0.05))
    weld.save(tmp_path / f"weld{suffix}")
    assert load_motion(tmp_path / f"weld{suffix}").speed == 0.05


@pytest.mark.parametrize("flag", ["stop"])
def test_flags_that_cannot_be_meant_are_refused(running: Plan, flag: str) -> None:
    with pytest.raises(InvalidInput, match=rf"^{flag}: "):
        replan(running, 0.2, **{flag: "no"})


def test_the_tool_stays_on_the_path_after_an_interruption(running: Plan) -> None:
    again = replan(running, 0.25, limits=LIMITS.scale(1.5))
    t = np.linspace(0.0, again.trajectory.end, 500)
    T = oracles.fk(again.robot, oracles.Joints(again.trajectory)(t))
    off = [oracles.off_line(running.path.start, running.path.goal, x)[0] for x in T]
    assert max(off) <= 1e-5


SEAM_LIMITS = MotionLimits.of(optik.load("ur5e"), acceleration=10.0, jerk=100.0)
SEAM_START = np.array([0.0, -1.57, 1.57, -1.57, -1.57, 0.0])


def seam(law: Any, *way: float, turn: float = 0.0, limits: MotionLimits = SEAM_LIMITS) -> Plan:
    """A line of a ur5e by a vector, with a turn about the tool's axis."""
    arm = optik.load("ur5e")
    begin = arm.fk(SEAM_START)
    end = oracles.moved(begin, np.array(way), begin[:3, 2] * turn)
    return plan(arm, planners.Line(begin, end), SEAM_START, limits=limits, timing=law)


@pytest.mark.parametrize(
    ("way", "turn", "name"), [((0.0, 0.3, -0.1), 0.0, "tool_speed"), ((0, 0, 0), 0.8, "rotation_speed")]
)
def test_a_constant_speed_is_never_exceeded_afterwards_and_the_record_says_what_ran(
    way: Any, turn: float, name: str
) -> None:
    running = seam(make_law("constant_speed", speed=0.15), *way, turn=turn)
    part = slice(0, 3) if name == "tool_speed" else slice(3, 6)
    for t in (0.05, 0.4, 0.8 * running.duration):
        for changed in ({}, {"limits": SEAM_LIMITS.scale(0.5)}, {"stop": True}, {"limits": SEAM_LIMITS.scale(3.0)}):
            onward = replan(running, t, **changed)
            assert onward, onward
            times = np.linspace(0.0, onward.duration, 400)
            J, dq = onward.robot.jacobian(onward.trajectory(times)), onward.trajectory(times, 1)
            twist = np.einsum("kij,kj->ki", J, dq)[:, part]
            assert np.linalg.norm(twist, axis=1).max() <= 0.15 * (1.0 + 2e-6)
            assert onward.limits.value(name) == pytest.approx(0.15, rel=1e-5) and name in onward.certificate.enforced
            rest = cut_before(running.trajectory, t)
            same = onward.duration == pytest.approx(rest.duration, abs=1e-9) and "stop" not in changed
            assert (onward.law, onward.speed) == (("constant_speed", 0.15) if same else ("optimal", None))
            assert onward.motion.certify().is_valid
        later = replan(replan(running, t, stop=True), 1e-3)
        assert later and later.certificate.extreme(name).value <= 0.15 * (1.0 + 2e-6)
    free = replan(running, 0.4, timing="optimal")
    assert free and free.certificate.extreme(name).value > 0.2  # which was asked for


def test_a_law_that_starts_at_rest_only_is_followed_by_optimal_under_the_limits_that_it_enforced() -> None:
    limits = replace(SEAM_LIMITS, jerk=None)
    running = seam("toppra", 0.0, 0.3, -0.1, limits=limits)
    onward = replan(running, 0.3 * running.duration, limits=limits.scale(0.5, ("velocity", "acceleration")))
    assert onward and onward.law == "optimal" and set(onward.certificate.enforced) == set(running.certificate.enforced)
    again = replan(onward, 0.2)
    assert again and set(again.certificate.enforced) == set(running.certificate.enforced)


def test_a_refusal_under_lower_limits_names_both() -> None:
    running = seam("optimal", 0.0, 0.3, -0.1)
    t = 0.5 * running.duration  # faster than the motion, so that none of its remaining part is left
    state = running.trajectory(t), 1.1 * running.trajectory(t, 1), 1.21 * running.trajectory(t, 2)
    refused = replan(running, state, limits=SEAM_LIMITS.scale(0.3))
    assert not refused and refused.failure is not None
    ratio, low, high = (
        float(x)
        for x in re.findall(r"has (\S+) times .* \(limit (\S+) \S+; in the plan (\S+) \S+\)", refused.failure.reason)[0]
    )
    assert ratio > 1.0 and low == pytest.approx(0.3 * high, rel=1e-5)
