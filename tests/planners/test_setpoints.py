"""Trajectories of other programs: clocks, forms of messages, other joints, wrapped joints, and what was assumed."""

import json
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import optik
from optik.errors import AssumptionWarning, InvalidInput
from optik.tables import LONGEST_LINE, MOST_COLUMNS, MOST_TABLE_BYTES
from optik.types import Array
from planners import MotionLimits, certify, load_trajectory, plan
from planners.trajectory import Trajectory
from tests.figures import tables
from tests.seeds import shift_seed

yaml = pytest.importorskip("yaml")
pytestmark = pytest.mark.filterwarnings("ignore:.*no units in the header:optik.errors.AssumptionWarning")
ARM = """<robot name="two"><link name="base"/><link name="a"/><link name="b"/>
<joint name="j1" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/><limit velocity="3" effort="9"/>
</joint><joint name="j2" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0.5 0 0"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" velocity="3" effort="9"/></joint></robot>"""
T, Q, V = [0.0, 0.5, 1.0], [[0.0, 0.0], [0.1, 0.05], [0.3, 0.15]], [[0.0, 0.0], [0.4, 0.2], [0.0, 0.0]]
"""Three points of a motion: times [s], positions [rad], velocities [rad/s]."""


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> optik.Robot:
    file = tmp_path_factory.mktemp("arm") / "two.urdf"
    file.write_text(ARM)
    return optik.load(file)


@pytest.fixture
def read(tmp_path: Path, two: optik.Robot) -> Callable[..., Trajectory]:
    """A function that writes a text or a message to a file, and reads it."""

    def reader(content: Any, name: str = "", **options: Any) -> Trajectory:
        file = tmp_path / (name or ("log.csv" if isinstance(content, str) else "log.yaml"))
        file.write_text(content if isinstance(content, str) else yaml.safe_dump(content), encoding="utf-8")
        return load_trajectory(file, two, **options)

    return reader


def message(
    time: Callable[[float], Any] = lambda t: {"sec": int(t), "nanosec": round(t % 1 * 1e9)}, **more: Any
) -> Any:
    points = [{"positions": q, "velocities": v, "time_from_start": time(t)} for t, q, v in zip(T, Q, V, strict=True)]
    return {"joint_names": ["j1", "j2"], "points": points, **more}


def check(found: Trajectory, order: int = 1) -> None:
    """Compare a trajectory with the three points."""
    assert found.knots.tolist() == T
    for k, rows in enumerate((Q, V)[: order + 1]):
        np.testing.assert_allclose(found(np.array(T), k), rows, rtol=0, atol=1e-15)


# ---------------------------------------------------------------- forms of messages
@pytest.mark.parametrize(
    "time",
    [
        lambda t: {"secs": int(t), "nsecs": round(t % 1 * 1e9)}, float,
        lambda t: {"nanosec": round(t * 1e9) % 10**9, "sec": int(t)},
        lambda t: {k: v for k, v in (("sec", int(t)), ("nanosec", round(t % 1 * 1e9))) if v},
    ],
)  # fmt: skip
def test_times_are_those_of_ros_1_and_2_or_float_seconds(read: Callable[..., Trajectory], time: Any) -> None:
    check(read(message(time)))
    check(read({"joint_trajectory": message(time), "multi_dof_joint_trajectory": {"points": []}}))
    check(read({"model_id": "two", "trajectory": [{"joint_trajectory": message(time)}], "trajectory_start": {}}))


def test_what_a_message_has_beside_one_joint_trajectory_is_refused(read: Callable[..., Trajectory]) -> None:
    inner = {"joint_trajectory": message()}
    for wrong, words in (
        ({"trajectory": [inner, inner]}, "trajectory: expected one .*; got 2"), ({"trajectory": []}, "joint_names: .*got None"),
        ({**inner, "multi_dof_joint_trajectory": {"points": [{}]}}, "trajectory: expected one .*; got 2"),
    ):  # fmt: skip
        with pytest.raises(InvalidInput, match=words):
            read(json.dumps(wrong), "log.json")


def test_the_only_trajectory_of_a_message_is_found_at_any_depth(read: Callable[..., Trajectory]) -> None:
    goal = {"trajectory": message(), "path_tolerance": [], "goal_time_tolerance": {"sec": 0, "nanosec": 0}}
    check(read({"header": {"frame_id": ""}, "goal_id": {"id": "a-1"}, "goal": goal}))
    check(read({"goal": [{"a": {"b": {"joint_trajectory": message()}}}], "multi_dof_joint_trajectory": {"points": []}}))
    for key, times in (
        ("times", T),
        ("time_from_start", T),
        ("time_from_start", [{"sec": 0, "nanosec": round(t * 1e9)} for t in T[:2]]),
    ):
        rows = slice(len(times))
        data = {"joint_names": ["j1", "j2"], key: times, "positions": Q[rows], "velocities": V[rows]}
        found = read({"result": {"planned": data}})
        np.testing.assert_allclose(found(found.knots, 1), V[rows], rtol=0, atol=1e-15)
    for wrong in ({"goal": {"trajectory": {"joint_names": ["j1", "j2"], "points": []}}}, {}, {"a": [1, 2]}):
        with pytest.raises(InvalidInput, match=r"log.yaml: joint_names: .*got None"):
            read(wrong)


def test_one_later_point_is_a_motion_from_the_start(read: Callable[..., Trajectory]) -> None:
    later = {
        "joint_names": ["j2", "j1"],
        "points": [{"positions": [0.15, 0.3], "time_from_start": {"sec": 2, "nanosec": 0}}],
    }
    with pytest.raises(InvalidInput, match=r"points\[0\].time_from_start: .*start=Q is the configuration at 0 s"):
        read(later)
    later["points"][0]["velocities"] = [0.0, 0.0]
    with pytest.warns(AssumptionWarning, match="at rest at the start"):
        found = read(later, start=[0.1, 0.0])
    assert found.duration == 2.0 and found(0.0).tolist() == [0.1, 0.0]
    np.testing.assert_allclose(found(2.0), [0.3, 0.15], rtol=0, atol=1e-15)
    np.testing.assert_allclose(found(np.array([0.0, 2.0]), 1), np.zeros((2, 2)), rtol=0, atol=1e-15)
    later["points"][0]["time_from_start"] = 0.0
    with pytest.raises(InvalidInput, match="expected at least two points; or one point after 0 s and start=Q"):
        read(later)


def test_numbers_that_yaml_reads_as_text_are_numbers(read: Callable[..., Trajectory]) -> None:
    check(read(yaml.safe_dump(message()).replace("0.05", "5e-2").replace("- 0.4\n", "- 4e-1\n"), "log.yaml"))


def test_a_first_point_after_0_needs_the_start(read: Callable[..., Trajectory]) -> None:
    later = message(lambda t: {"sec": int(t + 0.25), "nanosec": round((t + 0.25) % 1 * 1e9)})
    with pytest.raises(InvalidInput, match=r"points\[0\].time_from_start: .* got 0.25 s; start=Q is"):
        read(later)
    with pytest.warns(AssumptionWarning, match="at rest at the start"):
        found = read(later, start=[-0.1, 0.2])
    assert found.knots.tolist() == [0.0, 0.25, 0.75, 1.25] and found.notes == ("the arm is at rest at the start",)
    np.testing.assert_allclose(found(np.array([0.0, 0.25, 0.75])), [[-0.1, 0.2], *Q[:2]], rtol=0, atol=1e-15)
    np.testing.assert_allclose(found(np.array([0.0, 0.25, 0.75]), 1), [[0.0, 0.0], *V[:2]], rtol=0, atol=1e-15)
    with pytest.raises(InvalidInput, match=r"^start: expected none, or a first point after 0 s"):
        read(message(), start=[0.0, 0.0])
    with pytest.raises(InvalidInput, match=r"points\[0\]|log.csv, line 2"):
        read("time_from_start,j1,j2\n0.25,0,0\n1,0.1,0.1\n")


# ---------------------------------------------------------------- clocks
UNITS = "t_s;j1 [rad];j2 [rad];dq_j1 [rad/s];dq_j2 [rad/s]"


def table(begin: str = "", comma: bool = False, head: str = "time;j1;j2;dq_j1;dq_j2") -> str:
    times = [f"{begin}{t}" if not begin else begin + f"{t:.9f}"[1:] for t in T[:2]] + ["1.0"]
    rows = [";".join([t, *map(str, [*q, *v])]) for t, q, v in zip(times, Q, V, strict=True)]
    text = "\n".join([head, *rows]) + "\n"
    return text.replace(".", ",") if comma else text


def test_decimal_commas_are_read_and_told(read: Callable[..., Trajectory]) -> None:
    check(read(table()))
    with pytest.warns(AssumptionWarning, match=r"log\.csv: decimal commas") as told:
        found = read(table(comma=True))
    check(found)
    assert (found.notes == ("decimal commas",) and told[0].filename == __file__.replace(".pyc", ".py")) or len(
        told
    ) == 1


@pytest.mark.parametrize("begin", ["70", "-3", "1732600000", "1732600000123456789"])
def test_a_clock_may_begin_at_any_time(read: Callable[..., Trajectory], begin: str) -> None:
    unit = "_ns" if len(begin) > 12 else ""
    step = 1 if not unit else 10**9
    times = [f"{int(begin) + round(t * step)}" if unit else f"{int(begin) + t!r}" for t in T]
    text = f"time{unit},j1,j2\n" + "".join(f"{t},{q[0]},{q[1]}\n" for t, q in zip(times, Q, strict=True))
    with pytest.warns(AssumptionWarning, match="starts at the first time"):
        check(read(text), 0)
    data = {"joint_names": ["j2", "j1"], "times": [float(begin[:10]) + t for t in T], "positions": [q[::-1] for q in Q]}
    with pytest.warns(AssumptionWarning, match="starts at the first time"):
        check(read(json.dumps(data), "log.json"), 0)


def test_times_of_a_clock_since_1970_keep_their_nanoseconds(read: Callable[..., Trajectory]) -> None:
    text = "time,j1,j2\n1732600000.000000001,0,0\n1732600000.000000003,0.1,0\n"
    with pytest.warns(AssumptionWarning):
        np.testing.assert_allclose(read(text).knots, [0.0, 2e-9], rtol=1e-9)


def test_units_are_those_of_the_header(read: Callable[..., Trajectory]) -> None:
    q, v = np.rad2deg(Q).tolist(), np.rad2deg(V).tolist()
    for head in ("t_ms,j1_deg,j2_deg,dq_j1_deg,dq_j2_deg", "t [ms],j1 [deg],J2 (deg),dq_j1 [deg/s],velocity_j2 (°/s)"):
        text = head.replace("velocity_j2", "dq_j2") + "\n"
        text += "".join(f"{1e3 * T[i]},{q[i][0]!r},{q[i][1]!r},{v[i][0]!r},{v[i][1]!r}\n" for i in range(3))
        check(read(text))
    for head, words in (
        ("t,j1_deg,j2", "columns? j2: .*no unit"),
        ("t,j1 [mm],j2", "line 1"),
        ("t [deg],j1,j2", "line 1"),
        ("t,j1 [rad/s],j2 [rad/s]", "line 1"),
    ):
        with pytest.raises(InvalidInput, match=words):
            read(head + "\n0,0,0\n1,1,1\n")


def test_columns_and_joints_of_others_are_named_and_left_out_on_request(read: Callable[..., Trajectory]) -> None:
    text = "time,j1,j2,effort_j1,finger\n0,0,0,1,a\n1,0.3,0.15,1,b\n"
    with pytest.raises(InvalidInput, match=r"line 1: .*; ignore='effort_j1,finger' leaves columns out"):
        read(text)
    assert read(text, ignore="effort_j1, finger")(1.0).tolist() == [0.3, 0.15]
    with pytest.raises(InvalidInput, match=r"^ignore: expected columns of .*: time, j1, j2.*; got 'fingr'"):
        read(text, ignore=["effort_j1", "fingr"])
    hand = message()
    hand["joint_names"] = ["finger", "j2", "j1"]
    for point in hand["points"]:
        for field in ("positions", "velocities"):
            point[field] = [9.0, *point[field][::-1]]
    with pytest.raises(InvalidInput, match="got finger in finger, j2, j1; ignore='finger' leaves joints out"):
        read(hand)
    check(read(hand, ignore="finger"))
    for wrong in ("j1", "thumb"):
        with pytest.raises(InvalidInput, match=r"joint_names|^ignore: expected joints of the file"):
            read(hand, ignore=["finger", wrong])


def test_columns_can_be_named_by_the_caller(read: Callable[..., Trajectory]) -> None:
    rows = "".join(f"{t} {q[0]} {q[1]}\n" for t, q in zip(T, Q, strict=True))
    check(read(rows, columns="t,j1,j2"), 0)
    with pytest.warns(AssumptionWarning, match="decimal commas"):
        check(read(rows.replace(".", ","), columns=["t", "j1", "j2"]), 0)
    with pytest.warns(AssumptionWarning, match=r"the columns zeit,a1,a2 are read as t,j1,j2"):
        check(read("zeit a1 a2\n" + rows, columns="t,j1,j2"), 0)
    with pytest.raises(InvalidInput, match=r"line 1: .*columns='x,y,z,…' names the columns"):
        read(rows)
    with pytest.raises(InvalidInput, match="line 1: expected 4 values, one for each column"):
        read(rows, columns="t,j1,j2,j3")
    with pytest.raises(InvalidInput, match="line 1, column t"):
        read("nan nan NaN\n" + rows, columns="t,j1,j2")


# ---------------------------------------------------------------- joints that turn
WRAPPED = "time,j1,j2\n0,3.12,0\n0.01,3.14,0\n0.02,-3.1231853071795862,0\n0.03,-3.1031853071795862,0\n"


def test_a_joint_that_wraps_is_named_and_unwrapped_on_request(
    read: Callable[..., Trajectory], two: optik.Robot
) -> None:
    with pytest.raises(InvalidInput, match=r"line 4.* a jump of j1 by -6.26319 rad at 0.02 s.* unwrap='j1' removes"):
        read(WRAPPED)
    found = read(WRAPPED, unwrap="j1")
    np.testing.assert_allclose(found(found.knots)[:, 0], [3.12, 3.14, 3.16, 3.18], rtol=0, atol=1e-12)
    assert found.extrema(1).worst[0] == pytest.approx(2.0, abs=1e-9)
    assert read(WRAPPED, unwrap=())(0.02)[0] == -3.1231853071795862
    turned = read("time,j1,j2\n0,0,0\n1,7,0\n")  # more than a turn is meant
    assert turned(1.0)[0] == 7.0
    for wrong in ("j3", ["j1", "x"]):
        with pytest.raises(InvalidInput, match=r"^unwrap: expected joints of j1, j2"):
            read(WRAPPED, unwrap=wrong)
    limited = WRAPPED.replace("j1,j2", "j2,j1").replace(",0\n", ",0.5\n")
    assert read(limited)(0.02)[1] < 0.0  # its certificate states the jump
    assert certify(two, None, read(limited)).worst("velocity")[0] > 100.0


# ---------------------------------------------------------------- the newest rule of ROS 2 for positions
def upsampled(t: Array, q: Array) -> Array:
    """The velocities of fill_cubic_spline_velocities in ros2_controllers, by its equations."""
    n, h = len(t), np.diff(t)
    A, b = np.eye(n), np.zeros((n, q.shape[1]))
    for i in range(1, n - 1):
        A[i, i - 1 : i + 2] = 1 / h[i - 1], 2 * (1 / h[i - 1] + 1 / h[i]), 1 / h[i]
        b[i] = 3 * ((q[i + 1] - q[i]) / h[i] ** 2 + (q[i] - q[i - 1]) / h[i - 1] ** 2)
    return np.asarray(np.linalg.solve(A, b))


def test_splines_through_positions_are_those_of_ros_2(read: Callable[..., Trajectory]) -> None:
    rng = np.random.default_rng(5)
    t, q = np.append(0.0, np.cumsum(rng.uniform(0.1, 0.5, 6))), rng.uniform(-1, 1, (7, 2))
    rows = "".join(f"{x!r},{a!r},{b!r}\n" for x, (a, b) in zip(t.tolist(), q.tolist(), strict=True))
    found = read("t,j1,j2\n" + rows, interpolation="spline")
    np.testing.assert_allclose(found(t), q, rtol=0, atol=1e-14)
    np.testing.assert_allclose(found(t, 1), upsampled(t, q), rtol=0, atol=1e-13)
    s = np.linspace(0.0, t[-1], 50)
    np.testing.assert_allclose(found(s), CubicSpline(t, q, bc_type="clamped")(s), rtol=0, atol=1e-13)
    shifted = "time_from_start,j1,j2\n" + "".join(
        f"{x + 0.5!r},{a!r},{b!r}\n" for x, (a, b) in zip(t, q.tolist(), strict=True)
    )
    with pytest.warns(AssumptionWarning, match="at rest"):
        later = read(shifted.replace("np.float64(", "").replace(")", ""), interpolation="spline", start=[0.2, 0.1])
    np.testing.assert_allclose(later(0.5 + t, 1), upsampled(t, q), rtol=0, atol=1e-12)
    assert read("t,j1,j2\n" + rows).coefficients.shape[0] == 2
    for wrong in ("septic", "cubic", 3):
        with pytest.raises(InvalidInput, match=r"^interpolation: expected one of linear, spline"):
            read("t,j1,j2\n" + rows, interpolation=wrong)


def test_a_saved_motion_is_read_for_an_arm_with_other_names(tmp_path: Path, two: optik.Robot) -> None:
    text = ARM.replace('"j1"', '"a"').replace('"j2"', '"b"')
    other, names = optik.Robot.from_urdf(text), {"a": "j1", "b": "j2"}
    made = plan(two, Q[2], Q[0], limits=MotionLimits(velocity=1.0, acceleration=5.0, jerk=50.0))
    made.save(tmp_path / "exact.csv")
    made.save(tmp_path / "points.csv", rate=100.0)
    for name in ("exact.csv", "points.csv"):
        found = load_trajectory(tmp_path / name, other, joint_names=names)
        np.testing.assert_allclose(found(found.duration), Q[2], rtol=0, atol=1e-9)
        with pytest.raises(InvalidInput, match=r"csv: joint_names: expected those of two, a, b; got j1, j2$"):
            load_trajectory(tmp_path / name, other)
    swapped = {"a": "j2", "b": "j1"}
    found = load_trajectory(tmp_path / "points.csv", other, joint_names=swapped)
    np.testing.assert_allclose(found(found.duration), Q[2][::-1], rtol=0, atol=1e-9)
    with pytest.raises(InvalidInput, match=r"csv: joint_names: expected those of two, j2, j1; got j1, j2$"):
        load_trajectory(tmp_path / "exact.csv", other, joint_names=swapped)


# ---------------------------------------------------------------- what is hostile stays cheap
@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time,j1,j2\n" + "1" * (LONGEST_LINE + 1) + ",0,0\n", "line 2: expected lines of at most"),
        (",".join(f"c{i}" for i in range(MOST_COLUMNS + 1)) + "\n", f"at most {MOST_COLUMNS}"),
        ("time,j1,j2\n1e999,0,0\n2,0,0\n", "line 2, column time"), ("time,j1,j2\n1_0,0,0\n2,0,0\n", "line 2, column time"),
        ("time,j1,j2\n\u0661,0,0\n2,0,0\n", "line 2, column time"),
        ("time,j1,j2\n0,0,0\n1,0,0\n1,0,0\n", "line 4, column time"),
        ("time,j1,j2\n0,0,0\n", "one point"), ("\x00\x00", "line 1"), ("[" * 60_000, "line 1"), ("(" * 60_000 + " ", "line 1"),
        ('a' + '"' * 60_001, "line 1"), (" " * 60_000 + "x", "line 1"), ("time,j1,j2,j1\n", "different columns"),
        ("time,t,j1,j2\n0,0,0,0\n1,1,0,0\n", "expected times, .* ignore='time' or 't' leaves times out"),
        ("time,j1,j2,ddq_j1,ddq_j2\n0,0,0,0,0\n1,0,0,0,0\n", "it has accelerations without velocities: columns='t,j1,j2'"),
    ],
    ids=range(15),
)  # fmt: skip
def test_a_hostile_table_is_refused_in_one_line(read: Callable[..., Trajectory], text: str, words: str) -> None:
    with pytest.raises(InvalidInput, match=words) as caught:
        read(text)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 600 and "log.csv" in str(caught.value)


def test_a_table_is_read_up_to_a_size(tmp_path: Path, two: optik.Robot) -> None:
    with (tmp_path / "log.csv").open("wb") as out:
        out.truncate(MOST_TABLE_BYTES + 1)
    with pytest.raises(InvalidInput, match="more than 64 MB"):
        load_trajectory(tmp_path / "log.csv", two)


@pytest.mark.parametrize("case", range(60))
def test_random_tables_are_read_as_written_or_refused(case: int) -> None:
    row = tables.measure(shift_seed(1000) * 1000 + case)
    assert bool(row["words"]) == bool(row["refused"]), row
    assert all(value.reached for value in tables.judge([row])), row


def test_nothing_is_told_where_nothing_is_assumed(read: Callable[..., Trajectory]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert read(message()).notes == read(table(head=UNITS)).notes == read(table(), unit="s,rad").notes == ()
