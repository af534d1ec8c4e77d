"""Streams whose sources give what cannot be meant, raise, or are late; streams from moving states; what a report counts."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy

import optik
import planners
from optik.errors import InvalidInput
from planners import MotionLimits, stream
from planners.cell.drives import make_drive
from planners.streams import Chunk, JogVelocity, Setpoint
from planners.streams.stream import StreamReport
from tests.planners.test_retarget import PANDA, REST

GOAL = REST + 0.4
FAR = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 3.5])


HELD = optik.load("panda").fk(REST)
FAILED = planners.plan(
    optik.load("panda"), planners.Line(HELD, HELD + np.eye(4)[:, :1] * np.eye(4)[3]), REST, limits=PANDA
)


class Then:
    """A goal at once, and another target while the arm moves."""

    def __init__(self, target: Callable[[], Any], first: Any = GOAL, at: float = 0.2) -> None:
        self.target, self.first, self.at, self.asked = target, first, at, list[float]()

    def __call__(self, now: Setpoint) -> Any:
        self.asked.append(now.t)
        if now.t == 0.0:
            return self.first
        return self.target() if now.t >= self.at and self.asked[-2] < self.at else None


def fail() -> Any:
    raise RuntimeError("the policy is gone")


def moves_to_rest(points: list[Setpoint], limits: MotionLimits = PANDA) -> bool:
    """Whether set-points are continuous within the limits, the arm moved, and it is at rest."""
    bounds = limits.bounds(7)
    t, dq, ddq = (np.array([getattr(now, name) for now in points]) for name in ("t", "dq", "ddq"))
    assert (np.abs(np.diff(ddq, axis=0)) <= bounds["jerk"] * np.diff(t)[:, None] * (1.0 + 1e-6)).all()
    assert (np.abs(dq) <= bounds["velocity"] * (1.0 + 1e-9)).all()
    assert (np.abs(ddq) <= bounds["acceleration"] * (1.0 + 1e-9)).all()
    return bool(np.abs(dq).max() > 0.3 and not dq[-1].any() and not ddq[-1].any())


@pytest.mark.parametrize("realtime", [False, True])
@pytest.mark.parametrize(
    ("target", "words"),
    [(lambda: REST + FAR, "3.5 for joint7|joint7.*"), (lambda: REST * np.nan, "NaN"), (lambda: REST[:6], r"shape \(6,\)"),
     (lambda: "home", "'home'"), (lambda: Chunk(np.full((4, 7), np.nan), 20.0), "points"),
     (lambda: planners.plan(optik.load("panda"), REST, REST + 9.0, limits=PANDA), "q_start"),
     (lambda: FAILED, "reachable poses")],
)  # fmt: skip
def test_a_target_that_cannot_be_meant_is_counted_and_the_stream_goes_on(target, words, realtime):
    source = Then(target)
    flow = stream(
        optik.load("panda"), source, REST, limits=PANDA, rate=500.0, budget=0.05, silence=0.1, realtime=realtime
    )
    points = list(flow)
    report = flow.report()
    assert report.joined == 1 and list(report.kept.values()) == [1] and source.asked[-1] > 0.5
    assert re.search(words, next(iter(report.kept)))
    np.testing.assert_allclose(points[-1].q, GOAL, atol=1e-9)
    assert moves_to_rest(points)


@pytest.mark.parametrize("realtime", [False, True])
@pytest.mark.parametrize("place", ["source", "computation", "announcement"])
def test_an_exception_is_raised_when_the_arm_is_at_rest(place, realtime):
    source = Then(fail if place == "source" else lambda: REST)
    flow = stream(optik.load("panda"), source, REST, limits=PANDA, rate=500.0, budget=0.05, realtime=realtime)
    prompt = flow.engine.run
    if place == "computation":
        flow.engine.run = lambda *given: prompt(*given) if given[2] is GOAL else fail()  # type: ignore[method-assign]
    if place == "announcement":
        flow.announce = lambda motion, begin: fail() if begin > 0.1 else None
    points = []
    with pytest.raises(RuntimeError, match="the policy is gone"):
        points += [now for now in flow if points.append(now)]  # type: ignore[func-returns-value]
    np.testing.assert_allclose(points[-1].q, GOAL, atol=1e-9)
    assert isinstance(flow.error, RuntimeError) and flow.report().joined == 1 and flow.report().kept == {}
    assert source.asked[-1] < 0.3 and moves_to_rest(points)


def test_a_source_at_its_end_ends_the_stream_at_rest():
    targets = iter([GOAL, *[None] * 100, REST])
    points = list(
        stream(optik.load("panda"), lambda now: next(targets), REST, limits=PANDA, rate=500.0, realtime=False)
    )
    assert moves_to_rest(points) and points[-1].t < 2.0
    np.testing.assert_allclose(points[-1].q, REST, atol=1e-9)


@pytest.mark.parametrize("realtime", [False, True])
def test_a_source_of_invalid_targets_is_not_silent(realtime):
    flow = stream(optik.load("panda"), lambda now: "home" if now.t < 0.5 else GOAL if now.t < 0.52 else None, REST,
                  limits=PANDA, rate=100.0, budget=0.02, silence=0.2, realtime=realtime)  # fmt: skip
    points = list(flow)
    np.testing.assert_allclose(points[-1].q, GOAL, atol=1e-9)
    assert points[-1].t > 0.7 and sum(flow.report().kept.values()) > 10


def test_a_start_beyond_a_range_by_rounding_is_clipped_and_a_farther_one_is_named():
    robot, q = optik.load("panda"), REST.copy()
    for excess in (1e-7, 9e-7):
        q[3] = robot.limits.lower[3] - excess
        assert next(stream(robot, lambda now: None, q, limits=PANDA, realtime=False)).q[3] == robot.limits.lower[3]
    q[3] = robot.limits.lower[3] - 1e-5
    with pytest.raises(InvalidInput, match="for joint4, 1e-05 outside"):
        stream(robot, lambda now: None, q, limits=PANDA)
    with pytest.raises(InvalidInput, match=r"for joint., .* outside; are these degrees\?"):
        stream(robot, lambda now: None, np.degrees(REST), limits=PANDA)
    motion = planners.plan(robot, GOAL, REST, limits=PANDA)
    with pytest.raises(InvalidInput, match=r"for joint., .* outside; are these degrees\?"):
        planners.retarget(motion, 0.0, [0.0, -70.0, 0.0, -135.0, 0.0, 100.0, 45.0])


@pytest.mark.parametrize("name", ["ideal", "mujoco"])
@pytest.mark.parametrize("target", [fail, lambda: REST + FAR])
def test_a_drive_returns_its_record_of_a_source_that_fails(name, target):
    robot = optik.load("panda")
    done = make_drive(name, robot).follow(
        stream(robot, Then(target), REST, limits=PANDA, rate=250.0, realtime=False, silence=0.1)
    )
    assert bool(done) == (target is not fail) and (done or done.fault == "RuntimeError: the policy is gone")
    np.testing.assert_allclose(done.setpoints[-1], GOAL, atol=1e-9)
    assert np.abs(done.q[-1] - GOAL).max() < 5e-3 and done.report.joined == 1


# ---------------------------------------------------------------- from a moving state


STATE = (
    [0.01, -0.7, 0.08, -2.4, -0.1, 1.8, 0.7],
    [0.1, 0.9, 0.8, 0.9, -0.9, 1.0, -0.7],
    [-5.0, -3.0, 3.0, -4.0, 3.0, -3.0, 4.0],
)


def test_a_stream_begins_with_a_measured_state_and_a_target_is_joined_from_it():
    robot = optik.load("panda")
    points = list(stream(robot, lambda now: None, STATE, limits=PANDA, rate=500.0, realtime=False, silence=0.1))
    np.testing.assert_array_equal(np.array(points[0][1:4]), STATE)
    assert moves_to_rest(points) and points[-1].t < 0.6
    points = list(stream(robot, Then(lambda: None), STATE, limits=PANDA, rate=500.0, realtime=False, silence=0.1))
    assert moves_to_rest(points)
    np.testing.assert_allclose(points[-1].q, GOAL, atol=1e-9)
    found = planners.retarget(STATE, 0.0, GOAL, robot=robot, limits=PANDA)
    np.testing.assert_array_equal(np.array(found.state(0.0)), STATE)
    assert found.status == "goal" and found.certificate.is_valid


def test_a_trajectory_is_a_running_motion_and_is_stopped_where_it_ends_moving():
    robot, t = optik.load("panda"), np.linspace(0.0, 0.8, 9)
    samples = REST + 0.3 * np.sin(t[:, None] * np.linspace(0.5, 2.0, 7))
    curve = planners.Trajectory(scipy.interpolate.CubicSpline(t, samples))
    points = list(stream(robot, lambda now: None, curve, limits=PANDA, rate=500.0, realtime=False, silence=0.1))
    assert moves_to_rest(points) and points[-1].t > 0.9
    np.testing.assert_allclose(points[200].q, curve(0.4), atol=1e-12)
    found = planners.retarget(curve, 0.3, GOAL, robot=robot, limits=PANDA)
    assert found.status == "goal"
    np.testing.assert_allclose(np.array(found.state(0.0)), [curve(0.3, k) for k in range(3)], atol=1e-12)


@pytest.mark.parametrize(
    ("change", "words"),
    [((1, 3, 2.5), "velocity of joint4 is 2.5"), ((2, 1, 9.0), "acceleration of joint2"), ((0, 3, -3.05), "joint4 exceeds"),
     ((0, 0, 9.0), "a value in .* 9 for joint1, 6.1 outside"), ((1, 1, np.nan), r"of shape \(3, 7\)")],
)  # fmt: skip
def test_a_state_that_cannot_be_stopped_names_what_is_wrong(change, words):
    robot, X = optik.load("panda"), np.array(STATE)
    X[1, 3] = -1.0
    X[change[:2]] = change[2]
    with pytest.raises(InvalidInput, match=f"start: .*{words}"):
        stream(robot, lambda now: None, X, limits=PANDA)
    with pytest.raises(InvalidInput, match="motion: "):
        planners.retarget(X, 0.0, GOAL, robot=robot, limits=PANDA)
    with pytest.raises(InvalidInput, match=r"motion: .*with robot="):
        planners.retarget(X, 0.0, GOAL, limits=PANDA)


# ---------------------------------------------------------------- the report


def test_reasons_are_counted_by_kind():
    robot = optik.load("panda")
    rng, jog = np.random.default_rng(5), JogVelocity(timeout=0.1)

    def source(now: Setpoint) -> Any:
        if now.t > 1.0:
            return None
        jog.set(np.zeros(7))
        return [jog(now), REST + (3.5 + rng.random()) * np.eye(7)[6], rng.random(7) * np.nan, rng.random(6)][
            round(now.t * 100.0) % 4
        ]

    flow = stream(robot, source, REST, limits=PANDA, rate=100.0, realtime=False, silence=0.1)
    list(flow)
    report = flow.report()
    assert sorted(report.kept.values()) == [25, 25, 25] and all(text in str(report) for text in report.kept)


def test_a_report_says_what_budget_would_have_sufficed():
    flow = stream(
        optik.load("panda"), lambda now: GOAL if now.t < 1.0 else None, REST, limits=PANDA, rate=200.0, budget=0.03
    )
    prompt = flow.engine.run

    def slow(*given: Any) -> Any:
        time.sleep(0.08)
        return prompt(*given)

    flow.engine.run = slow  # type: ignore[method-assign]
    for now in flow:
        if now.t > 1.0:
            flow.stop()
    report = flow.report()
    assert report.late >= 3 and 0.07 < report.enough < 0.5
    assert f"motions late: a budget of {report.enough:.4g} s would have sufficed for 99 %" in str(report)


def test_a_report_has_a_line_for_each_thing_to_change_only():
    plain = StreamReport(9, 2, {}, 0, 0, 1, (0.0,) * 3, (0.0,) * 3, 0.0, 0, 0, 0.001, 0.005, {})
    assert len(str(plain).splitlines()) == 5
    said = str(plain._replace(clipped=3, jumps=2, scatter=0.006, cut={"a chunk of 9 poses ends": 4}))
    for words in (
        "3 targets were clipped",
        "π rad at 2 targets",
        "4 × a chunk of 9 poses",
        "noise of the targets is 6 mrad",
        "tolerance=0.024",
    ):
        assert words in said, said


def test_the_clock_of_a_stream_begins_at_its_first_set_point() -> None:
    flow = stream(optik.load("panda"), lambda now: None, REST, limits=PANDA, rate=100.0, realtime=False, silence=0.1)
    assert flow.time == 0.0
    assert [flow.time == now.t for now in flow].count(False) == 0 and flow.time > 0.05
