"""copp: convex path parametrisation with jerk limits (topp3_socp), seeded and refined as its documentation advises."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from benchmarks.peers.laws.base import TimingPeer
from optik.errors import NoSolution
from optik.types import Array
from planners.following.follow import JointPath
from planners.hermite import through
from planners.timing.base import refit
from planners.trajectory import Trajectory

STATIONS = 201
PASSES = 2


class Copp(TimingPeer):
    """``topp2_ra`` for a start, then ``topp3_socp`` around it, then around its own answer."""

    distribution = "copp-py"
    package = "copp_py"
    settings = (
        f"{STATIONS} equal stations with exact q', q'', q'''; topp2_ra, then topp3_socp linearised at its profile, then once "
        "more at its own (a and b): two passes; s(t) at the stations from s_to_t_topp3, its own polynomials between"
    )
    keeps: ClassVar[tuple[str, ...]] = ("velocity", "acceleration", "jerk")

    def __init__(self, limits: dict[str, Array]) -> None:
        import copp_py

        self._copp: Any = copp_py
        self._limits = limits

    def call(self, joint_path: JointPath) -> Any:
        """Samples, constraints, three solves, and times at the stations."""
        copp = self._copp
        s = np.linspace(0.0, joint_path.end, STATIONS)
        robot = copp.Robot(joint_path.robot.n, capacity=STATIONS)
        robot.append_s(s)
        q, dq, ddq, dddq = (np.ascontiguousarray(joint_path(s, order)) for order in range(4))
        robot.set_q(q, dq, ddq, 0, dddq=dddq)
        for add, field in (
            (robot.add_velocity_limits, "velocity"),
            (robot.add_acceleration_limits, "acceleration"),
            (robot.add_jerk_limits, "jerk"),
        ):
            if np.isfinite(self._limits[field]).all():
                add(self._limits[field], -self._limits[field], start_idx_s=0, length=STATIONS)
        try:
            seed = copp.solver.topp2_ra.Problem(
                robot.constraints, idx_s_interval=(0, STATIONS - 1), a_boundary=(0.0, 0.0)
            )
            a, b = copp.solver.topp2_ra.solve(seed), None
            for _ in range(PASSES):
                problem = copp.solver.topp3_socp.Problem(
                    robot.constraints, a, a_boundary=(0.0, 0.0), b_boundary=(0.0, 0.0), b_linearization=b
                )
                profile = copp.solver.topp3_socp.solve(problem)
                a, b = profile.a, profile.b
            _, t = copp.interpolation.s_to_t_topp3(s, profile, 0.0)
        except copp.CoppError as error:
            raise NoSolution(f"copp: {str(error)[:120]}") from None
        return s, t, profile

    def trajectory(self, joint_path: JointPath, raw: Any) -> Trajectory:
        """Through s, ṡ = √a and s̈ = b at the stations: what its profile is there, and exactly what it is between them."""
        s, t, profile = raw
        speed = np.sqrt(np.maximum(profile.a, 0.0))
        law = through(t, s[:, None], speed[:, None], profile.b[:, None])
        law.c = np.ascontiguousarray(law.c[..., 0])
        return refit(joint_path, law, self._limits["jerk"])


METHOD = Copp
