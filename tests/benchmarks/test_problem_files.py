"""A user's own poses and motions in a suite: read, refused with file, row and column, recorded, not changed in between."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import optik
from benchmarks.blocks.timing.motions import draw_motion
from benchmarks.blocks.timing.timers import line_rows
from benchmarks.problems.base import SETS, ProblemSet
from benchmarks.records import RunFolder
from benchmarks.run import run_suite
from benchmarks.suite import load_suite
from optik.errors import InvalidInput
from optik.ik import make_solver
from optik.registry import build_method
from planners import Line, MotionLimits, plan
from planners.following.follow import follow
from tests import oracles

HEADER = "x_m,y_m,z_m,qw,qx,qy,qz"
Q = np.deg2rad([[20.0, -35.0, 40.0, 25.0, 50.0, -30.0], [10.0, -30.0, 35.0, 20.0, 40.0, -20.0]])


def numbers(values: Any) -> str:
    return ",".join(repr(float(v)) for v in values)


def quaternions(T: Any) -> Any:
    return Rotation.from_matrix(T[:, :3, :3]).as_quat(scalar_first=True)


def drawn(file: Path, **options: Any) -> ProblemSet:
    return build_method(SETS, "file", "problem set", optik.load("paper6r"), 1, path=str(file), **options)


def table(folder: Path, *, header: str = HEADER, rows: list[str] | None = None, name: str = "poses.csv") -> Path:
    T = oracles.fk(oracles.table("paper6r"), Q)
    rows = [numbers([*p, *q]) for p, q in zip(T[:, :3, 3], quaternions(T), strict=True)] if rows is None else rows
    file = folder / name
    file.write_text("# measured\n" + "\n".join([header, *rows]) + "\n")
    return file


def test_poses_of_quaternions_matrices_and_arrays_are_the_same(tmp_path: Path) -> None:
    T = oracles.fk(oracles.table("paper6r"), Q)
    matrices = ",".join(["x_m,y_m,z_m", *(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))])
    joints = ",".join(f"q{i}_rad" for i in range(1, 7))
    rows = [numbers([*t[:3, 3], *t[:3, :3].ravel(), *(q + 0.01)]) for t, q in zip(T, Q, strict=True)]
    np.savez(tmp_path / "poses.npz", targets=T, starts=Q + 0.01)
    by_matrix = drawn(table(tmp_path, header=f"{matrices},{joints}", rows=rows, name="m.csv"))
    by_array = drawn(tmp_path / "poses.npz")
    by_quaternion = drawn(table(tmp_path), start_deg=[0.0, -30.0, 30.0, 0.0, 30.0, 0.0])
    for found in (by_matrix, by_array, by_quaternion):
        np.testing.assert_allclose(found.targets, T, atol=1e-14)
        assert found.known.all()
    np.testing.assert_array_equal(by_matrix.starts, Q + 0.01)
    np.testing.assert_array_equal(by_array.starts, by_matrix.starts)
    assert list(by_array.group) == ["poses", "poses"]
    np.testing.assert_allclose(by_array.sigma, oracles.smallest(oracles.table("paper6r"), Q), rtol=1e-6)
    assert len(drawn(tmp_path / "poses.npz", starts=["random", "zero"])) == 4


@pytest.mark.parametrize(
    ("header", "row", "says"),
    [
        (HEADER, "0.1,0.3,much,1,0,0,0", r"poses.csv, line 3, column z_m: expected a finite number; got 'much'"),
        (HEADER, "0.1,0.3,nan,1,0,0,0", r"line 3, column z_m"),
        (HEADER, "0.1,0.3,0.2,1,0,0", r"line 3: expected 7 values, .*; got 6 values"),
        (HEADER, "0.1,0.3,0.2,2,0,0,0", r"line 3, columns qw to qz: .*length 2"),
        (HEADER.replace("z_m", "z"), "0.1,0.3,0.2,1,0,0,0", r"header: .*got the column 'z'"),
        (HEADER + ",q1_rad", "0.1,0.3,0.2,1,0,0,0,0.1", r"header: .*got no column 'q2_rad'"),
        (HEADER + ",q1_deg", "0.1,0.3,0.2,1,0,0,0,0.1", r"header: .*got the column 'q1_deg'"),
        ("x_m,y_m,z_m", "0.1,0.3,0.2", r"header: .*qw, qx, qy, qz.*got no column 'r11'"),
    ],
)
def test_a_wrong_table_is_one_line_with_file_row_and_column(tmp_path: Path, header: str, row: str, says: str) -> None:
    with pytest.raises(InvalidInput, match=says) as caught:
        drawn(table(tmp_path, header=header, rows=[row]))
    assert "\n" not in str(caught.value)


def test_files_that_are_none_are_refused(tmp_path: Path) -> None:
    (tmp_path / "broken.npz").write_bytes(b"PK no archive")
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    np.savez(tmp_path / "flat.npz", targets=np.eye(4))
    np.savez(tmp_path / "sheared.npz", targets=2.0 * np.eye(4)[None])
    table(tmp_path, rows=[], name="empty.csv")
    for name in ("broken.npz", "binary.csv", "flat.npz", "sheared.npz", "empty.csv", "none.csv", "poses.txt"):
        with pytest.raises(InvalidInput, match=name):
            drawn(tmp_path / name)


SUITE = """
[[budgets]]
id = "own"
robot = "paper6r"
set = "file"
options = { path = "poses.csv", start_deg = [0, -30, 30, 0, 30, 0] }
budgets = [50]
methods = [{ solver = "dls" }]
"""


def test_a_file_lies_beside_its_suite_and_a_changed_one_does_not_continue_a_run(tmp_path: Path) -> None:
    folder = tmp_path / "suite"
    folder.mkdir()
    (folder / "own.toml").write_text(SUITE)
    with pytest.raises(InvalidInput, match=r"poses.csv"):
        load_suite(str(folder / "own.toml"))
    table(folder)
    done = run_suite(load_suite(str(folder / "own.toml")), tmp_path / "run")  # no --allow-plugins: data is not code
    assert [(row["group"], row["name"]) for row in done.manifest()["plugins"]] == [("files", "poses.csv")]
    rows = done.rows("budgets", "own")
    assert rows["known"].all()
    about = done.read_json("problems/own.json")
    assert about["sha256"] == drawn(folder / "poses.csv", start_deg=[0, -30, 30, 0, 30, 0]).sha256

    (folder / "poses.csv").write_text((folder / "poses.csv").read_text() + "# a note\n")
    with pytest.raises(InvalidInput, match=r"file poses.csv: .*as when the run began"):
        run_suite(load_suite(str(folder / "own.toml")), tmp_path / "run")


def test_a_run_does_not_continue_with_other_problems(tmp_path: Path) -> None:
    table(tmp_path)
    (tmp_path / "own.toml").write_text(SUITE)
    done = run_suite(load_suite(str(tmp_path / "own.toml")), tmp_path / "run")
    done.write_json("problems/own.json", {"sha256": "0" * 64})
    with pytest.raises(InvalidInput, match="SHA-256"):
        run_suite(load_suite(str(tmp_path / "own.toml")), tmp_path / "run")
    assert RunFolder(tmp_path / "run").rows("budgets", "own") is not None


# ---------------------------------------------------------------- motions


@pytest.mark.parametrize(
    ("robot", "kind", "indices"),
    [("paper6r", "arc", (0, 1)), ("paper6r", "seam", (0, 1)), ("panda", "seam", (1,)), ("panda", "joints", (0,))],
)
def test_drawn_motions_are_followed_whole_by_another_way(robot: str, kind: str, indices: tuple[int, ...]) -> None:
    for index in indices:
        drawn = draw_motion(robot, kind, index, seed=3)
        followed = follow(make_solver(drawn.robot, "lm"), drawn.path, drawn.q_start)
        assert followed, followed.failure
        np.testing.assert_allclose(oracles.fk(oracles.table(robot), drawn.q_start), drawn.path(0.0), atol=1e-9)
        ends = drawn.path(np.array([0.0, drawn.path.end]))[:, :3, :3]
        turns = np.abs(ends[0] - ends[1]).max() > 1e-6
        assert turns == (index == 1 or kind == "joints")
        again = draw_motion(robot, kind, index, seed=3)
        np.testing.assert_array_equal(again.q_start, drawn.q_start)
        assert again.path.to_dict() == drawn.path.to_dict()
        assert draw_motion(robot, kind, index, seed=4).path.to_dict() != drawn.path.to_dict()


def test_seams_and_saved_motions_come_from_files(tmp_path: Path) -> None:
    robot = optik.load("paper6r")
    T = robot.fk(Q[0])
    rows = [numbers([*(T[:3, 3] + d), *quaternions(T[None])[0]]) for d in ([0, 0, 0], [-0.05, 0, 0], [-0.05, 0, 0.05])]
    seam = table(tmp_path, rows=rows, name="seam.csv")
    goal = T.copy()
    goal[0, 3] -= 0.05
    made = plan(robot, Line(T, goal), Q[0], limits=MotionLimits(2.0, 10.0, 100.0))
    for name in ("line.json", "line.csv", "line.npz"):
        made.save(tmp_path / name)
    (tmp_path / "own.toml").write_text(
        '[[timing]]\nid = "own"\nrounds = 1\nlimits = [{ velocity = 2.0, acceleration = 10.0, jerk = 100.0 }]\n'
        'laws = [{ law = "optimal" }]\nlines = [\n'
        + "".join(f'  {{ robot = "paper6r", kind = "file", path = "{n}" }},\n' for n in ("seam.csv", "line.csv"))
        + "]\n"
    )
    block = load_suite(str(tmp_path / "own.toml")).of("timing")[0]
    assert block.kinds == ("seam.csv", "line.csv")
    read = draw_motion("paper6r", "file", 0, path=str(seam))
    (row,) = line_rows(block, read)
    assert (row["kind"], row["status"], row["breaks"]) == ("seam.csv", "solved", "")
    assert row["length"] == pytest.approx(0.1, abs=1e-9)
    for name in ("line.json", "line.csv", "line.npz"):
        read = draw_motion("paper6r", "file", 0, path=str(tmp_path / name))
        np.testing.assert_allclose(read.q_start, Q[0], atol=1e-12)
        assert read.path.to_dict() == made.path.to_dict()
    with pytest.raises(InvalidInput, match="paper6r"):
        draw_motion("ur5e", "file", 0, path=str(tmp_path / "line.json"))
    far = table(tmp_path, rows=["5,0,0,1,0,0,0", "5,1,0,1,0,0,0"], name="far.csv")
    with pytest.raises(InvalidInput, match="cannot follow"):
        draw_motion("paper6r", "file", 0, path=str(far))
