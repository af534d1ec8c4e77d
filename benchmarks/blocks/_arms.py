"""Arms with a payload, as blocks of a suite name them."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator

from optik.arm.inertia import payload_masses
from optik.arm.library import load
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.registry import short_name


def arm_label(robot: str, payload: float | tuple[float, float] | None) -> str:
    """Return the name of an arm in reports."""
    if payload is None:
        return short_name(robot)
    low, high = payload_masses(payload)
    return f"{short_name(robot)} " + (f"{low:g} kg" if low == high else f"{low:g} to {high:g} kg")


def arm_with(robot: str, payload: float | tuple[float, float] | None) -> Robot:
    """Load an arm and give it a payload."""
    arm = load(robot)
    return arm if payload is None else arm.with_payload(payload)


def _payload(value: Any) -> float | tuple[float, float]:
    try:
        low, high = payload_masses(value)
    except InvalidInput as error:
        raise InvalidInput("", error.got, error.expected) from None
    return high if low == high else (low, high)


Payload = Annotated[float | tuple[float, float] | None, BeforeValidator(_payload)]
"""Mass of the payload [kg], or the lightest and the heaviest; by default that of the robot's own file."""
