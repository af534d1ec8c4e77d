"""MotionBenchMaker's problems of Baxter's two arms: planned around the obstacles and each other, proved, and how fast.

The environment variable ``MBM`` names a folder with ``baxter.tar.bz2``, ``baxter_spherized.urdf`` and ``baxter.srdf``, as in
github:KavrakiLab/vamp, ``resources/baxter``. Oracle: the URDF's spheres, placed by Pinocchio, against the boxes and cylinders
of the file and each other, at 500 instants. CPU seconds are those of search, law and proof.
Measured: 148 of 148 with free ends of 180 (when the search restarted later), none in contact; a fifth of them: 28 of 28,
CPU 0.48 s (median).
"""

from __future__ import annotations

import time
import warnings
from functools import cache
from itertools import combinations
from typing import Any

import numpy as np
import pinocchio as pin

import planners
from benchmarks.problems.motionbench import read_archive, read_problem
from optik import Group, Robot
from optik.arm.urdf_tree import read_disabled_pairs
from optik.errors import OptikError
from optik.file_io import parse_yaml
from optik.types import Array
from tests.figures.figure import Row, Value, main
from tests.figures.search import folder

KINDS, OF_KIND, INSTANTS, ROUNDING = ("easy", "medium", "hard"), 60, 500, 1e-9
SIDES = ("left", "right")


class Spheres:
    """The spheres of the URDF by Pinocchio: their distances to a scene and between links."""

    def __init__(self) -> None:
        file = str(folder() / "baxter_spherized.urdf")
        self.model = pin.buildModelFromUrdf(file)
        self.data, found = self.model.createData(), pin.buildGeomFromUrdf(self.model, file, pin.GeometryType.COLLISION)
        spheres = found.geometryObjects
        self.joint = np.array([one.parentJoint for one in spheres])
        self.place = np.array([one.placement.translation for one in spheres])
        self.radius = np.array([one.geometry.radius for one in spheres])
        links = [self.model.frames[one.parentFrame].name for one in spheres]
        off = {
            frozenset(pair[:2]) for pair in read_disabled_pairs(folder() / "baxter.srdf", tuple(dict.fromkeys(links)))
        }
        self.moving = self.joint > 0
        before = np.array(self.model.parents)
        pairs = [
            (i, j) for i, j in combinations(range(len(links)), 2)
            if frozenset((links[i], links[j])) not in off
            and (a := self.joint[i]) != (b := self.joint[j]) and a != before[b] and b != before[a]
        ]  # fmt: skip
        self.pairs = np.array(pairs).T

    def least(self, names: tuple[str, ...], q: Array, objects: list[Any]) -> float:
        """The least distance at configurations (k, n) of named joints [m]."""
        at = [self.model.joints[self.model.getJointId(name)].idx_q for name in names]
        full, centres = pin.neutral(self.model), np.empty((len(q), len(self.radius), 3))
        for k, joints in enumerate(q):
            full[at] = joints
            pin.forwardKinematics(self.model, self.data, full)
            for joint in np.unique(self.joint):
                of, T = self.joint == joint, self.data.oMi[int(joint)]
                centres[k, of] = self.place[of] @ T.rotation.T + T.translation
        i, j = self.pairs
        least = float((np.linalg.norm(centres[:, i] - centres[:, j], axis=2) - self.radius[i] - self.radius[j]).min())
        for kind, size, place, turn in objects:
            x = (centres[:, self.moving] - place) @ pin.Quaternion(np.array(turn) / np.linalg.norm(turn)).matrix()
            off = np.abs(x) - 0.5 * np.array(size) if kind == "box" else np.stack(
                [np.hypot(x[..., 0], x[..., 1]) - size[1], np.abs(x[..., 2]) - 0.5 * size[0]], axis=-1
            )  # fmt: skip
            away = np.linalg.norm(np.maximum(off, 0.0), axis=-1) + np.minimum(off.max(axis=-1), 0.0)
            least = min(least, float((away - self.radius[self.moving]).min()))
        return least


@cache
def setting() -> tuple[Group, Spheres]:
    """Both arms, each with the torso, and the spheres."""
    file, arms = folder() / "baxter_spherized.urdf", dict[str, Robot]()
    links = [frame.name for frame in pin.buildModelFromUrdf(str(file)).frames if frame.type == pin.FrameType.BODY]
    for side, other in zip(SIDES, SIDES[::-1], strict=True):
        without = [link for link in links if link.startswith((other, f"{other[0]}_"))]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            arm = Robot.from_urdf(
                file,
                tip=f"{side}_gripper",
                shapes=True,
                without_shape=without,
                name=side,
                srdf=folder() / "baxter.srdf",
            )
        arms[side] = arm.with_limits(acceleration=np.full(arm.n, 5.0), jerk=np.full(arm.n, 50.0))
    return Group(arms), Spheres()


def measure(case: int) -> Row:
    (group, spheres), kind = setting(), KINDS[case % len(KINDS)]
    folder_of, file = f"bookshelf_tall_both_arms_{kind}", folder() / "baxter.tar.bz2"
    number = int(np.random.default_rng([case, 589]).integers(1, 601))
    world = parse_yaml(read_archive(file)[folder_of, number]["scene"], "scene")["world"]["collision_objects"]
    objects = [
        (one["type"], one["dimensions"], np.array(at["position"], float), at["orientation"])
        for body in world for one, at in zip(body["primitives"], body["primitive_poses"], strict=True)
    ]  # fmt: skip
    problems = {name: read_problem(file, folder_of, number, robot) for name, robot in group.members.items()}
    start, goal = ({name: getattr(one, end) for name, one in problems.items()} for end in ("start", "goal"))
    names = tuple(name for robot in group.members.values() for name in robot.joint_names)
    row: Row = {"kind": kind, "number": number}
    row["ends"] = spheres.least(names, np.array([group.stack(start), group.stack(goal)]), objects)
    if row["ends"] <= 0.0:
        return row
    if case == 0:  # compiles
        planners.plan(group, goal, start, scene=problems["left"].scene, avoid=True)
    began = time.process_time()
    try:
        found = planners.plan(group, goal, start, scene=problems["left"].scene, avoid=True)
    except OptikError as error:
        return row | {"solved": False, "why": str(error)[:200]}
    row |= {"cpu": time.process_time() - began, "solved": bool(found), "paths": found.chain_plan.search.paths}
    if not found:
        return row | {"why": f"{found.status}: {found.failure.reason}"[:200]}
    q = found.trajectory(np.linspace(0.0, found.duration, INSTANTS))
    row |= {"T": found.duration, "said": found.chain_plan.freedom.outcome, "proved": found.certificate.clearance.proved}
    return row | {"least": spheres.least(names, q, objects)}


def judge(rows: list[Row]) -> list[Value]:
    free = [row for row in rows if row["ends"] > 0.0]
    done = [row for row in free if row["solved"]]
    for row in free:
        if not row["solved"]:
            print(f"  {row['kind']} {row['number']}: {row['why']}")
    cpu, touching = [row.get("cpu", np.inf) for row in free], sum(row["least"] <= -ROUNDING for row in done)
    proved, said = sum(row["proved"] for row in done), sum("not optimised" in row["said"] for row in done)
    middle, late = np.median(cpu), np.quantile(cpu, 0.9)
    return [
        Value("planned and proved", "99 %", f"{proved} of {len(free)} free ({len(rows)})", proved >= 0.99 * len(free)),
        Value("CPU [s], median", "0.5", f"{middle:.2f} (90 %: {late:.2f}, most {max(cpu):.1f})", bool(middle <= 0.5)),
        Value("in contact by the spheres", "0", str(touching), not touching),
        Value("said that the path is not optimised", "shown", f"{said} of {len(done)}", True),
        Value("duration [s], median", "shown", f"{np.median([row['T'] for row in done]):.2f}", True),
    ]  # fmt: skip


if __name__ == "__main__":
    main("groups_baxter", measure, OF_KIND * len(KINDS), judge, part=0.2)
