"""Tasks: the components of a target pose that must be met."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import atan2, sqrt, tan
from typing import Any

import numpy as np

from optik.check import check_choice, real_array
from optik.compiled import compiled, inlined
from optik.errors import InvalidInput
from optik.kinematics import Chain, Range, forward, jacobian_from, squares, workspace
from optik.se3 import log_rotation, pose_error
from optik.types import Array

Goal = tuple[Array, Array]
"""A task's target as kernels take it: `Task.flags` (13,) [1, m, rad], and the target pose (4, 4) [1, m]."""
TASK_FRAMES = ("target", "base")
"""Frames of the components of an error."""
SERIES_ANGLE = 1e-3
"""Angle [rad] below which (1 − ½a cot ½a) / a² is replaced by its limit 1/12; the next term is a²/720."""
_MASKS = {
    "pose": (1, 1, 1, 1, 1, 1),
    "position": (1, 1, 1, 0, 0, 0),
    "rotation": (0, 0, 0, 1, 1, 1),
    "axis_x": (1, 1, 1, 0, 1, 1),
    "axis_y": (1, 1, 1, 1, 0, 1),
    "axis_z": (1, 1, 1, 1, 1, 0),
}
"""Masks of the named tasks."""


@dataclass(frozen=True)
class Task:
    """The required components of the pose error, (x, y, z, rx, ry, rz), along the axes of a frame.

    With one free rotation, the error of the other two is the angle between the tool's axis and the target's (in the frame
    ``"base"``: between the base axis in tool and in target coordinates). With two free rotations, it is the component of
    the rotation vector along the third axis.

    Parameters
    ----------
    mask : six of bool or 0/1
        The required components; at least one.
    frame : {"target", "base"}
        Frame of the components.
    box : number or six of them
        Half-width of the tolerance box of each component, ≥ 0 [m, rad]: the error is the distance from the box. Zero by
        default.

    Raises
    ------
    InvalidInput
        The mask is not six flags or has no true one; the frame is unknown; a side of the box is negative or infinite.
    """

    mask: tuple[bool, ...] = (True,) * 6
    frame: str = "target"
    box: tuple[float, ...] = (0.0,) * 6

    def __post_init__(self) -> None:
        given: Any = self.mask
        flags = tuple(given) if isinstance(given, Sequence | np.ndarray) and not isinstance(given, str) else ()
        if len(flags) != 6 or any(isinstance(f, str) or f not in (0, 1) for f in flags) or not any(flags):
            raise InvalidInput("task", repr(given)[:60], "six flags (x, y, z, rx, ry, rz), at least one of them true")
        check_choice(self.frame, "task.frame", TASK_FRAMES)
        object.__setattr__(self, "mask", tuple(bool(f) for f in flags))
        sides = real_array(self.box, "task.box", "a number ≥ 0, or six (x, y, z, rx, ry, rz)")
        if sides.shape not in ((), (6,)) or not (np.isfinite(sides) & (sides >= 0.0)).all():
            raise InvalidInput("task.box", repr(self.box)[:60], "a finite number ≥ 0, or six (x, y, z, rx, ry, rz)")
        object.__setattr__(self, "box", tuple(float(side) for side in np.broadcast_to(sides, 6)))

    @property
    def is_pose(self) -> bool:
        """Whether all components are required, without a tolerance box."""
        return all(self.mask) and not any(self.box)

    @property
    def size(self) -> int:
        """Number of required components."""
        return sum(self.mask)

    @property
    def exact(self) -> int:
        """Number of required components without a tolerance box."""
        return sum(met and side == 0.0 for met, side in zip(self.mask, self.box, strict=True))

    @cached_property
    def flags(self) -> Array:
        """The task as kernels take it: the mask as six numbers, 1 where the frame is the base, and the box; (13,)."""
        return np.array([*self.mask, self.frame == "base", *self.box], dtype=np.float64)


POSE = Task()
"""The task of the full pose."""


def as_task(value: object) -> Task:
    """Return a task, given by itself or by a name: pose, position, rotation, axis_x, axis_y, axis_z.

    ``axis_z`` requires the position and the direction of the tool's z axis (a spindle, a torch).
    """
    if isinstance(value, Task):
        return value
    if isinstance(value, str) and value in _MASKS:
        return Task(_MASKS[value])  # type: ignore[arg-type]
    raise InvalidInput("task", repr(value)[:60], f"a Task(mask, frame, box), or one of: {', '.join(_MASKS)}")


@compiled
def task_error(T: Array, target: Array, flags: Array, e: Array, w: Array) -> None:
    """Write the error of the tool beyond the tolerance box, along the axes of the task's frame.

    Shapes and units: T (4, 4) [1, m], target (4, 4) [1, m], flags (13,) [1, m, rad], e (6,) [m, rad] (overwritten), w (3,)
    [rad] (overwritten).
    """
    pose_error(T, target, e)
    p0, p1, p2 = e[0], e[1], e[2]
    D = np.empty((3, 3))
    if flags[6] == 0.0:  # D = R_tᵀ R, position along the target's axes
        for i in range(3):
            e[i] = target[0, i] * p0 + target[1, i] * p1 + target[2, i] * p2
            for j in range(3):
                D[i, j] = target[0, i] * T[0, j] + target[1, i] * T[1, j] + target[2, i] * T[2, j]
    else:  # D = R R_tᵀ
        for i in range(3):
            for j in range(3):
                D[i, j] = T[i, 0] * target[j, 0] + T[i, 1] * target[j, 1] + T[i, 2] * target[j, 2]
    log_rotation(D, w)
    free = 3.0 - flags[3] - flags[4] - flags[5]
    for i in range(3):
        e[3 + i] = -w[i]
    if free == 1.0:
        k = 0 if flags[3] == 0.0 else (1 if flags[4] == 0.0 else 2)
        i, j = (k + 1) % 3, (k + 2) % 3
        # the smallest rotation from a = D ê_k to ê_k has the axis a × ê_k, perpendicular to ê_k
        s = sqrt(D[i, k] * D[i, k] + D[j, k] * D[j, k])
        angle = atan2(s, D[k, k])
        e[3 + k] = 0.0
        e[3 + i] = D[j, k] * (angle / s) if s > 0.0 else angle
        e[3 + j] = -D[i, k] * (angle / s) if s > 0.0 else 0.0
    for i in range(6):
        side = flags[7 + i]
        if flags[i] == 0.0 or abs(e[i]) <= side:
            e[i] = 0.0
        else:  # the distance from the box
            e[i] -= side if e[i] > 0.0 else -side


@compiled
def task_rows(target: Array, flags: Array, w: Array, J: Array) -> None:
    """Transform the geometric Jacobian into that of `task_error`, in place.

    A component inside its box keeps its row with an error of zero, so that a step does not change it.

    Shapes and units: target (4, 4) [1, m], flags (13,) [1, m, rad], w (3,) [rad], J (6, n) [m/rad, 1] (overwritten).
    """
    free = 3.0 - flags[3] - flags[4] - flags[5]
    a = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    # J_l⁻¹(w) = I − ½[w] + c [w]² (Barfoot, State Estimation for Robotics, §7.1.5), for a single component
    c = 1.0 / 12.0 if a < SERIES_ANGLE else (1.0 - 0.5 * a / tan(0.5 * a)) / (a * a)
    x, y, z = w[0], w[1], w[2]
    for k in range(J.shape[1]):
        if flags[6] == 0.0:
            for b in (0, 3):
                v0, v1, v2 = J[b, k], J[b + 1, k], J[b + 2, k]
                for i in range(3):
                    J[b + i, k] = target[0, i] * v0 + target[1, i] * v1 + target[2, i] * v2
        if free == 2.0:
            v0, v1, v2 = J[3, k], J[4, k], J[5, k]
            c0, c1, c2 = y * v2 - z * v1, z * v0 - x * v2, x * v1 - y * v0
            J[3, k] = v0 - 0.5 * c0 + c * (y * c2 - z * c1)
            J[4, k] = v1 - 0.5 * c1 + c * (z * c0 - x * c2)
            J[5, k] = v2 - 0.5 * c2 + c * (x * c1 - y * c0)
        for i in range(6):
            if flags[i] == 0.0:
                J[i, k] = 0.0


@compiled
def keep_rows(flags: Array, J: Array, e: Array) -> int:
    """Move the required components of a task to the front; return their number.

    Shapes and units: flags (13,) [1, m, rad], J (6, n) [m/rad, 1], e (6,) [m, rad].
    """
    m = 0
    for i in range(6):
        if flags[i] != 0.0:
            e[m] = e[i]
            for k in range(J.shape[1]):
                J[m, k] = J[i, k]
            m += 1
    return m


@compiled
def task_system(target: Array, flags: Array, w: Array, J: Array, e: Array) -> int:
    """Write the linear system of a task by `task_rows` and `keep_rows`; return its size.

    Shapes and units: target (4, 4) [1, m], flags (13,) [1, m, rad], w (3,) [rad], J (6, n) [m/rad, 1] (overwritten), e (6,)
    [m, rad].
    """
    task_rows(target, flags, w, J)
    return keep_rows(flags, J, e)


@inlined
def whole_pose(flags: Array) -> bool:
    """Return whether a task requires the full pose without a box: `Task.is_pose` for kernels.

    Shapes and units: flags (13,) [1, m, rad].
    """
    pose = True
    for i in range(6):
        pose = pose and flags[i] == 1.0 and flags[7 + i] == 0.0
    return pose


@compiled
def goal_error(
    chain: Chain, flags: Array, target: Array, q: Array, frame: Array, T: Array, e: Array, w: Array
) -> tuple[float, float]:
    """Write the task error, joint frames and tool pose of one configuration; return the squared errors.

    Shapes and units: flags (13,) [1, m, rad], target (4, 4) [1, m], q (n,) [rad, m], frame (n, 4, 4) [1, m] (overwritten), T
    (4, 4) [1, m] (overwritten), e (6,) [m, rad] (overwritten), w (3,) [rad] (overwritten). Returns p2, r2  [m², rad²].
    """
    forward(chain, q, frame, T)
    task_error(T, target, flags, e, w)
    return squares(e)


@compiled
def goal_jacobian(chain: Chain, flags: Array, target: Array, frame: Array, T: Array, w: Array, J: Array) -> None:
    """Write the Jacobian of the error of `goal_error`.

    Shapes and units: flags (13,) [1, m, rad], target (4, 4) [1, m], frame (n, 4, 4) [1, m], T (4, 4) [1, m], w (3,) [rad], J
    (6, n) [m/rad, 1] (overwritten).
    """
    jacobian_from(chain, frame, T, J)
    task_rows(target, flags, w, J)


@compiled
def judge(chain: Chain, limits: Range, goal: Goal, slack: float, q: Array) -> tuple[float, float, bool]:
    """Return the errors of a configuration, and whether it satisfies its limits.

    Shapes and units: slack [rad, m], q (n,) [rad, m]. Returns position, rotation  [m, rad].
    """
    (lower, upper), (flags, target) = limits, goal
    e, w = np.empty(6), np.empty(3)
    frame, T, _J = workspace(chain, q.shape[0])
    p2, r2 = goal_error(chain, flags, target, q, frame, T, e, w)
    inside = True
    for i in range(q.shape[0]):
        inside = inside and lower[i] - slack <= q[i] <= upper[i] + slack
    return sqrt(p2), sqrt(r2), inside
