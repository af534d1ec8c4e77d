"""Certificate: proved properties of a trajectory, from its polynomials and not from samples, for any time law."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from optik.arm.motors import ranges_of
from optik.card import Bar, Card
from optik.check import format_count, format_ratio, real_array
from optik.errors import InvalidInput, InvalidMotion
from optik.ik.base import Tolerance
from optik.types import Array
from planners.certificate.analysis import (
    Coverage,
    Jump,
    MotionAnalysis,
    find_continuity_violations,
    find_position_violations,
    find_smallest_singular_value,
    sampled_jerk,
)
from planners.certificate.clearance import Clearance
from planners.certificate.effort import Energy, FrictionStep
from planners.certificate.path_error import PathError
from planners.certificate.violation import Allow, Violation, check_allow, word_of_limit, words_for
from planners.limits import ALL_LIMITS, LOADED, Extreme, MotionLimits, ToolExtreme, kind_of
from planners.limits.inputs import plain

RATIO_ROUNDING = 1e-12
"""Largest excess of a ratio over 1 that counts as rounding error."""
MOST_LIMITS = 7
"""Largest number of limits in a summary, by decreasing ratio."""


@dataclass(frozen=True, eq=False, repr=False)
class Certificate:
    """Proved properties of a trajectory. Two certificates are equal only if they are the same object.

    Attributes
    ----------
    joint_names : tuple of str
        In the order of all arrays.
    law : str
        Name of the time law of the trajectory.
    enforced : tuple of str
        Enforced limits: `is_valid` judges these and the position limits.
    velocity, acceleration, jerk : Extreme
        Exact peak values and their ratios to the limits, NaN without a limit. The jerk is infinite if the acceleration jumps.
    torque, torque_rate : Extreme
        Proved bounds on the torques [N·m, N], with Coulomb friction, and on their rates [N·m/s, N/s], without it, for this
        model of the arm's masses; NaN if they are not limited.
    extra : mapping of str to Extreme or ToolExtreme
        Peak values of further kinds of limits, by name (``MotionLimits(extra=...)``).
    exempt : mapping of str to tuple of int
        Sections without a payload, counted from 0, by the name of the limit on a payload that does not apply there.
    energy : Energy or None
        Mechanical energy and largest power found; None if neither the torque nor its rate is limited.
    friction_steps : tuple of FrictionStep
        Steps of the torque by Coulomb friction, which ``torque_rate`` excludes; empty if neither of them is limited.
    rate : float
        Rate of the controller [1/s].
    position_margin : (n,) array
        Least distance to the position limits, exact [rad or m]; negative if one is violated.
    path_error : PathError
        Proved bounds on the deviation of the tool from the path.
    tolerance : (2,) tuple of float, or None
        Largest distance [m] and angle [rad] to the path of a valid motion; None without a tolerance.
    tool_speed, rotation_speed : ToolExtreme
        Proved bounds on the speed of the tool's point [m/s] and of its rotation [rad/s], their ratios to the limits (NaN
        without a limit) and the times of the peaks.
    t, s : (m + 1,) array
        Times of the knots [s], and path parameters there [m, or rad].
    coverage : Coverage
        Part of the path that the motion covers.
    continuous : int
        Highest order, 0 to 3, up to which all derivatives are continuous; −1 if the position jumps. A motion that starts or
        ends at rest continues there with standstill.
    rest : (2,) tuple of bool
        Whether the velocity is zero at the start and at the end.
    clearance : Clearance or None
        Proved least distance between arm and scene and between links, for these shapes; None without a scene: then contact is
        not checked.
    jump : Jump or None
        Largest jump of the position, or of the velocity if the position is continuous.
    t_position_margin : (n,) array
        Times of the least distances to the position limits [s].
    analysis, parts : MotionAnalysis, and tuple of LimitedPart
        The analysis of the motion, and its parts with their limits, for the values that are computed when they are first read.
    """

    joint_names: tuple[str, ...]
    law: str
    enforced: tuple[str, ...]
    duration: float
    velocity: Extreme
    acceleration: Extreme
    jerk: Extreme
    rate: float
    position_margin: Array
    path_error: PathError
    tolerance: Tolerance | None
    tool_speed: ToolExtreme
    rotation_speed: ToolExtreme
    t: Array
    s: Array
    coverage: Coverage
    continuous: int
    rest: tuple[bool, bool]
    torque: Extreme
    torque_rate: Extreme
    analysis: MotionAnalysis = dataclasses.field(repr=False)
    parts: tuple[LimitedPart, ...] = dataclasses.field(repr=False)
    extra: Mapping[str, Extreme | ToolExtreme] = dataclasses.field(default_factory=dict)
    exempt: Mapping[str, tuple[int, ...]] = dataclasses.field(default_factory=dict)
    energy: Energy | None = None
    friction_steps: tuple[FrictionStep, ...] = ()
    clearance: Clearance | None = None
    jump: Jump | None = None
    t_position_margin: Array | None = None

    def __repr__(self) -> str:
        return str(self)

    def __str__(self) -> str:
        return "\n".join(summary_lines(self))

    def _repr_html_(self) -> str:
        """Return the verdict and the peaks for a notebook."""
        title, verdict = f"Certificate of {self.duration:.4g} s", summary_lines(self)[0]
        good, bars, facts = self.is_valid, limit_bars(self), proof_facts(self)
        return Card(title=title, verdict=verdict, good=good, bars=bars, facts=facts).to_html()

    @cached_property
    def sampled_jerk(self) -> Array:
        """Largest difference of accelerations at consecutive samples of the controller, over its period [rad/s³]."""
        return sampled_jerk(self.analysis.trajectory, self.rate)

    @cached_property
    def binding(self) -> Binding:
        """Path speed and active constraint of each segment."""
        return active_constraints(self.parts, self.t, self.s)

    @cached_property
    def _singular(self) -> tuple[float, float]:
        return find_smallest_singular_value(self.analysis.robot, self.analysis.trajectory)

    @property
    def singular_value(self) -> float:
        """Smallest singular value of the Jacobian [m/rad, 1]: the minimum of a grid that is refined around it."""
        return self._singular[0]

    @property
    def t_singular_value(self) -> float:
        """Time of the smallest singular value [s]."""
        return self._singular[1]

    def s_at(self, t: float) -> float:
        """Return the path parameter [m, or rad] at a time [s], between the knots by interpolation.

        Parameters
        ----------
        t : float
            Time since the start [s].

        Returns
        -------
        float
            Path parameter [m, or rad].
        """
        return float(np.interp(real_array(t, "t", "a time [s]", ()), self.t, self.s))

    def extreme(self, field: str) -> Extreme | ToolExtreme:
        """Return the peak value of a limited quantity, its ratio to the limit and its time.

        Parameters
        ----------
        field : str
            Name of the limit.

        Returns
        -------
        Extreme or ToolExtreme
            The first for a limit on every joint.

        Raises
        ------
        InvalidInput
            No limit of that name.
        """
        if isinstance(field, str) and field in ALL_LIMITS:
            named: Extreme | ToolExtreme = getattr(self, field)
            return named
        if not isinstance(field, str) or field not in self.extra:
            raise InvalidInput("field", repr(field), f"one of: {', '.join((*ALL_LIMITS, *self.extra))}")
        return self.extra[field]

    def worst(self, field: str) -> tuple[float, str, float]:
        """Return the largest ratio to a limit, its joint (``"tool"`` for the tool) and its time; NaN if nothing is limited.

        Parameters
        ----------
        field : str
            Name of the limit.

        Returns
        -------
        tuple of float, str and float
            Ratio [1], joint and time [s].

        Raises
        ------
        InvalidInput
            No limit of that name.
        """
        extreme, kind = self.extreme(field), kind_of(field)
        if kind.subject is not None:
            return extreme.worst((kind.subject,))
        limit = self.parts[-1].limits.value(field) if field in self.extra else None
        return extreme.worst(kind.subjects(self.analysis.robot, limit))

    @cached_property
    def violations(self) -> tuple[Violation, ...]:
        """The violations; empty if the certificate is valid."""
        moving = [] if self.rest[1] else [Violation("the motion does not end at rest", self.duration, "limits")]
        return (
            *self._limit_violations(),
            *find_continuity_violations(self.continuous, self.jump, self.joint_names),
            *find_position_violations(
                self.position_margin, ranges_of(self.analysis.robot).names, self.t_position_margin
            ),
            *self.coverage.find_violations(self.tolerance, self.duration),
            *moving,
            *self.path_error.find_violations(self.tolerance),
            *(() if self.clearance is None else self.clearance.find_violations()),
        )

    @property
    def asked(self) -> str:
        """What the path error is of: the "pose", the "axis" with its point, or the "point" alone."""
        return self.analysis.path.asked if self.analysis.has_path else "pose"

    def _limit_violations(self) -> list[Violation]:
        """Return the violations of enforced limits."""
        found = []
        for field in self.enforced:
            ratio, subject, t = self.worst(field)
            if ratio > 1.0 + RATIO_ROUNDING:
                much = f"{format_ratio(ratio)} of its limit" if ratio < float("inf") else "unbounded"
                words = f"{field} of {subject} is {much} at t = {t:.6g} s"
                words += ", for this model of the masses" if field in LOADED else ""
                joint = subject if subject in self.joint_names else None
                found.append(Violation(words, t, word_of_limit(field), joint))
        return found

    @property
    def reasons(self) -> tuple[str, ...]:
        """Texts of the violations; empty if the certificate is valid."""
        return tuple(violation.words for violation in self.violations)

    @property
    def is_valid(self) -> bool:
        """Whether every enforced limit is respected at every instant, and the motion follows its whole path.

        The motion respects the limits in ``enforced`` and the position limits. Position and velocity are continuous. The tool
        stays within the tolerance, if there is one. The motion covers the whole path forwards and ends at rest. With a scene,
        every distance is proved to exceed the margin.
        """
        return not self.violations

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for files; None for infinite and undefined numbers."""
        out: dict[str, Any] = {
            "law": self.law, "enforced": list(self.enforced), "is_valid": self.is_valid, "reasons": list(self.reasons),
            "duration": self.duration, "rate": self.rate, "continuous": self.continuous, "rest": list(self.rest),
            "singular_value": self.singular_value, "t_singular_value": self.t_singular_value,
            "path_error": self.path_error.to_dict(), "coverage": self.coverage._asdict(), "joint_names": list(self.joint_names),
            "tolerance": None if self.tolerance is None else list(self.tolerance),
        }  # fmt: skip
        out |= {name: self.extreme(name).to_dict() for name in (*ALL_LIMITS, *self.extra)}
        out["exempt"] = {name: list(sections) for name, sections in self.exempt.items()}
        out["energy"] = None if self.energy is None else self.energy._asdict()
        out["friction_steps"] = [step._asdict() for step in self.friction_steps]
        out |= {"sampled_jerk": plain(self.sampled_jerk), "position_margin": plain(self.position_margin)}
        out["clearance"] = None if self.clearance is None else self.clearance.to_dict()
        return out | {"binding": self.binding.to_dict()}


# ------------------------------------------------------------ summary


def summary_lines(proof: Certificate, least: float | None = None) -> list[str]:
    """Return a summary of a certificate, at most eleven lines: validity, duration, limits, path, tool, clearance."""
    if proof.is_valid:
        enforced = ", ".join(name for name in proof.enforced if not np.isnan(proof.worst(name)[0]))
        status = f"certificate valid; enforced: {enforced or 'joint ranges and path only'}"
    else:
        others = len(proof.reasons) - 1
        more = f" (and {format_count(others, 'more violation')})" if others else ""
        status = f"certificate NOT valid: {shorten_text(proof.reasons[0])}{more}"
    joints = f" (slowest joint alone: {least:.3g} s)" if least else ""
    return [status, f"duration {proof.duration:.3g} s{joints}", *_limit_lines(proof), *_tool_lines(proof)]


def limit_bars(proof: Certificate) -> list[Bar]:
    """Return the peak ratios of the limits with the largest ones, each with its joint and time."""
    found = {name: proof.worst(name) for name in (*ALL_LIMITS, *proof.extra)}
    bounded = {name: one for name, one in found.items() if not np.isnan(one[0])}
    bars = [
        Bar(name, ratio, f"{subject} at {t:.3g} s{describe_scope(proof, name)}")
        for name, (ratio, subject, t) in bounded.items()
    ]
    least = sorted((bar.ratio for bar in bars), reverse=True)[:MOST_LIMITS]
    return [bar for bar in bars if bar.ratio >= least[-1]]


def describe_scope(proof: Certificate, name: str) -> str:
    """Return a text that says whether a limit is not enforced, and in which sections, from 1, it does not apply."""
    exempt = proof.exempt.get(name, ())
    sections = f"{'sections' if len(exempt) > 1 else 'section'} {', '.join(str(i + 1) for i in exempt)}"
    enforced = "" if name in proof.enforced else ", not enforced"
    return enforced + (f", not applied in {sections} (no payload)" if exempt else "")


def _limit_lines(proof: Certificate) -> list[str]:
    """Return the summary's lines on limits (peak / limit)."""
    bars = limit_bars(proof)
    lines = [f"peak / limit, {bar.name}: {bar.ratio:.3g} ({bar.words})" for bar in bars]
    more = sum(not np.isnan(proof.worst(name)[0]) for name in (*ALL_LIMITS, *proof.extra)) - len(bars)
    return lines if more == 0 else [*lines[:-1], f"{lines[-1]}; {more} more limits with smaller ratios"]


def proof_facts(proof: Certificate) -> list[tuple[str, str]]:
    """Return path error, tool speed, smallest singular value and clearance as rows of a table."""
    off, facts = proof.path_error, []
    if np.isfinite(off.distance):
        angle = f" and {off.angle:.3g} rad" + " of the axis" * (proof.asked == "axis")
        facts.append(("path error", f"at most {1e3 * off.distance:.3g} mm{angle * (proof.asked != 'point')}"))
    facts.append(("tool speed", f"at most {proof.tool_speed.value:.3g} m/s"))
    facts.append(("smallest singular value", f"{proof.singular_value:.3g}"))
    if proof.clearance is not None and proof.clearance.kinds:
        kinds = (f"{words} {kind.describe()}" for words, kind in proof.clearance.kinds.items())
        facts.append(("clearance", "; ".join([*kinds, *filter(None, [proof.clearance.note])])))
    return facts


def _tool_lines(proof: Certificate) -> list[str]:
    """Return the lines on path error, tool speed and clearance."""
    facts = [f"{name} {words}" for name, words in proof_facts(proof)]
    clear = [fact for fact in facts if fact.startswith("clearance")]
    return [", ".join(fact for fact in facts if fact not in clear), *clear]


def shorten_text(words: str, most: int = 300) -> str:
    """Return text on one line, cut to at most a number of characters."""
    line = " ".join(words.split())
    return line if len(line) <= most else f"{line[: most - 1]}…"


class LimitedPart(NamedTuple):
    """A part of a motion, its start time [s], and its limits."""

    analysis: MotionAnalysis
    begin: float
    limits: MotionLimits


class Binding(NamedTuple):
    """Path speed and active constraint of each of the m segments of a motion.

    ``t`` and ``s`` (m + 1,) are times [s] and path parameters [m, or rad] of their ends, ``speed`` (m,) is the mean of ds/dt.
    ``ratio`` (m,) is the peak ratio to a limit on the segment [1], 0 where nothing is limited; ``limit`` (m,) names that limit
    and ``joint`` (m,) its joint, ``"tool"`` for limits of the tool.
    """

    t: Array
    s: Array
    speed: Array
    ratio: Array
    limit: tuple[str, ...]
    joint: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for files; None for infinite and undefined numbers."""
        numbers = {k: plain(getattr(self, k)) for k in ("t", "s", "speed", "ratio")}
        return numbers | {"limit": list(self.limit), "joint": list(self.joint)}


def active_constraints(parts: tuple[LimitedPart, ...], t: Array, s: Array) -> Binding:
    """Return the peak ratio of every segment between knots, its limit and its joint.

    Joint ratios are exact; tool ratios are taken at both ends of each segment.
    """
    found = list[tuple[float, str, str]]()
    for part in parts:
        analysis, limits = part.analysis.bare(), part.limits.bounds(part.analysis.robot.n)
        each = [(kind, limits[kind.name]) for kind in part.limits.kinds]
        ratios = np.concatenate([kind.piece_ratios(analysis, limit) for kind, limit in each], axis=1)
        columns = [(kind.name, subject) for kind, limit in each for subject in kind.subjects(analysis.robot, limit)]
        found += [(float(row[i]), *columns[i]) for row, i in zip(ratios, ratios.argmax(axis=1), strict=True)]
    ratio, limit, joint = zip(*found, strict=True)
    return Binding(t, s, np.diff(s) / np.diff(t), np.array(ratio), limit, joint)


def find_forbidden(proof: Certificate, allow: Allow) -> tuple[Violation, ...]:
    """Return the violations of a motion that the words of ``allow=`` do not permit."""
    allowed = check_allow(allow)
    return tuple(violation for violation in proof.violations if violation.allow not in allowed)


def check_valid(proof: Certificate, allow: Allow = (), context: str = "", advice: str = "") -> None:
    """Raise InvalidMotion if the motion has violations that the words of ``allow=`` do not permit."""
    violations = find_forbidden(proof, allow)
    if violations:
        reason = context + "; ".join(violation.words for violation in violations)
        first, words = violations[0], words_for(violations, allow)
        raise InvalidMotion(reason, words, s=proof.s_at(first.t), joint=first.joint, advice=advice)
