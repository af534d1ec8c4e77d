"""The objects around an arm, and the pairs of links and objects that may touch."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from optik import se3
from optik.arm.limits import freeze
from optik.arm.shapes.check import check_excess, check_length, check_point
from optik.arm.shapes.enclosure import Capsule, complete_frame, enclose_cylinder, enclose_mesh, enclose_objects
from optik.card import Card
from optik.check import check_keywords, check_number, check_words, format_value
from optik.errors import InvalidInput, UnknownName
from optik.scene.cloud import check_points, pack_cloud
from optik.scene.distance import check_mesh, find_hull, pack_solids
from optik.scene.files import OBJECT_KINDS, SCENE_KEYS, load_scene, name_object, scene_from_dict, scene_to_dict
from optik.tables import warn_of_assumptions
from optik.types import Array, Flags, content

if TYPE_CHECKING:
    from optik.arm.robot import Robot

SceneArrays: TypeAlias = tuple[Array, Array, Array, Array, Array, Array, Array]
"""A scene as kernels take it: poses (b, 4, 4) and half edges (b, 3) of the boxes, ends a and b (c, 3) and radius (c,) of the
spheres and capsules, points and normals (p, 6) of the planes, and `pack_solids`; all in the base frame [m, 1]."""
LARGEST_OBJECT = 100.0
"""Largest coordinate, edge and radius in a scene [m]: larger values look like millimetres; a floor is a plane."""
MOST_OBJECTS = 100_000
"""Most objects of a scene: their pairs with an arm's capsules fit in memory."""
SHORTEST_CYLINDER = 1e-6
"""Shortest cylinder [m]: the direction of its axis is exact to rounding."""
UNIT_NORMAL = 1e-14
"""A normal whose length differs from 1 by less [1] is kept to the last bit, so that a copy of a scene equals it."""


@check_keywords
@dataclass(frozen=True, eq=False)
class Scene:
    """Objects around an arm, in the frame of its base, in metres; equal by content.

    Parameters
    ----------
    boxes : sequence of (T, edges)
        Pose (4, 4) of the centre and full edge lengths (3,) along its axes [m].
    spheres : sequence of (centre, radius)
        Centre (3,) and radius [m].
    capsules : sequence of (a, b, radius)
        Ends of the segment (3,) and radius [m].
    planes : sequence of (point, normal)
        A point (3,) of the plane [m] and its normal (3,), of any length, to the free side; all points behind it are solid.
    cylinders : sequence of (a, b, radius)
        Centres of both flat ends (3,) and radius [m].
    meshes : sequence of (k, 3) or (k, 3, 3) arrays
        Corners of convex solids [m], whose convex hull is the object; or triangles of convex meshes.
    clouds : sequence of (points, radius)
        Points (k, 3), such as those of a depth camera, and the radius of the ball around each of them [m].
    allow : sequence of (link, object)
        Pairs that are not checked: the name of a link ("base" or the joint that moves it) or of its capsules, and the name
        of an object, such as the base and the table. Every name of a link must exist in the arm.
    names : sequence of str, optional
        One for each object, in the order boxes, spheres, capsules, planes, cylinders, meshes, clouds; by default box1, ….
    excess : scalar or (objects,) array, optional
        Largest distance of each object's surface from the enclosed body, such as a mesh [m]; 0 by default.
    margin : float
        Distance [m] to the objects at or below which the arm counts as in contact; it does not apply between its own links.
    notes : sequence of str
        Assumptions made while reading the scene from a file; not compared, and not saved.

    Raises
    ------
    InvalidInput
        Not poses, points or lengths, a normal of length 0, a mesh that is not convex, lengths in millimetres, an unknown object
        in ``allow``, a margin below 0.
    """

    boxes: tuple[tuple[Array, Array], ...] = ()
    spheres: tuple[tuple[Array, float], ...] = ()
    capsules: tuple[tuple[Array, Array, float], ...] = ()
    planes: tuple[tuple[Array, Array], ...] = ()
    cylinders: tuple[tuple[Array, Array, float], ...] = ()
    meshes: tuple[Array, ...] = ()
    clouds: tuple[tuple[Array, float], ...] = ()
    allow: tuple[tuple[str, str], ...] = ()
    names: tuple[str, ...] = ()
    excess: Array = 0.0  # type: ignore[assignment]
    margin: float = 0.0
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        checks = (_box, _sphere, _capsule, _plane, _cylinder, _mesh, _cloud)
        for kind, check in zip(OBJECT_KINDS, checks, strict=True):
            given = getattr(self, kind)
            if isinstance(given, str) or not isinstance(given, Iterable):
                raise InvalidInput(f"scene.{kind}", format_value(given), f"a list of {kind}")
            object.__setattr__(self, kind, tuple(check(one, f"scene.{kind}[{i}]") for i, one in enumerate(given)))
        counts = [len(getattr(self, kind)) for kind in OBJECT_KINDS]
        if sum(counts) > MOST_OBJECTS:
            raise InvalidInput("scene", f"{sum(counts)} objects", f"at most {MOST_OBJECTS}")
        object.__setattr__(self, "names", _check_names(self.names, counts))
        object.__setattr__(self, "allow", tuple(_check_allow(self.allow, self.names)))
        object.__setattr__(self, "excess", check_excess(self.excess, len(self.names), "scene.excess"))
        margin = check_number(self.margin, "scene.margin", "metres, 0 or more", least=0.0)
        object.__setattr__(self, "margin", margin)
        object.__setattr__(self, "notes", check_words(self.notes, "scene.notes"))

    # ------------------------------------------------------------ identity

    @cached_property
    def _content(self) -> Any:
        return content(tuple(getattr(self, key) for key in SCENE_KEYS))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Scene) and self._content == other._content

    def __hash__(self) -> int:
        return hash(self._content)

    def __reduce__(self) -> tuple[Any, ...]:
        return Scene, tuple(getattr(self, key) for key in SCENE_KEYS)

    def __repr__(self) -> str:
        counts = (f"{len(getattr(self, kind))} {kind}" for kind in OBJECT_KINDS if getattr(self, kind))
        margin = [f"margin {1e3 * self.margin:.4g} mm"] if self.margin else []
        return f"Scene({', '.join([*counts, *margin]) or 'empty'})"

    def _repr_html_(self) -> str:
        """Return the table of objects for a notebook."""
        names, each = iter(self.names), {kind: getattr(self, kind) for kind in OBJECT_KINDS}
        facts = [(kind, ", ".join(next(names) for _ in rows)[:300]) for kind, rows in each.items() if rows]
        return Card(title=repr(self), facts=facts).to_html()

    # ------------------------------------------------------------ files

    @staticmethod
    @check_keywords
    def load(
        file: str | os.PathLike[str],
        *,
        package_dirs: Mapping[str, str | os.PathLike[str]] | Sequence[str | os.PathLike[str]] | None = None,
        robot: Robot | None = None,
    ) -> Scene:
        """Load a scene from a file: TOML, as `optik.scene.files` describes it, JSON of `to_dict`, URDF, or a scene of MoveIt.

        Parameters
        ----------
        file : str or path
            Its name ends in .toml, .json, .urdf, .xml, .yaml, .yml or .scene. The <collision> elements of a URDF are placed
            with every joint at 0, in the frame of the root; STL and OBJ meshes are enclosed by capsules.
        package_dirs : mapping of str to path, or sequence of paths, optional
            For a URDF, folders of meshes besides its own, as of `Robot.from_urdf`.
        robot : Robot, optional
            For a MoveIt scene, the arm. Pairs of ``allow`` with links that it does not have are left out.

        Returns
        -------
        Scene

        Raises
        ------
        InvalidInput
            An unreadable or invalid file.
        RobotModelError
            A URDF that is not a tree, or without <collision>.
        """
        arguments = load_scene(file, package_dirs)
        if robot is not None and Path(file).suffix.lower() in (".yaml", ".yml"):
            known = (*robot.link_names, *(robot.shapes.names if robot.shapes else ()))
            arguments["allow"] = [pair for pair in arguments["allow"] if pair[0] in known]
        try:
            scene = Scene(**arguments)
            if not scene.names and Path(file).suffix.lower() != ".json":
                raise InvalidInput("scene", "no objects", "at least one object")
        except InvalidInput as error:
            where = f"{Path(file).name}: {error.argument}"
            raise InvalidInput(where, error.got, error.expected, advice=error.advice) from None
        warn_of_assumptions(file, scene.notes)
        return scene

    # ------------------------------------------------------------ attached objects

    def without(self, *names: str) -> Scene:
        """Return the scene without some objects, and without the pairs in ``allow`` that name them.

        Parameters
        ----------
        *names : str
            Names of objects.

        Returns
        -------
        Scene

        Raises
        ------
        UnknownName
            No object of that name.
        """
        for name in names:
            if name not in self.names:
                raise UnknownName("object", name, self.names)
        parts: dict[str, Any] = {"margin": self.margin}
        kept, first = [name not in names for name in self.names], 0
        for kind in OBJECT_KINDS:
            rows = getattr(self, kind)
            parts[kind] = tuple(one for one, keep in zip(rows, kept[first:], strict=False) if keep)
            first += len(rows)
        parts["names"] = tuple(name for name in self.names if name not in names)
        parts["allow"] = tuple(pair for pair in self.allow if pair[1] not in names)
        return Scene(**parts, excess=self.excess[kept])

    def attach(self, robot: Robot, name: str, q: ArrayLike, allow: Iterable[str] = ()) -> tuple[Robot, Scene]:
        """Attach an object to the arm's tool at a configuration, as a gripper does.

        Parameters
        ----------
        robot : Robot
            An arm with shapes.
        name : str
            Name of the object, and of its capsules on the arm. Capsules enclose boxes, cylinders, meshes and clouds.
        q : (n,) array
            The configuration at which the gripper closes [rad, m].
        allow : iterable of str
            Names of objects that it may touch, such as the table on which it stands.

        Returns
        -------
        tuple of (Robot, Scene)
            The arm with the object, which is not checked against the last two links, and the scene without it.

        Raises
        ------
        InvalidInput
            An arm without shapes, a plane, or a name that parts of the arm have.
        UnknownName
            No object of that name.
        """
        rest = self.without(name)
        if robot.shapes is None or name in robot.shapes.names:
            got = (
                f"{robot.name!r} without shapes"
                if robot.shapes is None
                else f"{robot.name!r} with a part {name[:60]!r}"
            )
            raise InvalidInput("robot", got, "an arm with shapes, without a part of the object's name")
        T = se3.inverse(robot.frames(robot.configuration(q))[-2])
        shapes = robot.shapes.with_part(name, len(robot.fixed), self._enclose(name), T)
        pairs = tuple((name, other) for other in check_words(allow, "allow"))
        return robot.with_shapes(shapes), replace(rest, allow=(*rest.allow, *pairs))

    def _enclose(self, name: str) -> list[Capsule]:
        """Return the capsules that enclose an object."""
        kinds = [(kind, one) for kind in OBJECT_KINDS for one in getattr(self, kind)]
        kind, one = kinds[self.names.index(name)]
        if kind == "planes":
            raise InvalidInput("name", f"the plane {name[:60]!r}", "an object of finite size")
        if kind == "meshes":
            return enclose_mesh(find_hull(one).triangles)
        if kind == "cylinders":
            a, b, radius = one
            return [enclose_cylinder(radius, float(np.linalg.norm(b - a))).transform(_pose_along(a, b))]
        if kind == "clouds":
            points, radius = one
            low, high = points.min(axis=0) - radius, points.max(axis=0) + radius
            one = se3.pose(p=0.5 * (low + high)), high - low
        return enclose_objects([one], name, np.eye(4))

    # ------------------------------------------------------------ data

    def to_dict(self) -> dict[str, Any]:
        """Return the scene as plain data for JSON; `from_dict` restores it to the last bit."""
        return scene_to_dict({key: getattr(self, key) for key in SCENE_KEYS})

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> Scene:
        """Return the scene that `to_dict` wrote.

        Parameters
        ----------
        data : mapping
            The result of `to_dict`.

        Returns
        -------
        Scene
            Equal to the written one.

        Raises
        ------
        InvalidInput
            Missing or unknown keys, or values that `Scene` refuses.
        """
        return Scene(**scene_from_dict(data))

    # ------------------------------------------------------------ for kernels

    @cached_property
    def arrays(self) -> SceneArrays:
        """The scene as kernels take it: spheres, as capsules with a = b, precede the capsules."""
        rounded = [(centre, centre, radius) for centre, radius in self.spheres] + list(self.capsules)
        columns: tuple[tuple[list[Any], tuple[int, ...]], ...] = (
            ([T for T, _ in self.boxes], (4, 4)),
            ([0.5 * edges for _, edges in self.boxes], (3,)),
            ([a for a, _, _ in rounded], (3,)),
            ([b for _, b, _ in rounded], (3,)),
            ([radius for _, _, radius in rounded], ()),
            ([np.concatenate(plane) for plane in self.planes], (6,)),
        )
        arrays = (freeze(np.array(rows, dtype=np.float64).reshape(-1, *shape), "scene") for rows, shape in columns)
        cylinders = [
            np.append(_pose_along(a, b), (radius, 0.5 * float(np.linalg.norm(b - a))))
            for a, b, radius in self.cylinders
        ]
        parts = [part for points, radius in self.clouds for part in pack_cloud(points, radius)]
        return (*arrays, pack_solids(cylinders, self.meshes, parts))  # type: ignore[return-value]

    def pair_mask(self, robot: Robot) -> Flags:
        """Return which capsules of an arm are checked against which objects: all but the pairs in ``allow``.

        Parameters
        ----------
        robot : Robot
            An arm with shapes.

        Returns
        -------
        (m, objects) array of bool
            One row for each capsule of ``robot.shapes``, one column for each of ``names``.

        Raises
        ------
        InvalidInput
            An arm without shapes.
        UnknownName
            A link in ``allow`` that the arm does not have.
        """
        if robot.shapes is None:
            raise InvalidInput("robot", f"{robot.name!r} without shapes", "an arm with shapes: robot.with_shapes(...)")
        if robot.shapes.unread:
            got = f"{robot.name!r} with {robot.shapes.describe_unread()}"
            raise InvalidInput("robot", got, "an arm whose links all have a shape")
        flags = np.ones((robot.shapes.m, len(self.names)), dtype=np.bool_)
        numbers = {name: i for i, name in enumerate(robot.link_names)}
        for link, other in self.allow:
            capsules = robot.shapes.find_capsules(link)
            if not len(capsules) and link not in numbers:
                known = dict.fromkeys((*robot.link_names, *robot.shapes.names))
                advice = "of a MoveIt scene for another model of the arm: Scene.load(file, robot=robot)"
                raise UnknownName("link in scene.allow", link, known, advice)
            column = self.names.index(other)
            flags[capsules, column] = False
            if link in numbers:
                flags[robot.shapes.find_capsules(numbers[link]), column] = False
        flags.setflags(write=False)
        return flags


# ---------------------------------------------------------------- checks


def _check_parts(value: Any, where: str, count: int, expected: str) -> Sequence[Any]:
    if not isinstance(value, list | tuple) or len(value) != count:
        raise InvalidInput(where, format_value(value), expected)
    return value


def _box(value: Any, where: str) -> tuple[Array, Array]:
    pose, edges = _check_parts(value, where, 2, "(T, edges): a pose (4, 4) and three edge lengths")
    T = freeze(se3.nearest_pose(se3.check_pose(pose, f"{where}: T")), where)
    check_point(T[:3, 3], f"{where}: T", LARGEST_OBJECT)
    lengths = freeze(edges, f"{where}: edges")
    if lengths.shape != (3,) or not (np.isfinite(lengths) & (lengths > 0.0)).all():
        raise InvalidInput(f"{where}: edges", format_value(edges), "three full edge lengths above 0")
    return T, check_point(lengths, f"{where}: edges", LARGEST_OBJECT)


def _sphere(value: Any, where: str) -> tuple[Array, float]:
    centre, radius = _check_parts(value, where, 2, "(centre, radius)")
    return check_point(centre, f"{where}: centre", LARGEST_OBJECT), check_length(
        radius, f"{where}: radius", LARGEST_OBJECT
    )


def _capsule(value: Any, where: str) -> tuple[Array, Array, float]:
    a, b, radius = _check_parts(value, where, 3, "(a, b, radius)")
    ends = [check_point(end, f"{where}: {name}", LARGEST_OBJECT) for end, name in ((a, "a"), (b, "b"))]
    return ends[0], ends[1], check_length(radius, f"{where}: radius", LARGEST_OBJECT)


def _cylinder(value: Any, where: str) -> tuple[Array, Array, float]:
    a, b, radius = _capsule(value, where)
    if not (length := float(np.linalg.norm(b - a))) > SHORTEST_CYLINDER:
        raise InvalidInput(where, f"a length of {length:.6g} m", f"ends more than {SHORTEST_CYLINDER:g} m apart")
    return a, b, radius


def _pose_along(a: Array, b: Array) -> Array:
    """Return the pose of the middle of a segment, with z along it."""
    T, u = np.eye(4), (b - a) / np.linalg.norm(b - a)
    T[:3, :3], T[:3, 3] = np.column_stack([*complete_frame(u), u]), 0.5 * (a + b)
    return T


def _mesh(value: Any, where: str) -> Array:
    return check_mesh(value, where, LARGEST_OBJECT)


def _cloud(value: Any, where: str) -> tuple[Array, float]:
    points, radius = _check_parts(value, where, 2, "(points, radius)")
    thick = check_length(radius, f"{where}: radius", LARGEST_OBJECT)
    return freeze(check_points(points, f"{where}: points", LARGEST_OBJECT), where), thick


def _plane(value: Any, where: str) -> tuple[Array, Array]:
    """Check a plane; return its point and unit normal."""
    point, normal = _check_parts(value, where, 2, "(point, normal)")
    direction = freeze(normal, f"{where}: normal")
    if direction.shape != (3,) or not np.isfinite(direction).all() or not direction.any():
        raise InvalidInput(f"{where}: normal", format_value(normal), "a direction of three numbers, not all 0")
    largest = float(np.abs(direction).max())
    scaled = direction / largest  # avoids overflow of the squares
    length = float(np.linalg.norm(scaled))
    unit = direction if abs(largest * length - 1.0) <= UNIT_NORMAL else scaled / length
    return check_point(point, f"{where}: point", LARGEST_OBJECT), freeze(unit, where)


def _check_names(value: Any, counts: Sequence[int]) -> tuple[str, ...]:
    default = [name_object(kind, i) for kind, count in zip(OBJECT_KINDS, counts, strict=True) for i in range(count)]
    names = check_words(value, "scene.names") or tuple(default)
    if len(names) != len(default) or len(set(names)) != len(names):
        got = f"{len(names)} names, {len(set(names))} different"
        raise InvalidInput("scene.names", got, f"{len(default)} different names, one for each object")
    return names


def _check_allow(value: Any, names: tuple[str, ...]) -> Iterable[tuple[str, str]]:
    expected = "pairs (link, object) of names"
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise InvalidInput("scene.allow", format_value(value), expected)
    for i, pair in enumerate(value):
        link, other = check_words(_check_parts(pair, f"scene.allow[{i}]", 2, expected), f"scene.allow[{i}]")
        if other not in names:
            raise UnknownName(f"object in scene.allow[{i}]", other, names)
        yield link, other
