"""Cell: laser unit, gripper, main control and drive as one system that moves the tool to a spot of the laser."""

from __future__ import annotations

import copy
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from optik import se3
from optik.arm.inertia import Body, check_body, check_shape, join_bodies, transform_body
from optik.arm.robot import Robot
from optik.check import check_count, check_kind, check_number, format_value
from optik.errors import InvalidInput
from optik.ik import SolverLike, get_solver
from optik.scene import Scene
from optik.scene.contact import check_scene
from optik.types import Array
from planners.cell._task import CellTask, Equipment
from planners.cell.drives import make_drive
from planners.cell.drives.base import Drive, StopRequest, Watcher
from planners.cell.laser import MOST_READINGS, PanTiltLaser, find_truth, find_variance, locate_spot, read_point
from planners.cell.outcome import CellStatus, Outcome, Step
from planners.cell.sighting import Follow, Look, Plane, Sighting, Spot, check_vectors
from planners.limits import MotionLimits
from planners.timing import LawLike, make_law

# ---------------- the gripper at the arm's tool


PARTS = ("gripper", "held")
"""Names of the capsules of the gripper and of a held object in ``robot.shapes``."""


@dataclass(frozen=True, eq=False)
class HeldObject:
    """An object between the fingers, as a rigid body in the grasp's frame.

    Parameters
    ----------
    mass : float
        Mass [kg].
    com : (3,) array
        Centre of mass [m]; by default the grasp point.
    inertia : (3, 3) array, optional
        Inertia about the centre of mass [kg·m²]; by default a point mass.
    shapes : sequence of (T, edges), (centre, radius) or (a, b, radius)
        Its collision shapes, as for `Robot.with_payload` [m].

    Raises
    ------
    InvalidInput
        Values that no body has.
    """

    mass: float
    com: ArrayLike = (0.0, 0.0, 0.0)
    inertia: ArrayLike | None = None
    shapes: Sequence[Any] = ()

    def __post_init__(self) -> None:
        _body(self.mass, self.com, self.inertia, "the held object")

    @property
    def body(self) -> Body:
        """The rigid body, in the grasp's frame."""
        return _body(self.mass, self.com, self.inertia, "the held object")


@dataclass(frozen=True, eq=False)
class Gripper:
    """A gripper of two parallel fingers on the arm's tool.

    Parameters
    ----------
    grasp : (4, 4) array
        Pose of the grasp point in the frame of the arm's tool [1, m].
    opening : float
        Largest distance of the fingers [m].
    mass : float
        Mass [kg].
    com : (3,) array, optional
        Centre of mass in the frame of the arm's tool [m]; by default halfway to the grasp point.
    inertia : (3, 3) array, optional
        Inertia about the centre of mass, in the axes of the arm's tool [kg·m²]; by default a point mass.
    shapes : sequence of (T, edges), (centre, radius) or (a, b, radius)
        Its collision shapes for all finger positions, in the frame of the arm's tool, as for `Robot.with_payload` [m].

    Raises
    ------
    InvalidInput
        A grasp that is no pose, an opening below 0, or values that no body has.
    """

    grasp: ArrayLike
    opening: float
    mass: float = 0.0
    com: ArrayLike | None = None
    inertia: ArrayLike | None = None
    shapes: Sequence[Any] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "grasp", se3.check_pose(self.grasp, "grasp"))
        object.__setattr__(
            self, "opening", check_number(self.opening, "opening", "a distance of 0 or more [m]", least=0.0)
        )
        _ = self.body

    @property
    def body(self) -> Body:
        """The rigid body, in the frame of the arm's tool."""
        com = 0.5 * self._grasp[:3, 3] if self.com is None else self.com
        return _body(self.mass, com, self.inertia, "the gripper")

    @property
    def _grasp(self) -> Array:
        assert isinstance(self.grasp, np.ndarray)
        return self.grasp

    def mount(self, robot: Robot, held: HeldObject | None = None) -> Robot:
        """Return an arm with the gripper: its tool is the grasp point, and masses and shapes include gripper and object.

        The previous payload of the arm is included in the new one. Joints, limits and names do not change.

        Parameters
        ----------
        robot : Robot
            The arm without the gripper.
        held : HeldObject, optional
            The object between the fingers.

        Returns
        -------
        Robot
            The arm with the gripper. If its own masses are unknown, it has no payload.

        Raises
        ------
        InvalidInput
            An arm whose payload is an interval, or shapes for an arm that has none.
        """
        to_grasp = se3.inverse(self._grasp)
        bodies = [transform_body(self.body, to_grasp)]
        if held is not None:
            bodies.append(held.body)
        if robot.payload is not None:
            if len(robot.payload.bodies) > 1:
                wanted = "an arm whose payload has one mass, to which the gripper's is added"
                raise InvalidInput("robot", f"a payload of {robot.payload}", wanted)
            bodies.append(transform_body(robot.payload.bodies[0], to_grasp))
        arm = robot.with_tool(self._grasp, add=True)
        mass, com, inertia = join_bodies(bodies)
        if robot.inertia is not None:
            arm = arm.with_payload(mass, com, inertia)
        return arm.with_shapes(self._shapes(robot, arm.tool, held))

    def _shapes(self, robot: Robot, grasp: Array, held: HeldObject | None) -> Any:
        """Return the arm's shapes with those of gripper and object."""
        shapes, parts = robot.shapes, ((self.shapes, robot.tool), (() if held is None else held.shapes, grasp))
        for name, (objects, T) in zip(PARTS, parts, strict=True):
            if not len(objects):
                continue
            if shapes is None:
                raise InvalidInput(
                    "robot",
                    f"{robot.name!r}, which has no shapes",
                    f"an arm with shapes, because the {name} has shapes",
                )
            shapes = shapes.with_part(name, len(robot.fixed), objects, T)
        return shapes


def check_width(gripper: Gripper, width: float) -> float:
    """Return a distance of the fingers [m], checked to be at most the opening."""
    expected = f"a distance of the fingers from 0 to {gripper.opening:g} m, the gripper's opening"
    if check_number(width, "width", expected, least=0.0) > gripper.opening:
        raise InvalidInput("width", f"{width:g} m", expected)
    return float(width)


def _body(mass: float, com: ArrayLike, inertia: ArrayLike | None, where: str) -> Body:
    """Return a checked rigid body."""
    mass = check_number(mass, f"mass of {where}", "a finite mass ≥ 0 [kg]", least=0.0)
    tensor = np.zeros((3, 3)) if inertia is None else check_shape(inertia, (3, 3), f"inertia of {where}")
    return check_body((mass, check_shape(com, (3,), f"centre of mass of {where}"), tensor), where)


# ---------------- the cell


MOST_ROUNDS = 100
"""Largest number of corrections of one task: because of noise, the error no longer decreases after two or three."""


class Cell(Equipment):
    """The system of the paper: a laser unit and an arm on one platform, the control that plans, and the drive that executes.

    Everything is in the arm's base frame, as is the laser's pose, so the platform's pose moves both together.

    Parameters
    ----------
    robot : Robot
        The arm, without the gripper.
    laser : PanTiltLaser
        The calibrated laser unit.
    drive : Drive, str or path
        A drive built for this arm, or the name of one.
    limits : MotionLimits, optional
        Limits of all motions; by default the robot's own.
    base : (4, 4) array, optional
        T_world_platform: pose of the arm's base frame in the world [1, m]; by default the identity. The direction of
        gravity is that of the robot: a tilted platform needs ``robot.with_gravity``.
    gripper : Gripper, optional
        Gripper at the arm's tool; its grasp point becomes the tool. By default the tool itself goes to the spot.
    unit : PanTiltLaser, optional
        The true unit of a simulation, which makes the readings; by default ``laser``.
    seed : int
        Seed of the noise of the readings.
    scene : Scene, optional
        Obstacles for an arm with shapes, and the margin to them.
    q : (n,) array, optional
        Initial configuration of a drive that is given by name [rad, m].

    Attributes
    ----------
    robot : Robot
        The arm with the gripper and the held object.
    held : HeldObject or None
        The held object.
    width : float or None
        Distance of the fingers [m]; initially the opening.

    Raises
    ------
    InvalidInput
        An argument of another type, or a drive for another arm.
    UnknownName
        No such drive.
    """

    def __init__(
        self,
        robot: Robot, laser: PanTiltLaser, drive: Drive | str | os.PathLike[str], limits: MotionLimits | None = None,
        *, base: ArrayLike | None = None, gripper: Gripper | None = None, unit: PanTiltLaser | None = None,
        seed: int = 0, scene: Scene | None = None, q: ArrayLike | None = None,
    ) -> None:  # fmt: skip
        for name, value, kind in (
            ("robot", robot, Robot), ("laser", laser, PanTiltLaser), ("limits", limits, MotionLimits),
            ("gripper", gripper, Gripper), ("unit", unit, PanTiltLaser),
        ):  # fmt: skip
            if not isinstance(value, kind) and (value is not None or name in ("robot", "laser")):
                raise InvalidInput(name, format_value(value), f"a {kind.__name__}")
        check_count(seed, "seed", 0)
        self.laser, self.unit, self.rng = laser, laser if unit is None else unit, np.random.default_rng(seed)
        self.base = se3.check_pose(np.eye(4) if base is None else base, "base")
        self._bare, self.gripper = robot, gripper
        self.held: HeldObject | None = None
        self.width = None if gripper is None else gripper.opening
        self.robot = robot if gripper is None else gripper.mount(robot)
        self.limits = MotionLimits.of(robot) if limits is None else limits
        check_scene(self.robot, scene)
        self.scene = scene
        self.drive = self._make_drive(drive, q)

    def _make_drive(self, drive: Any, q: ArrayLike | None) -> Drive:
        """Return the drive for the arm with its gripper."""
        if isinstance(drive, str | os.PathLike):
            return make_drive(drive, self.robot, **({} if q is None else {"q": q}))
        if not isinstance(drive, Drive):
            raise InvalidInput("drive", format_value(drive), "a Drive, or the name of one")
        if q is not None:
            raise InvalidInput("q", "a configuration and a Drive object", "the configuration given to the drive itself")
        if drive.robot == self.robot:
            return drive
        if drive.robot != self._bare:
            got = f"a drive built for another arm, {drive.robot.name!r}"
            raise InvalidInput("drive", got, "one built for this arm")
        drive.carry(self.robot)
        return drive

    @property
    def notes(self) -> list[str]:
        """Remarks on the cell in every outcome."""
        massless = self.robot.inertia is None and self.gripper is not None
        note = f"the masses of {self.robot.name} are unknown: the mass of the gripper is not included"
        return [note] if massless else []

    # ------------------------------------------------------------ platform and laser

    def with_base(self, base: ArrayLike) -> Self:
        """Return the cell on a platform at another pose, with the same arm, drive and laser.

        Parameters
        ----------
        base : (4, 4) array
            T_world_platform [1, m].

        Returns
        -------
        Cell
            The cell there.
        """
        there = copy.copy(self)
        there.base = se3.check_pose(base, "base")
        return there

    def from_world(self, points: ArrayLike) -> Array:
        """Return points of the world in the arm's base frame.

        Parameters
        ----------
        points : (3,) or (..., 3) array
            In the world [m].

        Returns
        -------
        (3,) or (..., 3) array
            In the base frame [m].
        """
        local: Array = (check_vectors(points, "points") - self.base[:3, 3]) @ self.base[:3, :3]
        return local

    def read(self, point: ArrayLike, readings: int = 1) -> Spot:
        """Return a noisy reading by the true unit; it carries the true point, for simulations.

        Parameters
        ----------
        point : (3,) array
            True point in the base frame [m].
        readings : int
            Number of readings.

        Returns
        -------
        Spot
            One reading, or arrays (readings,).
        """
        return read_point(self.unit, check_vectors(point, "point"), readings, self.rng)

    def truth(self, spot: Spot, plane: Plane | None = None) -> tuple[Array, bool]:
        """Return the true point of a reading, and whether it is known; if not, the reading is taken as exact.

        Parameters
        ----------
        spot : Spot
            A reading; one by `read` carries its true point.
        plane : Plane, optional
            Plane of the spot, on which ranges are not used.

        Returns
        -------
        point : (3,) array
            In the base frame [m].
        known : bool
            Whether the reading carries it.
        """
        return find_truth(self.unit, spot, plane)

    def sighting(self, spot: Spot, plane: Plane | None = None) -> Sighting:
        """Return the spot as the calibrated unit locates it: the mean of its readings.

        Parameters
        ----------
        spot, plane
            As for `truth`.

        Returns
        -------
        Sighting
            FOUND, or another status.
        """
        return locate_spot(self.laser, spot, plane)

    def noise(self, spot: Spot, plane: Plane | None = None) -> float:
        """Return the variance [m²] of a measured point by the noise of its readings alone, summed over the three axes.

        Parameters
        ----------
        spot, plane
            As for `truth`.

        Returns
        -------
        float
            The variance [m²].
        """
        return find_variance(self.laser, spot, plane)

    # ------------------------------------------------------------ tasks

    def move_to_spot(
        self, spot: Spot, orientation: ArrayLike | None = None, *, corrections: int = 0, readings: int = 1,
        timing: LawLike = "optimal", solver: SolverLike = "lm", samples: int = 151, plane: Plane | None = None,
        true_spot: ArrayLike | None = None, follow: Follow | None = None, moved: float = 0.005, most_replans: int = 10,
        look: Look | None = None, stop: StopRequest | None = None, watch: Watcher | None = None,
    ) -> Outcome:  # fmt: skip
        """Move the tool along a straight line to a spot, and measure its error there.

        Parameters
        ----------
        spot : Spot
            Its reading by the unit: pan, tilt [rad] and range [m], or arrays (k,) of several readings.
        orientation : (3, 3) array, optional
            Orientation of the tool at the spot [1]; by default the present one, as in the paper.
        corrections : int
            Number of correction passes; each measures the residual by the laser unit and moves the tool by it.
        readings : int
            Number of readings of the tool for each correction, which are averaged.
        timing : str, path, type, or TimeLaw
            Time law of the line, as for `planners.plan`.
        solver : str, path, type, or IKSolver
            IK method.
        samples : int
            Number of equally spaced positions of the line that the IK method solves.
        plane : Plane, optional
            Plane of the spot. Ranges are then not used: spot and tool are the intersections of beam and plane, and
            corrections are along the plane.
        true_spot : (3,) array, optional
            True position of the spot in a simulation [m]; by default that of `truth`.
        follow : callable, optional
            Returns a reading of the spot (3,) at every tick [rad, m]. If it has moved, the motion stops, and a new line begins.
        moved : float
            Largest distance of the spot from the target [m], above the noise of a reading.
        most_replans : int
            Largest number of new lines to a moving spot.
        look : callable, optional
            Returns readings of the real tool for corrections; by default the simulated unit reads it.
        stop, watch : optional
            As for `Drive.execute`.

        Returns
        -------
        Outcome
            Every step with its result, the error of every round, and the sources of the error.

        Raises
        ------
        InvalidInput
            An invalid argument; corrections on a real drive without ``look``; no such law or method.
        """
        self._check_request(corrections, readings, most_replans, {"follow": follow, "look": look, "watch": watch})
        check_kind(spot, "spot", Spot, "a planners.cell.Spot(pan, tilt, range)")
        return CellTask(
            self, make_law(timing), get_solver(self.robot, solver), self.notes, stop=stop, watch=watch,
            orientation=None if orientation is None else _rotation(orientation), corrections=corrections,
            readings=readings, samples=samples, plane=plane, follow=follow, look=look, most_replans=most_replans,
            stated_spot=None if true_spot is None else check_vectors(true_spot, "true_spot"),
            moved=check_number(moved, "moved", "a distance above 0 [m]", above=0.0),
        ).run(spot)  # fmt: skip

    def resume(
        self, outcome: Outcome, *, solver: SolverLike | None = None, stop: StopRequest | None = None,
        watch: Watcher | None = None,
    ) -> Outcome:  # fmt: skip
        """Resume a task along the same path after a stop on request or a fault during its motion.

        An arm off the path returns to it first. To correct afterwards, or if it cannot return, call `move_to_spot` again,
        whose line begins at the arm's present configuration.

        Parameters
        ----------
        outcome : Outcome
            The outcome of `move_to_spot` or `resume` that failed at the step "execution".
        solver : str, path or IKSolver, optional
            IK method of the error split; by default that of the plan.
        stop, watch : optional
            As for `Drive.resume`.

        Returns
        -------
        Outcome
            Its steps are "execution" and "tool".

        Raises
        ------
        InvalidInput
            An outcome of another kind.
        """
        stopped = isinstance(outcome, Outcome) and outcome.status in (CellStatus.STOPPED, CellStatus.FAULT)
        if not stopped or not outcome.executions or outcome.failed is None or outcome.failed.name != "execution":
            came = str(getattr(outcome, "status", format_value(outcome)))
            raise InvalidInput("outcome", came, "the outcome of a task that was stopped while the arm moved")
        method = get_solver(self.robot, outcome.executions[-1].plan.solver if solver is None else solver)
        return CellTask(self, make_law("optimal"), method, self.notes, stop, watch).resume(outcome)

    def _check_request(self, corrections: int, readings: int, most_replans: int, functions: dict[str, Any]) -> None:
        """Check the counts and the functions of a request; corrections on a real arm need a `look` function."""
        for name, function in functions.items():
            if function is not None and not callable(function):
                raise InvalidInput(name, format_value(function), "a function")
        check_count(corrections, "corrections", 0, MOST_ROUNDS)
        check_count(readings, "readings", 1, MOST_READINGS)
        check_count(most_replans, "most_replans", 0)
        if corrections and functions["look"] is None and not self.drive.simulated:
            raise InvalidInput("look", "nothing, on a real drive", "a function that reads the tool, for corrections")
        if readings > 1 and functions["look"] is not None:
            raise InvalidInput("readings", f"{readings}, with look", "1: look itself may return several readings")

    def open(self, width: float | None = None) -> Outcome:
        """Open the gripper and release the held object.

        Parameters
        ----------
        width : float, optional
            Distance of the fingers [m]; by default the gripper's opening.

        Returns
        -------
        Outcome
            One step, "open"; REFUSED if the gripper cannot open so far.
        """

        def act(gripper: Gripper) -> str:
            wide = check_width(gripper, gripper.opening if width is None else width)
            if wide < (self.width or 0.0):
                raise InvalidInput("width", f"{wide:g} m", f"at least {self.width:g} m, the present width")
            self._grip(gripper, None, wide)
            return f"{wide:g} m open"

        return self._run_gripper("open", act)

    def close(self, width: float = 0.0, held: HeldObject | None = None) -> Outcome:
        """Close the gripper, with or without an object.

        Parameters
        ----------
        width : float
            Distance of the fingers [m], the width of the object.
        held : HeldObject, optional
            The object; plans, certificates and the drive then include its mass and shapes.

        Returns
        -------
        Outcome
            One step, "close"; REFUSED if the gripper cannot close so far, or the arm cannot hold the object.
        """

        def act(gripper: Gripper) -> str:
            narrow = check_width(gripper, width)
            if held is not None and not isinstance(held, HeldObject):
                raise InvalidInput("held", format_value(held), "a planners.cell.HeldObject(mass)")
            if self.width is not None and narrow > self.width:
                raise InvalidInput("width", f"{narrow:g} m", f"at most {self.width:g} m, the present width")
            self._grip(gripper, held if held is not None else self.held, narrow)
            return f"{narrow:g} m open" + ("" if self.held is None else f", holding {self.held.mass:g} kg")

        return self._run_gripper("close", act)

    def _grip(self, gripper: Gripper, held: HeldObject | None, width: float) -> None:
        """Update arm and drive to the present load of the gripper."""
        robot = gripper.mount(self._bare, held)
        if held is not None and held is not self.held:
            self._check_weight(robot, held)
        if robot != self.robot:
            self.drive.carry(robot)
        self.robot, self.held, self.width = robot, held, width

    def _check_weight(self, robot: Robot, held: HeldObject) -> None:
        """Raise InvalidInput if the motors cannot hold an object at the arm's configuration; unknown torques are not judged."""
        if robot.inertia is None or robot.limits.torque is None:
            return
        try:
            q = self.drive.measure()
        except InvalidInput:  # a simulated drive that does not know its arm's configuration yet
            return
        if not np.isfinite(q).all():
            return
        still = np.zeros(robot.n)
        needed = np.abs(robot.torques(q, still, still)) / robot.limits.torque
        i = int(needed.argmax())
        if needed[i] > 1.0:
            what = f"{held.mass:g} kg, which needs {needed[i]:.3g} times the torque limit of {robot.joint_names[i]}"
            raise InvalidInput("held", what, "an object that the arm can hold in its present configuration")

    def _run_gripper(self, name: str, act: Callable[[Gripper], str]) -> Outcome:
        """Run one step of the gripper and return its outcome; a refused step changes nothing."""
        since = perf_counter()
        try:
            if self.gripper is None:
                raise InvalidInput("gripper", "none", "a cell with a gripper: Cell(..., gripper=Gripper(...))")
            said, status, advice = act(self.gripper), CellStatus.ARRIVED, ""
        except InvalidInput as error:
            said, status, advice = f"{error.argument} is {error.got}", CellStatus.REFUSED, error.expected
        good = status is CellStatus.ARRIVED
        step = Step(name, good, said, advice, self.robot if good else None, perf_counter() - since)
        return Outcome(self.robot, status, (step,), base=self.base, scene=self.scene, notes=tuple(self.notes))


def _rotation(value: ArrayLike) -> Array:
    """Return a checked orientation (3, 3)."""
    R = np.asarray(value)
    if R.shape != (3, 3):
        raise InvalidInput("orientation", f"shape {R.shape}", "a rotation matrix (3, 3)")
    checked: Array = se3.check_pose(se3.pose(R), "orientation")[:3, :3]
    return checked
