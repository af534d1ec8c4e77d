"""Inverse kinematics: one module per method, `solve_ik` for single calls, and the solver classes."""

from __future__ import annotations

import os
import sys
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeAlias

from numpy.typing import ArrayLike

from optik.arm.plain import describe_difference
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.ik.base import IKBatch, IKResult, IKSolver, IKStatus, Tolerance
from optik.ik.problem import check_problem, sample_restart
from optik.plugins.files import is_path
from optik.registry import build_method, load_method, names, own_names
from optik.scene import Scene
from optik.scene.contact import Contact, check_scene, find_contact
from optik.types import content

if TYPE_CHECKING:
    from optik.ik.closed_form import ClosedForm
    from optik.ik.dls import DLS
    from optik.ik.ipopt import IPOPT
    from optik.ik.lm import LM
    from optik.ik.sqp import SQP

SolverLike: TypeAlias = str | os.PathLike[str] | type[IKSolver] | IKSolver
"""An IK method: its name, file or class, or a solver that is built for the arm."""

__all__ = [
    "DLS", "IPOPT", "LM", "SQP", "ClosedForm", "IKBatch", "IKResult", "IKSolver", "IKStatus", "SolverLike",
    "Tolerance", "make_solver", "solve_ik", "solve_ik_batch", "solvers",
]  # fmt: skip


COLLISION_FREE_SEEDS = 100
"""Least number of additional initial guesses. A call of `lm` takes microseconds, and a 6R arm usually has eight branches."""


def solvers() -> tuple[str, ...]:
    """Return the names of all IK methods: ours and those of installed packages."""
    return names("optik.ik")


def make_solver(robot: Robot, solver: SolverLike = "lm", **options: Any) -> IKSolver:
    """Build a solver for a robot from the name of a method, the path of a Python file, or a class.

    Parameters
    ----------
    robot : Robot
        The arm.
    solver : str, path, type or IKSolver
        A name from `solvers`, a Python file such as ``"./jt.py"``, which is run, a class, or a solver of this robot.
    **options
        Options of the method.

    Returns
    -------
    IKSolver

    Raises
    ------
    UnknownName
        No such method; the error lists similar names.
    InvalidInput
        An unknown or invalid option, or a file that defines no method.
    """
    if isinstance(solver, str | os.PathLike | type):
        built: IKSolver = build_method("optik.ik", solver, "IK method", robot, **options)
        return built
    if not isinstance(solver, IKSolver):
        raise InvalidInput("solver", repr(solver)[:60], "a name, a file, or a class or object of IKSolver")
    if solver.robot != robot:
        other = f"a solver built for {solver.robot.name}, which differs in {describe_difference(solver.robot, robot)}"
        raise InvalidInput("solver", other, f"one built for this {robot.name}")
    return solver.with_options(**options) if options else solver


class _Options:
    """Options of a solver as a dictionary key, compared by the contents of arrays and mappings."""

    def __init__(self, options: dict[str, Any]) -> None:
        self.given = options
        self._content = content(options)
        self._hash = hash(self._content)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Options) and self._content == other._content

    def __hash__(self) -> int:
        return self._hash


_NO_OPTIONS = _Options({})
"""Key of a call without options, the most frequent one."""


class _MethodFile(Exception):
    """A method given as a path. The path may mean another file in the next call, so it is no key."""


@lru_cache(maxsize=64)
def _get_cached(robot: Robot, solver: Any, options: _Options) -> IKSolver:
    if is_path(solver):
        raise _MethodFile
    return make_solver(robot, solver, **options.given)


@lru_cache(maxsize=64)
def _get_cached_from_file(robot: Robot, method: type[IKSolver], solver: Any, options: _Options) -> IKSolver:
    return make_solver(robot, solver, **options.given)


def solve_ik(
    robot: Robot, target: ArrayLike, q0: ArrayLike, solver: SolverLike = "lm",
    *, scene: Scene | None = None, **options: Any,
) -> IKResult:  # fmt: skip
    """Find a configuration whose tool pose is the target; the solver is cached per robot and options.

    Parameters
    ----------
    robot, solver
        As of `make_solver`.
    target : (4, 4) array
        T_base_tool [m].
    q0 : (n,) array
        Initial guess inside the limits [rad, m].
    scene : Scene, optional
        Obstacles, and the least distance between the arm and them. The solution is collision-free, self-collisions included;
        the arm must have shapes. At least 100 more initial guesses are tried. If every solution found collides, the status
        is IN_CONTACT.
    **options
        ``trace=True``, ``closest=True``, and the options of the method.

    Returns
    -------
    IKResult
        ``bool(result)`` is success, verified by our own forward kinematics and the limits.

    Raises
    ------
    InvalidInput
        An invalid argument; a scene with an arm without shapes, or with ``closest``.
    UnknownName
        No such method; the error lists similar names.
    """
    trace, closest = options.pop("trace", False), options.pop("closest", False)
    if scene is not None:
        if closest:
            raise InvalidInput("closest", "True with a scene", "one of the two: the nearest pose may collide")
        return _solve_collision_free(get_solver(robot, solver, options), target, q0, scene, trace)
    return get_solver(robot, solver, options).solve(target, q0, trace=trace, closest=closest)


def _solve_collision_free(solver: IKSolver, target: ArrayLike, q0: ArrayLike, scene: Scene, trace: bool) -> IKResult:
    """Find a configuration whose tool pose is the target and which collides neither with a scene nor with itself."""
    robot = solver.robot
    check_scene(robot, scene)
    first = best = solver.solve(target, q0, trace=trace)
    pose, start = check_problem(robot, target, q0)
    iterations, solutions, least = 0, 0, Contact(-float("inf"), 0.0, ("", ""))
    for restart in range(max(COLLISION_FREE_SEEDS, solver.max_restarts) + 1):
        again = sample_restart(robot, pose, start, restart) if restart else start
        result = solver.solve(pose, again, trace=trace) if restart else first
        iterations += result.iterations
        if not result:
            if result.status is IKStatus.UNREACHABLE:
                break
            continue
        near = find_contact(robot, scene, result.q)
        if near.room > 0.0:
            return result._replace(iterations=iterations, restarts=max(restart, result.restarts))
        solutions += 1
        if near.room > least.room:
            best, least = result, near
    if not solutions:
        return first
    one, other = least.pair
    gap = f"the best has {1e3 * least.distance:.3g} mm between {one} and {other}"
    words = f"all {solutions} solutions found are closer than the margin or in contact; {gap}"
    return best._replace(status=IKStatus.IN_CONTACT, iterations=iterations, message=words)


def solve_ik_batch(
    robot: Robot, targets: ArrayLike, starts: ArrayLike, solver: SolverLike = "lm", *, threads: int | None = None,
    **options: Any,
) -> IKBatch:  # fmt: skip
    """Find configurations for many targets, with the same results as `solve_ik`.

    ``lm`` with complete poses uses all cores and vector instructions; other methods solve one target after another. If
    targets and starts are contiguous float64, the memory besides arguments and results is constant.

    Parameters
    ----------
    robot : Robot
        The arm.
    targets : (N, 4, 4) array
        T_base_tool [m].
    starts : (N, n) or (n,) array
        Initial guesses inside the limits [rad, m].
    threads : int, optional
        Largest number of threads, by default the number of cores. The results do not depend on it.
    solver, **options
        As of `make_solver`.

    Returns
    -------
    IKBatch
        ``batch.solved`` marks the successes.

    Raises
    ------
    InvalidInput
        An invalid argument, with the index of the first invalid target or initial guess.
    UnknownName
        No such method; the error lists similar names.
    """
    return get_solver(robot, solver, options).solve_batch(targets, starts, threads=threads)


def get_solver(robot: Robot, solver: SolverLike = "lm", options: dict[str, Any] | None = None) -> IKSolver:
    """Return the solver that `solve_ik` caches for a robot and options; build it on the first call."""
    name: Any = solver
    options = options or {}
    if isinstance(solver, IKSolver):
        return make_solver(robot, solver, **options)
    try:
        key = _Options(options) if options else _NO_OPTIONS
        try:
            return _get_cached(robot, name, key)
        except _MethodFile:
            return _get_cached_from_file(robot, load_method("optik.ik", solver, "IK method"), name, key)
    except TypeError as error:
        if "unhashable" not in str(error):
            raise
        return make_solver(robot, solver, **options)


def __getattr__(name: str) -> Any:
    """Import a method's class (``optik.ik.DLS``) or module (``optik.ik.dls``) on first access."""
    if name.startswith("_"):
        raise AttributeError(name)
    for method in own_names("optik.ik"):
        if method.replace("_", "") == name.lower():
            loaded = load_method("optik.ik", method)
            if name == method:
                return sys.modules[f"optik.ik.{method}"]
            if name == loaded.__name__:
                return loaded
    raise AttributeError(f"module 'optik.ik' has no attribute {name!r}; methods: {', '.join(solvers())}")
