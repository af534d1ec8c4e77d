"""Options of `optik plan` on masses: the payload, and limits on torque and torque rate."""

from __future__ import annotations

from typing import Any

import optik
from benchmarks.cli.shared import read_numbers
from optik.errors import InvalidInput

TORQUE_UNITS = {"torque": "[N·m, sliding N]", "torque_rate": "[N·m/s, sliding N/s]"}
"""Units of torque limits, for messages."""

MASS = "a mass [kg] such as 3, or an interval such as 0:3"
"""Values of ``--payload``."""


def add_payload(arm: optik.Robot, payload: str | None) -> optik.Robot:
    """Return the arm with the typed payload."""
    if payload is None:
        return arm
    try:
        masses = [float(part) for part in payload.split(":")]
    except ValueError:
        raise InvalidInput("--payload", repr(payload), MASS) from None
    if len(masses) > 2 or masses != sorted(masses):
        raise InvalidInput("--payload", repr(payload), MASS)
    if arm.inertia is None:
        raise InvalidInput("--payload", f"{payload} on {arm.name}, whose masses are unknown", "an arm with masses")
    try:
        return arm.with_payload(masses[0] if len(masses) == 1 else (masses[0], masses[1]))
    except InvalidInput as error:
        raise InvalidInput("--payload", error.got, error.expected) from None


def read_torque_limit(arm: optik.Robot, name: str, text: str | None, own: Any) -> Any:
    """Read a typed limit on torques or torque rates."""
    option = f"--{name.replace('_', '-')}"
    if text is None:
        return own
    if text == "none":
        return None
    if text == "robot":
        if own is None:
            wanted = f"numbers {TORQUE_UNITS[name]}, or none"
            raise InvalidInput(option, f"robot, but {arm.name} has no such limit", wanted)
        return own
    try:
        values = read_numbers(text, option)
    except InvalidInput:
        values = []
    if len(values) not in (1, arm.n):
        wanted = f"robot, none, one number or {arm.n} numbers {TORQUE_UNITS[name]}"
        raise InvalidInput(option, repr(text), wanted)
    if arm.inertia is None:
        raise InvalidInput(option, f"{text} for {arm.name}, whose masses are unknown", "an arm with masses, or none")
    return values if len(values) > 1 else values[0]
