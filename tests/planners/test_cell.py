"""The cell: every step of a task and how it fails, frames, error split, corrections, the gripper, and a spot that moves."""

from collections.abc import Callable

import numpy as np
import pytest

import optik
import planners
from optik import se3
from optik.errors import InvalidInput
from planners.cell import Cell, CellStatus, Gripper, HeldObject, Outcome, PanTiltLaser, Plane, Spot, split_errors
from planners.cell.drives import make_drive
from tests import oracles
from tests.planners.faulty import FaultyIdeal, LostEncoder, Stall
from tests.seeds import shift_seed

ARM = optik.load("paper6r")
START = np.deg2rad([20.0, -35.0, 40.0, 25.0, 50.0, -30.0])
TOOL = ARM.fk(START)
SPOT = TOOL[:3, 3] + [-0.12, 0.0, 0.20]
"""End of the default line."""
BESIDE = se3.pose(np.eye(3), [-0.6, 0.2, 0.1])
EXACT = PanTiltLaser(BESIDE)


def ideal(robot=ARM, **options):
    return FaultyIdeal(robot, START, **options)


def cell_of(laser=EXACT, drive=None, **options) -> Cell:
    return Cell(options.pop("robot", ARM), laser, ideal() if drive is None else drive, **options)


def turned(pose, v, w):
    out = np.array(pose)
    out[:3, 3] += v
    out[:3, :3] = se3.exp_so3(w) @ pose[:3, :3]
    return out


def sides(seed: int):
    """A calibration's error of 2 mm and 2 mrad in a random direction."""
    rng = np.random.default_rng(seed)
    v, w = rng.normal(size=(2, 3))
    return 2e-3 * v / np.linalg.norm(v), 2e-3 * w / np.linalg.norm(w)


# ---------------------------------------------------------------- the way of a task
def test_a_task_goes_through_the_steps_of_the_paper_and_arrives() -> None:
    cell = cell_of(drive=ideal(encoder=np.inf))
    outcome = cell.move_to_spot(cell.read(SPOT))
    assert outcome and outcome.status is CellStatus.ARRIVED and outcome.failed is None
    names = ["laser", "target", "line", "joints", "timing", "certificate", "execution", "tool"]
    assert [step.name for step in outcome.steps] == names
    assert all(step.ok and step.result is not None and step.seconds >= 0.0 for step in outcome.steps)
    end = oracles.fk(oracles.PAPER, outcome.executions[-1].q[-1])
    assert np.abs(end[:3, 3] - SPOT).max() < 1e-9  # by the table's own kinematics
    assert np.abs(end[:3, :3] - TOOL[:3, :3]).max() < 1e-9  # the orientation is kept
    assert np.abs(outcome.error.total - (end[:3, 3] - SPOT)).max() < 1e-12
    assert str(outcome).startswith("arrived") and outcome.to_dict()["status"] == "arrived"


def test_an_orientation_that_was_asked_is_reached() -> None:
    R = se3.exp_so3([0.0, 0.2, 0.0]) @ TOOL[:3, :3]
    cell = cell_of()
    outcome = cell.move_to_spot(cell.read(SPOT), R)
    assert outcome
    assert np.abs(oracles.fk(oracles.PAPER, outcome.executions[-1].q[-1])[:3, :3] - R).max() < 1e-8


def test_a_way_shorter_than_a_servo_period_takes_a_whole_one() -> None:
    near = TOOL[:3, 3] + np.array([0.0, 2e-8, 0.0])  # the limits allow it in 2 ms
    outcome = cell_of(drive=ideal(encoder=np.inf)).move_to_spot(EXACT.reading(near))
    assert outcome and outcome.executions[0].motion.end == pytest.approx(0.004, abs=1e-12)
    assert np.abs(outcome.tool - near).max() < 1e-12
    there = cell_of(drive=ideal(encoder=np.inf)).move_to_spot(EXACT.reading(TOOL[:3, 3]))
    assert there and not there.executions and there.steps[-1].name == "line" and there.steps[-1].ok


def test_a_tool_speed_that_was_asked_is_kept_and_corrections_need_not_come_to_it() -> None:
    v, w = sides(1)
    law = planners.make_law("constant_speed", speed=0.2)
    cell = cell_of(unit=EXACT.with_pose(turned(BESIDE, v, w)))
    outcome = cell.move_to_spot(cell.read(SPOT), timing=law, corrections=1)
    assert outcome and outcome.rounds[0].plan.speed == 0.2 and outcome.rounds[1].plan.speed is None
    fast = planners.MotionLimits(velocity=100.0, acceleration=1e6, jerk=1e10)
    spot = EXACT.reading(TOOL[:3, 3] + np.array([0.0, 1e-4, 0.0]))
    short = cell_of(limits=fast).move_to_spot(spot, timing=law)  # the servo's period would change the speed
    assert short.status is CellStatus.REFUSED and short.failed.name == "execution" and "period" in short.reason


def test_a_spot_on_the_graph_paper_needs_no_range() -> None:
    plane = Plane(SPOT, [0.3, 1.0, -0.2])
    pan, tilt, _ = EXACT.reading(SPOT)
    outcome = cell_of(drive=ideal(encoder=np.inf)).move_to_spot(Spot(pan, tilt, np.nan), plane=plane, true_spot=SPOT)
    assert outcome and np.abs(outcome.spot - SPOT).max() < 1e-12 and np.abs(outcome.error.total).max() < 1e-9


HALF = TOOL[:3, :3] @ np.diag([1.0, -1.0, -1.0])
BOX = optik.Scene(boxes=[(se3.pose(np.eye(3), TOOL[:3, 3] + [-0.06, 0.0, 0.1]), (0.05, 0.05, 0.05))])
FAILURES: dict[str, tuple[str, CellStatus, str, Callable[[], Outcome]]] = {
    "nan": ("laser", CellStatus.NO_SPOT, "pan = nan", lambda: cell_of().move_to_spot(Spot(np.nan, 0.0, 1.0))),
    "negative": ("laser", CellStatus.NO_SPOT, "-1", lambda: cell_of().move_to_spot(Spot(0.0, 0.0, -1.0))),
    "behind": (
        "laser", CellStatus.NO_SPOT, "behind",
        lambda: cell_of(PanTiltLaser(BESIDE, pan_limits=(-1.0, 1.0))).move_to_spot(Spot(3.0, 0.0, 1.0)),
    ),
    "angles": (
        "laser", CellStatus.NO_SPOT, "outside_angles",
        lambda: cell_of(PanTiltLaser(BESIDE, tilt_limits=(-0.1, 0.1))).move_to_spot(EXACT.reading(SPOT)),
    ),
    "range": (
        "laser", CellStatus.NO_SPOT, "out_of_range",
        lambda: cell_of(PanTiltLaser(BESIDE, range_limits=(0.0, 0.5))).move_to_spot(EXACT.reading(SPOT)),
    ),
    "parallel": (
        "laser", CellStatus.NO_SPOT, "parallel",
        lambda: cell_of().move_to_spot(Spot(0.0, 0.0, 1.0), plane=Plane(SPOT, [0.0, 1.0, 0.0])),
    ),
    "reach": ("target", CellStatus.NO_PLAN, "out of reach", lambda: cell_of().move_to_spot(Spot(0.0, 0.0, 5.0))),
    "encoder": (
        "target", CellStatus.FAULT, "encoder of joint3",
        lambda: cell_of(drive=ideal(faults=(LostEncoder(2, 0.0),))).move_to_spot(EXACT.reading(SPOT)),
    ),
    "half turn": (
        "line", CellStatus.NO_PLAN, "180",
        lambda: cell_of(drive=ideal(encoder=np.inf)).move_to_spot(EXACT.reading(SPOT), HALF),
    ),
    "joints": (
        "joints", CellStatus.NO_PLAN, "outside_limits",
        lambda: cell_of().move_to_spot(EXACT.reading(TOOL[:3, 3] + [0.42, 0.0, 0.0])),
    ),
    "law": (
        "timing", CellStatus.NO_PLAN, "too fast",
        lambda: cell_of().move_to_spot(EXACT.reading(SPOT), timing=planners.make_law("constant_speed", speed=5.0)),
    ),
    "stall": (
        "execution", CellStatus.FAULT, "joint1",
        lambda: cell_of(drive=ideal(faults=(Stall(0, 0.1),))).move_to_spot(EXACT.reading(SPOT)),
    ),
    "stop": ("execution", CellStatus.STOPPED, "", lambda: cell_of().move_to_spot(EXACT.reading(SPOT), stop=0.05)),
    "unseen tool": (
        "tool", CellStatus.NOT_MEASURED, "out_of_range",
        lambda: cell_of(unit=PanTiltLaser(BESIDE, range_limits=(0.0, 0.3))).move_to_spot(EXACT.reading(SPOT), corrections=1),
    ),
    "endless": (
        "replan", CellStatus.SPOT_MOVES, "2 times",
        lambda: cell_of().move_to_spot(
            EXACT.reading(SPOT), follow=lambda t: EXACT.reading(SPOT - [0.5 * t, 0.0, 0.0]), most_replans=1
        ),
    ),
    "lost on the way": (
        "laser", CellStatus.NO_SPOT, "tilt = nan",
        lambda: cell_of().move_to_spot(
            EXACT.reading(SPOT), follow=lambda t: EXACT.reading(SPOT) if t < 0.05 else Spot(0.0, np.nan, 0.0)
        ),
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", FAILURES)
def test_a_step_that_fails_ends_the_task_with_its_name_and_reason_and_the_arm_at_rest(case: str) -> None:
    name, status, words, task = FAILURES[case]
    outcome = task()
    assert not outcome and outcome.status is status
    assert outcome.failed.name == name and outcome.steps[-1] is outcome.failed
    assert words in outcome.reason
    assert (outcome.reason and outcome.advice) or status is CellStatus.STOPPED
    assert all(step.ok for step in outcome.steps[:-1])
    for execution in outcome.executions:
        assert np.abs(execution.dq[-1]).max() < 1e-9
    sent = {"execution", "tool", "replan"}
    assert bool(outcome.executions) == (name in sent or case == "lost on the way")
    assert f"{status} at step {name}" in str(outcome) and outcome.to_dict()["failed"] == name


def test_a_motion_whose_certificate_does_not_hold_is_not_executed(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tenth of a nanometre, which the law's cubics in time do not keep."""
    from planners.cell import _task

    monkeypatch.setattr(_task, "plan", lambda *a, **k: planners.plan(*a, **k, tolerance=(1e-10, 1e-10)))
    outcome = cell_of().move_to_spot(EXACT.reading(SPOT), timing="ruckig")
    assert outcome.status is CellStatus.NO_PLAN and outcome.failed.name == "certificate" and not outcome.executions
    assert "not_proved" in outcome.reason and [s.name for s in outcome.steps[-3:-1]] == ["joints", "timing"]


@pytest.mark.soak
def test_what_is_in_the_way_is_named() -> None:
    outcome = cell_of(scene=BOX).move_to_spot(EXACT.reading(SPOT))
    assert outcome.failed.name == "joints" and "box1" in outcome.reason and not outcome.executions


def test_after_a_stop_the_same_task_is_the_rest_of_the_same_line() -> None:
    line = planners.Line(TOOL, se3.pose(TOOL[:3, :3], SPOT))
    for on in (lambda cell, spot, first: cell.move_to_spot(spot), lambda cell, spot, first: cell.resume(first)):
        cell = cell_of(drive=ideal())
        spot = cell.read(SPOT)
        first = cell.move_to_spot(spot, stop=0.05)
        assert first.status is CellStatus.STOPPED and np.linalg.norm(first.tool - SPOT) > 0.01
        again = on(cell, spot, first)
        assert again and np.linalg.norm(again.tool - SPOT) < 3e-6 and np.linalg.norm(again.error.total) < 3e-6
        tools = ARM.fk(again.executions[0].q)
        assert np.abs(line.pose(line.nearest(tools))[:, :3, 3] - tools[:, :3, 3]).max() < 1e-5


def test_after_a_fault_the_task_goes_on_along_its_path() -> None:
    cell = cell_of(drive=ideal(faults=(Stall(0, 0.1, until=0.5),)))
    first = cell.move_to_spot(cell.read(SPOT))
    assert first.status is CellStatus.FAULT and np.linalg.norm(first.tool - SPOT) > 0.01
    again = cell.resume(first)
    assert again and [step.name for step in again.steps] == ["execution", "tool"]
    assert np.linalg.norm(again.tool - SPOT) < 3e-6
    split = again.error
    assert np.abs(split.laser + split.ik + split.path + split.servo - split.total).max() < 1e-12
    for wrong in (again, cell.close(), None):
        with pytest.raises(InvalidInput, match="outcome"):
            cell.resume(wrong)


def test_misuse_is_refused_by_name() -> None:
    spot = EXACT.reading(SPOT)
    with pytest.raises(InvalidInput, match="spot"):
        cell_of().move_to_spot((0.0, 0.0, 1.0))
    with pytest.raises(InvalidInput, match="corrections"):
        cell_of().move_to_spot(spot, corrections=-1)
    with pytest.raises(InvalidInput, match="orientation"):
        cell_of().move_to_spot(spot, np.ones((3, 3)))
    with pytest.raises(InvalidInput, match="moved"):
        cell_of().move_to_spot(spot, follow=lambda t: spot, moved=np.nan)
    with pytest.raises(InvalidInput, match="follow"):
        cell_of().move_to_spot(spot, follow=3)
    with pytest.raises(InvalidInput, match="readings: expected 1: look itself may return several readings; got 3"):
        cell_of().move_to_spot(spot, corrections=1, readings=3, look=lambda: EXACT.reading(SPOT))
    with pytest.raises(InvalidInput, match="drive"):
        Cell(optik.load("ur5e"), EXACT, ideal())
    with pytest.raises(InvalidInput, match="laser"):
        Cell(ARM, BESIDE, ideal())
    with pytest.raises(InvalidInput, match="base"):
        cell_of(base=np.ones((4, 4)))


# ---------------------------------------------------------------- frames
def test_a_platform_that_stands_elsewhere_changes_nothing_in_the_base_frame() -> None:
    T = se3.pose(se3.exp_so3([0.0, 0.0, 0.7]), [3.0, -2.0, 0.4])
    here, there = cell_of(), cell_of(base=T)
    world = T[:3, :3] @ SPOT + T[:3, 3]
    assert np.abs(there.from_world(world) - SPOT).max() < 1e-14
    one, other = (cell.move_to_spot(cell.read(SPOT)) for cell in (here, there))
    assert np.array_equal(one.executions[-1].q, other.executions[-1].q)
    assert np.array_equal(one.error.total, other.error.total)
    assert np.abs(other.in_world(other.tool) - world).max() < 1e-5  # what the encoders resolve
    assert np.array_equal(here.with_base(T).base, T) and np.array_equal(here.base, np.eye(4))


# ---------------------------------------------------------------- where the error comes from
def test_the_split_adds_up_exactly_and_has_its_definition() -> None:
    rng = np.random.default_rng(3)
    points = rng.normal(size=(5, 200, 3))
    split = split_errors(*points)
    spot, target, answer, planned, executed = points
    assert np.abs(split.laser + split.ik + split.path + split.servo - split.total).max() <= 1e-14
    assert np.array_equal(split.total, executed - spot) and np.array_equal(split.laser, target - spot)
    assert np.array_equal(split.ik, answer - target) and np.array_equal(split.servo, executed - planned)
    assert np.array_equal(split.at(7).path, (planned - answer)[7])
    q = [START, START + 1e-3, START - 1e-3]
    by_q = planners.cell.split_configurations(ARM, SPOT, SPOT + 1e-3, *q)
    a, b, c = (oracles.fk(oracles.PAPER, each)[:3, 3] for each in q)
    assert np.abs(by_q.ik - (a - SPOT - 1e-3)).max() < 1e-12 and np.abs(by_q.path - (b - a)).max() < 1e-12
    assert np.abs(by_q.servo - (c - b)).max() < 1e-12
    with pytest.raises(InvalidInput, match="answer"):
        split_errors(SPOT, SPOT, [np.nan, 0.0, 0.0], SPOT, SPOT)
    with pytest.raises(InvalidInput, match="broadcast"):
        split_errors(points[0], points[1][:7], SPOT, SPOT, SPOT)


def test_the_split_along_the_path_names_each_part() -> None:
    """A wrong laser pose shows in proportion to the way, a crude IK method as its error, a perfect servo as nothing."""
    v, w = sides(1)
    cell = cell_of(unit=EXACT.with_pose(turned(BESIDE, v, w)), drive=ideal(encoder=np.inf))
    solver = optik.ik.make_solver(ARM, "dls", tolerance=optik.ik.Tolerance(1e-4, 1e-4))
    outcome = cell.move_to_spot(cell.read(SPOT), solver=solver)
    along = outcome.path_split
    assert outcome and along.t.size > 100
    whole = sum(along.error[:4])
    assert np.abs(whole - along.error.total).max() <= 1e-12
    share = along.s / along.s[-1]
    assert np.abs(along.error.laser - share[:, None] * outcome.error.laser).max() < 1e-12
    assert np.linalg.norm(outcome.error.laser) > 5e-4
    assert 1e-9 < np.linalg.norm(along.error.ik, axis=1).max() < 1e-4
    assert np.abs(along.error.ik + along.error.path).max() < 1e-8  # the plan polishes what the method left
    assert np.abs(outcome.error.servo).max() < 1e-12
    q = outcome.executions[0].q[-1]
    assert np.abs(outcome.error.total - (oracles.fk(oracles.PAPER, q)[:3, 3] - SPOT)).max() < 1e-12


# ---------------------------------------------------------------- corrections
def test_corrections_remove_a_wrong_laser_pose_round_by_round() -> None:
    """Without noise the rest shrinks by the calibration's turn each time, 2 mrad, until rounding."""
    v, w = sides(2)
    cell = cell_of(unit=EXACT.with_pose(turned(BESIDE, v, w)))
    outcome = cell.move_to_spot(cell.read(SPOT), corrections=2)
    off = [float(np.linalg.norm(each.error)) for each in outcome.rounds]
    assert outcome and len(off) == 3
    assert 1e-3 < off[0] < 2e-3 + 2e-3 * 0.8  # by the lever of the beam, at most
    assert off[1] < 3e-3 * off[0] + 2e-6 and off[2] < 3e-6  # the encoders' resolution
    assert outcome.floor == 0.0


def test_corrections_on_the_graph_paper_measure_the_tool_as_they_measure_the_spot() -> None:
    """By range the tool would be measured with another error than the spot on the plane, and the rest would stay."""
    v, w = sides(4)
    cell = cell_of(unit=EXACT.with_pose(turned(BESIDE, v, w)))
    outcome = cell.move_to_spot(cell.read(SPOT), plane=Plane(SPOT, [-1.0, 0.0, -0.3]), corrections=3)
    off = [float(np.linalg.norm(each.error)) for each in outcome.rounds]
    assert outcome and off[0] > 5e-4 and off[-1] < 3e-6


def test_corrections_fall_to_the_noise_of_the_readings() -> None:
    """Squared errors in units of what the noise of the last readings leaves: χ² with three degrees of freedom each."""
    noisy = PanTiltLaser(BESIDE, angle_noise=2e-4, range_noise=5e-4)
    scaled = []
    for seed in range(1000 * shift_seed(0), 1000 * shift_seed(0) + 6):
        v, w = sides(seed)
        cell = cell_of(noisy, unit=noisy.with_pose(turned(BESIDE, v, w)), seed=seed, drive=ideal())
        outcome = cell.move_to_spot(cell.read(SPOT, 3), corrections=1, readings=4)
        exact = noisy.reading(SPOT)
        S = noisy.covariance(*exact) * (1.0 / 3.0 + 1.0 / 4.0)
        assert outcome and abs(outcome.floor**2 - np.trace(S)) < 0.02 * np.trace(S)
        e = outcome.rounds[-1].error
        scaled.append(float(e @ np.linalg.solve(S, e)))
    assert 4.9 < sum(scaled) < 42.3  # 0.1 % to 99.9 % of χ²(18)


@pytest.mark.soak
@pytest.mark.parametrize("drive", ["ideal", "mujoco"])
@pytest.mark.parametrize(("noise", "readings"), [(0.0, 1), (1.0, 1), (1.0, 10)])
def test_corrections_round_by_round_at_length(drive: str, noise: float, readings: int) -> None:
    """Prints the row of the table in docs/cell.md: RMS over 30 seeds [mm]."""
    laser = PanTiltLaser(BESIDE, angle_noise=2e-4 * noise, range_noise=5e-4 * noise)
    errors, floors = [], []
    for seed in range(30):
        unit = laser.with_pose(turned(BESIDE, *sides(seed)))
        cell = cell_of(laser, make_drive(drive, ARM, q=START), unit=unit, seed=seed)
        outcome = cell.move_to_spot(cell.read(SPOT, readings), corrections=2, readings=readings)
        assert outcome, outcome.reason
        errors.append([np.linalg.norm(r.error) for r in outcome.rounds])
        floors.append(outcome.floor)
    first, once, twice = 1e3 * np.sqrt(np.mean(np.square(errors), axis=0))
    floor = 1e3 * float(np.mean(floors))
    print(f"{drive}, noise {noise:g}, {readings} readings: {first:.2f} {once:.4f} {twice:.5f}, floor {floor:.2f}")
    assert first > 2.0 > 2.0 * once and twice < max(1.2 * floor, 2e-3)


@pytest.mark.parametrize("stated", [False, True])
def test_a_correction_that_noise_and_calibration_do_not_explain_is_not_made(stated: bool) -> None:
    noisy = PanTiltLaser(BESIDE, angle_noise=2e-4, range_noise=5e-4)
    laser = noisy.with_pose(BESIDE, np.diag([1e-6] * 3 + [1e-6] * 3)) if stated else noisy
    by_reading, by_pose = laser.jacobians(*laser.reading(SPOT))
    S = (by_reading * [2e-4, 2e-4, 5e-4]) @ (by_reading * [2e-4, 2e-4, 5e-4]).T
    S = S + by_pose @ np.diag([1e-6] * 6) @ by_pose.T if stated else S
    most = 6.0 * np.sqrt(np.trace(S)) + (0.005 if stated else 0.05)
    for far, made in ((0.95 * most, True), (1.05 * most, False), (0.3, False)):
        cell = cell_of(laser)
        wrong = laser.reading(SPOT + np.array([0.0, far, 0.0]))
        outcome = cell.move_to_spot(EXACT.reading(SPOT), corrections=1, look=lambda wrong=wrong: wrong)
        assert outcome.status is CellStatus.NOT_MEASURED and outcome.failed.name == "tool"
        assert (
            len(outcome.executions) == 1 + made
        )  # after a correction that was made, the same reading is twice as far off
        assert made or np.linalg.norm(ARM.fk(outcome.executions[0].q[-1])[:3, 3] - SPOT) < 1e-5
        assert "explain" in outcome.reason and ("covariance" in outcome.failed.advice) != stated


def test_corrections_remove_what_an_unknown_load_leaves() -> None:
    """A kilogram that the servos' feed-forward does not know: it hangs lower by a millimetre."""
    pytest.importorskip("mujoco")
    drive = make_drive("mujoco", ARM, q=START, plant=ARM.with_payload(1.0))
    cell = cell_of(drive=drive)
    outcome = cell.move_to_spot(cell.read(SPOT), corrections=2)
    off = [float(np.linalg.norm(each.error)) for each in outcome.rounds]
    assert outcome and off[0] > 3e-4 and off[1] < 0.5 * off[0] and off[2] < 0.3 * off[0]
    assert (
        np.linalg.norm(outcome.error.servo) > 3e-4 and np.linalg.norm(outcome.error.laser) > 3e-4
    )  # one undoes the other


# ---------------------------------------------------------------- the gripper
FINGERS = Gripper(se3.pose(se3.exp_so3([0.1, 0.2, 0.3]), [0.01, 0.02, 0.12]), 0.08, mass=1.1, com=[0.0, 0.01, 0.05])


def test_a_gripper_and_what_it_holds_count_in_all_torques() -> None:
    """Torques are linear in masses, so those of gripper and object add to those of the arm, each as a payload of its own."""
    held = HeldObject(2.3, com=[0.01, 0.0, 0.03], inertia=np.diag([0.01, 0.012, 0.014]))
    full = FINGERS.mount(ARM, held)
    grasp = np.asarray(FINGERS.grasp)
    R, p = grasp[:3, :3], grasp[:3, 3]
    rng = np.random.default_rng(5)
    q, dq, ddq = rng.uniform(-1.0, 1.0, (3, 20, 6))
    gripper = ARM.with_payload(1.1, [0.0, 0.01, 0.05])
    carried = ARM.with_payload(2.3, R @ [0.01, 0.0, 0.03] + p, R @ np.diag([0.01, 0.012, 0.014]) @ R.T)
    expected = gripper.torques(q, dq, ddq) + carried.torques(q, dq, ddq) - ARM.torques(q, dq, ddq)
    assert np.abs(full.torques(q, dq, ddq) - expected).max() < 1e-10
    assert np.abs(full.fk(q) - ARM.fk(q) @ grasp).max() < 1e-14
    loaded = ARM.with_payload(0.7, [0.02, 0.0, 0.0])
    expected = gripper.torques(q, dq, ddq) + loaded.torques(q, dq, ddq) - ARM.torques(q, dq, ddq)
    assert np.abs(FINGERS.mount(loaded).torques(q, dq, ddq) - expected).max() < 1e-10
    with pytest.raises(InvalidInput, match="one mass"):
        FINGERS.mount(ARM.with_payload((0.0, 1.0)))


def test_closing_on_an_object_changes_the_arm_of_plans_and_drive() -> None:
    drive = ideal()
    cell = cell_of(drive=drive, gripper=FINGERS)
    empty = cell.robot
    assert drive.robot == empty != ARM and cell.width == 0.08
    assert cell.move_to_spot(cell.read(SPOT))
    closed = cell.close(0.05, HeldObject(2.0, shapes=[((0.0, 0.0, 0.0), 0.03)]))
    assert closed and closed.steps[0].name == "close" and cell.width == 0.05
    assert drive.robot == cell.robot != empty
    assert abs(cell.robot.payload.masses[0] - 3.1) < 1e-12 and "held" in cell.robot.shapes.names
    outcome = cell.move_to_spot(cell.read(TOOL[:3, 3] + [0.0, -0.05, 0.05]))
    assert outcome and outcome.rounds[0].plan.robot == cell.robot
    opened = cell.open()
    assert opened and opened.steps[0].name == "open" and cell.robot == empty == drive.robot and cell.held is None


def test_a_gripper_refuses_what_it_cannot_do_and_nothing_changes() -> None:
    cell = cell_of(gripper=FINGERS)
    for outcome in (
        cell.close(0.1),
        cell.close(-0.01),
        cell.close(np.nan),
        cell.open(0.2),
        cell.close(0.01, HeldObject),
    ):
        assert not outcome and outcome.status is CellStatus.REFUSED and outcome.reason and outcome.advice
        assert cell.width == 0.08 and cell.held is None
    limit, still = np.asarray(ARM.limits.torque), np.zeros(6)
    none, more = (FINGERS.mount(ARM, HeldObject(m)).torques(START, still, still) for m in (0.0, 1.0))
    slope = np.where(np.abs(more - none) > 1e-9, more - none, np.nan)  # torques are linear in the mass
    crossing = np.nanmin((limit - np.sign(slope) * none) / np.abs(slope))
    heavy, light = cell.close(0.05, HeldObject(1.01 * crossing)), cell_of(gripper=FINGERS, drive=ideal(encoder=np.inf))
    assert heavy.status is CellStatus.REFUSED and "times the torque" in heavy.reason and cell.held is None
    assert light.close(0.05, HeldObject(0.99 * crossing))
    bare = cell_of().close()
    assert bare.status is CellStatus.REFUSED and bare.failed.name == "close" and "gripper" in bare.advice
    with pytest.raises(InvalidInput, match="opening"):
        Gripper(np.eye(4), -1.0)
    with pytest.raises(InvalidInput, match="mass"):
        HeldObject(np.nan)


# ---------------------------------------------------------------- a spot that moves
def test_a_spot_that_moves_is_followed() -> None:
    new = SPOT + np.array([0.05, -0.02, 0.01])
    cell = cell_of(drive=ideal(encoder=np.inf))
    outcome = cell.move_to_spot(EXACT.reading(SPOT), follow=lambda t: EXACT.reading(SPOT if t < 0.1 else new))
    assert outcome and [s.name for s in outcome.steps if s.name in ("stop", "replan")] == ["stop", "replan"]
    stopped = next(step.result for step in outcome.steps if step.name == "stop")
    assert np.abs(stopped.dq[-1]).max() < 1e-9
    assert planners.Line(TOOL, se3.pose(TOOL[:3, :3], SPOT)).nearest(ARM.fk(stopped.q[-1:])) < 0.99 * 0.2333
    path = stopped.plan.path
    tools = ARM.fk(stopped.q)
    assert np.abs(path.pose(path.nearest(tools))[:, :3, 3] - tools[:, :3, 3]).max() < 1e-5  # the stop is on the line
    assert np.abs(oracles.fk(oracles.PAPER, outcome.executions[-1].q[-1])[:3, 3] - new).max() < 1e-9
    assert np.abs(outcome.true_spot - new).max() < 1e-12


def test_a_spot_that_trembles_within_the_threshold_is_no_reason_to_stop() -> None:
    cell = cell_of()
    outcome = cell.move_to_spot(
        EXACT.reading(SPOT), follow=lambda t: EXACT.reading(SPOT + 0.003 * np.sin(50.0 * t) * np.eye(3)[0])
    )
    assert outcome and len(outcome.executions) == 1


def test_what_moves_less_than_the_threshold_is_still_corrected_at_the_end() -> None:
    late = SPOT + np.array([0.003, 0.0, -0.002])
    cell = cell_of(drive=ideal(encoder=np.inf))
    outcome = cell.move_to_spot(
        EXACT.reading(SPOT), follow=lambda t: EXACT.reading(SPOT if t < 0.3 else late), corrections=1
    )
    assert outcome and [step.name for step in outcome.steps].count("replan") == 0
    first, second = (float(np.linalg.norm(each.error)) for each in outcome.rounds)
    assert abs(first - np.linalg.norm(late - SPOT)) < 1e-9 and second < 1e-9


def test_a_follower_that_raises_is_heard_only_when_the_arm_is_at_rest() -> None:
    drive, told = ideal(), []

    def follow(t: float) -> Spot:
        if t > 0.05:
            raise RuntimeError("camera unplugged")
        return EXACT.reading(SPOT)

    with pytest.raises(RuntimeError, match="camera"):
        cell_of(drive=drive).move_to_spot(EXACT.reading(SPOT), follow=follow, watch=told.append)
    assert np.abs(told[-1].setpoint - told[-2].setpoint).max() < 1e-6  # it came to rest before
    assert drive.clock > 0.1


def test_a_reading_from_elsewhere_is_said_to_be_taken_as_exact() -> None:
    cell = cell_of()
    assert not cell.move_to_spot(cell.read(SPOT)).notes
    assert "taken as exact" in cell.move_to_spot(EXACT.reading(SPOT + 0.01)).notes[0]
    assert not cell.move_to_spot(EXACT.reading(SPOT), true_spot=SPOT).notes
