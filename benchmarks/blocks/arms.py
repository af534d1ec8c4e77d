"""Arms with a payload and scenes, as suites name them by a name or a file, and the torques of motions at instants."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator

from optik.arm.inertia import payload_masses
from optik.arm.library import load
from optik.arm.robot import Robot
from optik.dynamics import torques_batch
from optik.errors import InvalidInput
from optik.plugins.usage import resolve_data_file
from optik.registry import short_name
from optik.scene import Scene
from optik.types import Array
from planners.limits import DERIVATIVES, LOADED
from planners.trajectory import Trajectory


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


SCENES = {file.stem: str(file) for file in sorted((Path(__file__).parent / "scenes").glob("*.toml"))}
"""Files of the built-in scenes by name."""


def _scene(value: Any) -> str:
    if isinstance(value, str) and value in SCENES:
        return value
    if isinstance(value, str) and "." not in value and "/" not in value:
        raise InvalidInput("", repr(value), f"one of {', '.join(SCENES)}, or the path of a file")
    return resolve_data_file(value, "scene")


SceneName = Annotated[str, BeforeValidator(_scene)]
"""The name of a built-in scene, or the path of a file."""


def scene_named(name: str, margin: float = 0.0) -> Scene:
    """Load a scene; a margin [m] replaces the scene's own."""
    scene = Scene.load(SCENES.get(name, name))
    return replace(scene, margin=margin) if margin else scene


JOINT_LIMITS = (*DERIVATIVES, *LOADED)
"""Limits on every joint: for each, reports show the largest ratio to it, with its joint and its time."""


def torques_at(robot: Robot, motion: Trajectory, t: Array) -> tuple[Array, Array]:
    """Return torques and their rates at instants."""
    states = np.ascontiguousarray(np.stack([motion(t, order) for order in range(4)], axis=1))
    found = []
    for held in robot.loads:
        out = np.empty((t.size, 2, robot.n))
        torques_batch(robot.chain, held.bodies, held.viscous, states, out)
        out[:, 0] += held.coulomb * np.sign(states[:, 1])
        found.append(out)
    stacked = np.stack(found)
    return stacked[:, :, 0], stacked[:, :, 1]
