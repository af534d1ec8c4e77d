"""copp: convex path parametrisation with jerk limits (topp3_socp), initialised and refined as in its documentation."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from benchmarks.peers.laws.base import TimingPeer
from optik.errors import NoSolution
from optik.types import Array
from planners.following.follow import JointPath
from planners.timing.base import refit
from planners.trajectory import Trajectory
from planners.trajectory.curve import quintic_through

COPP_STATIONS = 201
"""Number of equally spaced stations in s: a compromise between computation time and duration of the motion."""
COPP_PASSES = 2
"""Passes of topp3_socp, each linearised at the result of the one before, as in its documentation."""


class Copp(TimingPeer):
    """``topp2_ra`` as initial guess, then ``topp3_socp`` linearised there, then again linearised at its own result."""

    distribution = "copp-py"
    package = "copp_py"
    settings = (
        f"{COPP_STATIONS} equal stations with exact q', q'', q'''; topp2_ra, then topp3_socp linearised at its profile, "
        "then once more at its own result (a and b): two passes; s(t) at the stations from s_to_t_topp3, its own polynomials "
        "between"
    )
    enforced: ClassVar[tuple[str, ...]] = ("velocity", "acceleration", "jerk")
    stations: ClassVar[int] = COPP_STATIONS
    """Number of equally spaced stations in s."""

    def __init__(self, limits: dict[str, Array]) -> None:
        import copp_py

        self._copp: Any = copp_py
        self._limits = limits

    def call(self, joint_path: JointPath) -> Any:
        """Compute samples and constraints, solve three times, and return the times at the stations."""
        copp, stations = self._copp, self.stations
        s = np.linspace(0.0, joint_path.end, stations)
        try:
            robot = self._constrained(joint_path, s)
            seed = copp.solver.topp2_ra.Problem(
                robot.constraints, idx_s_interval=(0, stations - 1), a_boundary=(0.0, 0.0)
            )
            a, b = copp.solver.topp2_ra.solve(seed), None
            for _ in range(COPP_PASSES):
                robot = self._again(robot, joint_path, s, a)
                problem = copp.solver.topp3_socp.Problem(
                    robot.constraints, a, a_boundary=(0.0, 0.0), b_boundary=(0.0, 0.0), b_linearization=b
                )
                profile = copp.solver.topp3_socp.solve(problem)
                a, b = profile.a, profile.b
            _, t = copp.interpolation.s_to_t_topp3(s, profile, 0.0)
        except copp.CoppError as error:
            raise NoSolution(f"copp: {str(error)[:120]}") from None
        return s, t, profile

    def _constrained(self, joint_path: JointPath, s: Array) -> Any:
        """Return copp's robot with the path at the stations and all given limits."""
        robot = self._copp.Robot(joint_path.robot.n, capacity=s.size)
        robot.append_s(s)
        q, dq, ddq, dddq = (np.ascontiguousarray(joint_path(s, order)) for order in range(4))
        robot.set_q(q, dq, ddq, 0, dddq=dddq)
        for add, field in (
            (robot.add_velocity_limits, "velocity"),
            (robot.add_acceleration_limits, "acceleration"),
            (robot.add_jerk_limits, "jerk"),
        ):
            if np.isfinite(self._limits[field]).all():
                add(self._limits[field], -self._limits[field], start_idx_s=0, length=s.size)
        return robot

    def _again(self, robot: Any, joint_path: JointPath, s: Array, a: Array) -> Any:
        """Return the robot for the next pass, with ṡ² (k,) of the previous one; here the same robot."""
        return robot

    def read(self, joint_path: JointPath, raw: Any) -> Trajectory:
        """Return the trajectory with s, ṡ = √a and s̈ = b of its profile at the stations, and its polynomials between them."""
        s, t, profile = raw
        speed = np.sqrt(np.maximum(profile.a, 0.0))
        law = quintic_through(t, s[:, None], speed[:, None], profile.b[:, None])
        law.c = np.ascontiguousarray(law.c[..., 0])
        return refit(joint_path, law, self._limits["jerk"])


METHOD = Copp
