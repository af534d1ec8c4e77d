"""The planner of a program: it follows parts, joins them into sections and reconfigures between them; its result."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from time import perf_counter
from typing import Any, Self

import numpy as np
import scipy

from optik import newton
from optik.arm.robot import Robot
from optik.check import check_kind, check_number, format_count
from optik.errors import InvalidInput, NoSolution
from optik.ik import get_solver, solve_ik
from optik.ik.problem import check_start
from optik.scene import Scene
from optik.types import Array
from planners.certificate.certification import SectionTimes, find_section_times, limits_of_parts, merge_certificates
from planners.following.branches import CollisionCheck
from planners.following.joint_path import JointPath
from planners.following.resolve.freedoms import FreeWay, Resolver, can_resolve
from planners.limits import TOOL_SPEEDS, MotionLimits
from planners.motion import PlanStatus
from planners.motion.motion import Event
from planners.paths.base import Path
from planners.paths.free_path import FreePath
from planners.paths.joint_curve import JointCurve
from planners.paths.joint_line import JointLine
from planners.paths.point_to_point import PointToPoint
from planners.paths.poses import NO_LENGTH
from planners.paths.program import SAME_PLACE, ProgramPath
from planners.paths.stretch import Stretch
from planners.planning.planner import PlanOptions
from planners.planning.result import Plan, PlanSeconds, judge_certificate
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
from planners.program.following import FailedPart, Leg, PartFollower, PlanPath
from planners.program.joining import Corner, Sharp, join_parts, round_corners, sharpen
from planners.program.parts import Dwell, Item, Move, Part, Program
from planners.trajectory import Trajectory, append_rest, join, make_rest

# ---------------- programPlan


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
        check_kind(events, "events", Iterable, expected)
        scheduled = tuple(events)
        for event in scheduled:
            check_kind(event, "events", PathEvent | PeriodicEvent | TimedEvent, expected)
        self._require_motion()
        if period is not None:
            check_number(period, "period", "a servo period above 0 [s]", above=0.0)
        plan = replace(self, scheduled=scheduled, period=period)
        for one in plan._list_events():
            if not 0.0 <= one.t <= self.duration:
                allowed = f"times in [0, {self.duration:.6g}] s"
                raise InvalidInput("events", f"{one.signal!r} at t = {one.t:.6g} s", allowed)
        return plan

    @cached_property
    def events(self) -> tuple[Event, ...]:
        """The events in their order in time; those of places that the motion does not cover are left out."""
        inside = [event for event in self._list_events() if 0.0 <= event.t <= self.duration]
        return round_to_periods(inside, self.period, self.duration)

    def _list_events(self) -> list[Event]:
        """Return the events at the places that the motion covers, in the order in which they were given."""
        assert isinstance(self.path, ProgramPath)
        first, last = (0.0, self.path.end) if self.span is None else self.span
        events = []
        for spec in self.scheduled:
            if isinstance(spec, TimedEvent):
                events.append(Event(spec.t, spec.signal, spec.value))
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
                    events.append(Event(t, spec.signal, spec.value, s, before))
        return events

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
        return tuple(find_section_times(self.path, self.trajectory, self.span))

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

    def stretched(self, factor: float, *, asked: bool = False) -> Self:
        """Return the plan with each section stretched by a factor, and the same waits; another motion is stretched whole."""
        if factor == 1.0:
            return self
        whole = sum(section.duration for section in self.sections) + sum(self.waits)
        if self.span is not None or not np.isclose(self.duration, whole, rtol=1e-12):
            return super().stretched(factor, asked=asked)
        sections = [section.stretched(factor, asked=asked) for section in self.sections]
        plan = build_plan(sections, self.waits, self.parts, self.corners, self.limits, self.scene)
        kept = {"scheduled": self.scheduled, "period": self.period, "resolution": self.resolution}
        return replace(plan, **kept)  # type: ignore[return-value, arg-type]

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
    seconds = PlanSeconds(*map(sum, zip(*(section.seconds for section in moving), strict=True)))
    rest = lead + sum(after)

    def whole_factor(name: str) -> float:
        chosen = rest + sum(float(p.duration / getattr(p, name)) for p in moving)
        return (rest + sum(p.duration for p in moving)) / chosen

    status, failure = judge_certificate(proof)
    span = None if covered is None else (proof.coverage.wanted[0], proof.coverage.wanted[1])
    first, last = moving[0], moving[-1]
    return ProgramPlan(
        first.robot, path, limits, status, first.solver, first.law, None, failure, trajectory, proof,
        whole_factor("stretch_factor"), span, first.speed, scene, seconds, first.before, first.start_error, last.stop_kind,
        limit_factor=whole_factor("limit_factor"), sections=tuple(sections), waits=tuple(waits), parts=tuple(parts),
        corners=tuple(corners),
    )  # fmt: skip


# ---------------- a path that needs reconfigurations


MOST_ADVISED = 8
"""Most reconfigurations of which a refusal speaks."""
RETREATS = (0.1, 0.05, 0.02, 0.0)
"""Distances [m] by which the tool leaves the path along its axis z before the arm moves: the longest that is possible."""
POLISHING_STEPS = 8
"""Newton steps after which the tool comes back exactly where it left."""
CHANGEABLE = tuple(
    PlanStatus[name]
    for name in ("OUTSIDE_LIMITS", "BRANCH_JUMP", "SINGULAR", "CONTACT", "NO_PATH_FOUND", "UNREACHABLE")
)
"""Failures that a reconfiguration can change."""

PlanProgram = Callable[[Program, Array], Plan]
"""`planners.plan` of a program from a start, with all other arguments given."""


def reconfigure(
    failed: Plan, path: Path, q: Array | None, held: bool, most: int, time_limit: float, plan_program: PlanProgram
) -> Plan:
    """Return the plan of a path with at most so many reconfigurations; with none, the refusal that says how many help."""
    fixed = path.asked != "pose" or (isinstance(path, FreePath) and len(path.screws) > 0 and not can_resolve(path))
    if failed.status not in CHANGEABLE or path.in_joints or fixed or failed.robot.n < 6:
        return failed
    collision = None if failed.scene is None else CollisionCheck(failed.robot, failed.scene)
    resolver = Resolver(failed.robot, path, collision, time_limit)
    sequences, resolution = resolver.find(q, held=held, many=True, cuts=max(most, MOST_ADVISED))
    if not sequences or not resolution.cuts:
        return failed
    assert failed.failure is not None
    count = len(resolution.cuts)
    if count > most:
        at = ", ".join(f"{s:.4g}" for s in resolution.cuts)
        some = f"{count} reconfiguration{'s' if count > 1 else ''}, at s = {at} {path.unit}"
        advice = f"reconfigurations={count}: a way with {some}, was found, which stops there"
        return replace(failed, failure=replace(failed.failure, advice=f"{advice}; or {failed.failure.advice}"))
    ways = resolver.relax([part for part in sequences[0] if len(part.s) > 1])
    last = failed
    for retreat in RETREATS:
        try:
            items = list_items(failed.robot, path, ways, retreat, avoid=failed.scene is not None)
        except NoSolution:
            continue
        last = plan_program(Program(items), ways[0].q[0])
        if last:
            break
    return replace(last, resolution=resolution)


def list_items(robot: Robot, path: Path, ways: list[FreeWay], retreat: float, *, avoid: bool) -> list[Item]:
    """Return the parts of a program: each stretch of the path, and the moves from one to the next.

    The tool leaves the path against its axis z, the arm moves, and the tool comes back. Raises NoSolution if the arm cannot
    be where it comes back from.
    """
    items: list[Item] = []
    for i, way in enumerate(ways):
        if i:
            begin = robot.fk(way.q[0])
            begin[:3, 3] -= retreat * begin[:3, 2]
            above = solve_ik(robot, begin, way.q[0])
            if not above:
                raise NoSolution("the tool cannot leave the path there")
            newton.polish_batch(robot.chain, above.q[None], begin[None], POLISHING_STEPS)
            moves = [Part(Move([0.0, 0.0, -retreat])), Part(above.q, avoid=avoid), Part(Move([0.0, 0.0, retreat]))]
            items += moves if retreat else [Part(way.q[0], avoid=avoid)]
        whole = path.given if isinstance(path, FreePath) else path
        part: Path = Stretch(whole, way.s[0], way.s[-1])
        if isinstance(path, FreePath):
            freed = FreePath(part, path.bounds, starts=1)
            part = freed.with_coefficients(way._replace(s=way.s - way.s[0]).fit(freed), None)
        items.append(Part(part, name=f"stretch {i + 1}"))
    return items


# ---------------- the planner of a program


EXACT = JointLine | PointToPoint | JointCurve
"""Paths that a section takes over as they are."""
NARROWER, MOST_NARROWER = 0.4, 3
"""Factor of a zone whose rounded corner is in contact or cannot be timed, and how often it is tried; then the arm stops."""


def plan_program(
    robot: Robot, program: Program, q_start: Any, plan_path: PlanPath, options: PlanOptions
) -> ProgramPlan:
    """Return the plan of a program."""
    q = None if q_start is None else check_start(robot, q_start, "q_start")
    for name in TOOL_SPEEDS:
        if np.ndim(options.limits.value(name)):
            expected = f"one number: a part has its own (Part.{name})"
            raise InvalidInput(f"limits.{name}", "more than one number", expected)
    started, planner = perf_counter(), ProgramPlanner(robot, program, plan_path, options)
    legs, failed = planner.follow_all(q)
    found = planner.fail(failed, legs) if failed is not None else planner.plan_sections(legs)
    if found and options.duration is not None:
        found = stretch_sections(found, options.duration)
    _, timing, proof = found.seconds
    return replace(found, seconds=PlanSeconds(perf_counter() - started - timing - proof, timing, proof))


class ProgramPlanner(PartFollower):
    """Follows the parts of a program, joins them into sections, and plans these."""

    def fail(self, failed: FailedPart, legs: Sequence[Leg], sections: Sequence[Plan] = ()) -> ProgramPlan:
        """Return the plan without a motion."""
        why = failed.failure
        solver, law = self._names(sections)
        names = [part.name for part in self.program.parts]
        robot = self.robots[why.part or 0]
        _, scene = self.find_conditions(robot)
        parts = tuple(PartRecord(names[leg.part], leg.path, -1, 0.0, 0.0, leg.joint_path) for leg in legs)
        return ProgramPlan(
            robot, failed.path, self.options.limits, PlanStatus(why.status), solver, law, failed.prefix, why,
            None, None, scene=scene, sections=tuple(sections), parts=parts, size=len(names),
        )  # fmt: skip

    def _names(self, sections: Sequence[Plan]) -> tuple[str, str]:
        if sections:
            return sections[0].solver, sections[0].law
        solver = self.options.solver
        return (solver if isinstance(solver, str) else get_solver(self.robot, solver).name), ""

    # ------------------------------------------------------------ sections

    def plan_sections(self, legs: Sequence[Leg]) -> ProgramPlan:
        """Return the plan of all sections, or the failure of the first one that has none."""
        sections: list[Plan] = []
        parts: list[PartRecord] = []
        corners: list[Corner] = []
        limits, at = self._whole_limits(legs), 0.0
        for group in self._split(legs):
            for planned in self._plan_group(group):
                if isinstance(planned, FailedPart):
                    return self.fail(planned, legs, sections)
                plan, places, rounded, chosen = planned
                for leg, a, b in zip(chosen, places[:-1], places[1:], strict=True):
                    name = self.program.parts[leg.part].name
                    alone = len(chosen) == 1  # a plan chooses the shape of a part alone
                    joints = None if alone or isinstance(leg.path, EXACT) else leg.joint_path
                    path = plan.path if alone else leg.path
                    parts.append(PartRecord(name, path, len(sections), at + a, at + b, joints))
                corners += [replace(c, part=chosen[c.part].part, begin=c.begin + at, end=c.end + at) for c in rounded]
                sections.append(plan)
                at += plan.path.end
        for leg in legs:
            if not leg.path.end > NO_LENGTH:
                section, at = (parts[leg.part - 1].section, parts[leg.part - 1].end) if leg.part else (-1, 0.0)
                parts.insert(leg.part, PartRecord(self.program.parts[leg.part].name, leg.path, section, at, at))
        return build_plan(sections, self._waits(parts), parts, corners, limits, self.options.scene)

    def _split(self, legs: Sequence[Leg]) -> Iterator[list[Leg]]:
        """Yield the parts with a motion between two programmed stops."""
        group: list[Leg] = []
        for leg in legs:
            group += [leg] if leg.path.end > NO_LENGTH else []
            if group and self.program.parts[leg.part].blend == 0.0:
                yield group
                group = []

    def _plan_group(self, legs: list[Leg]) -> Iterator[tuple[Plan, Array, list[Corner], list[Leg]] | FailedPart]:
        """Return the sections of parts with zones between: one, or more where a corner has to be a stop."""
        parts = self.program.parts
        zones = [np.min([part.zone for part in parts[a.part : b.part]], axis=0) for a, b in itertools.pairwise(legs)]
        robot, tolerance, n = legs[0].robot, self.options.tolerance, len(legs)
        tries, reasons = np.zeros(max(n - 1, 0), int), [""] * (n - 1)
        sharp: list[Sharp] = []
        for leg in legs if n > 1 else ():
            sharp.append(sharpen(robot, leg.path, leg.joint_path, sharp[-1] if sharp else None))
        while True:
            scaled = [zone * NARROWER**k for zone, k in zip(zones, tries, strict=True)]
            rounded = round_corners(robot, sharp, scaled, tolerance) if n > 1 else []
            stops = [i for i, (zone, _) in enumerate(rounded) if zone is None or tries[i] > MOST_NARROWER]
            out: list[tuple[Plan, Array, list[Corner], list[Leg]]] = []
            ends, again = [-1, *stops, n - 1], -1
            for a, b in itertools.pairwise(ends):
                members = range(a + 1, b + 1)
                inside = [(rounded[i][0], reasons[i] or rounded[i][1]) for i in members[:-1]]
                chosen, edges = [legs[i] for i in members], [sharp[i] for i in members] if n > 1 else []
                plan, places, corners = self._plan_section(chosen, edges, inside)
                for i, corner in zip(members, corners, strict=False):
                    corners[i - a - 1] = replace(corner, zone=tuple(zones[i].tolist()))
                if not plan:
                    assert plan.failure is not None
                    nearest = np.abs(places[1:-1] - plan.failure.s)
                    again = a + 1 + int(nearest.argmin()) if len(members) > 1 else -1
                    if again < 0:
                        yield self.explain(legs[members[0]].part, plan.path, plan.failure, plan.prefix)
                        return
                    ended = "in contact" if plan.status is PlanStatus.CONTACT else str(plan.status).replace("_", " ")
                    reasons[again] = f"the motion with a wider corner is {ended}"
                    break
                if b < n - 1:
                    why = reasons[b] or rounded[b][1]
                    corners.append(Corner(b - a - 1, tuple(zones[b].tolist()), (0.0, 0.0), places[-1], places[-1], why))
                out.append((plan, places, corners, chosen))
            if again < 0:
                yield from out
                return
            tries[again] += 1

    def _plan_section(
        self, legs: list[Leg], sharp: list[Sharp], zones: list[tuple[Any, str]]
    ) -> tuple[Plan, Array, list[Corner]]:
        """Return the plan of a section, the places of its parts, and its corners."""
        first = legs[0]
        if len(legs) == 1:
            plan = first.plan
            if plan is None:
                limits, whole = self.find_limits(self.program.parts[first.part]), self.options.tolerance
                plan = self.plan_alone(first.robot, first.path, first.ends[0], limits, tolerance=whole)
            return plan, np.array([0.0, first.path.end]), []
        path, places = join_parts(first.robot, sharp, [zone for zone, _ in zones])
        corners = [
            Corner(i, (0.0, 0.0), tuple(z.deviation.tolist()), places[i + 1] - z.half, places[i + 1] + z.half, why)
            for i, (z, why) in enumerate(zones)
        ]
        limits = limits_of_parts(self._whole_limits(legs), 0, len(legs))
        half = self.options.tolerance.scale(0.5)
        return self.plan_alone(first.robot, path, None, limits, tolerance=half), places, corners

    def _waits(self, parts: Sequence[PartRecord]) -> list[float]:
        """Return the waits [s] before the first section and after each."""
        waits, section, done = [0.0] * (parts[-1].section + 2), -1, 0
        for item in self.program.items:
            if isinstance(item, Part):
                section, done = parts[done].section, done + 1
            elif isinstance(item, Dwell):
                waits[section + 1] += item.seconds
        return waits

    def _whole_limits(self, legs: Sequence[Leg]) -> MotionLimits:
        """Return the limits of the parts with a motion; if a part has its own tool speed, one tool speed for each part."""
        own: dict[str, Any] = {}
        parts = [self.program.parts[leg.part] for leg in legs if leg.path.end > NO_LENGTH]
        for name in TOOL_SPEEDS:
            if any(getattr(part, name) is not None for part in self.program.parts):
                each = [self.find_speed(part, name) for part in parts]
                own[name] = np.array([np.inf if x is None else x for x in each])
        return replace(self.options.limits, **own) if own else self.options.limits


def stretch_sections(found: ProgramPlan, duration: float) -> ProgramPlan:
    """Return the plan with all sections, but no wait, slowed by one factor, so that the whole has a duration [s]."""
    waits = sum(found.waits)
    factor = (duration - waits) / (found.duration - waits)
    if not factor >= 1.0 - 1e-12:
        least = f"{found.duration:.6g} s, of which {waits:.6g} s are waits"
        raise InvalidInput("duration", f"{duration:g} s", f"at least {least}")
    if any(section.speed is not None for section in found.sections):
        got = f"{duration:g} s, with a constant tool speed"
        raise InvalidInput("duration", got, "none: the speed determines it")
    return found.stretched(factor, asked=True)
