"""Problem sets: targets with starts and known solutions, and configurations near singularities."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, wraps
from inspect import Signature, cleandoc, signature
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from optik import se3
from optik.arm.limits import JointLimits
from optik.arm.model import unit_factors
from optik.arm.robot import Robot
from optik.check import check_number
from optik.errors import InvalidInput
from optik.ik import make_solver
from optik.ik.problem import UNREACHABLE
from optik.types import Array, Flags, content

# ---------------- problem sets


SETS = "benchmarks.problems"
"""Package in which problem sets are found by name."""


@dataclass(frozen=True)
class ProblemSet:
    """IK problems: targets, and the initial guesses `starts`.

    Attributes
    ----------
    targets : (k, 4, 4) array
        Target poses [1, m].
    starts : (k, n) array
        Start configurations [rad, m].
    group : (k,) array of str
        What reports group by: a plane, a stratum, a distance.
    known : (k,) array of bool
        Whether a configuration inside the limits is known to reach the target. A target without one may be unreachable;
        it is counted separately, never dropped.
    sigma : (k,) array
        Smallest singular value of the Jacobian at the known configuration [1], NaN where none is known.
    spread : (k,) array
        Standard deviation of start − solution [rad], NaN where the start is not drawn around a solution.
    unreachable : (k,) array of bool, optional
        Whether it is proved that no configuration reaches the target; by default none is.
    """

    targets: Array
    starts: Array
    group: NDArray[np.str_]
    known: NDArray[np.bool_]
    sigma: Array
    spread: Array
    unreachable: NDArray[np.bool_] | None = None

    def __len__(self) -> int:
        return len(self.targets)

    @property
    def sha256(self) -> str:
        """SHA-256 of targets and starts: two runs with the same hash have solved the same problems."""
        return _digest(self.targets, self.starts)

    def chosen(self, most: int | None) -> NDArray[np.int64]:
        """Choose at most `most` problems: first those with a known solution, otherwise at random.

        A smaller choice is a subset of every larger one, so methods with different numbers of problems share the smallest.

        Parameters
        ----------
        most : int or None
            Largest number of problems; None for all.

        Returns
        -------
        (j,) array of int
            Indices of the problems, ascending.
        """
        if most is None or len(self) <= most:
            return np.arange(len(self))
        order = np.random.default_rng((len(self), 3)).permutation(len(self))
        return np.sort(order[np.argsort(~self.known[order], kind="stable")][:most])

    def frame(self, robot: Robot) -> pl.DataFrame:
        """Return a table with one row per problem: group, target, distance from the start, known solution.

        Parameters
        ----------
        robot : Robot
            The arm.

        Returns
        -------
        DataFrame
            Columns ``problem``, ``group``, ``x``, ``y``, ``z`` [m], ``distance`` [m] and ``turn`` [rad] between start
            and target, ``known``, ``unreachable``, ``sigma``, ``spread``, ``target`` (16 numbers) and ``start`` (n numbers).
        """
        first = robot.fk(self.starts)
        e = se3.error(first, self.targets)
        return pl.DataFrame(
            {
                "problem": np.arange(len(self)),
                "group": self.group.tolist(),
                "x": self.targets[:, 0, 3],
                "y": self.targets[:, 1, 3],
                "z": self.targets[:, 2, 3],
                "distance": np.linalg.norm(e[:, :3], axis=1),
                "turn": np.linalg.norm(e[:, 3:], axis=1),
                "known": self.known,
                "unreachable": np.zeros(len(self), dtype=bool) if self.unreachable is None else self.unreachable,
                "sigma": self.sigma,
                "spread": self.spread,
                "target": self.targets.reshape(-1, 16).tolist(),
                "start": self.starts.tolist(),
            }
        )


def _digest(targets: Array, starts: Array) -> str:
    """Return the SHA-256 of k and n, targets (k, 16 or 4, 4) and starts (k, n) as little-endian doubles."""
    k, n = starts.shape
    content = hashlib.sha256(f"{k} problems, {n} joints\n".encode())
    for array in (targets, starts):
        content.update(np.ascontiguousarray(array, dtype="<f8").reshape(-1).data)  # no copy: sets may be large
    return content.hexdigest()


def start_of(robot: Robot, start_deg: ArrayLike) -> Array:
    """Return a start configuration in SI units, from the degrees and millimetres of a suite."""
    q = robot.configuration(start_deg, "start_deg") / unit_factors(robot)
    if not robot.limits.contains(q):
        raise InvalidInput("start_deg", start_deg, f"a configuration within the joint limits of {robot.name}")
    return q


START_KINDS = ("near", "far", "random", "zero")
"""Kinds of starts. near: solution + N(0, spread) on every joint; far: half of its range away on every joint; random:
uniform inside the limits; zero: all joints at zero. All are clamped to the limits."""


def random_stream(seed: int, *words: str) -> np.random.Generator:
    """Return an independent random stream for a seed and some words, such as the names of a set and of a group."""
    return np.random.default_rng((seed, *(crc32(word.encode()) for word in words)))


def from_solutions(
    robot: Robot, seed: int, groups: dict[str, Array], *, starts: str | Sequence[str] | None = None,
    spread: float = 0.1, start_deg: ArrayLike | None = None,
) -> ProblemSet:  # fmt: skip
    """Return a problem set whose targets are the tool poses of known configurations, with one or several kinds of starts.

    Random starts are drawn for each group by itself, one problem after another: the first problems of a group are the same
    for any larger count.
    """
    kinds = check_starts(starts, start_deg)
    check_number(spread, "spread", "radians above 0", above=0.0)
    fixed = None if start_deg is None else start_of(robot, start_deg)
    parts = [(group, kind, q) for group, q in groups.items() for kind in kinds]
    first = [
        start_configurations(robot.limits, random_stream(seed, kind, group), q, kind, spread)
        if fixed is None
        else np.tile(fixed, (len(q), 1))
        for group, kind, q in parts
    ]
    names = [name_with_kind(group, kind, kinds) for group, kind, q in parts for _ in q]
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


def name_with_kind(group: str, kind: str, kinds: Sequence[str]) -> str:
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


WRIST, ELBOW, SHOULDER = 4, 2, 1
"""Indices of the joints of a six-joint arm that bend its wrist, its elbow and its shoulder."""
DET_SAMPLES, DET_BISECTIONS = 61, 60
"""Values of a joint at which the sign of det J is sampled, and bisections of a sign change, down to rounding."""
DRAWS, RANK_STEPS = 40, 30
"""Number of attempts before an arm counts as without singular configurations, and Gauss–Newton steps of each."""
RANK_LOST = 1e-9
"""Smallest singular value below which a configuration counts as singular [1]: rounding of the searches."""


def put_on_limits(robot: Robot, rng: np.random.Generator, q: Array, but: int | None = None) -> Array:
    """Put joints on one of their limits: each with probability ½, at least one, never the joint `but`."""
    chosen = _some(rng, q.shape, but)
    ends = np.where(rng.random(q.shape) < 0.5, robot.limits.lower, robot.limits.upper)
    return np.where(chosen, ends, q)


def put_at_zero(robot: Robot, rng: np.random.Generator, q: Array) -> Array:
    """Put joints at zero: each with probability ½, at least one, all in the first configuration; clamp to the limits."""
    chosen = _some(rng, q.shape, None)
    chosen[0] = True
    return robot.limits.clip(np.where(chosen, 0.0, q))


def _some(rng: np.random.Generator, shape: tuple[int, ...], but: int | None) -> NDArray[np.bool_]:
    chosen = rng.random(shape) < 0.5
    joints = np.array([j for j in range(shape[1]) if j != but])
    chosen[np.arange(shape[0]), rng.choice(joints, shape[0])] = True
    if but is not None:
        chosen[:, but] = False
    return chosen


def singular(robot: Robot, rng: np.random.Generator, count: int, joint: int, *, on_limits: bool) -> Array:
    """Return singular configurations inside the limits, up to rounding."""
    found: list[Array] = []
    for _ in range(DRAWS):
        q = robot.limits.sample(rng, 2 * count)
        if on_limits:
            q = put_on_limits(robot, rng, q, but=joint)
        q = by_one_joint(robot, rng, q, joint) if robot.n == 6 else by_all_joints(robot, q)
        good = robot.limits.contains(q) & (robot.singular_values(q)[:, -1] < RANK_LOST)
        found.append(robot.limits.clip(q[good]))
        if sum(map(len, found)) >= count:
            return np.concatenate(found)[:count]
    raise InvalidInput(
        "robot",
        f"{robot.name}, no singular configuration found",
        "an arm with singular configurations within its limits",
    )


def by_one_joint(robot: Robot, rng: np.random.Generator, q: Array, joint: int) -> Array:
    """Move one joint to a random sign change of det J; configurations without a sign change are dropped."""

    def sign(values: Array) -> NDArray[np.bool_]:
        at = q.copy()
        at[:, joint] = values
        positive: NDArray[np.bool_] = np.linalg.det(robot.jacobian(at)) > 0.0
        return positive

    low, high = robot.limits.lower[joint], robot.limits.upper[joint]
    low = low if np.isfinite(low) else min(-np.pi, high - 2.0 * np.pi)
    ticks = np.linspace(low, high if np.isfinite(high) else low + 2.0 * np.pi, DET_SAMPLES)
    signs = np.stack([sign(np.full(len(q), tick)) for tick in ticks], axis=1)
    changes = signs[:, 1:] != signs[:, :-1]
    first = (changes * rng.uniform(0.5, 1.0, changes.shape)).argmax(axis=1)
    low, high, before = ticks[first], ticks[first + 1], signs[np.arange(len(q)), first]
    for _ in range(DET_BISECTIONS):
        middle = 0.5 * (low + high)
        same = sign(middle) == before
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    moved = q.copy()
    moved[:, joint] = 0.5 * (low + high)
    changed: Array = moved[changes.any(axis=1)]
    return changed


def by_all_joints(robot: Robot, q: Array) -> Array:
    """Solve Jᵀu = 0, uᵀu = 1 for q and u by minimum-norm Gauss–Newton steps, clamped to the limits."""
    u = np.linalg.svd(robot.jacobian(q))[0][:, :, -1]
    for _ in range(RANK_STEPS):
        J = robot.jacobian(q)
        value = np.concatenate([np.einsum("kij,ki->kj", J, u), (np.sum(u * u, axis=1) - 1.0)[:, None]], axis=1)
        slope = np.zeros((len(q), robot.n + 1, robot.n + 6))
        for j in range(robot.n):
            step = np.zeros(robot.n)
            step[j] = 1e-6
            change = (robot.jacobian(q + step) - robot.jacobian(q - step)) / 2e-6
            slope[:, :-1, j] = np.einsum("kij,ki->kj", change, u)
        slope[:, :-1, robot.n :] = np.swapaxes(J, 1, 2)
        slope[:, -1, robot.n :] = 2.0 * u
        square = slope @ np.swapaxes(slope, 1, 2) + 1e-14 * np.eye(robot.n + 1)
        move = np.einsum("kji,kj->ki", slope, np.linalg.solve(square, value[..., None])[..., 0])
        move *= np.minimum(1.0, 0.5 / np.maximum(np.abs(move).max(axis=1, keepdims=True), 1e-12))
        q, u = robot.limits.clip(q - move[:, : robot.n]), u - move[:, robot.n :]
    return q


# ---------------- known solutions


REFERENCE_RESTARTS = 100
"""Restarts of `lm` for one target. On the paper's workspace 20, 50, 100 and 500 solve the same 2,733 targets of 4,305."""

MOST_BRANCHED = 6
"""Largest number of moving joints for finitely many solutions; with more, closed forms only sample them."""


class KnownSolutions(NamedTuple):
    """Known solutions of some targets."""

    q: Array  # (k, n) configurations inside the limits [rad, m]; NaN where none was found
    unreachable: Flags  # whether the bound on the arm's reach proves that there is none

    @property
    def found(self) -> Flags:
        """Whether each target (k,) has a known solution."""
        return np.asarray(np.isfinite(self.q).all(axis=1))


def known_solutions(
    robot: Robot, targets: Array, starts: Array, *, restarts: int = REFERENCE_RESTARTS
) -> KnownSolutions:
    """Find a configuration for each target: by `lm` with restarts, or else by `closed_form` among all branches.

    `lm` solves all targets as one batch, and proves those beyond the bound on the arm's reach unreachable. `closed_form`
    takes those that are left; arms with more than six moving joints, which have infinitely many branches, do without.
    """
    digests = tuple(hashlib.sha256(x.tobytes()).digest() for x in (targets, starts))
    return _solve_request(_Request((content(robot.to_dict()), digests, restarts), robot, targets, starts, restarts))


@dataclass(frozen=True)
class _Request:
    """Arguments of `known_solutions`, compared by content."""

    key: Hashable
    robot: Robot = field(compare=False)
    targets: Array = field(compare=False)
    starts: Array = field(compare=False)
    restarts: int = field(compare=False)


@lru_cache(maxsize=2)  # blocks of a suite share a set: the paper's workspace is solved once, not once for each of them
def _solve_request(asked: _Request) -> KnownSolutions:
    """Return the known solutions, cached by arguments."""
    robot, targets, starts = asked.robot, asked.targets, asked.starts
    batch = make_solver(robot, "lm", max_restarts=asked.restarts).solve_batch(targets, starts)
    q = np.where(batch.solved[:, None], batch.q, np.nan)
    unreachable: Flags = batch.status == UNREACHABLE
    left = np.flatnonzero(~batch.solved & ~unreachable)
    if len(left) and np.count_nonzero(robot.limits.lower < robot.limits.upper) <= MOST_BRANCHED:
        branches = make_solver(robot, "closed_form").solve_batch(targets[left], starts[left])
        q[left[branches.solved]] = branches.q[branches.solved]
    q.flags.writeable = unreachable.flags.writeable = False
    return KnownSolutions(q, unreachable)


def searched(
    robot: Robot, targets: Array, starts: Array, group: NDArray[np.str_], *, restarts: int = REFERENCE_RESTARTS
) -> ProblemSet:
    """Return a problem set of targets that are not reachable by construction; a search decides which are."""
    known = known_solutions(robot, targets, starts, restarts=restarts)
    sigma, found = np.full(len(targets), np.nan), known.found
    if found.any():
        sigma[found] = robot.singular_values(known.q[found])[:, -1]
    return ProblemSet(targets, starts, group, found, sigma, np.full(len(targets), np.nan), known.unreachable)
