"""Replanning from a plan's own motion: there is always an answer that keeps the limits, and it begins exactly there.

Interruptions of drawn plans, at any time: just after the start, at knots, just before the end. The judge evaluates the
coefficients by Horner's rule and the arm by its fixed transforms.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import optik
from optik.errors import InvalidInput
from optik.types import Array
from planners import (
    Arc,
    JointLine,
    JointPath,
    Line,
    MotionLimits,
    Path,
    Plan,
    PlanStatus,
    Polyline,
    Trajectory,
    load_motion,
    make_law,
    plan,
    replan,
)
from planners.timing.base import PathState
from planners.timing.optimal import Optimal
from tests import oracles
from tests.planners.cases import START, default_line, paper6r

ROBOTS = ("iiwa14", "panda", "ur5e", "paper6r", "kr6", "irb120")
LAWS = ("optimal", "optimal", "ruckig", "smooth")
EACH = 10
"""Interruptions of every plan."""
EXACT = (1e-12, 1e-9, 1e-6)
"""How far the start may be from the running motion's state [rad or m, per s, per s²]."""
LIMITS = MotionLimits(2.0, 10.0, 100.0)


def path_on(robot: optik.Robot, q: Array, rng: np.random.Generator) -> Path:
    low, high = np.maximum(robot.limits.lower, -3.0), np.minimum(robot.limits.upper, 3.0)

    def near(q: Array, size: float) -> Array:
        return np.clip(q + rng.normal(0.0, size, robot.n), low, high)

    kind = rng.integers(4)
    if kind == 0:
        Q = [q]
        for _ in range(3):
            Q.append(near(Q[-1], 0.15))
        return Polyline(np.array([robot.fk(x) for x in Q]), blend=0.005, blend_rotation=0.05)
    if kind == 1:
        return JointLine(robot, q, near(q, 0.4))
    T = robot.fk(q)
    if kind == 2:
        return Line(T, robot.fk(near(q, 0.2)))
    return Arc.about(T, T[:3, 3] + 0.05 * T[:3, 0], T[:3, 2], float(rng.uniform(0.5, 6.2)))


def drawn(seed: int) -> Iterator[Plan]:
    """Plans that hold, of many arms, paths, laws and limits."""
    rng = np.random.default_rng([11, seed])
    while True:
        robot = optik.load(str(rng.choice(ROBOTS)))
        low, high = np.maximum(robot.limits.lower, -3.0), np.minimum(robot.limits.upper, 3.0)
        q = low + (high - low) * rng.uniform(0.3, 0.7, robot.n)
        speed = float(rng.uniform(0.05, 0.5)) if rng.random() < 0.3 else None
        limits = MotionLimits(*(np.array([2.0, 10.0, 100.0]) * 10.0 ** rng.uniform(-0.5, 0.5, 3)), tool_speed=speed)
        path, law = path_on(robot, q, rng), str(rng.choice(LAWS))
        found = plan(robot, path, q, limits=limits, timing=law)
        if found and found.certificate.holds:
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
        return [f"none: {again.stop}"]
    words = [*again.certificate.broken]
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
    if max(oracles.off_by(last, again.path.pose(place)))[0] > 1e-8:
        words.append("ends off the path, or not at its end")
    if again.trajectory.duration > running.trajectory.end - t + 1e-9:
        words.append(f"takes {again.trajectory.duration} s, and {running.trajectory.end - t} s were left")
    at = np.sort(np.random.default_rng(0).uniform(0.0, after.t[-1], 300))
    words += [*oracles.joint_extremes(again, after, at), *oracles.tool_speeds(again, after, at)]
    assert again.span is not None
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
    assert again.certificate.holds
    assert again.trajectory.duration <= before * (1.0 + 1e-9)


@pytest.mark.parametrize("before", [0.0, 1e-12])
def test_at_its_end_a_motion_has_ended(running: Plan, before: float) -> None:
    with pytest.raises(InvalidInput) as info:
        replan(running, running.trajectory.end - before)
    assert info.value.argument == "state"


@pytest.mark.parametrize("t", [1e-8, 1e-6, 1e-4, 1e-2])
def test_a_stop_soon_after_the_start_takes_as_long_as_the_start_did(running: Plan, t: float) -> None:
    again = replan(running, t, stop=True)
    assert again.certificate.holds
    assert again.trajectory.duration <= 3.1 * t  # at the jerk limit: t up, 2 t down and back
    assert again.span is not None
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
        assert again.certificate.holds
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
    assert again.certificate.holds
    assert again.trajectory.duration == pytest.approx(around.trajectory.end - t, rel=2e-3)
    assert again.span is not None
    assert again.span[0] == pytest.approx({2e-3: 0.0, 0.4: 0.35}.get(part, 1.0) * circle.end, abs=0.1 * circle.end)


@pytest.mark.parametrize("stop", [False, True])
@pytest.mark.parametrize("part", [0.1, 0.45, 0.8])
def test_a_measured_state_is_begun_exactly_too(running: Plan, part: float, stop: bool) -> None:
    rng = np.random.default_rng(5)
    t = part * running.trajectory.end
    state = [running.trajectory(t, order) + rng.normal(0.0, size, 6) for order, size in enumerate((1e-8, 1e-8, 1e-6))]
    again = replan(running, tuple(state), stop=stop)
    assert max(again.certificate.worst(field)[0] for field in ("velocity", "acceleration", "jerk")) <= 1.01
    for order, value in enumerate(state):
        np.testing.assert_array_equal(again.trajectory(0.0, order), value)
    wide = replan(running, tuple(state), stop=stop, limits=LIMITS.scaled(1.2))
    assert wide.certificate.holds


def test_an_exact_state_given_as_arrays_is_answered_like_its_time(running: Plan) -> None:
    t = 0.62 * running.trajectory.end
    state = tuple(running.trajectory(t, order) for order in range(3))
    by_time, by_state = replan(running, t), replan(running, state)
    assert by_state.certificate.holds
    assert by_state.trajectory.duration == pytest.approx(by_time.trajectory.duration, rel=1e-9)


# ---------------------------------------------------------------- other limits


def test_lower_limits_that_the_state_breaks_are_named(running: Plan) -> None:
    t = running.trajectory.extrema(1).t_worst.max()
    none = replan(running, float(t), limits=MotionLimits(0.5, 10.0, 100.0))
    assert none.status is PlanStatus.TIMING_INFEASIBLE
    assert none.stop is not None
    speed = np.abs(running.trajectory(float(t), 1))
    assert none.stop.joint == f"joint{1 + int(speed.argmax())}"
    assert f"{speed.max() / 0.5:.6g}" in none.stop.reason
    assert none.stop.advice


def test_what_the_running_motion_breaks_later_is_named(running: Plan) -> None:
    none = replan(running, 0.45 * running.trajectory.end, limits=MotionLimits(2.0, 4.0, 40.0))
    assert none.status is PlanStatus.TIMING_INFEASIBLE
    assert none.stop is not None
    assert none.stop.joint in paper6r().joint_names
    assert 0.0 < none.stop.s <= running.path.end


def test_limits_are_widened_by_one_percent_at_most_and_never_when_strict(running: Plan) -> None:
    t = 0.6 * running.trajectory.end
    tight = MotionLimits(float(np.abs(running.trajectory(t, 1)).max()) / 1.005, 20.0, 400.0)
    wider = replan(running, t, limits=tight)
    assert wider.status is not PlanStatus.TIMING_INFEASIBLE
    assert not wider.certificate.holds
    assert 1.004 < wider.certificate.worst("velocity")[0] <= 1.0101
    strict = replan(running, t, limits=tight, strict=True)
    assert strict.status is PlanStatus.TIMING_INFEASIBLE
    assert strict.stop is not None
    assert "1.005 times the velocity" in strict.stop.reason


@pytest.mark.parametrize("stop", [False, True])
@pytest.mark.parametrize("field", ["velocity", "acceleration", "jerk"])
@pytest.mark.parametrize("size", [1e-9, 1e-300, 1e300])
def test_limits_of_any_size_are_answered(running: Plan, field: str, size: float, stop: bool) -> None:
    limits: dict[str, Any] = {"velocity": 2.0, "acceleration": 10.0, "jerk": 100.0, field: size}
    again = replan(running, 0.2, limits=MotionLimits(**limits), stop=stop)
    assert (again.status is PlanStatus.TIMING_INFEASIBLE) == (size < 1.0)


def test_a_faster_law_gains_what_is_left_to_gain() -> None:
    slow = plan(paper6r(), default_line(), START, limits=LIMITS, timing="smooth")
    again = replan(slow, 0.1)
    assert again.certificate.holds
    assert again.trajectory.duration < 0.9 * (slow.trajectory.end - 0.1)
    fast = plan(paper6r(), default_line(), START, limits=LIMITS)
    assert again.trajectory.duration > 0.7 * fast.trajectory.end


class Unaware(Optimal):
    """A law that knows nothing of the exact state."""

    def run_from(self, joint_path: JointPath, limits: MotionLimits, state: PathState, *, stop: bool) -> Trajectory:
        return super().run_from(joint_path, limits, state._replace(joints=None), stop=stop)


def test_a_law_that_starts_on_the_path_is_begun_at_the_state_too(running: Plan) -> None:
    t = 0.3 * running.trajectory.end
    again = replan(running, t, limits=LIMITS.scaled(1.3), timing=Unaware())
    assert again.certificate.holds
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


@pytest.mark.parametrize("flag", ["stop", "strict"])
def test_flags_that_cannot_be_meant_are_refused(running: Plan, flag: str) -> None:
    with pytest.raises(InvalidInput) as info:
        replan(running, 0.2, **{flag: "no"})
    assert info.value.argument == flag


def test_the_tool_stays_on_the_path_after_an_interruption(running: Plan) -> None:
    again = replan(running, 0.25, limits=LIMITS.scaled(1.5))
    t = np.linspace(0.0, again.trajectory.end, 500)
    T = oracles.fk(again.robot, oracles.Joints(again.trajectory)(t))
    off = [oracles.off_line(running.path.start, running.path.goal, x)[0] for x in T]
    assert max(off) <= 1e-5
