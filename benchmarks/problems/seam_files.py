"""Published seams of CppFlow and TORM among boxes, and of IKLink, read from copies of their repositories.

github.com/jstmn/cppflow has ``cppflow/problems/ARM__PATH.yaml`` with boxes, and the place of a path ``cppflow/paths/PATH.csv``.
github.com/uwgraphics/IKLink has ``input_trajectories/ARM_….csv`` with poses of the tool in the frame of the arm's base.
"""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.problems.tables import of_quaternions
from optik.arm.plain import read_list, read_record, read_vector, read_word
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.file_io import check_suffix, decode_text, parse_yaml, read_bytes
from optik.scene import Scene
from optik.scene.files import read_fields
from optik.se3 import check_pose
from optik.tables import read_cell
from optik.types import Array
from planners.paths.polyline import Polyline
from planners.program.parts import Program

EXPECTED = "a copy of github.com/jstmn/cppflow or uwgraphics/IKLink, or a problem (.yaml) or a trace (.csv) in it"
"""What the key `files` names."""
PLACES = ("cppflow/problems", "problems", "input_trajectories", ".")
"""Folders of a copy, of which the first one with problems or traces counts."""
PROBLEM_KEYS = ("robot", "path_name", "path_offset_frame", "path_xyz_offset", "path_R_offset")
BOX_KEYS = ("x", "y", "z", "roll", "pitch", "yaw", "size_x", "size_y", "size_z")
"""Keys of a problem, and of a box: position [m], angles, which are 0 in all published problems, and edges [m]."""
WORLD, LIFT = "world", "torso_lift_link"
"""Frames in which a path has its place."""
COLUMNS, PATH_HEADERS = 8, ("time,x,y,z,qw,qx,qy,qz", ",0,1,2,3,4,5,6")
TRACE_HEADERS = ("time,target-POS_X,target-POS_Y,target-POS_Z,target-ROT_X,target-ROT_Y,target-ROT_Z,target-ROT_W",)
"""Numbers of a line; first lines of a path, whose quaternions begin with the scalar part, and of a trace, where it is last."""
TORSO = np.array([-0.086875, 0.0, 0.37743])
"""Fetch's torso_lift_link in its base [m], with the lift at 0."""
HAND = Rotation.from_euler("z", 45, degrees=True).as_matrix()
"""Our flange of the Panda in the frame of its hand, which both repositories name."""
BLEND = 2e-3
"""Largest distance of the tool from a pose [m]."""


class SeamModel(NamedTuple):
    """An arm of the files: our name and number of joints, our base in the file's [m], and our flange in the file's."""

    name: str
    joints: int
    base: Array
    flange: Array


MODELS = {
    "panda": SeamModel("panda", 7, np.zeros(3), HAND),
    "fetch": SeamModel("fetch", 8, np.zeros(3), np.eye(3)),
    "fetch_arm": SeamModel("fetch", 7, TORSO, np.eye(3)),
}
"""Arms by their names in the files; fetch_arm begins behind the lift."""


class PublishedSeam(NamedTuple):
    """A seam: its name, the file's name of its arm, poses (k, 4, 4) of the flange in the arm's base [1, m], and boxes."""

    name: str
    robot: str
    poses: Array
    scene: Scene

    @property
    def path(self) -> Polyline | Program:
        """The polyline through the poses, or a program that stops where it reverses."""
        try:
            return Polyline(self.poses, blend=BLEND)
        except InvalidInput:
            return Program.of(self.poses, blend=BLEND)


def find_seam_files(place: Path) -> list[Path]:
    """Return the problems and traces of a folder, or the given one, and the paths that the problems name."""
    found = [place] if place.is_file() else []
    if place.is_dir():
        listed = ([*(place / at).glob("*.yaml"), *(place / at).glob("*.csv")] for at in PLACES)
        found = next((sorted(files) for files in listed if files), [])
    if not found:
        raise InvalidInput("", f"{str(place)!r}, which {'has none' if place.is_dir() else 'does not exist'}", EXPECTED)
    paths = {_path_of(file): file for file in found if check_suffix(file, (".yaml", ".csv"), "") == ".yaml"}
    for path, file in paths.items():
        if not path.is_file():
            raise InvalidInput(
                f"{file}: path_name", f"{path.stem!r}, and {str(path)!r} does not exist", "the name of a path"
            )
    return found + sorted(paths)


def read_seams(files: tuple[str, ...], robot: Robot) -> list[PublishedSeam]:
    """Return the seams of an arm in the files that `find_seam_files` returned."""
    each = [Path(file) for file in files]
    paths = {_path_of(file) for file in each if file.suffix == ".yaml"}
    found = [read_seam(file) for file in each if file not in paths]
    own = [seam for seam in found if MODELS[seam.robot][:2] == (robot.name, robot.n)]
    if not own:
        models = [MODELS[name] for name in sorted({seam.robot for seam in found})]
        expected = ", or ".join(f"{model.name} with {model.joints} joints" for model in models)
        raise InvalidInput("robot", f"{robot.name} with {robot.n} joints", f"an arm of the files: {expected}")
    return own


def read_seam(file: Path) -> PublishedSeam:
    """Read a problem or a trace."""
    if file.suffix == ".csv":
        name = _check_model(file.stem.partition("_")[0], f"{file}: the begin of its name")
        poses = _read_poses(file, TRACE_HEADERS, scalar_first=False)
        poses[:, :3, :3] = poses[:, :3, :3] @ MODELS[name].flange
        return PublishedSeam(file.stem, name, poses, Scene())
    document = _read_problem(file)
    name, frame = _check_model(document["robot"], f"{file}: robot"), document["path_offset_frame"]
    if frame not in (WORLD, LIFT):
        raise InvalidInput(f"{file}: path_offset_frame", repr(frame)[:60], f"{WORLD} or {LIFT}")
    at, (_, _, base, flange) = np.eye(4), MODELS[name]
    where = f"{file}: path_R_offset"
    at[:3, :3] = [read_vector(row, where) for row in read_list(document["path_R_offset"], where, "three rows", 3)]
    at[:3, 3] = read_vector(document["path_xyz_offset"], f"{file}: path_xyz_offset")
    at, poses = check_pose(at, where), _read_poses(_path_of(file), PATH_HEADERS, scalar_first=True)
    poses[:, :3, :3] = poses[:, :3, :3] @ at[:3, :3] @ flange
    poses[:, :3, 3] += at[:3, 3] - base
    if frame == LIFT:
        poses[:, :3, 3] += TORSO
    shift = read_vector(document.get("obstacle_xyz_offset", [0.0, 0.0, 0.0]), f"{file}: obstacle_xyz_offset")
    where = f"{file}: obstacles"
    boxes = [_read_box(box, where) for box in read_list(document.get("obstacles", []), where, "a list of boxes")]
    for T, _ in boxes:
        T[:3, 3] += shift
        T[:3, 3] -= base
    return PublishedSeam(file.stem, name, poses, Scene(boxes=tuple(boxes)))


def _check_model(name: Any, where: str) -> str:
    if not isinstance(name, str) or name not in MODELS:
        raise InvalidInput(where, repr(name)[:60], f"one of {', '.join(MODELS)}")
    return name


def _read_problem(file: Path) -> dict[str, Any]:
    text = decode_text(read_bytes(file), str(file))
    return read_record(
        parse_yaml(text, str(file)), PROBLEM_KEYS, str(file), optional=("obstacle_xyz_offset", "obstacles")
    )


def _path_of(file: Path) -> Path:
    """Return the file of the path that a problem names."""
    name = read_word(_read_problem(file)["path_name"], f"{file}: path_name")
    if Path(name).name != name:
        raise InvalidInput(
            f"{file}: path_name", repr(name)[:60], "the name of a file in the folder paths, without .csv"
        )
    return file.parent.parent / "paths" / f"{name}.csv"


def _read_box(given: Any, where: str) -> tuple[Array, Array]:
    """Return pose and edges of a box, which is a list of mappings of one key each."""
    parts = read_list(given, where, "a box: a list of mappings")
    box = {key: value for part in parts for key, value in read_fields(part, where).items()}
    box = read_record(box, BOX_KEYS, where)
    at, turn, edges = (read_vector([box[key] for key in BOX_KEYS[i : i + 3]], where) for i in (0, 3, 6))
    if turn.any():
        raise InvalidInput(f"{where}: roll, pitch, yaw", turn.tolist(), "0, as in all published problems")
    T = np.eye(4)
    T[:3, 3] = at
    return T, edges


def _read_poses(file: Path, headers: tuple[str, ...], *, scalar_first: bool) -> Array:
    """Return the poses (k, 4, 4) of a table of time, position [m] and quaternion [1]."""
    lines = decode_text(read_bytes(file, argument=str(file)), str(file)).splitlines()
    if not lines or lines[0] not in headers:
        raise InvalidInput(
            f"{file}, line 1", repr(lines[0])[:60] if lines else "nothing", " or ".join(map(repr, headers))
        )
    rows, where = list[list[float]](), [f"{file}, line {number}" for number in range(2, len(lines) + 1)]
    for at, line in zip(where, lines[1:], strict=True):
        rows.append([read_cell(cell) for cell in line.split(",")])
        if len(rows[-1]) != COLUMNS or not all(map(isfinite, rows[-1])):
            raise InvalidInput(at, repr(line)[:60], f"{COLUMNS} numbers: {headers[0]}")
    if len(rows) < 2:
        raise InvalidInput(str(file), f"{len(rows)} poses", "two or more")
    values, poses = np.array(rows), np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, 3], q = values[:, 1:4], values[:, 4:]
    poses[:, :3, :3] = of_quaternions(q if scalar_first else q[:, [3, 0, 1, 2]], where)
    return poses
