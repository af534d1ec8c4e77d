"""Invalid motions: which word permits which violation, and that files, messages and drives refuse all others."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PPoly
from typer.testing import CliRunner

from benchmarks.cli.app import app, main
from optik.errors import InvalidInput, InvalidMotion
from optik.ik import Tolerance
from planners import Line, MotionLimits, Plan, Trajectory, certify, load_motion, plan, replan, save, to_ros
from planners.cell.drives.base import fit_periods
from planners.cell.drives.ideal import IdealDrive
from planners.cell.show import restore_plan
from planners.certificate.clearance import Clearance, Closest
from planners.certificate.path_error import PathError
from planners.certificate.violation import ALLOWANCES
from planners.planning import PlanStatus
from tests.planners.cases import START, default_line, paper6r
from tests.planners.contacts import panda
from tests.planners.invalid import KINDS, Invalid, interpolated_contact, invalid, to_point
from tests.seeds import shift_seed

OWN = MotionLimits.of(paper6r())
GIVEN = MotionLimits(2.0, 10.0, 100.0)  # the same numbers, given by the caller
each_kind = pytest.mark.parametrize("kind", KINDS)
drawn = cache(invalid)


def line(**options: Any) -> Plan:
    return plan(paper6r(), default_line(), START, **options)


# ---------------------------------------------------------------- files, messages, drives
def others(one: Invalid) -> list[str]:
    return [word for word in ALLOWANCES if word != one.word]


@each_kind
@pytest.mark.parametrize("case", range(3))
def test_only_its_word_lets_an_invalid_motion_into_a_file(kind: str, case: int, tmp_path: Path) -> None:
    one = drawn(kind, case)
    assert one.found > 1.0
    for name, write in (("motion.npz", save), ("motion.json", to_ros)):
        for allow in ((), others(one)):
            with pytest.raises(InvalidMotion, match=r"allow=\(.*\), which permits it") as caught:
                write(one.plan, tmp_path / name, allow=allow)
            assert set(caught.value.allow) == {one.word, *allow}
            assert list(tmp_path.iterdir()) == []
        write(one.plan, tmp_path / name, allow=one.word)
        (tmp_path / name).rename(tmp_path / "written")
        (tmp_path / "written").unlink()


@each_kind
@pytest.mark.parametrize("case", range(3))
def test_only_its_word_lets_a_drive_execute_an_invalid_motion(kind: str, case: int) -> None:
    one = drawn(kind, case)
    for allow in ((), others(one)):
        refused = IdealDrive(panda()).execute(one.plan, allow=allow)
        assert refused.status == "refused" and refused.motion is None
        assert f"'{one.word}'" in refused.advice
    assert IdealDrive(panda()).execute(one.plan, allow=(one.word,))


def test_a_motion_that_is_permitted_to_touch_can_be_stopped_and_resumed() -> None:
    one = drawn("contact", 0)
    drive = IdealDrive(panda())
    stopped = drive.execute(one.plan, stop=0.1 * one.plan.trajectory.end, allow="contact")
    assert stopped.status == "stopped" and stopped.stop_plan is not None, (stopped.reason, stopped.notes)
    assert drive.resume(stopped).status == "refused"
    assert drive.resume(stopped, allow="contact")


def test_lines_of_a_controller_that_touch_are_not_written(tmp_path: Path) -> None:
    """The motion itself is valid: the points of 20 Hz cut a corner that passes a sphere."""
    written = refused = 0
    for case in range(6):
        made = interpolated_contact(np.random.default_rng([shift_seed(3), case]))
        if made is None or made.scene is None:
            continue
        assert made.certificate.is_valid
        save(made, tmp_path / "motion.npz")
        try:
            sent = to_ros(made, tmp_path / "lines.json", rate=20.0, interpolation="linear")
        except InvalidMotion as error:
            assert "contact" in str(error) and "contact" in error.allow
            sent = to_ros(made, tmp_path / "all.json", rate=20.0, interpolation="linear", allow=error.allow)
            refused += 1
        else:
            written += 1
        centre, radius = made.scene.spheres[0]
        t = np.linspace(0.0, sent.trajectory.end, 2001)
        free = to_point(panda(), sent.trajectory(t), np.asarray(centre)).min() > radius - 1e-9
        assert sent.certificate.clearance is not None and sent.certificate.clearance.proved == free
        assert (tmp_path / "lines.json").exists() == (written > 0)
    assert refused >= 2


def test_all_words_permit_everything_and_unknown_ones_are_named(tmp_path: Path) -> None:
    one = drawn("path", 0)
    save(one.plan, tmp_path / "motion.npz", allow=ALLOWANCES)
    for wrong in ("contacts", ("path", "jrk"), 3, (3,)):
        for use in (save, to_ros):
            with pytest.raises(InvalidInput, match="allow: expected some of: contact, path"):
                use(one.plan, tmp_path / "other.json", allow=wrong)
        with pytest.raises(InvalidInput, match="allow"):
            line(allow=wrong)
    with pytest.raises(InvalidInput, match="expected some of: limits, jerk; got 'contact'"):
        line(allow="contact")
    assert [file.name for file in tmp_path.iterdir()] == ["motion.npz"]


def test_a_motion_from_a_file_needs_the_word_again(tmp_path: Path) -> None:
    one = drawn("contact", 1)
    save(one.plan, tmp_path / "motion.npz", allow="contact")
    motion = load_motion(tmp_path / "motion.npz")
    with pytest.raises(InvalidMotion, match=r"is not valid: .*allow=\('contact',\)"):
        restore_plan(motion)
    read = restore_plan(motion, allow="contact")
    assert not read and read.status is PlanStatus.CONTACT
    assert IdealDrive(panda()).execute(read).status == "refused"
    assert IdealDrive(panda()).execute(read, allow="contact")


# ---------------------------------------------------------------- limits that were given
def test_which_limits_were_given() -> None:
    assert OWN.given_names == ()
    assert GIVEN.given_names == ("velocity", "acceleration", "jerk"), "also where the numbers are those of the robot"
    assert replace(OWN, jerk=5.0).given_names == ("jerk",)
    assert OWN.scale(0.5, ("velocity",)).given_names == ("velocity",)
    assert replace(OWN, tool_speed=0.1).select(("velocity", "tool_speed")).given_names == ("tool_speed",)
    assert GIVEN.__class__(*(np.full(6, x) for x in (2.0, 10.0, 100.0)), torque=OWN.torque) == OWN


def test_a_given_limit_that_the_law_does_not_enforce_must_be_respected(tmp_path: Path) -> None:
    usual = line(timing="toppra")
    assert usual and usual.certificate.worst("jerk")[0] == np.inf, "the limit is the robot's: it is shown"
    for limits in (GIVEN, replace(OWN, jerk=5.0)):
        made = line(timing="toppra", limits=limits)
        assert not made and not made.certificate.is_valid and made.has_motion
        assert made.status is PlanStatus.LIMITS_EXCEEDED and made.failure is not None
        assert "jerk of joint1 is unbounded" in made.failure.reason and "allow=('jerk',)" in made.failure.advice
        with pytest.raises(InvalidMotion):
            made.save(tmp_path / "motion.json")
        assert line(timing="toppra", limits=limits, allow="limits").status is PlanStatus.LIMITS_EXCEEDED
        allowed = line(timing="toppra", limits=limits, allow="jerk")
        assert allowed and "jerk" not in allowed.certificate.enforced
        allowed.save(tmp_path / "motion.json")
        assert load_motion(tmp_path / "motion.json").certify().is_valid
        made.save(tmp_path / "motion.json", allow="jerk")
        assert load_motion(tmp_path / "motion.json").certify().reasons == made.certificate.reasons


@pytest.mark.parametrize("share", [0.99, 1.01])
def test_a_law_that_enforces_nothing_is_held_to_what_was_given(share: float) -> None:
    reached = line(timing="quintic", limits=MotionLimits()).certificate
    limits = MotionLimits(velocity=share * reached.velocity.value.max())
    made = line(timing="quintic", limits=limits)
    assert bool(made) == (share > 1.0)
    assert made.certificate.enforced == ("velocity",)
    assert line(timing="quintic", limits=limits, allow=("limits",))
    assert bool(line(timing="quintic", limits=limits, allow="jerk")) == (share > 1.0)


def test_a_contact_or_a_deviation_stays_the_status_where_a_given_limit_is_exceeded_too() -> None:
    made = line(timing="toppra", limits=GIVEN, tolerance=(1e-12, 1e-12), samples=151)
    assert made.status in (PlanStatus.NOT_PROVED, PlanStatus.NO_IK, PlanStatus.BRANCH_JUMP)


def test_what_a_plan_was_given_holds_for_its_stop() -> None:
    running = line(limits=replace(OWN, tool_speed=0.3))
    assert "tool_speed" in replan(running, 0.3 * running.trajectory.end, stop=True).certificate.enforced


# ---------------------------------------------------------------- the words
@pytest.mark.parametrize(
    ("found", "bound", "word"), [(0.9, 0.99, None), (0.9, 1.01, "not_proved"), (1.01, 1.02, "path")]
)
def test_a_bound_beyond_the_tolerance_is_a_violation_only_if_a_value_is(found: float, bound: float, word: Any) -> None:
    for distance in (True, False):
        error = PathError(*((bound, 0.0, found, 0.0) if distance else (0.0, bound, 0.0, found)), 0.1, 0.2)
        words = [violation.allow for violation in error.find_violations(Tolerance(1.0, 1.0))]
        assert words == ([] if word is None else [word])
    assert [f.allow for f in PathError(*(float("nan"),) * 6).find_violations(Tolerance(1.0, 1.0))] == ["not_proved"] * 2


@pytest.mark.parametrize(
    ("found", "value", "word"), [(0.0101, 0.01001, None), (0.0101, 0.0099, "not_proved"), (0.0099, -np.inf, "contact")]
)
def test_a_distance_that_is_not_proved_is_no_contact(found: float, value: float, word: Any) -> None:
    near = Clearance(Closest(value, found, 0.5, ("hand", "box"), 0.01), None, ())
    assert [violation.allow for violation in near.find_violations()] == ([] if word is None else [word])


# ---------------------------------------------------------------- the command line
def run(*words: str) -> Any:
    return CliRunner().invoke(app, [str(word) for word in words])


def test_a_typed_limit_that_is_exceeded_ends_with_1_unless_it_is_allowed(tmp_path: Path) -> None:
    command, file = ("plan", "line", "--timing", "toppra"), str(tmp_path / "line.json")
    assert run(*command).exit_code == 0
    refused = run(*command, "--jerk", "5", "--out", file)
    assert refused.exit_code == 1 and "NOT valid" in refused.output and "--allow jerk" in refused.output
    assert run(*command, "--jerk", "5", "--allow", "limits,path", "--allow", "coverage").exit_code == 1
    assert list(tmp_path.iterdir()) == []
    allowed = run(*command, "--jerk", "5", "--allow", "jerk", "--out", file)
    assert allowed.exit_code == 0 and "certificate valid" in allowed.output
    assert load_motion(file).certify().is_valid
    unknown = run(*command, "--allow", "everything")
    assert isinstance(unknown.exception, InvalidInput) and "--allow: expected some of" in str(unknown.exception)


def test_an_invalid_file_is_executed_with_its_word_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "motion.json"
    save(drawn("contact", 1).plan, file, allow="contact")
    assert run("drive", str(file), "--allow", "contact").exit_code == 0
    monkeypatch.setattr("sys.argv", ["optik", "drive", str(file), "--allow", "path"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 1
    assert "--allow contact,path, which permits it" in " ".join(capfd.readouterr().err.split())


def test_the_refusal_says_what_by_how_much_and_where() -> None:
    with pytest.raises(InvalidMotion) as caught:
        drawn("path", 0).plan.motion.check_valid()
    assert "off its path at t = " in caught.value.reason and "the tolerance is 1e-05 m" in caught.value.reason
    assert isinstance(drawn("path", 0).plan.path, Line) and 0.0 < caught.value.s < drawn("path", 0).plan.path.end


@pytest.mark.parametrize("order", [0, 1])
def test_a_jump_is_named_with_its_size_joint_and_time(order: int) -> None:
    """Two pieces of 0.4 s and 0.6 s; joint 3 steps between them."""
    c = np.zeros((2, 2, 6))
    c[1] = START
    if order == 0:
        c[1, 1, 2] += 0.02
    else:  # it starts to move at the second piece, and is still moving at the end
        c[0, 1, 2] = 0.5
    trajectory = Trajectory(PPoly(c, [0.0, 0.4, 1.0]))
    broken = certify(paper6r(), None, trajectory, MotionLimits()).reasons
    what, size = (("position", 0.02), ("velocity", 0.5))[order]
    assert f"the {what} jumps by {size} " in broken[0]
    assert broken[0].endswith("at t = 0.4 s, joint joint3")


def test_a_range_that_is_left_is_named_with_its_time() -> None:
    c = np.zeros((3, 1, 6))
    c[2, 0] = START
    top = paper6r().limits.upper[4] + 0.03  # a parabola that has its top there, at t = 0.7 s
    rise = top - START[4]
    c[:2, 0, 4] = -rise / 0.49, 2.0 * rise / 0.7
    proof = certify(paper6r(), None, Trajectory(PPoly(c, [0.0, 1.0])), MotionLimits())
    violation = next(f for f in proof.violations if "exceeds its range" in f.words)
    assert violation.words.startswith("joint5 exceeds its range by 0.03 (rad or m) at t = 0.7")
    assert (violation.allow, violation.joint) == ("limits", "joint5") and violation.t == pytest.approx(0.7)


def test_a_plan_whose_certificate_is_of_other_limits_is_not_executed() -> None:
    made = line(duration=1.0)
    drive = IdealDrive(paper6r())
    stale = replace(made, limits=MotionLimits(velocity=1e-3))
    assert stale and fit_periods(stale, drive.period) is stale, "nothing else would certify it again"
    refused = drive.execute(stale)
    assert refused.status == "refused" and "velocity" in refused.reason and "'limits'" in refused.advice
