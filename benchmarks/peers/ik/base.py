"""Peers of inverse kinematics: their base class, and the loop of those that iterate from one start."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from benchmarks.peers.base import Absent, Failed, Peer
from benchmarks.peers.models import urdf
from benchmarks.peers.worker import WorkerPeer
from optik.arm.limits import JointLimits
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.types import Array

FK_TOLERANCE = 1e-9
"""Largest difference between a peer's forward kinematics and optik's [m, rad]: far above rounding, far below 1e-6."""

FK_CONFIGURATIONS, FK_SEED = 5, 20261
"""Number of random configurations for this comparison, and the seed: a wrong model differs at all of them."""


class Solutions(NamedTuple):
    """What a call answered: configurations, and what the method reports; None where it does not say."""

    q: Array  # (k, n) [rad, m], none for k = 0
    claimed: bool | None = None  # whether it says that it succeeded, which our forward kinematics judges
    iterations: int | None = None
    restarts: int | None = None


class SolverPeer(Peer):
    """An IK method of another package for one robot.

    Parameters
    ----------
    robot : Robot
        The arm.
    iterations : int or None
        Largest number of iterations of a call, for comparisons at equal iterations; None for the settings that serve the
        method best. Passed only to a class with ``budgeted = True``, so others need not have the parameter.

    Attributes
    ----------
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

    Raises
    ------
    InvalidInput
        The method does not support the arm.
    """

    takes_start: ClassVar[bool] = True
    budgeted: ClassVar[bool] = False
    clocked: ClassVar[bool] = False
    random: ClassVar[bool] = False
    fk_tolerance: ClassVar[float] = FK_TOLERANCE

    @abstractmethod
    def __init__(self, robot: Robot, *, iterations: int | None = None) -> None:
        """Prepare everything that does not depend on the target."""

    @abstractmethod
    def read(self, raw: Any) -> Solutions:
        """Return what a call answered; one correct configuration suffices. Not timed.

        Parameters
        ----------
        raw : Any
            Return value of `call`.

        Returns
        -------
        Solutions
            Configurations, and what the method reports.
        """

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

    @classmethod
    def facts(cls, **options: Any) -> dict[str, Any]:
        """Return the facts for the report, with the limit on iterations if there is one."""
        words = f"at most {options['iterations']:,} iterations; otherwise {cls.settings}" if options else cls.settings
        return super().facts() | {"settings": words, "clocked": cls.clocked, "random": cls.random}

    @classmethod
    def build(cls, given: Robot, **options: Any) -> Self:
        """Build it for a robot, and compare its forward kinematics with optik's; raise `Absent` if it cannot be run."""
        if options and not cls.budgeted:
            raise Absent("has no limit on iterations that can be set", "refused")
        try:
            peer = super().build(given, **options)
        except InvalidInput as error:
            raise Absent(
                f"does not support {given.name}: {error.got}; supported: {error.expected}", "refused"
            ) from None
        worst = np.zeros(2)
        for q in given.limits.sample(np.random.default_rng(FK_SEED), FK_CONFIGURATIONS):
            pose = peer.fk(q.copy())
            if pose is None:
                return peer
            off = np.asarray(pose, dtype=np.float64) - given.fk(q)
            worst = np.maximum(worst, [np.linalg.norm(off[:3, 3]), np.linalg.norm(off[:3, :3])])
        if not (worst <= cls.fk_tolerance).all():
            words = f"by {worst[0]:.1e} m, and by {worst[1]:.1e} in the rotation matrix"
            raise Absent(f"its model differs from optik's {words}", "differs")
        return peer


def need_revolute(robot: Robot, least: int, most: int) -> None:
    """Raise InvalidInput unless the arm has only revolute joints, and a supported number of them."""
    wanted = f"arms of {least} to {most} revolute joints" if least < most else f"arms of {least} revolute joints"
    if robot.prismatic.any():
        raise InvalidInput("robot", f"{int(robot.prismatic.sum())} prismatic joints", wanted)
    if not least <= robot.n <= most:
        raise InvalidInput("robot", f"{robot.n} joints", wanted)


def one(q: Any) -> Array:
    """Return one configuration for `Solutions`."""
    return np.asarray(q, dtype=np.float64).reshape(1, -1)


def none(robot: Robot) -> Array:
    """Return no configuration for `Solutions`."""
    return np.empty((0, robot.n))


METHOD_BASE = SolverPeer
"""Base class of the METHOD of every module here, and of every plug-in."""


LOOP_ITERATIONS = 100
"""Iteration limit of a loop of differential inverse kinematics, for targets where it does not converge."""
LOOP_TOLERANCE = 7e-7
"""Bound on the norm of the pose error, so that both errors are below the 1e-6 m and rad that every method must reach."""
TASK_DAMPING = 1e-3
"""``lm_damping`` of a frame task: without it the quadratic programme of an arm with seven joints may be singular."""


class LoopPeer(SolverPeer):
    """A peer whose call returns a configuration (n,) [rad, m], the number of iterations and whether it converged."""

    budgeted: ClassVar[bool] = True
    limits: JointLimits | None = None  # to which it is clamped, for a method that keeps limits to rounding

    def read(self, raw: Any) -> Solutions:
        """Return the last configuration of the iteration, whether the method reports convergence, and the iterations."""
        q, iterations, converged = raw
        return Solutions(one(q if self.limits is None else self.limits.clip(q)), bool(converged), iterations)


class WorkerSolver(WorkerPeer, LoopPeer):
    """An IK method in a separate environment; a subclass only states its facts."""

    requirements: ClassVar[tuple[str, ...]]  # what pip installs into the environment

    def __init__(self, robot: Robot, *, iterations: int | None = None) -> None:
        self.robot, self.limits = robot, robot.limits  # these methods respect limits up to rounding
        self.worker = self.start(self.environment, {"urdf": urdf(robot), "iterations": iterations})

    def read(self, raw: Any) -> Solutions:
        """Return the configuration, if there is one, clamped to the limits."""
        return Solutions(none(self.robot), bool(raw[2])) if raw[0] is None else super().read(raw)

    def fk(self, q: Array) -> Array | None:
        """Return the tool pose by the model in the worker process."""
        try:
            return np.array(self.worker.ask(q.tolist(), do="fk").raw)
        except Failed as error:
            raise Absent(f"its forward kinematics failed: {error.error}") from None


def frame_task_loop(
    configuration: Any, task: Any, pose_of: Callable[[Array], Any], solve_ik: Callable[..., Any],
    no_solution: type[Exception], iterations: int | None, **options: Any,
) -> Callable[[Array, Array], tuple[Array, int, bool]]:  # fmt: skip
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
