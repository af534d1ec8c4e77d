"""Minimum-time nonlinear programme in CasADi: fixed nodes in s, free time steps, constant s⃛ on each interval.

State (ṡ, s̈) at node k, control (Δt, s⃛) to the next: all constraints are polynomial and regular at rest.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from scipy.interpolate import PPoly

from benchmarks.peers.laws.base import TimingPeer
from optik.errors import NoSolution
from optik.types import Array
from planners.following.follow import JointPath
from planners.limits import DERIVATIVES
from planners.timing.base import refit
from planners.trajectory import Trajectory

NLP_INTERVALS = 50
"""Number of intervals; 100 take twice as long and reduce T from about 0.13 % to 0.05 % above the optimum."""
NLP_ITERATIONS = 300
"""Iteration limit of the solver: solves that succeeded took 14 to 150 iterations."""
SMALLEST_STEP, LARGEST_RATIO = 1e-3, 20.0
"""Bounds on time steps over the mean step, the upper one also on ṡ over the mean speed: otherwise fatrop may not terminate."""


class CasadiProgramme(TimingPeer):
    """Minimum time by CasADi's ``nlpsol``; a subclass for each solver has its name and options."""

    distribution = "casadi"
    package = "casadi"
    enforced: ClassVar[tuple[str, ...]] = DERIVATIVES
    solver: ClassVar[str]
    options: ClassVar[dict[str, Any]]

    def __init__(self, limits: dict[str, Array]) -> None:
        import casadi

        self._limits = limits
        self._solver, self._bounds = _built(casadi, self.solver, self.options, limits["velocity"].size)

    def call(self, joint_path: JointPath) -> Any:
        """Solve once for the derivatives at the nodes, with a quintic motion from rest to rest as the initial guess."""
        u = np.linspace(0.0, 1.0, NLP_INTERVALS + 1)
        s = joint_path.end * u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
        v, a = 30.0 * u**2 * (1.0 - u) ** 2, 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u)
        # scaled by the length of the path and the duration of the initial guess, so that all variables are near 1
        shares, duration = _shares(joint_path, s, self._limits, v, a)
        start = np.zeros(4 * NLP_INTERVALS + 2)
        start[0::4], start[1::4], start[2::4], start[3::4] = v, a, 1.0 / NLP_INTERVALS, np.diff(a) * NLP_INTERVALS
        least, most = np.full(start.size, -np.inf), np.full(start.size, np.inf)
        least[0::4], least[2::4] = 0.0, SMALLEST_STEP / NLP_INTERVALS
        most[0::4], most[2::4] = LARGEST_RATIO, LARGEST_RATIO / NLP_INTERVALS
        p = np.concatenate([np.diff(s) / joint_path.end, shares.ravel()])
        answer = self._solver(x0=start, p=p, lbx=least, ubx=most, **self._bounds)
        stats = self._solver.stats()
        if not stats["success"]:
            raise NoSolution(f"{self.solver} ended with {stats['return_status']}")
        return np.asarray(answer["x"]).ravel(), s, duration

    def read(self, joint_path: JointPath, raw: Any) -> Trajectory:
        """Return the trajectory of its s(t), a cubic on each interval."""
        x, s, duration = raw
        unit = joint_path.end
        v, a, steps, jerk = (x[i::4] for i in range(4))
        pieces = [jerk * unit / 6.0 / duration**3, a[:-1] * unit / 2.0 / duration**2, v[:-1] * unit / duration, s[:-1]]
        law = PPoly(np.stack(pieces), np.r_[0.0, np.cumsum(steps) * duration], extrapolate=True)
        return refit(joint_path, law, self._limits["jerk"])


def _shares(joint_path: JointPath, s: Array, limits: dict[str, Array], v: Array, a: Array) -> tuple[Array, float]:
    """Return coefficients (nodes, 6, n) of ṡ, s̈, s⃛ and their products, relative to each limit; duration of the guess [s]."""
    q = [joint_path(s, order) * joint_path.end**order for order in (1, 2, 3)]
    V, A, J = (limits[field] for field in DERIVATIVES)
    third = np.gradient(a, 1.0 / NLP_INTERVALS)
    columns = [x[:, None] for x in (v, a, third)]
    v, a, third = columns
    velocity = np.abs(q[0] * v / V).max()
    acceleration = np.abs((q[0] * a + q[1] * v * v) / A).max()
    jerk = np.abs((q[0] * third + 3.0 * q[1] * v * a + q[2] * v**3) / J).max()
    T = 1.02 * max(velocity, acceleration ** (1 / 2), jerk ** (1 / 3))
    shares = [q[0] / T / V, q[0] / T**2 / A, q[1] / T**2 / A, q[0] / T**3 / J, 3.0 * q[1] / T**3 / J, q[2] / T**3 / J]
    return np.stack(shares, axis=1), float(T)


def _built(ca: Any, solver: str, options: dict[str, Any], n: int) -> tuple[Any, dict[str, Array]]:
    """Return the solver and the bounds of its constraints; in each stage the dynamics first, then the limits."""
    K = NLP_INTERVALS
    x = [ca.MX.sym(f"x{k}", 2) for k in range(K + 1)]
    u = [ca.MX.sym(f"u{k}", 2) for k in range(K)]
    p = ca.MX.sym("p", K + 6 * n * (K + 1))
    g: list[Any] = []
    low: list[float] = []

    def add(expression: Any, lower: float) -> None:
        g.append(expression)
        low.extend([lower] * expression.numel())

    shares = [ca.vertsplit(p[K + 6 * n * k : K + 6 * n * (k + 1)], n) for k in range(K + 1)]
    for k in range(K + 1):
        v, a = x[k][0], x[k][1]
        ends = [(v, a, shares[k])]
        if k < K:
            h, j = u[k][0], u[k][1]
            after = ca.vertcat(v + h * a + 0.5 * h * h * j, a + h * j)
            add(x[k + 1] - after, 0.0)
            add(h * v + 0.5 * h * h * a + h**3 * j / 6.0 - p[k], 0.0)
            ends.append((after[0], after[1], shares[k + 1]))
        if k in (0, K):
            add(x[k], 0.0)
        add(shares[k][0] * v, -1.0)
        add(shares[k][1] * a + shares[k][2] * v * v, -1.0)
        if k < K:
            for v_end, a_end, share in ends:
                add(share[3] * j + share[4] * v_end * a_end + share[5] * v_end**3, -1.0)
    variables = ca.vertcat(*(part for k in range(K) for part in (x[k], u[k])), x[K])
    problem = {"x": variables, "p": p, "f": sum(part[0] for part in u), "g": ca.vertcat(*g)}
    lower = np.array(low)
    stages = {"equality": (lower == 0.0).tolist()} if solver == "fatrop" else {}
    return ca.nlpsol("timing", solver, problem, options | stages), {
        "lbg": lower,
        "ubg": np.where(lower < 0.0, 1.0, 0.0),
    }
