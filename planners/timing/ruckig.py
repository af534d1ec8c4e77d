"""Ruckig on the path's s: the time-optimal jerk-limited motion of one number, under bounds that keep every joint."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import ruckig
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from optik.errors import NoSolution
from planners.fit import fitted
from planners.follow import JointPath
from planners.timing.base import DERIVATIVES, MotionLimits, TimeLaw, derivatives_at, refit
from planners.trajectory import Trajectory

Array = NDArray[np.float64]

SHORTEST = 5e-4
"""Time [s] in which the acceleration may rise to its bound: faster gains nothing, and its pieces drown in rounding."""


class RuckigLaw(TimeLaw):
    """One triple of bounds on ṡ, s̈, s⃛ for the whole path, chosen so that the joints keep their limits everywhere.

    With |q̇| ≤ |q'| V, |q̈| ≤ |q'| A + |q''| V² and |q⃛| ≤ |q'| J + 3 |q''| V A + |q'''| V³, every (V, A) leaves a
    largest J; the (V, A, J) of the shortest motion is searched. The bounds are safe, so they leave room: the motion is
    then scaled in time, uniformly, until its exact extrema just keep the limits. Ruckig (Berscheid and Kröger, RSS 2021)
    is used on the scalar s only: its joint waypoints would leave the path, and are sent to a cloud service.
    """

    name: ClassVar[str] = "ruckig"
    keeps: ClassVar[tuple[str, ...]] = DERIVATIVES

    def run(self, joint_path: JointPath, limits: MotionLimits) -> Trajectory:
        """Time the joint path.

        Raises
        ------
        InvalidInput
            Velocity, acceleration or jerk limits are missing.
        NoSolution
            No bounds on s keep the joints.
        """
        bound = self.need(limits, joint_path.robot)
        bounds = _search(joint_path, bound)
        if bounds is None:
            raise NoSolution("no motion along s keeps the joint limits", advice="higher limits, or another path")
        trajectory = refit(joint_path, _profile(joint_path.end, *bounds), bound["jerk"])
        return fitted(joint_path.robot, trajectory, limits, self.keeps)


def _search(joint_path: JointPath, bound: dict[str, Array]) -> tuple[float, float, float] | None:
    """(V, A, J) of the shortest motion: a grid over V and over A's share of what V leaves, then two finer ones."""
    q1, q2, q3 = derivatives_at(joint_path)
    length = joint_path.end
    with np.errstate(divide="ignore", invalid="ignore"):
        fastest = min(
            float(np.nanmin(bound["velocity"] / q1)),
            float(np.nanmin(np.sqrt(bound["acceleration"] / q2))),
            float(np.nanmin(np.cbrt(bound["jerk"] / q3))),
        )
        # A short line or a low jerk limit never comes near these speeds, so both grids are geometric.
        v_range, a_range, best = (1e-4, 1.0), (1e-3, 0.999), (np.inf, 0.0, 0.0, 0.0)
        for _ in range(3):
            for v in fastest * np.geomspace(*v_range, 14):
                room_a, room_j = bound["acceleration"] - q2 * v * v, bound["jerk"] - q3 * v**3
                most = min(float(np.nanmin(room_a / q1)), float(np.nanmin(room_j / (3.0 * q2 * v))))
                for share in np.geomspace(*a_range, 14):
                    a = share * most
                    j = min(float(np.nanmin((room_j - 3.0 * q2 * v * a) / q1)), a / SHORTEST)
                    if a > 0.0 and j > 0.0 and (duration := _duration(length, v, a, j)) < best[0]:
                        best, at = (duration, v, a, j), (v / fastest, share)
            if not np.isfinite(best[0]):
                return None
            v_range, a_range = (_closer(r, x) for r, x in zip((v_range, a_range), at, strict=True))
    return best[1:]


def _closer(grid: tuple[float, float], x: float) -> tuple[float, float]:
    """A seventh of a geometric grid, around x, within (0, 1)."""
    step = (grid[1] / grid[0]) ** (1.0 / 13.0)
    return x / step, min(x * step, 0.9999)


def _solved(length: float, v: float, a: float, j: float) -> Any:
    problem, answer = ruckig.InputParameter(1), ruckig.Trajectory(1)
    problem.current_position, problem.target_position = [0.0], [length]
    problem.max_velocity, problem.max_acceleration, problem.max_jerk = [v], [a], [j]
    try:
        result = ruckig.Ruckig(1).calculate(problem, answer)
    except ruckig.RuckigError:  # numbers too far apart for its roots
        result = ruckig.Result.Error
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        raise NoSolution(f"Ruckig found no motion along s ({result})")
    return answer


def _duration(length: float, v: float, a: float, j: float) -> float:
    try:
        return float(_solved(length, v, a, j).duration)
    except NoSolution:
        return float("inf")


def _profile(length: float, v: float, a: float, j: float) -> Any:
    """Ruckig's s(t) as a piecewise cubic, phases without length left out."""
    profile = _solved(length, v, a, j).profiles[0][0]
    phases = [i for i in range(7) if profile.t[i] > 1e-9]
    t = np.concatenate([[0.0], np.cumsum([profile.t[i] for i in phases])])
    c = np.array([[profile.j[i] / 6.0, profile.a[i] / 2.0, profile.v[i], profile.p[i]] for i in phases]).T
    return PPoly(c, t, extrapolate=True)


METHOD = RuckigLaw
