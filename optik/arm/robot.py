"""Serial arms from DH tables and URDF: kinematics and comparison."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik import kinematics, se3
from optik.arm.chains import mount_arm
from optik.arm.inertia import Inertia
from optik.arm.limits import JointLimits
from optik.arm.model import UNIT_LENGTH, ArmDynamics, ArmModel
from optik.arm.plain import arm_from_dict, arm_to_dict
from optik.arm.shapes import Shapes
from optik.arm.summary import COLUMNS, describe_robot, joint_rows, tool_facts
from optik.card import Card
from optik.check import check_flag, check_keywords, check_kind, real_array
from optik.errors import InvalidInput, RobotModelError
from optik.types import Array

if TYPE_CHECKING:
    from optik.arm.compare import ArmComparison
    from optik.arm.shapes.urdf import Folders
    from optik.view import Page


class DHRow(NamedTuple):
    """One row of a Denavit–Hartenberg table.

    Lengths in metres, angles in radians. ``theta`` (revolute) or ``d`` (prismatic) is the joint's offset at q = 0.
    """

    a: float = 0.0
    alpha: float = 0.0
    d: float = 0.0
    theta: float = 0.0
    prismatic: bool = False


def screw_x(angle: float, length: float) -> Array:
    """Return the transform Rot(x, angle) Trans(x, length)."""
    return se3.pose(se3.exp_so3([angle, 0.0, 0.0]), (length, 0.0, 0.0))


def screw_z(angle: float, length: float) -> Array:
    """Return the transform Rot(z, angle) Trans(z, length)."""
    return se3.pose(se3.exp_so3([0.0, 0.0, angle]), (0.0, 0.0, length))


def check_table(rows: Iterable[DHRow | Mapping[str, Any]]) -> list[DHRow]:
    """Check the rows of a table; return them as `DHRow`."""
    table = []
    check_kind(rows, "rows", Iterable, "a list of DHRow or of mappings")
    for i, row in enumerate(rows):
        try:
            named = row if isinstance(row, DHRow) else DHRow(**row)
        except TypeError:
            wanted = "a DHRow, or a mapping with a, alpha, d, theta, prismatic"
            raise InvalidInput(f"rows[{i}]", repr(row)[:80], wanted) from None
        for field in ("a", "alpha", "d", "theta"):
            value = getattr(named, field)
            real = isinstance(value, int | float | np.integer | np.floating)
            if not real or not np.isfinite(value):
                raise RobotModelError("table", f"joint {i + 1}: {field} is {value!r}, expected a finite number")
        check_flag(named.prismatic, f"rows[{i}].prismatic")
        table.append(named)
    return table


@dataclass(frozen=True, eq=False)
class Robot(ArmDynamics):
    """A serial arm of revolute and prismatic joints about or along their z axes.

    Use `from_mdh`, `from_dh`, `from_urdf` or `optik.load`; a constructor's name states the convention. Methods raise
    InvalidInput for configurations of a wrong length, NaN or infinity.

    Parameters
    ----------
    name : str
        Name of the arm.
    fixed : (n, 4, 4) array
        Transform from the joint before (the base, for the first) to each joint at q = 0, base transform included.
    prismatic : (n,) array of bool
        Which joints slide.
    tool : (4, 4) array
        Transform from the last joint's frame to the tool.
    limits : JointLimits
        Of all n joints.
    joint_names : sequence of str, optional
        By default joint1, joint2, ….
    gravity : (3,) array, optional
        Direction of gravity in the base frame, of any length [1]; −z by default.
    source : str, optional
        Source of the numbers.
    gravity_magnitude : float, optional
        Acceleration of free fall [m/s²]; 9.80665 by default, 0 without weight.
    inertia : Inertia, optional
        Masses of the links, motors and friction; None where unknown.
    payload : Payload, optional
        A body in the tool's frame; see `with_payload`.
    shapes : Shapes, optional
        Capsules that enclose the links.
    motors : Motors, optional
        Motors that move the axes together; see `with_motors`.
    linkage : Linkage, optional
        Relations of the chain's N axes to n joints; fixed, inertia and shapes are those of the axes.

    Raises
    ------
    InvalidInput
        A value of the wrong type.
    RobotModelError
        Not a serial arm: wrong shapes, transforms that are not poses, repeated joint names, no direction of gravity,
        masses of another number of links, or a payload on an arm without masses.
    """

    def __repr__(self) -> str:
        turned = np.abs(self.gravity - (0.0, 0.0, -1.0)).max() > UNIT_LENGTH
        gravity = f", gravity ({', '.join(f'{x + 0.0:.3g}' for x in np.round(self.gravity, 6))})" if turned else ""
        return f"Robot({self.name!r}, {self.n} joints{gravity})"

    def __str__(self) -> str:
        return describe_robot(self, self._rest)

    @property
    def _rest(self) -> Array:
        return self.fk(self.limits.middle)[:3, 3]

    def _repr_html_(self) -> str:
        """Return the table of joints for a notebook."""
        return Card(title=repr(self), head=COLUMNS, rows=joint_rows(self), facts=tool_facts(self, self._rest)).to_html()

    @check_keywords
    def show(self, q: ArrayLike | None = None, *, scene: Any = None) -> Page:
        """Show the arm at a configuration: in the cell of a notebook, else in the browser.

        Parameters
        ----------
        q : (n,) array, optional
            The configuration [rad, m]; by default every joint in the middle of its range.
        scene : Scene, optional
            Obstacles around the arm.

        Returns
        -------
        Page
            The page; ``save(file)`` writes it.

        Raises
        ------
        InvalidInput
            A configuration of another length, NaN or infinity.
        """
        from optik.view import show_arm  # which draws arms and scenes, and so stands above this module

        return show_arm(self, self.limits.middle if q is None else q, scene)

    # ------------------------------------------------------------ conventions

    @staticmethod
    def from_mdh(rows: Iterable[DHRow | Mapping[str, Any]], limits: JointLimits, **options: Any) -> Robot:
        """Build from a modified (Craig) table: T_i = Rot(x, α_{i−1}) Trans(x, a_{i−1}) Rot(z, θ_i) Trans(z, d_i).

        Parameters
        ----------
        rows : iterable of DHRow or mapping
            Row i holds a_{i−1}, α_{i−1}, d_i, θ_i by name [m, rad].
        limits : JointLimits
            Of all joints.
        **options
            name, joint_names, gravity, source, gravity_magnitude, inertia, payload, shapes as of `Robot`; base and tool, both
            (4, 4): the base stands before the table's first transform, the tool after its last.

        Returns
        -------
        Robot

        Raises
        ------
        InvalidInput
            An option that does not exist, a base or tool that is no pose, rows that are none.
        RobotModelError
            Not a serial arm.
        """
        table = check_table(rows)
        fixed = [screw_x(r.alpha, r.a) @ screw_z(r.theta, r.d) for r in table]
        return _assemble(fixed, np.eye(4), table, limits, options)

    @staticmethod
    def from_dh(rows: Iterable[DHRow | Mapping[str, Any]], limits: JointLimits, **options: Any) -> Robot:
        """Build from a standard (distal) table: A_i = Rot(z, θ_i) Trans(z, d_i) Trans(x, a_i) Rot(x, α_i).

        Parameters
        ----------
        rows : iterable of DHRow or mapping
            Row i holds a_i, α_i, d_i, θ_i by name [m, rad].
        limits, **options
            As of `from_mdh`, but inertia and shapes are in the table's frames, a_i and α_i behind the joints' frames.

        Returns
        -------
        Robot
        """
        table = check_table(rows)
        before = [np.eye(4), *(screw_x(r.alpha, r.a) for r in table)]
        fixed = [b @ screw_z(r.theta, r.d) for b, r in zip(before, table, strict=False)]
        if isinstance(options.get("inertia"), Inertia) and options["inertia"].mass.size == len(table):
            options["inertia"] = options["inertia"].transform(before[1:])
        if isinstance(options.get("shapes"), Shapes):
            for link, T in enumerate(before):
                options["shapes"] = options["shapes"].transform_part(link, T)
        return _assemble(fixed, before[-1], table, limits, options)

    @staticmethod
    def from_urdf(
        source: str | os.PathLike[str], tip: str | None = None, base: str | None = None, *, name: str | None = None,
        gravity: ArrayLike | None = None, shapes: bool = False, package_dirs: Folders = None,
        srdf: str | os.PathLike[str] | None = None, values: Mapping[str, float] | None = None,
        without_shape: Sequence[str] = (),
    ) -> Robot:  # fmt: skip
        """Read the chain between two links of a URDF.

        Fixed joints are merged into their neighbours. A velocity or an effort (the torque limit) that is missing or 0 is
        unknown: infinite, or None where all are unknown. Masses are those of <inertial>, merged over fixed joints and with
        the links that branch off the chain, whose joints stand at 0. A link without <inertial> has the mass 0; if no link has
        one, the masses are unknown. Friction is that of <dynamics> (damping: viscous, friction: Coulomb); armature, an
        extension of URDF, is the inertia of the motor. Invalid masses and efforts are ignored with a warning. Position limits
        of ten turns give a DegreesWarning. Soft limits (<safety_controller>) are not read. Joints of the chain
        that follow others (<mimic>) make a linkage, whose joints are the driving ones, limited as both are.

        Parameters
        ----------
        source : str or path
            A file, or XML text (which begins with <). xacro must be expanded before.
        tip : str, optional
            Link of the tool; by default the end of the longest chain, before a hand: ``tool0``, else ``flange``, else its
            only end, else the last link before the hand; `print` shows it. If no rule decides, the error lists the links.
        base : str, optional
            Link of the base frame; by default the root.
        name : str, optional
            Name of the arm; by default that of the file.
        gravity : (3,) array, optional
            Direction of gravity in the base frame [1]; by default −z of the root link, turned through the joints before the
            base, which stand at 0. If one of them moves, a MovingMountWarning names it.
        shapes : bool
            Whether capsules that enclose the <collision> elements are computed.
        package_dirs : mapping of str to path, or sequence of paths, optional
            Folders of meshes: {package: folder}, or folders that contain packages. A package above the file is also found.
        srdf : str or path, optional
            File, or its text, whose ``disable_collisions`` name links that are not checked against each other.
        values : mapping of str to float, optional
            Values at which joints beside the chain are held [rad, m]; joints that follow them (<mimic>) and the masses behind
            them move along. By default, shapes enclose every value within the limits.
        without_shape : sequence of str, optional
            Links whose <collision> is not read. If another cannot be read, there is a warning; plans with a scene are refused.

        Returns
        -------
        Robot

        Raises
        ------
        InvalidInput
            No such file, no XML, no URDF, xacro, a DOCTYPE, an entity; a held joint that does not exist, belongs to the chain
            or follows another, or a value outside its limits.
        RobotModelError
            No tree of links, no such link, several possible tips, or a joint on the chain that is floating, planar, mimicking
            none or itself, without an axis, or has crossed, equal or missing limits.
        """
        from optik.arm.urdf import read_urdf
        from optik.arm.urdf_tree import name_file

        with name_file(source):
            return _robot(read_urdf(
                source, tip, base, name=name, gravity=gravity, shapes=shapes, package_dirs=package_dirs, srdf=srdf,
                values=values, without_shape=without_shape,
            ))  # fmt: skip

    def to_urdf(self, path: str | os.PathLike[str] | None = None) -> str:
        """Return the arm as URDF text, from link ``base`` to link ``tool``; write it to a file if one is named.

        The file has the same kinematics and torques (1e-12), position limits, velocities and torque limits. An effort or
        velocity of 0 means unknown. A payload is the mass of the link ``tool``. URDF has no fields for acceleration, jerk,
        torque rate, gravity and source.

        Parameters
        ----------
        path : str or path, optional
            File to be written.

        Returns
        -------
        str

        Raises
        ------
        RobotModelError
            A prismatic joint without limits, a limit on one side only, a joint that cannot move, a payload whose mass is an
            interval, or a name that XML cannot hold.
        OutputError
            The file cannot be written.
        """
        from optik.arm.urdf_writer import write_urdf

        return write_urdf(self, path)

    def with_arm(self, arm: Robot) -> Robot:
        """Return the chain of this mechanism, such as a slide, and an arm that stands with its base in the tool's frame.

        Shapes and masses are kept if both have them. A `Robot` has no mass of its base: add that of the arm to the last link
        of the slide (`with_inertia`).

        Parameters
        ----------
        arm : Robot
            The arm.

        Returns
        -------
        Robot
            Its joints are those of this mechanism, then those of the arm. Names that both have get the names of the two.

        Raises
        ------
        InvalidInput
            No robot.
        """
        if not isinstance(arm, Robot):
            raise InvalidInput("arm", repr(arm)[:60], "a Robot")
        return mount_arm(self, arm)

    def to_dict(self) -> dict[str, Any]:
        """Return the arm as plain data for JSON; `from_dict` restores it to the last bit."""
        return arm_to_dict(self)

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> Robot:
        """Return the arm that `to_dict` wrote: equal to it, with the same fingerprint.

        Parameters
        ----------
        data : mapping
            The result of `to_dict`.

        Returns
        -------
        Robot

        Raises
        ------
        InvalidInput
            Missing or unknown keys, wrong lengths, or a value that is not a number.
        RobotModelError
            Not a serial arm.
        """
        return _robot(arm_from_dict(data))

    # ------------------------------------------------------------ kinematics

    def fk(self, q: ArrayLike) -> Array:
        """Return the tool poses in the base frame.

        Parameters
        ----------
        q : (n,) or (..., n) array
            Configurations [rad, m].

        Returns
        -------
        (4, 4) or (..., 4, 4) array
            T_base_tool (paper eq. 1–2) [1, m].
        """
        q = self.configuration(q, batch=True)
        out = np.empty((*q.shape[:-1], 4, 4))
        kinematics.fk_batch(self.chain, q.reshape(-1, self.n), out.reshape(-1, 4, 4))
        return out

    def frames(self, q: ArrayLike) -> Array:
        """Return the poses of the joint frames and, last, of the tool, in the base frame; of a linkage those of its N axes.

        Parameters
        ----------
        q : (n,) or (..., n) array
            Configurations [rad, m].

        Returns
        -------
        (n + 1, 4, 4) or (..., n + 1, 4, 4) array
            Poses [1, m].
        """
        q = self.configuration(q, batch=True)
        out = np.empty((*q.shape[:-1], len(self.fixed) + 1, 4, 4))
        flat = out.reshape(-1, *out.shape[-3:])
        kinematics.frames_batch(self.chain, q.reshape(-1, self.n), flat)
        return out

    def jacobian(self, q: ArrayLike) -> Array:
        """Return the geometric Jacobians, rows (v, ω) in the base frame at the tool point.

        Parameters
        ----------
        q : (n,) or (..., n) array
            Configurations [rad, m].

        Returns
        -------
        (6, n) or (..., 6, n) array
            J with (v, ω) = J q̇ (paper eq. 3, read as note 5 of the corrections): rows of v [m/rad] for revolute and [1]
            for prismatic joints, rows of ω [1] for revolute joints and 0 for prismatic ones.
        """
        q = self.configuration(q, batch=True)
        out = np.empty((*q.shape[:-1], 6, self.n))
        kinematics.jacobian_batch(self.chain, q.reshape(-1, self.n), out.reshape(-1, 6, self.n))
        return out

    def singular_values(self, q: ArrayLike) -> Array:
        """Return the singular values of the geometric Jacobian; the last one is 0 at a singular configuration.

        The rows of J are in metres and in radians, so the values depend on the unit of length: they combine motion of
        the tool point [m] and rotation [rad] with equal weight, 1 m for 1 rad. Compare them only between configurations
        of one arm, or of arms of similar size.

        Parameters
        ----------
        q : (n,) or (..., n) array
            Configurations [rad, m].

        Returns
        -------
        (min(6, n),) or (..., min(6, n)) array
            In descending order, of mixed unit [m/rad or 1].
        """
        return np.asarray(np.linalg.svd(self.jacobian(q), compute_uv=False))

    def pose_errors(self, q: ArrayLike, targets: ArrayLike) -> Array:
        """Return the error twists (p_t − p, log(R_t Rᵀ)) in the base frame from the tool at q to the targets.

        Parameters
        ----------
        q : (n,) or (..., n) array
            Configurations [rad, m].
        targets : (4, 4) or (..., 4, 4) array
            Poses of the tool [1, m].

        Returns
        -------
        (6,) or (..., 6) array
            Position [m], then rotation [rad].

        Raises
        ------
        InvalidInput
            Wrong shapes, NaN or infinity.
        """
        q = self.configuration(q, batch=True)
        shape = (*q.shape[:-1], 4, 4)
        poses = real_array(targets, "targets", "poses (4, 4) or (..., 4, 4)")
        try:
            goal = np.array(np.broadcast_to(poses, shape), order="C").reshape(-1, 4, 4)
        except ValueError:
            raise InvalidInput("targets", f"shape {poses.shape}", f"poses of shape (4, 4) or {shape}") from None
        out = np.empty((*q.shape[:-1], 6))
        kinematics.errors_batch(self.chain, q.reshape(-1, self.n), goal, out.reshape(-1, 6))
        return out

    def compare(self, other: Robot, *, position: float = 1e-6, rotation: float = 1e-6) -> ArmComparison:
        """Compare with another model of the same arm, and explain the difference.

        The tool poses are compared at 40 fixed configurations inside the limits of both. If they differ, the simplest base,
        tool, joint zeros and joint directions that make them agree are searched and verified: other.fk(q) =
        base @ self.fk(signs * q + offsets) @ tool. A zero offset of the first joint equals a rotation of the base, one of
        the last joint a rotation of the tool; only one of the two is reported. The angle between the directions of gravity,
        with this base, is stated too.

        Parameters
        ----------
        other : Robot
            The other model, such as the same arm from a URDF.
        position, rotation : float
            Tolerances of the tool's position [m] and rotation [rad].

        Returns
        -------
        Comparison
            True if they agree; `str` describes the difference.

        Raises
        ------
        InvalidInput
            Not a Robot, or a tolerance that is not above 0.
        """
        from optik.arm.compare import compare_arms

        check_kind(other, "other", Robot)
        return compare_arms(self, other, position=position, rotation=rotation)


def _robot(arm: ArmModel) -> Robot:
    """Return the robot of an arm's data."""
    return Robot(**arm._arguments())


def _assemble(
    fixed: Sequence[Array], last: Array, table: Sequence[DHRow], limits: JointLimits, options: dict[str, Any]
) -> Robot:
    name = options.pop("name", "robot")
    if not table:
        raise RobotModelError(name, "no joints")
    base = se3.check_pose(options.pop("base", np.eye(4)), "base")
    tool = last @ se3.check_pose(options.pop("tool", np.eye(4)), "tool")
    given = ("joint_names", "gravity", "source", "gravity_magnitude", "inertia", "payload", "shapes")
    known = {key: options.pop(key) for key in given if key in options}
    if options:
        raise InvalidInput("options", ", ".join(options), f"some of name, base, tool, {', '.join(given)}")
    chain = np.array(fixed)
    chain[0] = base @ chain[0]
    return Robot(name, chain, np.array([r.prismatic for r in table]), tool, limits, **known)
