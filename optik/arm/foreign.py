"""Robots of other programs: URDF and xacro files with options, and descriptions that `robot_descriptions` downloads."""

from __future__ import annotations

import importlib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from optik.arm.robot import Robot
from optik.arm.shapes.meshes import Folders, MeshFolders, find_package
from optik.errors import InvalidInput, MissingDependency
from optik.plugins.files import check_code_allowed

PREFIX = "robot_descriptions:"
"""Begin of the name of a description: ``robot_descriptions:panda_description``."""


URDF = (".urdf", ".xml", ".xacro")
"""Suffixes of URDF files, and of xacro files, which are expanded."""
URDF_OPTIONS = {"tip", "base", "gravity", "shapes", "packages", "srdf", "without_shape"}
"""Options that may follow the path of a URDF."""
URDF_SYNTAX = (
    "options of a URDF, joined by &: tip=LINK, base=LINK, gravity=X,Y,Z, shapes=yes, packages=FOLDER, srdf=FILE, "
    "without_shape=LINK"
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
        found = importlib.import_module(f"robot_descriptions.{module}")
    except ModuleNotFoundError:
        raise InvalidInput("robot", repr(name), "a description of the package robot_descriptions") from None
    except Exception as error:  # git has many errors
        words = " ".join(str(error).split())[:160]
        raise InvalidInput("robot", f"{name!r}: {words}", "a description that can be downloaded") from error
    file = getattr(found, "URDF_PATH", None) or getattr(found, "XACRO_PATH", None)
    if file is None:
        raise InvalidInput("robot", f"{name!r}, which has no URDF", "a description with a URDF")
    packages = dict.fromkeys(str(Path(path).parent) for path in (found.PACKAGE_PATH, found.REPOSITORY_PATH))
    return Description(Path(file), getattr(found, "XACRO_ARGS", {}), tuple(packages))


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
            made = XacroDoc.from_file(str(file), subargs=dict(arguments), resolve_packages=False)
            return str(made.to_urdf_string())
        except Exception as error:  # xacro raises what its expressions raise
            words = " ".join(str(error).split())[:160] or type(error).__name__
            missing = re.search(r"Package not found: ([-\w]+)", str(error))
            folder = missing and find_package(missing[1], file.absolute().parent, folders)
            if not missing or folder is None:
                advice = "name the folder of its package (package_dirs=, on the command line --package-dir)"
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
    given = options.pop("package_dirs", None)
    packages = given if isinstance(given, Mapping) else [*folders, *(given or ())]
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
    options: dict[str, Any] = {key: value for key, value in links.items() if key not in ("packages", "shapes")}
    if isinstance(text := links.get("gravity"), str):
        try:
            options["gravity"] = [float(word) for word in text.split(",")]
        except ValueError:
            raise InvalidInput("gravity", repr(text), "three numbers, X,Y,Z") from None
    if isinstance(text := links.get("without_shape"), str):
        options["without_shape"] = text.split(",")
    if "packages" in links:
        options.setdefault("package_dirs", [links["packages"]])
    implied = "yes" if {"srdf", "packages", "package_dirs", "without_shape"} & set(links) else "no"
    options["shapes"] = links.get("shapes", implied) == "yes"
    return options
