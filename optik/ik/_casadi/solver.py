"""CasADi's solvers, called through their buffers, and watched."""

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
"""Type of the arrays that are taken as they are: comparing with np.float64 itself takes three times as long."""


class Answer(NamedTuple):
    """Output of a solver.

    Attributes
    ----------
    q : (n,) array
        Its last iterate [rad, m], clamped to the bounds, which IPOPT relaxes by 1e-8.
    f : float
        Its objective there.
    code : str
        Its return code.
    iterations : int
        As it counts them.
    visited : list of (n,) arrays
        Iterates 1 to `iterations` [rad, m], where they were watched.
    """

    q: Array
    f: float
    code: str
    iterations: int
    visited: list[Array]


class Programme:
    """A CasADi solver called through its buffers: arrays set once, no dictionary and no conversion in a call."""

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

    def answer(self, target: Any, q0: Any) -> Answer | None:
        """Run for a target pose from a start, both as the caller gave them."""
        if not (type(target) is type(q0) is np.ndarray and target.dtype == q0.dtype == _FLOAT):
            return None
        if not (target.shape == (4, 4) and q0.shape == self._x0.shape and target.flags.carray and q0.flags.carray):
            return None
        return self._run(np.inf) if take(target, q0, self._limits, self._x0, self._p) else None

    def solve(self, start: Array, parameters: Array, end: float) -> Answer:
        """Run from a start, which is moved inside the bounds."""
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
        except (RuntimeError, KeyError) as error:  # no exception of CasADi's leaves this module
            return Answer(self._in["x0"].copy(), np.inf, first_line(error), 0, [])
        q = np.empty(self._in["x0"].size)
        clamp(self._out["x"], self._in["lbx"], self._in["ubx"], q)
        visited: list[Array] = []
        if self._watch is not None:
            # iterate 0 is the start; the last may be reported twice, or (after a restoration) not at all
            before = self._watch.seen[1:count]
            visited = [*before, *[q] * (count - len(before))]
        return Answer(q, self._out["f"].item(), code, count, visited)


@compiled
def clamp(q: Array, lower: Array, upper: Array, out: Array) -> None:
    """Clamp a configuration to bounds; NaN stays.

    Shapes and units: q (n,) [rad, m], lower, upper (n,) [rad, m], out (n,) [rad, m] (overwritten).
    """
    for i in range(q.shape[0]):
        x = q[i]
        out[i] = upper[i] if x > upper[i] else (lower[i] if x < lower[i] else x)


@compiled
def take(target: Array, q0: Array, limits: Array, x0: Array, parameters: Array) -> bool:
    """Check a target and a start, and write them into the input of a programme.

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
    """Callback that keeps every iterate of a solver, and stops it when its time is over."""

    def __init__(self, sizes: Mapping[str, int]) -> None:
        super().__init__()
        x, g, p = sizes["x"], sizes.get("g", 0), sizes["p"]
        self._sizes = {"x": x, "f": 1, "g": g, "lam_x": x, "lam_g": g, "lam_p": p}
        self.seen: list[Array] = []
        self._end = np.inf
        self.construct("watch", {})

    def begin(self, end: float) -> None:
        """Forget what was seen, and set the time to stop at."""
        self.seen.clear()
        self._end = end

    def get_n_in(self) -> int:
        """As many as a solver has results."""
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        """One: whether to stop."""
        return 1

    def get_name_in(self, i: int) -> str:
        """Name of a result of the solver."""
        return str(ca.nlpsol_out(i))

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """Shape of a result of the solver."""
        return ca.Sparsity.dense(self._sizes[ca.nlpsol_out(i)], 1)

    def eval(self, arguments: Any) -> list[int]:
        """Keep an iterate."""
        self.seen.append(np.asarray(arguments[0], dtype=np.float64).ravel())
        return [int(time.perf_counter() >= self._end)]


def first_line(error: Exception) -> str:
    """Message of an exception of CasADi's, without the location in its source."""
    return str(error).strip().splitlines()[-1][:120]
