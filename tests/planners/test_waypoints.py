"""Waypoints from tables of comma-separated values: every accepted header, and errors that name line and column."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from optik import load
from optik.errors import AssumptionWarning, InvalidInput
from optik.ik import Tolerance
from optik.types import Array
from planners import PointToPoint, Polyline
from planners.paths import ViaPoint

HEAD = "x,y,z\n0,0,0\n"


def table(file: Path, columns: dict[str, Array], order: Array, words: str = "") -> Path:
    """Write columns in an order, with all digits."""
    names = [list(columns)[i] for i in order]
    rows = np.stack([columns[name] for name in names], axis=1)
    text = "\n".join(", ".join(map(repr, map(float, row))) for row in rows)
    file.write_text(f"{words}{', '.join(names)}\n{text}\n", encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("tables")


@given(st.integers(0, 2**32), st.sampled_from(["x,y,z", "X_mm,Y_mm,Z_mm"]),
       st.sampled_from(["", "qx,qy,qz,qw", "Roll,Pitch,Yaw", "roll_deg,pitch_deg,yaw_deg", "i,j,k"]))  # fmt: skip
def test_every_header_gives_the_poses_that_were_written(
    folder: Path, seed: int, position: str, orientation: str
) -> None:
    rng = np.random.default_rng(seed)
    p, first = rng.normal(size=(6, 3)), Rotation.random(random_state=rng)
    turned = first if not orientation else Rotation.from_rotvec(0.5 * rng.normal(size=(6, 3))) * first
    values = {
        "": lambda: np.empty((6, 0)), "qx,qy,qz,qw": lambda: turned.as_quat(),
        "Roll,Pitch,Yaw": lambda: turned.as_euler("ZYX")[:, ::-1],
        "roll_deg,pitch_deg,yaw_deg": lambda: turned.as_euler("ZYX", degrees=True)[:, ::-1],
        "i,j,k": lambda: -turned.as_matrix()[:, :, 2],
    }[orientation]()  # fmt: skip
    scale = 1e3 if "mm" in position else 1.0
    names = [*position.split(","), *filter(None, orientation.split(","))]
    columns = dict(zip(names, np.hstack([scale * p, values]).T, strict=True))
    words = rng.choice(["", "\ufeff", "# by a scanner\n\n"])
    file = table(folder / "poses.csv", columns, rng.permutation(len(names)), str(words))
    found = Polyline.from_csv(file, orientation=first.as_matrix()).waypoints
    np.testing.assert_allclose(found[:, :3, 3], p, rtol=0.0, atol=1e-14)
    if orientation == "i,j,k":
        np.testing.assert_allclose(found[:, :3, 2], turned.as_matrix()[:, :, 2], atol=1e-13)
        before = np.concatenate([first.as_matrix()[None], found[:-1, :3, :3]])
        turn = (Rotation.from_matrix(found[:, :3, :3]) * Rotation.from_matrix(before).inv()).magnitude()
        cosine = (found[:, :3, 2] * before[:, :, 2]).sum(axis=1)  # no rotation about the axis itself
        np.testing.assert_allclose(np.cos(turn), cosine, atol=1e-12)
    else:
        expected = np.broadcast_to(turned.as_matrix(), (6, 3, 3))
        np.testing.assert_allclose(found[:, :3, :3], expected, atol=1e-13)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["no lines", "header"]),
        ("0,0,0\n1,0,0\n", ["line 1", "'0,0,0'"]),
        ("x,y\n0,0\n", ["line 1", "x_mm,y_mm,z_mm"]),
        ("x;y;z\n0,0,0\n", ["line 2", "1 values", "separated by semicolons"]),
        ("x,y,z\n0,4,0,5,0,3\n1,2,3\n", ["line 2", "6 values", "with decimal commas, use another separator"]),
        ('x,y,z\n"1,234",0,0\n1,2,3\n', ["line 2", "'1,234'", "one decimal mark"]),
        ("x;y;z\n0,4;0;0\n0.5;0;0\n", ["line 3", "'0.5'", "one decimal mark"]),
        ("x;y;z\n1.234,5;0;0\n0,5;0;0\n", ["line 2, column x", "'1.234,5'", "a finite number"]),
        ("x_mm,y,z\n0,0,0\n1,1,1\n", ["line 1, columns y,z", "a unit for each of x,y,z"]),
        ("x [deg],y [deg],z [deg]\n0,0,0\n1,1,1\n", ["line 1", "x_mm,y_mm,z_mm"]),
        ("x,y,z\n0,0,0\n400,0,300\n", ["line 3, columns x,y,z", "a coordinate of 400 m", "unit='mm'"]),
        ("x,y,z,rx,ry,rz\n0,0,0,0,180,0\n1,0,0,0,180,0\n", ["line 2, columns rx,ry,rz", "length 180", "at most a turn"]),
        ("x,y,z,nx,ny,nz\n0,0,0,0,0,1\n1,0,0,0,0,0\n", ["line 3, columns nx,ny,nz", "length 0", "not 0"]),
        ('x,y,z\n0,0,"0\n1,1,1\n', ["line 2", "closed quotes"]),
        ("x,y,z,feed\n0,0,0,1\n", ["line 1", "'feed'", "ignore='feed'"]),
        ("x,y,z,x_mm,y_mm,z_mm\n", ["line 1"]),
        ("x,y,z,x\n", ["line 1"]),
        ("x,y,z,i,j,k,qx,qy,qz,qw\n", ["line 1"]),
        ("x,y,z,qx,qy,qz\n", ["line 1", "got 'x,y,z,qx,qy,qz'"]),
        (HEAD + "1,2\n", ["line 3", "3 values, one for each column", "2 values"]),
        (HEAD + "1,2,3,4\n", ["line 3", "4 values"]),
        (HEAD + "\n# a remark\n1,,3\n", ["line 5, column y", "''"]),
        (HEAD + "1,2,nan\n", ["line 3, column z", "'nan'"]),
        (HEAD + "1,2,0x3\n", ["line 3, column z"]),
        (HEAD, ["fewer than two rows", "at least two"]),
        (HEAD + "0,0,0\n", ["equal poses"]),
        ("x,y,z,i,j,k\n0,0,0,0,0,-1\n", ["fewer than two rows"]),
        ("x,y,z,i,j,k\n0,0,0,0,0,-1\n1,0,0,0,0,-1\n", ["line 2, columns i,j,k", "opposite to orientation="]),
        ("x,y,z,i,j,k\n0,0,0,0,0,1\n1,0,0,0,0,-1\n", ["line 3, columns i,j,k", "opposite"]),
        ("x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,1\n1,0,0,0,0,0,0\n", ["line 3, columns qx,qy,qz,qw", "length 0"]),
    ],
)  # fmt: skip
def test_a_wrong_table_is_refused_with_line_and_column(tmp_path: Path, text: str, words: list[str]) -> None:
    file = tmp_path / "wrong.csv"
    file.write_text(text)
    down = np.diag([1.0, -1.0, -1.0])
    with pytest.raises(InvalidInput) as info:
        Polyline.from_csv(file, orientation=down)
    for word in words:
        assert word in str(info.value), str(info.value)


ROWS = [(0.4, 0.0, 0.3), (0.45, 0.05, 0.3), (0.5, 0.05, 0.28)]


def seam(head: str, tail: str, scale: float = 1.0, separator: str = ",") -> str:
    """Write three points, with the same orientation each."""
    lines = [head, *(",".join(f"{scale * x:.9g}" for x in p) + f",{tail}" for p in ROWS)]
    return "\n".join(lines).replace(",", separator) + "\n"


TILT = Rotation.from_euler("ZYX", [30.0, 20.0, 10.0], degrees=True)


@pytest.mark.parametrize(
    ("text", "options", "rotation", "notes"),
    [
        (seam("x,y,z,rx,ry,rz", ",".join(map(str, TILT.as_rotvec()))), {}, TILT, ["rotation vectors"]),
        (seam("X,Y,Z,A,B,C", "30,20,10", 1e3), {}, TILT, ["KUKA", "millimetres"]),
        (seam("X_mm,Y_mm,Z_mm,A,B,C", "30,20,10", 1e3), {}, TILT, ["KUKA"]),
        (seam("X,Y,Z,A,B,C", "30,20,10"), {"unit": "m"}, TILT, ["KUKA"]),
        (seam("x [cm];y [cm];z [cm];yaw [deg];pitch [deg];roll [deg]", "30,20,10", 1e2, ";"), {}, TILT, []),
        (seam("x,y,z,yaw,pitch,roll", ",".join(map(str, np.deg2rad([30, 20, 10])))), {}, TILT, []),
        (seam("x,y,z,nx,ny,nz", "0,0,1"), {}, Rotation.from_euler("x", np.pi), []),
        (seam("x,y,z,i,j,k", "0,0,2.5"), {}, Rotation.from_euler("x", np.pi), ["axes of lengths 2.5 to 2.5"]),
        (seam("x,y,z,feed", "20"), {"ignore": "feed"}, None, []), (seam("a,b,c,d", "20", 1e3), {"columns": "x,y,z,feed",
         "ignore": ["feed"], "unit": "mm"}, None, ["the columns a,b,c,d are read as x,y,z,feed"]),
        (seam("x\ty\tz\tremark", "far away", 1.0, "\t"), {"ignore": "remark"}, None, []),
        (seam("", "1"), {"columns": "x,y,z,n", "ignore": "n"}, None, []),
    ],
)  # fmt: skip
def test_seams_of_other_programs_are_read(
    tmp_path: Path, text: str, options: Any, rotation: Rotation | None, notes: list[str]
) -> None:
    (file := tmp_path / "seam.csv").write_text(text)
    down = np.diag([1.0, -1.0, -1.0])
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        path = Polyline.from_csv(file, orientation=down, **options)
    np.testing.assert_allclose(path.waypoints[:, :3, 3], ROWS, rtol=0, atol=1e-12)
    R = down if rotation is None else rotation.as_matrix()
    np.testing.assert_allclose(path.waypoints[:, :3, :3], [R] * 3, rtol=0, atol=1e-12)
    assert len(path.notes) == len(notes) and all(b in a for a, b in zip(path.notes, notes, strict=True)), path.notes
    assert [type(one.message) for one in told] == [AssumptionWarning] * bool(notes)


def test_a_unit_is_that_of_the_header_or_the_given_one(tmp_path: Path) -> None:
    (file := tmp_path / "seam.csv").write_text(seam("x_mm,y_mm,z_mm,i,j,k", "0,0,1", 1e3))
    assert (
        Polyline.from_csv(file, orientation=np.eye(3)[:, [1, 0, 2]] * [1, 1, -1], unit="mm").waypoints[0, 0, 3] == 0.4
    )
    for unit, words in (
        ("m", r"^unit: expected mm, the unit in .*line 1"),
        ("mile", "the unit of x,y,z: m, mm, cm, in"),
    ):
        with pytest.raises(InvalidInput, match=words):
            Polyline.from_csv(file, orientation=np.eye(3), unit=unit)


def test_points_far_beyond_the_reach_are_refused_with_the_unit(tmp_path: Path) -> None:
    down, robot = np.diag([1.0, -1.0, -1.0]), load("ur5e")  # its wrist is within 0.98 m of the base
    for scale, refused in ((5.0, False), (1e2, True)):
        (file := tmp_path / "seam.csv").write_text(seam("x,y,z,n", "1", scale))
        assert len(Polyline.from_csv(file, orientation=down, ignore="n").waypoints) == 3
        if refused:
            with pytest.raises(
                InvalidInput, match=r"line 2, columns x,y,z: .* within 3.* m of the base; got .* 40 m.*unit='mm'"
            ):
                Polyline.from_csv(file, orientation=down, ignore="n", robot=robot)
        else:
            Polyline.from_csv(file, orientation=down, ignore="n", robot=robot)
    file.write_text(f"{JOINTS},x,y,z\n{STARTS},,,\n,,,,,,30,5,40\n{GOAL},,,\n")
    with pytest.raises(InvalidInput, match=r"line 3, columns x,y,z: .*unit='mm'"):
        PointToPoint.from_csv(load("paper6r"), file)


AXES = "x,y,z,i,j,k\n0,0,0,0,0,1\n1,0,0,0,0,1\n"


@pytest.mark.parametrize("orientation", [None, np.eye(4), 2.0 * np.eye(3), "up"])
@pytest.mark.parametrize("text", [HEAD + "1,0,0\n", AXES])
def test_a_file_without_a_whole_orientation_needs_one(tmp_path: Path, orientation: Any, text: str) -> None:
    file = tmp_path / "points.csv"
    file.write_text(text)
    with pytest.raises(InvalidInput, match=r"^orientation: "):
        Polyline.from_csv(file, orientation=orientation)


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=r"missing\.csv"):
        Polyline.from_csv(tmp_path / "missing.csv")
    with pytest.raises(InvalidInput, match="the path of a CSV file"):
        Polyline.from_csv(3)
    (tmp_path / "bytes.csv").write_bytes(b"x,y,z\n\xff")
    with pytest.raises(InvalidInput, match="UTF-8"):
        Polyline.from_csv(tmp_path / "bytes.csv")


JOINTS, POSE, TOLERANCE = "q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg", "x_mm,y_mm,z_mm", "tolerance_mm,tolerance_deg"
STARTS, GOAL = "20,-35,40,25,50,-30", "60,-25,25,25,70,-30"


def test_joint_waypoints_are_configurations_and_poses_with_tolerances(tmp_path: Path) -> None:
    robot, q = load("paper6r"), np.deg2rad([20.0, -35.0, 40.0, 25.0, 50.0, -30.0])
    over = robot.fk(q) + np.array([[0, 0, 0, -0.05], [0, 0, 0, 0.05], [0, 0, 0, 0.1], [0, 0, 0, 0]])
    rows = f"{STARTS},,,,,\n,,,,,,{','.join(f'{1e3 * x:.9f}' for x in over[:3, 3])},5,3\n40,-30,30,25,60,-30,,,,,\n{GOAL},,,,,"
    file = tmp_path / "cycle.csv"
    file.write_text(f"{JOINTS},{POSE},{TOLERANCE}\n{rows}\n")
    found = PointToPoint.from_csv(robot, file)
    there = np.deg2rad([[40.0, -30.0, 30.0, 25.0, 60.0, -30.0], [60.0, -25.0, 25.0, 25.0, 70.0, -30.0]])
    same = PointToPoint(robot, q, ViaPoint(over, (5e-3, np.deg2rad(3.0))), *there)
    assert [via.tolerance for via in found.vias] == [Tolerance(5e-3, np.deg2rad(3.0)), None]
    np.testing.assert_allclose(found.coefficients, same.coefficients, atol=1e-9)
    file.write_text(f"{POSE},q1,q2,q3,q4,q5,q6\n,,,{','.join(map(str, q))}\n,,,{','.join(map(str, there[1]))}\n")
    np.testing.assert_allclose(PointToPoint.from_csv(robot, file).coefficients[-1], there[1], atol=1e-12)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "got no lines"),
        (f"{POSE}\n1,2,3\n", "q1_deg,…,q6_deg (or q1,…"),
        (f"{JOINTS},q7_deg\n{STARTS},1\n", "'q7_deg'"),
        (f"{JOINTS},tolerance_mm\n{STARTS},1\n", "an orientation or tolerance_mm,tolerance_deg; got"),
        (f"{JOINTS}\n{STARTS}\n", "a start and a goal"),
        (f"{JOINTS},x_mm,y_mm\n{STARTS},,\n{GOAL},,\n", "line 1: expected a header with q1_deg"),
        (f"{JOINTS.replace('q2_deg', 'q2')}\n{STARTS}\n{GOAL}\n", "line 1, column q2: expected a unit for each"),
        (f"{JOINTS}\n{STARTS}\n1,a,1,1,1,1\n", "line 3, column q2"),
        (f"{JOINTS},{POSE}\n,,,,,,1,2,3\n{GOAL},,,\n", "line 2: expected the start, a configuration"),
        (f"{JOINTS},{POSE}\n{STARTS},,,\n{GOAL},1,2,3\n", "line 3: expected a configuration, or a pose"),
        (f"{JOINTS},{POSE}\n{STARTS},,,\n1,,,,,,1,2,3\n", "line 3, column q2: expected numbers in all of"),
        (
            f"{JOINTS},{TOLERANCE}\n{STARTS},1,1\n{GOAL},,\n",
            "line 2: expected the start, a configuration without a tolerance",
        ),
        (f"{JOINTS},{TOLERANCE}\n{STARTS},,\n{GOAL},1,1\n", "line 3: expected the goal, without a tolerance"),
    ],
)
def test_invalid_joint_waypoints_name_line_and_column(text: str, words: str, tmp_path: Path) -> None:
    file = tmp_path / "cycle.csv"
    file.write_text(text)
    with pytest.raises(InvalidInput) as raised:
        PointToPoint.from_csv(load("paper6r"), file)
    assert words in str(raised.value) and "cycle.csv" in str(raised.value)
