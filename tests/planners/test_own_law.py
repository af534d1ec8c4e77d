"""Laws that users write in a notebook or in a file: names by default, and errors that name what is wrong in the law."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import optik
import planners
from optik.errors import InvalidInput
from planners import MotionLimits, TimeLaw, Trajectory
from planners.certificate.analysis import MotionAnalysis
from planners.following.joint_path import JointPath
from planners.motion.fit import fit_to_limits, stretch_factor
from planners.timing.quintic import Quintic
from planners.timing.toppra import Toppra
from tests.planners.cases import START, default_joint_path, paper6r

LIMITS = MotionLimits(2.0, 10.0, 100.0)


class Sluggish(TimeLaw):
    """A law that states no name, as in a notebook: the paper's, without promises."""

    enforced: Any = ()

    def run(self, joint_path: JointPath, limits: MotionLimits) -> Trajectory:
        return Quintic(duration=2.0).run(joint_path, limits)


class Untimed(Sluggish):
    """A law that returns no trajectory."""

    def run(self, joint_path: JointPath, limits: MotionLimits) -> Any:
        return 5

    def run_from(self, *_: object, **__: object) -> Any:
        return 5


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
    for use in (fit_to_limits, lambda robot, motion, *rest: stretch_factor(MotionAnalysis(robot, motion), *rest)):
        with pytest.raises(InvalidInput, match="enforced"):
            use(paper6r(), trajectory, LIMITS, enforced)


def test_what_a_law_returns_must_be_a_trajectory_of_the_arm() -> None:
    with pytest.raises(InvalidInput, match=r"result of the time law 'untimed'.*got 5"):
        planned(Untimed())
    running = planned(Sluggish())
    with pytest.raises(InvalidInput, match="result of the time law 'untimed'"):
        planners.replan(running, state=1.0, timing=Untimed())


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
