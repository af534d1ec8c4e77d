"""Arms with a payload, as blocks of a suite have them."""

from __future__ import annotations

from typing import Any

from optik.arm.inertia import payload_masses
from optik.arm.library import load
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.registry import short_name


def arm_label(robot: str, payload: float | tuple[float, float] | None) -> str:
    """What reports call an arm.

    Parameters
    ----------
    robot : str
        Its name, or the path of a file.
    payload : float or pair of floats or None
        Mass in the tool [kg].

    Returns
    -------
    str
        Such as ``panda`` or ``panda 1.5 kg``.
    """
    if payload is None:
        return short_name(robot)
    low, high = payload_masses(payload)
    return f"{short_name(robot)} " + (f"{low:g} kg" if low == high else f"{low:g} to {high:g} kg")


def arm_with(robot: str, payload: float | tuple[float, float] | None) -> Robot:
    """Load an arm and give it a payload.

    Parameters
    ----------
    robot : str
        Its name, or the path of a file.
    payload : float or pair of floats or None
        Mass in the tool [kg]; None for what the file states.

    Returns
    -------
    Robot
        The arm.

    Raises
    ------
    UnknownName, InvalidInput
        As `optik.load` and `Robot.with_payload`.
    RobotModelError
        A payload on an arm whose masses are unknown.
    """
    arm = load(robot)
    return arm if payload is None else arm.with_payload(payload)


def read_payload(value: Any, where: str) -> float | tuple[float, float] | None:
    """Check a payload.

    Parameters
    ----------
    value : object
        A mass [kg], a list [lightest, heaviest], or None.
    where : str
        Its place in the suite, for errors.

    Returns
    -------
    float or pair of floats or None
        The mass or the interval [kg].

    Raises
    ------
    InvalidInput
        Anything else.
    """
    if value is None:
        return None
    try:
        low, high = payload_masses(value)
    except InvalidInput as error:
        raise InvalidInput(where, error.got, error.expected) from None
    return high if low == high else (low, high)
