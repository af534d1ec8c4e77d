"""All branches by closed forms (EAIK, ssik), or by numerical enumeration for arms that neither package solves."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from optik.arm.reach import outside_reach
from optik.arm.robot import Robot
from optik.check import check_choice
from optik.errors import MissingDependency, Unsupported
from optik.ik import branches
from optik.ik.base import Attempt, IKSolver, IKStatus
from optik.ik.problem import check_start
from optik.se3 import check_pose, exp_so3, pose
from optik.types import Array, Flags, compare_by_content

# ---------------- closed forms of other packages behind one interface: from a pose to candidates

# Both packages describe an arm by the axes and offsets of its joints at one configuration (product of exponentials: Murray,
# Li and Sastry, A Mathematical Introduction to Robotic Manipulation, §3.2; in the form of Elias and Wen, IK-Geo, 2022):
# T(q) = Π Trans(P_i) Rot(H_i, q_i) · Trans(P_m) · Rot(R0). Locked joints are part of the offsets.


EXTRA = "closed-form"
"""Extra of this package that installs the other packages."""
Solve = Callable[[Array], Any]
"""Function from the tool pose (4, 4) times R0ᵀ to candidates (k, m) of the m moving joints."""


class BackendError(Exception):
    """Failure of another package with an arm or a pose; `closed_form` handles it."""


class Axes(NamedTuple):
    """Axes and offsets of an arm's moving joints in the base frame, with these joints at zero.

    H (m, 3) holds unit axes; P (m + 1, 3) [m] offsets from the base to the first axis, from axis to axis, and to the tool; R0
    (3, 3) is the rotation of the tool; `home` (n,) holds the locked joints at their values, and `moving` the others' indices.
    """

    H: Array
    P: Array
    R0: Array
    home: Array
    moving: NDArray[np.intp]

    @classmethod
    def from_robot(cls, robot: Robot) -> Axes:
        """Return the axes and offsets of a robot."""
        lower, upper = robot.limits.lower, robot.limits.upper
        moving = np.flatnonzero(lower < upper)
        rest = np.where(lower < upper, 0.0, lower)
        frame = robot.frames(rest)
        points = np.vstack([frame[moving, :3, 3], frame[-1, :3, 3]])
        P = np.vstack([points[:1], np.diff(points, axis=0)])
        return cls(np.ascontiguousarray(frame[moving, :3, 2]), P, frame[-1, :3, :3].copy(), rest, moving)


class Backend:
    """Closed form of another package, built for a robot."""

    def __init__(self, name: str, robot: Robot) -> None:
        if robot.linkage is not None:
            raise BackendError("a linkage")
        self.name = name
        self._axes = Axes.from_robot(robot)
        self._inverse_tool_rotation = pose(self._axes.R0.T)
        if robot.prismatic[self._axes.moving].any():
            raise BackendError("it supports revolute joints only")
        try:
            self._solve: Solve = {"ssik": _build_ssik, "eaik": _build_eaik}[name](self._axes)
        except ImportError as error:
            raise MissingDependency(name, f"IK method 'closed_form' with backend {name!r}", EXTRA) from error
        except BackendError:
            raise
        except Exception as error:  # whatever another package raises
            raise BackendError(f"{type(error).__name__}: {error}") from error
        self._verify(robot)

    def candidates(self, target: Array) -> Array:
        """Return the configurations (k, n) of the closed form for a pose, neither verified nor inside the limits."""
        axes = self._axes
        try:
            found = np.array(self._solve(target @ self._inverse_tool_rotation), dtype=np.float64, order="C").reshape(
                -1, axes.moving.size
            )
        except Exception as error:  # whatever another package raises
            raise BackendError(f"{type(error).__name__}: {error}") from error
        if axes.moving.size == axes.home.size:
            return found
        q = np.tile(axes.home, (len(found), 1))
        q[:, axes.moving] = found
        return q

    def _verify(self, robot: Robot) -> None:
        """Check that the backend finds the configurations of some poses; the first solve also completes lazy imports."""
        for q in robot.limits.sample(np.random.default_rng(2), 4):
            target = robot.fk(q)
            found = self.candidates(target)
            found = found[np.isfinite(found).all(axis=1)]
            right = np.abs(robot.pose_errors(found, target)).max(axis=1, initial=0.0) < 1e-6
            if not right.any():
                raise BackendError("it solves none of the tested poses")
            turns = np.abs((found[right] - q + np.pi) % (2.0 * np.pi) - np.pi).max(axis=1)
            if self._axes.moving.size <= 6 and turns.min() > 1e-4:
                raise BackendError("it misses the configuration from which a tested pose was computed")


def build_backend(name: str, robot: Robot) -> Backend | None:
    """Return the named backend, for ``"auto"`` the first that is installed and supports the arm, None for enumeration."""
    if name == "enumeration" or (name == "auto" and robot.linkage is not None):
        return None
    if name != "auto":
        try:
            return Backend(name, robot)
        except BackendError as error:
            works = "'auto' (the first closed form that supports this arm) or 'enumeration' (numerical, any arm)"
            raise Unsupported("backend", f"{name!r}, which does not support {robot.name}: {error}", works) from error
    for known in ("eaik", "ssik"):
        try:
            return Backend(known, robot)
        except (MissingDependency, BackendError):
            continue
    return None


def _build_eaik(axes: Axes) -> Solve:
    """Build the solver of EAIK (Ostermeier, Külz and Althoff, 2025): subproblem decomposition of up to six joints.

    Its results include least-squares solutions. At a singularity true branches degrade to these, so they are candidates
    too. For some arms it reports a known decomposition but has none; their kinematic family contains "Unknown".
    """
    from eaik.IK_HP import HPRobot

    arm = HPRobot(axes.H, axes.P)
    family = str(arm.getKinematicFamily())
    if "Unknown" in family or not arm.hasKnownDecomposition():
        raise BackendError(f"EAIK has no decomposition of it ({family})")
    return lambda T: arm.IK(T).Q


def _build_ssik(axes: Axes) -> Solve:
    """Build the solver of ssik (Srinivasa, 2026): subproblems for 6R, samples of the redundant joint for 7R.

    Only its closed forms are used. Its general elimination takes minutes to build, and its results for a general 6R arm
    were wrong (8.2.0); its joint locking for 7R takes seconds per solve. The compiled 6R solver is called as in the files
    that ``ssik build`` writes.
    """
    import ssik

    arm = ssik.Manipulator.from_axes(axes.H, axes.P)
    if arm.dispatch_plan.tier != 0:
        raise BackendError(f"ssik has no closed form of it ({arm.solver_name})")
    native = _load_ssik_native(arm)

    def solve(T: Array) -> Any:
        with np.errstate(all="ignore"):
            solutions = native(T) if native else None
            if solutions is None:
                solutions = arm.solve(T, respect_limits=False, enumerate_windings=False, allow_rescue=False)
        return [solution.q for solution in solutions]

    return solve


def _load_ssik_native(arm: Any) -> Solve | None:
    """Return ssik's compiled solver, 30 times as fast as its Python one, or None if it is not available."""
    try:
        from ssik._native import try_native_solve
    except ImportError:
        return None

    def solve(T: Array) -> Any:
        return try_native_solve(
            arm.solver_name, arm.kinbody, T, respect_limits=False, enumerate_windings=False, allow_rescue=False
        )

    return solve


# ---------------- all branches of a target


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
        self.backend = check_choice(backend, "backend", BACKENDS)
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
        search = self._find_all(T, near, self._find_candidates(T), few=False)
        q = np.array(search.rows)
        if q0 is None:
            order = np.lexsort(np.round(q, 6).T[::-1])
        else:
            order = np.argsort(np.linalg.norm(q - near, axis=1), kind="stable")
        q = q[order]
        error = self.robot.pose_errors(q, T)
        position, rotation = np.linalg.norm(error[:, :3], axis=1), np.linalg.norm(error[:, 3:], axis=1)
        return Branches(q, position, rotation, search.free[order], search.backend, search.complete, search.message)

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
