"""Readers of STL, OBJ and COLLADA meshes, which must lie below given folders."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import TypeAlias
from urllib.parse import unquote

import numpy as np

from optik.arm.urdf_tree import is_text
from optik.check import check_words
from optik.errors import InvalidInput
from optik.file_io import read_bytes
from optik.types import Array

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
                found = candidate.resolve()
                if not found.is_relative_to(root.resolve()):
                    outside = True
                elif found.is_file():
                    return found
            except (OSError, RuntimeError):  # an impossible name, or a cycle of links
                continue
        if outside:
            expected = "a mesh below the folder of the description or below package_dirs"
            raise InvalidInput(what, f"the mesh {name[:120]!r}, which lies elsewhere", expected)
        asked = "; name the folder of its package (package_dirs=, on the command line --package-dir)"
        hint = asked if scheme in ("package", "model") and separator else ""
        raise InvalidInput(what, f"the mesh {name[:120]!r}, which does not exist{hint}", "an existing file")

    def _in_packages(self, path: str) -> list[tuple[Path, Path]]:
        """List roots and files of a path that begins with the name of a package."""
        package, _, inner = path.partition("/")
        found = [(self._named[package], self._named[package] / inner)] if package in self._named else []
        for root in self._roots:
            found.append((root, root / path))
            if root.name == package:
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
