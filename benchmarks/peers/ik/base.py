"""Peers of inverse kinematics: their base class and results, and the loop of those that iterate from one start."""

from __future__ import annotations

import importlib.util
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from benchmarks.peers.ik import PEERS
from benchmarks.provenance import version_here
from optik.arm.limits import JointLimits
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.registry import load_method
from optik.types import Array

FK_TOLERANCE = 1e-9
"""Largest difference between a peer's forward kinematics and optik's [m, rad]: far above rounding, far below 1e-6."""

FK_CONFIGURATIONS, FK_SEED = 5, 20261
"""Number of random configurations for this comparison, and the seed: a wrong model differs at all of them."""


class Peer(ABC):
    """An IK method of another package for one robot; its file binds the class to ``METHOD``.

    Parameters
    ----------
    robot : Robot
        The arm.
    iterations : int or None
        Largest number of iterations of a call, for comparisons at equal iterations; None for the settings that serve the
        method best. Passed only to a class with ``budgeted = True``, so others need not have the parameter.

    Attributes
    ----------
    distribution : str
        Name of its distribution, for ``pip install``.
    package : str
        Name of its package, for ``import``; imported in ``__init__`` only.
    settings : str
        How it is set up and called, for the report.
    takes_start : bool
        Whether ``call`` has the arguments (target, q0) or only (target).
    budgeted : bool
        Whether it can be built with a number of iterations.
    clocked, random : bool
        Whether a time limit of its own decides what it answers, and whether it draws random numbers whose seed the caller
        does not set: its answers differ between runs, and tables say so.
    fk_tolerance : float
        Largest difference between its forward kinematics and ours [m, rad]; larger than the default only where the method
        computes with fewer digits.
    call : callable
        The timed part, a complete call from Python.

    Raises
    ------
    ModuleNotFoundError
        Its package is not installed.
    InvalidInput
        The method does not support the arm.
    """

    distribution: ClassVar[str]
    package: ClassVar[str]
    settings: ClassVar[str]
    takes_start: ClassVar[bool] = True
    budgeted: ClassVar[bool] = False
    clocked: ClassVar[bool] = False
    random: ClassVar[bool] = False
    fk_tolerance: ClassVar[float] = FK_TOLERANCE
    call: Callable[..., Any]

    @abstractmethod
    def __init__(self, robot: Robot, *, iterations: int | None = None) -> None:
        """Prepare everything that does not depend on the target."""

    @abstractmethod
    def answers(self, raw: Any) -> Array:
        """Return the configurations of a call, none for k = 0; one correct configuration suffices. Not timed.

        Parameters
        ----------
        raw : Any
            Return value of `call`.

        Returns
        -------
        (k, n) array
            Configurations [rad, m].
        """

    def iterations(self, raw: Any) -> int | None:
        """Return the number of iterations of a call; None if the method does not report it.

        Parameters
        ----------
        raw : Any
            Return value of `call`.

        Returns
        -------
        int or None
            Number of iterations.
        """
        return None

    def claims(self, raw: Any) -> bool | None:
        """Return whether the method reports success of a call; None if it reports nothing.

        Parameters
        ----------
        raw : Any
            Return value of `call`.

        Returns
        -------
        bool or None
            Its own claim, which our forward kinematics judges.
        """
        return None

    def fk(self, q: Array) -> Array | None:
        """Return the tool pose by the method's own model; None if it has no forward kinematics.

        Parameters
        ----------
        q : (n,) array
            Configuration [rad, m].

        Returns
        -------
        (4, 4) array or None
            Pose of the tool in the base frame [1, m].
        """
        return None


class NotInstalled(Exception):
    """A peer that is not installed on this machine; the message says how to install it."""


@dataclass(frozen=True)
class Failed:
    """The failure of a call."""

    outcome: str  # raised (an exception), crashed (its process ended) or refused (it does not support the problem)
    error: str  # what it said


class Answer(NamedTuple):
    """One timed call."""

    raw: Any  # what it returned, or `Failed`
    ns: int  # its time [ns]; where its process ended, the time until then
    cpu_ns: int | None  # time of all threads of its process [ns]; None where its process ended


@dataclass(frozen=True)
class Absent:
    """A peer that is not run, and the reason."""

    why: str
    # absent: its package is missing; refused: it does not support the robot; differs: its model of the robot is not ours
    outcome: str = "absent"


def build_peer(name: str, robot: Robot, *, iterations: int | None = None) -> Peer | Absent:
    """Build a peer for a robot, and compare its forward kinematics with optik's."""
    kind = load_method(PEERS, name, "peer")
    if iterations is not None and not kind.budgeted:
        return Absent("has no limit on iterations that can be set", "refused")
    options = {} if iterations is None else {"iterations": iterations}
    try:
        peer: Peer | Absent = built_or_absent(kind, robot, **options)
    except InvalidInput as error:
        return Absent(f"does not support {robot.name}: {error.got}; supported: {error.expected}", "refused")
    if isinstance(peer, Absent):
        return peer
    return different_model(peer, robot) or peer


def different_model(peer: Peer, robot: Robot) -> Absent | None:
    """Compare the forward kinematics of a peer with optik's at random configurations inside the limits."""
    worst = np.zeros(2)
    for q in robot.limits.sample(np.random.default_rng(FK_SEED), FK_CONFIGURATIONS):
        pose = peer.fk(q.copy())
        if pose is None:
            return None
        off = np.asarray(pose, dtype=np.float64) - robot.fk(q)
        worst = np.maximum(worst, [np.linalg.norm(off[:3, 3]), np.linalg.norm(off[:3, :3])])
    if (worst <= peer.fk_tolerance).all():
        return None
    return Absent(
        f"its model differs from optik's by {worst[0]:.1e} m, and by {worst[1]:.1e} in the rotation matrix", "differs"
    )


def built_or_absent(kind: Any, *arguments: Any, **options: Any) -> Any:
    """Call a class that depends on an optional package."""
    try:
        return kind(*arguments, **options)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != kind.package:
            raise
        return Absent(f"not installed: pip install {kind.distribution}")
    except NotInstalled as error:
        return Absent(str(error))
    except ImportError as error:  # installed, but not for this machine
        return Absent(f"cannot be imported here: {error}")


def missing(kind: Any) -> str:
    """Return why a peer cannot run here, without importing it; empty if it can."""
    if hasattr(kind, "missing"):
        return str(kind.missing())
    return "" if importlib.util.find_spec(kind.package) else f"pip install {kind.distribution}"


def version_of(name: str, folder: str = PEERS) -> str | None:
    """Return the installed version of a peer."""
    kind: Any = load_method(folder, name, "peer")
    if hasattr(kind, "version"):
        found: str | None = kind.version()
        return found
    return version_here(kind.distribution)


def need_revolute(robot: Robot, least: int, most: int) -> None:
    """Raise InvalidInput unless the arm has only revolute joints, and a supported number of them."""
    wanted = f"arms of {least} to {most} revolute joints" if least < most else f"arms of {least} revolute joints"
    if robot.prismatic.any():
        raise InvalidInput("robot", f"{int(robot.prismatic.sum())} prismatic joints", wanted)
    if not least <= robot.n <= most:
        raise InvalidInput("robot", f"{robot.n} joints", wanted)


def zero_frames(robot: Robot) -> Array:
    """Return the joint frames and the tool frame at q = 0."""
    return robot.frames(np.zeros(robot.n))


def one(q: Any) -> Array:
    """Return one configuration as the result of `Peer.answers`."""
    return np.asarray(q, dtype=np.float64).reshape(1, -1)


def none(robot: Robot) -> Array:
    """Return no configuration as the result of `Peer.answers`."""
    return np.empty((0, robot.n))


METHOD_BASE = Peer
"""Base class of the METHOD of every module here, and of every plug-in."""


LOOP_ITERATIONS = 100
"""Iteration limit of a loop of differential inverse kinematics, for targets where it does not converge."""
LOOP_TOLERANCE = 7e-7
"""Bound on the norm of the pose error, so that both errors are below the 1e-6 m and rad that every method must reach."""
TASK_DAMPING = 1e-3
"""``lm_damping`` of a frame task: without it the quadratic programme of an arm with seven joints may be singular."""


class LoopPeer(Peer):
    """A peer whose call returns a configuration (n,) [rad, m], the number of iterations and whether it converged."""

    budgeted: ClassVar[bool] = True
    limits: JointLimits | None = (
        None  # to which the configuration is clamped, for a method that keeps limits to rounding
    )

    def answers(self, raw: Any) -> Array:
        """Return the last configuration of the iteration."""
        return one(raw[0] if self.limits is None else self.limits.clip(raw[0]))

    def iterations(self, raw: Any) -> int | None:
        """Return the number of iterations."""
        return int(raw[1])

    def claims(self, raw: Any) -> bool | None:
        """Say whether the method reports convergence."""
        return bool(raw[2])


def frame_task_loop(
    configuration: Any,
    task: Any,
    pose_of: Callable[[Array], Any],
    solve_ik: Callable[..., Any],
    no_solution: type[Exception],
    iterations: int | None,
    **options: Any,
) -> Callable[[Array, Array], tuple[Array, int, bool]]:
    """Return ``solve_ik(configuration, [task], dt=1)`` and ``integrate_inplace``, repeated until the task's error is small."""
    most = LOOP_ITERATIONS if iterations is None else iterations

    def call(target: Array, q0: Array) -> tuple[Array, int, bool]:
        task.set_target(pose_of(target))
        configuration.update(q0)
        for i in range(most + 1):
            converged = bool(np.linalg.norm(task.compute_error(configuration)) < LOOP_TOLERANCE)
            if converged or i == most:
                break
            try:
                velocity = solve_ik(configuration, [task], 1.0, "daqp", **options)
            except no_solution:
                break
            configuration.integrate_inplace(velocity, 1.0)
        return configuration.q.copy(), i, converged

    return call
