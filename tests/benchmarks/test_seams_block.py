"""Blocks of seams among boxes: how they are swept or read, both ways along them, and the rows."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.blocks.base import load_kind
from benchmarks.blocks.seams import ROOM, SeamsBlock, draw
from benchmarks.problems.seam_files import PATH_HEADERS, TRACE_HEADERS, find_seam_files, read_seam, read_seams
from benchmarks.records import RunFolder
from benchmarks.report.base import Run
from benchmarks.report.seams import REPORT
from benchmarks.run.session import run_suite
from benchmarks.suite import load_suite
from optik.arm.library import load
from optik.errors import InvalidInput
from optik.scene.contact import find_clearances
from optik.types import Array
from planners import Program
from tests.benchmarks.conftest import solved

SETTINGS: dict[str, Any] = {
    "id": "s", "robot": "paper6r", "boxes": 4, "turn": 2.0, "tilt": 0.4, "poses": 50, "count": 2,
    "limits": {"velocity": 2.0, "acceleration": 10.0, "jerk": 100.0},
}  # fmt: skip
LABELS = ["whole path", "local", "whole path, free", "local, free"]


def test_a_seam_is_swept_by_a_motion_that_is_free_of_contact_and_turns_the_tool() -> None:
    block, arm = SeamsBlock.read(SETTINGS), load("paper6r")
    scene, path, q, f = draw(block, arm, 3, 1)
    assert len(scene.boxes) == 4 and f.shape == (50, 3) and np.abs(f).max(axis=0).max() <= 2.0
    assert find_clearances(arm, scene, q)[0].min() > ROOM
    poses = arm.fk(q)
    poses[:, :3, :3] = poses[:, :3, :3] @ Rotation.from_euler("ZXY", f).inv().as_matrix()
    np.testing.assert_allclose(path.waypoints, poses[[k for k in range(50) if k not in path.dropped]], atol=1e-12)
    again, other = (draw(block, arm, 3, number).q for number in (1, 0))
    assert np.array_equal(again, q) and not np.array_equal(other, q)


def test_freedoms_make_seams_possible_that_are_refused_without(tmp_path: Path) -> None:
    rows = solved("seams", SETTINGS, tmp_path)
    assert rows["method"].to_list() == LABELS * 2 and rows["problem"].to_list() == [0] * 4 + [1] * 4
    assert rows.filter(method="whole path, free")["certified"].all()
    assert not rows.filter(method="local, free")["certified"].any()
    assert rows.select((pl.col("duration").is_not_null() == pl.col("certified")).all()).item()
    assert rows.filter(~pl.col("certified"))["reason"].str.len_chars().min() > 0
    plain = SETTINGS | {"robot": "panda", "turn": 0.0, "tilt": 0.0}
    assert SeamsBlock.read(plain).labels == tuple(LABELS[:2])
    with pytest.raises(InvalidInput, match=r"seams 's': .*shapes"):
        load_kind("seams").prepare(SeamsBlock.read(SETTINGS | {"robot": "kr6"}), 0)


def test_durations_are_compared_with_the_local_way_along_the_same_seam() -> None:
    rows = pl.DataFrame({"method": LABELS * 2, "problem": [0] * 4 + [1] * 4, "duration": [2.0, 4, 3, 2, 5, None, 6, 4]})
    found = load_kind("seams").complete(rows, SeamsBlock.read(SETTINGS))
    assert found["ratio"].to_list() == [0.5, 1.0, 1.5, 1.0, None, None, 1.5, 1.0]


# ---------------------------------------------------------------- published seams

LIMITS = {"velocity": 2.0, "acceleration": 10.0, "jerk": 100.0}
GIVEN: dict[str, Any] = {"id": "s", "robot": "panda", "limits": LIMITS}
BOX = "[x: 0.1, y: 0.7, z: 0.2, roll: 0.0, pitch: 0.0, yaw: 0.0, size_x: 0.1, size_y: 0.2, size_z: 0.3]"
PROBLEM = """
robot: panda
path_name: bent
path_offset_frame: world
path_xyz_offset: [0.1, 0.2, 0.3]
path_R_offset: [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
obstacle_xyz_offset: [0, 0, 0.5]
obstacles: [{box}]
"""


@pytest.fixture
def published(tmp_path: Path) -> tuple[Path, Array]:
    """Copies of both repositories with one seam each, and the poses of our flange along it."""
    arm, u = load("panda"), np.linspace(0.0, 1.0, 20)[:, None]
    q = np.array([0.3, 0.2, 0.1, -1.8, 0.2, 2.0, 0.6]) + u * np.array([0.4, 0.2, -0.2, 0.3, 0.3, -0.2, 0.4])
    flange = arm.fk(q)
    hand = flange[:, :3, :3] @ Rotation.from_euler("z", -45, degrees=True).as_matrix()
    turned = Rotation.from_matrix(hand @ Rotation.from_euler("y", -90, degrees=True).as_matrix())
    place = flange[:, :3, 3] - [0.1, 0.2, 0.3]
    for folder in ("cppflow/cppflow/problems", "cppflow/cppflow/paths", "iklink/input_trajectories"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "cppflow/cppflow/problems/panda__bent.yaml").write_text(PROBLEM.format(box=BOX))
    tables = {
        "cppflow/cppflow/paths/bent.csv": (PATH_HEADERS[0], np.hstack([u, place, turned.as_quat(scalar_first=True)])),
        "iklink/input_trajectories/panda_1.csv": (
            TRACE_HEADERS[0], np.hstack([u, flange[:, :3, 3], Rotation.from_matrix(hand).as_quat()])
        ),
    }  # fmt: skip
    for name, (header, rows) in tables.items():
        np.savetxt(tmp_path / name, rows, delimiter=",", header=header, comments="", fmt="%.17g")
    return tmp_path, flange


def test_a_problem_and_a_trace_have_the_poses_of_our_flange(published: tuple[Path, Array]) -> None:
    folder, flange = published
    for name in ("cppflow", "iklink"):
        files = tuple(map(str, find_seam_files(folder / name)))
        (seam,) = read_seams(files, load("panda"))
        np.testing.assert_allclose(seam.poses, flange, atol=1e-12)
        boxes = [(T[:3, 3].tolist(), list(edges)) for T, edges in seam.scene.boxes]
        assert boxes == ([([0.1, 0.7, 0.7], [0.1, 0.2, 0.3])] if name == "cppflow" else [])
    assert [Path(file).name for file in find_seam_files(folder / "cppflow")] == ["panda__bent.yaml", "bent.csv"]


def test_published_seams_are_planned_both_ways_and_listed_in_the_report(
    published: tuple[Path, Array], tmp_path: Path
) -> None:
    blocks = [GIVEN | {"files": "cppflow"}, GIVEN | {"id": "t", "files": "iklink", "turn": 0.5, "contact": False}]
    (tmp_path / "s.toml").write_text("\n".join(_in_toml(block) for block in blocks))
    suite = load_suite(str(tmp_path / "s.toml"))
    assert [plugin.name for plugin in suite.plugins] == ["panda__bent.yaml", "bent.csv", "panda_1.csv"]
    run = Run(run_suite(suite, tmp_path / "run"))
    first, second = (b.rows for b in run.of("seams"))
    assert first["seam"].to_list() == ["panda__bent"] * 2 and first["method"].to_list() == LABELS[:2]
    assert second["seam"].to_list() == ["panda_1"] * 4 and second["method"].to_list() == LABELS
    assert first["certified"].all() and second["certified"].all()
    assert [table.id for table in REPORT.tables(run)] == ["seams-s", "seams-each-s", "seams-t", "seams-each-t"]
    assert [row["seam"] for row in REPORT.tables(run)[3].rows] == ["panda_1"] * 4
    for name in ("cppflow/cppflow/paths/bent.csv", "s.toml"):
        shutil.move(tmp_path / name, tmp_path / "away")  # a report reads neither files nor the suite
    assert len(REPORT.tables(Run(RunFolder(tmp_path / "run")))) == 4


def test_a_seam_that_reverses_is_a_program_and_has_no_freedoms(published: tuple[Path, Array], tmp_path: Path) -> None:
    file = published[0] / "iklink/input_trajectories/panda_1.csv"
    lines = file.read_text().splitlines()
    file.write_text("\n".join([*lines[:20], *lines[18:1:-1], ""]))
    given = GIVEN | {"files": str(file), "contact": False, "reconfigurations": 1}
    rows = solved("seams", given, tmp_path / "run")
    seam = read_seam(file)
    assert isinstance(seam.path, Program) and rows["certified"].all()
    assert rows["length"].to_list() == [sum(part.goal.end for part in seam.path.parts)] * 2
    with pytest.raises(InvalidInput, match=r"seams 's': turn, tilt: .*panda_1, which reverses"):
        load_kind("seams").prepare(SeamsBlock.read(given | {"turn": 1.0}), 0)


def _in_toml(block: dict[str, Any]) -> str:
    limits = ", ".join(f"{name} = {value}" for name, value in block["limits"].items())
    words = [f"{name} = {json.dumps(value)}" for name, value in block.items() if name != "limits"]
    return "\n".join(["[[seams]]", *words, f"limits = {{ {limits} }}"])


@pytest.mark.parametrize(
    ("file", "old", "new", "said"),
    [
        ("", "", "", r"seams block 's': files: expected a copy of .*CppFlow|cppflow.*; got '.*none', which does not exist"),
        ("problems/panda__bent.yaml", "panda", "iiwa", r"panda__bent\.yaml: robot: expected one of panda, .*; got 'iiwa'"),
        ("problems/panda__bent.yaml", "path_name", "path", r"panda__bent\.yaml: expected known keys; got path_name missing"),
        ("problems/panda__bent.yaml", "bent", "lost", r"path_name: expected the name of a path; got 'lost', .* does not exist"),
        ("problems/panda__bent.yaml", "bent", "../bent", r"path_name: expected the name of a file"),
        ("problems/panda__bent.yaml", "world", "tool", r"path_offset_frame: expected world or torso_lift_link; got 'tool'"),
        ("problems/panda__bent.yaml", "yaw: 0.0", "yaw: 0.1", r"roll, pitch, yaw: expected 0.*; got \[0\.0, 0\.0, 0\.1\]"),
        ("problems/panda__bent.yaml", "[0, 1, 0]", "[0, 2, 0]", r"path_R_offset: expected"),
        ("problems/panda__bent.yaml", "[0.1, 0.2,", "[0.1, x,", r"path_xyz_offset: expected 3 finite numbers; got 'x'"),
        ("paths/bent.csv", "time,x", "t,x", r"bent\.csv, line 1: expected 'time,x,.*; got 't,x,"),
        ("paths/bent.csv", "\n0,", "\n0,0,", r"bent\.csv, line 2: expected 8 numbers"),
        ("paths/bent.csv", "\n1,", "\nnan,", r"bent\.csv, line 21: expected 8 numbers"),
    ],
)  # fmt: skip
def test_wrong_files_give_one_line_that_names_key_value_and_what_is_expected(
    published: tuple[Path, Array], file: str, old: str, new: str, said: str
) -> None:
    folder = published[0] / "cppflow"
    if file:
        place = folder / "cppflow" / file
        assert old in place.read_text()
        place.write_text(place.read_text().replace(old, new))
    given = GIVEN | {"files": str(folder if file else folder / "none")}
    with pytest.raises(InvalidInput, match=said) as caught:
        load_kind("seams").prepare(SeamsBlock.read(given), 0)
    assert "'s': files" in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"files": 3}, r"files: expected a copy of"),
        ({"robot": "ur5e"}, r"robot: expected an arm of the files: panda with 7 joints; got ur5e with 6 joints"),
        ({"poses": 100}, r"files: expected without it.*; got with poses"),
        ({"files": None}, r"count: expected a number of seams, or files; got none"),
    ],
)
def test_keys_that_do_not_fit_the_files_are_refused(published: tuple[Path, Array], more: Any, said: str) -> None:
    given = GIVEN | {"files": str(published[0] / "cppflow")} | more
    with pytest.raises(InvalidInput, match=said):
        load_kind("seams").prepare(SeamsBlock.read({key: x for key, x in given.items() if x is not None}), 0)
