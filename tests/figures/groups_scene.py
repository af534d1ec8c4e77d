"""Seams of a group among 12 boxes drawn around a collision-free motion that is forgotten: on a table, and held by another arm.

The known motion begins anywhere on the seam's start, so the boxes are often in the way of the motion that is chosen without
them. Oracle: coal at 1 kHz, of both members, the boxes, and between the members.
Measured: 40 of 40 and 20 of 20, none in contact; the boxes are in the way of 53; CPU 0.27 and 0.35 s.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import optik
import planners
from optik import Group, Scene, Shapes, se3
from optik.scene.contact import find_clearances, find_nearest_pairs
from optik.scene.world import chain_in_scene
from planners import Path
from planners.certificate.clearance import clearance
from tests.figures.figure import Row, Value, main
from tests.figures.groups_clock import WITHIN, GroupOracle, limited, sample
from tests.figures.groups_seams import ARMS, make_group, table
from tests.planners.chains import draw_seam, mounted
from tests.planners.contacts import COAL_ERROR, Oracle

ON_TABLE, HELD, BOXES, ROOM = 40, 20, 12, 0.02
"""Seams on a table, and on a piece in the other arm; boxes around each, and their distance from the known motion [m]."""


def of_case(case: int) -> tuple[Group, str, str, float]:
    """The group, the members that hold the seam and follow it, and the size of the seam [m]."""
    if case >= ON_TABLE:
        held, torch = mounted("ur5e", 0.8)
        like = limited("ur5e").limits
        rates = {"velocity": like.velocity, "acceleration": like.acceleration, "jerk": like.jerk}
        return Group(left=held.with_limits(**rates), right=torch.with_limits(**rates)), "left", "right", 0.6
    name, axes = ("ur10e", "ur5e")[case % 2], 2 - (case // 2) % 2
    at, size = ARMS[name]
    column = [(0, (*at[:2], at[2] - 0.6), (*at[:2], at[2] - 0.35), 0.08)]
    shapes = Shapes([*column, (axes, (0.0, 0.0, -0.05), (0.0, 0.0, 0.0), 0.08)])
    arm = make_group(name, axes).members["arm"]
    return Group(arm=arm, table=table(at, axes).with_shapes(shapes)), "table", "arm", size


def known_motion(rng: np.random.Generator, group: Group, frame: str, tool: str, seam: Path) -> Any:
    """A collision-free motion along a seam from a random configuration at its start; None if there is none in some draws."""
    holds, works = group.members[frame], group.members[tool]
    for _ in range(20):
        q = holds.limits.clip(rng.uniform(-np.pi, np.pi, holds.n))
        start = optik.solve_ik(works, holds.fk(q) @ seam.pose(0.0), works.limits.clip(rng.uniform(-2.5, 2.5, works.n)))
        if not start:
            continue
        found = planners.plan(
            group, seam, {frame: q, tool: start.q}, tool=tool, frame=frame, scene=Scene(), resolve="local"
        )
        if found:
            return found
    return None


def draw_boxes(rng: np.random.Generator, group: Group, motion: Any) -> Scene:
    """Boxes near the links of a motion, but not nearer than `ROOM`."""
    joints = group.split(motion.trajectory(np.linspace(0.0, motion.duration, 100)))
    places = np.concatenate(
        [robot.frames(joints[name])[:, :, :3, 3].reshape(-1, 3) for name, robot in group.members.items()]
    )
    boxes: list[Any] = []
    while len(boxes) < BOXES:
        far = rng.normal(size=3)
        centre = rng.choice(places) + rng.uniform(0.1, 0.35) * far / np.linalg.norm(far)
        box = se3.pose(Rotation.random(random_state=rng).as_matrix(), centre), rng.uniform(0.05, 0.25, 3)
        rooms = [
            find_clearances(one, Scene(boxes=[box]), joints[name])[0][:, 0].min() for name, one in group.members.items()
        ]
        boxes += [box] if min(rooms) > ROOM else []
    return Scene(boxes=boxes)


def draw(case: int) -> tuple[Group, str, str, Path, Scene, Any]:
    """A group, the members that hold the seam and follow it, the seam, the boxes and the known motion."""
    rng, (group, frame, tool, size) = np.random.default_rng([case, 585]), of_case(case)
    while True:
        seam = draw_seam(rng, size)
        known = known_motion(rng, group, frame, tool, seam)
        if known is None:
            continue
        scene = draw_boxes(rng, group, known)
        if clearance(chain_in_scene(group, frame, tool, scene), known.chain_plan.trajectory, Scene()).proved:
            return group, frame, tool, seam, scene, known


def least_distance(group: Group, scene: Scene, q: Any) -> float:
    """The least distance by coal at configurations (k, n) of the group [m]; infinite above `WITHIN`."""
    near = [Oracle(robot, scene).near(group.split(q)[name], WITHIN, WITHIN) for name, robot in group.members.items()]
    return min(GroupOracle(group).least(q), *(float(one.min()) for of in near for one in of))


def measure(case: int) -> Row:
    group, frame, tool, seam, scene, known = draw(case)
    usual = planners.plan(group, seam, tool=tool, frame=frame)
    row: Row = {"held": case >= ON_TABLE, "known": known.duration, "in_way": True}
    if usual:
        q = usual.chain_plan.trajectory(np.linspace(0.0, usual.duration, 300))
        row["in_way"] = bool(find_nearest_pairs(chain_in_scene(group, frame, tool, scene), Scene(), q)[0].min() <= 0.0)
    began = time.process_time()
    found = planners.plan(group, seam, tool=tool, frame=frame, scene=scene)
    row |= {"cpu": time.process_time() - began, "solved": bool(found)}
    if not found:
        return row | {"why": f"{found.status}: {found.failure.reason}"[:300]}
    return row | {"T": found.duration, "coal": least_distance(group, scene, sample(found))}


def judge(rows: list[Row]) -> list[Value]:
    out = []
    for words, held in (("on a table", False), ("held", True)):
        some = [row for row in rows if row["held"] is held]
        done = [row for row in some if row["solved"]]
        if not some:
            continue
        way, ratio = sum(row["in_way"] for row in some), [row["T"] / row["known"] for row in done]
        count = f"{len(done)} of {len(some)}, boxes in the way of {way}"
        cpu = [row["cpu"] for row in some]
        touching = sum(row["coal"] < -COAL_ERROR for row in done)
        out += [
            Value(f"{words}: planned", "95 %", count, len(done) >= 0.95 * len(some)),
            Value(f"{words}: in contact by coal", "0", str(touching), not touching),
            Value(f"{words}: CPU [s], T over the known motion's", "shown", f"{np.median(cpu):.2f} (most {max(cpu):.1f}), "
                  f"{np.median(ratio):.3f}", True),
        ]  # fmt: skip
    return out


if __name__ == "__main__":
    main("groups_scene", measure, ON_TABLE + HELD, judge)
