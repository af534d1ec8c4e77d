"""Robots by name, from TOML, URDF, xacro, JSON and Python files, and descriptions that `robot_descriptions` downloads.

A TOML file, such as those of optik, describes one arm by a Denavit–Hartenberg table:

    convention = "dh"                    # "dh" (standard, distal) or "mdh" (modified, Craig)
    source = "data sheet, revision 3"    # optional: source of the numbers; by default the file's name
    joint_names = ["elbow", "slide"]     # optional: by default joint1, joint2, …
    home_deg = [0.0, 90.0]               # optional: the default start of commands; sliding joints in millimetres
    gravity = [0.0, 0.0, -1.0]           # optional: direction of gravity in the base frame; by default its −z
    gravity_magnitude = 9.80665          # optional: acceleration of free fall, m/s²; 0 without weight
    base = { xyz_mm = [0.0, 0.0, 500.0], rpy_deg = [0.0, 0.0, 90.0] }   # optional: before the first row's transform
    tool = { xyz_mm = [0.0, 0.0, 120.0] }                               # optional: after the last row's transform

    joints = [  # one row for each joint, from the base to the tool; lengths and angles default to 0
      { a_mm = 0.0, alpha_deg = -90.0, d_mm = 290.0, theta_deg = 0.0, range_deg = [-165.0, 165.0], speed_deg = 250.0 },
      { type = "prismatic", a_mm = 250.0, range_mm = [0.0, 180.0], speed_mm = 1020.0 },
    ]

    [dynamic_limits]                     # optional: a number for all joints, or a list with one for each
    velocity = 2.0                       # rad/s or m/s, where the rows have no speeds
    acceleration = [10.0, 10.0]          # rad/s² or m/s²
    jerk = 100.0                         # rad/s³ or m/s³
    torque = [97.6, 520.0]               # N·m or N
    torque_rate = 1000.0                 # N·m/s or N/s

    [inertia]                            # optional: required for torques
    source = "identified by us, 2024"    # optional: by default the file's source

    [[inertia.links]]                    # one for each joint: the link that it moves; values default to 0
    mass_kg = 17.4
    com_mm = [-363.8, 6.0, 227.5]
    inertia = [0.13, 0.524, 0.539, 0.0, 0.0, 0.0]
    motor = 2.325
    viscous = 9.5
    coulomb = 13.6

    [[inertia.links]]
    mass_kg = 5.0

    [shapes]                             # optional: capsules that enclose the links, required for collision checks
    source = "measured by us"            # optional: by default the file's source
    capsules = [                         # link: 0 or "base", or the number or the name of the joint that moves it
      { link = "base", a_mm = [0.0, 0.0, -250.0], b_mm = [0.0, 0.0, -90.0], radius_mm = 95.0 },
      { link = 1, centre_mm = [-120.0, 40.0, 0.0], radius_mm = 110.0, excess_mm = 15.0, name = "motor" },
    ]
    apart = [ { links = ["base", "motor"], reason = "the motor turns above the base" } ]   # optional: not checked

A row names its position limits by one of range_deg, range_rad and range_mm, and its velocity by speed_deg [°/s] or
speed_mm [mm/s], in all rows or in none. Millimetres belong to prismatic joints, degrees and radians to revolute ones;
[-inf, inf] stands for a joint without position limits.

Centres of mass and inertias are given in the frames of the table, as in the literature. The frame of row i moves with joint
i: in a standard table it lies a_i and α_i behind the joint, in a modified table at the joint. `inertia` is about the centre
of mass, in kg·m², in the order xx, yy, zz, xy, xz, yz. `motor` is the inertia of motor and gears reflected to the joint (the
motor's inertia times the square of the gear ratio) in kg·m² or kg, `viscous` is in N·m·s/rad or N·s/m, `coulomb` in N·m or N.

A capsule, all points within a radius of a segment, encloses its link and is given in the same frames; the frame of the base
is the robot's base frame. The excess is the largest distance of the capsule's surface from the link. The last link carries
the tool.
"""

from __future__ import annotations

import importlib
import os
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from math import pi
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.inertia import STANDARD_GRAVITY, Inertia
from optik.arm.limits import DYNAMIC_LIMITS, JointLimits, VelocityByPosition, check_positive, warn_of_degrees
from optik.arm.plain import read_list, read_numbers, read_pose, read_record, read_vector, read_word
from optik.arm.robot import DHRow, Robot
from optik.arm.shapes import Shapes
from optik.arm.shapes.urdf import Folders, MeshFolders, find_package
from optik.check import (
    check_choice,
    check_count,
    check_flag,
    check_keywords,
    check_number,
    check_words,
    format_value,
    locate_error,
)
from optik.errors import InvalidInput, MissingDependency
from optik.file_io import decode_text, parse_json, parse_toml, read_bytes
from optik.plugins.files import check_code_allowed, is_path, resolve_file, split_links
from optik.registry import data_file, load_method, own_names
from optik.types import Array

# ---------------- robots of other programs


PREFIX = "robot_descriptions:"
"""Begin of the name of a description: ``robot_descriptions:panda_description``."""


URDF = (".urdf", ".xml", ".xacro")
"""Suffixes of URDF files, and of xacro files, which are expanded."""
URDF_OPTIONS = {"tip", "base", "gravity", "shapes", "packages", "srdf", "without_shape", "hold"}
"""Options that may follow the path of a URDF."""
URDF_SYNTAX = (
    "options of a URDF, any of: #tip=LINK&base=LINK&gravity=X,Y,Z&shapes=yes&packages=FOLDER&srdf=FILE"
    "&without_shape=LINK&hold=JOINT:VALUE"
)
"""Syntax of these options, for messages."""


class Description(NamedTuple):
    """A description on this machine: its URDF or xacro file, arguments for xacro, and folders that contain its packages."""

    file: Path
    arguments: Mapping[str, str]
    packages: tuple[str, ...]


def find_description(name: str) -> Description:
    """Return a description of `robot_descriptions` by its name, with or without `PREFIX`; it is downloaded if need be."""
    module = name.removeprefix(PREFIX)
    if not re.fullmatch(r"\w+_description", module):
        raise InvalidInput("robot", repr(name), f"{PREFIX}NAME_description, such as {PREFIX}panda_description")
    try:
        importlib.import_module("robot_descriptions")
    except ModuleNotFoundError:
        raise MissingDependency("robot_descriptions", f"robot {name!r}", "robots") from None
    try:
        package = importlib.import_module(f"robot_descriptions.{module}")
    except ModuleNotFoundError:
        raise InvalidInput("robot", repr(name), "a description of the package robot_descriptions") from None
    except Exception as error:  # git has many errors
        words = " ".join(str(error).split())[:160]
        raise InvalidInput("robot", f"{name!r}: {words}", "a description that can be downloaded") from error
    file = getattr(package, "URDF_PATH", None) or getattr(package, "XACRO_PATH", None)
    if file is None:
        raise InvalidInput("robot", f"{name!r}, which has no URDF", "a description with a URDF")
    packages = dict.fromkeys(str(Path(path).parent) for path in (package.PACKAGE_PATH, package.REPOSITORY_PATH))
    return Description(Path(file), getattr(package, "XACRO_ARGS", {}), tuple(packages))


def expand_xacro(file: Path, arguments: Mapping[str, str], packages: Folders = None) -> str:
    """Return the URDF text of a xacro file, whose expressions are run; packages are also searched above and beside it."""
    check_code_allowed(file)
    try:
        from xacrodoc import XacroDoc
        from xacrodoc import packages as known
    except ModuleNotFoundError:
        raise MissingDependency("xacrodoc", f"{file.name}", "robots") from None
    known.reset()  # packages of another file may have the same names
    folders = () if isinstance(packages, Mapping) else [Path(folder) for folder in packages or ()]
    known.look_in([str(folder) for folder in folders])
    known.update_package_cache(dict(packages) if isinstance(packages, Mapping) else {})
    while True:
        try:
            document = XacroDoc.from_file(str(file), subargs=dict(arguments), resolve_packages=False)
            return str(document.to_urdf_string())
        except Exception as error:  # xacro raises what its expressions raise
            words = " ".join(str(error).split())[:160] or type(error).__name__
            missing = re.search(r"Package not found: ([-\w]+)", str(error))
            folder = missing and find_package(missing[1], file.absolute().parent, folders)
            if not missing or folder is None:
                advice = "name the folder of its package (package_dirs=)"
                got, expected = f"{file.name}: {words}", "a xacro file that can be expanded"
                raise InvalidInput("robot", got, expected, advice=advice if missing else "") from error
            known.update_package_cache({missing[1]: folder})


def load_description(name: str, links: dict[str, Any]) -> Robot:
    """Read a robot of the package `robot_descriptions`, with options of its URDF."""
    made = find_description(name)
    return load_urdf(made.file, links, made.arguments, made.packages)


def load_urdf(
    file: Path, links: dict[str, Any], arguments: Mapping[str, str] | None = None, folders: Sequence[str] = ()
) -> Robot:
    """Read a robot from a URDF or a xacro file, with arguments for xacro and folders of its packages."""
    known = (*URDF_OPTIONS, "values", "package_dirs")
    options = _urdf_options({key: value for key, value in links.items() if key in known})
    others = {key: value for key, value in links.items() if key not in known}
    package_dirs = options.pop("package_dirs", None)
    packages = package_dirs if isinstance(package_dirs, Mapping) else [*folders, *(package_dirs or ())]
    source: str | Path = file
    if file.suffix.lower() == ".xacro":
        source = expand_xacro(file, {**(arguments or {}), **others}, packages)
        options["shapes"] &= "shapes" in links or "<collision" in source  # its packages may have other things
    elif others:
        raise InvalidInput("robot", "&".join(f"{key}={value}" for key, value in others.items()), URDF_SYNTAX)
    try:
        if options["shapes"]:
            options["package_dirs"] = MeshFolders(file.absolute().parent, packages)
        return Robot.from_urdf(source, **options)
    except InvalidInput as error:
        where = f"robot {str(file)!r}" if error.argument == "source" else error.argument
        raise InvalidInput(where, error.got, error.expected, advice=error.advice) from None


def parse_urdf_options(text: str) -> dict[str, str]:
    """Parse the options behind a URDF's path, ``tip=tool0&base=base_link``; others are arguments of xacro."""
    links = dict(part.partition("=")[::2] for part in text.split("&")) if text else {}
    if not all(links) or not all(links.values()) or links.get("shapes", "yes") not in ("yes", "no"):
        raise InvalidInput("robot", repr(text), URDF_SYNTAX)
    return links


def _urdf_options(links: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments of `Robot.from_urdf` for the options of a path; any option of shapes implies shapes=yes."""
    options: dict[str, Any] = {key: value for key, value in links.items() if key not in ("packages", "shapes", "hold")}
    if isinstance(text := links.get("gravity"), str):
        try:
            options["gravity"] = [float(word) for word in text.split(",")]
        except ValueError:
            raise InvalidInput("gravity", repr(text), "three numbers, X,Y,Z") from None
    if isinstance(text := links.get("without_shape"), str):
        options["without_shape"] = text.split(",")
    if "hold" in links:
        holds = [part.rpartition(":") for part in links["hold"].split(",")]
        try:
            options.setdefault("values", {name: float(value) for name, _, value in holds})
        except ValueError:
            raise InvalidInput("hold", repr(links["hold"]), "JOINT:VALUE,JOINT:VALUE [rad, m]") from None
    if "packages" in links:
        options.setdefault("package_dirs", [links["packages"]])
    implied = "yes" if {"srdf", "packages", "package_dirs", "without_shape"} & set(links) else "no"
    options["shapes"] = links.get("shapes", implied) == "yes"
    return options


# ---------------- robots by name and from TOML


ROBOTS = "optik.robots"
"""Name of the group of robots."""
RADIANS_PER_DEGREE = pi / 180.0
"""Factor from the degrees of data sheets to radians."""
MOST_TOML_BYTES = 2**20
"""Largest file that is read [bytes]: a thousand times that of an arm of seven joints."""
CONVENTIONS = {"mdh": Robot.from_mdh, "dh": Robot.from_dh}
"""Constructors by the convention of the rows: modified (Craig) or standard (distal)."""
REQUIRED_KEYS = ("convention", "joints")
"""Keys that every file has."""
OPTIONAL_KEYS = (
    "source", "joint_names", "home_deg", "gravity", "gravity_magnitude", "base", "tool", "dynamic_limits", "inertia", "shapes",
    "motors",
)  # fmt: skip
"""Keys that a file may have."""
RANGES = {"range_deg": RADIANS_PER_DEGREE, "range_rad": 1.0, "range_mm": 1e-3}
"""Keys of a joint's position limits, and the factor to radians or metres."""
SPEEDS = {"speed_deg": RADIANS_PER_DEGREE, "speed_mm": 1e-3}
"""Keys of a joint's velocity limit, and the factor to rad/s or m/s."""
JOINT_KEYS = ("type", "a_mm", "alpha_deg", "d_mm", "theta_deg", *RANGES, *SPEEDS)
"""Keys of a row; the type of the joint determines the required ones."""
CAPSULE_KEYS = ("a_mm", "b_mm", "centre_mm", "excess_mm", "name")
"""Keys of a capsule's row besides its link and radius."""
LINK_KEYS = ("mass_kg", "com_mm", "inertia", "motor", "viscous", "coulomb")
"""Keys of a row of masses."""


@check_keywords
def load(
    name: str | os.PathLike[str], *, tip: str | None = None, base: str | None = None,
    values: Mapping[str, float] | None = None, gravity: ArrayLike | None = None, without_shape: Sequence[str] | None = None,
    shapes: bool | None = None, package_dirs: Folders = None, srdf: str | os.PathLike[str] | None = None,
) -> Robot:  # fmt: skip
    """Load a robot by name or from a file.

    Parameters
    ----------
    name : str or path
        A name from `optik.robots()`; ``"robot_descriptions:panda_description"``, which that package downloads; or the path
        of a TOML file as those in ``optik/robots``, of a URDF, of a xacro file (its expressions are run), of a JSON file of
        `Robot.to_dict`, or of a Python file whose ``METHOD`` is a robot or returns one (it is run). Options of a URDF can
        follow its path: ``"./arm.urdf#tip=tool0&base=base_link&gravity=0,0,-1"``, ``shapes=yes`` to read its <collision>
        elements, with ``packages=FOLDER`` for a folder of packages, ``srdf=FILE``, ``without_shape=LINK,LINK``,
        ``hold=JOINT:VALUE,JOINT:VALUE``, and arguments of xacro.
    tip : str, optional
        Link of the tool of a URDF, as in `Robot.from_urdf`.
    base : str, optional
        Link of the base frame of a URDF; by default its root.
    values : mapping of str to float, optional
        Values at which joints of a URDF beside the chain are held [rad, m].
    gravity : (3,) array, optional
        Direction of gravity in the base frame [1], in place of the file's.
    shapes : bool, optional
        Whether the <collision> elements of a URDF are read; by default as the options behind its path say, or if one of
        the arguments about them is given: ``without_shape``, ``package_dirs``, ``srdf``.
    without_shape : sequence of str, optional
        Links of a URDF whose <collision> is not read.
    package_dirs : mapping of str to path, or sequence of paths, optional
        Folders of the packages that a URDF or xacro file names, as in `Robot.from_urdf`.
    srdf : str or path, optional
        SRDF of a URDF, as in `Robot.from_urdf`.

    Returns
    -------
    Robot

    Raises
    ------
    UnknownName
        No such robot; the error lists similar names.
    InvalidInput
        No such file, no robot in it, or a link for a file that is not a URDF.
    RobotModelError
        As `Robot.from_urdf`.
    """
    if not isinstance(name, str | os.PathLike):
        raise InvalidInput("name", repr(name)[:60], "a name from optik.robots(), or the path of a file")
    options: dict[str, Any] = {"tip": tip, "base": base, "values": values, "gravity": gravity}
    options |= {"without_shape": without_shape, "package_dirs": package_dirs, "srdf": srdf}
    if shapes is not None:
        options["shapes"] = "yes" if check_flag(shapes, "shapes") else "no"
    return _load(name, {key: value for key, value in options.items() if value is not None})


def _load(name: str | os.PathLike[str], given: dict[str, Any]) -> Robot:
    """Load a robot with the given options; every arm takes gravity, and a URDF the others."""
    foreign = str(name).startswith(PREFIX)
    path, links = split_links(os.fspath(name)) if foreign or is_path(name) else ("", "")
    urdf = foreign or Path(path).suffix.lower() in URDF
    if "gravity" in given and not urdf:
        others = {key: value for key, value in given.items() if key != "gravity"}
        return _load(name, others).with_gravity(given["gravity"])
    if path:
        # A URDF contains the robot's name, so its file may be named like one of our robots.
        if not urdf:
            data_file(ROBOTS, path, "robot")
        return _from_file(path, {**parse_urdf_options(links), **given})
    for argument, value in given.items():
        raise InvalidInput(argument, format_value(value), f"none: {name!r} is no URDF file")
    if name in own_names(ROBOTS):
        return robot_from_toml(data_file(ROBOTS, str(name), "robot"))
    return _resolve_robot(load_method(ROBOTS, name, "robot"), f"robot {name!r}", str(name))


def _from_file(path: str, links: dict[str, Any], name: str | None = None) -> Robot:
    """Read a robot from a file; a TOML file contains no name, so it takes the given one or its stem."""
    if path.startswith(PREFIX):
        return load_description(path, links)
    suffix, file = Path(path).suffix.lower(), resolve_file(path, "robot")
    if suffix in URDF:
        return load_urdf(file, links)
    if links:
        raise InvalidInput(", ".join(links), ", ".join(map(str, links.values())), f"none: {path!r} is no URDF file")
    if suffix == ".py":
        return _resolve_robot(load_method(ROBOTS, path, "robot"), f"METHOD of {path}", file.stem)
    if suffix == ".json":
        return Robot.from_dict(parse_json(decode_text(read_bytes(file)), f"robot {path!r}"))
    if suffix != ".toml":
        raise InvalidInput("robot", repr(path), "a file that ends in .toml, .urdf, .xacro, .json or .py")
    return robot_from_toml(file, name)


def _resolve_robot(value: Any, where: str, name: str) -> Robot:
    """Return the robot of a plug-in: a robot, a function that returns one, or the path of its file."""
    if isinstance(value, str | os.PathLike):
        path, links = split_links(os.fspath(value))
        return _from_file(str(Path(path).absolute()), parse_urdf_options(links), name)
    robot = value() if callable(value) and not isinstance(value, Robot | type) else value
    if not isinstance(robot, Robot):
        raise InvalidInput(where, repr(robot)[:60], "a Robot, a function that returns one, or the path of its file")
    return robot


def robot_from_toml(file: Path, name: str | None = None) -> Robot:
    """Read a robot from a TOML file, in the format that this module describes."""
    data = _read_toml(file)
    try:
        return _robot(data, file, name or file.stem)
    except InvalidInput as error:
        raise locate_error(file.name, error) from None


def read_home(name: str | os.PathLike[str]) -> Array | None:
    """Return the configuration `home_deg` of a robot's TOML file [°, mm], or None."""
    file: Path | None = None
    if is_path(name):
        file = resolve_file(name, "robot")
    else:
        with suppress(InvalidInput):  # an entry point that is not a file
            file = data_file(ROBOTS, name, "robot")
    if file is None or file.suffix.lower() != ".toml":
        return None
    home = _read_toml(file).get("home_deg")
    return None if home is None else np.array(home, dtype=np.float64)


def _read_toml(file: Path) -> dict[str, Any]:
    content = read_bytes(file, argument="file", expected="a readable TOML file of a robot", most=MOST_TOML_BYTES)
    try:
        return parse_toml(decode_text(content), file.name)
    except InvalidInput as error:
        raise InvalidInput(file.name, error.got, error.expected) from None


def _robot(data: dict[str, Any], file: Path, name: str) -> Robot:
    if "members" in data:
        raise InvalidInput("robot", f"{name}, a group of members", "one robot", advice="optik.Group.load reads it")
    read_record(data, REQUIRED_KEYS, "the file", optional=OPTIONAL_KEYS)
    convention = check_choice(data["convention"], "convention", CONVENTIONS)
    joints = data["joints"]
    if not isinstance(joints, list) or not joints:
        raise InvalidInput("joints", repr(joints)[:60], "a list of rows, one for each joint")
    for i, joint in enumerate(joints):
        read_record(joint, (), f"joints[{i}]", optional=JOINT_KEYS)
    names = check_words(data.get("joint_names", ()), "joint_names")
    default = [f"joint{i + 1}" for i in range(len(joints))]
    limits = _limits(joints, data.get("dynamic_limits", {}))
    turns = ["range_rad" in joint for joint in joints]
    warn_of_degrees(name, names or default, (limits.lower, limits.upper), turns, stacklevel=5)
    scale = np.array([1e-3 if joint.get("type") == "prismatic" else RADIANS_PER_DEGREE for joint in joints])
    if "home_deg" in data and not limits.contains(read_vector(data["home_deg"], "home_deg", len(joints)) * scale):
        raise InvalidInput("home_deg", repr(data["home_deg"]), "a configuration inside the joint ranges")
    source = read_word(data.get("source", file.name), "source")
    robot = CONVENTIONS[convention](
        [_row(joint, f"joints[{i}]") for i, joint in enumerate(joints)],
        limits,
        name=name,
        base=read_pose(data.get("base", {}), "base"),
        tool=read_pose(data.get("tool", {}), "tool"),
        joint_names=names,
        gravity=read_vector(data.get("gravity", [0.0, 0.0, -1.0]), "gravity", 3),
        gravity_magnitude=data.get("gravity_magnitude", STANDARD_GRAVITY),
        source=source,
        inertia=_inertia(data["inertia"], len(joints), source) if "inertia" in data else None,
        shapes=_shapes(data["shapes"], source, names or default) if "shapes" in data else None,
    )
    if "motors" not in data:
        return robot
    motors = read_record(
        data["motors"], ("matrix",), "motors", optional=("offset_deg", "names", "lower_deg", "upper_deg")
    )
    offset = scale * read_vector(motors.get("offset_deg", [0.0] * len(joints)), "motors.offset_deg", len(joints))
    coupled = robot.with_motors(motors["matrix"], offset=offset, names=motors.get("names"))
    ends = [(end, key) for end in ("lower", "upper") if (key := f"{end}_deg") in motors]
    axes: dict[str, Any] = {end: scale * read_vector(motors[key], f"motors.{key}", len(joints)) for end, key in ends}
    return coupled.with_limits(**axes) if axes else coupled


def _row(joint: Mapping[str, Any], where: str) -> DHRow:
    kind = check_choice(joint.get("type", "revolute"), f"{where}.type", ("revolute", "prismatic"))

    def number(key: str) -> float:
        return check_number(joint.get(key, 0.0), f"{where}.{key}", "a finite number")

    return DHRow(
        a=number("a_mm") / 1000.0,
        alpha=number("alpha_deg") * RADIANS_PER_DEGREE,
        d=number("d_mm") / 1000.0,
        theta=number("theta_deg") * RADIANS_PER_DEGREE,
        prismatic=kind == "prismatic",
    )


def _inertia(table: Any, n: int, source: Any) -> Inertia:
    """Read the masses of the links, in the frames of the table."""
    links = read_record(table, ("links",), "inertia", optional=("source",))["links"]
    if not isinstance(links, list) or len(links) != n:
        got = f"{len(links)} rows" if isinstance(links, list) else repr(links)[:60]
        raise InvalidInput("inertia.links", got, f"{n} rows, one for each joint")
    numbers: dict[str, list[float]] = {key: [] for key in ("mass_kg", "motor", "viscous", "coulomb")}
    com, tensor = np.zeros((n, 3)), np.zeros((n, 3, 3))
    for i, link in enumerate(links):
        where = f"inertia.links[{i}]"
        read_record(link, (), where, optional=LINK_KEYS)
        for key, found in numbers.items():
            found.append(check_number(link.get(key, 0.0), f"{where}.{key}", "a finite number ≥ 0", least=0.0))
        com[i] = read_vector(link.get("com_mm", [0.0] * 3), f"{where}.com_mm") / 1000.0
        xx, yy, zz, xy, xz, yz = read_vector(link.get("inertia", [0.0] * 6), f"{where}.inertia", 6)
        tensor[i] = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    mass, motor, viscous, coulomb = (np.array(found) for found in numbers.values())
    where_from = read_word(table.get("source", source), "inertia.source")
    return Inertia(mass, com, tensor, motor, viscous, coulomb, where_from)


def _limits(joints: Sequence[Mapping[str, Any]], dynamic: Any) -> JointLimits:
    """Read the position limits and speeds of the rows, and the table ``dynamic_limits``."""
    dynamic = dict(read_record(dynamic, (), "dynamic_limits", optional=(*DYNAMIC_LIMITS, "velocity_by_position")))
    n, by_position = len(joints), dynamic.pop("velocity_by_position", None)
    ranges = np.array([_range(joint, f"joints[{i}]") for i, joint in enumerate(joints)])
    limits: dict[str, Any] = {key: check_positive(value, n, f"dynamic_limits.{key}") for key, value in dynamic.items()}
    if any(key in joint for joint in joints for key in SPEEDS):
        if "velocity" in limits:
            expected = "velocities either in the rows or in dynamic_limits"
            raise InvalidInput("dynamic_limits.velocity", "speeds in the rows, too", expected)
        limits["velocity"] = np.array([_speed(joint, f"joints[{i}]") for i, joint in enumerate(joints)])
    if by_position is not None:
        limits["velocity_by_position"] = VelocityByPosition.from_plain(
            by_position, "dynamic_limits.velocity_by_position"
        )
    return JointLimits(ranges[:, 0], ranges[:, 1], **limits)


def _range(joint: Mapping[str, Any], where: str) -> Array:
    """Read the position limits (2,) of a row [rad, m]."""
    key = _find_key(joint, where, RANGES)
    return read_numbers(joint[key], (2,), f"{where}.{key}") * RANGES[key]


def _speed(joint: Mapping[str, Any], where: str) -> float:
    """Read the velocity limit of a row [rad/s, m/s]."""
    key = _find_key(joint, where, SPEEDS)
    value = check_number(joint[key], f"{where}.{key}", "a speed above 0", above=0.0)
    return value / 1000.0 if key == "speed_mm" else value * SPEEDS[key]


def _find_key(joint: Mapping[str, Any], where: str, keys: Mapping[str, float]) -> str:
    """Return the only one of several keys that a row has; its unit must fit the type of the joint."""
    found = [key for key in keys if key in joint]
    slides = joint.get("type") == "prismatic"
    fitting = [key for key in keys if key.endswith("_mm") == slides]
    if len(found) != 1 or found[0] not in fitting:
        kind = "prismatic" if slides else "revolute"
        raise InvalidInput(where, " and ".join(found) or "none", f"{' or '.join(fitting)} of a {kind} joint")
    return found[0]


def _shapes(table: Any, source: str, joint_names: Sequence[str]) -> Shapes:
    """Read the capsules of the links, in the frames of the table."""
    read_record(table, ("capsules",), "shapes", optional=("apart", "source"))
    links = {"base": 0} | {name: i + 1 for i, name in enumerate(joint_names)}
    rows = read_list(table["capsules"], "shapes.capsules")
    for i, row in enumerate(rows):
        read_record(row, ("link", "radius_mm"), f"shapes.capsules[{i}]", optional=CAPSULE_KEYS)
    capsules = [_capsule(row, f"shapes.capsules[{i}]", links) for i, row in enumerate(rows)]
    named = [read_word(row.get("name", ""), f"shapes.capsules[{i}].name") for i, row in enumerate(rows)]
    of_link = {number: name for name, number in links.items()}
    names = tuple(name or of_link.get(row[0], str(row[0])) for name, row in zip(named, capsules, strict=True))
    pairs = read_list(table.get("apart", []), "shapes.apart")
    apart = tuple(_apart(row, f"shapes.apart[{i}]", links, names) for i, row in enumerate(pairs))
    excess = [_length(row["excess_mm"], "shapes.capsules: excess_mm") if "excess_mm" in row else np.nan for row in rows]
    return Shapes(capsules, names, apart, np.array(excess), read_word(table.get("source", source), "shapes.source"))  # type: ignore[arg-type]


def _capsule(row: Mapping[str, Any], where: str, links: Mapping[str, int]) -> tuple[int, Array, Array, float]:
    """Read the link, ends and radius of a row."""
    ends = ("centre_mm", "centre_mm") if "centre_mm" in row else ("a_mm", "b_mm")
    if not set(ends) <= set(row) or ("centre_mm" in row and {"a_mm", "b_mm"} & set(row)):
        raise InvalidInput(where, ", ".join(row), "a_mm and b_mm of a capsule, or centre_mm of a sphere")
    a, b = (read_vector(row[key], f"{where}.{key}") / 1000.0 for key in ends)
    link = row["link"]
    number = links.get(link, link) if isinstance(link, str) else link
    if isinstance(number, str):
        raise InvalidInput(f"{where}.link", repr(link)[:60], f"the number of a link, or {', '.join(links)}")
    check_count(number, f"{where}.link", 0, len(links) - 1)
    return number, a, b, _length(row["radius_mm"], f"{where}.radius_mm")


def _apart(row: Any, where: str, links: Mapping[str, int], names: Sequence[str]) -> tuple[str | int, str | int, str]:
    """Read two parts that are not checked, and the reason."""
    read_record(row, ("links", "reason"), where)
    pair = read_list(row["links"], f"{where}.links", "two links", 2)
    # A name of capsules means these capsules; else the name of a link means all capsules of the link.
    one, other = (part if part in names else links.get(part, part) if isinstance(part, str) else part for part in pair)
    return one, other, read_word(row["reason"], f"{where}.reason")


def _length(value: Any, where: str) -> float:
    return check_number(value, where, "a length ≥ 0 in millimetres", least=0.0) / 1000.0
