"""A serial arm: its joints, limits, base, tool and gravity; every convention becomes this one description."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from optik import kinematics, se3
from optik.arm.limits import JointLimits, frozen
from optik.arm.tables import DHRow, rows_of, screw_x, screw_z
from optik.check import check_flag, check_words, real_array
from optik.errors import InvalidInput, RobotModelError
from optik.types import Array

if TYPE_CHECKING:
    from optik.arm.compare import Comparison


@dataclass(frozen=True, eq=False)
class Robot:
    """A serial arm of revolute and prismatic joints about or along their z axes.

    Use `from_mdh`, `from_dh`, `from_urdf` or `optik.load`; a constructor's name states the convention.

    Parameters
    ----------
    name : str
        What reports call it.
    fixed : (n, 4, 4) array
        Transform from the joint before (the base, for the first) to each joint at q = 0, base transform included.
    prismatic : (n,) array of bool
        Which joints slide.
    tool : (4, 4) array
        From the last joint's frame to the tool.
    limits : JointLimits
        Of all n joints.
    joint_names : sequence of str, optional
        By default joint1, joint2, ….
    gravity : (3,) array, optional
        Direction of gravity in the base frame; −z by default.
    source : str
        Where the figures come from.
    """

    name: str
    fixed: Array
    prismatic: NDArray[np.bool_]
    tool: Array
    limits: JointLimits
    joint_names: tuple[str, ...] = ()
    gravity: Array = (0.0, 0.0, -1.0)  # type: ignore[assignment]
    source: str = ""

    def __post_init__(self) -> None:
        for field in ("name", "source"):
            if not isinstance(getattr(self, field), str):
                raise InvalidInput(field, repr(getattr(self, field))[:60], "a word")
        if not isinstance(self.limits, JointLimits):
            raise InvalidInput("limits", repr(self.limits)[:60], "JointLimits(lower, upper)")
        fixed = frozen(self.fixed, "fixed")
        n = fixed.shape[0] if fixed.ndim == 3 else 0
        if fixed.shape != (n, 4, 4) or n == 0:
            raise RobotModelError(self.name, f"fixed transforms of shape {fixed.shape}, expected (n, 4, 4)")
        for i in range(n):
            try:
                se3.check_pose(fixed[i], f"joint {i + 1}")
            except InvalidInput as error:
                raise RobotModelError(self.name, str(error)) from None
        fixed = frozen([se3.nearest_pose(T) for T in fixed], "fixed")
        if self.limits.lower.size != n:
            raise RobotModelError(self.name, f"{n} joints but limits for {self.limits.lower.size}")
        given = np.asarray(self.prismatic, dtype=object)
        if given.shape != (n,):
            raise RobotModelError(self.name, f"prismatic has shape {given.shape}, expected ({n},)")
        prismatic = np.array([check_flag(slides, f"prismatic[{i}]") for i, slides in enumerate(given)])
        prismatic.setflags(write=False)
        joint_names = check_words(self.joint_names, "joint_names") or tuple(f"joint{i + 1}" for i in range(n))
        if len(set(joint_names)) != n:
            raise RobotModelError(self.name, f"{n} joints need {n} different names, got {joint_names}")
        gravity = frozen(self.gravity, "gravity")
        if gravity.shape != (3,) or not np.isfinite(gravity).all() or not gravity.any():
            raise RobotModelError(self.name, "gravity is no direction (3,)")
        object.__setattr__(self, "fixed", fixed)
        object.__setattr__(self, "prismatic", prismatic)
        object.__setattr__(self, "tool", frozen(se3.nearest_pose(se3.check_pose(self.tool, "tool")), "tool"))
        object.__setattr__(self, "joint_names", joint_names)
        norm = float(np.linalg.norm(gravity))
        if abs(norm - 1.0) > 1e-14:  # a direction is kept to the last bit, so that a copy of the robot equals it
            gravity = gravity / norm
        object.__setattr__(self, "gravity", frozen(gravity, "gravity"))

    # ------------------------------------------------------------ conventions

    @staticmethod
    def from_mdh(rows: Iterable[DHRow | Mapping[str, Any]], limits: JointLimits, **options: Any) -> Robot:
        """Build from a modified (Craig) table: T_i = Rot(x, α_{i−1}) Trans(x, a_{i−1}) Rot(z, θ_i) Trans(z, d_i).

        Parameters
        ----------
        rows : iterable of DHRow or mapping
            Row i holds a_{i−1}, α_{i−1}, d_i, θ_i by name; metres and radians.
        limits : JointLimits
            Of all joints.
        **options
            name, base, tool (4×4), joint_names, gravity, source.

        Raises
        ------
        RobotModelError
            Not a serial arm.
        """
        table = rows_of(rows)
        fixed = [screw_x(r.alpha, r.a) @ screw_z(r.theta, r.d) for r in table]
        return _assemble(fixed, np.eye(4), table, limits, options)

    @staticmethod
    def from_dh(rows: Iterable[DHRow | Mapping[str, Any]], limits: JointLimits, **options: Any) -> Robot:
        """Build from a standard (distal) table: A_i = Rot(z, θ_i) Trans(z, d_i) Trans(x, a_i) Rot(x, α_i).

        Parameters
        ----------
        rows : iterable of DHRow or mapping
            Row i holds a_i, α_i, d_i, θ_i by name; metres and radians.
        limits : JointLimits
            Of all joints.
        **options
            name, base, tool (4×4), joint_names, gravity, source.

        Raises
        ------
        RobotModelError
            Not a serial arm.
        """
        table = rows_of(rows)
        before = [np.eye(4), *(screw_x(r.alpha, r.a) for r in table)]
        fixed = [b @ screw_z(r.theta, r.d) for b, r in zip(before, table, strict=False)]
        return _assemble(fixed, before[-1], table, limits, options)

    @staticmethod
    def from_urdf(
        source: str | os.PathLike[str],
        tip: str | None = None,
        base: str | None = None,
        *,
        name: str | None = None,
        gravity: ArrayLike = (0.0, 0.0, -1.0),
    ) -> Robot:
        """Read the chain between two links of a URDF.

        Fixed joints are merged into their neighbours. Limits and velocities are the file's; a velocity that is missing
        or 0 is not known (infinite, or None where none is known). Efforts, soft limits (<safety_controller>), masses
        and shapes are not read, nor is any joint off the chain.

        Parameters
        ----------
        source : str or path
            A file, or the XML itself (text that begins with <). xacro must be expanded before.
        tip, base : str, optional
            Names of links: the tool, by default the only link without children below the base; and the frame that
            poses are given in, by default the root.
        name : str, optional
            By default the file's.
        gravity : (3,) array, optional
            Direction of gravity in the base frame; −z by default.

        Raises
        ------
        InvalidInput
            No such file, no XML, no URDF, xacro, a DOCTYPE or an entity.
        RobotModelError
            No tree of links, no such link, no tip below the base, or a joint on the chain that cannot be one: floating,
            planar, following another (<mimic>), without an axis, with crossed or missing limits.
        """
        from optik.arm.urdf import read_urdf

        return read_urdf(source, tip, base, name=name, gravity=gravity)

    def to_urdf(self, path: str | os.PathLike[str] | None = None) -> str:
        """Return the arm as URDF text, from link ``base`` to link ``tool``, and write it to a file where one is named.

        It reads back to the same kinematics (1e-12), position limits and velocities. An effort or velocity of 0 says
        that it is not known. Acceleration, jerk, gravity and source have no place in URDF.

        Raises
        ------
        RobotModelError
            A prismatic joint without limits, a limit on one side only, or a name that XML cannot hold.
        OutputError
            The file cannot be written.
        """
        from optik.arm.urdf import write_urdf

        return write_urdf(self, path)

    def to_dict(self) -> dict[str, Any]:
        """Return the arm as plain data that JSON holds; `from_dict` reads it back to the last bit, infinite limits too."""
        from optik.arm.plain import robot_to_dict

        return robot_to_dict(self)

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> Robot:
        """Return the arm that `to_dict` wrote, equal to it and with the same fingerprint.

        Raises
        ------
        InvalidInput
            Missing or unknown keys, wrong lengths, or what is no number.
        RobotModelError
            No serial arm.
        """
        from optik.arm.plain import robot_from_dict

        return robot_from_dict(data)

    # ------------------------------------------------------------ identity

    @cached_property
    def _content(self) -> bytes:
        digest = hashlib.sha256(repr((self.name, self.joint_names)).encode())
        lim = self.limits
        for array in (self.fixed, self.prismatic, self.tool, self.gravity, lim.lower, lim.upper):
            digest.update(array.tobytes())
        for limit in (lim.velocity, lim.acceleration, lim.jerk):
            digest.update(b"-" if limit is None else limit.tobytes())
        return digest.digest()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Robot) and self._content == other._content

    def __hash__(self) -> int:
        return hash(self._content)

    def __reduce__(self) -> tuple[Any, ...]:
        return Robot, (
            self.name, self.fixed, self.prismatic, self.tool, self.limits, self.joint_names, self.gravity, self.source,
        )  # fmt: skip

    def __repr__(self) -> str:
        return f"Robot({self.name!r}, {self.n} joints)"

    @property
    def fingerprint(self) -> str:
        """First 16 hexadecimal digits of the content's SHA-256: equal for equal arms, on any machine."""
        return self._content.hex()[:16]

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.fixed.shape[0])

    @cached_property
    def chain(self) -> kinematics.Chain:
        """The arm as compiled kernels take it: (fixed, prismatic, tool)."""
        return self.fixed, self.prismatic, self.tool

    # ------------------------------------------------------------ kinematics

    def configuration(self, q: ArrayLike, argument: str = "q", *, batch: bool = False) -> Array:
        """Return q as a float64 array (n,), or (..., n) where a batch is allowed.

        Raises
        ------
        InvalidInput
            Wrong length, NaN or infinity.
        """
        array = real_array(q, argument, f"{self.n} joint values")
        if array.ndim == 0 or array.shape[-1] != self.n or (array.ndim > 1 and not batch):
            wanted = f"shape ({self.n},) or (..., {self.n})" if batch else f"shape ({self.n},)"
            raise InvalidInput(argument, f"shape {np.shape(q)}", f"joint values of {wanted} for {self.name}")
        if not np.isfinite(array).all():
            raise InvalidInput(argument, "NaN or infinity in it", "finite joint values")
        return array

    def fk(self, q: ArrayLike) -> Array:
        """Tool poses in the base frame.

        Parameters
        ----------
        q : (n,) or (..., n) array
            Configurations [rad, m].

        Returns
        -------
        (4, 4) or (..., 4, 4) array
            T_base_tool (paper eq. 1–2).
        """
        q = self.configuration(q, batch=True)
        out = np.empty((*q.shape[:-1], 4, 4))
        kinematics.fk_batch(self.chain, q.reshape(-1, self.n), out.reshape(-1, 4, 4))
        return out

    def frames(self, q: ArrayLike) -> Array:
        """Joint frames and, last, the tool pose: (..., n + 1, 4, 4) in the base frame; what draws the arm."""
        q = self.configuration(q, batch=True)
        out = np.empty((*q.shape[:-1], self.n + 1, 4, 4))
        flat = out.reshape(-1, self.n + 1, 4, 4)
        kinematics.frames_batch(self.chain, q.reshape(-1, self.n), flat)
        return out

    def jacobian(self, q: ArrayLike) -> Array:
        """Geometric Jacobians, rows (v, ω) in the base frame at the tool point.

        Parameters
        ----------
        q : (n,) or (..., n) array
            Configurations [rad, m].

        Returns
        -------
        (6, n) or (..., 6, n) array
            J with (v, ω) = J q̇ (paper eq. 3, read as note 5 of the corrections).
        """
        q = self.configuration(q, batch=True)
        out = np.empty((*q.shape[:-1], 6, self.n))
        kinematics.jacobian_batch(self.chain, q.reshape(-1, self.n), out.reshape(-1, 6, self.n))
        return out

    def errors(self, q: ArrayLike, targets: ArrayLike) -> Array:
        """Error twists (..., 6), (p_t − p, log(R_t Rᵀ)) in the base frame, from the tool at q to the targets.

        q is (..., n) and targets (4, 4) or (..., 4, 4). This is what judges every method.
        """
        q = self.configuration(q, batch=True)
        shape = (*q.shape[:-1], 4, 4)
        poses = real_array(targets, "targets", "poses (4, 4) or (..., 4, 4)")
        try:
            goal = np.ascontiguousarray(np.broadcast_to(poses, shape)).reshape(-1, 4, 4)
        except ValueError:
            raise InvalidInput("targets", f"shape {poses.shape}", f"poses of shape (4, 4) or {shape}") from None
        out = np.empty((*q.shape[:-1], 6))
        kinematics.errors_batch(self.chain, q.reshape(-1, self.n), goal, out.reshape(-1, 6))
        return out

    def with_tool(self, tool: ArrayLike) -> Robot:
        """Return the same arm with another tool transform, last joint frame to tool, (4, 4)."""
        T = se3.check_pose(tool, "tool")
        return Robot(self.name, self.fixed, self.prismatic, T, self.limits, self.joint_names, self.gravity, self.source)

    def compare(self, other: Robot, *, position: float = 1e-6, rotation: float = 1e-6) -> Comparison:
        """Compare with another model of the same arm, and say what explains the difference.

        The tool poses are compared at 40 configurations that are always the same, inside the limits of both. If they
        differ, the simplest base, tool, joint zeros and joint directions that make them agree are searched for and
        verified: other.fk(q) = base @ self.fk(signs * q + offsets) @ tool. A turn of the first joint's zero is also one
        of the base, and of the last joint's one of the tool; one of the two is named.

        Parameters
        ----------
        other : Robot
            The other model, such as the same arm from a URDF.
        position, rotation : float
            Differences up to here [m], [rad] are none.

        Returns
        -------
        Comparison
            True where they agree; `str` says what differs.

        Raises
        ------
        InvalidInput
            No Robot, or a tolerance that is not above 0.
        """
        from optik.arm.compare import compare_robots

        return compare_robots(self, other, position=position, rotation=rotation)


def _assemble(
    fixed: Sequence[Array], last: Array, table: Sequence[DHRow], limits: JointLimits, options: dict[str, Any]
) -> Robot:
    name = options.pop("name", "robot")
    if not table:
        raise RobotModelError(name, "no joints")
    base = se3.check_pose(options.pop("base", np.eye(4)), "base")
    tool = last @ se3.check_pose(options.pop("tool", np.eye(4)), "tool")
    known = {k: options.pop(k) for k in ("joint_names", "gravity", "source") if k in options}
    if options:
        raise InvalidInput("options", ", ".join(options), "name, base, tool, joint_names, gravity or source")
    chain = np.array(fixed)
    chain[0] = base @ chain[0]
    return Robot(name, chain, np.array([r.prismatic for r in table]), tool, limits, **known)
