"""Certification of a trajectory from its polynomials, for any time law, and of sections that join at rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.check import check_keywords, check_kind, check_number
from optik.errors import InvalidInput
from optik.ik.base import Tolerance, ToleranceLike
from optik.scene import Scene
from optik.scene.contact import scene_for
from optik.types import Array, Flags
from planners.certificate.analysis import (
    Coverage,
    MotionAnalysis,
    check_rate,
    check_span,
    continuous_order,
    coverage,
    largest_jump,
    position_margins,
    position_times,
)
from planners.certificate.certificate import Certificate, LimitedPart
from planners.certificate.clearance import Clearance, clearance
from planners.certificate.effort import Energy, energy, friction_steps
from planners.certificate.frechet import waypoint_error
from planners.certificate.path_error import PathError
from planners.certificate.projection import NEAREST_TURN
from planners.limits import ALL_LIMITS, LOADED, TOOL_SPEEDS, Extreme, MotionLimits, ToolExtreme, check_path, kind_of
from planners.paths.base import Path
from planners.paths.program import ProgramPath
from planners.paths.waypoints import check_waypoints
from planners.trajectory import Trajectory, cut_after, cut_before

# ---------------- the certificate of a motion in sections


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


def find_section_times(
    path: ProgramPath, trajectory: Trajectory, span: tuple[float, float] | None
) -> list[SectionTimes]:
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
    first, analysis = proofs[0], MotionAnalysis(robot, trajectory)
    tolerances = [proof.tolerance for proof in proofs if proof.tolerance is not None]
    tolerance = max(tolerances, key=lambda each: each.position, default=None)
    enforced = dict.fromkeys(name for proof in proofs for name in proof.enforced)
    shift = list(zip(proofs, begins, starts, strict=True))

    extra = tuple(limits.extra or ())
    missing = {name: tuple(i for i, p in zip(which, proofs, strict=True) if name not in p.extra) for name in extra}

    def worst(name: str) -> Any:
        known: list[Any] = [(p.extreme(name), t) for p, t, _ in shift if name in ALL_LIMITS or name in p.extra]
        each = [x._replace(time=x.time + t) for x, t in known] or [ToolExtreme(np.nan, np.nan, 0.0)]
        most = reduce(select_worse, each)
        value = np.max([x.value for x in each], axis=0)  # which may be in a section with a higher limit
        return most._replace(value=value if isinstance(most, Extreme) else float(value))

    steps = [step._replace(t=step.t + t) for p, t, _ in shift for step in p.friction_steps]
    parts = [LimitedPart(part.analysis, t + part.begin, part.limits) for p, t, _ in shift for part in p.parts]
    margins = position_margins(robot, trajectory)
    return replace(
        first, enforced=tuple(enforced), duration=trajectory.duration, tolerance=tolerance,
        position_margin=margins, t_position_margin=position_times(robot, trajectory),
        path_error=_merge_errors([p.path_error for p in proofs], begins),
        t=trajectory.knots, s=_merge_places(trajectory, shift),
        coverage=_merge_coverage([p.coverage for p in proofs], begins, starts),
        continuous=min(continuous_order(analysis.jumps), *(p.continuous for p in proofs)),
        jump=largest_jump(trajectory, analysis.jumps), rest=analysis.rest,
        clearance=_merge_clearances([p.clearance for p in proofs], begins),
        **{name: worst(name) for name in ALL_LIMITS},
        extra={name: worst(name) for name in extra}, exempt={name: each for name, each in missing.items() if each},
        analysis=analysis.bare(), parts=tuple(parts), energy=_merge_energy([p.energy for p in proofs], begins),
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


# ---------------- certification of a trajectory


ENOUGH = 1.1
"""Ratio of the tolerance to the path error above which the bound on the path error is not refined."""


@check_keywords
def certify(
    robot: Robot, path: Path | ArrayLike | None, trajectory: Trajectory, limits: MotionLimits | None = None, *,
    law: str = "", enforced: tuple[str, ...] | None = None, rate: float = 1000.0,
    tolerance: ToleranceLike | None = None, span: tuple[float, float] | None = None,
    scene: Scene | None = None, before: tuple[MotionLimits, float] | None = None, analysis: MotionAnalysis | None = None,
) -> Certificate:  # fmt: skip
    """Return the certificate of a trajectory: the limits that it respects at every instant.

    Parameters
    ----------
    robot : Robot
        The arm.
    path : Path, or (k, 4, 4) array, or None
        Path of the tool; or waypoints [m] of a sharp polyline that it must follow within ``tolerance``, whose angle π leaves
        the rotation free; or None for a joint motion. In the last two cases path parameters are times.
    trajectory : Trajectory
        Joints over time [rad, m].
    limits : MotionLimits, optional
        Limits of the motion; by default the robot's own.
    law : str
        Name of the law, for the record.
    enforced : tuple of str, optional
        Limits that a valid motion must respect; by default all kinds that ``limits`` has.
    rate : float
        The controller's rate [1/s], for `Certificate.sampled_jerk`.
    tolerance : (2,) tuple of float, optional
        Largest distance [m] and angle [rad] to the path of a valid motion.
    span : (2,) tuple of float, optional
        Path parameters of the required start and end [m, rad]; by default the ends of the path.
    scene : Scene, optional
        Obstacles and the margin to them; self-contact is checked too. By default there is no collision check.
    before : (2,) tuple, optional
        Limits that replace ``limits`` until a time [s], which must be a knot of the motion.
    analysis : MotionAnalysis, optional
        Analysis of this trajectory, from `planners.timing.TimeLaw.run_with_analysis`, whose results are reused.

    Returns
    -------
    Certificate
        Proved properties; the exact extrema include the one-sided values at jumps.

    Raises
    ------
    InvalidInput
        An invalid argument, inconsistent arguments, an unknown limit in ``enforced``, or an arm without shapes.
    """
    if path is not None and not isinstance(path, Path):
        expected = "a Path, poses (k, 4, 4), or None: certify(robot, None, trajectory, limits)"
        check_kind(path, "path", Sequence | np.ndarray, expected)
        waypoints = check_waypoints(path, "path")
        options: dict[str, Any] = {"law": law, "enforced": enforced, "rate": rate, "scene": scene, "before": before}
        proof = certify(robot, None, trajectory, limits, **options)
        return _judge_waypoints(proof, waypoints, tolerance)
    limits = check_kinds(robot, path, trajectory, limits)
    span = _check_part(path, span, tolerance, trajectory)
    enforced = _check_enforced(enforced, limits)
    tolerance = None if tolerance is None else Tolerance.of(tolerance)
    analysis = _check_analysis(analysis, robot, trajectory)
    criteria: dict[str, Any] = {"law": law, "enforced": enforced, "rate": check_rate(rate), "tolerance": tolerance}
    if isinstance(path, ProgramPath):
        return _certify_sections(path, trajectory, limits, span, before, criteria | {"scene": scene})
    return _certify(analysis.along_path(path, *_required_accuracy(tolerance)), limits, before, span, scene, criteria)


def _certify_sections(
    path: ProgramPath, trajectory: Trajectory, limits: MotionLimits, span: tuple[float, float],
    before: tuple[MotionLimits, float] | None, criteria: dict[str, Any],
) -> Certificate:  # fmt: skip
    """Return the certificate of a motion that stops at the end of each section."""
    which, times = path.find_sections(span), find_section_times(path, trajectory, span)
    proofs = []
    for i, (begin, _, end) in zip(which, times, strict=True):
        part = cut_between(trajectory, begin, end)
        a, b = (float(np.clip(s - path.starts[i], 0.0, path.sections[i].end)) for s in span)
        own, scene = conditions_of(path, i, limits, criteria["scene"])
        enforced = tuple(name for name in criteria["enforced"] if name in own.names)
        given = criteria | {"span": (a, b), "before": before if i == which[0] else None}
        given |= {"scene": scene, "enforced": enforced}
        proofs.append(certify(path.robots[i], path.sections[i], part, own, **given))
    return merge_certificates(path, which, trajectory, proofs, [time.begin for time in times], limits)


def _check_part(
    path: Path | None, span: tuple[float, float] | None, tolerance: ToleranceLike | None, trajectory: Trajectory
) -> tuple[float, float]:
    """Return the part of the path that a motion must cover: all times without a path, which has no tolerance."""
    if path is None and (tolerance is not None or span is not None):
        raise InvalidInput("path", "None, with a tolerance or a span", "the Path of the tolerance and the span")
    return (0.0, trajectory.end) if path is None else check_span(span, path)


def _judge_waypoints(proof: Certificate, waypoints: Array, tolerance: ToleranceLike | None) -> Certificate:
    """Return the certificate of a motion without a path, with the path error along a polyline."""
    if tolerance is None:
        raise InvalidInput("tolerance", "None", "a largest distance and angle, because path is an array of waypoints")
    tolerance = Tolerance.of(tolerance)
    off = waypoint_error(proof.analysis.robot, proof.analysis.trajectory, waypoints, tolerance)
    return replace(proof, path_error=off, tolerance=tolerance)


def _check_enforced(enforced: tuple[str, ...] | None, limits: MotionLimits) -> tuple[str, ...]:
    """Return the names of the enforced limits, by default all; raise InvalidInput for one that `limits` does not have."""
    if unknown := [field for field in enforced or () if field not in limits.names]:
        raise InvalidInput("enforced", repr(unknown[0])[:60], f"names out of: {', '.join(limits.names)}")
    return limits.names if enforced is None else enforced


def _check_analysis(analysis: MotionAnalysis | None, robot: Robot, trajectory: Trajectory) -> MotionAnalysis:
    """Return the analysis of a motion, the given one if it is of this motion."""
    analysis = MotionAnalysis(robot, trajectory) if analysis is None else analysis
    if analysis.trajectory is not trajectory or analysis.robot != robot:
        raise InvalidInput("analysis", "the analysis of another motion", "that of this robot and trajectory")
    return analysis


def _required_accuracy(tolerance: Tolerance | None) -> tuple[tuple[float, float], float]:
    """Return a path error [m, rad] that is small enough, and the weight [m/rad] of rotation against position."""
    if tolerance is None:
        return (1.0, 1.0), NEAREST_TURN
    return (tolerance.position / ENOUGH, tolerance.rotation / ENOUGH), tolerance.position / tolerance.rotation


def _certify(
    analysis: MotionAnalysis, limits: MotionLimits, before: tuple[MotionLimits, float] | None, span: tuple[float, float],
    scene: Scene | None, criteria: dict[str, Any],
) -> Certificate:  # fmt: skip
    """Return the certificate for checked arguments; the criteria are fields of it."""
    robot, trajectory = analysis.robot, analysis.trajectory
    parts = limited_parts(analysis, limits, before)
    judged = judge_parts(analysis, parts)
    off, s, covered = _measure_along_path(analysis, span)
    return Certificate(
        joint_names=robot.joint_names,
        **criteria,
        duration=trajectory.duration,
        position_margin=position_margins(robot, trajectory),
        path_error=off,
        t=trajectory.knots,
        s=s,
        coverage=covered,
        continuous=continuous_order(analysis.jumps),
        jump=largest_jump(trajectory, analysis.jumps),
        t_position_margin=position_times(robot, trajectory),
        rest=analysis.rest,
        clearance=None if scene is None else clearance(robot, trajectory, scene),
        **{name: judged.pop(name) for name in ALL_LIMITS},
        extra=judged,
        analysis=analysis.bare(),
        parts=tuple(part._replace(analysis=part.analysis.bare()) for part in parts),
        **_measure_effort(analysis, limits),
    )


def _measure_effort(analysis: MotionAnalysis, limits: MotionLimits) -> dict[str, Any]:
    """Return the energy and the friction steps, if the torque or its rate is limited."""
    if all(limits.value(name) is None for name in LOADED):
        return {}
    torques = analysis.torques
    steps = friction_steps(analysis.robot, analysis.trajectory, torques, analysis.rest)
    return {"energy": energy(torques), "friction_steps": steps}


def _measure_along_path(analysis: MotionAnalysis, span: tuple[float, float]) -> tuple[PathError, Array, Coverage]:
    """Return the path error, the path parameters (m + 1,) at the knots, and the covered part of the path."""
    if not analysis.has_path:
        end, nothing = analysis.trajectory.end, (0.0, 0.0)
        covered = Coverage(0.0, end, span, end, end, (nothing, nothing, nothing))
        return PathError(*(float("nan"),) * 6), analysis.trajectory.knots, covered
    off, passage = analysis.along
    return off, passage.s[passage.knot], coverage(analysis.path, passage, span)


def check_kinds(robot: Robot, path: Path | None, trajectory: Trajectory, limits: MotionLimits | None) -> MotionLimits:
    """Return the limits; raise InvalidInput for arguments of a wrong type or with a wrong number of joints."""
    limits = MotionLimits.of(robot) if limits is None and isinstance(robot, Robot) else limits
    given = {"robot": robot, "path": path, "trajectory": trajectory, "limits": limits}
    for (argument, value), kind in zip(given.items(), (Robot, Path | None, Trajectory, MotionLimits), strict=True):
        check_kind(value, argument, kind, f"a {getattr(kind, '__name__', 'Path or None')}")
    if trajectory.n != robot.n:
        raise InvalidInput("trajectory", f"{trajectory.n} joints", f"the {robot.n} of {robot.name}")
    assert limits is not None
    if path is not None:
        check_path(limits, path)
    bounds = limits.bounds(robot.n)
    for name in () if isinstance(path, ProgramPath) else limits.extra or ():  # each section has its own arm
        kind_of(name).check_robot(robot, bounds[name])
    return limits


def limited_parts(
    analysis: MotionAnalysis, limits: MotionLimits, before: tuple[MotionLimits, float] | None
) -> tuple[LimitedPart, ...]:
    """Return the whole motion as one part, or its parts before and after the time at which the limits change."""
    if before is None:
        return (LimitedPart(analysis, 0.0, limits),)
    expected = "limits of the same kinds, and the time of a knot inside the motion"
    if not isinstance(before, tuple | list) or len(before) != 2 or not isinstance(before[0], MotionLimits):
        raise InvalidInput("before", repr(before)[:60], expected)
    old, t = before[0], check_number(before[1], "before", expected, above=0.0)
    trajectory, path = analysis.trajectory, analysis.path if analysis.has_path else None
    knots = trajectory.knots
    t = float(knots[int(np.abs(knots - t).argmin())]) if np.abs(knots - t).min() <= 1e-12 * trajectory.end else t
    if old.names != limits.names or t not in knots:
        raise InvalidInput("before", f"limits on {', '.join(old.names)} until {t:.9g} s", expected)
    if t >= trajectory.end:
        return (LimitedPart(analysis, 0.0, old),)
    halves = cut_after(trajectory, t), cut_before(trajectory, t)
    first, second = (MotionAnalysis(analysis.robot, part, path) for part in halves)
    return LimitedPart(first, 0.0, old), LimitedPart(second, t, limits)


def judge_parts(analysis: MotionAnalysis, parts: tuple[LimitedPart, ...]) -> dict[str, Any]:
    """Return the peak values of each kind of limit over the parts; infinite if a derivative jumps between two parts."""
    n = analysis.robot.n
    found: dict[str, Any] = {}
    for kind in parts[-1].limits.kinds:
        each: list[Any] = [kind.judge(part.analysis, part.limits.bounds(n)[kind.name]) for part in parts]
        each = [x._replace(time=x.time + part.begin) for x, part in zip(each, parts, strict=True)]
        found[kind.name] = each[0] if len(each) == 1 else select_worse(*each)
    if len(parts) > 1:
        k = int(np.searchsorted(analysis.trajectory.knots, parts[1].begin))
        jump = analysis.jumps[:3, k].any(axis=0)
        for kind in parts[-1].limits.kinds if jump.any() else ():
            # A jump of the acceleration is an infinite rate; one of a joint moves the torques of all.
            if kind.order > 2:
                worst, where = found[kind.name], jump if kind.name == "jerk" else jump.any()
                ratio = np.where(where & ~np.isnan(worst.ratio), np.inf, worst.ratio)
                found[kind.name] = worst._replace(ratio=ratio)
    return found
