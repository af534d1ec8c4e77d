"""Closed forms of other packages behind one interface, pose in, candidates out; imported when built, tried before use.

Both take an arm as the axes and offsets of its joints at one configuration (product of exponentials: Murray, Li and
Sastry, A Mathematical Introduction to Robotic Manipulation, §3.2; the form of Elias and Wen, IK-Geo, 2022):
T(q) = Π Trans(P_i) Rot(H_i, q_i) · Trans(P_m) · Rot(R0). Joints whose limits are one value are part of the offsets.
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
"""Extra of this package that installs them."""

Solve = Callable[[Array], Any]
"""From the tool pose (4, 4) with R0 taken off to candidates (k, m) for the m joints that move."""


class Refused(Exception):
    """Another package cannot solve this arm, or raised an error, which the text says; handled inside `closed_form`."""


class Axes(NamedTuple):
    """An arm as its moving joints' axes and offsets, all in the base frame where these joints are at zero.

    Attributes
    ----------
    H : (m, 3) array
        Unit axes.
    P : (m + 1, 3) array
        From the base to the first axis, from axis to axis, and to the tool [m].
    R0 : (3, 3) array
        Rotation of the tool there.
    rest : (n,) array
        The configuration: joints that cannot move at their value, the others at zero.
    moving : (m,) array of int
        Which joints can move.
    """

    H: Array
    P: Array
    R0: Array
    rest: Array
    moving: NDArray[np.intp]

    @classmethod
    def of(cls, robot: Robot) -> Axes:
        """Read them off a robot's own frames."""
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
        self.name = name
        self._axes = Axes.of(robot)
        self._unturned = pose(self._axes.R0.T)
        if robot.prismatic[self._axes.moving].any():
            raise Refused("it takes revolute joints only")
        try:
            self._solve: Solve = {"ssik": _ssik, "eaik": _eaik}[name](self._axes)
        except ImportError as error:
            raise MissingDependency(name, f"IK method 'closed_form' with backend {name!r}", EXTRA) from error
        except Refused:
            raise
        except Exception as error:  # whatever another package raises
            raise Refused(f"{type(error).__name__}: {error}") from error
        self._try(robot)

    def candidates(self, target: Array) -> Array:
        """Configurations that the closed form gives for a pose, not checked, limits aside."""
        axes = self._axes
        try:
            found = np.array(self._solve(target @ self._unturned), dtype=np.float64, order="C").reshape(
                -1, axes.moving.size
            )
        except Exception as error:  # whatever another package raises
            raise Refused(f"{type(error).__name__}: {error}") from error
        if axes.moving.size == axes.rest.size:
            return found
        q = np.tile(axes.rest, (len(found), 1))
        q[:, axes.moving] = found
        return q

    def _try(self, robot: Robot) -> None:
        """Check that it finds the configurations of some poses; solving once also loads what it loads late."""
        for q in robot.limits.sample(np.random.default_rng(2), 4):
            target = robot.fk(q)
            found = self.candidates(target)
            found = found[np.isfinite(found).all(axis=1)]
            right = np.abs(robot.pose_errors(found, target)).max(axis=1, initial=0.0) < 1e-6
            if not right.any():
                raise Refused("it answers none of the poses that it was tried with")
            turns = np.abs((found[right] - q + np.pi) % (2.0 * np.pi) - np.pi).max(axis=1)
            if self._axes.moving.size <= 6 and turns.min() > 1e-4:
                raise Refused("it misses the configuration that a pose was made from")


def choose(name: str, robot: Robot) -> Backend | None:
    """Return the backend of a name, for ``"auto"`` the first that is installed and solves the arm."""
    if name == "enumeration":
        return None
    if name != "auto":
        try:
            return Backend(name, robot)
        except Refused as error:
            works = "'auto' (the first closed form that does this arm) or 'enumeration' (numerical, any arm)"
            raise Unsupported("backend", f"{name!r}, which does not do {robot.name}: {error}", works) from error
    for known in ("eaik", "ssik"):
        try:
            return Backend(known, robot)
        except (MissingDependency, Refused):
            continue
    return None


def _eaik(axes: Axes) -> Solve:
    """EAIK (Ostermeier, Külz and Althoff, 2025): subproblem decomposition, up to six joints.

    Its answers include near misses, marked as least squares: at a singularity these are what is left of true branches,
    so they are passed on. It claims a known decomposition for arms that it has none for, and prints when asked to solve
    them; the family says so.
    """
    from eaik.IK_HP import HPRobot

    arm = HPRobot(axes.H, axes.P)
    family = str(arm.getKinematicFamily())
    if "Unknown" in family or not arm.hasKnownDecomposition():
        raise Refused(f"EAIK knows no decomposition of it ({family})")
    return lambda T: arm.IK(T).Q


def _ssik(axes: Axes) -> Solve:
    """Ssik (Srinivasa, 2026): subproblems for 6R, samples over the free joint for 7R. Only its closed forms are taken.

    Its general elimination takes minutes to build, and answered a general 6R arm wrongly (8.2.0); its joint-locking for
    7R takes seconds a solve. The compiled 6R solver is called as the files that ``ssik build`` writes call it.
    """
    import ssik

    arm = ssik.Manipulator.from_axes(axes.H, axes.P)
    if arm.dispatch_plan.tier != 0:
        raise Refused(f"ssik has no closed form of it ({arm.solver_name})")
    native = _ssik_native(arm)

    def solve(T: Array) -> Any:
        with np.errstate(all="ignore"):
            found = native(T) if native else None
            if found is None:
                found = arm.solve(T, respect_limits=False, enumerate_windings=False, allow_rescue=False)
        return [solution.q for solution in found]

    return solve


def _ssik_native(arm: Any) -> Solve | None:
    """Return ssik's compiled solver, 30 times as fast as its Python one, where this version and machine have it."""
    try:
        from ssik._native import try_native_solve
    except ImportError:
        return None

    def solve(T: Array) -> Any:
        return try_native_solve(
            arm.solver_name, arm.kinbody, T, respect_limits=False, enumerate_windings=False, allow_rescue=False
        )

    return solve
