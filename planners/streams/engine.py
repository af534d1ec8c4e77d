"""Retargeter: the motions of one arm from moving states onto chunks, joints, plans and velocities, within the same limits."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import ceil
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.limits import ask_for_degrees
from optik.arm.robot import Robot
from optik.check import check_choice, check_kind, check_number, finite_array
from optik.errors import InvalidInput
from optik.scene import Scene
from optik.scene.contact import check_scene
from optik.types import Array
from planners.limits import DERIVATIVES, MotionLimits, PathPoints, kind_of, symmetric_limit
from planners.limits.base import sides
from planners.paths.goal import find_continuous, unwind
from planners.streams import motion, result
from planners.streams.chunk import Chunk, Jog, read_targets, refuse_targets, resolve_poses
from planners.streams.motion import BRIEF_REST, OTHER_PART, JointCubics, Transfer
from planners.streams.reference import MOST_SPANS, SPARE, find_scatter, fit_reference, sample_reference, track_targets
from planners.streams.result import PacedReference, Retargeted, RetargetStatus, StreamCertificate
from planners.trajectory import Trajectory, cut_before, make_rest, map_joints

SLOWER = (1.0, 0.8, 0.64, 0.64, 0.64)
"""Factors of the pace that are tried where a torque or another limit of the whole arm is exceeded or not proved."""
SMALL_PART, LEAST_FACTOR = 0.1, 0.3
"""Part of a joint in a torque or its rate below which its limits are not reduced, and least factor of limits in one try."""
TORQUE_PART, SLOWER_RISE = 0.95, 0.8
"""Part of a torque's limit to which accelerations are reduced, and the rate at which a torque is raised over that at which it
is lowered."""
LEAST_PART, STOP_PART = 0.1, 1.1
"""Least accelerations that remain: over their own limits, and over those that stop a joint at the end of its range."""
SLOW_END, BRAKE_PART = 0.05, 0.8
"""Velocity permitted within the tolerance of clipped targets if velocity limits fall towards the range end [rad/s, m/s];
fraction of the deceleration used there, which leaves room for the proof."""
SHORTEST_WINDOW = 0.02
"""Shortest window over which a pace is averaged [s]."""
TRIED, MOST_PIECES = 31, 8000
"""Places of a chunk among which the nearest one to the arm is chosen, and a number of pieces above any budget."""
ARRIVED = (1e-10, 1e-12, 1e-12)
"""Distances from a goal at rest in position, velocity and acceleration that are rounding [rad, rad/s, rad/s², or m]."""
SCATTERS, MOST_TOLERANCE = 4.0, 4.0
"""The tolerance is raised to this multiple of the scatter, at most to this multiple of itself."""
ROUNDED = 1e-6
"""Excess over a range up to which joints are clipped to it [rad, m]."""
LATEST = 0.98
"""Latest entry into a chunk, over its duration."""
LONGEST_WAIT = 10.0
"""Longest wait for a chunk that is observed in the future [s]; with its duration, the longest delay of one that has ended."""
WORK = 350_000
"""Largest work of one call, in intervals times iterations."""
PROOF = 20
"""Work of the proof of an interval with limits of the whole arm."""
SLOW = (1.5, 0.045)
"""Duration of a motion, plus this for each span of its reference, above which its pieces become longer [s]."""
COUNTED = 600
"""Largest number of spans that count: with it `WORK` suffices for seven joints."""
ENTRIES = np.linspace(0.0, 0.95, 8)
"""Instants of entries into a plan whose durations are computed, over the plan's duration."""


class _Samples:
    """Samples R (k, 4, n) of a reference as a joint path, for the rows of limits."""

    asked = "pose"

    def __init__(self, robot: Robot, R: Array) -> None:
        self.robot, self.path, self.end, self._R = robot, self, 0.0, R

    def __call__(self, x: ArrayLike, order: int = 0) -> Array:
        return np.ascontiguousarray(self._R[:, order])

    def twist(self, s: Array) -> Array:
        """Return the tool's twists (k, 6) per second of the chunk's time."""
        twists: Array = np.einsum("kij,kj->ki", self.robot.jacobian(self(s)), self(s, 1))
        return twists


class _Attempt(NamedTuple):
    """A motion, or None and the reason; and the facts of a chunk, as `Retargeted` has them."""

    curve: JointCubics | Trajectory | None
    reason: str = "Ruckig found no motion"
    facts: Mapping[str, Any] = MappingProxyType({})


Make = Callable[[Array, int], _Attempt]
"""Makes a motion within limits (n, 4, 2) of single joints, at the k-th try."""


class Retargeter:
    """Retargets one arm; see `planners.retarget` for the arguments."""

    def __init__(
        self, robot: Robot, limits: MotionLimits | None = None, *, tolerance: float = 0.005, pace: float = 1.0,
        align: str = "nearest", longest: float = 0.04, scene: Scene | None = None,
    ) -> None:  # fmt: skip
        self.robot, self.limits = robot, MotionLimits.of(robot) if limits is None else limits
        check_kind(self.limits, "limits", MotionLimits)
        self.box = _box(robot, self.limits)
        self.tolerance = check_number(tolerance, "tolerance", "a distance [rad, m] above 0", above=0.0)
        self.pace = check_number(pace, "pace", "a number above 0", above=0.0)
        self.longest = check_number(longest, "longest", "seconds above 0", above=0.0)
        self.align, self.scene = check_choice(align, "align", ("nearest", "clock")), scene
        check_scene(robot, scene)
        self.others = result.other_limits(self.limits)
        if any(np.ndim(self.limits.value(name)) for name in ("tool_speed", "rotation_speed")):
            raise InvalidInput(
                "limits", "tool speeds for the segments of a path", "one tool speed for the whole motion"
            )
        self.ranges, self.free, self._falling = self.box[:, 0].copy(), find_continuous(robot), None
        if (falling := self.limits.value("velocity_by_position")) is not None:
            self._falling = falling.offset, falling.deceleration
            gap = (falling.offset + SLOW_END) ** 2 / (2.0 * falling.deceleration) + self.tolerance
            self.ranges += np.where(np.isfinite(falling.deceleration), gap, 0.0)[:, None] * [1.0, -1.0]
        self._usual, self._heavy = Transfer(self.box), robot
        if robot.payload is not None:  # the heaviest of an interval
            self._heavy = replace(robot, payload=replace(robot.payload, mass=robot.payload.masses[-1]))

    def run(self, running: Trajectory, at: float, onto: Any) -> Retargeted:
        """Return the motion onto a target, from the running motion's state at a time [s]."""
        X = np.array(result.state_of(running, at))
        status, tries, cut, reason = RetargetStatus.GOAL, len(SLOWER), "", self._refuse_state(X)
        if isinstance(onto, Chunk):
            status, tries = RetargetStatus.JOINED, tries if self.others else 1
            chunk, cut = resolve_poses(self.robot, onto, X, at)
            refused = cut if chunk is None else self._refuse_chunk(chunk, at - chunk.observed)
            reason = reason or refused
            if chunk is not None and not reason:
                make: Make = ChunkFollower(self, X, chunk, at - chunk.observed).make
        elif isinstance(onto, Jog):
            velocity = _joints(onto.velocity, self.robot.n, "velocity")
            make = lambda box, k: _Attempt(self._transfer(box).jog(X, velocity, onto.hold))  # noqa: E731
        elif hasattr(onto, "trajectory"):
            status, make = RetargetStatus.JOINED, self._enter(X, onto.trajectory)
        else:
            q = _joints(onto, self.robot.n, "onto")
            make = self._go(X, unwind(self.robot, q, X[0]) if self.free.any() else q)
        last, box = _Attempt(None), self._first_box(X)
        for k in range(0 if reason else tries):
            last = make(box, k)
            if last.curve is None:
                reason = reason or last.reason
                break
            proof = result.certify_joined(self.robot, last.curve, self.limits, X, self.scene)
            if proof.is_valid:
                return Retargeted(status, "", self.robot, self.limits, at, last.curve, proof, cut=cut, **last.facts)
            reason, box = reason or proof.reasons[0], self._tighten(box, proof, X, result.trajectory_of(last.curve))
        rest = at >= running.end - BRIEF_REST
        kept = make_rest(X[0], 3.0 * BRIEF_REST) if rest else cut_before(running, at)
        proof = result.certify_joined(self.robot, kept, self.limits, X, None)
        return Retargeted(RetargetStatus.KEPT, reason, self.robot, self.limits, at, kept, proof, cut=cut, **last.facts)

    def _refuse_state(self, X: Array) -> str:
        """Return why no motion from a state (3, n) is within the limits, or nothing."""
        low, high = self.box[:, :3].T
        spare = np.where([[True], [False], [False]], 1e-9, 1e-6 * (high - low))
        outside = (low - spare > X) | (high + spare < X)
        if not outside.any():
            return ""
        order, i = divmod(int(outside.argmax()), self.robot.n)
        name, wide = ("position", *DERIVATIVES)[order], f"[{low[order, i]:.6g}, {high[order, i]:.6g}]"
        return f"the {name} of {self.robot.joint_names[i]} is {X[order, i]:.6g}, outside its limits {wide}"

    def _refuse_chunk(self, chunk: Chunk, age: float) -> str:
        """Return why a chunk of an age [s] is not followed, or nothing."""
        m, n = np.shape(chunk.points)
        if n != self.robot.n:
            return f"the chunk has targets of {n} joints, and {self.robot.name} has {self.robot.n}"
        end = (m - 1) / chunk.rate
        latest, earliest = (end, -LONGEST_WAIT) if self.align == "clock" else (2.0 * end + LONGEST_WAIT, -np.inf)
        if not earliest <= age <= latest:
            when = (
                f"{age:.6g} s before `at`, and the chunk lasts {end:.3g} s" if age > 0.0 else f"{-age:.6g} s after `at`"
            )
            return f"the chunk's first target (`observed`) is {when}: is `observed` a time of another clock?"
        return refuse_targets(np.asarray(chunk.points), self.robot)

    # ------------------------------------------------------------ limits of the whole arm

    def _first_box(self, X: Array) -> Array:
        """Return the limits of single joints, with jerks that respect the torque rates at a state, if these are limited.

        A jerk changes the torques at the rates M q⃛. Each joint's jerk is divided by the largest excess of the rows in which its
        part is not small.
        """
        if "torque_rate" not in self.others:
            return self.box
        part = np.abs(self._heavy.mass_matrix(X[0])) * np.minimum(self.box[:, 3, 1], -self.box[:, 3, 0])
        excess = part.sum(axis=1) / symmetric_limit(self.limits.bounds(self.robot.n)["torque_rate"])
        matters = part > SMALL_PART * part.sum(axis=1)[:, None]
        box = self.box.copy()
        box[:, 3] /= np.maximum((excess[:, None] * matters).max(axis=0), 1.0)[:, None]
        return box

    def _tighten(self, box: Array, proof: StreamCertificate, X: Array, curve: Trajectory) -> Array:
        """Return limits of single joints that are reduced where a motion from a state (3, n) exceeds limits."""
        box = box.copy()
        for name, peak in proof.peaks.items():
            ratio, order = float(np.nanmax(peak.ratio)), kind_of(name).order
            if not ratio > 1.0:
                continue
            if name == "torque":
                self._relieve(box, peak, X, curve)
                continue
            if name in self.others:
                reached = proof.peaks[DERIVATIVES[order - 1]].value  # the bounds may be higher than what is reached
                used = np.clip(np.abs(reached) / np.abs(box[:, order]).max(axis=1), LEAST_FACTOR, 1.0)
                box[:, order] *= (used * min(max(OTHER_PART / ratio, LEAST_FACTOR), OTHER_PART))[:, None]
            else:  # by rounding in Ruckig
                box[:, order] *= (1.0 - 100.0 * SPARE) / ratio
            if order < 3:  # the state stays inside
                wide = 1e-9 * (self.box[:, order, 1] - self.box[:, order, 0])
                box[:, order, 0] = np.minimum(box[:, order, 0], X[order] - wide)
                box[:, order, 1] = np.maximum(box[:, order, 1], X[order] + wide)
        return box

    def _relieve(self, box: Array, peak: Any, X: Array, curve: Trajectory) -> None:
        """Reduce the limits (n, 4, 2) of the joints that raise torques above their limits, on a motion from a state (3, n).

        A torque is a row of M q̈, plus parts that accelerations do not change at once, such as gravity. Terms of the row that
        raise it at its peak are reduced by the excess. Each joint can still stop inside its range. While the accelerations of
        the state begin to change, jerks are reduced too: those that raise the torque, below those that lower it.
        """
        room = np.where(X[1] > 0.0, box[:, 0, 1] - X[0], X[0] - box[:, 0, 0])
        stop = STOP_PART * X[1] ** 2 / np.maximum(2.0 * room, 1e-9)
        begin = (np.ptp(self.box[:, 2], axis=1) / box[:, 3, 1]).max()
        for i in np.flatnonzero(peak.ratio > 1.0):
            q, dq, ddq = (curve(float(peak.time[i]), order) for order in range(3))
            row = self._heavy.mass_matrix(q)[i] * np.sign(self._heavy.torques(q, dq, ddq)[i])
            push, change = row * ddq, row * (ddq - X[2])
            if peak.time[i] < begin and (change < 0.0).any():
                up, down = np.maximum(change, 0.0).sum(), -np.minimum(change, 0.0).sum()
                box[change > 0.0, 3] *= np.clip(SLOWER_RISE * down / max(up, 1e-9), LEAST_FACTOR, 1.0)
            raises = push > SMALL_PART * max(push.max(), 1e-9)
            factor = 1.0 - (1.0 - TORQUE_PART / peak.ratio[i]) * peak.value[i] / max(push[raises].sum(), 1e-9)
            for j in np.flatnonzero(raises):
                side = int(ddq[j] > 0.0)
                least = max(LEAST_PART * abs(self.box[j, 2, side]), stop[j] if ddq[j] * X[1, j] < 0.0 else 0.0)
                most = min(abs(box[j, 2, side]), max(factor * abs(ddq[j]), least))
                box[j, 2, side] = np.copysign(most, ddq[j])

    def brake(self, box: Array, X: Array, low: Array, high: Array) -> Array:
        """Return limits with which joints that stop between two positions (n,) respect velocity limits that fall to the ends.

        Before a stop at a distance r from the end a deceleration a allows √(2 a x) at a distance x. It stays below the limit
        −o + √(2 d (r + x)) at each x if a ≤ d − o² / (2 r).
        """
        if self._falling is None:
            return box
        box, ends, (o, d) = box.copy(), self.robot.limits, self._falling
        for side, room in enumerate((ends.upper - high, low - ends.lower)):
            room, sign = np.maximum(room, 1e-9), 2.0 * side - 1.0
            most = np.maximum(BRAKE_PART * (d - o**2 / (2.0 * room)), sign * X[2] + 1e-6)  # the state stays inside
            falls = (np.sqrt(2.0 * d * room) - o < -sign * box[:, 1, 1 - side]) & (room > o**2 / (2.0 * d))
            box[falls, 2, side] = sign * np.minimum(sign * box[:, 2, side], most)[falls]
        return box

    def _transfer(self, box: Array) -> Transfer:
        """Return the solver of time-optimal motions within limits."""
        return self._usual if box is self.box else Transfer(box)

    # ------------------------------------------------------------ joints, and a plan

    def _go(self, X: Array, q: Array) -> Make:
        """Return the maker of time-optimal motions to joints."""
        q = clip_joints(self.robot, q, "onto")
        goal = np.stack([q, 0.0 * q, 0.0 * q])
        arrived = (np.abs(X - goal).max(axis=1) < ARRIVED).all()

        low, high = np.where(q < X[0], q, np.inf), np.where(q > X[0], q, -np.inf)

        return lambda box, k: _Attempt(
            make_rest(X[0], BRIEF_REST) if arrived else self._transfer(self.brake(box, X, low, high)).to_state(X, goal)
        )

    def _enter(self, X: Array, curve: Trajectory) -> Make:
        """Return the maker of motions that enter another one where they end soonest, then at the next best instants."""
        if curve.n != self.robot.n:
            raise InvalidInput("onto", f"a motion of {curve.n} joints", f"{self.robot.n}, of {self.robot.name}")

        if self.free.any():
            curve = map_joints(curve, np.eye(curve.n), unwind(self.robot, curve(0.0), X[0]) - curve(0.0))
        times = curve.end * ENTRIES
        goals = np.stack([curve(times, order) for order in range(3)], axis=1)

        def make(box: Array, k: int) -> _Attempt:
            transfer = self._transfer(box)
            entries = [(transfer.find(X, goal), t, goal) for t, goal in zip(times.tolist(), goals, strict=True)]
            found = sorted((e for e in entries if e[0] is not None), key=lambda e: e[0].duration - e[1])
            if k >= len(found):
                return _Attempt(None)
            entry, t, goal = found[k]
            return _Attempt(motion.build(X, goal, entry).onto(curve, t, goal))

        return make


class ChunkFollower:
    """The motions that follow one chunk from a state (3, n), at an age of the chunk [s]."""

    def __init__(self, engine: Retargeter, X: Array, chunk: Chunk, age: float) -> None:
        self._engine, self._X, self._budget, n = engine, X, WORK, engine.robot.n
        P, rate, repaired, clipped, jumps = read_targets(chunk, engine.robot, engine.free, engine.ranges)
        self._extent = P.min(axis=0), P.max(axis=0)
        spans, end = min(len(P) - 1, MOST_SPANS), (len(P) - 1) / rate
        self._c, self._h = np.empty((spans + 5, n)), end / spans
        scatter = find_scatter(P)
        tolerance = max(engine.tolerance, min(SCATTERS * scatter, MOST_TOLERANCE * engine.tolerance))
        self._error = fit_reference(P, tolerance, self._c)
        s0 = min(max(age, 0.0), LATEST * end)
        if engine.align == "nearest" and s0 > 0.0:
            places = np.linspace(0.0, s0, TRIED)
            away = np.abs(unwind(engine.robot, self._sample(places, 1)[:, 0], X[0]) - X[0]).max(axis=1)
            s0 = float(places[np.flatnonzero(away <= away.min() + engine.tolerance)[-1]])  # nearer ones are noise
        self._c += unwind(engine.robot, place := self._sample(np.array([s0]), 1)[0, 0], X[0]) - place
        self._facts: dict[str, Any] = {"repaired": repaired, "clipped": clipped, "jumps": jumps, "scatter": scatter}
        self._facts["skipped"] = ceil(s0 * chunk.rate - 1e-9)
        # A chunk observed in the future begins then, if it is entered by its clock.
        self._wait = max(-age, 0.0) if engine.align == "clock" else 0.0
        self._s = np.linspace(s0, end, int(min(max(motion.PLACES[0], (end - s0) / motion.APART), motion.PLACES[1])))
        self._R = self._sample(self._s, 4)

    def _sample(self, s: Array, orders: int) -> Array:
        """Return the reference and its derivatives (k, orders, n)."""
        R = np.empty((s.size, orders, self._c.shape[1]))
        sample_reference(self._c, self._h, s, R)
        return R

    def make(self, box: Array, k: int) -> _Attempt:
        """Return the motion that follows the chunk within limits of single joints, slower with each try."""
        engine = self._engine
        box = engine.brake(box, self._X, *self._extent) if k else box
        when, s, longest = self._find_pace(box, SLOWER[k])
        facts = self._facts | {"reference": PacedReference(self._c, self._h, when, s, self._error)}
        targets = self._sample(s, 1)[:, 0].copy()
        j, used, knots, count, c = track_targets(self._X, box, when, targets, longest, self._budget)
        self._budget -= used + PROOF * knots.size
        if j == -2:
            words = f"not found within the budget of work of one call: {when[-1]:.3g} s in pieces of at most {longest:.2g} s"
            return _Attempt(None, words + "; send fewer targets or a shorter chunk, or set a larger longest", facts)
        if j >= 0:
            return _Attempt(None, f"no motion of {engine.robot.joint_names[j]} within its limits was found", facts)
        return _Attempt(JointCubics(knots, count, c), "", facts)

    def _find_pace(self, box: Array, slower: float) -> tuple[Array, Array, float]:
        """Return instants [s], the chunk's time at each, and the longest piece [s], with the pace reduced to a fraction."""
        engine, s, X = self._engine, self._s, self._X
        pace = engine.pace * slower
        rows, cap, x, t = np.empty((s.size, X.shape[1], 4)), np.empty(s.size), np.empty(s.size), np.empty(s.size)
        motion.write_joint_rows(self._R, box, pace, rows, cap)
        rows = self._add_rows(rows, cap, OTHER_PART)
        first = pace
        if engine.pace > 1.0:
            rate = self._R[0, 1]
            first = float(np.clip(rate @ X[1] / max(rate @ rate, 1e-9), 0.05, pace))
        motion.sweep_pace(s, rows, cap, first * first, min(motion.LEAST_PACE, pace) ** 2, x, t)
        ramp = np.minimum(box[:, 2, 1], -box[:, 2, 0]) / np.minimum(box[:, 3, 1], -box[:, 3, 0])
        width = max(float(ramp.max()), SHORTEST_WINDOW)
        longest = engine.longest * max(1.0, float(t[-1] / (SLOW[0] + SLOW[1] * min((s[-1] - s[0]) / self._h, COUNTED))))
        step = 0.5 * longest
        when = np.arange(0.0, min(t[-1] + 0.5 * width, MOST_PIECES * longest) + 2.0 * step, step)
        out = np.empty_like(when)
        motion.smooth_pace(s, t, float(np.sqrt(x[0])), width, when, out)
        return when + self._wait, out, longest

    def _add_rows(self, rows: Array, cap: Array, part: float) -> Array:
        """Return the rows with those of limits of the whole arm, and lower the largest ṡ² by those of first order."""
        samples: Any = _Samples(self._engine.robot, self._R)
        points, extra = PathPoints(samples, self._s), [rows]
        for name in self._engine.others:
            order = kind_of(name).order
            if order == 1:
                most = np.abs(self._engine.limits.rows(name, points)[:, :, 0]).max(axis=1) / part
                np.minimum(cap, 1.0 / np.maximum(most, 1e-9) ** 2, out=cap)
            elif order == 2:
                found = self._engine.limits.rows(name, points) / part
                extra.append(np.pad(found, ((0, 0), (0, 0), (0, 4 - found.shape[2]))))
        return np.ascontiguousarray(np.concatenate(extra, axis=1))


def clip_joints(robot: Robot, q: Array, argument: str) -> Array:
    """Return joints (n,) clipped to their ranges, which they may exceed by the rounding of an encoder."""
    clipped, ends = robot.limits.clip(q), robot.limits
    i = int((excess := np.abs(q - clipped)).argmax())
    if excess[i] > ROUNDED:
        words = f"{q[i]:.6g} for {robot.joint_names[i]}, {excess[i]:.3g} outside"
        expected = f"a value in [{ends.lower[i]:.6g}, {ends.upper[i]:.6g}]"
        raise InvalidInput(argument, words, expected, advice=ask_for_degrees(ends, ~robot.prismatic, q))
    return clipped


def _box(robot: Robot, limits: MotionLimits) -> Array:
    """Return the limits (n, 4, 2) of position, velocity, acceleration and jerk, lower and upper."""
    box, bounds = np.empty((robot.n, 4, 2)), limits.bounds(robot.n)
    box[:, 0] = np.stack([robot.limits.lower, robot.limits.upper], axis=1)
    for order, name in enumerate(DERIVATIVES, 1):
        low, high = sides(bounds[name])
        if not np.isfinite(high).all():
            joint = robot.joint_names[int((~np.isfinite(high)).argmax())]
            expected, got = "finite limits on velocity, acceleration and jerk", f"no {name} limit of {joint}"
            raise InvalidInput("limits", got, expected, advice=f"such as {name}=10")
        box[:, order] = (1.0 - SPARE) * np.stack([low, high], axis=1)
    return box


def _joints(value: Any, n: int, argument: str) -> Array:
    """Return finite joint values (n,)."""
    expected = f"a Chunk, a plan, or {n} finite joint values" if argument == "onto" else f"{n} finite numbers"
    return finite_array(value, argument, expected, (n,))
