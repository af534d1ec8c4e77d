"""Laws that users write in a notebook or in a file: names by default, and errors that name what is wrong in the law."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import optik
import planners
from optik.errors import InvalidInput, NoSolution
from planners import MotionLimits, Trajectory
from planners.certificate.analysis import MotionAnalysis
from planners.following.joint_path import JointPath
from planners.motion.motion import find_stretch_factor
from planners.timing import TimeLaw
from planners.timing.quintic import Quintic
from planners.timing.toppra import Toppra
from tests.planners.cases import START, default_joint_path, paper6r

LIMITS = MotionLimits(2.0, 10.0, 100.0)


class Sluggish(TimeLaw):
    """A law that states no name, as in a notebook: the paper's, without promises."""

    enforced: Any = ()

    def _time(self, joint_path: JointPath, limits: MotionLimits) -> Trajectory:
        return Quintic(duration=2.0).run(joint_path, limits)


class Untimed(Sluggish):
    """A law that returns no trajectory."""

    def _time(self, joint_path: JointPath, limits: MotionLimits) -> Any:
        return 5

    def run_from(self, *_: object, **__: object) -> Any:
        return 5


class Running(Sluggish):
    """A law with the method that the planner does not call."""

    def run(self, joint_path: JointPath, limits: MotionLimits) -> Trajectory:  # type: ignore[misc]
        return super().run(joint_path, limits)


class Hopeful(Sluggish):
    """A law that takes no care of limits that it could do without."""

    enforced = ("velocity", "tool_speed", "rotation_speed")


def planned(law: Any) -> planners.Plan:
    return planners.plan(paper6r(), START + 0.1, START, timing=law, limits=LIMITS, samples=21)


def test_a_law_without_a_name_has_that_of_its_class() -> None:
    assert Sluggish().name == Sluggish.name == "sluggish"
    assert "name" not in vars(Sluggish)  # so that a file can still name its class
    assert (planned(Sluggish()).law, Quintic().name) == ("sluggish", "quintic")


def test_a_law_in_a_file_has_the_file_s_name(tmp_path: Path) -> None:
    file = tmp_path / "unhurried.py"
    file.write_text(f"from {__name__} import Sluggish\nclass Other(Sluggish): ...\nMETHOD = Other\n")
    assert planners.make_law(file).name == "unhurried"


@pytest.mark.parametrize("enforced", ["velocity", ("velocity", "jrek"), ["velocity"], (1,), None])
def test_promises_that_are_no_limits_are_refused_before_anything_runs(enforced: Any, tmp_path: Path) -> None:
    law = type("Wrong", (Untimed,), {"enforced": enforced})()
    file = tmp_path / f"wrong_{abs(hash(str(enforced)))}.py"
    file.write_text(f"from {__name__} import Untimed\nclass METHOD(Untimed):\n    enforced = {enforced!r}\n")
    running = planned(Sluggish())
    for use in (
        lambda: planned(law),
        lambda: planners.replan(running, state=1.0, timing=law),
        lambda: planners.make_law(file),
    ):
        with pytest.raises(
            InvalidInput, match=r"enforced of the time law 'wrong.*velocity, acceleration, jerk"
        ) as caught:
            use()
        assert repr(enforced[-1] if isinstance(enforced, tuple) else enforced) in str(caught.value)


@pytest.mark.parametrize("enforced", ["velocity", ("jrek",)])
def test_motions_are_fitted_to_limits_that_exist(enforced: Any) -> None:
    trajectory = Quintic(duration=2.0).run(default_joint_path(), LIMITS)
    for use in (
        planners.stretch_to_limits,
        lambda robot, motion, *rest: find_stretch_factor(MotionAnalysis(robot, motion), *rest),
    ):
        with pytest.raises(InvalidInput, match="enforced"):
            use(paper6r(), trajectory, LIMITS, enforced)


def test_what_a_law_returns_must_be_a_trajectory_of_the_arm() -> None:
    with pytest.raises(InvalidInput, match=r"result of the time law 'untimed'.*got 5"):
        planned(Untimed())
    running = planned(Sluggish())
    with pytest.raises(InvalidInput, match="result of the time law 'untimed'"):
        planners.replan(running, state=1.0, timing=Untimed())


def test_a_law_that_overrides_run_is_told_what_to_define() -> None:
    with pytest.raises(InvalidInput, match=r"_time\(joint_path, limits\); got running with a method run"):
        planned(Running())


def test_the_base_class_refuses_a_motion_that_no_limit_of_the_law_bounds() -> None:
    robot, turned = paper6r(), START + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.3])
    joint_path = planners.follow(
        optik.ik.make_solver(robot, "lm"), planners.Line(robot.fk(START), robot.fk(turned)), START
    )
    assert joint_path.joint_path is not None
    others = np.array([1.0, 1.0, 1.0, 1.0, 1.0, np.inf])
    snail = MotionLimits(others, 1.0, 1.0)
    with pytest.raises(NoSolution, match="no limit bounds a joint that moves; try: a finite limit on one of joint6"):
        Hopeful().run(joint_path.joint_path, snail)
    with pytest.raises(NoSolution):  # the tool's point stays where it is
        Hopeful().run(joint_path.joint_path, MotionLimits(others, tool_speed=0.1))
    for limits in (MotionLimits(others, rotation_speed=0.1), MotionLimits((-others[::-1], others[::-1]))):
        assert Hopeful().run(joint_path.joint_path, limits).duration == 2.0


def test_all_missing_limits_are_named_in_one_error() -> None:
    with pytest.raises(InvalidInput, match="velocity and acceleration"):
        planners.plan(paper6r(), START + 0.1, START, timing=Toppra(), limits=MotionLimits(jerk=100.0))


def test_the_call_in_an_error_on_missing_limits_gives_what_is_missing() -> None:
    robot, goal = optik.load("ur5e"), [0.3, -1.0, 1.0, 0.2, 0.4, 0.1]  # has limits on velocity and torque
    for limits, call in (
        (None, "MotionLimits.of(robot, jerk=...)"),  # its torque limits the acceleration
        (MotionLimits(jerk=50.0), "MotionLimits.of(robot, jerk=...)"),
        (MotionLimits.of(robot, acceleration=10.0), "MotionLimits.of(robot, acceleration=..., jerk=...)"),
    ):
        with pytest.raises(InvalidInput, match=re.escape(call)) as info:
            planners.plan(robot, goal, np.zeros(6), limits=limits)
        given = eval(call.replace("...", "50.0"), {"MotionLimits": MotionLimits, "robot": robot})
        assert planners.plan(robot, goal, np.zeros(6), limits=given)
        assert ("velocity" in info.value.got) is (limits is not None and limits.velocity is None)
