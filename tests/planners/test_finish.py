"""Quiet motions, and plans slowed to an rms torque or to the stops along them, against integrals and oscillators of our own."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
import scipy

import optik
from optik.errors import InvalidInput, NoSolution
from optik.types import Array
from planners import JointLine, Line, MotionLimits, Part, Plan, Program, ProgramPlan, make_law, plan, replan
from planners.program import Dwell
from planners.replan import finish
from planners.trajectory import Trajectory

BENT = np.deg2rad([10.0, -80.0, 95.0, -105.0, -90.0, 20.0])
TURN = np.array([2.2, -0.9, 0.8, 0.7, -1.0, 1.5])


@cache
def arm() -> optik.Robot:
    return optik.load("ur5e").with_payload((1.0, 3.0))


@cache
def planned(**law: Any) -> Plan:
    return plan(
        arm(),
        JointLine(arm(), BENT, BENT + TURN),
        BENT,
        limits=MotionLimits.of(arm(), acceleration=10.0, jerk=100.0),
        timing=make_law("optimal", **law),
    )


@cache
def program(**law: Any) -> ProgramPlan:
    goal = arm().fk(BENT).copy()
    goal[:3, 3] += (0.25, -0.2, 0.1)
    parts = [Part(Line(arm().fk(BENT), goal)), Dwell(0.2), Part(Line(goal, arm().fk(BENT)))]
    limits = MotionLimits.of(arm(), acceleration=10.0, jerk=100.0)
    found = plan(arm(), Program(parts), BENT, limits=limits, timing=make_law("optimal", **law))
    assert isinstance(found, ProgramPlan)
    return found


def residual(motion: Trajectory, frequency: float) -> float:
    """Amplitude after the motion of an undamped oscillator that its accelerations drive, over the largest of them."""
    t = np.linspace(0.0, motion.end, 40_001)
    w = 2.0 * np.pi * frequency
    a = motion(t, 2)
    return float(
        np.linalg.norm(scipy.integrate.trapezoid(a * np.exp(1j * w * t)[:, None], t, axis=0)) / np.abs(a).max()
    )


def test_a_quiet_motion_leaves_the_mode_at_rest() -> None:
    usual, quiet = planned(), planned(quiet=7.0)
    assert quiet and quiet.law == "optimal, quiet 7 Hz"
    assert residual(quiet.trajectory, 7.0) < 1e-9 * max(
        residual(usual.trajectory, f) for f in (6.0, 6.5, 7.0, 7.5, 8.0)
    )
    assert usual.duration < quiet.duration < usual.duration + 1.2 / 7.0
    again = replan(quiet, 0.4 * quiet.duration)
    assert again and again.law == "optimal"


def test_a_curved_path_and_a_program_are_quiet_too() -> None:
    found = program(quiet=9.0)
    path, limits = found.sections[0].path, found.sections[0].limits
    one = plan(arm(), path, BENT, limits=limits, timing=make_law("optimal", quiet=9.0))
    s = np.interp(np.linspace(0.0, one.duration, 20_001), one.trajectory.knots, one.trajectory.s)
    assert one and np.isfinite(s).all()
    assert found and all(section.duration == pytest.approx(one.duration, rel=0.05) for section in found.sections)
    assert replan(found, 0.3 * found.duration)


@pytest.mark.parametrize("quiet", [0.0, -3.0, "7", np.nan])
def test_a_frequency_is_above_zero(quiet: Any) -> None:
    with pytest.raises(InvalidInput, match="frequency above 0"):
        make_law("optimal", quiet=quiet)
    with pytest.raises(InvalidInput, match="quiet"):
        make_law("ruckig", quiet=7.0)


def test_a_quiet_motion_has_no_other_duration() -> None:
    quiet = planned(quiet=7.0)
    with pytest.raises(InvalidInput, match="moves the frequency"):
        plan(arm(), quiet.path, BENT, limits=quiet.limits, timing=make_law("optimal", quiet=7.0), duration=3.0)


# ---------------------------------------------------------------- rms torque


def rms(found: Plan, cycle: float | None) -> Array:
    """Largest rms torque of both loads, by the trapezoidal rule."""
    t = np.linspace(0.0, found.duration, 50_001)
    motion, worst = found.trajectory, np.zeros(6)
    for mass in (1.0, 3.0):
        one = arm().with_payload(mass)
        tau = one.torques(motion(t), motion(t, 1), motion(t, 2))
        total = scipy.integrate.trapezoid(tau**2, t, axis=0)
        rest = one.gravity_torques(motion(found.duration))
        if cycle is not None:
            total = total + (cycle - found.duration) * rest**2
        worst = np.maximum(worst, total / (found.duration if cycle is None else cycle))
    return np.sqrt(worst)


@pytest.mark.parametrize("cycle", [None, 5.0])
def test_the_rms_torque_meets_its_limit(cycle: float | None) -> None:
    free = planned()
    usual = rms(free, cycle)
    still = rms(free.slowed_to(rms_torque=np.maximum(1.0001 * rms(free, cycle), 1e-3), cycle=cycle), cycle)
    np.testing.assert_allclose(still, usual, rtol=1e-6)  # unchanged
    floor = rms(free.stretched(1.0 / 0.02 if cycle is None else cycle / free.duration), cycle)
    most = np.where(usual > floor, floor + 0.7 * (usual - floor), 1e3)
    slower = free.slowed_to(rms_torque=most, cycle=cycle)
    assert slower and slower.duration > free.duration
    assert 0.999 < (rms(slower, cycle) / most).max() <= 1.0 + 1e-6
    assert free.slowed_to(rms_torque=1e3) is free


def test_what_gravity_needs_is_refused_with_its_joint() -> None:
    with pytest.raises(NoSolution, match="rms torque of joint2 is"):
        planned().slowed_to(rms_torque=[99.0, 1.0, 99.0, 99.0, 99.0, 99.0])
    with pytest.raises(InvalidInput, match="at least the duration"):
        planned().slowed_to(rms_torque=50.0, cycle=0.1)
    with pytest.raises(InvalidInput, match="limits, or a stopping_time"):
        planned().slowed_to()
    with pytest.raises(InvalidInput, match="fixes no speed"):
        planned(quiet=7.0).slowed_to(rms_torque=50.0)


def test_a_program_is_slowed_as_a_whole() -> None:
    free = program()
    slower = free.slowed_to(rms_torque=[60.0, 41.5, 60.0, 60.0, 60.0, 60.0])
    assert isinstance(slower, ProgramPlan) and slower and slower.waits == free.waits
    factors = {round(b.duration / a.duration, 9) for a, b in zip(free.sections, slower.sections, strict=True)}
    assert len(factors) == 1


# ---------------------------------------------------------------- stops


@pytest.fixture
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer instants, each of which takes a stop; the way to the next one counts, so limits are met all the same."""
    monkeypatch.setattr(finish, "STEPS", 20)
    monkeypatch.setattr(finish, "CHECKED_STEPS", 100)
    for found in (planned(), program()):
        vars(found).pop("stopping", None)


pytestmark = pytest.mark.usefixtures("coarse")


def test_every_stop_is_within_the_limits() -> None:
    free, rng = planned(), np.random.default_rng(3)
    longest = free.stopping
    time, distance = 0.75 * longest.time.max(), 0.8 * longest.distance.max()
    slower = free.slowed_to(stopping_time=time, stopping_distance=distance)
    assert slower and slower.stop_step is not None
    for t in rng.uniform(1e-3, 0.99 * slower.duration, 10):
        stop = replan(slower, float(t), stop=True, time_limit=0.0)
        assert stop and stop.duration <= time and stop.span[1] - stop.span[0] <= distance
    assert slower.duration < 1.5 * free.duration
    assert len(slower.to_dict()["certificate"]) and "stopping" not in slower.to_dict()
    assert "stopping" in free.to_dict()


def test_a_program_stops_within_the_limit() -> None:
    free, rng = program(), np.random.default_rng(4)
    most = 0.8 * free.stopping.time.max()
    slower = free.slowed_to(stopping_time=most)
    assert isinstance(slower, ProgramPlan)
    for t in rng.uniform(1e-3, 0.99 * slower.duration, 10):
        try:
            stop = replan(slower, float(t), stop=True, time_limit=0.0)
        except InvalidInput:  # at rest between the parts
            continue
        assert stop.times[0].rest <= most


def test_a_limit_below_all_stops_is_refused_with_the_least() -> None:
    with pytest.raises(NoSolution, match=r"the motion has a stopping time of 0\.\d+ s"):
        planned().slowed_to(stopping_time=0.01)


def test_a_stop_that_needs_more_than_four_times_the_duration_is_found() -> None:
    usual = planned()
    nearest = usual.stretched(4.0).stopping.distance.max()
    found = usual.slowed_to(stopping_distance=float(nearest))
    assert found and found.stretch_factor == pytest.approx(8.0) and found.stopping.distance.max() <= nearest
