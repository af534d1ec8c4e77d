"""Arms on a wall, a ceiling or a lift: random URDFs whose base is turned, the same arms as TOML, and Pinocchio's gravity."""

from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

Array = Any
KINDS = ("revolute", "continuous", "prismatic")


class Mounted(NamedTuple):
    """An arm behind a mount: as URDF from the root link, the links and joints by name, and the arm as TOML.

    ``table`` is the arm alone, by the rows of its modified table, with gravity by SciPy's rotations of the mount's origins.
    """

    urdf: str
    base: str
    tip: str
    moving: tuple[str, ...]
    joints: tuple[str, ...]
    table: str


def _words(values: Any) -> str:
    return " ".join(repr(float(x)) for x in values)


def _joint(name: str, kind: str, parent: str, origin: tuple[Any, Any], rest: str = "") -> str:
    xyz, rpy = origin
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="of_{name}"/>'
        f'<origin xyz="{_words(xyz)}" rpy="{_words(rpy)}"/>{rest}</joint>'
    )


def random_mounted(rng: np.random.Generator, *, moving: bool) -> Mounted:
    """An arm of two to seven joints behind one to four joints, of which at least one moves or none does."""
    links, joints, R, before = ['<link name="world"/>'], [], np.eye(3), "world"
    kinds = rng.choice([*KINDS, "fixed", "fixed"] if moving else ["fixed"], rng.integers(1, 5))
    if moving:
        kinds[rng.integers(kinds.size)] = rng.choice(KINDS)
    limit = '<limit lower="-3" upper="3" effort="5000" velocity="2"/>'
    for i, kind in enumerate(kinds):
        rpy = rng.uniform(-3.2, 3.2, 3) if rng.random() < 0.6 else rng.integers(-2, 3, 3) * (np.pi / 2)
        rest = "" if kind == "fixed" else f'<axis xyz="{_words(rng.normal(size=3))}"/>{limit}'
        joints.append(_joint(f"mount{i}", kind, before, (rng.uniform(-1, 1, 3), rpy), rest))
        before = f"of_mount{i}"
        links.append(f'<link name="{before}">{_inertial(*_body(rng))}</link>')
        R = R @ Rotation.from_euler("xyz", rpy).as_matrix()
    base, rows, bodies = before, [], []
    for i in range(rng.integers(2, 8)):
        a, alpha, d, theta = rng.uniform(-0.5, 0.5), rng.uniform(-3, 3), rng.uniform(-0.5, 0.5), rng.uniform(-3, 3)
        slides, (mass, com, tensor) = rng.random() < 0.2, _body(rng)
        joints.append(_joint(f"offset{i}", "fixed", before, ((a, 0, 0), (alpha, 0, 0))))
        kind = "prismatic" if slides else "revolute"
        joints.append(_joint(f"q{i}", kind, f"of_offset{i}", ((0, 0, d), (0, 0, theta)), f'<axis xyz="0 0 1"/>{limit}'))
        before = f"of_q{i}"
        links += [f'<link name="of_offset{i}"/>', f'<link name="{before}">{_inertial(mass, com, tensor)}</link>']
        angles = np.degrees([alpha, theta]).tolist()
        reach = "range_mm = [-3e3, 3e3]" if slides else "range_rad = [-3, 3]"
        rows.append(
            f"  {{ a_mm = {1e3 * a!r}, alpha_deg = {angles[0]!r}, d_mm = {1e3 * d!r}, theta_deg = {angles[1]!r}, "
            f'type = "{kind}", {reach} }},'
        )
        bodies.append(
            f"[[inertia.links]]\nmass_kg = {mass!r}\ncom_mm = {(1e3 * com).tolist()}\n"
            f"inertia = {[*np.diag(tensor).tolist(), 0.0, 0.0, 0.0]}"
        )
    names = [f"q{i}" for i in range(len(rows))]
    down = R.T @ [0.0, 0.0, -1.0]
    head = f'convention = "mdh"\njoint_names = {names}\ngravity = {down.tolist()}\njoints = ['
    text = f'<robot name="mounted">{"".join(links)}{"".join(joints)}</robot>'
    moves = tuple(f"mount{i}" for i, kind in enumerate(kinds) if kind != "fixed")
    return Mounted(text, base, before, moves, tuple(names), "\n".join([head, *rows, "]", "[inertia]", *bodies, ""]))


def _body(rng: np.random.Generator) -> tuple[float, Array, Array]:
    """Mass, centre of mass and inertia of a random box."""
    mass, side = rng.uniform(0.5, 10.0), rng.uniform(0.05, 0.3, 3) ** 2
    return mass, rng.uniform(-0.3, 0.3, 3), np.diag(mass / 12.0 * (side.sum() - side))


def _inertial(mass: float, com: Array, tensor: Array) -> str:
    xx, yy, zz = np.diag(tensor).tolist()
    inside = f'<inertia ixx="{xx!r}" iyy="{yy!r}" izz="{zz!r}" ixy="0" ixz="0" iyz="0"/>'
    return f'<inertial><origin xyz="{_words(com)}"/><mass value="{mass!r}"/>{inside}</inertial>'


class MountedGravity:
    """Pinocchio's torques of gravity, which is −z of the root link, by the names of the joints; the others are at 0."""

    def __init__(self, urdf: str) -> None:
        import pinocchio

        self._pin, self._model = pinocchio, pinocchio.buildModelFromXML(urdf)
        self._model.gravity.linear = np.array([0.0, 0.0, -9.80665])
        self._data = self._model.createData()

    def torques(self, joints: tuple[str, ...], q: Array) -> Array:
        at = [self._model.joints[self._model.getJointId(name)].idx_v for name in joints]
        step = np.zeros(self._model.nv)
        step[at] = q
        place = self._pin.integrate(self._model, self._pin.neutral(self._model), step)
        return self._pin.computeGeneralizedGravity(self._model, self._data, place)[at].copy()
