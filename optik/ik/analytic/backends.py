"""Closed forms of other packages behind one interface: from a pose to candidates.

Both packages describe an arm by the axes and offsets of its joints at one configuration (product of exponentials: Murray,
Li and Sastry, A Mathematical Introduction to Robotic Manipulation, §3.2; in the form of Elias and Wen, IK-Geo, 2022):
T(q) = Π Trans(P_i) Rot(H_i, q_i) · Trans(P_m) · Rot(R0). Locked joints are part of the offsets.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from optik.arm.robot import Robot
from optik.errors import MissingDependency, Unsupported
from optik.se3 import pose
from optik.types import Array

EXTRA = "closed-form"
"""Extra of this package that installs the other packages."""
Solve = Callable[[Array], Any]
"""Function from the tool pose (4, 4) times R0ᵀ to candidates (k, m) of the m moving joints."""


class BackendError(Exception):
    """Failure of another package with an arm or a pose; `closed_form` handles it."""


class Axes(NamedTuple):
    """Axes and offsets of an arm's moving joints in the base frame, with these joints at zero.

    H (m, 3) holds unit axes; P (m + 1, 3) [m] offsets from the base to the first axis, from axis to axis, and to the tool; R0
    (3, 3) is the rotation of the tool; `home` (n,) holds the locked joints at their values, and `moving` the others' indices.
    """

    H: Array
    P: Array
    R0: Array
    home: Array
    moving: NDArray[np.intp]

    @classmethod
    def from_robot(cls, robot: Robot) -> Axes:
        """Return the axes and offsets of a robot."""
        lower, upper = robot.limits.lower, robot.limits.upper
        moving = np.flatnonzero(lower < upper)
        rest = np.where(lower < upper, 0.0, lower)
        frame = robot.frames(rest)
        points = np.vstack([frame[moving, :3, 3], frame[-1, :3, 3]])
        P = np.vstack([points[:1], np.diff(points, axis=0)])
        return cls(np.ascontiguousarray(frame[moving, :3, 2]), P, frame[-1, :3, :3].copy(), rest, moving)


class Backend:
    """Closed form of another package, built for a robot."""

    def __init__(self, name: str, robot: Robot) -> None:
        if robot.linkage is not None:
            raise BackendError("a linkage")
        self.name = name
        self._axes = Axes.from_robot(robot)
        self._inverse_tool_rotation = pose(self._axes.R0.T)
        if robot.prismatic[self._axes.moving].any():
            raise BackendError("it supports revolute joints only")
        try:
            self._solve: Solve = {"ssik": _build_ssik, "eaik": _build_eaik}[name](self._axes)
        except ImportError as error:
            raise MissingDependency(name, f"IK method 'closed_form' with backend {name!r}", EXTRA) from error
        except BackendError:
            raise
        except Exception as error:  # whatever another package raises
            raise BackendError(f"{type(error).__name__}: {error}") from error
        self._verify(robot)

    def candidates(self, target: Array) -> Array:
        """Return the configurations (k, n) of the closed form for a pose, neither verified nor inside the limits."""
        axes = self._axes
        try:
            found = np.array(self._solve(target @ self._inverse_tool_rotation), dtype=np.float64, order="C").reshape(
                -1, axes.moving.size
            )
        except Exception as error:  # whatever another package raises
            raise BackendError(f"{type(error).__name__}: {error}") from error
        if axes.moving.size == axes.home.size:
            return found
        q = np.tile(axes.home, (len(found), 1))
        q[:, axes.moving] = found
        return q

    def _verify(self, robot: Robot) -> None:
        """Check that the backend finds the configurations of some poses; the first solve also completes lazy imports."""
        for q in robot.limits.sample(np.random.default_rng(2), 4):
            target = robot.fk(q)
            found = self.candidates(target)
            found = found[np.isfinite(found).all(axis=1)]
            right = np.abs(robot.pose_errors(found, target)).max(axis=1, initial=0.0) < 1e-6
            if not right.any():
                raise BackendError("it solves none of the tested poses")
            turns = np.abs((found[right] - q + np.pi) % (2.0 * np.pi) - np.pi).max(axis=1)
            if self._axes.moving.size <= 6 and turns.min() > 1e-4:
                raise BackendError("it misses the configuration from which a tested pose was computed")


def build_backend(name: str, robot: Robot) -> Backend | None:
    """Return the named backend, for ``"auto"`` the first that is installed and supports the arm, None for enumeration."""
    if name == "enumeration" or (name == "auto" and robot.linkage is not None):
        return None
    if name != "auto":
        try:
            return Backend(name, robot)
        except BackendError as error:
            works = "'auto' (the first closed form that supports this arm) or 'enumeration' (numerical, any arm)"
            raise Unsupported("backend", f"{name!r}, which does not support {robot.name}: {error}", works) from error
    for known in ("eaik", "ssik"):
        try:
            return Backend(known, robot)
        except (MissingDependency, BackendError):
            continue
    return None


def _build_eaik(axes: Axes) -> Solve:
    """Build the solver of EAIK (Ostermeier, Külz and Althoff, 2025): subproblem decomposition of up to six joints.

    Its results include least-squares solutions. At a singularity true branches degrade to these, so they are candidates
    too. For some arms it reports a known decomposition but has none; their kinematic family contains "Unknown".
    """
    from eaik.IK_HP import HPRobot

    arm = HPRobot(axes.H, axes.P)
    family = str(arm.getKinematicFamily())
    if "Unknown" in family or not arm.hasKnownDecomposition():
        raise BackendError(f"EAIK has no decomposition of it ({family})")
    return lambda T: arm.IK(T).Q


def _build_ssik(axes: Axes) -> Solve:
    """Build the solver of ssik (Srinivasa, 2026): subproblems for 6R, samples of the redundant joint for 7R.

    Only its closed forms are used. Its general elimination takes minutes to build, and its results for a general 6R arm
    were wrong (8.2.0); its joint locking for 7R takes seconds per solve. The compiled 6R solver is called as in the files
    that ``ssik build`` writes.
    """
    import ssik

    arm = ssik.Manipulator.from_axes(axes.H, axes.P)
    if arm.dispatch_plan.tier != 0:
        raise BackendError(f"ssik has no closed form of it ({arm.solver_name})")
    native = _load_ssik_native(arm)

    def solve(T: Array) -> Any:
        with np.errstate(all="ignore"):
            found = native(T) if native else None
            if found is None:
                found = arm.solve(T, respect_limits=False, enumerate_windings=False, allow_rescue=False)
        return [solution.q for solution in found]

    return solve


def _load_ssik_native(arm: Any) -> Solve | None:
    """Return ssik's compiled solver, 30 times as fast as its Python one, or None if it is not available."""
    try:
        from ssik._native import try_native_solve
    except ImportError:
        return None

    def solve(T: Array) -> Any:
        return try_native_solve(
            arm.solver_name, arm.kinbody, T, respect_limits=False, enumerate_windings=False, allow_rescue=False
        )

    return solve
