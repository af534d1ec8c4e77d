"""An arm as plain data that JSON can hold, read back to the last bit, and the checks of such data."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.limits import JointLimits
from optik.arm.model import ArmModel
from optik.errors import InvalidInput
from optik.types import Array

INFINITE = {"inf": np.inf, "-inf": -np.inf}
"""JSON has no number for infinity: these words stand for it."""

LIMITS = ("lower", "upper", "velocity", "acceleration", "jerk")
KEYS = ("name", "joint_names", "prismatic", "fixed", "tool", "gravity", "limits", "source")


def plain_numbers(values: ArrayLike) -> Any:
    """Nested lists of floats, or one float for a scalar; infinite ones as the words "inf" and "-inf"."""

    def plain(x: Any) -> Any:
        if isinstance(x, list):
            return [plain(y) for y in x]
        return x if np.isfinite(x) else str(x)

    return plain(np.asarray(values, dtype=np.float64).tolist())


def numbers(data: Any, shape: tuple[int, ...], argument: str) -> Array:
    """Array of a known shape that `plain_numbers` wrote.

    Raises
    ------
    InvalidInput
        Another shape, or something that is no number.
    """
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
        if type(value) in (int, float):
            return float(value)
    except OverflowError:
        pass
    raise InvalidInput(argument, repr(value)[:60], "numbers")


def record(data: Any, keys: tuple[str, ...], argument: str) -> dict[str, Any]:
    """Return a mapping that has exactly these keys.

    Raises
    ------
    InvalidInput
        Anything else; keys that are missing, or not known, are named.
    """
    if not isinstance(data, dict):
        raise InvalidInput(argument, repr(data)[:60], f"a mapping with {', '.join(keys)}")
    missing, unknown = [k for k in keys if k not in data], [str(k) for k in data if k not in keys]
    if missing or unknown:
        wrong = [f"{', '.join(part)} {word}" for part, word in ((missing, "missing"), (unknown, "not known")) if part]
        raise InvalidInput(argument, "; ".join(wrong)[:200], f"a mapping with {', '.join(keys)}")
    return data


def word(value: Any, argument: str) -> str:
    """Return a string.

    Raises
    ------
    InvalidInput
        Anything else.
    """
    if not isinstance(value, str):
        raise InvalidInput(argument, repr(value)[:60], "a word")
    return value


def words(value: Any, argument: str) -> tuple[str, ...]:
    """Return a list of strings as a tuple.

    Raises
    ------
    InvalidInput
        Anything else.
    """
    if not isinstance(value, list):
        raise InvalidInput(argument, repr(value)[:60], "a list of words")
    return tuple(word(w, argument) for w in value)


def arm_to_dict(arm: ArmModel) -> dict[str, Any]:
    """Plain data of a robot; see `Robot.to_dict`."""
    limits = {k: None if (v := getattr(arm.limits, k)) is None else plain_numbers(v) for k in LIMITS}
    return {
        "name": arm.name,
        "joint_names": list(arm.joint_names),
        "prismatic": arm.prismatic.tolist(),
        "fixed": plain_numbers(arm.fixed),
        "tool": plain_numbers(arm.tool),
        "gravity": plain_numbers(arm.gravity),
        "limits": limits,
        "source": arm.source,
    }


def arm_from_dict(data: Any) -> ArmModel:
    """Robot of plain data; see `Robot.from_dict`."""
    data = record(data, KEYS, "robot")
    joint_names = words(data["joint_names"], "robot.joint_names")
    n, prismatic = len(joint_names), data["prismatic"]
    if not isinstance(prismatic, list) or len(prismatic) != n or any(type(p) is not bool for p in prismatic):
        raise InvalidInput("robot.prismatic", repr(prismatic)[:60], f"{n} times true or false")
    limits = {
        k: None if v is None and k not in ("lower", "upper") else numbers(v, (n,), f"robot.limits.{k}")
        for k, v in record(data["limits"], LIMITS, "robot.limits").items()
    }
    return ArmModel(
        name=word(data["name"], "robot.name"),
        fixed=numbers(data["fixed"], (n, 4, 4), "robot.fixed"),
        prismatic=np.array(prismatic, dtype=np.bool_),
        tool=numbers(data["tool"], (4, 4), "robot.tool"),
        limits=JointLimits(**limits),  # type: ignore[arg-type]
        joint_names=joint_names,
        gravity=numbers(data["gravity"], (3,), "robot.gravity"),
        source=word(data["source"], "robot.source"),
    )
