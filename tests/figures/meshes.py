"""Arms with the meshes of their makers: how much of their space is free, motions among boxes, and the time to load them.

``ARMS`` names a folder with ``urdf/NAME.urdf`` for each arm below, and their ROS packages anywhere in it. No arm has an SRDF.
Pinocchio reads the URDF and its meshes, and coal judges contact of the triangles: of pairs of links that optik examines, in
random configurations and at 500 Hz of every motion. The same motions are planned with the capsules alone, and with the pairs
of links left out whose capsules touch in any sampled configuration, in turn, to compare the computing time. Joints
beside the arm are held where Pinocchio leaves them. Motions that do not exist are not asked: those that would lead two links
with one or two joints between them through contact, on a grid of 3°.
"""

from __future__ import annotations

import os
import tempfile
import time
import warnings
import xml.etree.ElementTree as ElementTree
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import label

import planners
from optik import Robot, Scene, Shapes, se3
from optik.scene.contact import SELF, find_nearest_pairs, find_pairs
from optik.types import Array, Flags
from planners import MotionLimits
from tests.figures.figure import Row, Value, main

SEED, CONFIGURATIONS, MOTIONS, BOXES, RATE, STEP = 20261129, 300, 20, 6, 500.0, np.radians(3.0)
TIPS = {
    "irb120": "tool0", "irb1200": "tool0", "irb2600": "tool0", "irb4600": "tool0", "crx5ia": "flange",
    "lrmate200id7l": "flange", "m710ic_50": "flange", "gp8": "tool0", "hc10": "tool0", "hc20": "tool0", "ma2010": "tool0",
    "sia10f": "link_tool0", "kr10r1420": "tool0", "kr210l150": "tool0", "kr3r540": "tool0", "tx60l": "tool0",
    "tx2_90": "tool0", "xarm6g": "link_tcp", "tm12": "flange", "elfin5": "elfin_end_link", "aubo_i5": "wrist3_Link",
    "jaka_zu5": "Link_6", "niryo_one": "tool_link", "piper": "link6", "openarm": "openarm_hand_tcp", "z1": "link06",
    "vx300s": "vx300s/ee_gripper_link", "sawyer": "right_hand",
}  # fmt: skip
"""The arms, and the tip of each."""


@cache
def packages() -> dict[str, str]:
    """Folders of the ROS packages, by the names in their package.xml."""
    files = sorted(Path(os.environ["ARMS"]).rglob("package.xml"))
    return {str(ElementTree.parse(file).findtext("name")).strip(): str(file.parent) for file in files}


@cache
def linked_packages() -> tempfile.TemporaryDirectory[str]:
    """A folder in which each package has its own name, as Pinocchio asks."""
    folder = tempfile.TemporaryDirectory()
    for name, package in packages().items():
        Path(folder.name, name).symlink_to(package)
    return folder


def load(name: str) -> Robot:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        file = f"{os.environ['ARMS']}/urdf/{name}.urdf"
        own = Robot.from_urdf(file, tip=TIPS[name]).joint_names
        with_range = [(joint, joint.find("limit")) for joint in ElementTree.parse(file).iter("joint")]
        beside = {
            str(joint.get("name")): 0.0
            for joint, limit in with_range
            if joint.get("type") in ("revolute", "prismatic") and joint.find("mimic") is None and limit is not None
            and joint.get("name") not in own and float(limit.get("lower", 0)) <= 0.0 <= float(limit.get("upper", 0))
        }  # fmt: skip
        return Robot.from_urdf(file, tip=TIPS[name], shapes=True, package_dirs=packages(), values=beside)


class Judge:
    """The triangles of an arm's links, and the boxes around it, by Pinocchio and coal."""

    def __init__(self, robot: Robot, name: str) -> None:
        import coal
        import pinocchio as pin

        self._coal, self._pin, self._robot = coal, pin, robot
        file, folders = f"{os.environ['ARMS']}/urdf/{name}.urdf", [linked_packages().name]
        self._model = pin.buildModelFromUrdf(file)
        self._geometry = pin.buildGeomFromUrdf(self._model, file, pin.GeometryType.COLLISION, package_dirs=folders)
        self._data, self._places = self._model.createData(), pin.GeometryData(self._geometry)
        self._columns = [self._model.joints[self._model.getJointId(j)].idx_q for j in robot.joint_names]
        self._turns = [self._model.joints[self._model.getJointId(j)].nq == 2 for j in robot.joint_names]
        self._links: dict[str, list[int]] = {}
        for i, shape in enumerate(self._geometry.geometryObjects):
            self._links.setdefault(self._model.frames[shape.parentFrame].name, []).append(i)
        pairs = find_pairs(robot, Scene()).names
        self._own = [pair for pair in dict.fromkeys(pairs) if self._links.keys() >= {*pair}]

    def _list_between(self, pair: tuple[str, str]) -> list[int]:
        """List the arm's joints on which the place of one link in the other depends."""
        first, other = (
            {*self._model.supports[self._geometry.geometryObjects[self._links[link][0]].parentJoint]} for link in pair
        )
        names = [self._model.names[joint] for joint in first ^ other]
        return sorted(self._robot.joint_names.index(name) for name in names if name in self._robot.joint_names)

    @cache  # noqa: B019 # one judge for each arm
    def _label(self, pair: tuple[str, str]) -> tuple[list[int], list[Array], Array]:
        """Return one or two joints between two links, a grid of their values, and its parts where the links are apart."""
        joints, limits = self._list_between(pair), self._robot.limits
        grid = [
            np.linspace(limits.lower[i], limits.upper[i], 1 + round((limits.upper - limits.lower)[i] / STEP))
            for i in joints
        ]
        q = np.repeat(limits.middle[None], np.prod([len(x) for x in grid], dtype=int), axis=0)
        q[:, joints] = np.stack(np.meshgrid(*grid, indexing="ij"), axis=-1).reshape(len(q), -1)
        apart = np.array([not self._touches(x, [pair]) for x in q]).reshape([len(x) for x in grid])
        return joints, grid, label(apart, np.ones((3,) * len(grid)))[0]

    def parts(self, a: Array, b: Array) -> bool:
        """Whether no motion leads from a to b: two links, with one or two joints between, would have to touch."""
        for pair in self._own:
            if 1 <= len(self._list_between(pair)) <= 2:
                joints, grid, parts = self._label(pair)
                one, other = (
                    parts[tuple(np.abs(x - q[i]).argmin() for x, i in zip(grid, joints, strict=True))] for q in (a, b)
                )
                if one and other and one != other:
                    return True
        return False

    def _place(self, q: Array) -> None:
        x = self._pin.neutral(self._model)
        for column, turns, value in zip(self._columns, self._turns, q.tolist(), strict=True):
            x[column : column + 1 + turns] = (np.cos(value), np.sin(value)) if turns else value
        self._pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._places, x)

    def _touch(self, i: int, other: Any, place: Any) -> bool:
        T = self._places.oMg[i]
        here = self._coal.Transform3s(T.rotation.copy(), T.translation.copy())
        shape = self._geometry.geometryObjects[i].geometry
        return bool(
            self._coal.collide(shape, here, other, place, self._coal.CollisionRequest(), self._coal.CollisionResult())
        )

    def _touches(self, q: Array, pairs: list[tuple[str, str]]) -> bool:
        """Place the links, and return whether one of the pairs touches."""
        self._place(q)
        for one, other in pairs:
            for j in self._links[other]:
                T = self._places.oMg[j]
                there = self._coal.Transform3s(T.rotation.copy(), T.translation.copy())
                if any(self._touch(i, self._geometry.geometryObjects[j].geometry, there) for i in self._links[one]):
                    return True
        return False

    def is_free(self, q: Array, scene: Scene) -> bool:
        """Whether no examined pair of links touches, and no moving link touches a box."""
        if self._touches(q, self._own):
            return False
        moving = {n for n, k in zip(self._robot.shapes.names, self._robot.shapes.capsules[0], strict=True) if k > 0}  # type: ignore[union-attr]
        for T, edges in scene.boxes:
            place = self._coal.Transform3s(T[:3, :3].copy(), T[:3, 3].copy())
            if any(self._touch(i, self._coal.Box(*edges), place) for n in moving for i in self._links.get(n, ())):
                return False
        return True


def capsules_alone(robot: Robot) -> Robot:
    """The arm without hulls, and without the pairs of links whose capsules touch in a sampled configuration."""
    assert robot.shapes is not None
    old = robot.shapes
    plain = robot.with_shapes(Shapes(old.capsules, old.names, old.apart, old.excess))
    q, found = robot.limits.sample(np.random.default_rng(1), 400), True
    apart: list[Any] = []
    while found:
        pairs = find_pairs(plain, Scene())
        room, which = find_nearest_pairs(plain, Scene(), q)
        new = {pairs.names[k] for k in which[room <= 0.0]}
        apart += [(*pair, "by hand") for pair in new]
        plain, found = robot.with_shapes(Shapes(old.capsules, old.names, (*old.apart, *apart), old.excess)), bool(new)
    return plain


def draw(robot: Robot, rng: np.random.Generator) -> Scene:
    """Boxes around an arm."""
    reach = float(np.linalg.norm(robot.fk(robot.limits.sample(np.random.default_rng(0), 300))[:, :3, 3], axis=1).max())
    boxes = []
    while len(boxes) < BOXES:
        x = reach * rng.uniform((-1.0, -1.0, 0.0), 1.0)
        if np.hypot(x[0], x[1]) > 0.35 * reach:
            boxes.append((se3.pose(se3.exp_so3(rng.normal(size=3)), x), reach * rng.uniform(0.05, 0.3, 3)))
    return Scene(boxes=boxes)


def measure(case: int) -> Row:
    name = list(TIPS)[case]
    if not Path(f"{os.environ['ARMS']}/urdf/{name}.urdf").exists():
        return {"name": name, "missing": True}
    load("irb120")  # kernels
    home, seconds = os.environ.get("XDG_CACHE_HOME"), []
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder
        for _ in range(2):
            begin = time.process_time()
            robot = load(name)
            seconds.append(time.process_time() - begin)
    os.environ |= {"XDG_CACHE_HOME": home} if home else {}
    if home is None:
        del os.environ["XDG_CACHE_HOME"]
    if robot.shapes is None or robot.shapes.unread:
        return {"name": name, "missing": True}
    judge, rng = Judge(robot, name), np.random.default_rng([SEED, case])
    q = robot.limits.sample(rng, CONFIGURATIONS)
    free: Flags = np.array([judge.is_free(x, Scene()) for x in q])
    ours = find_nearest_pairs(robot, Scene(), q)[0] > 0.0
    row: Row = {"name": name, "first": seconds[0], "again": seconds[1], "free": int(free.sum()),
                "found": int((ours & free).sum()), "false": int((ours & ~free).sum()),
                "left_out": [pair for pair in robot.shapes.left_out if pair[2] != "neighbours"]}  # fmt: skip
    plain, limits = (
        capsules_alone(robot),
        MotionLimits(velocity=np.full(robot.n, 1.0), acceleration=np.full(robot.n, 4.0), jerk=np.full(robot.n, 40.0)),
    )
    arms, cpu, solved, asked, contacts, both = (robot, plain), np.zeros(2), 0, 0, 0, 0
    for _ in range(MOTIONS):
        scene = draw(robot, rng)
        ends = [x for x in robot.limits.sample(rng, 60) if judge.is_free(x, scene)][:2]
        if len(ends) < 2:
            continue
        found = []
        for arm in arms:
            planners.plan(arm, ends[1], ends[0], limits=limits, scene=scene, avoid=True) if asked == 0 else None
            begin = time.process_time()
            found.append(planners.plan(arm, ends[1], ends[0], limits=limits, scene=scene, avoid=True))
            spent = time.process_time() - begin
            found[-1] = found[-1], spent
        if not found[0][0] and judge.parts(*ends):
            continue
        asked += 1
        solved += bool(found[0][0])
        if found[0][0]:
            motion = found[0][0].trajectory
            t = np.linspace(0.0, motion.end, max(2, int(np.ceil(RATE * motion.end)) + 1))
            contacts += not all(judge.is_free(x, scene) for x in motion(t))
            if found[1][0]:
                both += 1
                cpu += [spent for _, spent in found]
    own = (find_pairs(robot, Scene()).bodies[:, 2] == SELF).sum()
    return row | {
        "asked": asked,
        "solved": solved,
        "contacts": contacts,
        "both": both,
        "cpu": cpu.tolist(),
        "pairs": int(own),
    }


def judge_rows(rows: list[Row]) -> list[Value]:
    known = [row for row in rows if not row.get("missing")]
    for row in known:
        row["share"] = 100.0 * row["found"] / max(row["free"], 1)
        words = (
            "{name}: {share:.1f} % of {free} free, {solved} of {asked}, {both} by both in {cpu} s, "
            "load {first:.1f}, {again:.2f} s"
        )
        print(f"  {words.format(**row)}")
    shares = [row["found"] / max(row["free"], 1) for row in known]
    solved = [row["solved"] / row["asked"] for row in known if row["asked"]]
    ratio = np.divide(*np.sum([row["cpu"] for row in known], axis=0))
    false, contacts = sum(row["false"] for row in known), sum(row["contacts"] for row in known)
    first, again = max(row["first"] for row in known), max(row["again"] for row in known)
    return [
        Value("arms", "28", f"{len(known)}", len(known) >= 27),
        Value("free configurations of each arm that are free", "≥ 95 %", f"{100 * min(shares):.1f} %", min(shares) >= 0.95),
        Value("configurations in contact that are free", "0", f"{false}", false == 0),
        Value("motions of each arm", "≥ 95 %", f"{100 * min(solved):.0f} %", min(solved) >= 0.95),
        Value("motions in contact", "0", f"{contacts}", contacts == 0),
        Value("CPU over that of capsules alone", "≤ 1.5", f"{ratio:.2f}", bool(ratio <= 1.5)),
        Value("first load, and again", "≤ 10 s, ≤ 0.5 s", f"{first:.1f} s, {again:.2f} s", first <= 10.0 and again <= 0.5),
    ]  # fmt: skip


if __name__ == "__main__":
    main("meshes", measure, len(TIPS), judge_rows, part=0.2)
