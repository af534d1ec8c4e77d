"""Retargeter: the motions of one arm from moving states onto chunks, joints, plans and velocities, within the same limits."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.check import check_number, real_array
from optik.errors import InvalidInput
from optik.scene import Scene
from optik.scene.contact import check_scene
from optik.types import Array
from planners.limits import DERIVATIVES, MotionLimits, PathPoints, kind_of
from planners.limits.base import sides
from planners.retarget.certificate import certify_joined, other_limits, trajectory_of
from planners.retarget.chunk import Chunk, repair
from planners.retarget.cubics import BRIEF_REST, JointCubics
from planners.retarget.jog import Jog
from planners.retarget.pace import APART, OTHER_PART, PLACES, joint_rows, sample_reference, smooth_pace, sweep, time_of
from planners.retarget.reference import MOST_SPANS, fit_reference
from planners.retarget.result import Reference, Retargeted, RetargetStatus, state_of
from planners.retarget.tracking import SPARE, track
from planners.retarget.transfer import Transfer
from planners.trajectory import State, Trajectory, cut_before, join, make_rest

SLOWER = (1.0, 0.8, 0.64)
"""Factors of the pace that are tried where a torque or another limit of the whole arm is exceeded or not proved."""
TRIED, MOST_KNOTS = 31, 600
"""Places of a chunk among which the nearest one to the arm is chosen, and the largest number of knots of a joint."""
LATEST = 0.98
"""Latest entry into a chunk, over its duration."""
ENTRIES, TRIED_ENTRIES, LAST_ENTRY = 6, 3, 0.95
"""Entries into a plan whose durations are computed, and again beside the best one; the number of motions that are judged; and
the last entry, over the duration of the plan."""


class _Samples:
    """Samples R (k, 4, n) of a reference as a joint path, for the rows of limits."""

    def __init__(self, robot: Robot, R: Array) -> None:
        self.robot, self.path, self.end, self._R = robot, self, 0.0, R

    def __call__(self, x: ArrayLike, order: int = 0) -> Array:
        return np.ascontiguousarray(self._R[:, order])

    def twist(self, s: Array) -> Array:
        """Return the tool's twists (k, 6) per second of the chunk's time."""
        twists: Array = np.einsum("kij,kj->ki", self.robot.jacobian(self(s)), self(s, 1))
        return twists


class Retargeter:
    """Retargets one arm; see `planners.retarget` for the arguments."""

    def __init__(
        self, robot: Robot, limits: MotionLimits | None = None, *, tolerance: float = 0.005, pace: float = 1.0,
        align: str = "nearest", longest: float = 0.04, scene: Scene | None = None,
    ) -> None:  # fmt: skip
        self.robot, self.limits = robot, MotionLimits.of(robot) if limits is None else limits
        if not isinstance(self.limits, MotionLimits):
            raise InvalidInput("limits", repr(limits)[:60], "an object of the class MotionLimits")
        self._box = _box(robot, self.limits)
        self._tolerance = check_number(tolerance, "tolerance", "a distance [rad, m] above 0", above=0.0)
        self._pace = check_number(pace, "pace", "a number above 0", above=0.0)
        self._longest = check_number(longest, "longest", "seconds above 0", above=0.0)
        if align not in ("nearest", "clock"):
            raise InvalidInput("align", repr(align)[:60], "'nearest' or 'clock'")
        self._nearest, self.scene = align == "nearest", scene
        check_scene(robot, scene)
        self._others = other_limits(self.limits)
        if any(np.ndim(self.limits.value(name)) for name in ("tool_speed", "rotation_speed")):
            raise InvalidInput(
                "limits", "tool speeds for the segments of a path", "one tool speed for the whole motion"
            )
        box = self._box
        self._ramp = float((np.minimum(box[:, 2, 1], -box[:, 2, 0]) / np.minimum(box[:, 3, 1], -box[:, 3, 0])).max())
        self._transfer = Transfer(box)

    def run(self, running: JointCubics | Trajectory, at: float, onto: Any) -> Retargeted:
        """Return the motion onto a target, from the running motion's state at a time [s]."""
        state = state_of(running, at)
        X = np.array(state)
        if words := self._refuse_state(X):
            return self._keep(running, at, state, words)
        if isinstance(onto, Chunk):
            return self._join_chunk(running, at, state, onto)
        if isinstance(onto, Jog):
            velocity = _joints(onto.velocity, self.robot.n, "velocity")
            return self._judge(running, at, state, self._transfer.jog(X, velocity, onto.hold), RetargetStatus.GOAL)
        if hasattr(onto, "trajectory"):
            return self._join_plan(running, at, state, onto)
        return self._go(running, at, state, _joints(onto, self.robot.n, "onto"))

    def _refuse_state(self, X: Array) -> str:
        """Return why no motion from a state (3, n) is within the limits, or nothing."""
        for order, name in enumerate(("position", *DERIVATIVES[:2])):
            low, high = self._box[:, order, 0], self._box[:, order, 1]
            spare = 1e-9 if order == 0 else 1e-6 * (high - low)
            outside = (X[order] < low - spare) | (X[order] > high + spare)
            if outside.any():
                i = int(outside.argmax())
                wide = f"[{low[i]:.6g}, {high[i]:.6g}]"
                return f"the {name} of {self.robot.joint_names[i]} is {X[order, i]:.6g}, outside its limits {wide}"
        return ""

    def _keep(self, running: JointCubics | Trajectory, at: float, state: State, reason: str, **more: Any) -> Retargeted:
        """Return the rest of the running motion."""
        rest = at >= running.end - BRIEF_REST
        curve = make_rest(state[0], 3.0 * BRIEF_REST) if rest else cut_before(trajectory_of(running), at)
        proof = certify_joined(self.robot, curve, self.limits, state, None)
        return Retargeted(RetargetStatus.KEPT, reason, self.robot, self.limits, at, curve, proof, **more)

    def _judge(
        self, running: JointCubics | Trajectory, at: float, state: State, curve: JointCubics | Trajectory | None,
        status: RetargetStatus, **more: Any,
    ) -> Retargeted:  # fmt: skip
        """Return a motion if its certificate is valid, else the running one."""
        if curve is None:
            return self._keep(running, at, state, "Ruckig found no motion", **more)
        proof = certify_joined(self.robot, curve, self.limits, state, self.scene)
        if not proof.is_valid:
            return self._keep(running, at, state, proof.reasons[0], **more)
        return Retargeted(status, "", self.robot, self.limits, at, curve, proof, **more)

    # ------------------------------------------------------------ a chunk

    def _join_chunk(self, running: JointCubics | Trajectory, at: float, state: State, chunk: Chunk) -> Retargeted:
        """Return the motion that follows a chunk."""
        if (n := np.shape(chunk.points)[1]) != self.robot.n:
            raise InvalidInput("onto", f"targets of {n} joints", f"{self.robot.n}, of {self.robot.name}")
        P, rate, repaired = repair(chunk, self._box[:, 0, 0], self._box[:, 0, 1])
        m, X = len(P), np.array(state)
        spans = min(m - 1, MOST_SPANS)
        c, h = np.empty((spans + 5, self.robot.n)), (m - 1) / spans / rate
        error = fit_reference(P, self._tolerance, c)
        end = (m - 1) / rate
        s0 = min(max(at - chunk.observed, 0.0), LATEST * end)
        if self._nearest and s0 > 0.0:
            places = np.linspace(0.0, s0, TRIED)
            R = np.empty((TRIED, 1, self.robot.n))
            sample_reference(c, h, places, R)
            s0 = float(places[((R[:, 0] - X[0]) ** 2).sum(axis=1).argmin()])
        more: dict[str, Any] = {"skipped": int(s0 * chunk.rate + 1e-9), "repaired": repaired}
        s = np.linspace(s0, end, int(min(max(PLACES[0], (end - s0) / APART), PLACES[1])))
        R = np.empty((s.size, 4, self.robot.n))
        sample_reference(c, h, s, R)
        found = None
        for slower in SLOWER if self._others else SLOWER[:1]:
            when, at_s = self._pace_of(R, s, X, slower)
            reference = Reference(c, h, when, at_s, error)
            curve = self._track(X, reference)
            if isinstance(curve, str):
                return self._keep(running, at, state, curve, **more)
            found = self._judge(running, at, state, curve, RetargetStatus.JOINED, reference=reference, **more)
            if found:
                return found
        assert found is not None
        return found

    def _pace_of(self, R: Array, s: Array, X: Array, slower: float) -> tuple[Array, Array]:
        """Return instants [s] and the chunk's time there, at most at a fraction of the wanted pace."""
        pace, n = self._pace * slower, self.robot.n
        rows, cap, x, t = np.empty((s.size, n, 4)), np.empty(s.size), np.empty(s.size), np.empty(s.size)
        joint_rows(R, self._box, pace, rows, cap)
        if self._others:
            rows = self._add_rows(R, s, rows, cap, slower)
        first = pace
        if self._pace > 1.0:
            rate = R[0, 1]
            first = float(np.clip(rate @ X[1] / max(rate @ rate, 1e-9), 0.05, pace))
        sweep(s, rows, cap, first * first, x)
        time_of(s, x, t)
        width = max(self._ramp, 0.02)
        when = np.arange(0.5 * self._longest, t[-1] + 0.5 * width + self._longest, 0.5 * self._longest)
        out = np.empty_like(when)
        smooth_pace(s, t, float(np.sqrt(x[0])), width, when, out)
        return when, out

    def _add_rows(self, R: Array, s: Array, rows: Array, cap: Array, slower: float) -> Array:
        """Return the rows with those of limits of the whole arm, and lower the largest ṡ² by those of first order."""
        samples: Any = _Samples(self.robot, R)
        points, part = PathPoints(samples, s), OTHER_PART * slower
        extra = [rows]
        for name in self._others:
            order = kind_of(name).order
            if order > 2:
                continue
            found = self.limits.rows(name, points) / part
            if order == 1:
                most = np.abs(found[:, :, 0]).max(axis=1)
                np.minimum(cap, 1.0 / np.maximum(most, 1e-9) ** 2, out=cap)
            else:
                extra.append(np.pad(found, ((0, 0), (0, 0), (0, 4 - found.shape[2]))))
        return np.ascontiguousarray(np.concatenate(extra, axis=1))

    def _track(self, X: Array, reference: Reference) -> JointCubics | str:
        """Return the motion nearest to a paced reference, or why there is none."""
        n = self.robot.n
        R = np.empty((reference.when.size, 1, n))
        sample_reference(reference.c, reference.h, reference.s, R)
        size = min(reference.when.size + 150, MOST_KNOTS)
        knots, count, c = np.empty((n, size)), np.empty(n, dtype=np.int64), np.empty((n, 4, size))
        j = track(X, self._box, reference.when, R[:, 0].copy(), self._longest, knots, count, c)
        if j >= 0:
            return f"no motion of {self.robot.joint_names[j]} within its limits was found"
        return JointCubics(knots, count, c)

    # ------------------------------------------------------------ joints, and a plan

    def _go(self, running: JointCubics | Trajectory, at: float, state: State, q: Array) -> Retargeted:
        """Return the motion to joints: the time-optimal one, or, where that leaves a range, a stop and then that one."""
        outside = (q < self._box[:, 0, 0] - 1e-9) | (q > self._box[:, 0, 1] + 1e-9)
        if outside.any():
            i = int(outside.argmax())
            low, high = self._box[i, 0]
            raise InvalidInput(
                "onto", f"{q[i]:.6g} for {self.robot.joint_names[i]}", f"a value in [{low:.6g}, {high:.6g}]"
            )
        X, goal = np.array(state), np.zeros((3, self.robot.n))
        goal[0] = q
        found = self._judge(running, at, state, self._transfer.to_state(X, goal), RetargetStatus.GOAL)
        if found:
            return found
        stop = self._transfer.jog(X, np.zeros(self.robot.n), 0.0)
        if stop is None:
            return found
        rest = np.zeros((3, self.robot.n))
        rest[0] = stop(stop.end)
        onward = self._transfer.to_state(rest, goal)
        if onward is None:
            return found
        return self._judge(running, at, state, join(stop.trajectory, onward.trajectory), RetargetStatus.GOAL)

    def _join_plan(self, running: JointCubics | Trajectory, at: float, state: State, plan: Any) -> Retargeted:
        """Return the motion that enters a plan where it ends soonest."""
        curve, X = trajectory_of(plan.trajectory), np.array(state)
        if curve.n != self.robot.n:
            raise InvalidInput("onto", f"a motion of {curve.n} joints", f"{self.robot.n}, of {self.robot.name}")
        best: list[tuple[float, float]] = []  # durations of entry and rest, and entries [s]
        low, high = 0.0, LAST_ENTRY * curve.end
        for _ in range(2):
            times = np.linspace(low, high, ENTRIES)
            for t, goal in zip(times.tolist(), np.stack([curve(times, k) for k in range(3)], axis=1), strict=True):
                entry = self._transfer.find(X, goal)
                if entry is not None:
                    best.append((entry.duration + curve.end - t, t))
            if not best:
                return self._keep(running, at, state, "Ruckig found no motion into the plan")
            apart, middle = (high - low) / (ENTRIES - 1), min(best)[1]
            low, high = max(middle - apart, 0.0), min(middle + apart, LAST_ENTRY * curve.end)
        found = None
        for _, t in sorted(best)[:TRIED_ENTRIES]:
            motion = self._transfer.to_state(X, np.array([curve(t, order) for order in range(3)]))
            if motion is not None:
                whole = join(motion.trajectory, cut_before(curve, t).without_s)
                found = self._judge(running, at, state, whole, RetargetStatus.JOINED)
                if found:
                    return found
        return found or self._keep(running, at, state, "Ruckig found no motion into the plan")


def _box(robot: Robot, limits: MotionLimits) -> Array:
    """Return the limits (n, 4, 2) of position, velocity, acceleration and jerk, lower and upper."""
    box, bounds = np.empty((robot.n, 4, 2)), limits.bounds(robot.n)
    box[:, 0] = np.stack([robot.limits.lower, robot.limits.upper], axis=1)
    for order, name in enumerate(DERIVATIVES, 1):
        low, high = sides(bounds[name])
        if not np.isfinite(high).all():
            joint = robot.joint_names[int((~np.isfinite(high)).argmax())]
            expected = f"finite limits on velocity, acceleration and jerk: MotionLimits.of(robot, {name}=…)"
            raise InvalidInput("limits", f"no {name} limit of {joint}", expected)
        box[:, order] = (1.0 - SPARE) * np.stack([low, high], axis=1)
    return box


def _joints(value: Any, n: int, argument: str) -> Array:
    """Return finite joint values (n,)."""
    expected = f"a Chunk, a plan, or {n} finite joint values" if argument == "onto" else f"{n} finite numbers"
    q = real_array(value, argument, expected)
    if q.shape != (n,) or not np.isfinite(q).all():
        raise InvalidInput(argument, repr(value)[:60], expected)
    return q
