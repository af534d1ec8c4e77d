"""ROS messages: their fields, their times, and that the certificate is of what the controller makes of what was written."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import PPoly

from optik import JointLimits, Robot
from optik.errors import InvalidInput, NoSolution, OutputError
from optik.scene.files import LONGEST_DURATION, NANOSECONDS
from optik.types import Array
from planners import JointLine, Line, MotionLimits, Trajectory, load_motion, make_law, plan, save
from planners.files.setpoints import load_trajectory
from planners.motion import Motion, get_motion
from planners.ros.export import NEAR_KNOT, _to_yaml, to_ros
from planners.trajectory import cut_before
from tests import oracles
from tests.planners.cases import MOVE, START, default_line, moved, paper6r
from tests.planners.test_controller import between, exact

each_suffix = pytest.mark.parametrize("suffix", [".yml", ".json"])

# trajectory_msgs/msg/JointTrajectory.msg and what it is made of, in ROS 2
DURATION = {"sec": int, "nanosec": int}
POINT = {"positions": list, "velocities": list, "accelerations": list, "effort": list, "time_from_start": DURATION}
MESSAGE = {"header": {"stamp": DURATION, "frame_id": str}, "joint_names": list, "points": [POINT]}
NAMES = [f"joint{i + 1}" for i in range(6)]


@cache
def planned(law: str = "ruckig") -> Motion:
    return get_motion(plan(paper6r(), default_line(), START, timing=law))


def hop(T: float = 0.5, size: float = 0.05, **options: Any) -> Motion:
    """From rest to rest by one quintic, which promises nothing but what is asked."""
    c = np.zeros((6, 1, 6))
    c[5, 0] = START
    c[:3, 0] = size * np.array([6.0 / T**5, -15.0 / T**4, 10.0 / T**3])[:, None]
    fields: dict[str, Any] = {"limits": MotionLimits(), "enforced": ()} | options
    trajectory = Trajectory(PPoly(c, [0.0, T]))
    return Motion(paper6r(), way_of(trajectory), trajectory=trajectory, **fields)


def way_of(trajectory: Trajectory) -> JointLine:
    """The straight way in joint space that a motion runs through, whatever the range of the joints."""
    arm, wide = paper6r(), JointLimits(np.full(6, -10.0), np.full(6, 10.0))
    free = Robot("free", arm.fixed, arm.prismatic, arm.tool, wide)
    return JointLine(free, trajectory(0.0), trajectory(trajectory.end))


def at_its_limits(kind: str) -> Motion:
    """From rest to rest in phases of constant jerk, or constant acceleration, which are the limits it promises."""
    if kind == "jerk":
        s = oracles.s_curve(1.0, 1.0, 0.11)
    else:  # a trapezoid of velocity: accelerations jump
        s = PPoly([[2.0, 0.0, -2.0], [0.0, 1.2, 1.2], [0.0, 0.18, 0.54]], [0.0, 0.3, 0.6, 0.9])
    size = 0.1 * np.arange(1.0, 7.0)
    c = s.c[..., None] * size
    c[-1] += START
    trajectory = Trajectory(PPoly(c, s.x))
    orders = (1, 2, 3) if kind == "jerk" else (1, 2)
    limits = MotionLimits(*(trajectory.extrema(order).worst * (1.0 + 1e-9) for order in orders))
    enforced = ("velocity", "acceleration", "jerk")[: len(orders)]
    return Motion(paper6r(), way_of(trajectory), limits, trajectory, "phases", enforced)


def read(file: Path) -> Any:
    """The message as ROS's own tools read it."""
    return json.loads(file.read_text()) if file.suffix == ".json" else yaml.safe_load(file.read_text())


def fits(data: Any, shape: Any) -> bool:
    """Whether data have exactly the fields of a message, in order."""
    if isinstance(shape, dict):
        return list(data) == list(shape) and all(fits(data[k], shape[k]) for k in shape)
    if isinstance(shape, list):
        return all(fits(item, shape[0]) for item in data)
    return type(data) is shape


def nanoseconds(message: Any) -> list[int]:
    return [p["time_from_start"]["sec"] * 10**9 + p["time_from_start"]["nanosec"] for p in message["points"]]


def accepted(message: Any) -> bool:
    """The checks of ROS 2's joint_trajectory_controller on a goal: lengths, increasing times, rest at the end."""
    n, t = len(message["joint_names"]), nanoseconds(message)
    lengths = all(
        len(p["positions"]) == n and len(p["velocities"]) in (0, n) and len(p["accelerations"]) in (0, n)
        and p["effort"] == [] for p in message["points"]
    )  # fmt: skip
    rest = all(abs(v) <= np.finfo(np.float32).eps for v in message["points"][-1]["velocities"])
    return lengths and rest and all(b > a for a, b in pairwise(t))


def interpolated(message: Any, t: float, order: int) -> Array:
    """What a controller makes of a message at t, joints in the message's order; slow."""
    times = [x * 1e-9 for x in nanoseconds(message)]
    i = max(k for k in range(len(times) - 1) if times[k] <= t)
    ends = [[p[f] for f in ("positions", "velocities", "accelerations") if p[f]] for p in message["points"][i : i + 2]]
    return between(np.array(ends[0]), np.array(ends[1]), times[i + 1] - times[i], t - times[i], order)


# ---------------------------------------------------------------- what is written
@each_suffix
@pytest.mark.parametrize("rate", [None, 125.0, 300.0])
@pytest.mark.parametrize("interpolation", ["quintic", "cubic", "linear"])
def test_the_message_is_one_and_what_a_controller_makes_of_it_is_what_was_certified(
    interpolation: str, rate: float | None, suffix: str, tmp_path: Path
) -> None:
    file = tmp_path / f"motion{suffix}"
    motion = planned()
    sent = to_ros(motion, file, rate=rate, interpolation=interpolation)
    message = read(file)
    assert fits(message, MESSAGE)
    assert accepted(message)
    assert message["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    assert message["joint_names"] == NAMES
    assert len(message["points"]) == sent.points
    filled = {"quintic": (6, 6), "cubic": (6, 0), "linear": (0, 0)}[interpolation]
    assert {(len(p["velocities"]), len(p["accelerations"])) for p in message["points"]} == {filled}
    for t in np.random.default_rng(1).uniform(0.0, sent.trajectory.end, 12):
        for order in range(4):
            expected = interpolated(message, t, order)
            np.testing.assert_allclose(sent.trajectory(t, order), expected, rtol=0, atol=2e-6 * 10.0**order)
    back = load_trajectory(file, motion.robot)
    assert back.coefficients.tobytes() == sent.trajectory.coefficients.tobytes()
    assert back.knots.tobytes() == sent.trajectory.knots.tobytes()
    assert replace(motion, trajectory=back).certify().to_dict() == sent.certificate.to_dict()


@pytest.mark.parametrize("rate", [None, 50.0, 333.0, 1000.0])
@pytest.mark.parametrize("law", ["quintic", "ruckig", "toppra"])
def test_the_controller_is_sent_the_exact_states_of_the_motion_uniformly_slowed(
    law: str, rate: float | None, tmp_path: Path
) -> None:
    motion = planned(law)
    sent = to_ros(motion, tmp_path / "motion.json", rate=rate)
    message = read(tmp_path / "motion.json")
    source, times = motion.trajectory, nanoseconds(message)
    assert sent.factor == pytest.approx(times[-1] * 1e-9 / source.duration, rel=1e-12)
    assert sent.factor >= 1.0 - 1e-9 / source.duration
    if rate is None:
        np.testing.assert_allclose(np.array(times) * 1e-9, source.knots * sent.factor, rtol=0, atol=1.6e-9)
    else:
        assert times == [round(k * 10**9 / rate) for k in range(len(times))]
    for i in {0, 1, len(times) // 3, len(times) // 2, len(times) - 2, len(times) - 1}:
        for order, field in enumerate(("positions", "velocities", "accelerations")):
            at = min(times[i] * 1e-9 / sent.factor, source.duration)
            nearest = source.knots[np.argmin(np.abs(source.knots - at))]
            at = nearest if abs(nearest - at) < 1e-9 else at
            wanted = exact(source, at, order) / sent.factor**order
            np.testing.assert_allclose(message["points"][i][field], wanted, rtol=0, atol=1e-7 * 10.0**order)
    assert sent.certificate.is_valid
    assert sent.certificate.path_error.distance < 1e-6


@settings(max_examples=10)
@given(T=st.floats(0.02, 4.0), rate=st.none() | st.floats(1.0, 1000.0))
def test_times_are_whole_nanoseconds_that_fill_whole_periods(T: float, rate: float | None, tmp_path: Path) -> None:
    sent = to_ros(hop(T), tmp_path / "motion.json", rate=rate)
    message = read(tmp_path / "motion.json")
    times = nanoseconds(message)
    assert accepted(message)
    end = int(np.ceil(T * 1e9)) if rate is None else round(int(np.ceil((T - 5e-10) * rate)) * 10**9 / rate)
    assert abs(times[-1] - end) <= 1
    assert sent.trajectory.duration == times[-1] / 10**9


@pytest.mark.parametrize(("T", "rate", "points"), [(0.9, 100.0, 91), (0.1 * 3, 1000.0, 301), (0.3 + 1e-9, 1000.0, 302)])
def test_a_duration_of_whole_periods_is_not_stretched_for_its_last_bit(
    T: float, rate: float, points: int, tmp_path: Path
) -> None:
    sent = to_ros(hop(T), tmp_path / "motion.json", rate=rate)
    assert sent.points == points
    assert points == 302 or sent.factor == pytest.approx(1.0, abs=1e-12)


def test_a_yaml_says_what_was_done_in_its_comments(tmp_path: Path) -> None:
    sent = to_ros(planned("toppra"), tmp_path / "motion.yaml", rate=125.0)
    remarks = [line for line in (tmp_path / "motion.yaml").read_text().splitlines() if line.startswith("#")]
    assert remarks[0] == f'# "paper6r", law "toppra": {sent.points} points at 125 per second'
    assert f"{sent.factor:.9g} times" in remarks[1]
    assert f"acceleration {sent.certificate.worst('acceleration')[0]:.9g}, jerk inf" in remarks[2]
    assert f"jump at {sent.jumps} knots, by up to {sent.largest_jump:.6g}" in remarks[3]


def test_jumps_of_acceleration_are_stated_and_a_point_carries_the_mean_of_both_sides(tmp_path: Path) -> None:
    c = np.zeros((3, 2, 6))  # up at 2 rad/s² for 0.1 s, down at 2
    c[2, :, :], c[0, 0, 1], c[0, 1, 1], c[1, 1, 1] = START, 1.0, -1.0, 0.2
    c[2, 1, 1] += 0.01
    trajectory = Trajectory(PPoly(c, [0.0, 0.1, 0.2]))
    motion = replace(hop(), trajectory=trajectory, path=way_of(trajectory))
    sent = to_ros(motion, tmp_path / "motion.json")
    assert (sent.jumps, sent.largest_jump, sent.points) == (1, pytest.approx(4.0), 3)
    accelerations = [p["accelerations"][1] for p in read(tmp_path / "motion.json")["points"]]
    np.testing.assert_allclose(accelerations, [2.0, 0.0, -2.0], atol=1e-7)
    assert sent.certificate.jerk.value[1] == np.inf, "it jumps from and to standstill"
    assert (to_ros(planned(), tmp_path / "motion.json").jumps, hop().trajectory.knots.size) == (0, 2)


# ---------------------------------------------------------------- limits
@pytest.mark.parametrize(("kind", "rate"), [("acceleration", None), ("acceleration", 100.0), ("jerk", 97.0)])
def test_what_the_controller_would_exceed_is_slowed_and_said_or_refused(
    kind: str, rate: float | None, tmp_path: Path
) -> None:
    motion = at_its_limits(kind)
    assert motion.certify().is_valid
    as_it_is = replace(motion, enforced=())
    unslowed = to_ros(as_it_is, tmp_path / "motion.json", rate=rate)
    assert max(unslowed.certificate.worst(field)[0] for field in motion.enforced) > 1.001
    sent = to_ros(motion, tmp_path / "motion.json", rate=rate)
    assert 1.0005 * unslowed.factor < sent.factor < 1.5
    assert sent.certificate.is_valid
    assert 0.7 < max(sent.certificate.worst(field)[0] for field in motion.enforced) <= 1.0
    with pytest.raises(NoSolution, match=r"exceeds its limits; .* 1\.\d+ times its duration"):
        to_ros(motion, tmp_path / "strict.json", rate=rate, strict=True)
    assert not (tmp_path / "strict.json").exists()


def weld(speed: float | None = 0.05) -> Motion:
    law = make_law("constant_speed", speed=speed)
    return get_motion(plan(paper6r(), default_line(), START, timing=law))


@pytest.mark.parametrize("rate", [None, 125.0, 1000.0])
def test_a_tool_speed_that_was_asked_is_kept_and_the_end_is_held(rate: float | None, tmp_path: Path) -> None:
    motion = weld()
    sent = to_ros(motion, tmp_path / "motion.json", rate=rate)
    assert sent.certificate.is_valid
    end = motion.trajectory.duration
    speeds = oracles.speeds(oracles.PAPER, sent.trajectory, np.linspace(0.3 * end, 0.7 * end, 50))[:, 0]
    np.testing.assert_allclose(speeds, 0.05, rtol=1e-6)
    t = np.linspace(0.0, end, 400)
    np.testing.assert_allclose(sent.trajectory(t), motion.trajectory(t), rtol=0.0, atol=1e-9)
    if rate is not None:
        periods = sent.trajectory.duration * rate
        assert periods == pytest.approx(round(periods), abs=1e-6)
        assert end <= sent.trajectory.duration < end + 1.0 / rate
        np.testing.assert_allclose(sent.trajectory(sent.trajectory.end, 1), 0.0, atol=1e-12)


@pytest.mark.parametrize("rate", [125.0, 500.0])
def test_points_of_the_rate_stand_apart_from_the_knots_between(rate: float, tmp_path: Path) -> None:
    to_ros(weld(), tmp_path / "motion.json", rate=rate)
    stamps = [p["time_from_start"] for p in read(tmp_path / "motion.json")["points"]]
    times = np.array([NANOSECONDS * t["sec"] + t["nanosec"] for t in stamps])
    of_rate = np.isin(times, np.rint(np.arange(times[-1] * rate / NANOSECONDS + 1) * NANOSECONDS / rate).astype(int))
    inner = of_rate[1:-1]
    assert inner.any() and not inner.all()
    apart = np.minimum(np.diff(times)[:-1], np.diff(times)[1:])[inner]
    assert apart.min() >= NEAR_KNOT * NANOSECONDS / rate - 1


def test_the_longest_time_of_ros_is_a_time_and_equal_times_are_named(tmp_path: Path) -> None:
    to_ros(hop(), tmp_path / "motion.json")
    message = read(tmp_path / "motion.json")
    last = message["points"][-1]
    file = tmp_path / "other.json"
    last["time_from_start"] = {"sec": LONGEST_DURATION, "nanosec": 0}
    file.write_text(json.dumps(message))
    assert load_trajectory(file, paper6r()).end == float(LONGEST_DURATION)
    last["time_from_start"] = {"sec": LONGEST_DURATION + 1, "nanosec": 0}
    file.write_text(json.dumps(message))
    with pytest.raises(InvalidInput, match="time_from_start"):
        load_trajectory(file, paper6r())
    last["time_from_start"] = {"sec": 1, "nanosec": 0}
    message["points"] += [last | {"time_from_start": {"sec": 2, "nanosec": 0}}] * 2
    file.write_text(json.dumps(message))
    with pytest.raises(InvalidInput, match=r"points\[3\]\.time_from_start.* got 2 s after 2 s"):
        load_trajectory(file, paper6r())


def test_a_tool_speed_that_nobody_asked_or_that_need_not_be_kept_is_slowed(tmp_path: Path) -> None:
    assert weld(None).speed is None
    for motion, options in ((weld(None), {}), (weld(), {"keep_speed": False})):
        sent = to_ros(motion, tmp_path / "motion.json", rate=125.0, **options)
        assert sent.factor > 1.01
        assert sent.certificate.is_valid
    with pytest.raises(InvalidInput, match="keep_speed"):
        to_ros(weld(), tmp_path / "motion.json", keep_speed="no")


def test_a_tool_speed_that_cannot_be_kept_is_refused_with_what_it_would_be(tmp_path: Path) -> None:
    motion = weld()
    least = np.asarray(motion.certify().acceleration.value) * (1.0 + 1e-9)
    tight = replace(motion, limits=replace(motion.limits, acceleration=least))  # cubics pass this limit
    with pytest.raises(
        NoSolution, match=r"a tool speed of 0\.0[0-9]+ m/s instead of 0\.05 m/s.*keep_speed=False"
    ) as caught:
        to_ros(tight, tmp_path / "motion.json", interpolation="cubic")
    assert not (tmp_path / "motion.json").exists()
    slower = float(re.findall(r"speed of ([0-9.]+) m/s", caught.value.reason)[0])
    sent = to_ros(tight, tmp_path / "motion.json", interpolation="cubic", keep_speed=False)
    assert sent.factor == pytest.approx(0.05 / slower, rel=1e-3)
    assert sent.factor > 1.0005


def test_a_motion_at_its_limits_keeps_them_at_its_knots_without_being_slowed(tmp_path: Path) -> None:
    sent = to_ros(at_its_limits("jerk"), tmp_path / "motion.json", strict=True)
    assert sent.certificate.is_valid
    assert 1.0 <= sent.factor < 1.0 + 1e-8


def test_what_an_interpolation_cannot_keep_is_shown_and_not_hidden(tmp_path: Path) -> None:
    motion = planned()
    linear = to_ros(motion, tmp_path / "motion.json", rate=200.0, interpolation="linear")
    assert not linear.certificate.is_valid
    assert linear.certificate.worst("acceleration")[0] == np.inf
    cubic = to_ros(motion, tmp_path / "motion.json", rate=200.0, interpolation="cubic")
    assert [f for f in motion.enforced if cubic.certificate.worst(f)[0] > 1.0] == ["jerk"]


def test_a_motion_that_passes_a_joints_range_is_not_written(tmp_path: Path) -> None:
    limits = paper6r().limits
    tight = JointLimits(limits.lower, np.append(limits.upper[:5], START[5] + 0.04), limits.velocity)
    robot = Robot("tight", paper6r().fixed, paper6r().prismatic, paper6r().tool, tight, tuple(NAMES))
    with pytest.raises(NoSolution, match=r"joint6 exceeds its range by 0\.01"):
        to_ros(replace(hop(), robot=robot), tmp_path / "motion.json")
    assert list(tmp_path.iterdir()) == []


def test_a_start_on_the_move_is_neither_slowed_nor_stretched(tmp_path: Path) -> None:
    c = np.zeros((4, 1, 6))
    c[3, 0], c[2, 0, 0], c[1, 0, 0] = START, 0.2, -0.2  # q̇ from 0.2 to 0 in 0.5 s
    trajectory = Trajectory(PPoly(c, [0.0, 0.5]))
    moving = replace(hop(), trajectory=trajectory, path=way_of(trajectory))
    assert to_ros(moving, tmp_path / "motion.json").factor == 1.0
    assert to_ros(moving, tmp_path / "motion.json", rate=100.0).factor == 1.0
    with pytest.raises(InvalidInput, match="rate: expected none, or one that divides the duration"):
        to_ros(moving, tmp_path / "motion.json", rate=75.0)
    rest = cut_before(hop().trajectory, 0.3)
    limits = MotionLimits(acceleration=rest.extrema(2).worst * (1.0 + 1e-9))
    limited = replace(hop(), trajectory=rest, path=way_of(rest), limits=limits, enforced=("acceleration",))
    with pytest.raises(NoSolution, match="starts in motion and cannot be slowed"):
        to_ros(limited, tmp_path / "motion.json", interpolation="cubic", rate=20.0)


def test_a_motion_that_does_not_end_at_rest_is_refused(tmp_path: Path) -> None:
    trajectory = Trajectory(PPoly(np.stack([np.full((1, 6), 0.1), START[None]]), [0.0, 0.5]))
    with pytest.raises(InvalidInput, match=r"a motion that ends at rest; got a speed of 0\.1 at its end"):
        to_ros(replace(hop(), trajectory=trajectory), tmp_path / "motion.json")


# ---------------------------------------------------------------- names, order, start
@each_suffix
def test_another_order_and_other_names_are_written_and_read_back(suffix: str, tmp_path: Path) -> None:
    file, motion = tmp_path / f"motion{suffix}", planned()
    straight = to_ros(motion, tmp_path / "straight.json", rate=50.0)
    order = [NAMES[i] for i in (5, 0, 3, 1, 4, 2)]
    sent = to_ros(motion, file, rate=50.0, joint_names=order)
    message = read(file)
    assert message["joint_names"] == order
    assert message["points"][0]["positions"] == [START[i] for i in (5, 0, 3, 1, 4, 2)]
    assert sent.trajectory.coefficients.tobytes() == straight.trajectory.coefficients.tobytes()
    assert load_trajectory(file, motion.robot)(0.3).tobytes() == sent.trajectory(0.3).tobytes()

    mapping = {name: f"arm: {name!r} \\ ä #{i}" for i, name in enumerate(order)}
    sent = to_ros(motion, file, rate=50.0, joint_names=mapping, frame_id='base "1"')
    message = read(file)
    assert message["joint_names"] == list(mapping.values())
    assert message["header"]["frame_id"] == 'base "1"'
    assert message["points"][0]["positions"] == [START[i] for i in (5, 0, 3, 1, 4, 2)]
    assert load_trajectory(file, motion.robot, joint_names=mapping)(0.3).tobytes() == sent.trajectory(0.3).tobytes()
    with pytest.raises(InvalidInput, match="joint_names"):
        load_trajectory(file, motion.robot)


@pytest.mark.parametrize(
    "wrong",
    [
        "joint1", [], NAMES[:5], [*NAMES[:5], "joint1"], [*NAMES[:5], "wrist"], [*NAMES, "tool"], 3, [1, 2, 3, 4, 5, 6],
        dict(zip(NAMES[:5], "abcde", strict=True)), dict(zip(NAMES, "abcdea", strict=True)),
        dict(zip(NAMES, ["", *"abcde"], strict=True)), dict(zip(NAMES, ["a\nb", *"abcde"], strict=True)),
        dict(zip(NAMES, range(6), strict=True)),
    ],
    ids=str,
)  # fmt: skip
def test_names_that_are_not_the_robots_are_refused(wrong: Any, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="joint_names"):
        to_ros(hop(), tmp_path / "motion.json", joint_names=wrong)
    assert list(tmp_path.iterdir()) == []


def test_an_arm_that_stands_elsewhere_is_refused_with_the_joint(tmp_path: Path) -> None:
    file = tmp_path / "motion.json"
    names = {name: f"arm_{name}" for name in reversed(NAMES)}
    state = {f"arm_{name}": q for name, q in zip(NAMES, START, strict=True)} | {"gripper": 0.04}
    for start in (START, START + 0.0099, state):
        to_ros(hop(), file, start=start, joint_names=names)
    file.unlink()
    away = START + 0.02 * np.eye(6)[3]
    for start in (away, state | {"arm_joint4": away[3]}):
        with pytest.raises(InvalidInput, match=r"start: expected an arm within 0\.01 .*; got joint4 0\.02 rad"):
            to_ros(hop(), file, start=start, joint_names=names)
    to_ros(hop(), file, start=away, tolerance=0.03)
    file.unlink()
    for start, tolerance, named in (
        (START[:5], 0.01, "start"),
        (np.full(6, np.nan), 0.01, "start"),
        ({"arm_joint1": 0.3}, 0.01, "none for joint1"),
        (START, -1.0, "tolerance"),
        (START, np.nan, "tolerance"),
    ):
        with pytest.raises(InvalidInput, match=named):
            to_ros(hop(), file, start=start, tolerance=tolerance)
    assert not file.exists()


# ---------------------------------------------------------------- misuse of writing
@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"rate": 0.0}, "rate"), ({"rate": np.nan}, "rate"), ({"rate": 1e8}, "at most 1000000 points"),
        ({"rate": 2e9}, "rate"), ({"interpolation": "septic"}, "interpolation"), ({"frame_id": 3}, "frame_id"),
        ({"frame_id": "a\nb"}, "frame_id"),
    ],
)  # fmt: skip
def test_what_cannot_be_meant_is_refused(options: Any, named: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=named):
        to_ros(hop(), tmp_path / "motion.json", **options)
    assert list(tmp_path.iterdir()) == []


def test_times_that_would_not_increase_in_nanoseconds_are_refused(tmp_path: Path) -> None:
    base = hop().trajectory
    c = np.repeat(base.coefficients, 3, axis=1)
    c[:, 1:] = 0.0
    c[5, 1:] = base(0.5)
    trajectory = Trajectory(PPoly(c, [0.0, 0.5, 0.5 + 1e-10, 0.5 + 2e-10]))
    with pytest.raises(InvalidInput, match="points at least 1 ns apart: give a rate"):
        to_ros(replace(hop(), trajectory=trajectory), tmp_path / "motion.json")
    assert to_ros(replace(hop(), trajectory=trajectory), tmp_path / "motion.json", rate=100.0).points == 51


def test_save_writes_the_message_where_the_suffix_is_yaml(tmp_path: Path) -> None:
    save(hop(), tmp_path / "saved.YAML", rate=100.0)
    to_ros(hop(), tmp_path / "sent.yaml", rate=100.0)
    assert (tmp_path / "saved.YAML").read_bytes() == (tmp_path / "sent.yaml").read_bytes()
    with pytest.raises(InvalidInput, match=r"\.csv, \.json, \.npz, \.yaml, \.yml; got"):
        save(hop(), tmp_path / "saved.txt")
    with pytest.raises(InvalidInput, match=r"\.csv, \.json, \.npz; got"):
        load_motion(tmp_path / "saved.yaml")


def test_files_and_plans_that_are_none_are_named(tmp_path: Path) -> None:
    for file in ("motion.txt", "motion", 3):
        with pytest.raises(InvalidInput, match=r"\.json, \.yaml, \.yml"):
            to_ros(hop(), file)
        with pytest.raises(InvalidInput, match=r"\.csv, \.json, \.yaml, \.yml"):
            load_trajectory(file, paper6r())
    with pytest.raises(OutputError):
        to_ros(hop(), tmp_path / "none" / "motion.json")
    with pytest.raises(InvalidInput, match="readable file"):
        load_trajectory(tmp_path / "motion.json", paper6r())
    start = paper6r().fk(START)
    with pytest.raises(NoSolution):
        to_ros(plan(paper6r(), Line(start, moved(start, 5.0 * MOVE)), START), tmp_path / "motion.json")
    assert list(tmp_path.iterdir()) == []


# ---------------------------------------------------------------- YAML
@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1), st.text(st.characters(codec="utf-8")))
def test_what_is_written_as_yaml_is_read_back_to_the_last_bit(values: list[float], name: str) -> None:
    name = "".join(c for c in name if c.isprintable())
    time = {"sec": 1, "nanosec": 2}
    point = {"positions": values, "velocities": [], "accelerations": [], "effort": [], "time_from_start": time}
    message = {"header": {"stamp": time, "frame_id": name}, "joint_names": [name], "points": [point, point]}
    back = yaml.safe_load(_to_yaml(message, ["a: b", "# c"]))
    assert repr(back) == repr(message), "types and the sign of zero too"


# ---------------------------------------------------------------- reading what others wrote
def test_a_message_as_ros_prints_it_is_read(tmp_path: Path) -> None:
    file = tmp_path / "motion.yaml"
    point = "- positions: [0, 0.1, 0.2, 0.3, 0.4, {}]\n  time_from_start: {{sec: {}, nanosec: 0}}\n"
    file.write_text("joint_names: [joint1, joint3, joint2, joint4, joint5, joint6]\npoints:\n")
    file.write_text(file.read_text() + point.format(0.5, 0) + point.format(0.7, 2) + "---\n")
    motion = load_trajectory(file, paper6r())
    np.testing.assert_allclose(motion(1.0), [0.0, 0.2, 0.1, 0.3, 0.4, 0.6], atol=1e-15)
    np.testing.assert_allclose(motion(1.0, 1), [0, 0, 0, 0, 0, 0.1], atol=1e-15)


def with_field(i: int, field: str, value: Any) -> Callable[[Any], Any]:
    return lambda m: m["points"][i].update({field: value})


def with_time(i: int, value: Any) -> Callable[[Any], Any]:
    return with_field(i, "time_from_start", value)


WRONG: dict[str, tuple[Callable[[Any], Any], str]] = {
    "no names": (lambda m: m.pop("joint_names"), "joint_names"),
    "names of another arm": (lambda m: m.update(joint_names=list("abcdef")), "joint_names"),
    "a name twice": (lambda m: m.update(joint_names=[*NAMES[:5], "joint1"]), "joint_names"),
    "no points": (lambda m: m.pop("points"), "points"),
    "one point": (lambda m: m.update(points=m["points"][:1]), "at least two points; or one point after 0 s and start=Q"),
    "a point that is none": (lambda m: m["points"].insert(1, 3), "points"),
    "no time": (lambda m: m["points"][1].pop("time_from_start"), r"points\[1\].time_from_start"),
    "times of ROS 1 and 2": (with_time(1, {"sec": 0, "nsecs": 5}), "secs and nsecs of ROS 1"),
    "a time in whole numbers": (with_time(1, 1), "seconds with a decimal point"),
    "a time that is no number": (with_time(1, 1e10), "seconds with a decimal point"),
    "a time in fractions": (with_time(1, {"sec": 0.5, "nanosec": 0}), "sec and nanosec, integers from 0"),
    "a time below 0": (with_time(1, {"sec": -1, "nanosec": 0}), "sec and nanosec, integers from 0"),
    "nanoseconds beyond a second": (with_time(1, {"sec": 0, "nanosec": 10**9}), "sec and nanosec, integers from 0"),
    "a first point later": (with_time(0, {"sec": 0, "nanosec": 1}), r"points\[0\].time_from_start.* got 1e-09 s; start=Q"),
    "a time twice": (with_time(1, {"sec": 0, "nanosec": 0}), r"points\[1\].time_from_start.* got 0 s after 0 s"),
    "positions of five joints": (lambda m: m["points"][2]["positions"].pop(), r"points\[2\].positions"),
    "no positions": (with_field(1, "positions", []), r"points\[1\].positions"),
    "velocities in some points": (with_field(1, "velocities", []), r"points\[1\].velocities.*in all points or in none"),
    "accelerations alone": (
        lambda m: [p.update(velocities=[]) for p in m["points"]], "accelerations without velocities",
    ),
    "a word": (with_field(1, "positions", [*"abcdef"]), r"points\[1\].positions"),
    "true": (with_field(1, "positions", [True] * 6), r"points\[1\].positions"),
    "a figure beyond all": (with_field(1, "velocities", [10**400] * 6), r"points\[1\].velocities"),
}  # fmt: skip


@each_suffix
@pytest.mark.parametrize(("change", "named"), WRONG.values(), ids=WRONG.keys())
def test_a_file_that_holds_no_message_is_refused_by_name(
    change: Callable[[Any], Any], named: str, suffix: str, tmp_path: Path
) -> None:
    file = tmp_path / f"motion{suffix}"
    to_ros(hop(), file, rate=10.0)
    message = read(file)
    change(message)
    file.write_text(json.dumps(message) if suffix == ".json" else yaml.safe_dump(message))
    with pytest.raises(InvalidInput, match=named) as caught:
        load_trajectory(file, paper6r())
    assert str(file) in str(caught.value)


@each_suffix
@pytest.mark.parametrize(
    "junk",
    [b"", b"\xff\xfe\x00", b"[" * 5000, b"3", b"a: b: c", b"{", b"- 1\n--- \n- 2\n", b"!!python/object:os.system {}",
     b"a: 2001-99-99", b"points: [.nan, .inf]", b"&a [*a]", b"? [1]\n: 2\n"],
)  # fmt: skip
def test_junk_is_refused(suffix: str, junk: bytes, tmp_path: Path) -> None:
    (tmp_path / f"motion{suffix}").write_bytes(junk)
    with pytest.raises(InvalidInput, match=re.escape(f"motion{suffix}")):
        load_trajectory(tmp_path / f"motion{suffix}", paper6r())


def test_a_message_in_json_that_is_cut_off_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "motion.json"
    to_ros(hop(), file, rate=10.0)
    whole = file.read_bytes()
    for size in range(0, len(whole) - 1, 37):
        file.write_bytes(whole[:size])
        with pytest.raises(InvalidInput):
            load_trajectory(file, paper6r())
