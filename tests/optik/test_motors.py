"""Motors that move several axes: conversions, implied limits, files of robots, refusals."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import numpy as np
import pytest

import optik
from optik.arm.mjcf_writer import to_mjcf
from optik.errors import InvalidInput, RobotModelError
from optik.types import Array

NAMES = ("M1", "M2", "M3", "M4", "M5", "M6")


def coupled_23() -> Array:
    """Motor 3 turns joint 3 against the ground: m3 = q3 + q2."""
    C = np.eye(6)
    C[2, 1] = -1.0
    return C


def wrist() -> Array:
    """A differential: m5, m6 = q5 ± q6."""
    C = np.eye(6)
    C[4:, 4:] = [[0.5, 0.5], [0.5, -0.5]]
    return C


def anyhow(seed: int = 3) -> Array:
    return np.eye(6) + 0.2 * np.random.default_rng(seed).normal(size=(6, 6))


MATRICES = {"joints 2 and 3": coupled_23(), "differential wrist": wrist(), "random": anyhow()}


def arm() -> optik.Robot:
    return optik.load("ur5e").with_limits(acceleration=10.0, jerk=100.0, torque_rate=2000.0)


@pytest.mark.parametrize("C", MATRICES.values(), ids=MATRICES)
def test_motors_and_axes_are_converted_both_ways(C: Array) -> None:
    rng, offset = np.random.default_rng(1), np.linspace(-0.3, 0.4, 6)
    motors = arm().with_motors(C, offset=offset, names=NAMES).motors
    m = rng.normal(size=(50, 6))
    np.testing.assert_allclose(motors.axes(m), np.array([C @ x + offset for x in m]), atol=1e-14)
    np.testing.assert_allclose(motors.of(motors.axes(m)), m, atol=1e-13)
    np.testing.assert_allclose(motors.of(motors.axes(m, 1), 1), m, atol=1e-13)


@pytest.mark.parametrize("C", MATRICES.values(), ids=MATRICES)
def test_limits_of_axes_are_those_that_the_motors_reach(C: Array) -> None:
    robot, rng = arm().with_motors(C, offset=np.full(6, 0.1), names=NAMES), np.random.default_rng(2)
    motors, limits = robot.motors, robot.limits
    signs = rng.integers(0, 2, (4000, 6))
    corners = np.where(signs, motors.limits.upper, motors.limits.lower) @ C.T + 0.1
    np.testing.assert_allclose(limits.lower, corners.min(axis=0), rtol=1e-12)
    np.testing.assert_allclose(limits.upper, corners.max(axis=0), rtol=1e-12)
    drawn = limits.lower + (limits.upper - limits.lower) * rng.uniform(size=(4000, 6))
    m = (drawn - 0.1) @ np.linalg.inv(C).T
    inside = ((m >= motors.limits.lower) & (m <= motors.limits.upper)).all(axis=1)
    assert (limits.contains(drawn) == inside).all() and inside.any() and not inside.all()
    assert limits.contains(limits.sample(rng, 1000)).all() and limits.contains(limits.middle)
    clipped = limits.clip(drawn)
    assert limits.contains(clipped).all() and (clipped[inside] == drawn[inside]).all()
    assert limits.contains(limits.clip(limits.middle + 100.0 * rng.normal(size=(200, 6)))).all()
    for name in ("velocity", "acceleration", "jerk"):
        most = getattr(motors.limits, name)
        reached = np.abs((rng.integers(0, 2, (4000, 6)) * 2.0 - 1.0) * most @ C.T).max(axis=0)
        np.testing.assert_allclose(getattr(limits, name), reached, rtol=1e-12)


def test_rotors_and_friction_become_those_of_the_motors() -> None:
    plain = optik.load("puma560")
    robot = plain.with_motors(coupled_23())
    assert (robot.motors.inertia == plain.inertia.motor).all() and plain.inertia.motor.any()
    assert not robot.inertia.motor.any() and not robot.inertia.viscous.any() and not robot.inertia.coulomb.any()


def test_json_pickle_equality_and_hash() -> None:
    robot = arm().with_motors(wrist(), offset=np.full(6, 0.1), names=NAMES)
    again = optik.Robot.from_dict(json.loads(json.dumps(robot.to_dict())))
    copy = pickle.loads(pickle.dumps(robot))
    assert again == robot == copy and hash(again) == hash(robot) and not copy.motors.matrix.flags.writeable
    for other in (
        arm(),
        arm().with_motors(coupled_23(), offset=np.full(6, 0.1), names=NAMES),
        arm().with_motors(wrist(), names=NAMES),
    ):
        assert other != robot and other.fingerprint != robot.fingerprint


def test_a_toml_file_has_the_makers_joints(tmp_path: Path) -> None:
    text = (Path(optik.__file__).parent / "robots" / "ur5.toml").read_text(encoding="utf-8")
    rows = [[float(x) for x in row] for row in coupled_23()]
    file = tmp_path / "coupled.toml"
    table = f"\n[motors]\nmatrix = {rows}\noffset_deg = [0, 0, 90, 0, 0, 0]\nnames = {list(NAMES)}\n"
    file.write_text(text + table, encoding="utf-8")
    robot = optik.load(file)
    assert robot.motors.names == NAMES and robot.motors.offset[2] == np.pi / 2.0
    assert (robot.motors.limits.velocity == np.pi).all() and robot.limits.velocity[2] == pytest.approx(2.0 * np.pi)
    for wrong in ("matrix = [[1, 2]]", "matrix = [[0, 0, 0, 0, 0, 0]]"):
        file.write_text(text + f"\n[motors]\n{wrong}\n", encoding="utf-8")
        with pytest.raises(InvalidInput, match=r"motors\.matrix"):
            optik.load(file)


@pytest.mark.parametrize(
    ("matrix", "options", "words"),
    [
        (np.ones((6, 6)), {}, "an invertible matrix"),
        (np.eye(5), {}, "an invertible matrix"),
        (np.eye(6), {"names": ["a", "b"]}, "6 different names"),
        (np.eye(6), {"offset": [0.0, 1.0]}, "6 numbers"),
        ("x", {}, "numbers"),
    ],
)
def test_wrong_couplings_are_refused(matrix, options, words) -> None:
    with pytest.raises(InvalidInput, match=words):
        arm().with_motors(matrix, **options)


def test_formats_without_a_place_for_them_refuse_them_by_name() -> None:
    robot = arm().with_motors(wrist(), names=NAMES)
    for write in (lambda: robot.to_urdf(), lambda: to_mjcf(robot)):
        with pytest.raises(RobotModelError, match="M1, M2, M3, M4, M5, M6 are coupled"):
            write()


@pytest.mark.parametrize("C", MATRICES.values(), ids=MATRICES)
@pytest.mark.parametrize("solver", ["lm", "dls", "closed_form", "sqp"])
def test_inverse_kinematics_searches_the_ranges_of_the_motors(C: Array, solver: str) -> None:
    robot, solved = optik.load("ur5e" if solver == "closed_form" else "paper6r").with_motors(C, names=NAMES), 0
    motors, low, high = robot.motors, robot.motors.limits.lower, robot.motors.limits.upper
    given = motors.limits.sample(np.random.default_rng(5), 12)
    for m in given:
        found = optik.solve_ik(robot, robot.fk(motors.axes(m)), robot.limits.middle, solver)
        solved += bool(found)
        reached = np.linalg.solve(C, found.q - motors.offset)
        assert ((reached >= low - 1e-9) & (reached <= high + 1e-9)).all()
    assert solved == 12 or (solver in ("dls", "sqp") and solved)  # without restarts
    targets = robot.fk(motors.axes(given))
    batch = optik.ik.make_solver(robot, solver).solve_batch(targets, robot.limits.middle)
    assert batch.solved.sum() == solved and robot.limits.contains(batch.q).all()


def test_what_only_motors_out_of_range_reach_says_so() -> None:
    robot, rng, words = optik.load("paper6r").with_motors(coupled_23(), names=NAMES), np.random.default_rng(5), set()
    plain = optik.load("paper6r").with_limits(lower=robot.limits.lower, upper=robot.limits.upper)
    for q in plain.limits.sample(rng, 60):
        found = optik.solve_ik(robot, robot.fk(q), robot.limits.middle)
        words |= set() if found else {found.message}
    assert words == {"the target was met only outside the ranges of the motors"}
    outside = robot.motors.axes(robot.motors.limits.upper * np.array([1.0, 1.0, 1.1, 1.0, 1.0, 1.0]))
    for start in (outside, [outside]):
        with pytest.raises(InvalidInput, match="M3 = "):
            solver = optik.ik.make_solver(robot, "lm")
            T = robot.fk(robot.limits.middle)
            solver.solve(T, start) if start is outside else solver.solve_batch(T[None], start)


def palletiser() -> optik.Robot:
    """The motors of joints 2 and 3 have ranges, and so has the angle between both links, which is narrower."""
    robot = arm().with_limits(lower=np.full(6, -2.0), upper=np.full(6, 2.0)).with_motors(coupled_23(), names=NAMES)
    lower, upper = robot.limits.lower.copy(), robot.limits.upper.copy()
    lower[2], upper[2] = 0.4, 2.3
    return robot.with_limits(lower=lower, upper=upper)


def test_axes_and_motors_both_have_ranges() -> None:
    robot, rng = palletiser(), np.random.default_rng(6)
    limits, motors, low, high = robot.limits, robot.motors, np.full(6, -2.0), np.full(6, 2.0)
    assert limits.lower[2] == 0.4 and limits.upper[2] == 2.3 and limits.narrower.tolist() == [2]
    q = rng.uniform(-4.5, 4.5, (20000, 6))
    m = q @ np.linalg.inv(coupled_23()).T
    both = ((m >= low) & (m <= high)).all(axis=1) & (q[:, 2] >= 0.4) & (q[:, 2] <= 2.3)
    assert (limits.contains(q) == both).all() and both.any()
    assert limits.contains(limits.middle) and np.abs(motors.of(limits.middle)).max() < 1.99
    drawn = limits.sample(rng, 4000)
    assert (
        limits.contains(drawn).all() and limits.contains(limits.clip(q)).all() and (limits.clip(drawn) == drawn).all()
    )
    x = drawn[:, 2]
    assert x.min() < 0.42 and x.max() > 2.2 and (x == 0.4).sum() + (x == 2.3).sum() == 0  # not gathered at the ends
    assert optik.Robot.from_dict(json.loads(json.dumps(robot.to_dict()))) == robot
    for T in robot.fk(drawn[:20]):
        found = optik.solve_ik(robot, T, limits.middle)
        assert not found or limits.contains(found.q)


def test_ranges_without_a_common_configuration_are_refused() -> None:
    robot = palletiser()
    lower, upper = robot.limits.lower.copy(), robot.limits.upper.copy()
    lower[2], upper[2] = 3.9, 4.0  # a corner of the motors' ranges
    narrow = robot.with_limits(lower=lower, upper=upper).limits
    assert narrow.contains(narrow.middle) and narrow.contains(narrow.sample(np.random.default_rng(0), 50)).all()
    lower[1] = 0.0  # joint 2 above 0 leaves at most 2 rad to joint 3
    for ends in ({"lower": lower}, {"lower": np.full(6, 5.0), "upper": np.full(6, 6.0)}):
        with pytest.raises(InvalidInput, match="limits"):
            robot.with_limits(**({"upper": upper} | ends))


def test_a_toml_file_has_ranges_of_axes_beside_those_of_the_motors(tmp_path: Path) -> None:
    text = (Path(optik.__file__).parent / "robots" / "ur5.toml").read_text(encoding="utf-8")
    rows, ends = [[float(x) for x in row] for row in coupled_23()], [360.0] * 6
    ends[2] = 80.0
    file = tmp_path / "coupled.toml"
    file.write_text(f"{text}\n[motors]\nmatrix = {rows}\nupper_deg = {ends}\n", encoding="utf-8")
    limits = optik.load(file).limits
    assert limits.upper[2] == pytest.approx(np.deg2rad(80.0)) and limits.narrower.tolist() == [2]


def test_limits_of_an_arm_with_motors_are_kept() -> None:
    robot = arm().with_motors(wrist(), names=NAMES)
    assert robot.with_limits(velocity=1.0).limits.contains(robot.limits.middle)
    plain = robot.with_limits(robot.limits)
    assert plain == robot


def test_limits_that_belong_to_axes_are_refused_for_motors_and_kept_for_axes() -> None:
    fr3 = optik.load("fr3")
    slowed = fr3.limits.velocity_by_position
    with pytest.raises(InvalidInput, match=r"with_limits\(velocity_by_position="):
        fr3.with_motors(np.eye(7))
    with pytest.raises(InvalidInput, match=r"with_limits\(deceleration="):
        arm().with_limits(deceleration=3.0).with_motors(np.eye(6))
    coupled = fr3.with_limits(velocity_by_position=None).with_motors(np.eye(7))
    assert coupled.with_limits(velocity_by_position=slowed).limits.velocity_by_position == slowed


@pytest.mark.parametrize("wrong", [[1.0, 2.0, 3.0], 3.0, None, "x"])
def test_values_of_another_number_of_joints_are_refused(wrong) -> None:
    motors = arm().with_motors(wrist(), names=NAMES).motors
    for convert in (motors.of, motors.axes):
        with pytest.raises(InvalidInput, match="6 joints"):
            convert(wrong)
    with pytest.raises(InvalidInput, match="6 different names"):
        arm().with_motors(wrist(), names=np.array("x"))
