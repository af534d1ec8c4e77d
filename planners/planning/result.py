"""Plan: a motion with its joint path and its certificate, or the reason why there is none."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.card import Card
from optik.check import check_keywords, check_number, format_count
from optik.errors import InvalidInput
from optik.scene import Scene
from optik.types import Array
from optik.view.page import Page, show_page
from planners.certificate.certificate import Certificate, describe_limiting, shorten_text, summary_lines
from planners.certificate.violation import Allow, words_for
from planners.files import save
from planners.following.follow import JointPath, PlanFailure
from planners.following.resolve import Resolution
from planners.limits import DERIVATIVES, MotionLimits
from planners.limits.motion_limits import compute_least_duration
from planners.motion import Motion, PlanStatus
from planners.motion.motion import Event, events_to_plain
from planners.motion.show import motion_card, plot_motion, show_motion
from planners.paths.base import Path
from planners.paths.coordinates import CoordinateRange
from planners.planning.failed import failed_plan_data, plot_failed_plan, show_failed_plan
from planners.ros.export import RosExport
from planners.timing.base import StopKind, speed_bound
from planners.trajectory import Trajectory

FAR_SLOWER, SLOWNESS_POINTS = 30.0, 257
"""Ratio to the duration at the velocity limits above which a plan reports where it is slow; number of points for this."""


class PlanSeconds(NamedTuple):
    """Times of planning: following the path, finding the law's motion, and certifying it [s]."""

    joints: float = 0.0
    timing: float = 0.0
    certificate: float = 0.0


@dataclass(frozen=True)
class FreedomResult:
    """What a plan did with the freedoms of its path.

    Attributes
    ----------
    fixed_duration : float
        Duration of the motion along the initial path [s].
    gain : float
        Fraction of it that the choice saves; 0 if the initial path was kept, at least −0.002 where the joints move less.
    outcome : str
        In words: chosen, or why the initial path was kept.
    ranges : tuple of CoordinateRange
        Allowed and reached range of each coordinate. The convex hull of the spline's coefficients proves the reached range.
    s, values : (k,) and (k, d) arrays
        Path parameters [m, or rad], and what each of the ranges bounds there; the joints of a path in joint space [rad, m].
    gradient : float
        Sum over the coefficients of |dT/dp| at the initial path [s/rad, s/m]; NaN if it is not known.
    starts, steps : int
        Initial guesses that were tried, and Newton steps in all.
    distance, angle : float
        Proved bounds on the tool's distance [m] and angle [rad] to the given path; NaN for a path in joint space.
    unknown : tuple of str
        Further limits, which the choice does not know: only the timing of the chosen path respects them.
    """

    fixed_duration: float
    gain: float
    outcome: str
    ranges: tuple[CoordinateRange, ...]
    s: Array
    values: Array
    gradient: float = float("nan")
    starts: int = 0
    steps: int = 0
    distance: float = float("nan")
    angle: float = float("nan")
    unknown: tuple[str, ...] = ()

    def __str__(self) -> str:
        moved = self.ranges if self.gain else ()
        ranges = "".join(
            f"; {one.name} {_pair(one.reached)} {one.unit} of {_pair(one.allowed)} {one.unit}" for one in moved
        )
        far = f"; tool at most {1e3 * self.distance:.3g} mm and {self.angle:.5g} rad from the given path"
        ranges += far if moved and np.isfinite(self.distance) else ""
        tried = f"; {format_count(self.starts, 'start')}, {self.steps} Newton steps" if self.starts else ""
        word = "shorter" if self.gain > 0.0 else "longer"
        saved = f", {100.0 * abs(self.gain):.3g} % {word} than {self.fixed_duration:.4g} s" if self.gain else ""
        unknown = f"; chosen without {', '.join(self.unknown)}" if self.unknown else ""
        return f"freedoms: {self.outcome}{saved}{ranges}{tried}{unknown}"


def _pair(values: tuple[float, float]) -> str:
    """Return two numbers with a unit behind them, as messages of the command line convert them."""
    return f"[{values[0]:.5g}, {values[1]:.5g}]"


class SearchReport(NamedTuple):
    """How a plan found a way around obstacles.

    Attributes
    ----------
    planner : str
        Name of the search.
    samples : int
        Random configurations of all searches.
    rounds : int
        Rounds of the choice of path and timing, each with the pairs of shapes that came too near in those before.
    paths : int
        Initial paths that were tried.
    """

    planner: str
    samples: int
    rounds: int
    paths: int


class Stopping(NamedTuple):
    """Certified stops along a motion: from times t (k,) [s], their durations [s] and their ways along the path [m, rad]."""

    t: Array
    time: Array
    distance: Array


def judge_certificate(
    proof: Certificate, enforced: tuple[str, ...] | None = None
) -> tuple[PlanStatus, PlanFailure | None]:
    """Return the status of a plan with this certificate, and its first violation; the law enforces these limits."""
    if proof.is_valid:
        return PlanStatus.SOLVED, None
    status = PlanStatus.NOT_PROVED
    advice = "another law, or a wider tolerance; plan.trajectory and plan.certificate show where"
    if proof.clearance is not None and proof.clearance.touches:
        status = PlanStatus.CONTACT
        advice = "another start, goal or path, or a smaller margin; plan.certificate.clearance shows where"
    elif enforced is not None and replace(proof, enforced=enforced).is_valid:
        status = PlanStatus.LIMITS_EXCEEDED
        advice = f"another law, as {proof.law} does not enforce this limit; or allow={words_for(proof.violations)!r}"
    first = proof.violations[0]
    reason = f"the certificate is not valid: {'; '.join(proof.reasons)}"
    return status, PlanFailure(status, proof.s_at(first.t), first.joint, reason, advice)


@dataclass(frozen=True, repr=False)
class Plan:
    """The result of `plan`. ``bool(plan)`` is success: there is a motion, and its certificate is valid.

    Attributes
    ----------
    robot, path, limits
        The arguments of the plan.
    status : PlanStatus
        How planning ended.
    solver, law : str
        The IK method and the time law.
    prefix : JointPath or None
        The joint path, or on failure its valid part.
    failure : PlanFailure or None
        Where and why it failed: s, joint, reason, advice. There may be a motion too, for example with NOT_PROVED.
    stretch_factor : float
        Duration over the duration of the motion that the law chose: it was stretched for limits, or on request.
    limit_factor : float
        The part of that factor which limits required, also those of `slowed_to`; 1 if none did, or with ``duration=``.
    span : (2,) tuple of float, or None
        The part of the path [m, or rad] that the motion covers, if it is not the whole path: after `replan`.
    speed : float or None
        The constant tool speed [m/s; rad/s for a pure rotation] that the law was given.
    scene : Scene or None
        Obstacles, and the margin to them.
    before : (2,) tuple, or None
        Limits that hold until a time [s], if the motion respects `limits` only from then on: after `replan` with lower limits.
    start_error : (3,) tuple of float, or None
        Largest differences [rad, rad/s, rad/s², or m] between the measured state given to `replan` and the motion's own.
    stop_kind : StopKind or None
        Kind of a stop: the optimum, the sweep's stop, or the end of the motion if that comes first.
    freedom : FreedomResult or None
        What was done with the freedoms of a `FreePath`: ranges, gain, and the coordinates along the path.
    resolution : Resolution or None
        How the whole path was resolved, if it was: layers, configurations, computing time.
    search : SearchReport or None
        How the way around obstacles was found, of a plan with ``avoid``.
    stop_step : float or None
        Time [s] between the instants whose stops `slowed_to` checked: `replan` also stops from the next one.
    seconds : PlanSeconds
        Durations of the parts of planning (after `replan` of the certificate only). They do not count in a comparison of plans.
    """

    robot: Robot
    path: Path
    limits: MotionLimits
    status: PlanStatus
    solver: str
    law: str
    prefix: JointPath | None
    failure: PlanFailure | None
    _trajectory: Trajectory | None
    _certificate: Certificate | None
    stretch_factor: float = 1.0
    span: tuple[float, float] | None = None
    speed: float | None = None
    scene: Scene | None = None
    seconds: PlanSeconds = field(default=PlanSeconds(), compare=False)
    before: tuple[MotionLimits, float] | None = None
    start_error: tuple[float, float, float] | None = None
    stop_kind: StopKind | None = None
    freedom: FreedomResult | None = field(default=None, compare=False)
    search: SearchReport | None = field(default=None, compare=False)
    resolution: Resolution | None = field(default=None, compare=False)
    stop_step: float | None = None
    limit_factor: float = 1.0

    @property
    def within_limits_from(self) -> float:
        """Time [s] from which the motion respects `limits`; before it, `before` has the limits that hold."""
        return 0.0 if self.before is None else self.before[1]

    def __bool__(self) -> bool:
        return self.status is PlanStatus.SOLVED

    def __repr__(self) -> str:
        return str(self)

    @property
    def _title(self) -> str:
        path, words = self.path, f" of {self.path.end:.3g} {self.path.unit}"
        words += f" (points merged: {len(path.dropped)})" if path.dropped else ""
        return f"{self.robot.name}, {type(path).__name__}{words}, {self.solver} + {self.law}"

    def _repr_html_(self) -> str:
        """Return verdict, peaks and plots for a notebook."""
        if self.has_motion:
            return motion_card(self._title, self.motion, self.certificate).to_html()
        assert self.failure is not None
        why = self.failure
        verdict = f"{self.status} at s = {why.s:.3g} {self.path.unit}{f', {why.joint}' if why.joint else ''}"
        facts = (("reason", why.reason), ("try", why.advice))
        return Card(title=self._title, verdict=verdict, good=False, facts=facts).to_html()

    def plot(self) -> Any:
        """Plot position, velocity, acceleration, jerk and torque over time against their limits; or positions up to a failure.

        Returns
        -------
        plotly.graph_objects.Figure
            With the active constraint of every segment of the motion below; and the stopping time, if `stopping` was read.

        Raises
        ------
        MissingDependency
            Plotly is not installed.
        """
        if not self.has_motion:
            return plot_failed_plan(self)
        stops = vars(self).get("stopping")
        return plot_motion(self.motion, self.certificate, None if stops is None else (stops.t, stops.time))

    def show(self) -> Page:
        """Show the motion, or the part before a failure: in the cell of a notebook, else in the browser.

        Returns
        -------
        Page
            The page; ``save(file)`` writes it.
        """
        return show_page(show_motion(self) if self.has_motion else show_failed_plan(failed_plan_data(self)))

    def __str__(self) -> str:
        lines, why, proof = [f"{self.status}: {self._title}"], self.failure, self._certificate
        if why is not None:
            share = f" ({100.0 * why.s / self.path.end:.3g} % of the path)" if self.path.end > 0.0 else ""
            if why.s or why.joint:
                lines.append(
                    f"stopped at s = {why.s:.3g} {self.path.unit}{share}{f', {why.joint}' if why.joint else ''}"
                )
            lines += [f"reason: {shorten_text(why.reason)}", f"try: {shorten_text(why.advice)}"]
        if proof is not None:
            lines += summary_lines(proof, self.least_duration)[why is not None :]
        return "\n".join([*lines, *self.remarks])

    @property
    def remarks(self) -> list[str]:
        """Lines on what limits the motion for how long, its stretch, where it is far slower, and what the plan chose."""
        lines = [] if self._certificate is None else describe_limiting(self._certificate)
        if self.limit_factor > 1.0:
            lines.append(f"duration stretched by {100.0 * (self.limit_factor - 1.0):.3g} % to meet the limits")
        return [*lines, *(str(x).strip() for x in (self.slowness, self.resolution, self.freedom) if x is not None)]

    @property
    def slowness(self) -> str | None:
        """Where a motion is far slower than its velocity limits require, in words; None if it is not."""
        if (
            not self
            or self.prefix is None
            or self.speed is not None
            or self.span is not None
            or self.limits.velocity is None
        ):
            return None
        s, t = np.linspace(0.0, self.prefix.end, SLOWNESS_POINTS), np.linspace(0.0, self.duration, SLOWNESS_POINTS)
        least = float(np.trapezoid(1.0 / speed_bound(self.prefix, self.limits, s), s))
        times = self.duration / (least + compute_least_duration(np.ptp(self.prefix(s), axis=0), self.limits))
        at = s[np.bincount(np.searchsorted(s, [self.certificate.s_at(x) for x in t])).argmax()]
        words = (
            f"  slow: {times:.3g} times as long as the velocity limits require; most time is spent near s = {at:.4g}"
        )
        return f"{words} {self.path.unit}" if times > FAR_SLOWER else None

    @property
    def has_motion(self) -> bool:
        """Whether there is a motion; it may be invalid."""
        return self._trajectory is not None

    def _require_motion(self) -> None:
        if self.failure is not None and not self.has_motion:
            raise self.failure.to_error()

    @property
    def joint_path(self) -> JointPath:
        """The whole joint path; raises `NoSolution` if there is none."""
        self._require_motion()
        assert self.prefix is not None
        return self.prefix

    @property
    def trajectory(self) -> Trajectory:
        """The timed motion; raises `NoSolution` with s, joint, reason and advice if there is none."""
        self._require_motion()
        assert self._trajectory is not None
        return self._trajectory

    @property
    def certificate(self) -> Certificate:
        """The certificate of the trajectory; raises `NoSolution` if there is no trajectory."""
        self._require_motion()
        assert self._certificate is not None
        return self._certificate

    @property
    def duration(self) -> float:
        """Duration of the motion [s], with the waits of a program; raises `NoSolution` if there is no motion."""
        return self.trajectory.duration

    @property
    def least_duration(self) -> float | None:
        """Least duration [s] of a joint move on any path: that of its slowest joint alone; None for other motions."""
        if not self.path.in_joints or not self.has_motion or self.span is not None or self.before is not None:
            return None
        if all(self.limits.value(name) is None for name in DERIVATIVES):
            return None
        return compute_least_duration(self.goal - self.trajectory(0.0), self.limits)

    @cached_property
    def stopping(self) -> Stopping:
        """Certified stops along the motion: arrays ``t`` [s], ``time`` [s] and ``distance`` [m, or rad] along the path."""
        from planners.replan.finish import find_stops

        return find_stops(self)

    @check_keywords
    def slowed_to(
        self, *, rms_torque: ArrayLike | None = None, cycle: float | None = None, stopping_time: float | None = None,
        stopping_distance: float | None = None,
    ) -> Self:  # fmt: skip
        """Return the plan with its motion stretched as a whole until it respects further limits; a motion that does is kept.

        Parameters
        ----------
        rms_torque : scalar or (n,) array, optional
            Greatest root mean square of each joint's torque over a cycle [N·m, N], friction included, for every load.
        cycle : float, optional
            Duration of a cycle [s]: the motion, and rest at its end, in which the static torque counts. By default the motion.
        stopping_time, stopping_distance : float, optional
            Greatest duration [s] and greatest way along the path [m, or rad] of the stop that `replan` with ``stop=True`` finds
            at any time of the motion.

        Returns
        -------
        Plan
            Of the same kind, certified. Every section of a program is stretched by the same factor; its waits do not change.

        Raises
        ------
        InvalidInput
            A plan without a valid motion, an invalid limit, or a cycle that is shorter than the motion.
        NoSolution
            A limit that no stretched motion respects: with the joint and its torque, or with the least value that was reached.
        """
        from planners.replan.finish import stretch_to_ends  # which replans, and so stands above this module

        return stretch_to_ends(self, rms_torque, cycle, stopping_time, stopping_distance)

    @property
    def events(self) -> tuple[Event, ...]:
        """The events of the motion: none, except in the plan of a program (`ProgramPlan.schedule`)."""
        return ()

    @property
    def goal(self) -> Array:
        """Configuration (n,) in which the motion ends [rad, m], of several goals, the one taken."""
        return np.asarray(self.trajectory(self.trajectory.duration))

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for files and programs: the trajectory at its knots and the certificate, or the failure."""
        out: dict[str, Any] = {
            "format": "optik-plan/2",
            "robot": self.robot.name,
            "robot_fingerprint": self.robot.fingerprint,
            "status": str(self.status),
            "solver": self.solver,
            "law": self.law,
            "limits": self.limits.to_dict(self.robot.n),
            "path": self.path.to_dict(),
        }
        if self.failure is not None:
            why = self.failure
            out |= {"s": why.s, "joint": why.joint, "reason": why.reason, "advice": why.advice}
        if self.freedom is not None:
            out["freedom"] = _freedom_to_dict(self.freedom)
        if self.search is not None:
            out["search"] = self.search._asdict()
        if self.resolution is not None:
            out["resolution"] = self.resolution._asdict()
        if self._trajectory is None:
            return out
        motion, t = self._trajectory, self._trajectory.knots
        if "stopping" in vars(self):
            out["stopping"] = {name: values.tolist() for name, values in self.stopping._asdict().items()}
        return out | {
            "duration": motion.duration,
            "slowed": self.stretch_factor,
            "span": None if self.span is None else list(self.span),
            "speed": self.speed,
            "within_limits_from": self.within_limits_from,
            "start_error": None if self.start_error is None else list(self.start_error),
            "stop_kind": self.stop_kind,
            "stop_step": self.stop_step,
            "joint_names": list(self.robot.joint_names),
            "goal": self.goal.tolist(),
            "events": events_to_plain(self.events),
            "knots": {"t": t.tolist(), **{k: motion(t, i).tolist() for i, k in enumerate(("q", "dq", "ddq"))}},
            "coefficients": motion.coefficients.tolist(),
            "certificate": self.certificate.to_dict(),
        }

    @property
    def motion(self) -> Motion:
        """The motion with its path, limits, tolerance and scene, as files store it; raises `NoSolution` if there is none."""
        proof = self.certificate
        return Motion(
            self.robot, self.path, self.limits, self.trajectory, self.law, proof.enforced, proof.tolerance, self.span,
            self.speed, self.scene, self.before, self.events,
        )  # fmt: skip

    def with_motion(self, trajectory: Trajectory, proof: Certificate | None = None, **changed: Any) -> Self:
        """Return the plan with another motion on its path, certified and judged.

        Parameters
        ----------
        trajectory : Trajectory
            The motion.
        proof : Certificate, optional
            Its certificate, if it has one; by default it is certified.
        **changed
            Further fields of the plan that differ, such as ``span``.

        Returns
        -------
        Plan
            Of the same kind. `stretch_factor` changes with the duration, and is 1 for another ``span``.

        Raises
        ------
        NoSolution
            The plan failed: there is no motion.
        """
        ratio = trajectory.duration / self.duration
        known: dict[str, Any] = {"stretch_factor": ratio * self.stretch_factor, "limit_factor": self.limit_factor}
        known["stop_step"] = None if self.stop_step is None else ratio * self.stop_step
        if changed.get("span", self.span) != self.span:  # another part of the path: the law's duration is not known
            known = {"stretch_factor": 1.0, "limit_factor": 1.0, "stop_step": None}
        changed = known | changed
        plan = replace(self, _trajectory=trajectory, **changed)
        if proof is None:
            proof = plan.motion.certify(rate=self.certificate.rate)
        met = tuple(name for name in proof.enforced if self.certificate.worst(name)[0] <= 1.0)
        status, failure = judge_certificate(proof, met if self.status is PlanStatus.LIMITS_EXCEEDED else None)
        return replace(plan, _certificate=proof, status=status, failure=failure)

    def stretched(self, factor: float, *, asked: bool = False) -> Self:
        """Return the plan with its motion stretched by a factor, certified and judged.

        Parameters
        ----------
        factor : float
            New duration over the present one [1]; of a program without its waits, which stay.
        asked : bool
            Whether the caller set the duration, so that limits did not require it (`limit_factor`).

        Returns
        -------
        Plan
            Of the same kind; itself for a factor of 1.

        Raises
        ------
        InvalidInput
            A factor below 1, or a motion that begins or ends in motion: it would no longer continue another one.
        NoSolution
            The plan failed: there is no motion.
        """
        if factor == 1.0:
            return self
        check_number(factor, "factor", "a factor of at least 1", least=1.0 - 1e-9)
        if not all(self.certificate.rest):
            raise InvalidInput("factor", f"{factor:g} for a motion that begins or ends in motion", "1")
        limit_factor = 1.0 if asked else factor * self.limit_factor
        return self.with_motion(self.trajectory.stretched(factor), limit_factor=limit_factor)

    @check_keywords
    def save(
        self, file: str | os.PathLike[str], *, format: str | os.PathLike[str] | None = None,
        rate: float | None = None, allow: Allow = (),
    ) -> RosExport | None:  # fmt: skip
        """Write the motion to a file, atomically, in the format of its suffix; `planners.load_motion` reads it.

        Parameters
        ----------
        file : str or path
            Its suffix is the name of a format, one of `planners.files.formats`, or ``.yaml`` for a message of ROS.
        format : str, optional
            Name of the format, for a file with another suffix.
        rate : float, optional
            Points per second [1/s] of a format with points, such as CSV, and of a message; by default points at the knots.
        allow : str or several
            Violations to permit, as for `planners.save`.

        Returns
        -------
        RosExport or None
            For a message, the result of `to_ros`.

        Raises
        ------
        InvalidMotion
            The motion is invalid, and ``allow`` does not permit it.
        NoSolution
            The plan failed: there is no motion. `to_dict` says why.
        InvalidInput
            A suffix that is not a format.
        UnknownName
            No format has that name.
        OutputError
            The file cannot be written.
        """
        return save(self.motion, file, format=format, rate=rate, allow=allow)


def _freedom_to_dict(chosen: FreedomResult) -> dict[str, Any]:
    """Return plain data for programs; None for numbers that are not known, and for ranges without bounds."""
    data = {each.name: getattr(chosen, each.name) for each in fields(chosen)}
    for name in ("gradient", "distance", "angle"):
        data[name] = data[name] if np.isfinite(data[name]) else None
    ranges = [
        {
            "name": one.name, "unit": one.unit, "reached": list(one.reached),
            "allowed": list(one.allowed) if np.isfinite(one.allowed).all() else None,
        }
        for one in chosen.ranges
    ]  # fmt: skip
    return data | {"ranges": ranges, "s": chosen.s.tolist(), "values": chosen.values.tolist()}
