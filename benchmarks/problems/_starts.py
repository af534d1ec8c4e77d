"""Start configurations: near a solution, far from it, random inside the limits, or zero; the same for every problem set."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from inspect import Signature, cleandoc, signature
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmarks.problems.base import ProblemSet, start_of
from optik.arm.limits import JointLimits
from optik.arm.robot import Robot
from optik.check import check_number
from optik.errors import InvalidInput
from optik.types import Array

START_KINDS = ("near", "far", "random", "zero")
"""Kinds of starts. near: solution + N(0, spread) on every joint; far: half of its range away on every joint; random:
uniform inside the limits; zero: all joints at zero. All are clamped to the limits."""


def stream(seed: int, *words: str) -> np.random.Generator:
    """Return an independent random stream for a seed and some words, such as the names of a set and of a group."""
    return np.random.default_rng((seed, *(crc32(word.encode()) for word in words)))


def from_solutions(
    robot: Robot,
    seed: int,
    groups: dict[str, Array],
    *,
    starts: str | Sequence[str] | None = None,
    spread: float = 0.1,
    start_deg: ArrayLike | None = None,
) -> ProblemSet:
    """Return a problem set whose targets are the tool poses of known configurations, with one or several kinds of starts.

    Random starts are drawn for each group by itself, one problem after another: the first problems of a group are the same
    for any larger count.
    """
    kinds = check_starts(starts, start_deg)
    check_number(spread, "spread", "radians above 0", above=0.0)
    fixed = None if start_deg is None else start_of(robot, start_deg)
    parts = [(group, kind, q) for group, q in groups.items() for kind in kinds]
    first = [
        start_configurations(robot.limits, stream(seed, kind, group), q, kind, spread)
        if fixed is None
        else np.tile(fixed, (len(q), 1))
        for group, kind, q in parts
    ]
    names = [named(group, kind, kinds) for group, kind, q in parts for _ in q]
    far = [np.full(len(q), spread if kind == "near" else np.nan) for _, kind, q in parts]
    solutions = np.concatenate([q for *_, q in parts])
    sigma, known = robot.singular_values(solutions)[:, -1], np.ones(len(names), dtype=bool)
    return ProblemSet(
        robot.fk(solutions), np.concatenate(first), np.array(names), known, sigma, np.concatenate(far)
    )  # fmt: skip


START_OPTIONS = """
starts : str or sequence of str, optional
    Kinds of starts: near (the default), far, random, zero; one or several.
spread : float
    Standard deviation of start − solution on every joint, for near starts [rad].
start_deg : (n,) array, optional
    One start for all problems instead; prismatic joints in millimetres [deg, mm]."""
"""Documentation of the options that `with_starts` adds."""


def with_starts(draw: Callable[..., dict[str, Array]]) -> Callable[..., ProblemSet]:
    """Return the problem set of the configurations that a function samples, with the options for their starts."""

    @wraps(draw)
    def make(
        robot: Robot, seed: int, *, starts: Any = None, spread: float = 0.1, start_deg: Any = None, **options: Any
    ) -> ProblemSet:
        groups = draw(robot, seed, **options)
        return from_solutions(robot, seed, groups, starts=starts, spread=spread, start_deg=start_deg)

    own, more = (signature(one).parameters.values() for one in (draw, from_solutions))
    added = [parameter for parameter in more if parameter.kind is parameter.KEYWORD_ONLY]
    make.__signature__ = Signature([*own, *added], return_annotation="ProblemSet")  # type: ignore[attr-defined]
    words, title, rest = cleandoc(draw.__doc__ or "").partition("\n\nReturns\n")
    make.__doc__ = f"{words}{START_OPTIONS}{title}{rest}"
    return make


def check_starts(
    starts: str | Sequence[str] | None, start_deg: ArrayLike | None = None, known: Sequence[str] = START_KINDS
) -> tuple[str, ...]:
    """Return the requested kinds of starts."""
    if start_deg is not None:
        if starts is not None:
            raise InvalidInput("starts", f"{starts!r} together with start_deg", "either starts or start_deg")
        return ("fixed",)
    kinds = (known[0],) if starts is None else (starts,) if isinstance(starts, str) else tuple(starts)
    if not kinds or len(set(kinds)) != len(kinds) or any(kind not in known for kind in kinds):
        raise InvalidInput("starts", repr(starts)[:60], f"one or more of {', '.join(known)}, each once")
    return kinds


def named(group: str, kind: str, kinds: Sequence[str]) -> str:
    """Return the name of a group, with its kind of start if there are several kinds."""
    return group if len(kinds) == 1 else f"{group}, {kind} start"


def start_configurations(limits: JointLimits, rng: np.random.Generator, q: Array, kind: str, spread: float) -> Array:
    """Return a start of one kind for each solution."""
    if kind == "near":
        return limits.clip(q + spread * rng.normal(size=q.shape))
    if kind == "random":
        return limits.sample(rng, len(q))
    if kind == "zero":
        return limits.clip(np.zeros_like(q))
    return limits.clip(_opposite(limits, q))


def _opposite(limits: JointLimits, q: Array) -> Array:
    """Return configurations half of the range away on every joint; π [rad, m] away if a limit is infinite."""
    width = np.where(limits.bounded, 2.0 * limits.half, 1.0)
    lower = np.where(limits.bounded, limits.lower, 0.0)
    wrapped = lower + np.mod(q - lower + 0.5 * width, width)
    free: NDArray[np.float64] = np.where(q + np.pi <= limits.upper, q + np.pi, q - np.pi)
    return np.where(limits.bounded, wrapped, np.where(limits.half == 0.0, q, free))
