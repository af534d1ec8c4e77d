"""The viser scene of a motion: the moving capsules of the arm, and the fixed path, scene, beam and grid."""

from __future__ import annotations

from typing import Any

import numpy as np

from optik.arm.robot import Robot
from optik.types import Array, Indices
from planners.cell.view._data import find_up
from planners.cell.view.show import Show, Track

ARM_COLOURS = ((217, 138, 61), (143, 153, 166))
"""Colours of the links in turn [RGB], those of the page."""
PATH_COLOUR, EXECUTED_COLOUR, LASER_COLOUR = (47, 111, 222), (194, 37, 122), (224, 38, 31)
"""Colours of the path, of the tool's executed path and of the laser beam [RGB], those of the page."""
OBJECT_COLOUR, LEVEL_COLOUR = (93, 138, 120), (190, 196, 204)
"""Colours of the scene and of the grid [RGB]."""
AROUND_CAPSULE = 24
"""Number of corners of a drawn capsule's cross-section."""


class Stage:
    """The arm and its surroundings in a viser server."""

    def __init__(self, server: Any, show: Show) -> None:
        self.server, self.show = server, show
        self.reach = _reach(show)
        up = find_up(show.robot)
        with server.atomic():
            server.scene.reset()
            server.scene.set_up_direction(tuple(up))
            self._surroundings(up)
            self.frames = self._arm()
        self._look(up)
        self.place(show.planned.q[0])

    def place(self, q: Array) -> None:
        """Move the arm to a configuration."""
        if not np.isfinite(q).all():
            return
        with self.server.atomic():
            for frame, T in zip(self.frames, self.show.robot.frames(q), strict=True):
                frame.wxyz, frame.position = _quaternion(T), T[:3, 3]

    # ------------------------------------------------------------ parts

    def _arm(self) -> list[Any]:
        """Add the arm's capsules below the frames of its links; return the moving frames of joints and tool."""
        scene, robot = self.server.scene, self.show.robot
        scene.add_frame("/arm/0", axes_length=0.16 * self.reach, axes_radius=0.004 * self.reach)
        moving = [scene.add_frame(f"/arm/{i + 1}", show_axes=False) for i in range(robot.n)]
        moving.append(scene.add_frame("/arm/tool", axes_length=0.1 * self.reach, axes_radius=0.003 * self.reach))
        for i, (link, a, b, radius) in enumerate(_bodies(robot, self.reach)):
            vertices, faces = capsule_mesh(a, b, radius)
            colour = ARM_COLOURS[link % 2]
            scene.add_mesh_simple(f"/arm/{link}/capsule{i}", vertices, faces, color=colour)
        return moving

    def _surroundings(self, up: Array) -> None:
        """Add grid, path, executed path, beam and scene."""
        show = self.show
        self._lines("/grid", _grid(show.robot, up, self.reach), LEVEL_COLOUR, 1.0)
        self._polyline("/path", show.path, PATH_COLOUR, 5.0)
        if show.executed is not None:
            self._polyline("/executed", tool_points(show.robot, show.executed), EXECUTED_COLOUR, 2.5)
        if show.beam is not None:
            self._polyline("/laser/beam", np.array(show.beam), LASER_COLOUR, 3.0)
            for name, point in show.beam._asdict().items():
                self._ball(f"/laser/{name}", point, 0.012 * self.reach, LASER_COLOUR, 1.0)
                self.server.scene.add_label(f"/laser/{name}/label", {"origin": "laser unit"}.get(name, name))
        self._scene()

    def _scene(self) -> None:
        """Add translucent boxes, spheres, capsules and planes."""
        scene = self.show.scene
        if scene is None:
            return
        add = self.server.scene
        for i, (T, edges) in enumerate(scene.boxes):
            add.add_box(
                f"/scene/box{i}", color=OBJECT_COLOUR, dimensions=tuple(edges), opacity=0.5,
                wxyz=_quaternion(T), position=T[:3, 3],
            )  # fmt: skip
        for i, (centre, radius) in enumerate(scene.spheres):
            self._ball(f"/scene/sphere{i}", centre, radius, OBJECT_COLOUR, 0.5)
        for i, (a, b, radius) in enumerate(scene.capsules):
            vertices, faces = capsule_mesh(a, b, radius)
            add.add_mesh_simple(f"/scene/capsule{i}", vertices, faces, color=OBJECT_COLOUR, opacity=0.5)
        for i, (point, normal) in enumerate(scene.planes):
            x, y = _across(normal)
            corners = [(point @ normal) * normal + 1.2 * self.reach * (u * x + v * y) for u in (-1, 1) for v in (-1, 1)]
            faces = np.array([[0, 1, 3], [0, 3, 2]])
            add.add_mesh_simple(
                f"/scene/plane{i}", np.array(corners), faces, color=OBJECT_COLOUR, opacity=0.25, side="double"
            )

    def _ball(self, name: str, centre: Array, radius: float, colour: tuple[int, int, int], opacity: float) -> None:
        self.server.scene.add_icosphere(name, radius, colour, position=centre, opacity=opacity)

    def _polyline(self, name: str, points: Array, colour: tuple[int, int, int], width: float) -> None:
        self._lines(name, np.stack([points[:-1], points[1:]], axis=1), colour, width)

    def _lines(self, name: str, ends: Array, colour: tuple[int, int, int], width: float) -> None:
        """Add line segments (k, 2, 3) without NaN."""
        ends = ends[np.isfinite(ends).all(axis=(1, 2))]
        if len(ends):
            self.server.scene.add_line_segments(name, ends, colour, thickness=width, thickness_units="screen")

    def _look(self, up: Array) -> None:
        """Place the camera upright beside the path."""
        course = self.show.path[np.isfinite(self.show.path).all(axis=1)]  # a row of NaN is between two paths
        middle = course[len(course) // 2]
        level = middle - (middle @ up) * up
        x, y = _across(up) if np.linalg.norm(level) < 0.01 * self.reach else (level, np.cross(up, level))
        side = x / np.linalg.norm(x) + y / np.linalg.norm(y)
        camera = self.server.initial_camera
        camera.up = up
        camera.look_at = 0.25 * self.reach * up + 0.3 * level
        camera.position = camera.look_at + 1.6 * self.reach * (0.8 * side + 0.5 * up)


def tool_points(robot: Robot, track: Track) -> Array:
    """Return the positions of the tool at the instants of a motion."""
    return np.asarray(robot.fk(track.q)[:, :3, 3], dtype=np.float64)


def capsule_mesh(a: Array, b: Array, radius: float) -> tuple[Array, Indices]:
    """Return the triangles of a capsule, or of a sphere if both ends are one point."""
    length = float(np.linalg.norm(b - a))
    z = (b - a) / length if length > 1e-9 else np.array([0.0, 0.0, 1.0])
    x, y = _across(z)
    quarter = np.linspace(0.0, 0.5 * np.pi, AROUND_CAPSULE // 4 + 1)
    latitude, end = np.concatenate((quarter - 0.5 * np.pi, quarter)), np.repeat([0.0, 1.0], len(quarter))
    turn = np.linspace(0.0, 2.0 * np.pi, AROUND_CAPSULE, endpoint=False)
    ring = np.cos(turn)[:, None] * x + np.sin(turn)[:, None] * y
    out = np.cos(latitude)[:, None, None] * ring + np.sin(latitude)[:, None, None] * z
    vertices = a + end[:, None, None] * (b - a) + radius * out
    k = np.arange(AROUND_CAPSULE)
    near = np.stack([k, np.roll(k, -1), np.roll(k, -1) + AROUND_CAPSULE, k + AROUND_CAPSULE], axis=1)
    quads = (near[None] + AROUND_CAPSULE * np.arange(len(latitude) - 1)[:, None, None]).reshape(-1, 4)
    return vertices.reshape(-1, 3), np.concatenate((quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]))


def _bodies(robot: Robot, reach: float) -> list[tuple[int, Array, Array, float]]:
    """Return link, ends and radius of the drawn capsules of the arm, or of thin ones between the joint frames."""
    if robot.shapes is not None:
        return [(int(link), a, b, float(radius)) for link, a, b, radius in zip(*robot.shapes.capsules, strict=True)]
    fixed, prismatic, tool = robot.chain
    nothing, thin = np.zeros(3), 0.008 * reach
    bodies: list[tuple[int, Array, Array, float]] = []
    ends = [*(T[:3, 3] for T in fixed), tool[:3, 3]]
    lower, upper = robot.limits.lower, robot.limits.upper
    for i in np.flatnonzero(prismatic):  # a prismatic joint is drawn as a rod of its largest travel
        bodies.append((int(i) + 1, nothing, np.array([0.0, 0.0, -max(lower[i], upper[i], key=abs)]), thin))
    bodies += [(i, nothing, end, thin) for i, end in enumerate(ends)]
    return bodies + [(i, nothing, nothing, 2.0 * thin) for i in range(robot.n + 1)]


def _reach(show: Show) -> float:
    """Return the largest distance of the drawn arm and path from the base [m]."""
    instants = show.planned.q[:: max(1, len(show.planned.q) // 25)]
    far = np.linalg.norm(show.robot.frames(instants)[..., :3, 3], axis=-1).max()
    return float(max(0.05, far, np.nanmax(np.linalg.norm(show.path, axis=1), initial=0.0)))


def _grid(robot: Robot, up: Array, reach: float) -> Array:
    """Return the lines (k, 2, 3) of a level grid under the base, a tenth of the reach apart [m]."""
    foot = 0.0
    if robot.shapes is not None:
        _, *ends, radius = (column[robot.shapes.capsules[0] == 0] for column in robot.shapes.capsules)
        foot = min(0.0, *(float(np.min(end @ up - radius, initial=0.0)) for end in ends))
    x, y = _across(up)
    steps = 0.1 * reach * np.arange(-12, 13)
    far = steps[-1]
    rows = [[s * u - far * v, s * u + far * v] for s in steps for u, v in ((x, y), (y, x))]
    return np.array(rows) + foot * up


def _across(z: Array) -> tuple[Array, Array]:
    """Return two directions that are perpendicular to a direction and to each other."""
    x = np.cross(z, np.eye(3)[int(np.abs(z).argmin())])
    x /= np.linalg.norm(x)
    return x, np.cross(z, x)


def _quaternion(T: Array) -> Array:
    """Return the rotation of a pose as a quaternion (w, x, y, z) for viser."""
    from viser.transforms import SO3

    return np.asarray(SO3.from_matrix(T[:3, :3]).wxyz, dtype=np.float64)
