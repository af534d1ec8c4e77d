"""Default method: Gauss–Newton steps with a damping that decreases with the error, and restarts from seeds."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import cache
from typing import Any, ClassVar

import numba
import numpy as np
from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.check import check_flag, check_number
from optik.errors import InvalidInput, RobotModelError
from optik.ik._lm import kernels
from optik.ik._lm.lanes import AT_ATTEMPTS, AT_BEST, AT_BEST_E, AT_FIRST, AT_ITERATIONS, MOST_JOINTS, pack_arm
from optik.ik._lm.search import attempt_task
from optik.ik._null_space import Preference
from optik.ik.base import Attempt, IKBatch, IKResult, IKSolver, IKStatus
from optik.ik.problem import MAX_ITERATIONS, SOLVED, STALLED, STATUS_OF_CODE, TOO_FEW_JOINTS, check_start
from optik.newton import GAIN, LEAST_DAMPING
from optik.se3 import check_pose
from optik.types import Array

PATIENCE, PROGRESS = 4, 0.7
"""An attempt ends after PATIENCE consecutive iterations [1] that do not reduce E below this fraction of its least value [1]."""
BATCH_LANES = 16
"""Targets per lane group of a batch. Four vectors of four numbers hide each other's latency (8 lanes: 10 % slower)."""
BATCH_CHUNK = 4096
"""Problems that a thread takes at a time: dispatching costs little, and all threads end at about the same time."""

# Attribute look-ups would take as long as an iteration.
_solved, _new, _empty = IKStatus.SOLVED, tuple.__new__, np.empty

_MESSAGE = {
    IKStatus.MAX_ITERATIONS: "the last attempt reached max_iterations",
    IKStatus.STALLED: "the error stopped decreasing in every attempt",
    IKStatus.OUTSIDE_LIMITS: "attempts met the target only with joints outside their limits",
}
"""Messages of failures by status."""


class LM(IKSolver):
    """Levenberg–Marquardt damped by the error, Δq = Jᵀ (J Jᵀ + λ² I)⁻¹ e with λ² = gain · ½|e|², with restarts.

    An attempt ignores the joint limits until it meets the target. Multiples of 2π then bring the joints inside the limits;
    if that is impossible, the configuration is clamped and the iteration continues inside the limits. An attempt that
    stalls ends early. The next ones start from seeds: first from the 16 of 256 whose poses are nearest to the target. The
    damping is that of Sugihara (2011) with a negligible constant part. For complete poses one compiled kernel checks the
    arguments, solves, and verifies the solution.

    Parameters
    ----------
    robot : Robot
        The arm, of at most 14 joints.
    gain : float
        Gain of the damping, ≥ 0 [1].
    max_iterations : int
        Largest number of iterations of one attempt.
    max_restarts : int
        Largest number of attempts after the first.
    prefer : str or mapping, optional
        Secondary objective, minimised in the null space once the target is met: ``"posture"`` ½|q − posture|²,
        ``"limits"`` ½ Σ ((q − middle) / half range)² (Liégeois 1977), ``"manipulability"`` −log √det(J Jᵀ) (Yoshikawa
        1985), or a mapping of these names to weights. The result is a local minimum that meets the target. Without
        redundancy (six joints and a complete pose) it has no effect, and ``message`` says so.
    posture : (n,) array, optional
        Posture of ``"posture"`` [rad, m], by default `q0`.
    **options
        Options of `IKSolver`.

    Raises
    ------
    InvalidInput
        An option out of range, or more than 14 joints.
    """

    name: ClassVar[str] = "lm"

    def __init__(
        self, robot: Robot, *, gain: float = GAIN, max_iterations: int = 50, max_restarts: int = 500,
        prefer: str | Mapping[str, float] | None = None, posture: ArrayLike | None = None, **options: Any,
    ) -> None:  # fmt: skip
        super().__init__(robot, max_iterations=max_iterations, max_restarts=max_restarts, **options)
        if robot.n > MOST_JOINTS:
            raise InvalidInput("robot", f"{robot.n} joints", f"at most {MOST_JOINTS} for lm; dls takes any number")
        self.gain = check_number(gain, "gain", "a finite number ≥ 0", least=0.0)
        self.preference = Preference.from_options(robot, prefer, posture)
        for option, value in self.preference.options.items():
            setattr(self, option, value)  # vars(self) would make every later look-up of an attribute slower
        tolerance = self.tolerance
        self._numbers = np.array(
            [tolerance.position, tolerance.rotation, gain, LEAST_DAMPING, max_iterations, 0, max_restarts + 1, PATIENCE,
             PROGRESS, bool(self._missing)]
        )  # fmt: skip
        self._rule = (
            tolerance.position, tolerance.rotation, float(max_iterations), float(PATIENCE), PROGRESS, self.gain,
            LEAST_DAMPING, 1.0,
        )  # fmt: skip
        self._n = robot.n
        self._kernel = _compile_single(robot.n)
        usual = self.time_limit is None and robot.motors is None
        self._packed = self.task.is_pose and robot.linkage is None  # the kernel's axes are the joints
        self._fast = self._packed and usual and not self.preference
        if robot.linkage is None:
            self._arm = pack_arm(robot, self._reach, self._numbers)
            self._compare_models()

    def solve(self, target: ArrayLike, q0: ArrayLike, *, trace: bool = False, closest: bool = False) -> IKResult:
        """Find a configuration whose tool pose is the target."""
        if trace is not False or closest is not False:
            trace, closest = check_flag(trace, "trace"), check_flag(closest, "closest")
        if trace or not self._fast:
            return super().solve(target, q0, trace=trace, closest=closest)
        q = _empty(self._n)
        try:
            code, iterations, restarts, position, rotation = self._kernel(self._arm, target, q0, q)
        except TypeError:
            # a list, another type of numbers, or a read-only or non-contiguous array: possibly valid, but not for the kernel
            code = kernels.INVALID_ARGUMENT
        if code == SOLVED:
            # equals IKResult(…) in two thirds of its time
            return _new(IKResult, (q, _solved, iterations, restarts, position, rotation, None, ""))
        pose, start = check_pose(target, "target"), check_start(self.robot, q0)
        if code == kernels.INVALID_ARGUMENT:
            plain = np.array(pose, order="C"), np.array(start, order="C")
            code, iterations, restarts, position, rotation = self._kernel(self._arm, *plain, q)
        result = self._add_message(IKResult(q, STATUS_OF_CODE[code], iterations, restarts, position, rotation), pose)
        return self._find_closest(result, pose, start) if closest and not result else result

    def _add_message(self, result: IKResult, target: Array) -> IKResult:
        if result.status is IKStatus.UNREACHABLE:
            return self._mark_unreachable(result, target)
        return self._name_missing(result._replace(message=_MESSAGE.get(result.status, "")))

    def _fill(self, batch: IKBatch, targets: Array, starts: Array, threads: int | None) -> None:
        if not self._fast:
            super()._fill(batch, targets, starts, threads)
            return
        kernel = _compile_batch(self.robot.n)

        def part(first: int) -> None:
            k = slice(first, first + BATCH_CHUNK)
            kernel(self._arm, targets[k], starts[k], tuple([field[k] for field in batch]))

        from concurrent.futures import ThreadPoolExecutor

        with ThreadPoolExecutor(threads or _count_cores()) as pool:
            for _ in pool.map(part, range(0, len(targets), BATCH_CHUNK)):
                pass  # raises an exception of the thread
        if self._missing:
            ended = np.isin(batch.status, (MAX_ITERATIONS, STALLED)) & (batch.iterations > 0)
            batch.status[ended] = TOO_FEW_JOINTS

    def _solve(self, target: Array, q0: Array, trace: bool) -> IKResult:
        result = super()._solve(target, q0, trace)
        if not self.preference or not result:
            return result
        note = self.preference.explain(self.task)
        if note:
            return result._replace(message=note)
        tolerance = self.tolerance.position, self.tolerance.rotation
        q = self.preference.improve(self.task, tolerance, target, q0, result.q)
        position, rotation, inside = self._measure(q, target)
        return result._replace(q=q, position_error=position, rotation_error=rotation) if inside else result

    def _attempt(
        self, restart: int, target: Array, q0: Array, trace: bool, time_limit: float | None, last: Attempt | None
    ) -> Attempt:  # fmt: skip
        if not self._packed:
            return super()._attempt(restart, target, q0, trace, time_limit, last)
        arm, n = self._arm.copy(), self.robot.n
        arm[AT_FIRST], arm[AT_ATTEMPTS] = restart, restart + 1
        if (
            last is not None and self.robot.motors is None
        ):  # a failed attempt ends with the best iterate of all attempts so far
            position, rotation, _ = self._measure(last.q, target)
            arm[AT_BEST_E], arm[AT_BEST : AT_BEST + n] = 0.5 * (position**2 + rotation**2), last.q
        out = np.empty(n + 6 * (self.max_iterations + 1 if trace else 1))
        code, iterations, *_ = self._kernel(arm, np.array(target, order="C"), np.array(q0, order="C"), out)
        status, twists = STATUS_OF_CODE[code], out[n:].reshape(-1, 2, 3)[: iterations + 1]  # one row without a trace
        # the kernel's twists are seen from the first joint's frame
        errors = (twists @ self.robot.fixed[0, :3, :3].T).reshape(-1, 6) if trace else None
        residual = float(np.linalg.norm(twists[-1]))
        return Attempt(out[:n].copy(), status, iterations, errors, _MESSAGE.get(status, ""), residual)

    def attempt(self, target: Array, start: Array, trace: bool, time_limit: float | None) -> Attempt:
        """Run one attempt; it is so short that the time limit is checked only between attempts."""
        if self._packed:
            return self._attempt(0, target, start, trace, time_limit, None)
        robot, limits = self.robot, self.robot.limits
        # if the arm is redundant, steps respect the limits from the first one: otherwise q drifts out of them (measured)
        q, errors = limits.clip(start), np.empty((self.max_iterations + 1 if trace else 0, 6))
        iterations, code = attempt_task(
            robot.chain, (limits.lower, limits.upper), (self.task.flags, target),
            self._rule, self.task.size < robot.n, q, errors,
        )  # fmt: skip
        status = STATUS_OF_CODE[code]
        return Attempt(q, status, iterations, errors[: iterations + 1] if trace else None, _MESSAGE.get(status, ""))

    def _compare_models(self) -> None:
        """Check the kernel's model of the arm: at the tool poses of some configurations its error must be zero."""
        for q in self.robot.limits.sample(np.random.default_rng(0), 4):
            target = self.robot.fk(q)
            size = 1.0 + np.abs(self.robot.fixed[:, :3, 3]).sum() + np.abs(self.robot.tool[:3, 3]).sum()
            size += np.abs(np.where(self.robot.prismatic, q, 0.0)).sum()
            size *= 1.0 + 1e-3 * np.abs(np.where(self.robot.prismatic, 0.0, q)).max()  # rounding of large angles
            out, arm = np.empty(self.robot.n + 6), self._arm.copy()
            arm[AT_ITERATIONS], arm[AT_ATTEMPTS] = 0, 1
            self._kernel(arm, target, q, out)
            if not np.abs(out[self.robot.n :]).max() <= 1e-12 * size:
                raise RobotModelError(self.robot.name, f"the chain of lm has the error {out[self.robot.n :]} [m, rad]")


def _count_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def _compile_single(n: int) -> Any:
    """Return the kernel of single calls, compiled only for contiguous float64 arrays."""
    kernel = kernels.build_single(n)
    vector, matrix = numba.float64[::1], numba.float64[:, ::1]
    kernel.compile((vector, matrix, vector, vector))
    kernel.disable_compile()
    return kernel


@cache
def _compile_batch(n: int) -> Any:
    """Return the kernel of batches, compiled only for contiguous arrays."""
    kernel = kernels.build_batch(n, BATCH_LANES)
    one, two, three = numba.float64[::1], numba.float64[:, ::1], numba.float64[:, :, ::1]
    counts = numba.int32[::1]
    kernel.compile((one, three, two, numba.types.Tuple((two, numba.uint8[::1], counts, counts, one, one))))
    kernel.disable_compile()
    return kernel


METHOD = LM
