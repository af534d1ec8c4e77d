"""Capsules that enclose the <collision> elements of a URDF, and readers of its STL, OBJ and COLLADA meshes."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any, TypeAlias
from urllib.parse import unquote

import numpy as np

from optik.arm.branches import Axis, find_driver, read_range
from optik.arm.shapes.cache import enclose_once
from optik.arm.shapes.enclosure import Capsule, SweepStep, box_triangles, sweep_capsules
from optik.arm.shapes.hulls import enclose_body, enclose_disc
from optik.arm.shapes.model import Shapes
from optik.arm.urdf_tree import Joint, Tree, check_plain, is_text, joint_origin, origin_pose, read_number, read_triple
from optik.check import check_words
from optik.errors import InvalidInput, RobotModelError
from optik.file_io import read_bytes
from optik.types import Array

# ---------------- readers of STL


MOST_MESH_BYTES = 64 * 2**20
"""Largest mesh that is read [bytes]: its text is parsed in seconds."""
MOST_TRIANGLES = 1_000_000
"""Most triangles of a mesh, as in an STL of `MOST_MESH_BYTES`."""

# Bytes of a binary STL: 80 of text and the number of triangles; normal, three corners and two bytes for each.
STL_HEADER, STL_TRIANGLE = 84, 50

SUFFIXES = (".stl", ".obj", ".dae")
"""Suffixes of meshes that are read."""
COLLADA = ("trimesh", "collada")
"""Modules that read COLLADA."""

PACKAGE_FILE = "package.xml"
"""File in the folder of a ROS package."""
FARTHEST_CORNER = 1e4
"""Largest coordinate in a mesh [m, or its own unit before scaling]."""


Folders: TypeAlias = Mapping[str, str | os.PathLike[str]] | Sequence[str | os.PathLike[str]] | None
"""Folders of ROS packages by their names, or folders that contain packages."""


class MeshFolders:
    """The folders from which meshes of a description may be loaded, subfolders included."""

    def __init__(self, beside: Path | None = None, package_dirs: Folders = None) -> None:
        given = package_dirs or ()
        if isinstance(given, str | bytes) or not isinstance(given, Mapping | Sequence):
            raise InvalidInput("package_dirs", repr(given)[:60], "{package: folder}, or a list of folders")
        folders = list(given.values()) if isinstance(given, Mapping) else list(given)
        for folder in folders:
            if not isinstance(folder, str | os.PathLike) or not Path(folder).is_dir():
                raise InvalidInput("package_dirs", repr(folder)[:120], "folders that exist")
        self._named: dict[str, Path] = {}
        if isinstance(given, Mapping):
            self._named = dict(zip(check_words(given, "package_dirs"), map(Path, folders), strict=True))
        self._roots = [] if isinstance(given, Mapping) else [Path(folder) for folder in folders]
        self._beside = beside

    def file(self, name: str, what: str) -> Path:
        """Find the file of a mesh."""
        scheme, separator, rest = name.partition("://")
        if separator and scheme not in ("package", "model", "file"):
            raise InvalidInput(what, f"the mesh {name[:120]!r}", "a mesh in a file, not a URL")
        if Path(name).suffix.lower() not in SUFFIXES:
            raise InvalidInput(what, f"the mesh {name[:120]!r}", "a mesh in STL, OBJ or COLLADA")
        path = unquote(rest) if separator else name
        if "\0" in path:
            raise InvalidInput(what, f"the mesh {name[:120]!r}", "the name of a file")
        candidates = self._in_packages(path) if scheme in ("package", "model") and separator else self._plain(path)
        outside = False
        for root, candidate in candidates:
            try:
                resolved = candidate.resolve()
                if not resolved.is_relative_to(root.resolve()):
                    outside = True
                elif resolved.is_file():
                    return resolved
            except (OSError, RuntimeError):  # an impossible name, or a cycle of links
                continue
        if outside:
            expected = "a mesh below the folder of the description or below package_dirs"
            raise InvalidInput(what, f"the mesh {name[:120]!r}, which lies elsewhere", expected)
        if scheme in ("package", "model") and separator:
            got = f"{path.partition('/')[0]}/…/{Path(path).name}"[:120]
            raise InvalidInput(what, got, "an existing mesh", advice="package_dirs= finds it")
        raise InvalidInput(what, repr(name[:120]), "an existing mesh")

    def _in_packages(self, path: str) -> list[tuple[Path, Path]]:
        """List roots and files of a path that begins with the name of a package."""
        package, _, inner = path.partition("/")
        found = [(self._named[package], self._named[package] / inner)] if package in self._named else []
        for root in self._roots:
            found.append((root, root / path))
            if package in _list_names(root):
                found.append((root, root / inner))
        if self._beside is not None and (own := find_package(package, self._beside)) is not None:
            found.append((own, own / inner))
        return found

    def _plain(self, path: str) -> list[tuple[Path, Path]]:
        roots = [*([] if self._beside is None else [self._beside]), *self._named.values(), *self._roots]
        found = [(root, root / path) for root in roots]  # an absolute path replaces the root
        above = [] if self._beside is None else _list_above(self._beside)
        return found + [(root, above[0] / path) for root in above if (root / PACKAGE_FILE).is_file()][:1]


def find_package(package: str, beside: Path, given: Iterable[Path] = ()) -> Path | None:
    """Return the folder of a package: first one that is given or in one; then the nearest above a folder or beside these."""
    near = (place for root in (*given, *_list_above(beside)) for place in (root, root / package))
    return next((place for place in near if package in _list_names(place) and package != ".." and place.is_dir()), None)


def _list_above(folder: Path) -> list[Path]:
    """List a folder and those above it, without the root of the file system."""
    return [folder, *folder.parents][:-1]


def _list_names(folder: Path) -> list[str]:
    """List the names of a package in a folder: that of the folder, and that in its package.xml."""
    file = folder / PACKAGE_FILE
    text = read_bytes(file).decode(errors="replace") if file.is_file() else ""
    return [folder.name, *re.findall(r"<name>\s*(\S+?)\s*</name>", text)]


def find_mesh_folders(source: str | os.PathLike[str], package_dirs: Folders | MeshFolders) -> MeshFolders:
    """Return the folders from which meshes of a description may be loaded, subfolders included."""
    if isinstance(package_dirs, MeshFolders):  # those of a xacro file, which comes as text
        return package_dirs
    return MeshFolders(None if is_text(source) else Path(source).absolute().parent, package_dirs)


def read_mesh_bytes(file: Path) -> bytes:
    """Read the content of a mesh's file."""
    expected = f"a mesh of at most {MOST_MESH_BYTES // 2**20} MB"
    return read_bytes(file, argument=f"mesh {file.name!r}", expected=expected, most=MOST_MESH_BYTES)


def read_mesh(file: Path) -> Array:
    """Read the triangles of a mesh."""
    where, content = f"mesh {file.name!r}", read_mesh_bytes(file)
    triangles = {".obj": _obj, ".dae": _collada}.get(file.suffix.lower(), _stl)(content, where)
    if not 1 <= len(triangles) <= MOST_TRIANGLES:
        raise InvalidInput(where, f"{len(triangles):,} triangles", f"1 to {MOST_TRIANGLES:,} triangles")
    if not np.isfinite(triangles).all() or np.abs(triangles).max() > FARTHEST_CORNER:
        raise InvalidInput(where, "NaN, infinity or a coordinate above 1e4", "finite coordinates in metres")
    return triangles


def _stl(content: bytes, where: str) -> Array:
    """Read the triangles of an STL; it is binary if its length fits its number of triangles."""
    if len(content) >= STL_HEADER:
        count = int.from_bytes(content[80:STL_HEADER], "little")
        if len(content) == STL_HEADER + STL_TRIANGLE * count:
            kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
            return np.frombuffer(content, kind, count, STL_HEADER)["corners"].astype(np.float64)
    if not content.lstrip().startswith(b"solid") or b"facet" not in content:
        raise InvalidInput(where, f"{len(content)} bytes that are not a complete STL", "a complete STL")
    numbers = re.findall(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", content)
    if len(numbers) % 3 or len(numbers) != 3 * len(re.findall(rb"\bendfacet\b", content)):
        raise InvalidInput(where, f"{len(numbers)} corners, not three for each facet", "a complete STL")
    return _floats(numbers, where).reshape(-1, 3, 3)


def _obj(content: bytes, where: str) -> Array:
    """Read the triangles of an OBJ; polygons are divided into fans."""
    corners: list[list[bytes]] = []
    faces: list[tuple[int, int, int]] = []
    for line in content.replace(b"\\\n", b" ").splitlines():
        word, *rest = line.split(b"#", 1)[0].split() or [b""]
        if word == b"v":
            if len(rest) < 3:
                raise InvalidInput(where, repr(line[:60]), "three coordinates of a corner")
            corners.append(rest[:3])
        elif word == b"f":
            try:
                face = [int(part.split(b"/")[0]) for part in rest]
            except ValueError:
                raise InvalidInput(where, repr(line[:60]), "numbers of corners") from None
            face = [i - 1 if i > 0 else len(corners) + i for i in face]
            if len(face) < 3 or min(face) < 0 or max(face) >= len(corners):
                raise InvalidInput(where, repr(line[:60]), "a face of three or more corners that are defined before")
            faces += [(face[0], face[i], face[i + 1]) for i in range(1, len(face) - 1)]
    if not faces:
        return np.zeros((0, 3, 3))
    return _floats(corners, where)[np.array(faces, dtype=np.int64)]


def _collada(content: bytes, where: str) -> Array:
    """Read the triangles of a COLLADA file in metres, by its own unit; its upward axis is ignored, as in ROS."""
    if any(find_spec(module) is None for module in COLLADA):
        expected = "the packages trimesh and pycollada: pip install 'optik-toolkit[meshes]'"
        raise InvalidInput(where, "COLLADA, and a package is not installed", expected, advice="a mesh in STL or OBJ")
    import trimesh
    from defusedxml.ElementTree import fromstring

    try:  # what cannot be read is not left out
        unit = fromstring(content, forbid_dtd=True).find("{*}asset/{*}unit")
        scene = trimesh.load_scene(BytesIO(content), file_type="dae", ignore_broken=False)
        scale = 1.0 if unit is None else float(unit.get("meter", "1"))
        return np.asarray(scene.to_mesh().triangles, dtype=np.float64) * scale
    except Exception as error:  # these packages raise many
        words = " ".join(f"{type(error).__name__}: {error}".split())
        raise InvalidInput(where, f"COLLADA that cannot be read ({words[:120]})", "complete COLLADA") from None


def _floats(words: Sequence[Sequence[bytes]], where: str) -> Array:
    try:
        return np.array(words, dtype="S").astype(np.float64).reshape(-1, 3)
    except ValueError as error:
        raise InvalidInput(where, str(error)[:80], "coordinates that are numbers") from None


# ---------------- capsules that enclose the <collision> elements of a URDF


Rows: TypeAlias = list[tuple[int, Array, str]]
"""Links of a chain: number of the arm's link, pose in its frame, and name."""


def read_shapes(tree: Tree, base: str, placed: list[tuple[Joint, Array]], folders: MeshFolders, axis: Axis) -> Shapes:
    """Read the shapes of a chain of links and of the links that branch off it.

    Branches behind fixed joints move with their link. Branches behind movable joints, such as the fingers of a gripper, are
    enclosed for all positions of these joints, so their excess is unknown.
    """
    chain = {base, *(joint.child for joint, _ in placed)}
    carried: dict[str, list[tuple[str, Capsule]]] = {link: [] for link in chain}
    unread: list[tuple[str, str]] = []
    for link in tree.list_below(base):
        if enclosed := _read_own(tree, link, folders, unread):
            carrier, steps, ranges = find_steps(tree, link, chain, axis)
            if steps:
                enclosed = enclose_once(partial(sweep_capsules, enclosed, steps, ranges), enclosed, steps, ranges)
            carried[carrier] += [(link, c) for c in enclosed]
    rows = place_links(base, placed)
    capsules = [(i, name, c.transform(T)) for i, T, link in rows for name, c in carried[link]]
    if not capsules and not unread:
        raise RobotModelError(tree.name, "no <collision> on any link of the chain")
    return Shapes(
        [(i, c.a, c.b, c.radius) for i, _, c in capsules],  # type: ignore[arg-type]
        tuple(name for _, name, _ in capsules),
        excess=np.array([c.excess for *_, c in capsules]),
        source=f"<collision> of URDF {tree.name!r}",
        unread=tuple(unread),
        hulls=tuple(c.hulls for *_, c in capsules) if any(c.hulls for *_, c in capsules) else (),
    )


def place_links(base: str, placed: list[tuple[Joint, Array]]) -> Rows:
    """Return for each link of a chain the number of the arm's link that it belongs to, its pose there, and its name."""
    rows = [(0, np.eye(4), base)]
    for joint, T in placed:
        rows.append((rows[-1][0] + (joint.kind != "fixed"), T, joint.child))
    return rows


def read_surface(tree: Tree, link: str, T: Array, folders: MeshFolders) -> Array:
    """Read the triangles (k, 3, 3) of a link's own meshes at a pose; none if another shape belongs to it."""
    found, where = [np.zeros((0, 3, 3))], f"<collision> of link {link!r}"
    for element in tree.parts(link, "collision"):
        kind, shape = find_geometry(tree, element)
        if kind != "mesh":
            return found[0]
        place = T @ origin_pose(tree.name, where, element.find(f"{tree.prefix}origin"))
        found.append(read_triangles(tree.name, shape, where, folders) @ place[:3, :3].T + place[:3, 3])
    return np.concatenate(found)


def _read_own(tree: Tree, link: str, folders: MeshFolders, unread: list[tuple[str, str]]) -> list[Capsule]:
    """Read the capsules of a link's own <collision> elements, in its frame; append the reason to `unread` if one fails."""
    found = []
    for element in tree.parts(link, "collision"):
        where = f"<collision> of link {link!r}"
        try:
            T = origin_pose(tree.name, where, element.find(f"{tree.prefix}origin"))
            found += [c.transform(T) for c in read_geometry(tree, element, where, folders)]
        except RobotModelError as error:
            unread.append((link, error.problem.removeprefix(f"{where}: ")))
        except InvalidInput as error:
            unread.append((link, str(error).removeprefix(f"{where}: ")))
    return found


def find_steps(tree: Tree, link: str, chain: set[str], axis: Axis) -> tuple[str, list[SweepStep], Array]:
    """Return the link of the chain that carries a link, the joints between them, and the ranges (d, 2) of their drivers."""
    steps: list[SweepStep] = []
    drivers: dict[str, tuple[float, float]] = {}
    while link not in chain:
        joint, T = tree.above[link], joint_origin(tree.name, tree.above[link])
        if joint.kind == "fixed":
            steps.append(SweepStep(T, False, np.array([0.0, 0.0, 1.0]), 0, 0.0, 0.0))
        else:
            driver, factor, offset = find_driver(tree, joint)
            drivers.setdefault(driver.name, read_range(tree.name, driver))
            number, slides = list(drivers).index(driver.name), joint.kind == "prismatic"
            if slides and not np.isfinite(drivers[driver.name]).all():
                problem = f"joint {joint.name!r}: type 'prismatic' without limits: the space of its links is unknown"
                raise RobotModelError(tree.name, problem)
            read_range(tree.name, joint)  # a joint of another type, or crossed limits
            steps.append(SweepStep(T, slides, axis(joint), number, factor, offset))
        link = joint.parent
    ranges = np.array(list(drivers.values())).reshape(-1, 2)
    for i, (low, high) in enumerate(ranges.tolist()):
        moved = [step for step in steps if step.factor and step.driver == i]
        if high - low > 2.0 * np.pi and all(abs(step.factor) == 1.0 and not step.slides for step in moved):
            ranges[i] = -np.pi, np.pi  # one turn is all there is
    return link, steps, ranges


# ---------------------------------------------------------------- geometries


def find_geometry(tree: Tree, element: Any) -> tuple[str, Any]:
    """Return the kind and element of the geometry of a <collision>."""
    outer = element.find(f"{tree.prefix}geometry")
    for child in () if outer is None else outer:
        if isinstance(child.tag, str):  # not a comment
            return child.tag.removeprefix(tree.prefix), child
    return "nothing", None


def read_length(robot: str, where: str, kind: str, shape: Any, name: str) -> float:
    """Return a length of a geometry [m], such as the radius of a sphere."""
    value = read_number(robot, where, shape.get(name, ""), f"{kind} {name}")
    if not 0.0 < value <= FARTHEST_CORNER:
        expected = f"a length above 0 of at most {FARTHEST_CORNER:g} m"
        raise RobotModelError(robot, f"{where}: {kind} {name} {value:.6g}, expected {expected}")
    return value


def read_triangles(robot: str, shape: Any, where: str, folders: MeshFolders) -> Array:
    """Read the triangles (k, 3, 3) of a <mesh> [m]."""
    file, scale = _find_mesh(robot, shape, where, folders)
    return _scale(read_mesh(file), scale)


def _find_mesh(robot: str, shape: Any, where: str, folders: MeshFolders) -> tuple[Path, Array]:
    """Return the file of a <mesh>, and its scale (3,)."""
    scale = read_triple(robot, where, shape.get("scale", "1 1 1"), "mesh scale")
    return folders.file(check_plain(shape.get("filename", "")), where), scale


def _scale(triangles: Array, scale: Array) -> Array:
    with np.errstate(over="ignore"):
        return np.asarray(triangles * scale)


def read_geometry(tree: Tree, element: Any, where: str, folders: MeshFolders) -> list[Capsule]:
    """Enclose the geometry of a <collision> by capsules, in its own frame."""
    kind, shape = find_geometry(tree, element)
    length = partial(read_length, tree.name, where, kind, shape)

    def enclosed(triangles: Array) -> list[Capsule]:
        farthest = float(np.abs(triangles).max())
        if not farthest <= FARTHEST_CORNER:
            problem = f"{where}: the {kind} extends to {farthest:.6g} m, expected at most {FARTHEST_CORNER:g} m"
            raise RobotModelError(tree.name, problem)
        return enclose_body(triangles)

    if kind == "box":
        edges = read_triple(tree.name, where, shape.get("size", ""), "box size")
        if (edges <= 0.0).any():
            raise RobotModelError(tree.name, f"{where}: box size {edges.tolist()}, expected lengths above 0")
        return enclose_once(lambda: enclosed(box_triangles(edges)), edges)
    if kind == "sphere":
        return [Capsule(np.zeros(3), np.zeros(3), length("radius"), 0.0)]
    if kind == "cylinder":
        return enclose_disc(length("radius"), length("length"))
    if kind == "capsule":
        end = np.array([0.0, 0.0, 0.5 * length("length")])
        return [Capsule(-end, end, length("radius"), 0.0)]
    if kind == "mesh":
        file, scale = _find_mesh(tree.name, shape, where, folders)
        return enclose_once(lambda: enclosed(_scale(read_mesh(file), scale)), read_mesh_bytes(file), file.suffix, scale)
    raise RobotModelError(tree.name, f"{where}: {kind[:40]!r}, expected a box, sphere, cylinder, capsule or mesh")
