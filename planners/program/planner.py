"""The planner of a program: it follows the parts, chooses configurations, joins parts into sections, and plans these."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np

from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.ik import get_solver
from optik.ik.problem import check_start
from optik.types import Array
from planners.certificate.sections import limits_of_parts
from planners.following.failure import PlanFailure
from planners.limits import TOOL_SPEEDS, MotionLimits
from planners.motion import PlanStatus
from planners.paths.joint_curve import JointCurve
from planners.paths.joint_line import JointLine
from planners.paths.point_to_point import PointToPoint
from planners.paths.poses import NO_LENGTH
from planners.planning.result import Plan, PlanSeconds
from planners.program.following import FailedPart, Leg, Options, PartFollower, PlanAlone
from planners.program.joining import Corner, Sharp, join_parts, round_corners, sharpen
from planners.program.parts import Dwell, Part, Program
from planners.program.result import PartRecord, ProgramPlan, build_plan

EXACT = JointLine | PointToPoint | JointCurve
"""Paths that a section takes over as they are."""
NARROWER, MOST_NARROWER = 0.4, 3
"""Factor of a zone whose rounded corner is in contact or cannot be timed, and how often it is tried; then the arm stops."""


def plan_program(
    robot: Robot, program: Program, q_start: Any, alone: PlanAlone, options: Options, duration: float | None
) -> ProgramPlan:
    """Return the plan of a program."""
    q = None if q_start is None else check_start(robot, q_start, "q_start")
    for name in TOOL_SPEEDS:
        if np.ndim(options.limits.value(name)):
            expected = f"one number: a part has its own (Part.{name})"
            raise InvalidInput(f"limits.{name}", "more than one number", expected)
    started, planner = perf_counter(), ProgramPlanner(PartFollower(robot, program, alone, options))
    legs, failed = planner.follower.follow_all(q)
    found = planner.fail(failed, legs) if failed is not None else planner.plan_sections(legs)
    if found and duration is not None:
        found = slow_sections(found, duration)
    _, timing, proof = found.seconds
    return replace(found, seconds=PlanSeconds(perf_counter() - started - timing - proof, timing, proof))


@dataclass(frozen=True)
class ProgramPlanner:
    """Joins followed parts into sections, and plans these with `planners.plan`."""

    follower: PartFollower

    @property
    def program(self) -> Program:
        """The program."""
        return self.follower.program

    @property
    def options(self) -> Options:
        """What the program is planned with."""
        return self.follower.options

    def fail(self, failed: FailedPart, legs: Sequence[Leg], sections: Sequence[Plan] = ()) -> ProgramPlan:
        """Return the plan without a motion."""
        why = failed.failure
        solver, law = self._names(sections)
        names = [part.name for part in self.program.parts]
        robot = self.follower.robots[why.part or 0]
        _, scene = self.follower.find_conditions(robot)
        parts = tuple(PartRecord(names[leg.part], leg.path, -1, 0.0, 0.0, leg.joint_path) for leg in legs)
        return ProgramPlan(
            robot, failed.path, self.options.limits, PlanStatus(why.status), solver, law, failed.prefix, why,
            None, None, scene=scene, sections=tuple(sections), parts=parts, size=len(names),
        )  # fmt: skip

    def _names(self, sections: Sequence[Plan]) -> tuple[str, str]:
        if sections:
            return sections[0].solver, sections[0].law
        solver = self.options.solver
        return (solver if isinstance(solver, str) else get_solver(self.follower.robot, solver).name), ""

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
                plan, places, own, chosen = planned
                for leg, a, b in zip(chosen, places[:-1], places[1:], strict=True):
                    name = self.program.parts[leg.part].name
                    alone = len(chosen) == 1  # a plan chooses the shape of a part alone
                    joints = None if alone or isinstance(leg.path, EXACT) else leg.joint_path
                    path = plan.path if alone else leg.path
                    parts.append(PartRecord(name, path, len(sections), at + a, at + b, joints))
                corners += [replace(c, part=chosen[c.part].part, begin=c.begin + at, end=c.end + at) for c in own]
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
            made = round_corners(robot, sharp, scaled, tolerance) if n > 1 else []
            stops = [i for i, (zone, _) in enumerate(made) if zone is None or tries[i] > MOST_NARROWER]
            out: list[tuple[Plan, Array, list[Corner], list[Leg]]] = []
            ends, again = [-1, *stops, n - 1], -1
            for a, b in itertools.pairwise(ends):
                own = range(a + 1, b + 1)
                inside = [(made[i][0], reasons[i] or made[i][1]) for i in own[:-1]]
                chosen, edges = [legs[i] for i in own], [sharp[i] for i in own] if n > 1 else []
                plan, places, corners = self._plan_section(chosen, edges, inside)
                for i, corner in zip(own, corners, strict=False):
                    corners[i - a - 1] = replace(corner, zone=tuple(zones[i].tolist()))
                if not plan:
                    assert plan.failure is not None
                    again = a + 1 + self._nearest_corner(plan.failure, places) if len(own) > 1 else -1
                    if again < 0:
                        yield self.follower.explain(legs[own[0]].part, plan.path, plan.failure, plan.prefix)
                        return
                    ended = "in contact" if plan.status is PlanStatus.CONTACT else str(plan.status).replace("_", " ")
                    reasons[again] = f"the motion with a wider corner is {ended}"
                    break
                if b < n - 1:
                    why = reasons[b] or made[b][1]
                    corners.append(Corner(b - a - 1, tuple(zones[b].tolist()), (0.0, 0.0), places[-1], places[-1], why))
                out.append((plan, places, corners, chosen))
            if again < 0:
                yield from out
                return
            tries[again] += 1

    @staticmethod
    def _nearest_corner(failure: PlanFailure, places: Array) -> int:
        """Return the corner of a section that is nearest to the place of its failure."""
        return int(np.abs(places[1:-1] - failure.s).argmin())

    def _plan_section(
        self, legs: list[Leg], sharp: list[Sharp], zones: list[tuple[Any, str]]
    ) -> tuple[Plan, Array, list[Corner]]:
        """Return the plan of a section, the places of its parts, and its corners."""
        first = legs[0]
        if len(legs) == 1:
            plan = first.plan
            if plan is None:
                limits, whole = self.follower.find_limits(self.program.parts[first.part]), self.options.tolerance
                plan = self.follower.plan_alone(first.robot, first.path, first.ends[0], limits, tolerance=whole)
            return plan, np.array([0.0, first.path.end]), []
        path, places = join_parts(first.robot, sharp, [zone for zone, _ in zones])
        corners = [
            Corner(i, (0.0, 0.0), tuple(z.deviation.tolist()), places[i + 1] - z.half, places[i + 1] + z.half, why)
            for i, (z, why) in enumerate(zones)
        ]
        limits = limits_of_parts(self._whole_limits(legs), 0, len(legs))
        half = self.options.tolerance.scale(0.5)
        return self.follower.plan_alone(first.robot, path, None, limits, tolerance=half), places, corners

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
                each = [self.follower.find_speed(part, name) for part in parts]
                own[name] = np.array([np.inf if x is None else x for x in each])
        return replace(self.options.limits, **own) if own else self.options.limits


def slow_sections(found: ProgramPlan, duration: float) -> ProgramPlan:
    """Return the plan with all sections, but no wait, slowed by one factor, so that the whole has a duration [s]."""
    waits = sum(found.waits)
    factor = (duration - waits) / (found.duration - waits)
    if not factor >= 1.0 - 1e-12:
        least = f"{found.duration:.6g} s, of which {waits:.6g} s are waits"
        raise InvalidInput("duration", f"{duration:g} s", f"at least {least}")
    sections = []
    for section in found.sections:
        if section.speed is not None:
            got = f"{duration:g} s, with a constant tool speed"
            raise InvalidInput("duration", got, "none: the speed determines it")
        slower = replace(section.motion, trajectory=section.trajectory.slowed(factor))
        proof = slower.certify(rate=section.certificate.rate)
        sections.append(replace(section, _trajectory=slower.trajectory, _certificate=proof))
    return build_plan(sections, found.waits, found.parts, found.corners, found.limits, found.scene)
