import inspect
import json
import pickle
from dataclasses import fields
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

import optik
from optik.arm.library import load
from optik.errors import InvalidInput, NoSolution, OptikError, OutputError, UnknownName
from optik.ik import make_solver
from planners import Arc, JointLine, Line, MotionLimits, Plan, Trajectory, laws, make_law, plan, replan
from planners.cell.drives._ros_run import add_room
from planners.cell.drives.base import fit_periods
from planners.following.failure import FollowStatus
from planners.following.joint_path import JointPath
from planners.planning import PlanStatus
from planners.planning.planner import PlanOptions
from planners.replan import finish
from planners.timing import TimeLaw
from tests import oracles
from tests.oracles import PAPER
from tests.planners.cases import START, default_joint_path, default_line, paper6r

ROBOT = paper6r()
LIMITS = MotionLimits(2.0, 10.0, 100.0)


def planned(**options: Any) -> Plan:
    return plan(ROBOT, default_line(), START, **{"timing": "quintic", "samples": 31, "solver": "dls"} | options)


def too_far() -> Plan:
    """A line that joint 5 does not follow to its end."""
    line = Line(default_line().start, oracles.moved(default_line().start, [0.62, -0.78, 0.13]))
    return plan(ROBOT, line, START, timing="quintic")


class Refusing(TimeLaw):
    """Finds no motion."""

    name: ClassVar[str] = "refusing"
    enforced: ClassVar[tuple[str, ...]] = ()

    def _time(self, joint_path: JointPath, limits: MotionLimits) -> Trajectory:
        raise NoSolution("it will not", s=0.125, joint="joint2", advice="ask again")


def test_misuse_is_an_error_of_ours(tmp_path: Path) -> None:
    made, line = planned(), default_line()
    calls: dict[str, Any] = {
        "order": lambda x: made.trajectory(0.1, x), "t": made.trajectory, "s": line.pose, "s_at": made.certificate.s_at,
        "worst": made.certificate.worst, "allow": lambda x: made.save(tmp_path / "m.json", allow=x),
        "goal": lambda x: plan(ROBOT, x, START), "via": lambda x: Arc.through(line.start, x, line.goal),
        "branch": lambda x: plan(ROBOT, line, START, branch=x),
    }  # fmt: skip
    for value in ("x", 10**400, np.zeros((2, 2)), np.array(["a", "b"], dtype=object), [[1, 2], [3]], {"a": 1}, 1j):
        for name, call in calls.items():
            with pytest.raises(OptikError):
                print(name, call(value))


# ---------------------------------------------------------------- success
@pytest.mark.parametrize("law", laws())
def test_a_plan_has_its_joint_path_its_motion_and_its_certificate(law: str) -> None:
    result = planned(timing=law, samples=151, limits=LIMITS, allow=("limits", "jerk"))
    assert result
    assert result.status is PlanStatus.SOLVED
    assert (result.solver, result.law, result.failure) == ("dls", law, None)
    np.testing.assert_allclose(result.joint_path.q, default_joint_path().q, rtol=0.0, atol=1e-13)
    assert result.prefix is result.joint_path
    again = make_law(law).run(default_joint_path(), LIMITS)
    assert result.trajectory.duration == pytest.approx(result.stretch_factor * again.duration, rel=1e-9)
    assert result.stretch_factor == 1.0 if law != "toppra" else 1.0 <= result.stretch_factor < 1.001
    assert result.certificate.is_valid
    assert result.certificate.law == law
    assert result.certificate.enforced == make_law(law).enforced
    assert result.certificate.duration == result.trajectory.duration
    np.testing.assert_array_equal(result.certificate.velocity.value, result.trajectory.extrema(1).worst)


def test_methods_and_laws_are_taken_by_name_or_built() -> None:
    solver, law = make_solver(ROBOT, "ipopt"), make_law("quintic", duration=1.0)
    result = planned(solver=solver, timing=law)
    assert (result.solver, result.law, result.trajectory.duration) == ("ipopt", "quintic", 1.0)


def test_the_robots_own_limits_are_the_default() -> None:
    ours = planned().limits.arrays(6)
    for field in ("velocity", "acceleration", "jerk"):
        np.testing.assert_array_equal(ours[field], getattr(ROBOT.limits, field))
    tight = planned(limits=MotionLimits(velocity=0.1)).certificate
    np.testing.assert_allclose(tight.velocity.ratio, tight.velocity.value / 0.1, rtol=1e-12)


def test_samples_are_as_many_as_asked() -> None:
    assert len(planned(samples=47).joint_path.knots) == 47


def test_a_plan_survives_pickling() -> None:
    result = planned()
    again = pickle.loads(pickle.dumps(result))
    assert again.status is result.status
    np.testing.assert_array_equal(again.trajectory.coefficients, result.trajectory.coefficients)
    assert again.certificate.to_dict() == result.certificate.to_dict()


# ---------------------------------------------------------------- failure
def test_a_plan_that_fails_says_where_and_why_wherever_its_motion_is_asked_for() -> None:
    result = too_far()
    assert not result
    assert result.status is PlanStatus.OUTSIDE_LIMITS
    failure = result.failure
    for ask in ("trajectory", "certificate", "joint_path"):
        with pytest.raises(NoSolution) as info:
            getattr(result, ask)
        error = info.value
        assert (error.s, error.joint, error.reason, error.advice) == (
            failure.s,
            "joint5",
            failure.reason,
            failure.advice,
        )
        assert 47 / 150 < error.s / result.path.end < 48 / 150
        assert error.advice
        assert failure.reason in str(error)
        assert f"{failure.reason}; try: {failure.advice}" in str(error)
        assert f"at s = {error.s:.6g} m" in failure.reason  # with its unit
        assert isinstance(error, optik.OptikError)


def test_the_good_part_of_a_plan_that_fails_is_kept() -> None:
    result = too_far()
    assert result.prefix.end <= result.failure.s
    for s, q in zip(result.prefix.knots, result.prefix.q, strict=True):
        assert max(oracles.off_by(oracles.fk(PAPER, q), result.path.pose(s))) <= 1e-12


@pytest.mark.parametrize("status", [s for s in FollowStatus if s is not FollowStatus.SOLVED])
def test_every_way_to_stop_on_the_path_is_a_way_a_plan_ends(status: FollowStatus) -> None:
    assert PlanStatus(status).value == status.value


def test_a_singular_start_is_the_plans_status() -> None:
    q = np.zeros(6)
    start = ROBOT.fk(q)
    result = plan(ROBOT, Line(start, oracles.moved(start, [0.0, 0.05, 0.02])), q, timing="quintic")
    assert result.status is PlanStatus.SINGULAR
    assert result.prefix is None
    with pytest.raises(NoSolution) as info:
        result.joint_path  # noqa: B018
    assert info.value.s == 0.0


def test_few_samples_are_filled_in_where_the_path_needs_more() -> None:
    few = planned(samples=2, timing="optimal", solver="lm")
    assert few
    assert len(few.joint_path.nodes) > 2
    assert few.certificate.path_error.distance <= 1e-5


def test_a_law_that_finds_no_motion_is_a_status_with_the_joint_path_kept() -> None:
    result = planned(timing=Refusing())
    assert not result
    assert result.status is PlanStatus.TIMING_INFEASIBLE
    assert result.prefix.end == result.path.end
    with pytest.raises(NoSolution) as info:
        result.trajectory  # noqa: B018
    error = info.value
    assert (error.s, error.joint, error.reason, error.advice) == (0.125, "joint2", "it will not", "ask again")


def test_a_solver_built_for_another_arm_is_refused() -> None:
    with pytest.raises(InvalidInput) as info:
        planned(solver=make_solver(load("ur5e")))
    assert info.value.argument == "solver"
    assert "ur5e" in info.value.got


# ---------------------------------------------------------------- names
@pytest.mark.parametrize(
    ("argument", "name", "nearest"),
    [
        ("solver", "dsl", "dls"),
        ("solver", "ipot", "ipopt"),
        ("timing", "rucki", "ruckig"),
        ("timing", "quintik", "quintic"),
    ],
)
def test_an_unknown_name_is_answered_with_the_nearest(argument: str, name: str, nearest: str) -> None:
    with pytest.raises(UnknownName) as info:
        planned(**{argument: name})
    assert info.value.name == name
    assert info.value.nearest[0] == nearest
    assert nearest in info.value.known
    assert nearest in str(info.value)
    assert isinstance(info.value, LookupError)


@pytest.mark.parametrize("law", laws())
def test_an_option_that_a_law_does_not_have_is_refused(law: str) -> None:
    with pytest.raises(InvalidInput) as info:
        make_law(law, no_such_option=1)
    assert info.value.argument == "options"
    assert "no_such_option" in info.value.got


# ---------------------------------------------------------------- limits
@pytest.mark.parametrize("field", ["velocity", "acceleration", "jerk"])
@pytest.mark.parametrize("wrong", [[1.0], [1.0] * 5, [1.0] * 7, []])
def test_limits_of_another_length_are_refused_by_name(field: str, wrong: Any) -> None:
    with pytest.raises(InvalidInput) as info:
        planned(limits=MotionLimits(**{field: wrong}))
    assert info.value.argument == field
    assert "6" in info.value.expected


def test_a_robot_without_dynamic_limits_needs_them_for_a_law_that_keeps_them() -> None:
    robot, q = load("ur5e"), np.deg2rad([15.0, -80.0, 95.0, -60.0, -70.0, 20.0])
    line = Line(robot.fk(q), oracles.moved(robot.fk(q), [0.05, 0.0, 0.02]))
    with pytest.raises(InvalidInput, match="acceleration and jerk") as info:
        plan(robot, line, q, timing="ruckig")
    assert info.value.argument == "limits"
    assert plan(robot, line, q, timing="ruckig", limits=MotionLimits(3.0, 10.0, 100.0)).certificate.is_valid
    assert plan(robot, line, q, timing="quintic"), "the paper's law needs none"


# ---------------------------------------------------------------- files
@pytest.mark.parametrize("law", laws())
def test_plain_data_of_a_plan_are_strict_json_from_which_the_motion_can_be_rebuilt(law: str) -> None:
    result = planned(timing=law, limits=LIMITS, allow=("limits", "jerk"))
    data = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert (data["format"], data["status"], data["solver"], data["law"]) == ("optik-plan/2", "solved", "dls", law)
    assert (data["robot"], data["robot_fingerprint"]) == (ROBOT.name, ROBOT.fingerprint)
    x, c = np.array(data["knots"]["t"]), np.array(data["coefficients"])
    trajectory = result.trajectory
    for u in np.linspace(0.0, 0.999, 23):
        t = u * trajectory.duration
        k = int(np.searchsorted(x, t, side="right") - 1)
        mine = [np.polyval(c[:, k, j], t - x[k]) for j in range(6)]
        np.testing.assert_allclose(mine, trajectory(t), rtol=0.0, atol=1e-13)
    for order, name in enumerate(("q", "dq", "ddq")):
        np.testing.assert_array_equal(data["knots"][name], trajectory(trajectory.knots, order))
    assert data["certificate"] == json.loads(json.dumps(result.certificate.to_dict()))
    assert np.array(data["path"]["goal"]).tolist() == default_line().goal.tolist()


def test_the_data_of_a_plan_that_fails_say_its_reason() -> None:
    result = too_far()
    data = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert data["status"] == "outside_limits"
    assert (data["s"], data["joint"]) == (result.failure.s, "joint5")
    assert (data["reason"], data["advice"]) == (result.failure.reason, result.failure.advice)
    assert "coefficients" not in data


# ---------------------------------------------------------------- limits, durations, goals
def test_what_a_law_promises_and_passes_is_slowed_or_refused() -> None:
    slowed = planned(timing="toppra", samples=151)
    assert slowed.stretch_factor > 1.0
    assert slowed.certificate.is_valid
    assert max(slowed.certificate.worst(f)[0] for f in ("velocity", "acceleration")) <= 1.0
    strict = planned(timing="toppra", samples=151, strict=True)
    assert strict.status is PlanStatus.LIMITS_EXCEEDED
    assert strict.failure.joint in ROBOT.joint_names
    assert "of its limit" in strict.failure.reason
    assert planned(timing="optimal", strict=True)


def test_a_duration_is_met_exactly_or_refused_with_the_least() -> None:
    free = planned(timing="optimal")
    longer = planned(timing="optimal", duration=2.0)
    assert longer.trajectory.duration == pytest.approx(2.0, abs=1e-12)
    assert longer.certificate.is_valid
    refused = planned(timing="optimal", duration=0.9 * free.trajectory.duration)
    assert refused.status is PlanStatus.TIMING_INFEASIBLE
    least = float(refused.failure.reason.split()[-2])
    assert 0.0 <= least - free.trajectory.duration <= 1.01e-4
    assert planned(timing="optimal", duration=least), "the printed duration can be typed"


def test_a_goal_may_be_a_pose_or_joints() -> None:
    line = plan(ROBOT, default_line().goal, START, limits=LIMITS)
    assert isinstance(line.path, Line)
    np.testing.assert_allclose(line.path.goal, default_line().goal, atol=1e-12)
    joints = plan(ROBOT, START + 0.2, START, limits=LIMITS)
    assert isinstance(joints.path, JointLine)
    assert joints.certificate.is_valid
    np.testing.assert_allclose(joints.trajectory(joints.trajectory.end), START + 0.2, atol=1e-9)


def test_one_joint_alone_takes_as_long_as_the_double_s() -> None:
    """In joint space with one moving joint the optimum is known in closed form (Biagiotti and Melchiorri, §3.4)."""
    for move in (0.01, 0.1, 0.7):
        goal = START.copy()
        goal[2] -= move
        found = plan(ROBOT, goal, START, limits=LIMITS).trajectory.duration
        known = float(oracles.double_s(move, np.array(2.0), np.array(10.0), np.array(100.0)))
        assert known * (1.0 - 1e-9) <= found <= known * 1.001


def test_a_goal_needs_a_start() -> None:
    with pytest.raises(InvalidInput, match=r"^q_start: "):
        plan(ROBOT, default_line().goal)


def test_without_a_start_the_branch_is_chosen_for_the_whole_path() -> None:
    chosen = plan(ROBOT, default_line(), limits=LIMITS)
    assert chosen
    assert chosen.certificate.path_error.distance <= 1e-8


def test_a_duration_that_changes_the_tool_speed_that_was_asked_is_refused() -> None:
    law = make_law("constant_speed", speed=0.05)
    free = plan(ROBOT, default_line(), START, timing=law, limits=LIMITS)
    twice = plan(ROBOT, default_line(), START, timing=law, limits=LIMITS, duration=2.0 * free.trajectory.duration)
    assert twice.status is PlanStatus.TIMING_INFEASIBLE
    assert all(speed in twice.failure.reason for speed in ("0.025", "0.05"))
    assert "without a speed" in twice.failure.advice
    assert plan(ROBOT, default_line(), START, timing=law, limits=LIMITS, duration=free.trajectory.duration)
    any_speed = plan(ROBOT, default_line(), START, timing="constant_speed", limits=LIMITS, duration=9.0)
    assert any_speed.trajectory.duration == pytest.approx(9.0)


WRONG = {
    "duration": (0.0, -1.0, np.nan, "long", 1e10, 10**400), "strict": (1,), "tolerance": (0.0,), "rate": (0.0,),
    "branch": ("left",), "solver": (5,), "timing": (5,), "limits": (5,), "path": (5,),
}  # fmt: skip


@pytest.mark.parametrize("argument", WRONG)
def test_what_cannot_be_meant_is_refused_by_name(argument: str) -> None:
    for wrong in WRONG[argument]:
        given: dict[str, Any] = {"path": default_line(), "timing": "quintic", "samples": 31} | {argument: wrong}
        with pytest.raises(InvalidInput) as info:
            plan(ROBOT, given.pop("path"), START, **given)
        assert info.value.argument.partition(".")[0] == argument


# ---------------------------------------------------------------- replanning
@pytest.mark.parametrize("part", [0, 1, 2])
def test_a_state_off_the_path_is_refused_by_name(part: int) -> None:
    first = plan(ROBOT, default_line(), START, limits=LIMITS)
    state = [first.trajectory(0.3, order) for order in range(3)]
    state[part][3] += (1e-3, 1e-2, 10.0)[part]
    with pytest.raises(InvalidInput) as info:
        replan(first, tuple(state))
    assert info.value.argument == "state"
    assert ("position", "velocity", "acceleration")[part] in info.value.got


@pytest.mark.parametrize("wrong", [-0.1, 99.0, np.nan, "now", (1, 2), (np.zeros(6), np.zeros(5), np.zeros(6))])
def test_a_state_that_cannot_be_meant_is_refused(wrong: Any) -> None:
    first = plan(ROBOT, default_line(), START, limits=LIMITS)
    with pytest.raises(InvalidInput, match=r"^state: "):
        replan(first, wrong)


def test_a_state_at_rest_starts_again_but_does_not_stop() -> None:
    first = plan(ROBOT, default_line(), START, limits=LIMITS)
    assert replan(first, 0.0).trajectory.duration == pytest.approx(first.trajectory.duration, rel=2e-3)
    for state, stop in ((0.0, True), (first.trajectory.end, False)):
        with pytest.raises(InvalidInput, match=r"^state: "):
            replan(first, state, stop=stop)


def test_limits_of_the_tool_are_kept_from_a_moving_state() -> None:
    limits = MotionLimits(2.0, 10.0, 100.0, tool_speed=0.3)
    first = plan(ROBOT, default_line(), START, limits=limits)
    again = replan(first, 0.3 * first.trajectory.end, limits=MotionLimits(2.0, 12.0, 120.0, tool_speed=0.305))
    assert again.certificate.is_valid
    assert again.certificate.worst("tool_speed")[0] > 0.99


def test_a_plan_that_failed_cannot_be_replanned() -> None:
    with pytest.raises(InvalidInput, match=r"^plan: "):
        replan(too_far(), 0.1)


# ---------------------------------------------------------------- files
@pytest.mark.parametrize("fails", ["write_bytes", "replace"])
def test_a_file_that_cannot_be_written_leaves_what_was_there(
    fails: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "plan.json"
    target.write_text("the old plan")
    real = Path.write_bytes

    def full_disk(self: Path, data: Any) -> int:
        if fails == "write_bytes":
            real(self, data[: len(data) // 2])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, fails, full_disk)
    with pytest.raises(OutputError, match="No space left"):
        planned().save(target)
    monkeypatch.undo()
    assert target.read_text() == "the old plan"
    assert [f.name for f in tmp_path.iterdir()] == ["plan.json"], "no part of a file is left"


@pytest.mark.parametrize("name", ["a" * 245 + ".json", "a" * 300 + ".json", "a\0b.json"])
def test_a_name_that_no_file_can_have_is_an_output_error_too(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    try:
        planned().save(name)
    except OutputError:
        return
    assert (tmp_path / name).is_file(), "245 letters are a name that a file can have"


def test_robots_of_the_same_name_are_told_apart_by_what_differs():
    robot = paper6r()
    loaded = robot.with_payload(2.0)
    path = JointLine(robot, START, START + 0.1)
    assert plan(loaded, path, START), "a path in joint space is one of the kinematics"
    other = robot.with_tool(oracles.trans(z=0.1))
    with pytest.raises(InvalidInput, match="which differs in tool"):
        plan(other, path, START)
    with pytest.raises(InvalidInput, match=r"solver: .*which differs in payload"):
        plan(loaded, loaded.fk(START + 0.1), START, solver=make_solver(robot, "lm"))


def test_a_stretch_is_the_ratio_of_the_durations_and_limits_are_named_where_they_caused_it() -> None:
    usual, doubled = planned(timing="toppra", samples=151), planned(timing="toppra", samples=151, duration=10.0)
    chosen, limited = usual.duration / usual.stretch_factor, usual.limit_factor
    assert 1.0 < limited == usual.stretch_factor < 1.01
    expected = (
        (usual, limited), (doubled, 1.0), (fit_periods(usual, 0.3), limited), (add_room(usual), limited),
        (usual.stretched(2.0), 2.0 * limited), (usual.stretched(2.0, asked=True), 1.0),
    )  # fmt: skip
    for result, factor in expected:
        assert result.stretch_factor == pytest.approx(result.duration / chosen, rel=1e-12)
        assert result.limit_factor == pytest.approx(factor, rel=1e-12)
        assert ("to meet the limits" in str(result)) == (factor > 1.0)
        assert result and result.certificate.duration == result.duration
        assert result.to_dict()["slowed"] == result.stretch_factor
    assert len({result.duration for result, _ in expected}) == len(expected) - 1


def test_a_plan_with_another_motion_is_judged_anew() -> None:
    usual = planned(timing="optimal", limits=LIMITS)
    hasty = usual.with_motion(usual.trajectory.stretched(0.5))
    assert usual and not hasty and hasty.status is PlanStatus.NOT_PROVED
    assert hasty.failure is not None and "is not valid" in hasty.failure.reason and hasty.stretch_factor == 0.5
    free = planned(timing="quintic", limits=LIMITS.scale(0.1))
    assert free.status is free.stretched(1.01).status is PlanStatus.LIMITS_EXCEEDED
    assert free.stretched(100.0).status is PlanStatus.SOLVED and free.stretched(100.0).failure is None


def test_only_a_motion_between_rests_is_stretched_and_only_to_longer_ones() -> None:
    usual = planned(timing="optimal", limits=LIMITS)
    for one, factor in ((usual, 0.5), (replan(usual, 0.3 * usual.duration), 1.5)):
        with pytest.raises(InvalidInput, match="factor"):
            one.stretched(factor)
    with pytest.raises(NoSolution):
        too_far().stretched(2.0)


def test_checked_stops_follow_the_stretching_and_nothing_is_far_slower_than_no_limit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(finish, "STEPS", 20)
    monkeypatch.setattr(finish, "CHECKED_STEPS", 40)
    usual = planned(timing="optimal", limits=LIMITS)
    checked = usual.slowed_to(stopping_time=0.9 * float(usual.stopping.time.max()))
    assert checked.stop_step is not None
    assert checked.stretched(2.0).stop_step == pytest.approx(2.0 * checked.stop_step)
    assert replan(checked, 0.3 * checked.duration).stop_step is None
    endless = plan(paper6r(), START + 0.2, START, timing="quintic", limits=MotionLimits(), duration=2.0)
    assert endless.least_duration is None and "slow" not in str(endless) and "alone" not in str(endless)


def test_the_options_of_a_plan_have_the_defaults_of_its_arguments() -> None:
    arguments = inspect.signature(plan).parameters
    defaults = {one.name: one.default for one in fields(PlanOptions) if one.name != "limits"}
    known = {*defaults, "robot", "path", "q_start", "limits", "reconfigurations", "tool", "frame"}
    assert known == set(arguments) and defaults == {name: arguments[name].default for name in defaults}
