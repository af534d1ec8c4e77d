"""ProgramPlan: the motion of a program with its sections, parts and corners."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, reduce
from typing import Any

import numpy as np
import scipy

from optik.check import check_number, format_count
from optik.errors import InvalidInput
from optik.scene import Scene
from planners.certificate.sections import SectionTimes, find_stops, merge_certificates
from planners.following.joint_path import JointPath
from planners.limits import MotionLimits
from planners.motion.event import Event
from planners.paths.base import Path
from planners.paths.program import SAME_PLACE, ProgramPath
from planners.planning.request import judge_certificate
from planners.planning.result import Plan, PlanSeconds
from planners.program.events import (
    PathEvent,
    PeriodicEvent,
    Scheduled,
    TimedEvent,
    find_part,
    find_time,
    list_places,
    round_to_periods,
)
from planners.program.joining import Corner
from planners.trajectory import Trajectory, append_rest, join, make_rest


@dataclass(frozen=True)
class PartRecord:
    """A part in the motion of a program.

    Attributes
    ----------
    name : str or None
        Its name.
    path : Path
        Its path before corners are rounded.
    section : int
        Index of its section, from 0; −1 for a part without a motion before the first section.
    begin, end : float
        Path parameter of the whole program at its start and end; equal for a part without a motion.
    """

    name: str | None
    path: Path
    section: int
    begin: float
    end: float
    joint_path: JointPath | None = field(default=None, repr=False, compare=False)

    @property
    def deviation(self) -> tuple[float, float]:
        """Proved bounds on distance [m] and angle [rad] between its path and its joint path, outside of the corners."""
        return (0.0, 0.0) if self.joint_path is None else self.joint_path.bound

    def s_at(self, x: float) -> float:
        """Return the path parameter of the program at one of the part's own path.

        Parameters
        ----------
        x : float
            In [0, path.end] [m, or rad].

        Returns
        -------
        float
            In [begin, end].
        """
        return self.begin + (self.end - self.begin) * x / (self.path.end or 1.0)


@dataclass(frozen=True, repr=False)
class ProgramPlan(Plan):
    """The result of `plan` for a `Program`: a `Plan` of the whole motion, whose `Plan.path` is a `ProgramPath`.

    ``bool(plan)`` is success: every section has a motion with a valid certificate. On failure `Plan.failure` names the part,
    and s is the position along its own path.

    Attributes
    ----------
    sections : tuple of Plan
        The plans between two stops, in their order; on failure those before it. After `replan` not all move.
    waits : tuple of float
        The wait before the first section, and after each [s].
    parts : tuple of PartRecord
        The parts, in their order; on failure those that were followed.
    corners : tuple of Corner
        The corners between two parts without a wait or a change of the tool between them, stops included.
    scheduled : tuple of PathEvent, PeriodicEvent and TimedEvent
        What `schedule` was given.
    period : float or None
        The servo period of `schedule` [s].
    size : int
        On failure, the number of all parts of the program.
    """

    sections: tuple[Plan, ...] = ()
    waits: tuple[float, ...] = ()
    parts: tuple[PartRecord, ...] = ()
    corners: tuple[Corner, ...] = ()
    scheduled: tuple[Scheduled, ...] = ()
    period: float | None = None
    size: int = 0

    def schedule(self, events: Iterable[Scheduled], *, period: float | None = None) -> ProgramPlan:
        """Return the plan with events, whose times are in `events`. They are computed from this plan's motion.

        A place inside a rounded corner moves with it: the ends of the corner keep their place, and the end of the part before
        is the point of the corner nearest to the programmed one. `replan` keeps the events whose place is still ahead.

        Parameters
        ----------
        events : sequence of PathEvent, PeriodicEvent and TimedEvent
            The events; they replace those that the plan has.
        period : float, optional
            Servo period [s]: times are rounded to whole periods, and `Event.shift` states by how much.

        Returns
        -------
        ProgramPlan
            The same motion with events.

        Raises
        ------
        InvalidInput
            An unknown part, a place outside it, a distance along a part in joint space, or a time outside the motion.
        NoSolution
            The plan failed: there is no motion.
        """
        expected = "a list of PathEvent, PeriodicEvent and TimedEvent"
        if not isinstance(events, Iterable):
            raise InvalidInput("events", repr(events)[:120], expected)
        given = tuple(events)
        for event in given:
            if not isinstance(event, PathEvent | PeriodicEvent | TimedEvent):
                raise InvalidInput("events", repr(event)[:60], expected)
        self._require_motion()
        if period is not None:
            check_number(period, "period", "a servo period above 0 [s]", above=0.0)
        found = replace(self, scheduled=given, period=period)
        for one in found._list_events():
            if not 0.0 <= one.t <= self.duration:
                allowed = f"times in [0, {self.duration:.6g}] s"
                raise InvalidInput("events", f"{one.signal!r} at t = {one.t:.6g} s", allowed)
        return found

    @cached_property
    def events(self) -> tuple[Event, ...]:
        """The events in their order in time; those of places that the motion does not cover are left out."""
        inside = [event for event in self._list_events() if 0.0 <= event.t <= self.duration]
        return round_to_periods(inside, self.period, self.duration)

    def _list_events(self) -> list[Event]:
        """Return the events at the places that the motion covers, in the order in which they were given."""
        assert isinstance(self.path, ProgramPath)
        first, last = (0.0, self.path.end) if self.span is None else self.span
        found = []
        for spec in self.scheduled:
            if isinstance(spec, TimedEvent):
                found.append(Event(spec.t, spec.signal, spec.value))
                continue
            section = max(self.parts[find_part(self.parts, spec.part)].section, 0)
            places = list_places(self.parts, self.corners, self.path, spec)
            if section not in self.moving_sections:
                continue
            joints, start = self.sections[section].joint_path, float(self.path.starts[section])
            when = self.times[self.moving_sections.index(section)]
            before = getattr(spec, "before", 0.0) - getattr(spec, "after", 0.0)
            for s in places:
                if first <= s + SAME_PLACE * self.path.end and s <= last + SAME_PLACE * self.path.end:
                    t = find_time(self, joints, start, s, when) - before
                    found.append(Event(t, spec.signal, spec.value, s, before))
        return found

    @property
    def _title(self) -> str:
        words = f"{self.robot.name}, program of {format_count(self.size or len(self.parts), 'part')}"
        if not self.has_motion:
            return f"{words}, {self.solver}"
        stops = "without a stop" if len(self.sections) == 1 else f"in {len(self.sections)} sections"
        return f"{words} {stops}{self.describe_idle()}, {self.solver} + {self.law}"

    def describe_idle(self) -> str:
        """Return a text that lists the parts without a motion, counted from 1; empty if there are none.

        Returns
        -------
        str
            Such as ", nothing to do in parts 1, 4".
        """
        idle = [str(i + 1) for i, part in enumerate(self.parts) if part.begin == part.end]
        return f", nothing to do in {'parts' if len(idle) > 1 else 'part'} {', '.join(idle)}" if idle else ""

    @property
    def moving_sections(self) -> range:
        """The sections that the motion covers: all, unless it is that of `replan`."""
        assert isinstance(self.path, ProgramPath)
        return self.path.find_sections((0.0, self.path.end) if self.span is None else self.span)

    @cached_property
    def times(self) -> tuple[SectionTimes, ...]:
        """When each section of `moving_sections` begins, when its motion ends, and when the wait after it ends [s]."""
        assert isinstance(self.path, ProgramPath)
        return tuple(find_stops(self.path, self.trajectory, self.span))

    @cached_property
    def joint_path(self) -> JointPath:
        """The joint paths of all sections one after another; raises `NoSolution` if there is no motion."""
        self._require_motion()
        assert isinstance(self.path, ProgramPath)
        each = [section.joint_path for section in self.sections]
        nodes = [a + own.nodes[1:] for a, own in zip(self.path.starts[:-1], each, strict=True)]
        knots = np.concatenate([[0.0], *nodes])
        joined = object.__new__(JointPath)
        joined.robot, joined.path, joined.knots, joined.nodes = self.robot, self.path, knots, knots
        c = np.concatenate([own.coefficients for own in each], axis=1)
        joined._set_polynomial(scipy.interpolate.PPoly(c, knots))
        return joined

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for files and programs: those of a plan, with the parts and the corners."""
        out = super().to_dict()
        if self.failure is not None:
            out["part"] = self.failure.part
        keys = "name", "section", "begin", "end", "deviation"
        parts = [{key: getattr(part, key) for key in keys} | {"path": part.path.to_dict()} for part in self.parts]
        return out | {"waits": list(self.waits), "parts": parts, "corners": [asdict(corner) for corner in self.corners]}


def join_sections(sections: Sequence[Plan], waits: Sequence[float]) -> tuple[Trajectory, list[float]]:
    """Return the motion through sections, with a wait [s] before the first one and after each, and when each begins."""
    start = np.asarray(sections[0].trajectory(0.0))
    motion: Trajectory | None = make_rest(start, waits[0]) if waits[0] > 0.0 else None
    begins = []
    for section, wait in zip(sections, waits[1:], strict=True):
        begins.append(0.0 if motion is None else motion.duration)
        own = section.trajectory.without_s  # they begin at the section's start
        motion = own if motion is None else join(motion, own)
        motion = append_rest(motion, wait) if wait > 0.0 else motion
    assert motion is not None
    return motion, begins


def build_plan(
    sections: Sequence[Plan], waits: Sequence[float], parts: Sequence[PartRecord], corners: Sequence[Corner],
    limits: MotionLimits, scene: Scene | None, covered: tuple[range, float] | None = None,
) -> ProgramPlan:  # fmt: skip
    """Return the plan of a program from the valid plans of its sections; `covered` are those that move, and the wait before."""
    which, lead = (range(len(sections)), waits[0]) if covered is None else covered
    path = ProgramPath([section.path for section in sections], [section.robot for section in sections])
    moving = [sections[i] for i in which]
    ended = moving[-1].span is None or moving[-1].span[1] >= moving[-1].path.end
    after = [waits[i + 1] if i < which[-1] or ended else 0.0 for i in which]
    trajectory, begins = join_sections(moving, [lead, *after])
    proof = merge_certificates(path, which, trajectory, [p.certificate for p in moving], begins, limits)
    seconds = reduce(_add_seconds, [section.seconds for section in moving])
    status, failure = judge_certificate(proof)
    span = None if covered is None else (proof.coverage.wanted[0], proof.coverage.wanted[1])
    first, last = moving[0], moving[-1]
    return ProgramPlan(
        first.robot, path, limits, status, first.solver, first.law, None, failure, trajectory, proof,
        max(section.slowed for section in moving), span, first.speed, scene, seconds, first.before, first.start_error,
        last.stop_kind, sections=tuple(sections), waits=tuple(waits), parts=tuple(parts), corners=tuple(corners),
    )  # fmt: skip


def _add_seconds(a: PlanSeconds, b: PlanSeconds) -> PlanSeconds:
    return PlanSeconds(*(x + y for x, y in zip(a, b, strict=True)))
