"""Set-points, and what a simulated drive does with them: encoders, stops, faults, refusals."""

import time
from dataclasses import replace
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

import optik
from optik.errors import InvalidInput, NoSolution
from planners import JointLine, MotionLimits, Plan, make_law, plan, replan
from planners.cell import Execution, ExecutionStatus, FaultKind, IdealDrive, Moment, fit_periods, make_setpoints
from planners.cell.drives._run import EncoderMonitor
from planners.following.follow import PlanFailure
from planners.planning import PlanStatus
from planners.trajectory import simulate_controller
from tests import oracles
from tests.planners.cases import START, default_line, paper6r
from tests.planners.faulty import FaultyIdeal, LostEncoder, Stall
from tests.planners.stops import stops
from tests.seeds import shift_seed

PERIOD = 0.004


@cache
def line(law: str = "optimal", speed: float | None = None) -> Plan:
    timing = make_law(law) if speed is None else make_law(law, speed=speed)
    found = plan(paper6r(), default_line(), START, timing=timing)
    assert found
    return found


@cache
def sliding() -> Plan:
    """Of an arm with a sliding joint."""
    robot = optik.load("irb910sc")
    q = robot.limits.lower + 0.3 * (robot.limits.upper - robot.limits.lower)
    goal = robot.limits.lower + 0.45 * (robot.limits.upper - robot.limits.lower)
    found = plan(robot, JointLine(robot, q, goal), q, limits=MotionLimits(1.0, 5.0, 50.0))
    assert found
    return found


def goal() -> Any:
    return line().trajectory(line().trajectory.end)


def run(*faults: Any, **options: Any) -> tuple[IdealDrive, Execution]:
    drive = FaultyIdeal(paper6r(), faults=faults, **options)
    return drive, drive.execute(line())


def at_rest_within_limits(execution: Execution, but: int | None = None) -> None:
    """The arm's own velocities, by differences of its positions, stay within the limits, and the last is zero."""
    dt = np.diff(execution.t)[:, None]
    v = np.diff(execution.q, axis=0) / dt
    kept = np.arange(6) != but
    assert (np.abs(v).max(axis=0) <= paper6r().limits.velocity * (1.0 + 1e-6))[kept].all()
    a = np.diff(v, axis=0) / dt[1:]
    assert (np.abs(a).max(axis=0) <= 1.1 * np.asarray(paper6r().limits.acceleration))[kept].all()
    assert np.abs(execution.dq[-1]).max() < 1e-9
    assert np.abs(v[-1]).max() < 1e-3


# ---------------------------------------------------------------- set-points
@pytest.mark.parametrize("period", [0.004, 0.001, 1.0 / 125.0, 0.3])
def test_a_plan_is_slowed_to_whole_periods_and_certified_again(period: float) -> None:
    slower = fit_periods(line(), period)
    count = round(slower.trajectory.end / period)
    assert slower.trajectory.end == count * period
    assert 0.0 <= slower.trajectory.end - line().trajectory.end < period
    assert slower and slower.certificate.is_valid and slower.certificate is not line().certificate
    assert slower.certificate.enforced == line().certificate.enforced
    assert slower.stretch_factor == pytest.approx(slower.trajectory.end / line().trajectory.end, rel=1e-12)
    share = np.linspace(0.0, 1.0, 50)
    there = line().trajectory(share * line().trajectory.end)
    np.testing.assert_allclose(slower.trajectory(share * slower.trajectory.end), there, rtol=0.0, atol=1e-12)
    assert fit_periods(slower, period) is slower


def test_a_constant_tool_speed_stays_and_its_last_setpoint_is_held() -> None:
    weld = line("constant_speed", 0.05)
    assert fit_periods(weld, PERIOD) is weld
    stream = make_setpoints(weld, PERIOD)
    assert stream.t[-2] < weld.trajectory.end < stream.t[-1]
    np.testing.assert_allclose(stream.q[-1], weld.trajectory(weld.trajectory.end), rtol=0.0, atol=1e-14)
    execution = IdealDrive(paper6r()).execute(weld)
    assert execution and execution.plan is weld


def test_setpoints_are_the_states_at_the_ticks() -> None:
    slower = fit_periods(line(), PERIOD)
    stream = make_setpoints(slower.motion, PERIOD)
    np.testing.assert_allclose(stream.t, PERIOD * np.arange(len(stream.t)), rtol=1e-15)
    joints = oracles.Joints(slower.trajectory)
    for order, rows in enumerate((stream.q, stream.dq)):
        np.testing.assert_allclose(rows, joints(stream.t, order), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(stream.dq[[0, -1]], 0.0, atol=1e-12)


@pytest.mark.parametrize("period", [0.0, -0.004, np.nan, np.inf, 10.0, "fast", None])
def test_periods_that_cannot_be_meant_are_refused(period: Any) -> None:
    for call in (fit_periods, make_setpoints):
        with pytest.raises(InvalidInput, match=r"^period: "):
            call(line(), period)


@pytest.mark.parametrize("period", [0.02, 0.004])
@pytest.mark.parametrize("law", ["optimal", "ruckig"])
def test_the_cubics_of_the_servo_exceed_an_acceleration_by_four_27ths_of_jerk_and_period_at_most(
    law: str, period: float
) -> None:
    """Their acceleration is the straight line nearest in the mean square; a ramp over two thirds is its worst case."""
    x = np.linspace(0.0, 1.0, 100_001)
    ramp = -np.maximum(2.0 / 3.0 - x, 0.0)
    assert np.polyval(np.polyfit(x, ramp, 1), 1.0) == pytest.approx(4.0 / 27.0, rel=1e-4)
    slower = fit_periods(line(law), period)
    cubics = simulate_controller(slower.trajectory, 1.0 / period, "cubic")
    over = cubics.extrema(2).worst - slower.trajectory.extrema(2).worst
    assert (over <= 4.0 / 27.0 * slower.trajectory.extrema(3).worst * period * (1.0 + 1e-9)).all()


def test_a_motion_of_too_many_periods_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InvalidInput, match=r"period: .*at most 500,000 periods"):
        make_setpoints(line(), line().trajectory.end / 500_001)
    monkeypatch.setattr(import_module("planners.cell.drives.base"), "MOST_PERIODS", 500)
    assert len(make_setpoints(line(), line().trajectory.end / 499).t) == 500


@pytest.mark.parametrize("periods", [1, 2, 7])
def test_a_motion_needs_the_whole_periods_that_it_lasts(periods: int) -> None:
    motion = line().trajectory
    for off, count in ((0.0, periods), (0.99e-9, periods), (1.01e-9, periods + 1), (-0.99e-9, periods)):
        period = (motion.end - off) / periods
        assert len(make_setpoints(motion, period).t) == count + 1
    with pytest.raises(InvalidInput, match="period"):
        make_setpoints(motion, motion.end + 1.01e-9)


def test_a_failed_plan_has_no_setpoints() -> None:
    far = plan(paper6r(), paper6r().fk(START) @ oracles.trans(5.0, 0.0, 0.0), START)
    assert not far
    with pytest.raises(NoSolution):
        make_setpoints(far, PERIOD)
    refused = IdealDrive(paper6r()).execute(far)
    assert refused.status is ExecutionStatus.REFUSED and "did not succeed" in refused.reason


# ---------------------------------------------------------------- the ideal arm
@pytest.mark.parametrize("encoder", [2.0**20, 2.0**13])
@pytest.mark.parametrize("motion", [line, sliding])
def test_the_measured_tool_is_as_near_as_the_encoders_resolution_allows(motion: Any, encoder: float) -> None:
    robot = motion().robot
    execution = IdealDrive(robot, encoder=encoder).execute(motion())
    assert execution and execution.setpoints is not None
    np.testing.assert_allclose(execution.q, execution.motion(execution.t), rtol=0.0, atol=2e-6)
    half = np.where(robot.prismatic, 0.5e-6, np.pi / encoder)
    assert (np.abs(execution.measured - execution.setpoints.q) <= half * (1.0 + 1e-9) + 1e-12).all()
    T, aim = oracles.fk(robot, execution.measured), oracles.fk(robot, execution.setpoints.q)
    off = np.linalg.norm(T[:, :3, 3] - aim[:, :3, 3], axis=1)
    columns = np.linalg.norm(oracles.jacobian(robot, execution.setpoints.q)[:, :3], axis=1)
    second = 2.0 * half[~robot.prismatic].sum() ** 2  # of an arm shorter than 2 m
    assert (off <= columns @ half + second).all()
    assert off.max() > 0.05 * (columns @ half).max()


@pytest.mark.parametrize("hold", [False, True])
def test_setpoints_are_interpolated_by_cubics_or_held(hold: bool) -> None:
    execution = IdealDrive(paper6r(), hold=hold, step=0.001).execute(line())
    stream = execution.setpoints
    assert execution and stream is not None
    if hold:
        k = np.minimum((np.arange(len(execution.t) - 1)) // 4, len(stream.t) - 1)
        np.testing.assert_array_equal(execution.q[1:], stream.q[k])
    else:
        cubic = CubicHermiteSpline(stream.t, stream.q, stream.dq)
        np.testing.assert_allclose(execution.q, cubic(execution.t), rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(execution.dq, cubic(execution.t, 1), rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(execution.q[-1], goal(), rtol=0.0, atol=1e-9)


def test_noise_of_the_encoders_is_drawn_from_the_seed() -> None:
    first, second, other = (run(encoder_noise=1e-4, seed=shift_seed(seed))[1].measured for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, second)
    stream = make_setpoints(fit_periods(line(), PERIOD), PERIOD).q
    assert 0.8e-4 < (first - stream).std() < 1.2e-4 and not np.array_equal(first, other)


# ---------------------------------------------------------------- stop and resume
def wrong_of(seed: int, plans: int, each: int, first: int = 0) -> list[str]:
    """All that is wrong with random stops; how far they went to the limits is printed."""
    found = list(stops(shift_seed(seed), plans, each, first))
    worst: dict[str, float] = {}
    for x in found:
        worst |= {name: max(worst.get(name, 0.0), ratio) for name, ratio in x.ratios.items()}
    print(f"{len(found)} stops of {plans} plans: {worst}")
    assert sum(x.execution.stop_plan is not None for x in found) > 0.5 * len(found)
    assert sum(x.resumed is not None for x in found) > 0.15 * len(found)
    return [f"{x.plan.robot.name}, {x.plan.law}: {word}" for x in found for word in x.wrong]


def test_stops_are_within_the_limits_on_the_path_and_resumed() -> None:
    assert not wrong_of(3, 2, 3, first=4)  # of arms that are planned quickly; make soak has all


@pytest.mark.soak
@pytest.mark.parametrize("seed", [1, 2])
def test_stops_are_within_the_limits_on_the_path_and_resumed_at_length(seed: int) -> None:
    assert not wrong_of(seed, 10, 10)


def test_a_stop_takes_effect_once_the_setpoints_that_were_sent_are_used_up() -> None:
    for ahead in (1, 10):
        execution = IdealDrive(paper6r(), ahead=ahead).execute(line(), stop=0.1)
        assert execution.status is ExecutionStatus.STOPPED and execution.stop_plan is not None
        assert execution.motion.end - execution.stop_plan.trajectory.end == pytest.approx(
            0.1 + ahead * PERIOD, abs=1e-9
        )


def test_a_stop_near_the_end_is_the_end_and_says_so() -> None:
    execution = IdealDrive(paper6r()).execute(line(), stop=line().trajectory.end - 0.02)
    assert execution and execution.stop_plan is None and "no stop was needed" in execution.notes[0]
    np.testing.assert_allclose(execution.q[-1], goal(), rtol=0.0, atol=1e-9)


def test_a_stop_that_cannot_be_certified_is_not_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    def none(running: Plan, *given: Any, **options: Any) -> Plan:
        return replan(running, 0.1, stop=True, tolerance=(1e-15, 1e-15))

    monkeypatch.setattr(import_module("planners.cell.drives._run"), "replan", none)
    execution = IdealDrive(paper6r()).execute(line(), stop=0.1)
    assert execution.status is ExecutionStatus.DONE and "could be certified" in execution.notes[0]


def test_the_stop_that_is_sent_is_the_first_that_is_certified(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a plan whose law keeps no jerk there are two; here the gentle one, then both, cannot be certified."""
    running = plan(paper6r(), default_line(), START, timing="toppra", limits=MotionLimits(2.0, 10.0))
    module: Any = import_module("planners.cell.drives._run")
    both, t = module.find_stop_limits(running), 0.3 * running.trajectory.end
    assert [x.jerk is not None for x in both] == [True, True] and (both[0].jerk < both[1].jerk).all()
    first = module.plan_stop_at(running, t)
    assert first and first.limits == both[0]

    def refuses(*hopeless: MotionLimits) -> Any:
        def other(running: Plan, t: float, **options: Any) -> Plan:
            if options.get("limits", both[0]) in hopeless:
                options["tolerance"] = (1e-15, 1e-15)
            return replan(running, t, **options)

        return other

    monkeypatch.setattr(module, "replan", refuses(both[0]))
    second = module.plan_stop_at(running, t)
    assert second and second.limits == both[1]
    monkeypatch.setattr(module, "replan", refuses(*both))
    assert not module.plan_stop_at(running, t)


@pytest.mark.parametrize(
    ("law", "limits"),
    [("toppra", MotionLimits(2.0, 10.0)), ("quintic", MotionLimits(2.0, 10.0, 100.0)), ("quintic", MotionLimits()),
     ("toppra", MotionLimits((-1.5, 2.0), (-8.0, 10.0)))],
)  # fmt: skip
def test_a_plan_whose_law_keeps_no_jerk_is_stopped_and_resumed_too(law: str, limits: MotionLimits) -> None:
    running = plan(paper6r(), default_line(), START, timing=law, limits=limits, allow=("limits", "jerk"))
    drive = IdealDrive(paper6r())
    stopped = drive.execute(running, stop=0.15 * running.trajectory.end)
    assert (
        stopped.status is ExecutionStatus.STOPPED
        and stopped.stop_plan is not None
        and stopped.stop_plan.certificate.is_valid
    )
    for order, limit in ((1, 2.0), (2, 10.0)):
        own = running.trajectory.extrema(order).worst
        most = np.maximum(own, 0.1 * own.max() if limits.velocity is None else limit)
        assert (stopped.stop_plan.trajectory.extrema(order).worst <= most * (1.0 + 2e-6)).all()
    assert drive.resume(stopped)


def test_an_arm_that_was_moved_since_its_stop_is_not_resumed() -> None:
    drive = IdealDrive(paper6r())
    stopped = drive.execute(line(), stop=0.1)
    moved = IdealDrive(paper6r(), q=stopped.q[-1] + 0.01)
    refused = moved.resume(stopped)
    assert refused.status is ExecutionStatus.REFUSED and "moved since" in refused.reason
    assert drive.resume(stopped)


# ---------------------------------------------------------------- faults
def test_a_joint_is_found_just_beyond_the_tolerance_where_it_comes_to_rest() -> None:
    stall, joint = Stall("joint2", 0.6 * line().trajectory.end), 1
    wide = run(stall, encoder=np.inf, end_tolerance=10.0, following=10.0)[1]
    assert wide and wide.setpoints is not None
    off = abs(wide.q[-1, joint] - wide.setpoints.q[-1, joint])
    assert off > 1e-3
    for share, status in ((0.99, ExecutionStatus.DONE), (1.01, ExecutionStatus.FAULT)):
        assert run(stall, encoder=np.inf, end_tolerance=off / share, following=10.0)[1].status is status
    late = np.abs(wide.measured - wide.setpoints.q)[: len(wide.setpoints.t), joint].max()
    for share, found in ((0.99, False), (1.01, True)):
        done = run(stall, encoder=np.inf, end_tolerance=10.0, following=late / share)[1]
        assert (done.fault is not None and done.fault.kind is FaultKind.STALL) == found


def test_a_stalled_joint_stops_the_arm_which_goes_back_and_on() -> None:
    drive, execution = run(Stall("joint1", 0.1, until=0.3), following=0.02)
    assert execution.fault is not None and execution.fault.kind is FaultKind.STALL
    assert execution.fault.joint == "joint1" and 0.1 < execution.fault.t < 0.2
    stalled = execution.q[execution.t > 0.11, 0]
    assert np.ptp(stalled) == 0.0
    at_rest_within_limits(execution, but=0)
    again = drive.resume(execution)
    assert again
    assert again.before is not None and again.before.status is ExecutionStatus.DONE
    np.testing.assert_allclose(again.q[-1], goal(), rtol=0.0, atol=1e-9)


def test_a_joint_that_stays_stalled_faults_again_and_a_new_plan_starts_where_it_stands() -> None:
    drive, execution = run(Stall(0, 0.1), following=0.02)
    again = drive.resume(execution)
    assert again.status is ExecutionStatus.FAULT and again.fault is not None and again.fault.joint == "joint1"
    back = plan(paper6r(), START, drive.measure())
    assert back.trajectory(0.0) == pytest.approx(drive.measure(), abs=1e-9)


def test_a_joint_that_stalls_by_little_is_found_at_rest() -> None:
    _, execution = run(Stall("joint2", 0.1), end_tolerance=1e-3)
    assert execution.status is ExecutionStatus.FAULT and execution.fault is not None
    assert execution.fault.joint == "joint2" and "came to rest" in execution.reason


def test_a_lost_encoder_stops_the_arm_and_is_repaired_before_it_goes_on() -> None:
    drive, execution = run(LostEncoder("joint3", 0.1, until=0.3))
    assert execution.fault is not None and execution.fault.kind is FaultKind.ENCODER
    assert execution.fault.joint == "joint3" and execution.fault.t == pytest.approx(0.1)
    assert "went on by its set-points" in execution.reason
    at_rest_within_limits(execution)
    assert np.isnan(execution.measured[:, 2]).any() and not np.isnan(execution.measured[:, :2]).any()
    assert drive.resume(execution)
    lost = FaultyIdeal(paper6r(), START, faults=(LostEncoder("joint3", 0.0),))
    assert np.isnan(lost.measure()[2])
    refused = lost.execute(line())
    assert refused.status is ExecutionStatus.REFUSED and "joint3" in refused.reason
    forever, stopped = run(LostEncoder("joint3", 0.1))
    refused = forever.resume(stopped)
    assert refused.status is ExecutionStatus.REFUSED and "joint3" in refused.reason


def test_a_frozen_encoder_is_found_as_a_joint_that_does_not_follow() -> None:
    _, execution = run(LostEncoder("joint1", 0.1, frozen=True), following=0.02)
    assert execution.fault is not None and execution.fault.kind is FaultKind.STALL
    assert "frozen" in execution.reason
    at_rest_within_limits(execution)


@pytest.mark.parametrize(("over", "found"), [(1.01, True), (0.99, False)])
def test_a_reading_that_stays_while_its_set_point_moves_by_the_tolerance_and_four_counts_is_a_fault(
    over: float, found: bool
) -> None:
    q = make_setpoints(fit_periods(line(), PERIOD), PERIOD).q[:, 2]
    assert np.ptp(q) > 1.005 * np.abs(q - q[0]).max()  # the joint moves to both sides of its start, where it freezes
    tolerance = np.ptp(q) / over - 4.0 * 2.0 * np.pi / 2.0**20
    _, execution = run(LostEncoder("joint3", 0.0, frozen=True), following=tolerance)
    assert execution.fault is not None and execution.fault.kind is FaultKind.ENCODER
    assert execution.fault.joint == "joint3" and ("its set-point moved by more than" in execution.reason) == found
    at_rest_within_limits(execution)


def test_unmoved_readings_are_those_of_a_plain_search() -> None:
    rng = np.random.default_rng(3)
    read, asked = rng.integers(0, 2, (60, 3)).astype(float), rng.normal(size=(60, 3))
    read[rng.random((60, 3)) < 0.1] = np.nan
    unmoved = EncoderMonitor()
    for k in range(60):
        moved, seconds = unmoved.update(read[k], asked[k], 0.1 * k), unmoved.seconds(0.1 * k)
        for i in range(3):
            first = k
            while first > 0 and read[first - 1, i] == read[k, i]:
                first -= 1
            assert moved[i] == np.ptp(asked[first : k + 1, i]) and seconds[i] == pytest.approx(0.1 * (k - first))


@pytest.mark.parametrize("frozen", [False, True])
def test_an_encoder_that_is_lost_at_the_last_tick_is_a_fault(frozen: bool) -> None:
    end = fit_periods(line(), PERIOD).trajectory.end
    _, execution = run(LostEncoder("joint3", end - (0.1 if frozen else 1e-6), frozen=frozen))
    assert execution.fault is not None and execution.fault.kind is FaultKind.ENCODER
    assert execution.fault.joint == "joint3" and execution.fault.t == pytest.approx(end)


def test_a_watcher_that_takes_long_makes_ticks_late_where_the_pace_is_real() -> None:
    def slow(moment: Moment) -> None:
        if 0.1 < moment.t < 0.11:
            time.sleep(0.05)

    drive = IdealDrive(paper6r(), pace=4.0)
    began = time.monotonic()
    execution = drive.execute(line(), watch=slow)
    assert execution and execution.late > 0
    assert time.monotonic() - began >= line().trajectory.end / 4.0


# ---------------------------------------------------------------- refusals
def test_a_plan_whose_certificate_does_not_hold_is_refused() -> None:
    why = PlanFailure(
        PlanStatus.NOT_PROVED, 0.1, "joint1", "the certificate does not hold: jerk of joint1", "another law"
    )
    refused = IdealDrive(paper6r(), START).execute(replace(line(), status=PlanStatus.NOT_PROVED, failure=why))
    assert refused.status is ExecutionStatus.REFUSED and "does not hold" in refused.reason
    np.testing.assert_allclose(refused.q[-1], START, atol=1e-5)


def test_a_plan_that_begins_in_motion_or_is_too_fast_for_the_arm_is_refused() -> None:
    moving = replan(line(), 0.2)
    refused = IdealDrive(paper6r()).execute(moving)
    assert refused.status is ExecutionStatus.REFUSED and "in motion" in refused.reason
    fast = plan(paper6r(), default_line(), START, limits=MotionLimits(20.0, 100.0, 5000.0))
    assert fast
    refused = IdealDrive(paper6r()).execute(fast)
    assert refused.status is ExecutionStatus.REFUSED and "own limit" in refused.reason


@pytest.mark.parametrize(
    ("argument", "options"),
    [
        ("period", {"period": 0.0}), ("ahead", {"ahead": 0}), ("hold", {"hold": "yes"}), ("encoder", {"encoder": -1.0}),
        ("encoder", {"encoder": [1.0, 2.0]}), ("encoder_noise", {"encoder_noise": np.nan}), ("pace", {"pace": 0.0}),
        ("following", {"following": 0.0}), ("start_tolerance", {"start_tolerance": np.nan}), ("step", {"step": 0.01}),
        ("seed", {"seed": -1}), ("q", {"q": [0.0]}), ("q", {"q": [100.0] * 6}),
    ],
)  # fmt: skip
def test_options_that_cannot_be_meant_are_refused(argument: str, options: dict[str, Any]) -> None:
    with pytest.raises(InvalidInput, match=rf"^{argument}: "):
        IdealDrive(paper6r(), **options)


def test_what_is_no_plan_of_this_arm_is_refused() -> None:
    for wrong in (line().motion, sliding(), None):
        with pytest.raises(InvalidInput, match=r"^plan: "):
            IdealDrive(paper6r()).execute(wrong)
    with pytest.raises(InvalidInput):
        IdealDrive(paper6r()).execute(line(), stop="now")
    with pytest.raises(InvalidInput):
        IdealDrive(paper6r()).measure()
    done = IdealDrive(paper6r()).execute(line())
    for wrong in (done, None):
        with pytest.raises(InvalidInput, match=r"^execution: "):
            IdealDrive(paper6r()).resume(wrong)
