"""Clearance of a plan for the report: over time by its shapes, and the arm's posture at the least distance."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from optik.arm.robot import Robot
from optik.scene import Scene
from optik.scene.contact import BOX, CYLINDER, MESH, ROUND, SELF, find_clearances, find_nearest, find_pairs
from optik.scene.mesh import find_hull
from optik.types import Array
from planners.cell.view.data import find_near_points
from planners.plan import Plan

CLEARANCE_INSTANTS = 501
"""Number of instants of the clearance that are stored for plots; the least value is the certificate's."""


def clearance_frame(planned: Plan) -> pl.DataFrame:
    """Return the least distances over time, by the compiled distances at instants."""
    assert planned.scene is not None
    t = np.linspace(0.0, planned.trajectory.end, CLEARANCE_INSTANTS)
    distances, _ = find_clearances(planned.robot, planned.scene, planned.trajectory(t))
    columns = {
        name: [float(x) if np.isfinite(x) else None for x in distance]
        for name, distance in zip(("scene", "own"), distances.T, strict=True)
    }
    return pl.DataFrame(
        {"t": t, **columns},
        schema_overrides=dict.fromkeys(columns, pl.Float64),
    )


def nearest_picture(planned: Plan) -> dict[str, Any] | None:
    """Return the shapes of the arm and the scene at their least distance; without a scene, those of two links."""
    robot, scene, proof = planned.robot, planned.scene, planned.certificate.clearance
    assert scene is not None and proof is not None and robot.shapes is not None
    closest = proof.scene or proof.own
    if closest is None:
        return None
    q = planned.trajectory(closest.time)
    arm, which = placed(robot, q), find_clearances(robot, scene, q)[1][0, int(proof.scene is None)]
    one, other, kind = find_pairs(robot, scene).bodies[which].tolist()
    box_pose, box_half, a, b, radius, *_ = scene.arrays
    points = nearest_points(arm, scene, one, other, kind)
    clouds = [(p.tolist(), p.tolist(), r, False) for q, r in scene.clouds for p in find_near_points(points[1][None], q)]
    return {
        "law": planned.law, "time": closest.time, "proved": closest.value if np.isfinite(closest.value) else None,
        "found": closest.found, "margin": closest.margin, "pair": list(closest.pair),
        "left_out": [list(pair) for pair in proof.left_out],
        "words": "; ".join(f"{words} {kind.describe()}" for words, kind in proof.kinds.items()),
        "marks": [(kind.time, kind.found) for kind in proof.kinds.values()],
        "points": [p.tolist() for p in points],
        "arm": [
            (p.tolist(), r.tolist(), float(size), i == one or (kind == SELF and i == other))
            for i, (p, r, size) in enumerate(zip(*arm, strict=True))
        ],
        "boxes": [
            (T.tolist(), (2.0 * half).tolist(), kind == BOX and i == other)
            for i, (T, half) in enumerate(zip(box_pose, box_half, strict=True))
        ],
        "rounds": [
            (a[i].tolist(), b[i].tolist(), float(radius[i]), kind == ROUND and i == other)
            for i in range(len(radius))
        ] + clouds,
        "cylinders": [
            (c.tolist(), d.tolist(), r, kind == CYLINDER and i == other) for i, (c, d, r) in enumerate(scene.cylinders)
        ],
        "meshes": [
            (find_hull(corners).edges[:, [0, 1, 2, 9, 10, 11]].tolist(), kind == MESH and i == other)
            for i, corners in enumerate(scene.meshes)
        ],
        "planes": [(p.tolist(), n.tolist()) for p, n in scene.planes],
    }  # fmt: skip


def placed(robot: Robot, q: Array) -> tuple[Array, Array, Array]:
    """Return the capsules of an arm at a configuration."""
    assert robot.shapes is not None
    link, a, b, radius = robot.shapes.capsules
    T = np.concatenate([np.eye(4)[None], robot.frames(q)[:-1]])[link]
    R, p = T[:, :3, :3], T[:, :3, 3]
    return np.einsum("mij,mj->mi", R, a) + p, np.einsum("mij,mj->mi", R, b) + p, radius


def nearest_points(
    arm: tuple[Array, Array, Array], scene: Scene, one: int, other: int, kind: int
) -> tuple[Array, Array]:
    """Return the nearest points of a capsule of the arm and of another body."""
    a, b, radius = arm
    length, place, off = find_nearest((one, other, kind), scene.arrays, np.stack([a, b], axis=1))
    other_radius = {SELF: radius, ROUND: scene.arrays[4]}.get(kind, np.zeros(other + 1))[other]
    toward = -np.array(off) / length if length != 0.0 else np.zeros(3)
    axis = a[one] + place * (b[one] - a[one])
    return axis + radius[one] * toward, axis + (length - other_radius) * toward
