"""CasADi solvers called through their buffers, and the callback that records their iterates."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from optik.arm.limits import LIMIT_TOLERANCE, JointLimits
from optik.compiled import compiled
from optik.se3 import is_pose
from optik.types import Array

_FLOAT = np.dtype(np.float64)
"""Type of arrays that need no conversion: a comparison with np.float64 itself takes three times as long."""


class Answer(NamedTuple):
    """Output of a solver: last iterate (n,) [rad, m], objective there, return code, iterations, and the recorded iterates (n,).

    The last iterate is clamped to the bounds, which IPOPT relaxes by 1e-8.
    """

    q: Array
    f: float
    code: str
    iterations: int
    visited: list[Array]


class Programme:
    """CasADi solver called through its buffers: the arrays are set once, and a call converts nothing."""

    def __init__(
        self, function: ca.Function, limits: JointLimits, bounds: JointLimits, box: Array, watch: Watch | None
    ) -> None:
        self._function, self._watch, self.constrained = function, watch, box.size > 0
        buffer: Any
        buffer, self._call = function.buffer()
        self._buffer = buffer
        self._in: dict[str, Any] = {
            name: np.zeros(function.numel_in(name)) for name in ("x0", "p", "lbx", "ubx", "lbg", "ubg")
        }
        self._out: dict[str, Any] = {name: np.zeros(function.numel_out(name)) for name in ("x", "f")}
        for name, array in self._in.items():
            if array.size:
                buffer.set_arg(function.index_in(name), memoryview(array))
        for name, array in self._out.items():
            buffer.set_res(function.index_out(name), memoryview(array))
        self._in["lbx"][:], self._in["ubx"][:] = bounds.lower, bounds.upper
        self._in["lbg"][:], self._in["ubg"][:] = -box, box
        self._x0, self._p = self._in["x0"], self._in["p"]
        self._limits = np.array([limits.lower, limits.upper, bounds.lower, bounds.upper])

    def solve_arrays(self, target: Any, q0: Any) -> Answer | None:
        """Solve for a target and an initial guess if both are valid float64 arrays; otherwise return None."""
        if not (type(target) is type(q0) is np.ndarray and target.dtype == q0.dtype == _FLOAT):
            return None
        if not (target.shape == (4, 4) and q0.shape == self._x0.shape and target.flags.carray and q0.flags.carray):
            return None
        return self._run(np.inf) if load_problem(target, q0, self._limits, self._x0, self._p) else None

    def solve(self, start: Array, parameters: Array, end: float) -> Answer:
        """Solve from an initial guess, which is clamped to the bounds, until the clock time `end`."""
        clamp(start, self._in["lbx"], self._in["ubx"], self._in["x0"])
        self._in["p"][:] = parameters
        return self._run(end)

    def _run(self, end: float) -> Answer:
        if self._watch is not None:
            self._watch.begin(end)
        try:
            self._call()
            stats = self._buffer.stats()
            code, count = stats["return_status"], stats["iter_count"]
        except (RuntimeError, KeyError) as error:  # exceptions of CasADi do not leave this module
            return Answer(self._in["x0"].copy(), np.inf, first_line(error), 0, [])
        q = np.empty(self._in["x0"].size)
        clamp(self._out["x"], self._in["lbx"], self._in["ubx"], q)
        visited: list[Array] = []
        if self._watch is not None:
            # iterate 0 is the initial guess; the last may be reported twice, or (after a restoration) not at all
            before = self._watch.iterates[1:count]
            visited = [*before, *[q] * (count - len(before))]
        return Answer(q, self._out["f"].item(), code, count, visited)


@compiled
def clamp(q: Array, lower: Array, upper: Array, out: Array) -> None:
    """Write a configuration clamped to bounds into out; NaN stays.

    Shapes and units: q (n,) [rad, m], lower, upper (n,) [rad, m], out (n,) [rad, m] (overwritten).
    """
    for i in range(q.shape[0]):
        x = q[i]
        out[i] = upper[i] if x > upper[i] else (lower[i] if x < lower[i] else x)


@compiled
def load_problem(target: Array, q0: Array, limits: Array, x0: Array, parameters: Array) -> bool:
    """Write a target and an initial guess into the input of a programme; return False if one is invalid.

    Shapes and units: target (4, 4) [1, m], q0 (n,) [rad, m], limits (4, n) [rad, m], x0 (n,) [rad, m] (overwritten), parameters
    (m,) [1, m] (overwritten).
    """
    if not is_pose(target):
        return False
    for i in range(x0.shape[0]):
        if not (limits[0, i] - LIMIT_TOLERANCE <= q0[i] <= limits[1, i] + LIMIT_TOLERANCE and abs(q0[i]) < np.inf):
            return False
        x0[i] = min(max(q0[i], limits[2, i]), limits[3, i])
    for i in range(12):
        parameters[i] = target[i // 4, i % 4]
    return True


class Watch(ca.Callback):
    """Callback that records every iterate of a solver, and stops the solver at its time limit."""

    def __init__(self, sizes: Mapping[str, int]) -> None:
        super().__init__()
        x, g, p = sizes["x"], sizes.get("g", 0), sizes["p"]
        self._sizes = {"x": x, "f": 1, "g": g, "lam_x": x, "lam_g": g, "lam_p": p}
        self.iterates: list[Array] = []
        self._end = np.inf
        self.construct("watch", {})

    def begin(self, end: float) -> None:
        """Clear the iterates, and set the clock time at which the solver is stopped."""
        self.iterates.clear()
        self._end = end

    def get_n_in(self) -> int:
        """Return the number of inputs: the results of a solver."""
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        """Return the number of outputs: whether to stop."""
        return 1

    def get_name_in(self, i: int) -> str:
        """Return the name of a result of the solver."""
        return str(ca.nlpsol_out(i))

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """Return the shape of a result of the solver."""
        return ca.Sparsity.dense(self._sizes[ca.nlpsol_out(i)], 1)

    def eval(self, arguments: Any) -> list[int]:
        """Record an iterate, and return whether to stop."""
        self.iterates.append(np.asarray(arguments[0], dtype=np.float64).ravel())
        return [int(time.perf_counter() >= self._end)]


def first_line(error: Exception) -> str:
    """Return the message of a CasADi exception without the location in CasADi's source."""
    return str(error).strip().splitlines()[-1][:120]
