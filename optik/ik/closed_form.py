"""All branches by closed forms (EAIK, ssik), each checked; where neither solves the arm, by a numerical enumeration."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.reach import outside_reach
from optik.arm.robot import Robot
from optik.content import content, have_equal_content
from optik.errors import InvalidInput
from optik.ik._closed import branches
from optik.ik._closed import roots as roots_of
from optik.ik._closed.backends import Refused, choose
from optik.ik._problem import check_start
from optik.ik.base import Attempt, IKSolver, IKStatus
from optik.se3 import check_pose, exp_so3, pose
from optik.types import Array, Flags

BACKENDS = ("auto", "ssik", "eaik", "enumeration")
"""Values of the option ``backend``."""

ENUMERATION = "enumeration (numerical, may be incomplete)"
"""What results and messages call an enumeration."""

ENUMERATION_STARTS = 1024
"""Starts of an enumeration at most; IDLE_STARTS ends most of them before."""

IDLE_STARTS = 60
"""An enumeration ends when so many starts in a row found no new root. A branch that a share p of the starts leads to is
then missed with probability (1 − p)^60: 5 % for p = 0.05, 0.2 % for p = 0.1."""

ENOUGH_ROOTS = 32
"""Roots of a redundant arm, which has infinitely many, that end an enumeration."""

MOST_ROOTS = 8
"""Roots that a 6R arm with a closed form has at most. Where there are fewer, some may be lost, not complex: the search
asks beside the target too, and iterates from the start. (EAIK lost the straight wrist of a stretched UR5e.)"""

BESIDE = 1e-3
"""How far targets are moved to ask a closed form beside a singularity [m, rad]."""


class Branches(NamedTuple):
    """All configurations of an arm that meet one target.

    Attributes
    ----------
    q : (k, n) array
        Inside the limits, every winding; nearest to q0 first where there was one, else in lexicographic order.
    position_error, rotation_error : (k,) array
        By our own forward kinematics [m, rad].
    free : (k,) array of bool
        Whether the branch is one point of a curve of solutions (a singular wrist, a redundant arm): the nearest to q0
        of its piece inside the limits, for a redundant arm a sample.
    backend : str
        What found them.
    complete : bool
        Whether these are all: true for a closed form away from singularities. It is not proved; every branch is checked.
    message : str
        What was done, in words.
    """

    q: Array
    position_error: Array
    rotation_error: Array
    free: Flags
    backend: str
    complete: bool
    message: str

    def __eq__(self, other: object) -> bool:
        return have_equal_content(self, other)

    def __ne__(self, other: object) -> bool:
        return not have_equal_content(self, other)

    def __hash__(self) -> int:
        return hash(content(self))


class _Found(NamedTuple):
    """Roots (k, n) and branches (m, n) of a target, which branches are points of curves, and how they were found."""

    roots: Array
    rows: Array
    free: Flags
    backend: str
    complete: bool
    steps: int
    message: str


class ClosedForm(IKSolver):
    """The branch nearest to the start, of all that a closed form gives; at singular configurations too.

    Every candidate is polished by our own kinematics and checked, near misses included; whole turns are added wherever
    limits allow. Where the Jacobian has lost rank, the closed form is asked beside the target as well, and a curve of
    solutions is followed to its point nearest to the start. Where no branch is found, restarts follow.

    A redundant arm has infinitely many: samples of them are tried, and the nearest is brought nearer along the curve.

    Parameters
    ----------
    robot : Robot
        The arm.
    backend : {"auto", "ssik", "eaik", "enumeration"}
        ``"eaik"`` solves 6R arms and smaller ones by subproblems, ``"ssik"`` 6R and 7R; ``"enumeration"`` searches from
        many starts, for any arm, and cannot know when it has all. ``"auto"`` takes the first of these that is installed
        and solves this arm. Tried on building.
    **options
        Those of `IKSolver`. ``max_iterations`` counts for one start of an enumeration. The only task is ``"pose"``.

    Raises
    ------
    MissingDependency
        A named backend is not installed; the extra ``closed-form`` installs both.
    InvalidInput
        A named backend cannot do this arm; an option out of range.
    """

    name: ClassVar[str] = "closed_form"
    takes_tasks: ClassVar[bool] = False

    def __init__(self, robot: Robot, *, backend: str = "auto", **options: Any) -> None:
        super().__init__(robot, **options)
        if backend not in BACKENDS:
            raise InvalidInput("backend", repr(backend)[:60], f"one of: {', '.join(BACKENDS)}")
        self.backend = backend
        lower, upper = robot.limits.lower, robot.limits.upper
        moving = lower < upper
        self._chain = robot.chain
        self._limits = lower, upper
        self._free = np.where(moving, -np.inf, lower), np.where(moving, np.inf, upper)
        for bound in self._free:
            bound.flags.writeable = False  # as limits are
        self._errors = self.tolerance.position, self.tolerance.rotation
        self._tight = min(self._errors[0], branches.ROOT_ERROR), min(self._errors[1], branches.ROOT_ERROR)
        self._redundant = int(moving.sum()) > 6
        self._too_many = branches.too_many(robot)
        self._closed = choose(backend, robot)
        self._label = self._closed.name if self._closed else ENUMERATION
        self._starts = robot.limits.sample(np.random.default_rng(1), ENUMERATION_STARTS)
        twists = np.random.default_rng(3).uniform(-BESIDE, BESIDE, (3, 6))
        self._nudges = [pose(exp_so3(sign * w[3:]), sign * w[:3]) for w in twists for sign in (1.0, -1.0)]

        self._load()

    def _load(self) -> None:
        """Compile or load all that a solve may need, at a pose of the arm's own."""
        q = self._starts[0]
        target = self.robot.fk(q)
        self.attempt(target, q, False, None)
        self._enumerate(target, q, False)
        branches.slide(self.robot, target, q, q, self._tight)

    @property
    def options(self) -> dict[str, Any]:
        """All options, as they would be given again."""
        return {**super().options, "backend": self.backend}

    @property
    def label(self) -> str:
        """What answers: ``"eaik"``, ``"ssik"``, or that it is a numerical enumeration."""
        return self._label

    def branches(self, target: ArrayLike, q0: ArrayLike | None = None) -> Branches:
        """Find all configurations inside the limits whose tool pose is the target.

        Parameters
        ----------
        target : (4, 4) array
            T_base_tool [1, m].
        q0 : (n,) array, optional
            Configuration inside the limits [rad, m], by default the middle of the limits. The order, the point of a curve of
            solutions, and the winding of a joint without limits are those nearest to it.

        Returns
        -------
        Branches
            Empty where there is none.

        Raises
        ------
        InvalidInput
            The target is not a pose, or the start is outside the limits.
        """
        T = np.array(check_pose(target, "target"), order="C")
        near = self.robot.limits.middle if q0 is None else check_start(self.robot, q0)
        found = self._all(T, near, self._ask(T), few=False)
        q = np.array(found.rows)
        if q0 is None:
            order = np.lexsort(np.round(q, 6).T[::-1])
        else:
            order = np.argsort(np.linalg.norm(q - near, axis=1), kind="stable")
        q = q[order]
        error = self.robot.pose_errors(q, T)
        position, rotation = np.linalg.norm(error[:, :3], axis=1), np.linalg.norm(error[:, 3:], axis=1)
        return Branches(q, position, rotation, found.free[order], found.backend, found.complete, found.message)

    def attempt(self, target: Array, start: Array, trace: bool, seconds: float | None) -> Attempt:
        """Take the branch nearest to the start."""
        # of one type whatever the caller has: kernels are compiled once
        target, start = np.ascontiguousarray(target), np.array(start)
        if self._closed is None or self._redundant:
            return self._nearest(target, start, self._all(target, start, self._ask(target), few=True))
        candidates, q = self._ask(target), np.empty(self.robot.n)
        problem = self._chain, self._free, self._limits, target, self._tight
        count, solved, doubt = roots_of.regular_answer(*problem, candidates, start, q)
        if 0 < count < MOST_ROOTS and not doubt:
            candidates = np.vstack([candidates, start, *self._beside(target, 2)])
            count, solved, doubt = roots_of.regular_answer(*problem, candidates, start, q)
        if count == 0 or doubt or (count < MOST_ROOTS and not solved):
            return self._nearest(target, start, self._all(target, start, candidates, few=True))
        status = IKStatus.SOLVED if solved else IKStatus.OUTSIDE_LIMITS
        return Attempt(q, status, 0, None, f"{self._label}: {count} branches, limits aside")

    def _nearest(self, target: Array, start: Array, found: _Found) -> Attempt:
        """Choose of all that was found."""
        if len(found.rows):
            q = found.rows[np.linalg.norm(found.rows - start, axis=1).argmin()]
            return Attempt(q.copy(), IKStatus.SOLVED, found.steps, None, found.message)
        q = start.copy()
        if len(found.roots):
            roots_of.nearest(self._chain, self._limits, found.roots, start, q)
            return Attempt(q, IKStatus.OUTSIDE_LIMITS, found.steps, None, found.message)
        q = self.robot.limits.clip(q)
        roots_of.refine(self._chain, self._limits, target, self.max_iterations, q)
        return Attempt(q, IKStatus.STALLED, found.steps, None, found.message)

    # ------------------------------------------------------------ roots

    def _ask(self, target: Array) -> Array:
        """Ask the closed form for candidates (k, n); a backend that raises yields none."""
        none = np.empty((0, self.robot.n))
        if self._closed is None:
            return none
        try:
            return self._closed.candidates(target)
        except Refused:
            return none

    def _distinct(
        self, target: Array, candidates: Array, tolerances: tuple[tuple[float, float], ...] = ()
    ) -> tuple[Array, Flags]:
        """Roots (k, n) among candidates (m, n), each once, and which of them are singular."""
        # where none meets the target to rounding (a target just out of reach), those within the tolerance
        roots, singular = np.empty_like(candidates), np.empty(len(candidates), np.bool_)
        for errors in tolerances or (self._tight, self._errors):
            count = roots_of.distinct(self._chain, self._free, target, errors, candidates, roots, singular)
            if count:
                break
        return roots[:count], singular[:count]

    def _beside(self, target: Array, times: int) -> list[Array]:
        """Candidates for targets a little beside this one: near its solutions, away from its singularity."""
        return [self._ask(target @ nudge) for nudge in self._nudges[:times]]

    def _enumerate(self, target: Array, near: Array, clamped: bool) -> tuple[Array, int]:
        """Roots (k, n) by search from many starts, free of the limits or kept inside them, and the steps it took."""
        starts = np.vstack([near, self._starts])
        roots = np.empty((ENOUGH_ROOTS, self.robot.n))
        bounds = self._limits if clamped else self._free
        steps = 0
        for errors in (self._tight, self._errors):
            count, taken = roots_of.enumerate_roots(
                self._chain, bounds, target, errors, starts, self.max_iterations, roots, IDLE_STARTS
            )
            steps += taken
            if count:
                break
        return roots[:count], steps

    # ------------------------------------------------------------ branches

    def _all(self, target: Array, near: Array, candidates: Array, *, few: bool) -> _Found:
        """Find all roots and branches of a target: by the closed form, beside the target, and by search; or a few branches."""
        roots, singular = self._distinct(target, candidates)
        told, exact = [self._label], self._closed is not None and not self._redundant
        trusted, (wide, flat) = exact and bool(len(roots) and not singular.any()), (roots, singular)
        if exact and (len(roots) < MOST_ROOTS or singular.any()):
            beside = self._beside(target, len(self._nudges))
            roots, singular = self._distinct(target, np.vstack([roots, *beside]))
            if len(roots):
                roots, singular = self._distinct(target, np.vstack([roots, near]))
            # near a singularity a closed form may have an error above rounding but within the tolerance
            wide, flat = self._distinct(target, np.vstack([roots, candidates]), (self._errors,))
            trusted = trusted and not (singular.any() or flat.any())
            told += [] if trusted else ["asked beside the target too"]
        rows, free = self._expand(target, near, roots, singular, few, self._tight)
        if exact and not (trusted or len(rows)):
            rows, free = self._expand(target, near, wide, flat, few, self._errors)
            roots = roots if len(roots) else wide
        steps, searched = 0, trusted or self._out_of_reach(target)
        for clamped in () if searched else (False, True):
            enough = self._closed is not None or (few if self._redundant else clamped)
            if (len(rows) and enough) or (self._redundant and not clamped):
                continue
            more, taken = self._enumerate(target, near, clamped)
            steps += taken
            told += [ENUMERATION] if ENUMERATION not in told else []
            roots, singular = self._distinct(target, np.vstack([roots, more]))
            rows, free = self._expand(target, near, roots, singular, few, self._tight)
            if not (
                len(rows) or self._redundant
            ):  # a search inside the limits may end within the tolerance, above rounding
                wide, flat = self._distinct(target, more, (self._errors,))
                rows, free = self._expand(target, near, wide, flat, few, self._errors)
        if self._redundant:
            told.append("samples of infinitely many")
        elif free.any():
            told.append("some are points of curves")
        backend = told[0] if len(roots) and ENUMERATION not in told else ENUMERATION
        message = f"{', '.join(told)}: {len(roots)} branches limits aside, {len(rows)} configurations inside them"
        return _Found(roots, rows, free, backend, trusted and not self._too_many, steps, message)

    def _expand(
        self, target: Array, near: Array, roots: Array, singular: Flags, few: bool, errors: tuple[float, float]
    ) -> tuple[Array, Flags]:  # fmt: skip
        """Return the windings of roots (k, n) inside the limits, a few or all: branches (m, n), and which are points of curves.

        `errors` are the tolerances within which the points of a curve meet the target.
        """
        robot, every = self.robot, np.ones(self.robot.n, dtype=np.bool_)
        plain, curved = [np.empty((0, robot.n))], np.empty((0, robot.n))
        for root, lost in zip(roots, singular, strict=True):
            if lost and not self._redundant:
                moves = branches.goes_on(robot, target, self._free, root, errors)
                if moves.any():
                    more = branches.pieces(robot, target, errors, root, moves, near, curved, few)
                    curved = np.vstack([curved, more])
                    continue
            each = 2 if few else branches.MOST_WINDINGS
            plain.append(branches.windings(robot, root, near, every, each=each))
        rows = branches.inside(robot, target, self._errors, np.vstack(plain))
        if self._redundant:
            curved, rows = np.vstack([self._nearer(target, near, roots, rows), rows]), rows[:0]
        if few and len(roots) and not len(rows) + len(curved):
            return self._expand(target, near, roots, singular, False, errors)
        curved = branches.unique(curved)
        return np.vstack([rows, curved]), np.repeat([False, True], [len(rows), len(curved)])

    def _nearer(self, target: Array, near: Array, roots: Array, rows: Array) -> Array:
        """Of a redundant arm: branches (k, n) nearer than the samples (m, n), or the first inside the limits."""
        tries = rows[np.linalg.norm(rows - near, axis=1).argsort()[:3]]
        if not len(rows):
            turned = roots + 2.0 * np.pi * np.round((near - roots) / (2.0 * np.pi)) * ~self.robot.prismatic
            out = np.abs(turned - self.robot.limits.clip(turned)).max(axis=1, initial=0.0)
            tries = turned[out.argsort()[:16]]
        slid = [branches.slide(self.robot, target, q, near, self._tight) for q in (near, *tries)]
        return branches.inside(self.robot, target, self._errors, np.array(slid).reshape(-1, self.robot.n))

    def _out_of_reach(self, target: Array) -> bool:
        return bool(outside_reach(self._reach, target, *self._errors) >= 0.0)


METHOD = ClosedForm
