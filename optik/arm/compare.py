"""Comparison of two models of an arm, and the base, tool, joint zeros and directions that explain a difference.

With other(q) = base · first(signs ∘ q + offsets) · tool, the directions of the joint axes of both models at q = 0 give
the rotation of the base and the offsets of revolute joints, one joint after the other; all lengths then follow from one
linear least-squares problem. Every explanation is verified by the tool poses before it is reported.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice, product
from math import atan2, degrees, pi
from typing import Any, NamedTuple

import numpy as np

from optik import kinematics, se3
from optik.arm.limits import JointLimits
from optik.arm.model import ArmModel
from optik.check import check_number
from optik.types import Array, Flags

COMPARED = 40
"""Number of configurations that are compared: 240 equations, far more than an explanation has unknowns."""
SIGNS_TRIED = 512
"""Largest number of combinations of joint directions that are tried, fewest reversed joints first: all for nine joints."""
UNEXPLAINED = "angles and distances of neighbouring axes agree; lengths along the axes may differ"
"""Reason of a difference that neither the axes nor an explanation describes."""
PARALLEL = 1e-3
"""Angle [rad] below which two axes count as parallel: the direction of their common normal is then mostly noise."""


@dataclass(frozen=True, eq=False)
class ArmComparison:
    """Result of a comparison of two models of an arm; true if they agree without an explanation.

    Attributes
    ----------
    agree : bool
        Whether all tool poses agree within the tolerances.
    explained : bool
        Whether they agree after other(q) = base · first(signs ∘ q + offsets) · tool.
    position, rotation : float
        Largest difference of the tool's position [m] and rotation [rad]; infinite if the joints do not match.
    position_left, rotation_left : float
        Largest differences [m], [rad] after the explanation; as before if there is none.
    base, tool : (4, 4) array
        Transforms of the explanation [1, m]; the identity if none is needed.
    signs : (n,) array
        Directions of the joints, +1 or −1 [1].
    offsets : (n,) array
        Offsets of the joint zeros [rad, m].
    reasons : tuple of str
        The explanation in words; if there is none, the differences that no explanation can remove.
    names : tuple of two str
        Names of the robots.
    gravity : float
        Angle between the directions of gravity after the explanation [rad]; 0 within the tolerance of rotations.
    """

    agree: bool
    explained: bool
    position: float
    rotation: float
    position_left: float
    rotation_left: float
    base: Array
    tool: Array
    signs: Array
    offsets: Array
    reasons: tuple[str, ...]
    names: tuple[str, str]
    gravity: float = 0.0

    def __bool__(self) -> bool:
        return self.agree

    def __str__(self) -> str:
        first, other = self.names if self.names[0] != self.names[1] else (self.names[0], "the other")
        head = f"{first} and {other}"
        if not np.isfinite(self.position):
            return f"{head} cannot be compared: {'; '.join(self.reasons)}"
        difference = f"by up to {self.position:.3g} m and {degrees(self.rotation):.3g}°"
        gravity = f"\n  - gravity differs by {degrees(self.gravity):.3g}°" if self.gravity else ""
        if self.agree:
            return f"{head} agree: they differ {difference}{gravity}"
        reasons = "\n".join(f"  - {reason}" for reason in self.reasons) + gravity
        if self.explained:
            left = f"{self.position_left:.2g} m and {degrees(self.rotation_left):.2g}°"
            return f"{head} differ {difference}; this explains it and leaves {left}:\n{reasons}"
        return f"{head} differ {difference}; no base, tool, zero or sign explains it\n{reasons}".rstrip()


class _Candidate(NamedTuple):
    """One explanation: the remaining differences [m], [rad], base, tool, signs and offsets, and the number of its parts."""

    left: tuple[float, float]
    values: tuple[Array, Array, Array, Array]
    parts: int


class _Pair:
    """Two arms, the poses to be matched, and the axes and tools of both at q = 0, those of the first arm first."""

    def __init__(self, first: ArmModel, other: ArmModel, position: float, rotation: float) -> None:
        self.first, self.n, self.prismatic = first, first.n, first.prismatic
        self.position, self.rotation = position, rotation
        self.q = _configurations(first, other)
        self.target = _frames(other, self.q)[:, -1]
        if first.linkage is None and other.linkage is None:
            home = np.concatenate([_frames(arm, np.zeros((1, arm.n))) for arm in (first, other)])
            self.axes, self.points, self.tools = home[:, :-1, :3, 2], home[:, :-1, :3, 3], home[:, -1, :3, :3]

    def differences(self, poses: Array) -> tuple[float, float]:
        """Return the largest position [m] and rotation [rad] differences from the poses of the other arm."""
        e = se3.error(poses, self.target)
        return float(np.linalg.norm(e[:, :3], axis=1).max()), float(np.linalg.norm(e[:, 3:], axis=1).max())

    def is_within(self, position: float, rotation: float) -> bool:
        """Return whether differences are within the tolerances."""
        return position <= self.position and rotation <= self.rotation

    def matters(self, T: Array) -> bool:
        """Return whether a transform differs from the identity by more than the tolerances."""
        e = se3.error(np.eye(4), T)
        return not self.is_within(float(np.linalg.norm(e[:3])), float(np.linalg.norm(e[3:])))


def compare_arms(first: ArmModel, other: ArmModel, *, position: float = 1e-6, rotation: float = 1e-6) -> ArmComparison:
    """Compare two models of an arm, and explain the difference; see `Robot.compare`."""
    position = check_number(position, "position", "a tolerance above 0 [m]", above=0.0)
    rotation = check_number(rotation, "rotation", "a tolerance above 0 [rad]", above=0.0)
    nothing, names = (np.eye(4), np.eye(4), np.ones(first.n), np.zeros(first.n)), (first.name, other.name)
    if mismatch := _find_joint_differences(first, other):
        return ArmComparison(False, False, np.inf, np.inf, np.inf, np.inf, *nothing, mismatch, names)
    pair = _Pair(first, other, position, rotation)
    plain = pair.differences(_frames(first, pair.q)[:, -1])
    if pair.is_within(*plain):
        return ArmComparison(True, True, *plain, *plain, *nothing, (), names, _gravity_angle(pair, other, np.eye(4)))
    if first.linkage is not None or other.linkage is not None:
        return ArmComparison(False, False, *plain, *plain, *nothing, (UNEXPLAINED,), names)
    against = tuple(_find_axis_differences(pair))
    best = None if against else _find_simplest(pair)
    gravity = _gravity_angle(pair, other, np.eye(4) if best is None else best.values[0])
    if best is None:
        return ArmComparison(False, False, *plain, *plain, *nothing, against or (UNEXPLAINED,), names, gravity)
    return ArmComparison(False, True, *plain, *best.left, *best.values, tuple(_reasons(pair, best)), names, gravity)


def _gravity_angle(pair: _Pair, other: ArmModel, base: Array) -> float:
    """Return the angle between the directions of gravity with a transform (4, 4) between the bases, 0 within tolerance."""
    turned = base[:3, :3] @ pair.first.gravity
    angle = atan2(float(np.linalg.norm(np.cross(turned, other.gravity))), float(turned @ other.gravity))
    return angle if angle > pair.rotation else 0.0


def _find_joint_differences(first: ArmModel, other: ArmModel) -> tuple[str, ...]:
    if first.n != other.n:
        return (f"{first.n} joints and {other.n}",)
    kinds = ("turns", "slides")
    return tuple(
        f"joint {i + 1} {kinds[int(first.prismatic[i])]} in one and {kinds[int(other.prismatic[i])]} in the other"
        for i in np.flatnonzero(first.prismatic != other.prismatic)
    )


def _configurations(first: ArmModel, other: ArmModel) -> Array:
    """Sample configurations (COMPARED, n) inside the limits of both arms, or of the first if a joint's ranges are disjoint."""
    lower = np.maximum(first.limits.lower, other.limits.lower)
    upper = np.minimum(first.limits.upper, other.limits.upper)
    apart = lower > upper
    lower, upper = np.where(apart, first.limits.lower, lower), np.where(apart, first.limits.upper, upper)
    half = np.where(first.prismatic, 1.0, pi)
    return JointLimits(lower, upper).sample(np.random.default_rng(0), COMPARED, half_if_infinite=half)


def _frames(arm: ArmModel, q: Array) -> Array:
    """Return the joint frames and, last, the tool poses (k, N + 1, 4, 4) of an arm at configurations (k, n)."""
    out = np.empty((len(q), len(arm.fixed) + 1, 4, 4))
    kinematics.frames_batch(arm.chain, q, out)
    return out


# ---------------------------------------------------------------- invariants of all explanations


def _find_axis_differences(pair: _Pair) -> Iterator[str]:
    """Describe differing angles and distances of neighbouring axes, which no base, tool, joint zero or direction changes."""
    for i in range(pair.n - 1):
        (angle, distance), (angle_other, distance_other) = (
            _angle_and_distance(*lines)
            for lines in zip(pair.axes[:, i : i + 2], pair.points[:, i : i + 2], strict=True)
        )
        names = f"the axes of joints {i + 1} and {i + 2}"
        if abs(angle - angle_other) > 4.0 * pair.rotation:
            yield f"{names} are {degrees(angle):.6g}° to each other in one and {degrees(angle_other):.6g}° in the other"
        elif not pair.prismatic[i : i + 2].any() and abs(distance - distance_other) > 4.0 * pair.position:
            yield f"{names} are {distance:.6g} m apart in one and {distance_other:.6g} m in the other"


def _angle_and_distance(axes: Array, points: Array) -> tuple[float, float]:
    """Return the angle [rad] in [0, π/2] and the distance [m] of two lines."""
    normal = np.cross(axes[0], axes[1])
    sine, between = float(np.linalg.norm(normal)), points[1] - points[0]
    if sine < PARALLEL:
        distance = float(np.linalg.norm(between - (between @ axes[0]) * axes[0]))
    else:
        distance = abs(float(between @ normal)) / sine
    return atan2(sine, abs(float(axes[0] @ axes[1]))), distance


# ---------------------------------------------------------------- the search


def _find_simplest(pair: _Pair) -> _Candidate | None:
    """Return the verified explanation of fewest parts; a reversed joint, an offset, the base and the tool are one part each."""
    best: _Candidate | None = None
    for signs in _sign_vectors(pair):
        flips = int((signs < 0.0).sum())
        for offsets, base, tool in product((False, True), repeat=3):
            if best is not None and best.parts <= flips + offsets + base + tool:
                continue
            found = _fit(pair, signs, offsets=offsets, base=base, tool=tool)
            if pair.is_within(*found.left) and (best is None or found.parts < best.parts):
                best = found
    return best


def _sign_vectors(pair: _Pair) -> list[Array]:
    """List the joint directions that the angles and moments of neighbouring axes allow, fewest reversed joints first."""
    allowed = []
    for i in range(pair.n - 1):
        cosines = [float(axes[i] @ axes[i + 1]) for axes in pair.axes]
        moments = [
            float((points[i + 1] - points[i]) @ np.cross(axes[i], axes[i + 1]))
            for axes, points in zip(pair.axes, pair.points, strict=True)
        ]
        told = 0.0
        if min(map(abs, cosines)) > PARALLEL:
            told = float(np.sign(cosines[0] * cosines[1]))
        elif not pair.prismatic[i : i + 2].any() and min(map(abs, moments)) > 10.0 * pair.position:
            told = float(np.sign(moments[0] * moments[1]))
        allowed.append((1.0, -1.0) if told == 0.0 else (told,))
    steps = islice(product((1.0, -1.0), *allowed), 2**16)
    found: list[Array] = [np.cumprod(np.array(s)) for s in steps]
    return sorted(found, key=lambda s: int((s < 0.0).sum()))[:SIGNS_TRIED]


def _fit(pair: _Pair, signs: Array, *, offsets: bool, base: bool, tool: bool) -> _Candidate:
    """Fit the explanation with these signs and the allowed parts: rotations first, then all lengths together."""
    n = pair.n
    X, Y, o = np.eye(3), np.eye(3), np.zeros(n)
    if base and (offsets or tool):
        X = _base_rotation(pair, signs)
    if offsets:
        o = _find_offsets(pair, signs, X, skip_first=base, to_tool=not tool)
    R = _frames(pair.first, signs * pair.q + o)[:, -1, :3, :3]
    if base and not (offsets or tool):
        X = _mean_rotation(pair.target[:, :3, :3] @ np.swapaxes(R, 1, 2))
    if tool:
        Y = _mean_rotation(np.swapaxes(X @ R, 1, 2) @ pair.target[:, :3, :3])
    slides = pair.prismatic & offsets
    x, y, o[slides] = _lengths(pair, _frames(pair.first, signs * pair.q + o), X, slides, base=base, tool=tool)
    T_base, T_tool = se3.pose(X, x), se3.pose(Y, y)
    left = pair.differences(T_base @ _frames(pair.first, signs * pair.q + o)[:, -1] @ T_tool)
    shifted = np.abs(o) > np.where(pair.prismatic, pair.position, pair.rotation)
    parts = int((signs < 0.0).sum() + shifted.sum()) + pair.matters(T_base) + pair.matters(T_tool)
    return _Candidate(left, (T_base, T_tool, signs, o), parts)


def _mean_rotation(R: Array) -> Array:
    """Return the rotation (3, 3) nearest to the mean of rotations (k, 3, 3)."""
    U, _, Vt = np.linalg.svd(R.mean(axis=0))
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt)


def _base_rotation(pair: _Pair, signs: Array) -> Array:
    """Return the base rotation that aligns the first axis, and the next axis not parallel to it, with the other's."""
    a, b = signs[0] * pair.axes[0, 0], pair.axes[1, 0]
    w, sine, cosine = np.cross(a, b), float(np.linalg.norm(np.cross(a, b))), float(a @ b)
    if sine < 1e-12:  # same or opposite direction: any perpendicular axis
        w = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))])
    X = se3.exp_so3(atan2(sine, cosine) / np.linalg.norm(w) * w)
    angle = _angle_about(pair, signs, X, 0, to_tool=False)
    return np.asarray(se3.exp_so3(angle * b) @ X)


def _find_offsets(pair: _Pair, signs: Array, X: Array, *, skip_first: bool, to_tool: bool) -> Array:
    """Return the offsets (n,) of the revolute joints from the directions of the next axes; 0 for prismatic joints."""
    offsets, R = np.zeros(pair.n), X
    for i in range(pair.n):
        if pair.prismatic[i]:
            continue
        if i > 0 or not skip_first:
            # the other's axis is the first's times the sign, and the angle about it has the same sign
            offsets[i] = signs[i] * _angle_about(pair, signs, R, i, to_tool=to_tool)
            R = R @ se3.exp_so3(offsets[i] * pair.axes[0, i])
    return offsets


def _angle_about(pair: _Pair, signs: Array, R: Array, i: int, *, to_tool: bool) -> float:
    """Return the angle about joint i's axis of the other arm that aligns the next axes of both arms."""
    # R (3, 3) is the rotation that all joints before i apply to the first arm's axes at q = 0. The angle follows from the
    # direction of the next axis, or from its position if it is parallel; a parallel prismatic joint does not determine
    # it. After the last joint it follows from the tool.
    axis = pair.axes[1, i]
    for k in range(i + 1, pair.n):
        v, target = signs[k] * (R @ pair.axes[0, k]), pair.axes[1, k]
        if np.linalg.norm(np.cross(axis, v)) > PARALLEL:
            return _turn(axis, v, target)
        if not pair.prismatic[k]:
            v, target = R @ (pair.points[0, k] - pair.points[0, i]), pair.points[1, k] - pair.points[1, i]
            apart = np.linalg.norm(np.cross(axis, v)) > 10.0 * pair.position
            return _turn(axis, v, target) if apart else 0.0
    if not to_tool:
        return 0.0
    W = pair.tools[1] @ (R @ pair.tools[0]).T
    sine = 0.5 * float(axis @ [W[2, 1] - W[1, 2], W[0, 2] - W[2, 0], W[1, 0] - W[0, 1]])
    return atan2(sine, 0.5 * (float(np.trace(W)) - 1.0))


def _turn(axis: Array, v: Array, target: Array) -> float:
    """Return the angle about an axis from one vector to another, both projected along the axis."""
    a, b = v - (v @ axis) * axis, target - (target @ axis) * axis
    return atan2(float(axis @ np.cross(a, b)), float(a @ b))


def _lengths(
    pair: _Pair, frames: Array, X: Array, slides: Flags, *, base: bool, tool: bool
) -> tuple[Array, Array, Array]:
    """Return the translations of base and tool (3,), (3,), and the offsets of the sliding joints."""
    # The positions are linear in them: p_other = X p + x + X R y + X Σ d_i o_i. The solution of least norm is taken.
    p, R, d = frames[:, -1, :3, 3], frames[:, -1, :3, :3], np.swapaxes(frames[:, :-1, :3, 2][:, slides], 1, 2)
    rest = (pair.target[:, :3, 3] - p @ X.T).reshape(-1)
    columns = [np.tile(np.eye(3), (COMPARED, 1))] * base + [(X @ R).reshape(-1, 3)] * tool
    columns.append((X @ d).reshape(3 * COMPARED, -1))
    found: Any = np.linalg.lstsq(np.hstack(columns), rest, rcond=1e-9)[0]
    x, y, o = np.split(found, (3 * base, 3 * base + 3 * tool))
    return x if base else np.zeros(3), y if tool else np.zeros(3), o


# ---------------------------------------------------------------- reasons in words


def _reasons(pair: _Pair, found: _Candidate) -> Iterator[str]:
    base, tool, signs, offsets = found.values
    for which, T in (("base", base), ("tool", tool)):
        if pair.matters(T):
            yield f"the {which}s differ {_transform_in_words(pair, T, which)}"
    for i in range(pair.n):
        slides = bool(pair.prismatic[i])
        if signs[i] < 0.0:
            yield f"joint {i + 1} {'slides' if slides else 'turns'} the other way"
        if abs(offsets[i]) > (pair.position if slides else pair.rotation):
            shift = f"{offsets[i]:.6g} m" if slides else f"{degrees(offsets[i]):.6g}°"
            yield f"joint {i + 1} has its zero offset by {shift}"


def _transform_in_words(pair: _Pair, T: Array, which: str) -> str:
    words, e = [], se3.error(np.eye(4), T)
    move, turn = float(np.linalg.norm(e[:3])), float(np.linalg.norm(e[3:]))
    if move > pair.position:
        words.append(f"by {_describe_vector(e[:3], pair.position, 'm', 1.0)} of the {which}")
    if turn > pi - pair.rotation and e[3:].sum() < 0.0:
        e[3:] = -e[3:]  # rotations by π about ±axis are equal
    if turn > pair.rotation:
        words.append(f"by a turn of {_describe_vector(e[3:], pair.rotation, '°', 180.0 / pi, 'about')}")
    return " and ".join(words)


def _describe_vector(v: Array, least: float, unit: str, scale: float, word: str = "along") -> str:
    """Return a vector in words: its length, and its axis or direction."""
    space = " " if unit == "m" else ""
    large = np.flatnonzero(np.abs(v) > least)
    if large.size == 1:
        return f"{v[large[0]] * scale:.6g}{space}{unit} {word} {'xyz'[large[0]]}"
    size = float(np.linalg.norm(v))
    v = np.where(np.abs(v) > least, v, 0.0)
    return f"{size * scale:.6g}{space}{unit} {word} ({', '.join(f'{x:.4g}' for x in v / size)})"
