"""Clearance of a plan for the report: over time by its shapes, and the arm's posture at the least distance."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from optik.arm.robot import Robot
from optik.distance import segment_box, segment_plane, segment_segment
from optik.scene import Scene
from optik.scene.contact import BOX, PLANE, SELF, find_pairs, rooms_batch
from optik.types import Array, Indices
from planners.certificate.clearance import Clearance
from planners.plan import Plan

CLEARANCE_INSTANTS = 501
"""Number of instants of the clearance that are stored for plots; the least value is the certificate's."""


def clearance_frame(planned: Plan) -> pl.DataFrame:
    """Return the least distances over time, by the compiled distances at instants."""
    assert planned.scene is not None
    robot, scene, t = planned.robot, planned.scene, np.linspace(0.0, planned.trajectory.end, CLEARANCE_INSTANTS)
    assert robot.shapes is not None
    q, bodies = np.ascontiguousarray(planned.trajectory(t)), find_pairs(robot, scene).bodies
    columns = {}
    for name, chosen in (("scene", bodies[:, 2] != SELF), ("own", bodies[:, 2] == SELF)):
        distance, which = np.full(t.size, np.inf), np.empty(t.size, np.int64)
        if chosen.any():
            rooms_batch(
                robot.chain, (robot.shapes.capsules, scene.arrays, bodies[chosen].copy()), q, 0.0, distance, which
            )
        columns[name] = [float(value) if np.isfinite(value) else None for value in distance]
    return pl.DataFrame(
        {"solver": planned.solver, "law": planned.law, "t": t, **columns},
        schema_overrides=dict.fromkeys(columns, pl.Float64),
    )


def nearest_picture(planned: Plan) -> dict[str, Any] | None:
    """Return the shapes of the arm and the scene at their least distance; without a scene, those of two links."""
    robot, scene, proof = planned.robot, planned.scene, planned.certificate.clearance
    assert scene is not None and proof is not None and robot.shapes is not None
    closest = proof.scene or proof.own
    if closest is None:
        return None
    arm = placed(robot, planned.trajectory(closest.time))
    one, other, kind = _nearest_body(arm, scene, find_pairs(robot, scene).bodies, own=proof.scene is None)
    box_pose, box_half, a, b, radius, point, normal = scene.arrays
    return {
        "law": planned.law, "time": closest.time, "proved": closest.value if np.isfinite(closest.value) else None,
        "found": closest.found, "margin": proof.margin, "pair": list(closest.pair), "words": _words(proof),
        "marks": [(kind.time, kind.found) for kind in (proof.scene, proof.own) if kind is not None],
        "points": [p.tolist() for p in nearest_points(arm, scene, one, other, kind)],
        "arm": [
            (p.tolist(), r.tolist(), float(size), i == one or (kind == SELF and i == other))
            for i, (p, r, size) in enumerate(zip(*arm, strict=True))
        ],
        "boxes": [
            (T.tolist(), (2.0 * half).tolist(), kind == BOX and i == other)
            for i, (T, half) in enumerate(zip(box_pose, box_half, strict=True))
        ],
        "rounds": [
            (a[i].tolist(), b[i].tolist(), float(radius[i]), kind not in (BOX, SELF, PLANE) and i == other)
            for i in range(len(radius))
        ],
        "planes": [(p.tolist(), n.tolist()) for p, n in zip(point, normal, strict=True)],
    }  # fmt: skip


def _words(proof: Clearance) -> str:
    """Describe the proved bound and the least distance found, of the scene and of the arm's own links."""
    out = []
    for words, kind in (("to the scene", proof.scene), ("between links", proof.own)):
        if kind is not None:
            proved = f"at least {1e3 * kind.value:.4g} mm is proved" if np.isfinite(kind.value) else "nothing is proved"
            first, second = kind.pair
            out.append(
                f"{words} {proved}, {1e3 * kind.found:.4g} mm found between {first} and {second} at {kind.time:.3f} s"
            )
    return "; ".join(out)


def _nearest_body(arm: tuple[Array, Array, Array], scene: Scene, bodies: Indices, *, own: bool) -> tuple[int, int, int]:
    """Return the nearest pair of the arm and the scene, or of two links."""

    def distance(pair: list[int]) -> float:
        _, off, other_radius = _witness(arm, scene, *pair)
        return float(np.linalg.norm(off)) - float(arm[2][pair[0]]) - other_radius

    one, other, kind = min((pair for pair in bodies.tolist() if (pair[2] == SELF) == own), key=distance)
    return one, other, kind


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
    place, off, other_radius = _witness(arm, scene, one, other, kind)
    length = float(np.linalg.norm(off))
    toward = -off / length if length > 0.0 else np.zeros(3)
    axis = a[one] + place * (b[one] - a[one])
    return axis + radius[one] * toward, axis + (length - other_radius) * toward


def _witness(
    arm: tuple[Array, Array, Array], scene: Scene, one: int, other: int, kind: int
) -> tuple[float, Array, float]:
    """Return the nearest point on a capsule's axis [0 to 1], the vector to it from the other body, and that body's radius."""
    a, b, radius = arm
    p, q = _triple(a[one]), _triple(b[one])
    box_pose, box_half, c, d, sizes, point, normal = scene.arrays
    if kind == BOX:
        _, place, w = segment_box(p, q, box_pose[other], box_half[other])
        return place, np.array(w), 0.0
    if kind == PLANE:
        _, place, w = segment_plane(p, q, point[other], normal[other])
        return place, np.array(w), 0.0
    first, second, size = (a, b, radius) if kind == SELF else (c, d, sizes)
    _, place, w = segment_segment(p, q, _triple(first[other]), _triple(second[other]))
    return place, np.array(w), float(size[other])


def _triple(point: Array) -> tuple[float, float, float]:
    x, y, z = map(float, point)
    return x, y, z
