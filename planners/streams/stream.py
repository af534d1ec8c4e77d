"""stream(): set-points at a fixed rate from a running motion, which join targets as they come, else end at rest."""

from __future__ import annotations

import atexit
import re
import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from math import ceil
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.check import check_flag, check_kind, check_number, format_value, real_array
from optik.errors import InvalidInput, NoSolution
from optik.scene import Scene
from optik.types import Array
from planners.limits import MotionLimits
from planners.motion.motion import HasMotion, Motion, get_motion
from planners.planning.result import Plan
from planners.streams.chunk import Chunk, Jog
from planners.streams.engine import SCATTERS, Retargeter, clip_joints
from planners.streams.motion import BRIEF_REST
from planners.streams.result import Retargeted, RetargetStatus, state_of
from planners.trajectory import Trajectory, join, make_rest

# ---------------- running motions of an arm


AT_REST = 1e-9
"""Largest velocity of a joint at the end of a motion that ends at rest [rad/s, m/s]."""


def begin(engine: Retargeter, start: Any, argument: str) -> Trajectory:
    """Return a running motion that ends at rest; a moving state or end is continued by a stop."""
    robot, n = engine.robot, engine.robot.n
    curve = start if isinstance(start, Trajectory) else getattr(start, "trajectory", None)
    expected = f"a motion of {n} joints, {n} finite joint values, or a state (q, q̇, q̈) of shape (3, {n})"
    if curve is not None:
        X = np.array([curve(curve.end, order) for order in range(3)])
        rests = np.abs(X[1]).max() <= AT_REST
    else:
        X = real_array(start, argument, expected)
        X = np.stack([X, *np.zeros((2, X.size))]) if X.ndim == 1 else X
        rests = not X[1:].any()
    if X.shape != (3, n) or not np.isfinite(X).all():
        raise InvalidInput(argument, format_value(start, 60), expected)
    if curve is None:
        X = np.stack([clip_joints(robot, X[0], argument), *X[1:]])
    if rests:
        return curve or make_rest(X[0], 3.0 * BRIEF_REST)
    moving = scipy.interpolate.PPoly((X / [[1.0], [1.0], [2.0]])[::-1, None], np.array([0.0, BRIEF_REST]))
    stop = engine.run(Trajectory(moving), 0.0, Jog(np.zeros(n), 0.0))
    if not stop:
        raise InvalidInput(argument, f"a moving state: {stop.reason}", "a state that can be stopped within the limits")
    return stop.trajectory if curve is None else join(curve, stop.trajectory)


# ---------------- stream()


BUDGET = 0.004
"""Default time from the arrival of a target to the start of its motion [s]."""
SILENCE = 1.0
"""Default time at rest without a target after which a stream ends [s]."""
KEPT_TIMES = 100_000
"""Largest number of computing times and delays in a report."""
ENOUGH = 0.99
"""Fraction of the motions that would have begun in time with the advised budget."""
_VARIES = re.compile(r"""'[^']*'?|"[^"]*"?|\[[^]]*]?|\([^)]*\)?|(?<!\w)[-+]?(\d[\w.]*([-+]\d+)?|inf|nan)""")
"""What differs between texts of one kind: quoted words, lists and numbers."""


class Setpoint(NamedTuple):
    """The state of a stream at one tick: time [s], q, q̇ and q̈ (n,), and the motion that begins here, if one does."""

    t: float
    q: Array
    dq: Array
    ddq: Array
    joined: Retargeted | None = None


Source = Callable[[Setpoint], "Chunk | Jog | ArrayLike | HasMotion | None"]
"""A function that returns a new target, or None; it gets the present set-point and must not wait."""


class StreamReport(NamedTuple):
    """What a stream did.

    ``ticks`` counts the set-points that were given, and ``missed`` the ticks that passed before the loop asked for them.
    ``joined`` counts the targets onto which a motion began. ``skipped`` counts their points before the entry. ``clipped``
    counts their points outside the ranges. ``jumps`` counts their points at which a joint with limits jumped by more than π.
    ``kept`` counts by kind why targets were not joined, and ``cut`` why chunks of poses ended early; the first text stands for
    all that differ only in numbers. ``late`` counts motions that were proved after their instant and dropped. With ``enough``
    [s] as budget 99 % of all would have been in time. ``scatter`` is the largest standard deviation of targets about a smooth
    curve, and ``tolerance`` is that of the stream [rad, m]. ``cpu`` holds computing times and ``delay`` delays of ticks: the
    median, the 99 % quantile and the largest value [s].
    """

    ticks: int
    joined: int
    kept: dict[str, int]
    late: int
    missed: int
    skipped: int
    cpu: tuple[float, float, float]
    delay: tuple[float, float, float]
    enough: float
    clipped: int
    jumps: int
    scatter: float
    tolerance: float
    cut: dict[str, int]

    def __str__(self) -> str:
        kept, cut = ("; ".join(f"{count} × {why}" for why, count in each.items()) for each in (self.kept, self.cut))
        cpu, delay = (" / ".join(f"{1e3 * x:.3g}" for x in each) for each in (self.cpu, self.delay))
        noise = f"the noise of the targets is {1e3 * self.scatter:.2g} mrad (or mm), above tolerance={self.tolerance:g}"
        lines = {
            f"{self.ticks} set-points, {self.missed} ticks missed": True,
            f"{self.joined} targets joined, {self.skipped} points skipped, {self.late} motions late": True,
            f"not joined: {kept or 'none'}": True,
            f"computing time of a target, median / 99 % / largest: {cpu} ms": True,
            f"delay of a tick: {delay} ms": True,
            f"{self.late} motions late: a budget of {self.enough:.4g} s would have sufficed for 99 %": self.late,
            f"{self.clipped} targets were clipped to the joint ranges": self.clipped,
            f"a joint with limits jumps by more than π rad at {self.jumps} targets": self.jumps,
            f"{noise}; try tolerance={SCATTERS * self.scatter:.2g}": self.scatter > self.tolerance,
            f"chunks of poses that end early: {cut}": self.cut,
        }
        return "\n".join(line for line, said in lines.items() if said)


class Stream(Iterator[Setpoint]):
    """An iterator of set-points; see `planners.stream`."""

    def __init__(
        self, robot: Robot, source: Source, start: ArrayLike | Retargeted | Any, *, rate: float, budget: float,
        silence: float | None, realtime: bool, **options: Any,
    ) -> None:  # fmt: skip
        check_kind(robot, "robot", Robot)
        if not callable(source):
            raise InvalidInput("source", repr(source)[:60], "a function of the present set-point")
        self.robot, self.rate = robot, check_number(rate, "rate", "set-points per second, above 0", above=0.0)
        self._source, self.realtime = source, check_flag(realtime, "realtime")
        self.budget = check_number(budget, "budget", "seconds, at least 0", least=0.0)
        self._silence = None if silence is None else check_number(silence, "silence", "seconds, at least 0", least=0.0)
        self.engine = Retargeter(robot, **options)
        self._running, self._begin = begin(self.engine, start, "start"), 0.0
        self._waiting = deque[tuple[Retargeted, float]]()  # motions that begin later, each from the one before
        self._pool = ThreadPoolExecutor(1) if realtime else None
        self._work: tuple[Future[tuple[Retargeted, float]], float, float] | None = None
        self._tick, self._began, self._heard, self._given = -1, 0.0, 0.0, -1.0
        self._stopping = self._rests = False
        self.announce: Callable[[Retargeted, float], None] = lambda motion, begin: None
        """Called with each motion that was proved and the time at which it begins [s], before it does."""
        self.error: Exception | None = None
        """The exception of the source or a computation. No target is taken after it; it is raised when the arm is at rest."""
        self._kept, self._cut = (dict[str, tuple[str, int]]() for _ in range(2))  # by kind: the first text, the count
        self._joined = self._late = self._missed = 0
        self._facts = np.zeros(4)  # skipped, clipped and jumping targets; the largest scatter
        self._cpu, self._delay, self._needed = (deque[float](maxlen=KEPT_TIMES) for _ in range(3))
        self._warm_up()

    def _warm_up(self) -> None:
        """Compile what each kind of target needs, before the first one comes."""
        q = state_of(self._running, 0.0)[0]
        goal, chunks = self.engine.run(self._running, 0.0, q), (Chunk([x] * 8, 20.0) for x in (q, self.robot.fk(q)))
        for target in (*chunks, Jog(np.zeros(self.robot.n), 0.1), goal):
            self.engine.run(self._running, 0.0, target)

    @property
    def time(self) -> float:
        """The stream's clock [s], on which `Chunk.observed` is given; 0 before the first set-point."""
        if self._tick < 0:
            return 0.0
        return time.perf_counter() - self._began if self.realtime else self._tick / self.rate

    def stop(self) -> None:
        """Ignore further targets: accepted motions are executed to their end at rest, and then the stream ends."""
        self._stopping = True

    def __next__(self) -> Setpoint:
        """Return the set-point of the next tick; at the end raise what the source raised."""
        now = self.advance()
        if now is None:
            raise self.error or StopIteration
        return now

    def advance(self) -> Setpoint | None:
        """Return the set-point of the next tick, that of the clock and never two at once; raise nothing at the end.

        Returns
        -------
        Setpoint or None
            None at the end, at rest; `error` is what the source raised.
        """
        t = self._wait()
        joined, self._given = self._join(t), t
        now = Setpoint(t, *state_of(self._running, t - self._begin), joined)
        patience = 0.0 if self._stopping else self._silence
        if self._rests and patience is not None and t - max(self._heard, self._begin + self._running.end) >= patience:
            self.close()
            return None
        self._rests = t - self._begin >= self._running.end and not self._waiting and self._work is None
        self._poll(now)
        return now

    def _wait(self) -> float:
        """Wait for the next tick, and return its time; ticks that have passed are left out."""
        if self._tick < 0:
            self._began = time.perf_counter()
        self._tick += 1
        if self.realtime:
            passed = int((time.perf_counter() - self._began) * self.rate)
            if passed > self._tick:
                self._missed += passed - self._tick
                self._tick = passed
            early = self._began + self._tick / self.rate - time.perf_counter()
            if early > 0.0:
                time.sleep(early)
            self._delay.append(time.perf_counter() - self._began - self._tick / self.rate)
        return self._tick / self.rate

    def _poll(self, now: Setpoint) -> None:
        """Ask the source for a target, and begin to compute its motion."""
        if self._stopping or self._work is not None:
            return
        try:
            target = self._source(now)
            if target is None:
                return
            self._heard = now.t
            at = ceil((now.t + self.budget) * self.rate - 1e-9) / self.rate
            base, begin = self._running, self._begin
            if self._waiting:
                base, begin = self._waiting[-1][0].trajectory, self._waiting[-1][1]
            at = max(at, begin)
            if self._pool is None:
                self._take(*self._compute(base, begin, at, target), at)
            else:
                self._work = self._pool.submit(self._compute, base, begin, at, target), at, now.t
        except Exception as error:
            self._refuse(error)

    def _refuse(self, error: Exception) -> None:
        """Count a target that is not valid, or a failed plan; after any other error, take no more targets."""
        self._heard = self._given
        if isinstance(error, InvalidInput | NoSolution):
            _count(self._kept, str(error))
        else:
            self._stopping, self.error = True, error

    def _compute(self, base: Trajectory, begin: float, at: float, target: Any) -> tuple[Retargeted, float]:
        """Return the motion from a time on, and its computing time [s]."""
        if isinstance(target, Chunk):
            target = Chunk(target.points, target.rate, target.observed - begin)
        since = time.thread_time()
        found = self.engine.run(base, at - begin, target)
        return found, time.thread_time() - since

    def _take(self, found: Retargeted, seconds: float, at: float) -> None:
        """Schedule the motion onto a target that came at a time, or count why there is none."""
        self._cpu.append(seconds)
        if self._given > at + 1e-9:  # the running motion's set-points after this instant were given
            self._late += 1
        elif found.status is RetargetStatus.KEPT:
            _count(self._kept, found.reason)
        else:
            self.announce(found, at)
            self._waiting.append((found, at))
            self._facts[:3] += found.skipped, found.clipped, found.jumps
            self._facts[3] = max(self._facts[3], found.scatter)
            if found.cut:
                _count(self._cut, found.cut)

    def _join(self, t: float) -> Retargeted | None:
        """Return the motion that begins now, if one does; a result that came after its instant is dropped."""
        if self._work is not None and self._work[0].done():
            (work, at, asked), self._work = self._work, None
            self._needed.append(max(self._given - asked, 0.0))
            try:
                self._take(*work.result(), at)
            except Exception as error:
                self._refuse(error)
        joined: Retargeted | None = None
        while self._waiting and t >= self._waiting[0][1] - 1e-9:
            joined, self._begin = self._waiting.popleft()
            self._running = joined.trajectory
            self._joined += 1
        return joined

    def close(self) -> None:
        """End the thread that computes motions."""
        if self._pool is not None:
            self._pool.shutdown(wait=False)

    def report(self) -> StreamReport:
        """Return what the stream did so far.

        Returns
        -------
        StreamReport
            Counts, computing times and delays.
        """
        cpu, delay = (
            tuple(np.quantile(x, (0.5, ENOUGH, 1.0)).tolist()) if x else (0.0,) * 3 for x in (self._cpu, self._delay)
        )
        kept, cut = (dict(each.values()) for each in (self._kept, self._cut))
        enough = float(np.quantile(self._needed, ENOUGH, method="higher")) if self._needed else 0.0
        ticks, (skipped, clipped, jumps) = self._tick + 1 - self._missed, self._facts[:3].astype(int).tolist()
        more = enough, clipped, jumps, float(self._facts[3]), self.engine.tolerance, cut
        return StreamReport(ticks, self._joined, kept, self._late, self._missed, skipped, cpu, delay, *more)


def _count(counts: dict[str, tuple[str, int]], text: str) -> None:
    """Count a text by its kind, for which the first one stands."""
    kind = _VARIES.sub("…", text)
    first, count = counts.get(kind, (text, 0))
    counts[kind] = first, count + 1


def stream(
    robot: Robot, source: Source, start: Any, *, rate: float = 1000.0, limits: MotionLimits | None = None,
    tolerance: float = 0.005, pace: float = 1.0, align: str = "nearest", longest: float = 0.04,
    scene: Scene | None = None, budget: float = BUDGET, silence: float | None = SILENCE, realtime: bool = True,
) -> Stream:  # fmt: skip
    """Return an iterator of set-points that joins the targets of a source as they come.

    Every accepted motion ends at rest, so the arm stops by itself when the source is silent. Opening a stream compiles the code
    for all targets. A Python loop is not a real-time system: missed ticks are skipped, and the report states the delays.

    Parameters
    ----------
    robot : Robot
        The arm.
    source : callable
        Gets the present `Setpoint`; returns a `Chunk`, joints, a plan, or None. It must not block, and is not asked while a
        motion is computed. `JogVelocity` is a source. `Chunk.observed` is a time on the stream's clock, `Setpoint.t`. A target
        that is not valid is counted; another exception is raised when the arm is at rest.
    start : (n,) array, (3, n) array, or Plan, Motion, Retargeted or Trajectory
        Joints at rest [rad, m]; a measured state q, q̇, q̈, which is brought to rest; or the motion that begins with the stream.
    rate : float
        Set-points per second [1/s].
    limits, tolerance, pace, align, longest, scene
        As for `planners.retarget`; the limits are by default the robot's. Targets that scatter are smoothed by up to
        four tolerances. Pieces of slow motions last longer than `longest`.
    budget : float
        Time from the arrival of a target to the start of its motion [s]. A result that comes later is dropped.
    silence : float, optional
        Time at rest without a new target after which the stream ends [s]; None for never.
    realtime : bool
        Whether to wait for the clock; otherwise set-points come as fast as they are asked for.

    Returns
    -------
    Stream
        The iterator, with `Stream.stop`, `Stream.report` and `Stream.time`.

    Raises
    ------
    InvalidInput
        An argument of another type or out of range, or a missing limit.
    """
    return Stream(robot, source, start, rate=rate, budget=budget, silence=silence, realtime=realtime, limits=limits,
                  tolerance=tolerance, pace=pace, align=align, longest=longest, scene=scene)  # fmt: skip


# ---------------- retarget()


def retarget(
    motion: Any, at: float, onto: Any, *, limits: MotionLimits | None = None, tolerance: float = 0.005,
    pace: float = 1.0, align: str = "nearest", longest: float = 0.04, scene: Scene | None = None,
    robot: Robot | None = None,
) -> Retargeted:  # fmt: skip
    """Return a motion from the moving state of the running motion onto another target.

    A chunk is followed as closely as the limits allow: repeated targets are repaired, the targets are smoothed within the
    tolerance, their pace is lowered where the limits demand it, and the joints track them. Joints and plans are entered by
    time-optimal motions. Every result ends at rest. If none is proved, the running motion goes on, without a new proof.

    Parameters
    ----------
    motion : Plan, Motion or Retargeted; with `robot` also Trajectory or (3, n) array
        The running motion, or the measured state (q, q̇, q̈) at ``at=0``; then the running motion is the stop from this state.
    at : float
        Its time at which the new motion begins [s].
    onto : Chunk, (n,) array, or Plan, Motion or Retargeted
        Targets at a fixed rate; joints to stop at [rad, m]; or another motion, which is entered where it ends soonest.
    limits : MotionLimits, optional
        By default those of the running motion, or of `robot`. Velocity, acceleration and jerk of all joints must be limited.
    tolerance : float
        Largest distance between a target and the smoothed chunk [rad, m]; four times it where they scatter.
    pace : float
        Largest rate of the chunk, over its own; above 1 to be faster than the chunk says [1].
    align : {"nearest", "clock"}
        "nearest" enters the chunk where it is nearest to the arm, but not later than by its clock; "clock" by its clock.
    longest : float
        Longest duration of a piece [s]: shorter ones follow more closely, at more work. Slow motions have longer ones.
    scene : Scene, optional
        Obstacles, which the motion is proved to avoid.
    robot : Robot, optional
        The arm of a trajectory or a state.

    Returns
    -------
    Retargeted
        The motion and its certificate. JOINED for a chunk or a motion, GOAL for joints, KEPT if the running motion goes on.

    Raises
    ------
    InvalidInput
        An argument of another type, size or range, a missing limit, or a state that is not stopped within the limits.
    """
    at = check_number(at, "at", "a time of the running motion [s], at least 0", least=0.0)
    options: dict[str, Any] = {"tolerance": tolerance, "pace": pace, "align": align, "longest": longest}
    if robot is None:
        if not isinstance(motion, Retargeted | Plan | Motion) and not hasattr(motion, "motion"):
            expected = "a Plan, Motion or Retargeted; or with robot= also a Trajectory or a state (q, q̇, q̈)"
            raise InvalidInput("motion", format_value(motion, 60), expected)
        motion = motion if isinstance(motion, Retargeted | Plan) else get_motion(motion)
        robot, limits = motion.robot, motion.limits if limits is None else limits
    for known in _engines:
        same = known.robot is robot and known.limits is limits and known.scene is scene
        if same and all(isinstance(x, float | str) and x == getattr(known, name) for name, x in options.items()):
            break
    else:
        known = Retargeter(robot, limits, scene=scene, **options)
        _engines.appendleft(known)
    return known.run(begin(known, motion, "motion"), at, onto)


_engines = deque[Retargeter](maxlen=4)
"""Those of the last calls, which the next call with the same objects uses again."""
atexit.register(_engines.clear)  # before Ruckig's module, which reports objects that outlive it
