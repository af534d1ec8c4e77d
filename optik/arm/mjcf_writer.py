"""An arm as a MuJoCo model: MJCF text with joints, masses, motors, friction, gravity and payload, and the compiled model."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

from optik import se3
from optik.arm.inertia import Body, Inertia
from optik.arm.motors import refuse_motors
from optik.arm.robot import Robot
from optik.arm.urdf_writer import check_xml_names
from optik.check import check_flag, check_number
from optik.errors import InvalidInput, MissingDependency, RobotModelError
from optik.file_io import write_atomically
from optik.types import Array

ROD_DENSITY = 1500.0
"""Density of the assumed rods [kg/m³]: with `ROD_THICKNESS` an arm of the UR5e's size weighs 14 kg, of the Panda's 20 kg;
the real ones weigh 19 and 16 kg without their bases."""
ROD_THICKNESS = 0.1
"""Diameter of the assumed rods, as a part of the length of all links together [1]: arms are some ten times as long as thick."""


def assume_masses(robot: Robot) -> tuple[Robot, str]:
    """Return an arm with known masses, and a description of the assumptions.

    An arm that has masses is returned as it is. One without gets, for each link, a solid cylinder from its joint to the next
    one (the tool, for the last), `ROD_THICKNESS` of the arm's length thick and at least as long, of `ROD_DENSITY`; motors
    whose inertia is that of all masses behind the joint at a distance of one diameter (those masses themselves, where the
    joint slides); no friction; and no torque limits, as those of a real motor do not belong to assumed masses.
    """
    if robot.inertia is not None:
        return robot, ""
    ends = np.concatenate([robot.fixed[1:, :3, 3], robot.tool[None, :3, 3]])
    lengths = np.linalg.norm(ends, axis=1)
    # An arm without any length has nothing to scale by: one metre then.
    thickness = ROD_THICKNESS * (float(lengths.sum()) or 1.0)
    rods = [_rod(end, float(length), thickness) for end, length in zip(ends, lengths, strict=True)]
    mass, com, tensor = (np.array(part) for part in zip(*rods, strict=True))
    moved = np.cumsum(mass[::-1])[::-1]
    motor = np.where(robot.prismatic, moved, moved * thickness**2)
    source = "assumed: rods along the links, as the masses are unknown"
    inertia = Inertia(mass, com, tensor, motor=motor, source=source)
    limits = robot.limits.replace(torque=None, torque_rate=None)
    return replace(robot, inertia=inertia, limits=limits), _describe_masses(robot, thickness, float(mass.sum()))


def _rod(end: Array, length: float, thickness: float) -> tuple[float, Array, Array]:
    """Return a solid cylinder from a frame's origin to a point: mass, centre of mass, inertia about it."""
    radius, long = 0.5 * thickness, max(length, thickness)
    mass = ROD_DENSITY * np.pi * radius**2 * long
    along = end / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    about, across = 0.5 * mass * radius**2, mass * (3.0 * radius**2 + long**2) / 12.0
    tensor = across * np.eye(3) + (about - across) * np.outer(along, along)
    return mass, 0.5 * end, tensor


def _describe_masses(robot: Robot, thickness: float, total: float) -> str:
    dropped = " its torque limits are not applied," if robot.limits.torque is not None else ""
    return (
        f"the masses of {robot.name!r} are unknown: its links are assumed to be solid rods of {ROD_DENSITY:.0f} kg/m³, "
        f"{1000.0 * thickness:.0f} mm thick, {total:.1f} kg together, its motors to have the inertia of the moved masses at "
        f"that distance, without friction;{dropped} torques are those of this assumption, not of the arm"
    )


PLANT_STEP = 0.0005
"""Step of MuJoCo's integrator by default [s]: eight steps in a servo period of 4 ms, as fast as current loops of drives run."""
SMALLEST_MASS = 1e-12
"""Mass [kg] and smallest principal moment [kg·m²] that are written for 0: MuJoCo refuses moving bodies below 1e-15. They
change torques by less than 1e-9 N·m up to accelerations of 100 m/s² and rad/s²."""
TRIANGLE_MARGIN = 1e-15
"""Part by which the sum of the two smaller moments exceeds the largest after mending [1]: rounding of that sum."""
STIFF_STEPS = 2.0
"""Time constant with which MuJoCo brings a sticking joint to rest, in steps: its shortest. With its default of 0.02 s a joint
at rest creeps under load by some 1e-3 rad/s."""
STIFF_SOLIMP = "0.9999 0.9999 0.001 0.5 2"
"""Impedance of friction in MuJoCo: its largest. A joint that sticks then carries 99.99 % of the load by friction, not 90 %."""
Axes = tuple[Array, Array]
"""Principal moments (3,) [kg·m²], and the axes as columns of a rotation matrix (3, 3)."""


def to_mjcf(
    robot: Robot, path: str | os.PathLike[str] | None = None, *, step: float = PLANT_STEP, limits: bool = False
) -> str:
    """Return the arm as MJCF, MuJoCo's XML, and write it to a file if one is named.

    Body i moves with joint i, and its frame is that joint's (`Robot.frames`); ``tool`` is a site. Masses, centres of mass
    and inertia tensors are those of `Robot.inertia`, the motors' inertia is the joint's armature, viscous friction its
    damping, Coulomb friction its frictionloss, and the payload a body of its own that is welded to the last link. One
    motor turns each joint, within the torque limits. Capsules of `Robot.shapes` are drawn and touch nothing.

    What MuJoCo refuses is written as the nearest that it takes: a mass or moment of 0 as 1e-12, and moments of which
    one exceeds the sum of the two others (measured ones do) with a third of the excess on each. `mujoco_model` puts
    the exact moments back. An arm without masses gets those of `planners.cell.MujocoDrive`, with a comment that says so.

    Parameters
    ----------
    robot : Robot
        The arm.
    path : str or path, optional
        File to be written.
    step : float
        Of MuJoCo's integrator [s].
    limits : bool
        Let MuJoCo push joints back at their position limits. By default it is told the ranges and does not apply
        them: the planner keeps them, and a plan inside them must not be touched.

    Returns
    -------
    str
        The text.

    Raises
    ------
    InvalidInput
        A payload whose mass is an interval, a step that is not above 0.
    RobotModelError
        A name that XML cannot hold.
    OutputError
        The file cannot be written.
    """
    step = float(check_number(step, "step", "seconds, above 0", above=0.0))
    check_flag(limits, "limits")
    _check_payload(robot)
    check_xml_names(robot)
    refuse_motors(robot, "MJCF")
    if robot.linkage is not None:
        raise RobotModelError(robot.name, "a linkage, whose axes follow joints; MuJoCo is given serial arms only")
    root = _root(robot, step, limits)
    ET.indent(root)
    text = ET.tostring(root, encoding="unicode") + "\n"
    if path is not None:
        write_atomically(path, lambda part: part.write_text(text, encoding="utf-8"))
    return text


def mujoco_model(robot: Robot, *, step: float = PLANT_STEP, limits: bool = False) -> Any:
    """Return the arm as a compiled MuJoCo model, with the exact moments of inertia where MuJoCo's compiler refuses them.

    Parameters
    ----------
    robot, step, limits
        As `to_mjcf` takes them.

    Returns
    -------
    mujoco.MjModel
        Joint i, body i + 1 (`Robot.frames`) and motor i are those of the arm's joint i.

    Raises
    ------
    MissingDependency
        MuJoCo is not installed.
    InvalidInput, RobotModelError
        As `to_mjcf`.
    """
    mujoco = import_mujoco("a model for MuJoCo")
    model = mujoco.MjModel.from_xml_string(to_mjcf(robot, step=step, limits=limits))
    heavy, _ = assume_masses(robot)
    assert heavy.inertia is not None
    bodies = [*heavy.inertia.bodies, *(heavy.payload.bodies if heavy.payload else ())]
    for i, body in enumerate(bodies):
        moments, _ = _principal(body)
        if body[0] > 0.0 and (_mend_moments(moments) != moments).any():
            model.body_inertia[i + 1] = np.maximum(moments, 0.0)
    mujoco.mj_setConst(model, mujoco.MjData(model))  # what follows from the masses
    return model


def import_mujoco(needed_by: str) -> Any:
    """Return the package mujoco."""
    try:
        import mujoco
    except ImportError as error:
        raise MissingDependency("mujoco", needed_by, "sim") from error
    return mujoco


# ---------------------------------------------------------------- elements


def _root(robot: Robot, step: float, limits: bool) -> ET.Element:
    heavy, assumed = assume_masses(robot)
    root = ET.Element("mujoco", model=robot.name)
    if assumed:
        root.append(ET.Comment(" Masses: solid rods along the links, assumed because those of the arm are unknown. "))
    ET.SubElement(root, "compiler", angle="radian", autolimits="true", inertiafromgeom="false")
    gravity = _words(robot.gravity_magnitude * robot.gravity)
    option = ET.SubElement(root, "option", timestep=repr(step), gravity=gravity, integrator="implicitfast")
    ET.SubElement(option, "flag", contact="disable", limit="enable" if limits else "disable")
    stiff = {"solreffriction": _words([STIFF_STEPS * step, 1.0]), "solimpfriction": STIFF_SOLIMP}
    ET.SubElement(ET.SubElement(root, "default"), "joint", stiff)
    _add_bodies(ET.SubElement(root, "worldbody"), heavy)
    motors = ET.SubElement(root, "actuator")
    for i, name in enumerate(heavy.joint_names):
        _add_motor(motors, heavy, name, i)
    return root


def _add_bodies(world: ET.Element, robot: Robot) -> None:
    """Add the chain of bodies, each with its mass, joint and capsules; the last one has the payload and the tool."""
    assert robot.inertia is not None
    _add_capsules(world, robot, 0)
    body = world
    for i, (name, link) in enumerate(zip(robot.joint_names, robot.inertia.bodies, strict=True)):
        body = ET.SubElement(body, "body", _place(robot.fixed[i]), name=f"link{i + 1}")
        _add_inertial(body, link)
        kind = "slide" if robot.prismatic[i] else "hinge"
        joint = ET.SubElement(body, "joint", name=name, type=kind, axis="0 0 1")
        lower, upper = robot.limits.lower[i], robot.limits.upper[i]
        if np.isfinite([lower, upper]).all() and lower < upper:
            joint.set("range", _words([lower, upper]))
        for attribute, values in _JOINT.items():
            if (value := float(getattr(robot.inertia, values)[i])) > 0.0:
                joint.set(attribute, repr(value))
        _add_capsules(body, robot, i + 1)
    if robot.payload is not None:
        _add_inertial(ET.SubElement(body, "body", _place(robot.tool), name="payload"), robot.payload.bodies[0])
    ET.SubElement(body, "site", _place(robot.tool), name="tool")


_JOINT = {"armature": "motor", "damping": "viscous", "frictionloss": "coulomb"}
"""Attributes of a joint in MJCF, and the fields of `Inertia` that they are."""


def _add_inertial(body: ET.Element, link: Body) -> None:
    # By principal axes: MuJoCo's own decomposition of a full tensor is too coarse for rods and plates, which it then refuses.
    mass, com, _ = link
    moments, axes = _principal(link)
    place = {"pos": _words(com), "quat": _words(se3.quaternion(axes))}
    ET.SubElement(
        body, "inertial", place, mass=repr(max(mass, SMALLEST_MASS)), diaginertia=_words(_mend_moments(moments))
    )


def _add_motor(motors: ET.Element, robot: Robot, name: str, i: int) -> None:
    motor = ET.SubElement(motors, "motor", name=name, joint=name)
    if robot.limits.torque is not None and np.isfinite(most := float(robot.limits.torque[i])):
        motor.set("ctrlrange", _words([-most, most]))


def _add_capsules(body: ET.Element, robot: Robot, link: int) -> None:
    if robot.shapes is None:
        return
    number, starts, ends, radii = robot.shapes.capsules
    for k in np.flatnonzero(number == link):
        a, b, radius = starts[k], ends[k], float(radii[k])
        apart = {"contype": "0", "conaffinity": "0", "group": "1", "mass": "0"}
        if np.linalg.norm(b - a) < 1e-9 * radius:
            ET.SubElement(body, "geom", apart, type="sphere", pos=_words(a), size=repr(radius))
        else:
            ET.SubElement(body, "geom", apart, type="capsule", fromto=_words([*a, *b]), size=repr(radius))


# ---------------------------------------------------------------- numbers


def _principal(link: Body) -> Axes:
    """Return the principal moments of a link, and their axes as columns of a rotation."""
    moments, axes = np.linalg.eigh(link[2])
    return moments, axes * np.sign(np.linalg.det(axes))


def _mend_moments(moments: Array) -> Array:
    """Return the moments nearest to the given ascending ones that MuJoCo accepts; the same if it accepts those."""
    low, middle, high = np.maximum(moments, SMALLEST_MASS)
    excess = max(high * (1.0 + TRIANGLE_MARGIN) - low - middle, 0.0) / 3.0
    return np.array([low + excess, middle + excess, high - excess])


def _place(T: Array) -> dict[str, str]:
    """Return position and unit quaternion (w, x, y, z) of a pose, as XML attributes."""
    return {"pos": _words(T[:3, 3]), "quat": _words(se3.quaternion(T[:3, :3]))}


def _words(numbers: Any) -> str:
    """Return numbers with all their digits, as an XML attribute."""
    return " ".join(repr(float(x)) for x in numbers)


# ---------------------------------------------------------------- checks


def _check_payload(robot: Robot) -> None:
    if robot.payload is not None and len(robot.payload.masses) > 1:
        wanted = f"one mass, such as robot.with_payload({robot.payload.masses[-1]:g}), as a simulated arm carries one"
        raise InvalidInput("payload", f"an interval, {robot.payload}", wanted)
