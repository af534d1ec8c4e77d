"""All branches by closed forms (EAIK, ssik), or by numerical enumeration for arms that neither package solves."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.reach import outside_reach
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.ik.analytic import branches
from optik.ik.analytic.backends import BackendError, build_backend
from optik.ik.base import Attempt, IKSolver, IKStatus
from optik.ik.problem import check_start
from optik.se3 import check_pose, exp_so3, pose
from optik.types import Array, Flags, compare_by_content

BACKENDS = ("auto", "ssik", "eaik", "enumeration")
"""Values of the option ``backend``."""
ENUMERATION = "enumeration (numerical, may be incomplete)"
"""Name of an enumeration in results and messages."""
ENUMERATION_SEEDS = 1024
"""Largest number of seeds of an enumeration; most end earlier by IDLE_SEEDS."""
IDLE_SEEDS = 60
"""An enumeration ends after this number of consecutive seeds without a new root. It misses a branch that a fraction p of the
seeds leads to with probability (1 − p)^60: 5 % for p = 0.05, 0.2 % for p = 0.1."""
ENOUGH_ROOTS = 32
"""Number of roots that ends an enumeration: a redundant arm has infinitely many."""
MOST_ROOTS = 8
"""Largest number of roots of a 6R arm with a closed form. If there are fewer, some may be lost instead of complex: the search
then also solves for perturbed targets and iterates from `q0`. (EAIK lost the straight wrist of a stretched UR5e.)"""
PERTURBATION = 1e-3
"""Size of the perturbations of targets near a singularity [m, rad]."""


@compare_by_content
class Branches(NamedTuple):
    """Configurations of an arm that meet one target.

    Attributes
    ----------
    q : (k, n) array
        Configurations inside the limits, with all 2π-multiples; nearest to q0 first, or in lexicographic order without q0.
    position_error, rotation_error : (k,) array
        Errors by our own forward kinematics [m, rad].
    free : (k,) array of bool
        Whether the branch is one point of a curve of solutions (a singular wrist, a redundant arm): the point nearest to
        q0 of each piece inside the limits, or a sample for a redundant arm.
    backend : str
        Name of the backend that found them.
    complete : bool
        Whether these are all branches: true for a closed form away from singularities. Every branch is verified, but
        completeness is not proved.
    message : str
        Description of the search in words.
    """

    q: Array
    position_error: Array
    rotation_error: Array
    free: Flags
    backend: str
    complete: bool
    message: str


class _BranchSearch(NamedTuple):
    """Roots (k, n) and branches (m, n) of a target; `free` marks branches that are points of curves."""

    roots: Array
    rows: Array
    free: Flags
    backend: str
    complete: bool
    steps: int
    message: str


class ClosedForm(IKSolver):
    """Inverse kinematics by closed forms: the branch nearest to `q0`, or all branches.

    Our own Newton iteration polishes every candidate of the closed form, near misses included, and our own kinematics
    verify it. Multiples of 2π are added within the limits. At a singular configuration the closed form also solves for
    perturbed targets, and a curve of solutions is followed to its point nearest to `q0`. If there is no branch, restarts
    follow.

    A redundant arm has infinitely many solutions: samples are compared, and the nearest ones slide along their curves
    towards `q0`.

    Parameters
    ----------
    robot : Robot
        The arm.
    backend : {"auto", "ssik", "eaik", "enumeration"}
        ``"eaik"`` solves arms of up to 6 revolute joints by subproblems, ``"ssik"`` 6R and 7R arms. ``"enumeration"``
        searches from many seeds, for any arm, and may miss branches. ``"auto"`` is the first of these that is installed
        and solves some poses of this arm.
    **options
        Options of `IKSolver`. ``max_iterations`` limits one seed of an enumeration. The only task is ``"pose"``.

    Raises
    ------
    MissingDependency
        A named backend is not installed; the extra ``closed-form`` installs both.
    InvalidInput
        A named backend does not support this arm, or an option is out of range.
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
            bound.flags.writeable = False  # as those of the limits: kernels are compiled once
        self._errors = self.tolerance.position, self.tolerance.rotation
        self._tight = min(self._errors[0], branches.ROOT_ERROR), min(self._errors[1], branches.ROOT_ERROR)
        self._redundant = int(moving.sum()) > 6
        self._too_many = branches.has_too_many_windings(robot)
        self._backend = build_backend(backend, robot)
        self.label = self._backend.name if self._backend else ENUMERATION
        self._starts = robot.limits.sample(np.random.default_rng(1), ENUMERATION_SEEDS)
        twists = np.random.default_rng(3).uniform(-PERTURBATION, PERTURBATION, (3, 6))
        self._nudges = [pose(exp_so3(sign * w[3:]), sign * w[:3]) for w in twists for sign in (1.0, -1.0)]

        self._load()

    def _load(self) -> None:
        """Compile or load all kernels of a solve."""
        q = self._starts[0]
        target = self.robot.fk(q)
        self.attempt(target, q, False, None)
        self._enumerate(target, q, False)
        branches.slide(self.robot, target, q, q, self._tight)

    def branches(self, target: ArrayLike, q0: ArrayLike | None = None) -> Branches:
        """Find all configurations inside the limits whose tool pose is the target.

        Parameters
        ----------
        target : (4, 4) array
            T_base_tool [1, m].
        q0 : (n,) array, optional
            Configuration inside the limits [rad, m], by default the middle of the limits. It determines the order, the
            points on curves of solutions, and the 2π-multiple of a joint without limits.

        Returns
        -------
        Branches
            Empty if there is no branch.

        Raises
        ------
        InvalidInput
            The target is not a pose, or q0 is outside the limits.
        """
        T = np.array(check_pose(target, "target"), order="C")
        near = self.robot.limits.middle if q0 is None else check_start(self.robot, q0)
        found = self._find_all(T, near, self._find_candidates(T), few=False)
        q = np.array(found.rows)
        if q0 is None:
            order = np.lexsort(np.round(q, 6).T[::-1])
        else:
            order = np.argsort(np.linalg.norm(q - near, axis=1), kind="stable")
        q = q[order]
        error = self.robot.pose_errors(q, T)
        position, rotation = np.linalg.norm(error[:, :3], axis=1), np.linalg.norm(error[:, 3:], axis=1)
        return Branches(q, position, rotation, found.free[order], found.backend, found.complete, found.message)

    def attempt(self, target: Array, start: Array, trace: bool, time_limit: float | None) -> Attempt:
        """Return the branch nearest to the initial guess."""
        # contiguous and writeable: kernels are compiled once
        target, start = np.ascontiguousarray(target), np.array(start)
        if self._backend is None or self._redundant or self.robot.motors is not None:
            return self._choose_nearest(
                target, start, self._find_all(target, start, self._find_candidates(target), few=True)
            )
        candidates, q = self._find_candidates(target), np.empty(self.robot.n)
        problem = self._chain, self._free, self._limits, target, self._tight
        count, solved, doubt = branches.find_nearest_branch(*problem, candidates, start, q)
        if 0 < count < MOST_ROOTS and not doubt:
            candidates = np.vstack([candidates, start, *self._find_candidates_beside(target, 2)])
            count, solved, doubt = branches.find_nearest_branch(*problem, candidates, start, q)
        if count == 0 or doubt or (count < MOST_ROOTS and not solved):
            return self._choose_nearest(target, start, self._find_all(target, start, candidates, few=True))
        status = IKStatus.SOLVED if solved else IKStatus.OUTSIDE_LIMITS
        return Attempt(q, status, 0, None, f"{self.label}: {count} branches without limits")

    def _choose_nearest(self, target: Array, start: Array, found: _BranchSearch) -> Attempt:
        """Return the branch nearest to the initial guess, or the best configuration if there is none."""
        if len(found.rows):
            q = found.rows[np.linalg.norm(found.rows - start, axis=1).argmin()]
            return Attempt(q.copy(), IKStatus.SOLVED, found.steps, None, found.message)
        q = start.copy()
        if len(found.roots):
            branches.choose_nearest(self._chain, self._limits, found.roots, start, q)
            return Attempt(q, IKStatus.OUTSIDE_LIMITS, found.steps, None, found.message)
        q = self.robot.limits.clip(q)
        branches.refine_root(self._chain, self._limits, target, self.max_iterations, q)
        return Attempt(q, IKStatus.STALLED, found.steps, None, found.message)

    # ------------------------------------------------------------ roots

    def _find_candidates(self, target: Array) -> Array:
        """Return the candidates (k, n) of the closed form, or none if the backend raises."""
        none = np.empty((0, self.robot.n))
        if self._backend is None:
            return none
        try:
            return self._backend.candidates(target)
        except BackendError:
            return none

    def _find_distinct(
        self, target: Array, candidates: Array, tolerances: tuple[tuple[float, float], ...] = ()
    ) -> tuple[Array, Flags]:
        """Return the distinct roots (k, n) among candidates (m, n), and which of them are singular."""
        # if none meets the target to rounding (a target just out of reach), those within the tolerance
        roots, singular = np.empty_like(candidates), np.empty(len(candidates), np.bool_)
        for errors in tolerances or (self._tight, self._errors):
            count = branches.find_distinct(self._chain, self._free, target, errors, candidates, roots, singular)
            if count:
                break
        return roots[:count], singular[:count]

    def _find_candidates_beside(self, target: Array, times: int) -> list[Array]:
        """Return candidates for perturbed targets, which are near the solutions and away from the singularity."""
        return [self._find_candidates(target @ nudge) for nudge in self._nudges[:times]]

    def _enumerate(self, target: Array, near: Array, clamped: bool) -> tuple[Array, int]:
        """Return the solutions (k, n) that Newton steps find from many seeds, inside the limits or not, and the step count."""
        starts = np.vstack([near, self._starts])
        roots = np.empty((ENOUGH_ROOTS, self.robot.n))
        bounds = self._limits if clamped else self._free
        steps = 0
        for errors in (self._tight, self._errors):
            count, taken = branches.enumerate_roots(
                self._chain, bounds, target, errors, starts, self.max_iterations, roots, IDLE_SEEDS
            )
            steps += taken
            if count:
                break
        return roots[:count], steps

    # ------------------------------------------------------------ branches

    def _find_all(self, target: Array, near: Array, candidates: Array, *, few: bool) -> _BranchSearch:
        """Find the roots and branches of a target by the closed form, by perturbed targets, and by enumeration.

        With `few` only some of the branches are returned. `candidates` (k, n) are those of the closed form.
        """
        roots, singular = self._find_distinct(target, candidates)
        told, exact = [self.label], self._backend is not None and not self._redundant
        trusted, (wide, flat) = exact and bool(len(roots) and not singular.any()), (roots, singular)
        if exact and (len(roots) < MOST_ROOTS or singular.any()):
            beside = self._find_candidates_beside(target, len(self._nudges))
            roots, singular = self._find_distinct(target, np.vstack([roots, *beside]))
            if len(roots):
                roots, singular = self._find_distinct(target, np.vstack([roots, near]))
            # near a singularity a closed form may have errors above rounding but within the tolerance
            wide, flat = self._find_distinct(target, np.vstack([roots, candidates]), (self._errors,))
            trusted = trusted and not (singular.any() or flat.any())
            told += [] if trusted else ["perturbed targets"]
        rows, free = self._expand(target, near, roots, singular, few, self._tight)
        if exact and not (trusted or len(rows)):
            rows, free = self._expand(target, near, wide, flat, few, self._errors)
            roots = roots if len(roots) else wide
        steps, searched = 0, trusted or self._is_out_of_reach(target)
        for clamped in () if searched else (False, True):
            enough = self._backend is not None or (few if self._redundant else clamped)
            if (len(rows) and enough) or (self._redundant and not clamped):
                continue
            more, taken = self._enumerate(target, near, clamped)
            steps += taken
            told += [ENUMERATION] if ENUMERATION not in told else []
            roots, singular = self._find_distinct(target, np.vstack([roots, more]))
            rows, free = self._expand(target, near, roots, singular, few, self._tight)
            # A search inside the limits may end within the tolerance, above rounding.
            if not (len(rows) or self._redundant):
                wide, flat = self._find_distinct(target, more, (self._errors,))
                rows, free = self._expand(target, near, wide, flat, few, self._errors)
        if self._redundant:
            told.append("samples of infinitely many")
        elif free.any():
            told.append("some are points of curves")
        backend = told[0] if len(roots) and ENUMERATION not in told else ENUMERATION
        message = f"{', '.join(told)}: {len(roots)} branches without limits, {len(rows)} configurations inside them"
        return _BranchSearch(roots, rows, free, backend, trusted and not self._too_many, steps, message)

    def _expand(
        self, target: Array, near: Array, roots: Array, singular: Flags, few: bool, errors: tuple[float, float]
    ) -> tuple[Array, Flags]:  # fmt: skip
        """Return the branches (m, n) of roots (k, n) with 2π-multiples inside the limits, and which are points of curves.

        `errors` is the tolerance of points of curves; with `few` only some branches are returned.
        """
        robot, every = self.robot, np.ones(self.robot.n, dtype=np.bool_)
        plain, curved = [np.empty((0, robot.n))], np.empty((0, robot.n))
        for root, lost in zip(roots, singular, strict=True):
            if lost and not self._redundant:
                moves = branches.find_curve_joints(robot, target, self._free, root, errors)
                if moves.any():
                    more = branches.find_curve_points(robot, target, errors, root, moves, near, curved, few)
                    curved = np.vstack([curved, more])
                    continue
            each = 2 if few else branches.MOST_WINDINGS
            plain.append(branches.windings(robot, root, near, every, each=each))
        rows = branches.select_inside(robot, target, self._errors, np.vstack(plain))
        if self._redundant:
            curved, rows = np.vstack([self._slide_nearer(target, near, roots, rows), rows]), rows[:0]
        if few and len(roots) and not len(rows) + len(curved):
            return self._expand(target, near, roots, singular, False, errors)
        curved = branches.unique(curved)
        return np.vstack([rows, curved]), np.repeat([False, True], [len(rows), len(curved)])

    def _slide_nearer(self, target: Array, near: Array, roots: Array, rows: Array) -> Array:
        """Return branches (k, n) of a redundant arm that are nearer than its samples (m, n), or inside the limits at all."""
        tries = rows[np.linalg.norm(rows - near, axis=1).argsort()[:3]]
        if not len(rows):
            turned = roots + 2.0 * np.pi * np.round((near - roots) / (2.0 * np.pi)) * self.robot.turning
            out = np.abs(turned - self.robot.limits.clip(turned)).max(axis=1, initial=0.0)
            tries = turned[out.argsort()[:16]]
        slid = [branches.slide(self.robot, target, q, near, self._tight) for q in (near, *tries)]
        return branches.select_inside(self.robot, target, self._errors, np.array(slid).reshape(-1, self.robot.n))

    def _is_out_of_reach(self, target: Array) -> bool:
        """Return whether the target is proved to be out of reach."""
        return bool(outside_reach(self._reach, target, *self._errors) >= 0.0)


METHOD = ClosedForm
