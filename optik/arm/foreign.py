"""Robots of other packages: descriptions of `robot_descriptions`, which downloads them, and xacro files, by `xacrodoc`."""

from __future__ import annotations

import importlib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from optik.errors import InvalidInput, MissingDependency
from optik.plugins.files import check_code_allowed

PREFIX = "robot_descriptions:"
"""Begin of the name of a description: ``robot_descriptions:panda_description``."""


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


def expand_xacro(file: Path, arguments: Mapping[str, str], packages: Sequence[str] = ()) -> str:
    """Return the URDF text of a xacro file, whose expressions are run."""
    check_code_allowed(file)
    try:
        from xacrodoc import XacroDoc
        from xacrodoc import packages as known
    except ModuleNotFoundError:
        raise MissingDependency("xacrodoc", f"{file.name}", "robots") from None
    try:
        known.look_in([str(folder) for folder in packages])
        return str(XacroDoc.from_file(str(file), subargs=dict(arguments)).to_urdf_string())
    except Exception as error:  # xacro raises what its expressions raise
        words = " ".join(str(error).split())[:160] or type(error).__name__
        raise InvalidInput("robot", f"{file.name}: {words}", "a xacro file that can be expanded") from error
