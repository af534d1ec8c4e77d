"""Groups: several mechanisms in one world on one clock, and the chains through two of them.

A TOML file describes a group by its members:

    [members.arm]
    robot = "ur10e"              # a name, or a file relative to this one
    base = { xyz_mm = [0.0, 0.0, 400.0] }                     # optional: where the robot's base frame stands in the world
    tool = { xyz_mm = [0.0, 0.0, 150.0], rpy_deg = [0.0, 40.0, 0.0] }   # optional: replaces the tool of the robot

    dynamic_limits = { acceleration = 10.0, jerk = 100.0 }    # optional: in rad and m, a number or one for each joint
    payload_kg = 2.0             # optional: at the origin of the tool's frame

    [members.table]
    robot = "table.urdf"
    base = { xyz_mm = [900.0, 0.0, 0.0] }
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.chains import join_chains, join_limits, join_members
from optik.arm.library import load
from optik.arm.limits import DYNAMIC_LIMITS, ByContent, JointLimits, check_positive
from optik.arm.plain import read_pose, read_record, read_word
from optik.arm.robot import Robot
from optik.card import Card
from optik.check import check_number, locate_error, real_array
from optik.errors import InvalidInput
from optik.file_io import decode_text, parse_toml, read_bytes
from optik.plugins.files import is_path
from optik.types import Array, Indices

WORLD = "world"
"""Name of the frame in which the bases of the members stand."""


@dataclass(frozen=True, eq=False, init=False)
class Group(ByContent):
    """Several mechanisms in one world on one clock: two arms, or an arm and a positioner.

    A configuration is the concatenation of the joints of all members, in the order of the members.

    Parameters
    ----------
    members : mapping of str to Robot, optional
        The members by name.
    **named : Robot
        Further members. The base of each places it in the world: `Robot.with_base`.

    Raises
    ------
    InvalidInput
        Fewer than two members, a name that is empty, ``"world"`` or has a slash, or a member that is not a Robot.
    """

    members: Mapping[str, Robot]

    def __init__(self, members: Mapping[str, Robot] = MappingProxyType({}), /, **named: Robot) -> None:
        every = {**members, **named}
        if len(every) < 2:
            raise InvalidInput("members", ", ".join(every) or "none", "two robots or more, each with a name")
        for name, robot in every.items():
            if not isinstance(name, str) or not name or "/" in name or name == WORLD:
                raise InvalidInput("members", repr(name)[:60], f"names without a slash, other than {WORLD!r}")
            if not isinstance(robot, Robot):
                raise InvalidInput(name, repr(robot)[:60], "a Robot")
        object.__setattr__(self, "members", MappingProxyType(every))

    def __reduce__(self) -> tuple[Any, ...]:
        return Group, (dict(self.members),)

    @property
    def content(self) -> Any:
        """The members, as hashable values."""
        return tuple((name, robot.fingerprint) for name, robot in self.members.items())

    def __repr__(self) -> str:
        return f"Group({', '.join(f'{name}={robot.name!r}' for name, robot in self.members.items())}; {self.n} joints)"

    def __str__(self) -> str:
        return "\n\n".join([repr(self), *(f"{name}: {robot}" for name, robot in self.members.items())])

    def _repr_html_(self) -> str:
        """Return the tables of the members for a notebook."""
        return Card(title=repr(self)).to_html() + "".join(robot._repr_html_() for robot in self.members.values())

    # ------------------------------------------------------------ joints

    @property
    def n(self) -> int:
        """Number of joints of all members."""
        return sum(robot.n for robot in self.members.values())

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names (n) of the joints, as ``MEMBER/JOINT``."""
        return tuple(f"{name}/{joint}" for name, robot in self.members.items() for joint in robot.joint_names)

    @cached_property
    def limits(self) -> JointLimits:
        """Ranges and limits of all joints.

        If only some members have a limit, such as on jerk, it is infinite for the joints of the others.
        """
        robots = self.members.values()
        return JointLimits(**join_limits([one.limits for one in robots], [np.arange(one.n) for one in robots]))

    def columns(self, member: str) -> Indices:
        """Return the indices of a member's joints among those of the group.

        Parameters
        ----------
        member : str
            Its name.

        Returns
        -------
        (k,) array of int

        Raises
        ------
        InvalidInput
            An unknown name.
        """
        self._check(member, "member")
        names = list(self.members)
        before = sum(self.members[name].n for name in names[: names.index(member)])
        return before + np.arange(self.members[member].n)

    def split(self, q: ArrayLike) -> dict[str, Array]:
        """Return the joints of each member.

        Parameters
        ----------
        q : (..., n) array
            Joints of the group [rad, m], or one of their derivatives.

        Returns
        -------
        dict of (..., k) arrays
            The joints of each member [rad, m], by its name.
        """
        values = real_array(q, "q", f"values of {self.n} joints", (..., self.n))
        return {name: values[..., self.columns(name)] for name in self.members}

    def stack(self, joints: Mapping[str, ArrayLike]) -> Array:
        """Return the joints of the group from those of all members.

        Parameters
        ----------
        joints : mapping of str to (..., k) array
            The joints of each member [rad, m], or one of their derivatives, by its name.

        Returns
        -------
        (..., n) array
            [rad, m].

        Raises
        ------
        InvalidInput
            A member that is missing or unknown, or a wrong number of joints.
        """
        if not isinstance(joints, Mapping) or joints.keys() != self.members.keys():
            got = ", ".join(map(str, joints)) if isinstance(joints, Mapping) else repr(joints)[:60]
            raise InvalidInput("joints", got, f"the joints of {', '.join(self.members)}")
        parts = [robot.configuration(joints[name], name, batch=True) for name, robot in self.members.items()]
        return np.concatenate(parts, axis=-1)

    # ------------------------------------------------------------ chains

    def fk(self, q: ArrayLike) -> dict[str, Array]:
        """Return the poses of all tools in the world.

        Parameters
        ----------
        q : (..., n) array
            Joints of the group [rad, m].

        Returns
        -------
        dict of (..., 4, 4) arrays
            The pose of each tool [1, m], by the name of the member.
        """
        return {name: self.members[name].fk(part) for name, part in self.split(q).items()}

    def chain(self, frame: str, tool: str) -> Robot:
        """Return the serial chain from the tool of one member to the tool of another.

        Its joints are those of `frame` in reverse order, then those of `tool`; `order` has their indices. Its base moves, so it
        has neither gravity nor masses, and limits on torques and on payloads (containers, trays, grips, suction) are refused
        for it.

        Parameters
        ----------
        frame, tool : str
            Names of two members. The frame ``"world"`` returns the member `tool` itself.

        Returns
        -------
        Robot

        Raises
        ------
        InvalidInput
            An unknown name, or the same twice.
        """
        self._check(tool, "tool")
        if frame == WORLD:
            return self.members[tool]
        self._check(frame, "frame", WORLD)
        if frame == tool:
            raise InvalidInput("frame", repr(frame), f"another member than the tool, or {WORLD!r}")
        kept: dict[tuple[str, str], Robot] = self.__dict__.setdefault("_chains", {})
        if (frame, tool) not in kept:
            kept[frame, tool] = join_chains(self.members[frame], self.members[tool], (frame, tool))
        return kept[frame, tool]

    def order(self, frame: str, tool: str) -> Indices:
        """Return the index in the group of each joint of a chain.

        Parameters
        ----------
        frame, tool : str
            Names of two members, as in `chain`.

        Returns
        -------
        (k,) array of int
            ``q[..., group.order(frame, tool)]`` are the joints of the chain.
        """
        own = self.columns(tool)
        return own if frame == WORLD else np.concatenate([self.columns(frame)[::-1], own])

    def as_robot(self, tool: str | None = None) -> Robot:
        """Return all members as one robot in the world, which has their joints in the order of the group.

        It has no masses, so limits on torques are refused for it. Its serial chain passes through each other member and back to
        the world, and last through `tool`. On the way back, the axes of a member are repeated in reverse, with the opposite
        sign. They add no joints.

        Parameters
        ----------
        tool : str, optional
            The member whose tool is that of the robot, by default the last one.

        Returns
        -------
        Robot

        Raises
        ------
        InvalidInput
            An unknown name.
        """
        tool = list(self.members)[-1] if tool is None else tool
        self._check(tool, "tool")
        kept: dict[str, Robot] = self.__dict__.setdefault("_robots", {})
        return kept.get(tool) or kept.setdefault(tool, join_members(self.members, tool))

    def places(self, robot: Robot) -> Indices:
        """Return the index in a robot of each joint of the group, found by its name.

        Parameters
        ----------
        robot : Robot
            A chain through all members, or `as_robot`.

        Returns
        -------
        (n,) array of int
            ``q[..., group.places(robot)]`` are the joints of the group.

        Raises
        ------
        InvalidInput
            A robot with other joints.
        """
        names, wanted = robot.joint_names, self.joint_names
        if set(names) != set(wanted):
            raise InvalidInput("robot", ", ".join(names)[:80], f"the joints of the group, {', '.join(wanted)}"[:80])
        return np.array([names.index(name) for name in wanted])

    def with_payload(
        self, mass: float, com: ArrayLike = (0.0, 0.0, 0.0), inertia: ArrayLike | None = None, *,
        fraction: tuple[float, float] = (0.4, 0.6),
    ) -> Group:  # fmt: skip
        """Return the group with a payload that its two members carry together.

        Parameters
        ----------
        mass : float
            Mass of the body [kg].
        com : (3,) array, optional
            Its centre of mass in the frame of both tools [m].
        inertia : (3, 3) array, optional
            Its inertia about the centre of mass [kg·m²]; by default a point mass.
        fraction : (2,) tuple of float
            Smallest and largest fraction of the mass that the first member carries; the second one carries the remainder.
            Internal forces, with which the arms squeeze or stretch the body, are not modelled.

        Returns
        -------
        Group

        Raises
        ------
        InvalidInput
            Not two members, or fractions that are not in order between 0 and 1.
        """
        low, high = (check_number(one, "fraction", "numbers from 0 to 1", least=0.0) for one in fraction)
        if len(self.members) != 2:
            raise InvalidInput("group", f"{len(self.members)} members", "two members, which carry the body")
        if not low <= high <= 1.0:
            raise InvalidInput("fraction", repr(fraction)[:60], "(smallest, largest) between 0 and 1")
        parts, whole = ((low, high), (1.0 - high, 1.0 - low)), None if inertia is None else np.asarray(inertia)
        return Group({
            name: robot.with_payload((a * mass, b * mass), com, None if whole is None else b * whole)
            for (name, robot), (a, b) in zip(self.members.items(), parts, strict=True)
        })  # fmt: skip

    def _check(self, name: str, argument: str, *others: str) -> None:
        """Raise InvalidInput for a name that is not that of a member."""
        if name not in self.members:
            raise InvalidInput(argument, repr(name)[:60], " or ".join((*self.members, *others)))

    # ------------------------------------------------------------ files

    def to_dict(self) -> dict[str, Any]:
        """Return the group as plain data for JSON; `from_dict` restores exactly the same values."""
        return {"members": {name: robot.to_dict() for name, robot in self.members.items()}}

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> Group:
        """Return the group that `to_dict` wrote.

        Parameters
        ----------
        data : mapping
            The result of `to_dict`.

        Returns
        -------
        Group

        Raises
        ------
        InvalidInput
            Other data.
        """
        members = read_record(data, ("members",), "group")["members"]
        if not isinstance(members, dict):
            raise InvalidInput("group.members", repr(members)[:60], "a mapping from names to robots")
        return Group({name: Robot.from_dict(one) for name, one in members.items()})

    @staticmethod
    def load(file: str | os.PathLike[str]) -> Group:
        """Read a group from a TOML file.

        Parameters
        ----------
        file : str or path
            A file with a table ``[members.NAME]`` for each member. Its keys are:

            - ``robot``: the name or the file of a robot;
            - ``base``, optional: the pose of its base frame in the world, with ``xyz_mm`` and ``rpy_deg``;
            - ``tool``, optional: a pose with ``xyz_mm`` and ``rpy_deg`` that replaces the tool of the robot;
            - ``dynamic_limits``, optional: ``velocity``, ``acceleration``, ``jerk``, ``torque`` and ``torque_rate``, which
              replace those of the robot;
            - ``payload_kg``, optional: a mass at the origin of the tool's frame.

        Returns
        -------
        Group

        Raises
        ------
        InvalidInput
            No such file, or not a group.
        """
        return Group(_read_members(Path(file)))


def read_group(name: str) -> Group | None:
    """Return the group in a TOML file, or None if the argument is the name or file of a single robot."""
    file = Path(name)
    if file.suffix.lower() != ".toml" or not file.is_file():
        return None
    return Group.load(file) if "members" in parse_toml(decode_text(read_bytes(file), file.name), file.name) else None


def _read_members(file: Path) -> dict[str, Robot]:
    """Return the members of a group's file."""
    text = decode_text(read_bytes(file, argument="file", expected="a readable TOML file of a group"), file.name)
    try:
        members = read_record(parse_toml(text, file.name), ("members",), "the file")["members"]
        return {name: _read_member(one, f"members.{name}", file.parent) for name, one in members.items()}
    except InvalidInput as error:
        raise locate_error(file.name, error) from None


def _read_member(data: Any, where: str, folder: Path) -> Robot:
    """Return a member of a group's file."""
    read_record(data, ("robot",), where, optional=("base", "tool", "dynamic_limits", "payload_kg"))
    name = read_word(data["robot"], f"{where}.robot")
    robot = load(str(folder / name) if is_path(name) else name)
    rates = read_record(data.get("dynamic_limits", {}), (), f"{where}.dynamic_limits", optional=DYNAMIC_LIMITS)
    checked: Any = {key: check_positive(x, robot.n, f"{where}.{key}") for key, x in rates.items()}
    robot = robot.with_limits(**checked)
    if "base" in data:
        robot = robot.with_base(read_pose(data["base"], f"{where}.base"))
    if "payload_kg" in data:
        robot = robot.with_payload(check_number(data["payload_kg"], f"{where}.payload_kg", "a mass [kg]", least=0.0))
    return robot.with_tool(read_pose(data["tool"], f"{where}.tool")) if "tool" in data else robot
