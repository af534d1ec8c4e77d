"""The certificate of a motion in sections: each section is certified for itself, and they join at rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce
from typing import Any, NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.scene import Scene
from optik.scene.contact import scene_for
from optik.types import Array, Flags
from planners.certificate.analysis import MotionAnalysis
from planners.certificate.certificate import Certificate, LimitedPart
from planners.certificate.checks import (
    Coverage,
    continuous_order,
    largest_jump,
    position_margins,
    position_times,
)
from planners.certificate.clearance import Clearance
from planners.certificate.effort import Energy
from planners.certificate.path_error import PathError
from planners.limits import ALL_LIMITS, TOOL_SPEEDS, Extreme, MotionLimits, ToolExtreme, kind_of
from planners.paths.program import ProgramPath
from planners.trajectory import Trajectory, cut_after, cut_before

STILL = 1e-9
"""Largest velocity at a stop [rad/s, m/s]: rounding."""
UNMOVED = 1e-12
"""Largest distance [rad, m] that a joint goes in a piece of a motion that is a wait."""
AT_STOP = 1e-6
"""Largest distance of a stop from its configuration, of the tool from its pose [m, rad]."""


def limits_of_parts(limits: MotionLimits, a: int, b: int) -> MotionLimits:
    """Return the limits of the parts from a to b − 1, of limits with one bound on the tool's speeds for each part."""
    own: dict[str, Any] = {}
    for name in TOOL_SPEEDS:
        if np.ndim(value := limits.value(name)):
            own[name] = value[a:b] if np.isfinite(value[a:b]).any() else None
    return replace(limits, **own) if own else limits


Conditions = tuple[MotionLimits, Scene | None]
"""Limits and scene of a motion."""


def conditions_for(robot: Robot, arms: Sequence[Robot], limits: MotionLimits, scene: Scene | None) -> Conditions:
    """Return limits and scene for one arm of a program, without limits on a payload if only other arms carry one."""
    kept = tuple(name for name in limits.names if not kind_of(name).on_goods)
    if kept != limits.names and robot.payload is None and any(arm.payload is not None for arm in arms):
        limits = limits.select(kept)
    return limits, scene_for(robot, scene, arms)


def conditions_of(path: ProgramPath, i: int, limits: MotionLimits, scene: Scene | None) -> Conditions:
    """Return limits and scene of a section, from those of the whole program."""
    own = limits_of_parts(limits, path.firsts[i], path.firsts[i + 1])
    return conditions_for(path.robots[i], path.robots, own, scene)


class SectionTimes(NamedTuple):
    """When a section of a motion begins, when its motion ends, and when the wait after it ends [s]."""

    begin: float
    rest: float
    end: float


def find_stops(path: ProgramPath, trajectory: Trajectory, span: tuple[float, float] | None) -> list[SectionTimes]:
    """Return the times of the sections that a motion covers."""
    which = path.find_sections((0.0, path.end) if span is None else span)
    knots, rests = trajectory.knots, _find_rests(trajectory)
    still = np.flatnonzero(np.abs(trajectory(knots, 1)).max(axis=1) <= STILL)
    times, last = list[SectionTimes](), _skip_rests(rests, 0) if not rests.all() else 0
    begin = float(knots[last])
    for i in which[:-1]:
        robot, section = path.robots[i], path.sections[i]
        at = still[still > last]
        off = robot.pose_errors(trajectory(knots[at]), section.pose(section.end)) if at.size else np.empty((0, 6))
        near = np.abs(off).max(axis=1) <= AT_STOP
        if not near.any():
            missing = f"no rest at s = {path.starts[i + 1]:.6g}"
            raise InvalidInput("trajectory", missing, f"a motion that stops after each of {len(which)} sections")
        first = int(at[np.argmax(near)])
        last = _skip_rests(rests, first)
        times.append(SectionTimes(begin, float(knots[first]), float(knots[last])))
        begin = times[-1].end
    moving = np.flatnonzero(~rests[last:])
    rest = knots[last + moving[-1] + 1] if moving.size else trajectory.end  # a hold
    return [*times, SectionTimes(begin, float(rest), trajectory.end)]


def _find_rests(trajectory: Trajectory) -> Flags:
    """Return which pieces (m,) of a motion stay where they are."""
    powers = np.arange(len(trajectory.coefficients) - 1, 0, -1)[:, None, None]
    moved = np.abs(trajectory.coefficients[:-1]) * np.diff(trajectory.knots)[:, None] ** powers
    return np.asarray(moved.max(axis=(0, 2), initial=0.0) <= UNMOVED)


def _skip_rests(rests: Flags, k: int) -> int:
    """Return the knot at which a motion goes on that rests from knot k on, or k."""
    while k < rests.size and rests[k]:
        k += 1
    return k


def cut_between(trajectory: Trajectory, begin: float, end: float) -> Trajectory:
    """Return the part of a motion between two times, without path parameters: they count from another start."""
    part = trajectory.without_s if end == trajectory.end else cut_after(trajectory, end)
    return cut_before(part, begin) if begin > 0.0 else part


def merge_certificates(
    path: ProgramPath, which: range, trajectory: Trajectory, proofs: Sequence[Certificate], begins: Sequence[float],
    limits: MotionLimits,
) -> Certificate:  # fmt: skip
    """Return the certificate of a motion from those of its sections `which`; `limits` are those of the whole motion."""
    robot, starts = path.robots[0], path.starts[which]
    first, motion = proofs[0], MotionAnalysis(robot, trajectory)
    tolerances = [proof.tolerance for proof in proofs if proof.tolerance is not None]
    tolerance = max(tolerances, key=lambda each: each.position, default=None)
    enforced = dict.fromkeys(name for proof in proofs for name in proof.enforced)
    shift = list(zip(proofs, begins, starts, strict=True))

    extra = tuple(limits.extra or ())
    missing = {name: tuple(i for i, p in zip(which, proofs, strict=True) if name not in p.extra) for name in extra}

    def worst(name: str) -> Any:
        known: list[Any] = [(p.extreme(name), t) for p, t, _ in shift if name in ALL_LIMITS or name in p.extra]
        each = [x._replace(time=x.time + t) for x, t in known] or [ToolExtreme(np.nan, np.nan, 0.0)]
        found = reduce(select_worse, each)
        value = np.max([x.value for x in each], axis=0)  # which may be in a section with a higher limit
        return found._replace(value=value if isinstance(found, Extreme) else float(value))

    steps = [step._replace(t=step.t + t) for p, t, _ in shift for step in p.friction_steps]
    parts = [LimitedPart(part.motion, t + part.begin, part.limits) for p, t, _ in shift for part in p.parts]
    margins = position_margins(robot, trajectory)
    return replace(
        first, enforced=tuple(enforced), duration=trajectory.duration, tolerance=tolerance,
        position_margin=margins, t_position_margin=position_times(robot, trajectory),
        path_error=_merge_errors([p.path_error for p in proofs], begins),
        t=trajectory.knots, s=_merge_places(trajectory, shift),
        coverage=_merge_coverage([p.coverage for p in proofs], begins, starts),
        continuous=min(continuous_order(motion.jumps), *(p.continuous for p in proofs)),
        jump=largest_jump(trajectory, motion.jumps), rest=motion.rest,
        clearance=_merge_clearances([p.clearance for p in proofs], begins),
        **{name: worst(name) for name in ALL_LIMITS},
        extra={name: worst(name) for name in extra}, exempt={name: each for name, each in missing.items() if each},
        motion=motion.bare(), parts=tuple(parts), energy=_merge_energy([p.energy for p in proofs], begins),
        friction_steps=tuple(steps),
    )  # fmt: skip


def _merge_places(trajectory: Trajectory, shift: Sequence[tuple[Certificate, float, float]]) -> Array:
    """Return the path parameters at the knots of the whole motion: during a wait, that of the stop."""
    t = np.concatenate([begin + proof.t for proof, begin, _ in shift])
    s = np.concatenate([start + proof.s for proof, _, start in shift])
    return np.asarray(np.interp(trajectory.knots, t, s))


def select_worse(first: Any, second: Any) -> Extreme | ToolExtreme:
    """Return for each joint the peak with the larger ratio, or with the larger value if neither is limited."""
    free = np.isnan(first.ratio) & np.isnan(second.ratio)
    a, b = (np.where(free, x.value, np.nan_to_num(x.ratio, nan=-1.0, posinf=np.inf)) for x in (first, second))
    chosen = [np.where(a >= b, x, y) for x, y in zip(first, second, strict=True)]
    return Extreme(*chosen) if isinstance(first, Extreme) else ToolExtreme(*(float(x) for x in chosen))


def _merge_errors(errors: Sequence[PathError], begins: Sequence[float]) -> PathError:
    """Return the largest path error, with its time in the whole motion."""
    i, j = (int(np.argmax([getattr(e, name) for e in errors])) for name in ("distance", "angle"))
    a, b = errors[i], errors[j]
    found, turned = max(e.found_distance for e in errors), max(e.found_angle for e in errors)
    return PathError(a.distance, b.angle, found, turned, begins[i] + a.t_distance, begins[j] + b.t_angle)


def _merge_coverage(parts: Sequence[Coverage], begins: Sequence[float], starts: Array) -> Coverage:
    """Return the covered part of the whole path: what a section lacks at its ends, and its longest backward stretch."""
    late, early, back = ([part.missing[k] for part in parts] for k in range(3))
    i = int(np.argmax([max(length) for length in back]))
    first, last = parts[0], parts[-1]
    return Coverage(
        float(starts[0]) + first.begin, float(starts[-1]) + last.end,
        (float(starts[0]) + first.wanted[0], float(starts[-1]) + last.wanted[1]), float(starts[i]) + parts[i].back,
        begins[i] + parts[i].t_back, (max(late, key=max), max(early, key=max), back[i]),
    )  # fmt: skip


def _merge_clearances(each: Sequence[Clearance | None], begins: Sequence[float]) -> Clearance | None:
    """Return the least distances of all sections; None without a scene."""
    known = [c for c in each if c is not None]
    if len(known) < len(each):
        return None

    def least(name: str) -> Any:
        kinds = [(getattr(c, name), t) for c, t in zip(known, begins, strict=True) if getattr(c, name) is not None]
        if not kinds:
            return None
        nearest, t = min(kinds, key=lambda kind: kind[0].room)
        proved = min(kind.value - kind.margin for kind, _ in kinds) + nearest.margin
        return nearest._replace(time=nearest.time + t, value=min(nearest.value, proved))

    return Clearance(least("scene"), least("own"), tuple(dict.fromkeys(pair for c in known for pair in c.left_out)))


def _merge_energy(each: Sequence[Energy | None], begins: Sequence[float]) -> Energy | None:
    """Return the energy of all sections, and their largest power; None where it is not known."""
    known = [e for e in each if e is not None]
    if len(known) < len(each):
        return None
    i = int(np.argmax([e.power for e in known]))
    return Energy(sum(e.net for e in known), sum(e.drawn for e in known), known[i].power, begins[i] + known[i].time)
