"""Arms with fingers beside the tip, as URDFs with meshes, and contact of their true meshes by Pinocchio and coal."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trimesh

KINDS = ("one revolute", "two revolute", "one prismatic", "two prismatic", "two jointed")
"""Hands: a finger beside a fixed jaw, or two fingers that follow one joint; jointed ones have a second link each."""
LENGTHS = (0.06, 0.12, 0.13, 0.06, 0.05)
"""Lengths of the links of the arm [m]."""
AXES = ("0 0 1", "0 1 0", "0 1 0", "0 1 0", "0 0 1")
RANGES = (2.0, 1.8, 2.4, 2.4, 2.8)
"""Axes of the joints of the arm, and their limits on both sides [rad]."""


class Finger(NamedTuple):
    """A joint of a hand: name, type, parent, origin (xyz, rpy), axis, limits, and the factor and offset of a mimic."""

    name: str
    kind: str
    parent: str
    xyz: tuple[float, float, float]
    axis: tuple[float, float, float]
    limits: tuple[float, float]
    factor: float = 1.0
    offset: float = 0.0


class Hand(NamedTuple):
    """The URDF of an arm with a hand, the joints of its fingers, the first of which drives the others, and its limits."""

    file: Path
    fingers: tuple[Finger, ...]

    @property
    def limits(self) -> tuple[float, float]:
        return self.fingers[0].limits


def bar(rng: np.random.Generator, length: float, thick: tuple[float, float]) -> trimesh.Trimesh:
    """A part of a link along z: a box, a tapered hull, or a cylinder."""
    a, b = rng.uniform(*thick, 2)
    kind = rng.integers(3)
    if kind == 0:
        mesh = trimesh.creation.box((a, b, length))
    elif kind == 1:
        mesh = trimesh.creation.cylinder(0.5 * a, length, sections=16)
    else:
        mesh = trimesh.creation.box((a, b, length))
        narrow = rng.uniform(0.5, 1.0)
        mesh.vertices = mesh.vertices * np.where(mesh.vertices[:, 2:] > 0.0, (narrow, narrow, 1.0), 1.0)
    mesh.apply_translation((0.0, 0.0, 0.5 * length))
    return mesh


def finger_mesh(rng: np.random.Generator, length: float) -> trimesh.Trimesh:
    """A finger along z, straight, or bent to its side at the end."""
    parts = [bar(rng, length, (0.012, 0.022))]
    if rng.uniform() < 0.5:
        tip = trimesh.creation.box((0.03, 0.014, 0.012))
        tip.apply_translation((0.012, 0.0, length - 0.006))
        parts.append(tip)
    return trimesh.util.concatenate(parts)


def draw_fingers(rng: np.random.Generator, kind: str) -> tuple[tuple[Finger, ...], dict[str, trimesh.Trimesh]]:
    """The joints and meshes of the fingers of a hand."""
    length, wide, height = rng.uniform(0.06, 0.1), rng.uniform(0.01, 0.025), 0.045
    meshes = {"finger1": finger_mesh(rng, length)}
    if "prismatic" in kind:
        limits, axis, joint = (0.0, rng.uniform(0.02, 0.045)), (1.0, 0.0, 0.0), "prismatic"
    else:
        limits, axis, joint = (rng.uniform(-0.2, 0.0), rng.uniform(0.7, 1.8)), (0.0, 1.0, 0.0), "revolute"
    fingers = [Finger("finger1", joint, "hand", (wide, 0.0, height), axis, limits)]
    if kind.startswith("one"):
        meshes["jaw"] = finger_mesh(rng, length)
        return tuple(fingers), meshes
    factor, offset = (-1.0, 0.0) if rng.uniform() < 0.5 else (1.0, 0.0)
    side = (-wide, 0.0, height)
    other = axis if factor < 0.0 else tuple(-x for x in axis)
    fingers.append(Finger("finger2", joint, "hand", side, other, limits, factor, offset))
    meshes["finger2"] = finger_mesh(rng, length)
    if kind == "two jointed":
        for i in (1, 2):
            before, turn = fingers[i - 1], -fingers[i - 1].factor
            low, high = sorted(turn * x for x in limits)
            fingers.append(
                Finger(f"tip{i}", "revolute", f"finger{i}", (0.0, 0.0, length), before.axis, (low, high), turn, offset)
            )
            meshes[f"tip{i}"] = finger_mesh(rng, 0.6 * length)
    return tuple(fingers), meshes


def write_hand(folder: Path, seed: Any, kind: str) -> Hand:
    """Write the URDF and the meshes of an arm with a random hand."""
    rng = np.random.default_rng(seed)
    fingers, meshes = draw_fingers(rng, kind)
    for i, length in enumerate((0.05, *LENGTHS)):
        name = f"link{i}" if i < len(LENGTHS) else "hand"
        meshes[name] = bar(rng, length, (0.025, 0.045))
    joints, z = [], 0.05
    names = [*(f"link{i}" for i in range(len(LENGTHS))), "hand"]
    for i, (axis, turn) in enumerate(zip(AXES, RANGES, strict=True)):
        joints.append(
            f'<joint name="j{i + 1}" type="revolute"><parent link="{names[i]}"/><child link="{names[i + 1]}"/>'
            f'<origin xyz="0 0 {z}"/><axis xyz="{axis}"/>'
            f'<limit lower="{-turn}" upper="{turn}" velocity="1" effort="1"/></joint>'
        )
        z = LENGTHS[i]
    if "jaw" in meshes:
        place = "-0.02 0 0.045"
        joints.append(
            f'<joint name="jaw" type="fixed"><parent link="hand"/><child link="jaw"/><origin xyz="{place}"/></joint>'
        )
    for one in fingers:
        follows = (
            "" if one is fingers[0] else f'<mimic joint="finger1" multiplier="{one.factor}" offset="{one.offset}"/>'
        )
        joints.append(
            f'<joint name="{one.name}" type="{one.kind}"><parent link="{one.parent}"/><child link="{one.name}"/>'
            f'<origin xyz="{" ".join(map(str, one.xyz))}"/><axis xyz="{" ".join(map(str, one.axis))}"/>{follows}'
            f'<limit lower="{one.limits[0]}" upper="{one.limits[1]}" velocity="1" effort="1"/></joint>'
        )
    joints.append(
        '<joint name="tool" type="fixed"><parent link="hand"/><child link="tip"/><origin xyz="0 0 0.1"/></joint>'
    )
    links = ['<link name="tip"/>']
    folder.mkdir(parents=True, exist_ok=True)
    for name, mesh in meshes.items():
        mesh.export(folder / f"{name}.stl")
        links.append(
            f'<link name="{name}"><collision><geometry><mesh filename="{name}.stl"/></geometry></collision></link>'
        )
    file = folder / "arm.urdf"
    file.write_text(f'<robot name="own">{"".join(links + joints)}</robot>', encoding="utf-8")
    return Hand(file, fingers)


class MeshContact:
    """Contact between the true meshes of links that are not neighbours, by Pinocchio and coal."""

    def __init__(self, hand: Hand) -> None:
        import pinocchio as pin

        self._pin, self.hand = pin, hand
        text, folder = hand.file.read_text(), str(hand.file.parent)
        text = text.replace('filename="', f'filename="{folder}/')
        self.model = pin.buildModelFromXML(text)
        self.geometry = pin.buildGeomFromUrdfString(self.model, text, pin.GeometryType.COLLISION, package_dirs=[folder])
        number = {f"link{i}": i for i in range(5)}
        links = [number.get(one.name.rpartition("_")[0], 5) for one in self.geometry.geometryObjects]
        for i, j in zip(*np.triu_indices(len(links), 1), strict=True):
            if abs(links[i] - links[j]) > 1:
                self.geometry.addCollisionPair(pin.CollisionPair(int(i), int(j)))
        self.data, self.found = self.model.createData(), self.geometry.createData()

    def touches(self, q: np.ndarray, value: float) -> bool:
        """Whether links touch at joints of the arm and a value of the fingers' driver."""
        full = self._pin.neutral(self.model)
        names = list(self.model.names)
        values = {f"j{i + 1}": x for i, x in enumerate(q)}
        values |= {f.name: f.factor * value + f.offset for f in self.hand.fingers}
        for name, x in values.items():
            full[self.model.joints[names.index(name)].idx_q] = x
        return bool(self._pin.computeCollisions(self.model, self.data, self.geometry, self.found, full, True))
