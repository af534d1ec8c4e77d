"""VAMP's search as a peer of blocks ``[[motion]]``: RRT-Connect and simplification on its own sphere models."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.peers.base import Absent
from benchmarks.peers.models import Solid, list_solids
from optik.arm.robot import Robot
from optik.arm.urdf_writer import roll_pitch_yaw
from optik.errors import NoSolution
from optik.scene import Scene
from optik.types import Array
from planners.search.base import SearchResult, SearchStatus


def find_by_vamp(robot: Robot, scene: Scene, ends: tuple[Array, Array]) -> SearchResult:
    """Return VAMP's simplified path by its default settings; Absent where it is absent or has not this arm."""
    vamp, name = _find_arm(robot)
    arm, search, settings, simplification = vamp.configure_robot_and_planner_with_kwargs(name, "rrtc")
    start, goal = (q.astype(np.float32) for q in ends)
    # A cylinder is the capsule, or else the box around it, as in VAMP's evaluation: an end may be between it and one of them.
    for kind in ("Capsule", "Box"):
        world, random = _make_world(vamp, list_solids(scene), kind), arm.halton()
        if arm.validate(start, world) and arm.validate(goal, world):
            break
    else:
        raise NoSolution("an end is in contact in VAMP's model")
    found = search(start, goal, world, settings, random)
    if not found.solved:
        raise NoSolution("VAMP found no path")
    path = arm.simplify(found.path, world, simplification, random).path.numpy().astype(float)
    path = np.clip(path, robot.limits.lower, robot.limits.upper)  # rounded to single precision
    path[0], path[-1] = ends
    return SearchResult(SearchStatus.FOUND, (path,), found.iterations)


def _find_arm(robot: Robot) -> tuple[Any, str]:
    """Return the package, and the name of its arm with our joints and as many spheres."""
    try:
        import vamp
    except ModuleNotFoundError:
        raise Absent("pip install vamp-planner") from None
    for name in vamp.robots:
        arm = getattr(vamp, name)
        if tuple(arm.joint_names()) == robot.joint_names and robot.shapes and robot.shapes.m == arm.n_spheres():
            return vamp, name
    raise Absent(f"VAMP has no sphere model of {robot.name}")


def _make_world(vamp: Any, solids: list[Solid], around: str) -> Any:
    """Return the objects in VAMP's wording, with the capsule or the box around each cylinder."""
    world = vamp.Environment()
    for kind, sizes, T in solids:
        at, turn = T[:3, 3].tolist(), roll_pitch_yaw(T[:3, :3])
        if kind == "Sphere":
            world.add_sphere(vamp.Sphere(at, *sizes))
        elif kind == "Box" or (kind, around) == ("Cylinder", "Box"):
            edges = sizes if kind == "Box" else [2.0 * sizes[0], 2.0 * sizes[0], sizes[1]]
            world.add_cuboid(vamp.Cuboid(at, turn, [0.5 * edge for edge in edges]))
        else:
            world.add_capsule(vamp.Cylinder(at, turn, *sizes))
    return world
