"""Columns of logs by the words of their headers: names of times and of joints, numbers, units, and what stays refused."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import optik
from optik.errors import AssumptionWarning, InvalidInput
from planners import load_trajectory
from planners.trajectory import Trajectory
from tests.figures import headers

pytestmark = pytest.mark.filterwarnings("ignore:.*no units in the header:optik.errors.AssumptionWarning")
STYLES, EACH = len(headers.CLOCKS) + len(headers.JOINTS), headers.FILES * len(headers.UNITS)
Q = [[0.0, 0.0, 0.0], [0.1, 0.2, 0.3], [0.3, 0.5, 0.4]]


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> optik.Robot:
    file = tmp_path_factory.mktemp("arm") / "arm.urdf"
    file.write_text(headers.ARM)
    return optik.load(file)


@pytest.fixture
def read(tmp_path: Path, arm: optik.Robot) -> Callable[..., Trajectory]:
    """A function that reads a table of three rows at 0, 0.5 and 1 s under a header, or a whole text."""

    def reader(head: str, times: Any = (0.0, 0.5, 1.0), scale: float = 1.0, **options: Any) -> Trajectory:
        rates = ";1;2;3" * ((head.count(";") - 3) // 3)
        rows = [f"{t};{';'.join(repr(x * scale) for x in q)}{rates}" for t, q in zip(times, Q, strict=True)]
        (file := tmp_path / "log.csv").write_text("\n".join([head, *rows]) + "\n")
        return load_trajectory(file, arm, **options)

    return reader


def check(found: Trajectory) -> None:
    np.testing.assert_allclose(found.knots, [0.0, 0.5, 1.0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(found(found.knots), Q, rtol=0, atol=1e-12)


@pytest.mark.parametrize("case", [style * EACH + (7 * style) % EACH for style in range(STYLES)])
def test_a_log_under_any_header_is_read_as_written_or_refused_with_unit(case: int) -> None:
    row = headers.measure(case)
    assert all(value.reached for value in headers.judge([row])), row


@pytest.mark.parametrize(
    "head",
    [
        "t;A1;A2;A3;v1;v2;v3;a1;a2;a3", "t;q1;q2;q3;qd1;qd2;qd3;qdd1;qdd2;qdd3",
        "t;actualQ1;actualQ2;actualQ3;actualQd1;actualQd2;actualQd3;acc_1;acc_2;acc_3",
        "t;SHOULDER;Elbow;wrist;vel_SHOULDER;vel_Elbow;vel_wrist;/x/Shoulder/accel;/x/elbow/accel;/x/wrist/accel",
    ],
)  # fmt: skip
def test_words_state_the_order_of_the_derivative(read: Callable[..., Trajectory], head: str) -> None:
    found = read(head)
    check(found)
    for order in (1, 2):
        np.testing.assert_allclose(found(np.array([0.0, 0.5]), order), [[1.0, 2.0, 3.0]] * 2, rtol=0, atol=1e-9)


def test_numbers_are_the_joints_in_their_order_and_it_is_said(read: Callable[..., Trajectory]) -> None:
    for head in ("t;J1;J2;J3", "t;q_0;q_1;q_2", "t;axis1;axis2;axis3", "t;joint_a1;joint_a2;joint_a3"):
        with pytest.warns(
            AssumptionWarning,
            match=f"{head[2:].replace(';', ',')} are read as shoulder,elbow,wrist of .*, by number \\(robot=",
        ):
            check(read(head))
    for head in ("t;q2;q3;q4", "t;q1;q2;q4", "t;m1;m2;m3", "t;effort1;effort2;effort3", "t;error1;error2;error3",
                 "t;/position/error/shoulder;/position/error/elbow;/position/error/wrist", "t;a1;a2;a3",
                 "t;pos_std_1;pos_std_2;pos_std_3"):  # fmt: skip
        with pytest.raises(
            InvalidInput, match=r"line 1: .*; it has no positions: columns='t,shoulder,elbow,wrist' names all columns$"
        ):
            read(head)
        check(read(head, columns="t,shoulder,elbow,wrist"))


def test_two_sets_of_columns_are_refused(read: Callable[..., Trajectory]) -> None:
    head = "t;actual_q_0;actual_q_1;actual_q_2;target_q_0;target_q_1;target_q_2"
    with pytest.raises(
        InvalidInput, match=r"line 1: expected one column of positions for each joint.* ignore='target_q_0,"
    ):
        read(head)
    check(read(head, ignore="target_q_0,target_q_1,target_q_2"))
    with pytest.raises(InvalidInput, match=r"ignore='shoulder_rad,elbow_rad,wrist_rad' or 'shoulder_deg,"):
        read("t;shoulder_deg;shoulder_rad;elbow_deg;elbow_rad;wrist_deg;wrist_rad")
    with pytest.raises(InvalidInput, match=r"line 1: expected times.* ignore='t' or 'stamp' leaves times out$"):
        read("t;shoulder;elbow;wrist;stamp;x;y", ignore="x,y")


def test_units_come_from_the_header_the_size_or_the_option(read: Callable[..., Trajectory]) -> None:
    deg = 180.0 / np.pi
    check(read("t_us;shoulder [deg];elbow [deg];wrist [deg]", (0, 500_000, 1_000_000), deg))
    check(read("t;shoulder;elbow;wrist", (0, 500, 1000), deg, unit=["deg", "ms"]))
    check(read("%time;shoulder;elbow;wrist", (0, 500_000_000, 1_000_000_000)))  # of rostopic echo -p
    check(read("%time;shoulder;elbow;wrist"))  # a header that another program marks as a comment
    with pytest.warns(AssumptionWarning, match="nanoseconds, because they are large whole numbers"):
        check(
            read(
                "t;shoulder_deg;elbow_deg;wrist_deg",
                [1_700_000_000_123_456_789 + k * 500_000_000 for k in range(3)],
                deg,
            )
        )
    for times in ([1.7e12, 1.7e12 + 500.0, 1.7e12 + 1000.0], [1_700_000_000_000_000 + k * 500_000 for k in range(3)],
                  [0, 500_000_000, 1_000_000_000]):  # fmt: skip
        with pytest.raises(InvalidInput, match=r"line [23], column t: .* unit='ms', 'us' or 'ns'"):
            read("t;shoulder;elbow;wrist", times)
    with pytest.raises(InvalidInput, match=r"^unit: expected no unit=, because the file states all units; got rad$"):
        read("t_s;shoulder_deg;elbow_deg;wrist_deg", unit="rad")
    check(
        read("t_ms;shoulder;elbow;wrist", (0, 500, 1000), deg, unit="ms,degrees")
    )  # the unit of the header, and another
    check(read("t;shoulder [°];elbow [°];wrist [°]", (0, 500, 1000), deg, unit="MSEC,DEG"))
    with pytest.raises(
        InvalidInput, match=r"^unit: expected units for rad, .*, such as 'deg', or ms, which it states; got us"
    ):
        read("t_ms;shoulder;elbow;wrist", unit="us")
    for wrong in ("furlong", "ms,us", "ms,"):
        with pytest.raises(InvalidInput, match=r"^unit: expected units for s, rad, which .*, such as 'ms,deg'; got"):
            read("t;shoulder;elbow;wrist", unit=wrong)


def test_degrees_that_cannot_be_radians_are_asked_for(read: Callable[..., Trajectory]) -> None:
    with pytest.raises(InvalidInput, match=r"line 4, column elbow: .* elbow = 28.6479; are these degrees\? unit='deg'"):
        read("t_s;shoulder;elbow;wrist", scale=180.0 / np.pi)
    check(read("t_s;shoulder;elbow;wrist", scale=180.0 / np.pi, unit="deg"))
    assert read("t_s;shoulder;elbow;wrist", scale=180.0 / np.pi, unit="rad")(1.0)[1] == pytest.approx(28.6479, abs=1e-4)
    assert read("t_s;shoulder_rad;elbow_rad;wrist_rad", scale=180.0 / np.pi)(1.0)[1] == pytest.approx(28.6479, abs=1e-4)
    assert read("t_s;shoulder;elbow;wrist", scale=10.0)(1.0)[1] == 5.0  # 2 rad too far can be meant, and is judged
    assert read("t_s;shoulder;elbow;wrist", scale=1000.0)(1.0)[1] == 500.0  # no degrees either


def test_rates_without_units_have_those_of_the_positions(read: Callable[..., Trajectory]) -> None:
    head = "t_s;shoulder_deg;elbow_deg;wrist_deg;vel_shoulder;vel_elbow;vel_wrist"
    with pytest.warns(
        AssumptionWarning, match="the velocities have no units, and are read in those of the positions/s"
    ):
        found = read(head, scale=180.0 / np.pi, unit="s,deg")
    check(found)
    np.testing.assert_allclose(found(0.5, 1), np.deg2rad([1.0, 2.0, 3.0]), rtol=0, atol=1e-12)


def test_seconds_and_nanoseconds_are_added_only_as_parts_of_a_time(tmp_path: Path, arm: optik.Robot) -> None:
    file = tmp_path / "log.csv"

    def read_pair(head: str, *cells: str, **options: Any) -> Trajectory:
        rows = [f"{x};{';'.join(map(repr, q))}" for x, q in zip(cells, Q, strict=True)]
        file.write_text("\n".join([f"{head};shoulder;elbow;wrist", *rows]) + "\n")
        return load_trajectory(file, arm, **options)

    check(read_pair("stamp.sec;stamp.nanosec", "5;700000000", "6;200000000", "6.0;7e8"))
    for head, cells in (
        ("time_s;time_ns", ("0;0", "0.5;500000000", "1;1000000000")),  # the same times twice
        ("t_sec;t_nsec", ("1700000000.0;1700000000000000000", "1700000001;1700000001000000000", "1700000002;17e17")),
        ("timestamp [s];timestamp [ns]", ("0;0", "0.25;250000000", "0.5;500000000")),
        ("t_s;t_ns", ("0;0", "0;-5", "1;0")),
    ):
        first, second = head.split(";")
        with pytest.raises(InvalidInput) as refused:
            read_pair(head, *cells)
        assert f"ignore={first!r} or {second!r} leaves" in str(refused.value)
    check(read_pair("time_s;time_ns", "0;0", "0.5;500000000", "1;1000000000", ignore="time_ns"))


def make_arm(*names: str, kind: str = "revolute") -> optik.Robot:
    joints = "".join(headers.JOINT.format(i + 1, i, name) for i, name in enumerate(names))
    return optik.Robot.from_urdf(f'<robot name="arm"><link name="l0"/>{joints}</robot>'.replace("revolute", kind, 1))


def test_numbers_of_columns_are_those_of_the_joints_names(tmp_path: Path) -> None:
    file, six = tmp_path / "log.csv", [f"a_long_name_of_an_arm_joint{i}" for i in range(1, 7)]
    for names, heads, at in (
        ([f"joint{i}" for i in range(6)], [f"joint{i}" for i in range(1, 7)], None),  # joint1 is another joint
        ([f"joint_{i}" for i in range(1, 7)], [f"joint_{i}" for i in range(6)], None),
        (["j0", "j1"], ["j1", "j2"], None),
        (["j0", "j1"], ["q1", "q2"], None),
        (["j1", "j3", "j2"], ["position0", "position1", "position2"], None),
        (["j1", "j3", "j2"], ["j_1", "j_2", "j_3"], [0, 2, 1]),
        (["j_3_b", "j_2_a"], ["q2", "q3"], [1, 0]),
        (six, [f"actual_q_{i}" for i in range(6)], [*range(6)]),  # indices from 0
    ):
        rows = [[0.0, *(0.0 for _ in heads)], [1.0, *(0.1 * i for i in range(len(heads)))]]
        file.write_text("\n".join(";".join(map(str, row)) for row in [["t", *heads], *rows]) + "\n")
        if at is None:
            with pytest.raises(InvalidInput, match=r"no positions: columns='t,|robot= names another arm"):
                load_trajectory(file, make_arm(*names))
            continue
        with pytest.warns(AssumptionWarning) as told:
            found = load_trajectory(file, make_arm(*names))
        np.testing.assert_allclose(found(1.0), [0.1 * i for i in at], rtol=0, atol=1e-12)
        read, named = (",".join(x if len(x) < 4 else [x[0], "…", x[-1]]) for x in ([heads[i] for i in at], names))
        assert f"{read} are read as {named} of " in str(told[0].message)


def test_columns_that_may_be_positions_or_accelerations_are_named_both(tmp_path: Path) -> None:
    (file := tmp_path / "log.csv").write_text("t,q1,q2,v1,v2,a1,a2\n0,0,0,0,0,0,0\n1,0.1,0.2,0,0,9,9\n")
    with pytest.raises(InvalidInput, match=r"ignore='q1,q2' or 'a1,a2' leaves some out"):
        load_trajectory(file, make_arm("a1", "a2"))
    np.testing.assert_allclose(load_trajectory(file, make_arm("a1", "a2"), ignore="a1,a2")(1.0), [0.1, 0.2])


def test_degrees_are_asked_for_beside_a_slider_and_a_little_outside_the_range(tmp_path: Path) -> None:
    (file := tmp_path / "log.csv").write_text("t,rail,turn\n0,0,0\n1,-9,175\n")
    with pytest.raises(InvalidInput, match=r"column turn: .* turn = 175; are these degrees\?"):
        load_trajectory(file, make_arm("rail", "turn", kind="prismatic"))


def test_messages_have_units_too(tmp_path: Path, arm: optik.Robot) -> None:
    data = {"joint_names": headers.NAMES, "times": [0.0, 500.0, 1000.0], "positions": np.rad2deg(Q).tolist()}
    data["velocities"] = np.rad2deg(V := np.array([[0.0] * 3, [0.1, 0.2, 0.3], [0.0] * 3])).tolist()
    (file := tmp_path / "log.json").write_text(json.dumps(data))
    with pytest.raises(InvalidInput, match=r"log.json: times\[2\]: .*are these degrees\?"):
        load_trajectory(file, arm)
    check(found := load_trajectory(file, arm, unit="ms,deg"))
    np.testing.assert_allclose(found(found.knots, 1), V, rtol=0, atol=1e-12)
    file.write_text(json.dumps(data).replace("times", "time_from_start"))
    check(load_trajectory(file, arm, unit="ms,deg"))
    times = [{"sec": 0, "nanosec": 500_000_000 * k} for k in range(2)]
    file.write_text(json.dumps({"joint_names": headers.NAMES, "time_from_start": times, "positions": Q[:2]}))
    assert load_trajectory(file, arm).duration == 0.5
    with pytest.raises(InvalidInput, match=r"^unit: expected units for rad.* got ms,deg"):
        load_trajectory(file, arm, unit="ms,deg")
