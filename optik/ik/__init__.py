"""Inverse kinematics: one file a method; `solve_ik` for one call, the classes for many."""

from __future__ import annotations

import os
import sys
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.content import content
from optik.errors import InvalidInput
from optik.ik._free import solve_free
from optik.ik.base import IKBatch, IKResult, IKSolver, IKStatus, Tolerance
from optik.plugins.files import is_path
from optik.registry import build_method, load_method, names, own_names

if TYPE_CHECKING:
    from optik.ik.closed_form import ClosedForm
    from optik.ik.dls import DLS
    from optik.ik.ipopt import IPOPT
    from optik.ik.lm import LM
    from optik.ik.sqp import SQP
    from optik.scene import Scene

__all__ = [
    "DLS",
    "IPOPT",
    "LM",
    "SQP",
    "ClosedForm",
    "IKBatch",
    "IKResult",
    "IKSolver",
    "IKStatus",
    "Tolerance",
    "make_solver",
    "solve_ik",
    "solve_ik_batch",
    "solvers",
]


def solvers() -> tuple[str, ...]:
    """Names of all IK methods, ours and those of installed packages; a file is a method by its path."""
    return names("optik.ik")


def make_solver(robot: Robot, solver: str | os.PathLike[str] = "lm", **options: Any) -> IKSolver:
    """Build a method for a robot, by its name or from a file that is given as a path.

    Parameters
    ----------
    robot : Robot
        The arm.
    solver : str or path
        A name from `solvers`, or a Python file such as ``"./jt.py"``, which is run.
    **options
        Those of the method.

    Returns
    -------
    IKSolver
        Built for this robot.

    Raises
    ------
    UnknownName
        No such method; the nearest names are offered.
    InvalidInput
        An option that the method does not have, or out of range; a file that is no method.
    """
    built: IKSolver = build_method("optik.ik", solver, "IK method", robot, **options)
    return built


class _Options:
    """Options of a solver as a key: two are one where their contents are, arrays and mappings among them."""

    def __init__(self, options: dict[str, Any]) -> None:
        self.given = options
        self._content = content(options)
        self._hash = hash(self._content)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Options) and self._content == other._content

    def __hash__(self) -> int:
        return self._hash


_NO_OPTIONS = _Options({})
"""The usual case, whose key need not be made anew in every call."""


class _FromFile(Exception):
    """A method was named by a path, which may mean another file in the next call: it is not kept by its name."""


@lru_cache(maxsize=64)
def _kept(robot: Robot, solver: Any, options: _Options) -> IKSolver:
    if is_path(solver):
        raise _FromFile
    return make_solver(robot, solver, **options.given)


@lru_cache(maxsize=64)
def _kept_from_file(robot: Robot, method: type[IKSolver], solver: Any, options: _Options) -> IKSolver:
    return make_solver(robot, solver, **options.given)


def solve_ik(
    robot: Robot, target: ArrayLike, q0: ArrayLike, solver: str | os.PathLike[str] = "lm",
    *, scene: Scene | None = None, **options: Any,
) -> IKResult:  # fmt: skip
    """Find a configuration whose tool pose is the target; the solver is kept per robot and options.

    Parameters
    ----------
    robot : Robot
        The arm.
    target : (4, 4) array
        T_base_tool [m].
    q0 : (n,) array
        Start, inside the limits [rad, m].
    solver : str or path
        A name from `solvers`, or a Python file such as ``"./jt.py"``, which is run.
    scene : Scene, optional
        Obstacles for an arm with shapes, and the margin to them; its links are checked too. Up to 100 other seeds are tried;
        the status is IN_CONTACT if every solution found is in contact.
    **options
        ``trace=True``, ``closest=True``, and the options of the method.

    Returns
    -------
    IKResult
        ``bool(result)`` is success, rechecked by our own forward kinematics and the limits.

    Raises
    ------
    InvalidInput
        An invalid argument; a scene with an arm without shapes, or with ``closest``.
    UnknownName
        No such method; the nearest names are offered.
    """
    trace, closest = options.pop("trace", False), options.pop("closest", False)
    if scene is not None:
        if closest:
            raise InvalidInput("closest", "True, with a scene", "one of the two: the nearest pose may touch")
        return solve_free(solver_for(robot, solver, options), target, q0, scene, trace)
    return solver_for(robot, solver, options).solve(target, q0, trace=trace, closest=closest)


def solve_ik_batch(
    robot: Robot,
    targets: ArrayLike,
    starts: ArrayLike,
    solver: str | os.PathLike[str] = "lm",
    *,
    threads: int | None = None,
    **options: Any,
) -> IKBatch:
    """Find configurations for many targets; the same answers as of `solve_ik`, field by field.

    With ``lm`` and whole poses, on all cores and many side by side; other methods solve one after the other. Beyond the
    arrays given and returned it takes a constant amount of memory, where targets and starts are contiguous float64.

    Parameters
    ----------
    robot : Robot
        The arm.
    targets : (N, 4, 4) array
        T_base_tool [m].
    starts : (N, n) or (n,) array
        Starts, inside the limits [rad, m].
    solver : str or path
        A name from `solvers`, or a Python file such as ``"./jt.py"``, which is run.
    threads : int, optional
        At most so many; by default all cores. The answers are the same for any number.
    **options
        Those of the method.

    Returns
    -------
    IKBatch
        ``batch.solved`` says which succeeded.

    Raises
    ------
    InvalidInput
        An invalid argument; of targets and starts the index of the first invalid one.
    UnknownName
        No such method; the nearest names are offered.
    """
    return solver_for(robot, solver, options).solve_batch(targets, starts, threads=threads)


def solver_for(robot: Robot, solver: str | os.PathLike[str] = "lm", options: dict[str, Any] | None = None) -> IKSolver:
    """Return the solver that `solve_ik` keeps for a robot and options; built where it is not there yet."""
    name: Any = solver
    options = options or {}
    try:
        key = _Options(options) if options else _NO_OPTIONS
        try:
            return _kept(robot, name, key)
        except _FromFile:
            return _kept_from_file(robot, load_method("optik.ik", solver, "IK method"), name, key)
    except TypeError as error:
        if "unhashable" not in str(error):
            raise
        return make_solver(robot, solver, **options)


def __getattr__(name: str) -> Any:
    """Import a method's class (``optik.ik.DLS``), or its module (``optik.ik.dls``), when it is first asked for."""
    if name.startswith("_"):
        raise AttributeError(name)
    for method in own_names("optik.ik"):
        if method.replace("_", "") == name.lower():
            found = load_method("optik.ik", method)
            if name == method:
                return sys.modules[f"optik.ik.{method}"]
            if name == found.__name__:
                return found
    raise AttributeError(f"module 'optik.ik' has no attribute {name!r}; methods: {', '.join(solvers())}")
