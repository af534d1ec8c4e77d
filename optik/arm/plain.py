"""Arms as plain data for JSON, exact to the last bit, and checks of such data."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optik import se3
from optik.arm.inertia import STANDARD_GRAVITY, Inertia, Payload
from optik.arm.limits import JointLimits, VelocityByPosition
from optik.arm.linkage import Linkage
from optik.arm.model import ArmModel
from optik.arm.motors import LIMIT_FIELDS, Motors
from optik.arm.shapes.model import Shapes
from optik.check import check_number
from optik.errors import InvalidInput
from optik.types import Array

INFINITE = {"inf": np.inf, "-inf": -np.inf}
"""Strings for infinite numbers, which JSON lacks."""
LIMIT_KEYS = ("lower", "upper", "velocity", "acceleration", "jerk")
"""Keys of an arm's limits that are always written: fields of `JointLimits`."""
LATER_KEYS = ("torque", "torque_rate", "deceleration")
"""Keys of an arm's limits that are written where known, as is ``velocity_by_position``."""
ARM_KEYS = ("name", "joint_names", "prismatic", "fixed", "tool", "gravity", "limits", "source")
"""Keys of an arm that are always written: fields of `ArmModel`."""
MASS_KEYS = ("gravity_magnitude", "inertia", "payload")
"""Keys of an arm that are written where they are known, gravity_magnitude where it is not the standard value."""
INERTIA_KEYS = ("mass", "com", "tensor", "motor", "viscous", "coulomb", "source")
"""Keys of an arm's masses: the fields of `Inertia`."""
MOTOR_KEYS = ("matrix", "offset", "inertia", "viscous", "coulomb")
"""Keys of motors that are arrays: fields of `Motors`."""
LINKAGE_KEYS = ("joint", "factor", "offset", "prismatic", "names")
"""Keys of the relations of a linkage: the fields of `Linkage`."""
PAYLOAD_KEYS = ("mass", "com", "inertia")
"""Keys of a payload: the fields of `Payload`."""
ORIENTATIONS = {"rpy_deg": 3, "quaternion_wxyz": 4, "quaternion_xyzw": 4, "rotation_vector_rad": 3, "abc_deg": 3}
"""Keys of an orientation, with their numbers of values. abc_deg are KUKA's angles A, B, C about z, y, x."""
LONGEST_ROTATION = 2.0 * np.pi + 1e-3
"""Longest rotation vector [rad]: longer ones are probably in degrees."""
SHAPES_KEYS = ("link", "a", "b", "radius", "excess", "names", "apart", "source")
"""Keys of an arm's shapes: the arrays of `Capsules` and the excess in columns, and the other fields of `Shapes`."""


def numbers_to_list(values: ArrayLike) -> Any:
    """Return numbers as nested lists of floats, infinite ones as the strings "inf" and "-inf"."""

    def plain(x: Any) -> Any:
        if isinstance(x, list):
            return [plain(y) for y in x]
        return x if np.isfinite(x) else str(x)

    return plain(np.asarray(values, dtype=np.float64).tolist())


def read_numbers(data: Any, shape: tuple[int, ...], argument: str) -> Array:
    """Read an array of a known shape that `numbers_to_list` wrote."""
    flat: list[float] = []

    def walk(part: Any, depth: int) -> None:
        if depth < len(shape):
            if not isinstance(part, list) or len(part) != shape[depth]:
                got = f"{len(part)} of them" if isinstance(part, list) else repr(part)[:60]
                raise InvalidInput(argument, got, f"numbers of shape {shape}: a list of {shape[depth]} here")
            for inner in part:
                walk(inner, depth + 1)
        else:
            flat.append(_number(part, argument))

    walk(data, 0)
    return np.array(flat, dtype=np.float64).reshape(shape)


def _number(value: Any, argument: str) -> float:
    if isinstance(value, str) and value in INFINITE:
        return float(INFINITE[value])
    try:
        if type(value) in (int, float) and value == value:
            return float(value)
    except OverflowError:
        pass
    raise InvalidInput(argument, repr(value)[:60], "numbers")


def read_record(data: Any, keys: tuple[str, ...], argument: str, *, optional: tuple[str, ...] = ()) -> dict[str, Any]:
    """Check that a mapping has all required keys and no unknown ones, and return it."""
    expected = f"a mapping with {', '.join((*keys, *optional))}"
    if not isinstance(data, dict):
        raise InvalidInput(argument, repr(data)[:60], expected)
    missing = [key for key in keys if key not in data]
    unknown = [key if isinstance(key, str) and key.isprintable() else repr(key) for key in data
               if key not in keys and key not in optional]  # fmt: skip
    if missing or unknown:
        wrong = [f"{', '.join(part)} {word}" for part, word in ((missing, "missing"), (unknown, "unknown")) if part]
        from difflib import get_close_matches

        near = get_close_matches(unknown[0], (*keys, *optional)) if unknown else []
        near = [key for key in near if key == near[0] or key.startswith(f"{unknown[0]}_")]
        near = missing if len(missing) == len(unknown) == 1 else near
        expected = expected if not near or len(expected) < 60 else "known keys"
        advice = f"did you mean {' or '.join(near)}?" if near else ""
        raise InvalidInput(argument, "; ".join(wrong)[:200], expected, advice=advice)
    return data


def read_word(value: Any, argument: str) -> str:
    """Check that a value is a string, and return it."""
    if not isinstance(value, str):
        raise InvalidInput(argument, repr(value)[:60], "a string")
    return value


def read_words(value: Any, argument: str) -> tuple[str, ...]:
    """Check that a value is a list of strings; return it as a tuple."""
    return tuple(read_word(w, argument) for w in read_list(value, argument, "a list of strings"))


def read_list(value: Any, argument: str, expected: str = "a list of rows", count: int | None = None) -> list[Any]:
    """Check that a value is a list, of known length if one is given, and return it."""
    if not isinstance(value, list) or count not in (None, len(value)):
        raise InvalidInput(argument, repr(value)[:60], expected)
    return value


def read_vector(value: Any, argument: str, count: int = 3) -> Array:
    """Read a list of finite numbers."""
    expected = f"{count} finite numbers"
    return np.array([check_number(x, argument, expected) for x in read_list(value, argument, expected, count)])


def read_pose(data: Any, argument: str, *, optional: tuple[str, ...] = ()) -> Array:
    """Read a pose (4, 4) from a mapping with ``xyz_mm`` and at most one orientation; without one, that of the frame."""
    read_record(data, (), argument, optional=(*optional, "xyz_mm", *ORIENTATIONS))
    xyz = read_vector(data.get("xyz_mm", [0.0] * 3), f"{argument}.xyz_mm") / 1000.0
    kinds = [kind for kind in ORIENTATIONS if kind in data]
    if len(kinds) > 1:
        raise InvalidInput(argument, " and ".join(kinds), "one orientation")
    turns = [make_rotation(k, read_vector(data[k], at := f"{argument}.{k}", ORIENTATIONS[k]), at) for k in kinds]
    return se3.pose(turns[0] if turns else None, xyz)


def make_rotation(kind: str, values: Array, argument: str) -> Array:
    """Return the rotation matrix (3, 3) of an orientation in one of the `ORIENTATIONS`."""
    length, order = math.hypot(*values), kind.rpartition("_")[2]
    if kind.startswith("quaternion"):
        if not abs(length - 1.0) <= se3.QUATERNION_ERROR:
            got = f"[{', '.join(f'{x:.3g}' for x in values)}] of length {length:.6g}"
            raise InvalidInput(argument, got, f"a unit quaternion {', '.join(order)}")
        return se3.from_quaternion(values if order == "wxyz" else np.roll(values, 1))
    if kind == "rotation_vector_rad":
        if not length <= LONGEST_ROTATION:
            got = f"a vector of length {length:.6g}"
            raise InvalidInput(argument, got, "a rotation vector [rad] of at most a turn")
        return se3.exp_so3(values)
    return np.asarray(se3.from_xyz_rpy(np.zeros(3), values if kind == "rpy_deg" else values[::-1])[:3, :3])


def arm_to_dict(arm: ArmModel) -> dict[str, Any]:
    """Return an arm as plain data; see `Robot.to_dict`."""
    limits = {k: None if (v := getattr(arm.limits, k)) is None else numbers_to_list(v) for k in LIMIT_KEYS}
    limits |= {k: numbers_to_list(v) for k in LATER_KEYS if (v := getattr(arm.limits, k)) is not None}
    if arm.limits.velocity_by_position is not None:
        limits["velocity_by_position"] = arm.limits.velocity_by_position.to_plain()
    masses: dict[str, Any] = {}
    if arm.gravity_magnitude != STANDARD_GRAVITY:
        masses["gravity_magnitude"] = arm.gravity_magnitude
    if arm.inertia is not None:
        masses["inertia"] = {k: numbers_to_list(getattr(arm.inertia, k)) for k in INERTIA_KEYS[:-1]}
        masses["inertia"]["source"] = arm.inertia.source
    if arm.payload is not None:
        masses["payload"] = {k: numbers_to_list(getattr(arm.payload, k)) for k in PAYLOAD_KEYS}
    return {
        "name": arm.name,
        "joint_names": list(arm.joint_names),
        "prismatic": arm.prismatic.tolist(),
        "fixed": numbers_to_list(arm.fixed),
        "tool": numbers_to_list(arm.tool),
        "gravity": numbers_to_list(arm.gravity),
        "limits": limits,
        "source": arm.source,
        **masses,
        **({} if arm.shapes is None else {"shapes": shapes_to_dict(arm.shapes)}),
        **({} if arm.motors is None else {"motors": _motors_to_dict(arm.motors)}),
        **({} if arm.linkage is None else {"linkage": _linkage_to_dict(arm.linkage)}),
    }


def arm_from_dict(data: Any) -> ArmModel:
    """Read an arm from plain data; see `Robot.from_dict`."""
    data = read_record(data, ARM_KEYS, "robot", optional=(*MASS_KEYS, "shapes", "motors", "linkage"))
    joint_names = read_words(data["joint_names"], "robot.joint_names")
    n, prismatic = len(joint_names), data["prismatic"]
    if not isinstance(prismatic, list) or len(prismatic) != n or any(type(p) is not bool for p in prismatic):
        raise InvalidInput("robot.prismatic", repr(prismatic)[:60], f"{n} times true or false")
    linkage = _linkage_from_dict(data["linkage"]) if "linkage" in data else None
    links = n if linkage is None else len(linkage.names)
    optional = (*LATER_KEYS, "velocity_by_position")
    fields = dict(read_record(data["limits"], LIMIT_KEYS, "robot.limits", optional=optional))
    by_position = fields.pop("velocity_by_position", None)
    limits: dict[str, Any] = {
        k: None if v is None and k not in ("lower", "upper") else read_numbers(v, (n,), f"robot.limits.{k}")
        for k, v in fields.items()
    }
    if by_position is not None:
        limits["velocity_by_position"] = VelocityByPosition.from_plain(by_position, "robot.limits.velocity_by_position")
    return ArmModel(
        name=read_word(data["name"], "robot.name"),
        fixed=read_numbers(data["fixed"], (links, 4, 4), "robot.fixed"),
        prismatic=np.array(prismatic, dtype=np.bool_),
        tool=read_numbers(data["tool"], (4, 4), "robot.tool"),
        limits=JointLimits(**limits),
        joint_names=joint_names,
        gravity=read_numbers(data["gravity"], (3,), "robot.gravity"),
        source=read_word(data["source"], "robot.source"),
        gravity_magnitude=_number(data.get("gravity_magnitude", STANDARD_GRAVITY), "robot.gravity_magnitude"),
        inertia=_inertia(data["inertia"], links) if "inertia" in data else None,
        payload=_payload(data["payload"]) if "payload" in data else None,
        shapes=shapes_from_dict(data["shapes"]) if "shapes" in data else None,
        motors=_motors_from_dict(data["motors"], n) if "motors" in data else None,
        linkage=linkage,
    )


def _linkage_to_dict(linkage: Linkage) -> dict[str, Any]:
    """Return the relations of a linkage as plain data."""
    return {name: np.asarray(getattr(linkage, name)).tolist() for name in LINKAGE_KEYS}


def _linkage_from_dict(data: Any) -> Linkage:
    """Read the relations of a linkage from plain data."""
    data = read_record(data, LINKAGE_KEYS, "robot.linkage")
    names = read_words(data["names"], "robot.linkage.names")
    joint, factor, offset = (read_numbers(data[key], (len(names),), f"robot.linkage.{key}") for key in LINKAGE_KEYS[:3])
    if (joint != np.round(joint)).any() or any(type(slides) is not bool for slides in data["prismatic"]):
        raise InvalidInput("robot.linkage", f"{data['joint']}, {data['prismatic']}"[:60], "indices, and true or false")
    return Linkage(joint.astype(np.int64), factor, offset, np.array(data["prismatic"], np.bool_), names)


def _motors_to_dict(motors: Motors) -> dict[str, Any]:
    """Return motors as plain data."""
    limits = {k: numbers_to_list(v) for k in LIMIT_FIELDS if (v := getattr(motors.limits, k)) is not None}
    arrays = {k: numbers_to_list(getattr(motors, k)) for k in MOTOR_KEYS}
    return {"names": list(motors.names), "limits": limits} | arrays


def _motors_from_dict(data: Any, n: int) -> Motors:
    """Read motors from plain data."""
    data = read_record(data, ("names", "limits", *MOTOR_KEYS), "robot.motors")
    limits = read_record(data["limits"], ("lower", "upper"), "robot.motors.limits", optional=LIMIT_FIELDS[2:])
    arrays = {k: read_numbers(data[k], (n, n) if k == "matrix" else (n,), f"robot.motors.{k}") for k in MOTOR_KEYS}
    own: dict[str, Any] = {k: read_numbers(v, (n,), f"robot.motors.limits.{k}") for k, v in limits.items()}
    return Motors(names=read_words(data["names"], "robot.motors.names"), limits=JointLimits(**own), **arrays)


def _inertia(data: Any, n: int) -> Inertia:
    data = read_record(data, INERTIA_KEYS, "robot.inertia")
    shapes = {"com": (n, 3), "tensor": (n, 3, 3)}
    arrays = {k: read_numbers(data[k], shapes.get(k, (n,)), f"robot.inertia.{k}") for k in INERTIA_KEYS[:-1]}
    return Inertia(**arrays, source=read_word(data["source"], "robot.inertia.source"))


def _payload(data: Any) -> Payload:
    data = read_record(data, PAYLOAD_KEYS, "robot.payload")
    mass = read_numbers(data["mass"], (2,) if isinstance(data["mass"], list) else (), "robot.payload.mass")
    com, tensor = (read_numbers(data[k], s, f"robot.payload.{k}") for k, s in (("com", (3,)), ("inertia", (3, 3))))
    return Payload(tuple(mass.tolist()) if mass.ndim else float(mass), com, tensor)


def shapes_to_dict(shapes: Shapes) -> dict[str, Any]:
    """Return shapes as plain data."""
    columns = [column.tolist() for column in (*shapes.capsules, shapes.excess)]
    columns[4] = [None if e != e else e for e in columns[4]]
    words_ = (list(shapes.names), [list(pair) for pair in shapes.apart], shapes.source)
    unread = {"unread": [list(pair) for pair in shapes.unread]} if shapes.unread else {}
    rows = [
        [[h.corners.tolist(), h.radius, None if h.excess != h.excess else h.excess] for h in of] for of in shapes.hulls
    ]
    several = {"mechanism": list(shapes.mechanism)} if shapes.mechanism else {}
    return (
        dict(zip(SHAPES_KEYS, (*columns, *words_), strict=True)) | unread | ({"hulls": rows} if rows else {}) | several
    )


def shapes_from_dict(data: Any) -> Shapes:
    """Read shapes from plain data."""
    data = read_record(data, SHAPES_KEYS, "robot.shapes", optional=("unread", "hulls", "mechanism"))
    links = read_list(data["link"], "robot.shapes.link", "a list of numbers of links")
    m = len(links)
    a, b = (read_numbers(data[k], (m, 3), f"robot.shapes.{k}") for k in ("a", "b"))
    radius = read_numbers(data["radius"], (m,), "robot.shapes.radius")
    known = read_list(data["excess"], "robot.shapes.excess", f"{m} numbers or null", m)
    stated = [np.nan if e is None else _number(e, "robot.shapes.excess") for e in known]
    capsules: Any = list(zip(links, a, b, radius.tolist(), strict=True))
    names = read_words(data["names"], "robot.shapes.names")
    source = read_word(data["source"], "robot.shapes.source")
    pairs = read_list(data.get("unread", []), "robot.shapes.unread")
    unread = [read_words(pair, "robot.shapes.unread") for pair in pairs]
    of = tuple(read_list(data.get("mechanism", []), "robot.shapes.mechanism"))
    return Shapes(capsules, names, data["apart"], np.array(stated), source, unread, data.get("hulls", ()), of)  # type: ignore[arg-type]


def describe_difference(a: ArmModel, b: ArmModel) -> str:
    """Return the names of the parts in which two robots differ, for an error."""
    first, second = arm_to_dict(a), arm_to_dict(b)
    differing = [key for key in {**first, **second} if first.get(key) != second.get(key)]
    return ", ".join(differing) or "nothing that files contain"
