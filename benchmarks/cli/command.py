"""Commands as dataclasses of their options, and one-line error messages of the command line."""

from __future__ import annotations

import json
import os
import re
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from difflib import get_close_matches
from enum import Enum
from inspect import Parameter, Signature, get_annotations
from pathlib import Path
from typing import Annotated, Any, NamedTuple, get_args, get_type_hints

import numpy as np
import typer
from rich.console import Console
from typer.core import TyperCommand

import optik
from benchmarks.cli import readers
from benchmarks.cli.readers import LIMIT_HELP, format_numbers, read_configuration, read_held, read_number_list
from optik.arm.model import unit_factors
from optik.arm.motors import from_maker, maker_joints
from optik.arm.urdf import TIP_ADVICE
from optik.errors import InvalidInput, OptikError, RobotModelError, UnknownName
from optik.plugins.files import is_path
from optik.registry import data_file, names, short_name

# ---------------- errors of the parser as one line


UsageError: Any = typer.BadParameter.__base__
"""Base class of the parser's errors: of the package click, or of the copy of it in newer versions of Typer."""

VALUES = {float: "a number", int: "a whole number"}
"""Values of options by their type, for messages."""


GOALS = ("--move", "--to", "--to-deg", "--waypoints", "--xyz")
MEANT = {name: GOALS for name in ("--goal", "--target", "--pose", "--position", "--end")} | {"--drive": ("--on",)}
"""Options that are not spelled like what is often typed for them."""


def describe_usage(error: Any, context: Any, words: Sequence[str], kind: type) -> OptikError:
    """Return the parser's error about the words of a command as one of ours; `kind` is the class of the command."""
    name, param = str(getattr(error, "option_name", "") or ""), getattr(error, "param", None)
    example = f"; for example: {(context.command.epilog or '').removeprefix('Example: ').strip('`')}"
    options = {typed: p for p in context.command.params for typed in (*p.opts, *p.secondary_opts)}
    if name and name not in options:
        long = [each for each in options if each.startswith("--")]
        near = [each for each in long if each.startswith(name) or each in MEANT.get(name, ())][:3]
        near = near or [f"--{each}" for each in get_close_matches(name[2:], [each[2:] for each in long], n=2)]
        meant = f"did you mean {' or '.join(near)}? " if near else ""
        return OptikError(f"unknown option {name}; {meant}{context.command_path} --help lists the options")
    if name:
        return OptikError(f"{name} takes no value" if options[name].is_flag else f"{name} needs a value{example}")
    if param is None:
        return OptikError(f"unexpected argument {error.format_message().rpartition('(')[2].rstrip(')')}{example}")
    named = max(param.opts, key=len) if param.param_type_name == "option" else str(param.metavar).strip("[]")
    typed = _find_value(param.opts, words)
    if typed is None:
        extra = context.command.make_parser(context).parse_args(list(words))[1]
        beside = f", and unexpected argument {extra[0]}" if extra else ""
        return OptikError(f"{named} is missing{beside}{example}")
    each = "--limits joint_limits.yaml has one for each joint" if "," in typed and param.name in LIMIT_EXAMPLES else ""
    return InvalidInput(named, repr(typed), _describe_values(kind, param.name), advice=each)


def _find_value(names: Sequence[str], words: Sequence[str]) -> str | None:
    """Return the last value of an option among the words of a command, or None."""
    found = None
    for i, word in enumerate(words):
        name, equals, value = word.partition("=")
        if name in names:
            found = value if equals else next(iter(words[i + 1 :]), None)
    return found


def _describe_values(kind: Any, name: str) -> str:
    """Describe the values of an option: a number with its least value, or one of several words."""
    hint: Any = get_type_hints(kind)[name]
    parts = [part for each in (get_args(hint) or (hint,)) for part in (get_args(each) or (each,))]
    for part in parts:
        if isinstance(part, type) and issubclass(part, Enum):
            return f"one of: {', '.join(str(member.value) for member in part)}"
    (info,) = (each.metadata["typer"] for each in fields(kind) if each.name == name)
    least = "" if info.min is None else f" of at least {info.min:g}"
    least += "".join(re.findall(r" \[[^]]+\]", info.help or "")[:1])
    return next((words for part, words in VALUES.items() if part in parts), "another value") + least


# ---------------- messages of the library in the words of the command line


OPTIONS: dict[str, str] = {}
"""Options and arguments of all commands, as typed, by their field."""

ARGUMENTS = {
    "IK method": "solver", "time law": "timing", "limit": "limit", "freedom": "free", "file format": "format",
    "limits.tool_speed": "tool_speed", "limits.rotation_speed": "rotation_speed", "target": "xyz", "q": "q_deg",
    "angle": "angle_deg", "data": "set_", "goal": "set_", "robot": "name", "drive": "on", "search": "avoid",
    "extra": "limit", "peer": "name", "scene.margin": "margin", "package_dirs": "package_dir", "start": "start_deg",
    "q_start": "start_deg", "tilt": "free", "freedoms": "free", "open_container.angle": "limit",
}  # fmt: skip
"""Arguments of the library, and kinds of names, that a command has under another name."""

PHRASES = {
    "q_start": "--start-deg", "time_limit": "--time-limit", " (max_restarts)": "",  # no option of `optik plan`
    "free(path, turn=True, tilt=True)": "--free turn,tilt", "turn=True, tilt=True": "--free turn,tilt",
    "True without turn=True": "tilt without turn", "strict=False, which": "the motion without --strict, which",
    "elbow=True in planners.free": "--free elbow",
    "optik.solve_ik with closest=True": "optik ik --closest",
    "with_limits sets them": "only <limit> is read", "with_limits(torque=None)": "--torque none",
    "with_limits(velocity=)": "--velocity", "optik.Group.load reads it": "`optik plan`, `view` and `robots` take a group",
    ", or shapes.with_apart": "", ", or shapes.with_part": "", "a longer ramp= (at most 0.5); ": "",
    "load_limits reads": "--limits reads", "a `planners.Program`": "`optik plan program`",
    "np.deg2rad converts degrees": "degrees end with deg, as in 15deg",
}  # fmt: skip
"""Further words of the library, and what is typed instead."""

NUMBER = r"-?\d[\d.]*(?:e[-+]?\d+)?"
"""Regular expression of a number in a message."""


def translate(words: str) -> str:
    """Return a message of the library with degrees, millimetres and options in place of radians and Python arguments."""

    def convert(match: re.Match[str]) -> str:
        factor, unit = (180.0 / np.pi, "°") if match["unit"] == "rad" else (1e3, " mm")
        return re.sub(NUMBER, lambda number: f"{float(number[0]) * factor:.4g}", match["values"]) + unit

    quantity = rf"(?P<values>\[{NUMBER}(?:, {NUMBER})+\]|{NUMBER}(?= rad)) (?P<unit>rad|m)\b(?!/)"
    return name_options(re.sub(quantity, convert, words))


def name_options(words: str) -> str:
    """Return a message with options in place of Python arguments, such as --tip tool0 for tip='tool0'."""

    def join(match: re.Match[str]) -> str:
        option, value = OPTIONS.get(match[1], OPTIONS.get(ARGUMENTS.get(match[1], ""), "")), match[2]
        if not option.startswith("--") or option in ("--free", "--limit", "--set"):  # these are followed by NAME=VALUE
            return match[0]
        if value.startswith("{"):
            return " ".join(f"{option} {name}={number}" for name, number in re.findall(r"'([^']+)': ([^,}]+)", value))
        values = [quoted or plain for quoted, plain in re.findall(r"'([^']+)'|([-+.\w]+)", value)]
        return f"{option} {'none' if value == '()' else ','.join(values).removeprefix('True')}".rstrip()

    for python, typed in PHRASES.items():
        words = words.replace(python, typed)
    return re.sub(r"(?<![\w#&'])(\w+)=(\([^)]*\)|\{[^}]*\}|'[^']*'|[^ ,;:)]*)", join, words)


# ---------------- commands as dataclasses of their options


class _Console(Console):
    """Console that is a terminal only on one: FORCE_COLOR asks for colours, and a notebook's cell keeps what is drawn over."""

    @property
    def is_terminal(self) -> bool:
        """Whether what changes in place is shown."""
        return self.file.isatty() and "JPY_PARENT_PID" not in os.environ


COLOURS: Any = "standard" if os.environ.get("FORCE_COLOR") else "auto"
"""Colours of the consoles."""
out_console, err_console = (
    _Console(stderr=error, markup=False, highlight=False, color_system=COLOURS) for error in (False, True)
)

PANELS = ("Options", "Path", "Target", "Task", "With --on ros", "Robot", "Method", "Limits", "Scene", "Output")
"""Panels of the help, in their order."""

NUMBERS, Q_DEG = "NUMBERS", "Q_DEG"
"""Metavars of vector options and arguments: numbers with commas or spaces."""

LIMIT_EXAMPLES = {"velocity": 1, "acceleration": 10, "jerk": 50}
"""Limits that hold for every joint, with examples for messages."""

# ---------------------------------------------------------------- commands


def option(panel: str, help: str, default: Any = None, *flags: str, **settings: Any) -> Any:
    """Return a field of a command that is an option, in a panel of the help; it is required if its default is ``...``."""
    settings = {"metavar": ""} | settings if default is False else settings  # no type behind a flag
    info = typer.Option(*flags, help=help, rich_help_panel=panel, **settings)
    flag = next(iter(flags), "")
    return field(default=MISSING if default is ... else default, metadata={"typer": info, "flag": flag})


def numbers(panel: str, help: str, default: Any = None) -> Any:
    """Return a field of a command that is an option of one or more numbers."""
    return option(panel, help, default, metavar=NUMBERS)


def argument(metavar: str, help: str, group: str = "") -> Any:
    """Return a field of a command that is an argument; a name of a group is checked before a missing option is named."""
    check = (lambda name: data_file(group, name, metavar.lower()) and name) if group else None
    return field(metadata={"typer": typer.Argument(metavar=metavar, help=help, callback=check)})


def optional(metavar: str, help: str) -> Any:
    """Return a field of a command that is an argument which may be left out."""
    return field(default=None, metadata={"typer": typer.Argument(metavar=metavar, help=help)})


@dataclass(frozen=True, kw_only=True)
class Command(ABC):
    """A command: a dataclass of its options, whose docstring is its help."""

    @abstractmethod
    def run(self) -> None:
        """Run the command; a status other than 0 is raised as typer.Exit."""


def add_command(group: typer.Typer, name: str, kind: type[Command], example: str, **settings: Any) -> None:
    """Add a command, whose help ends with an example."""

    def run(**given: Any) -> None:
        try:
            kind(**given).run()
        except UnknownName as error:
            typed = name_typed(kind, given, error.kind, str(error.name))
            error.args = (f"{typed}: {error}" if typed else str(error),)
            raise
        except InvalidInput as error:
            typed = name_typed(kind, given, error.argument, error.got) or error.argument
            words = name_options if error.argument == "values" else translate  # --hold is in the file's units
            got, expected, advice = map(words, (error.got, error.expected, error.advice))
            error.args = InvalidInput(typed, got, expected, advice=advice).args
            raise

    for each in fields(kind):
        OPTIONS.setdefault(each.name, _as_typed(each.name, each.metadata))
    run.__signature__ = Signature(_list_parameters(kind))  # type: ignore[attr-defined] # Typer reads it
    run.__annotations__ = {}
    epilog = f"Example: `optik {example}`"
    parser = type(kind.__name__, (CommandParser,), {"kind": kind})
    group.command(name, cls=parser, help=kind.__doc__, epilog=epilog, **settings)(run)


def name_typed(kind: type[Command], given: dict[str, Any], argument: str, got: str) -> str:
    """Return the option or argument, as typed, that an argument of the library stands for; empty if there is none."""
    known = {each.name: each.metadata for each in fields(kind) if "typer" in each.metadata}
    if argument.rpartition(" ")[2] in ("file", "run", "robot", "scene"):  # one of several: that whose name was typed
        words = re.split(r"[\s',]+", got)
        named = [name for name, value in given.items() if value is not None and str(value) and str(value) in words]
        argument = named[0] if len(named) == 1 else argument
    if argument not in known and f"{argument}s" not in known:
        argument = ARGUMENTS.get(argument, argument)
    if argument == "on" and "on" not in known:
        argument = "drive"
    return _as_typed(argument, known[argument]) if argument in known else ""


def _as_typed(name: str, metadata: Mapping[str, Any]) -> str:
    """Return the option or argument of a field as typed."""
    if "flag" not in metadata:
        return str(metadata["typer"].metavar).strip("[]")
    return metadata["flag"] or f"--{name.replace('_', '-')}"


def _list_parameters(kind: Any) -> list[Parameter]:
    """Return the fields of a command as parameters for Typer, in the order of the panels."""
    hints, infos = get_type_hints(kind), {each.name: each.metadata["typer"] for each in fields(kind)}
    parameters = [
        Parameter(
            each.name, Parameter.KEYWORD_ONLY, annotation=Annotated[hints[each.name], infos[each.name]],
            default=Parameter.empty if each.default is MISSING else each.default,
        )
        for each in fields(kind)
    ]  # fmt: skip
    own = get_annotations(kind)  # of a panel's options, the command's own come first

    def place(each: Parameter) -> tuple[int, bool]:
        return PANELS.index(infos[each.name].rich_help_panel or "Options"), each.name not in own

    return sorted(parameters, key=place)


class CommandParser(TyperCommand):
    """A command whose vectors may be typed as several arguments, and whose errors are one line."""

    kind: type[Command]

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Join the numbers of each vector, then parse."""
        words = self._join_numbers(args)
        try:
            return list(super().parse_args(ctx, list(words)))
        except UsageError as error:
            raise describe_usage(error, ctx, words, self.kind) from None

    def _join_numbers(self, args: list[str]) -> list[str]:
        """Return the words with each vector as one; joint values that are an argument come last, behind --."""
        valued: Any = {name: p for p in self.params for name in p.opts if not getattr(p, "is_flag", False)}
        takes_joints = any(getattr(p, "metavar", None) == Q_DEG for p in self.params)
        words, joints, others, rest = list[str](), list[str](), list[str](), deque(args)
        while rest:
            word = rest.popleft()
            name, equals, value = word.partition("=")
            if name in valued and (equals or rest):
                run = [value if equals else rest.popleft()]
                while valued[name].metavar == NUMBERS and _is_number(run[0]) and rest and _is_number(rest[0]):
                    run.append(rest.popleft())
                words += [f"{name}={','.join(run)}"] if name.startswith("--") else [name, ",".join(run)]
            elif takes_joints and re.match(r"[-+]?\.?\d", word):
                joints.append(word)
            elif takes_joints and not word.startswith("-"):
                others.append(word)
            elif not takes_joints or word != "--":
                words.append(word)
        lacks_value = words[-1:] and words[-1] in valued
        return [*words, "--", ",".join(joints), *others] if joints and not lacks_value else [*words, *others]

    def get_help_option(self, ctx: Any) -> Any:
        """Return --help, in the last panel."""
        found: Any = super().get_help_option(ctx)
        found.rich_help_panel = PANELS[-1]
        return found


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


# ---------------------------------------------------------------- shared options


@dataclass(frozen=True, kw_only=True)
class JsonCommand(Command):
    """A command whose output is text or JSON."""

    as_json: bool = option("Output", "Print JSON instead of text.", False, "--json")


@dataclass(frozen=True, kw_only=True)
class FileCommand(JsonCommand):
    """A command with options of a robot's file."""

    tip: str | None = option(
        "Robot",
        "Tool link of a URDF; by default the end of its longest chain, before a hand. Required for several arms.",
    )
    base: str | None = option("Robot", "Base link of a URDF, the frame of all poses; by default its root.")
    values: list[str] | None = option(
        "Robot",
        "Hold a joint beside the arm of a URDF at a value in the file's units [rad, m]; repeatable: gripper=0.3.", None,
        "--hold", metavar="JOINT=VALUE",
    )  # fmt: skip
    package_dir: str | None = option(
        "Robot",
        "Folder of ROS packages, for a xacro file and for package:// meshes of a URDF, whose collision shapes are then read.",
    )
    srdf: str | None = option("Robot", "SRDF with the pairs of a URDF's links that are not checked against each other.")
    without_shape: list[str] | None = option(
        "Robot", "Links of a URDF whose collision shapes are not read; comma-separated, repeatable.", metavar="LINK"
    )
    gravity: str | None = numbers(
        "Robot",
        "Direction of gravity in the base frame, for example 0,0,-1. Default: the file's; for a URDF, −z of its root link.",
    )

    def load_file(self, name: str) -> optik.Robot:
        """Load a robot, and print the tip that a rule chose."""
        gravity = None if self.gravity is None else read_number_list(self.gravity, "--gravity", 3)
        if gravity is not None and not any(gravity):
            raise InvalidInput("--gravity", self.gravity, "a direction, such as 0,0,-1")
        links = [link.strip() for text in self.without_shape or () for link in text.split(",")] or None
        arm = optik.load(
            name, tip=self.tip, base=self.base, values=read_held(self.values), gravity=gravity, without_shape=links,
            package_dirs=None if self.package_dir is None else [self.package_dir], srdf=self.srdf,
        )  # fmt: skip
        if arm.source.endswith(TIP_ADVICE):
            err_console.print(name_options(arm.source), soft_wrap=True)
        return arm


@dataclass(frozen=True, kw_only=True)
class RobotCommand(FileCommand):
    """A command on a robot."""

    robot: str = option(
        "Robot",
        "A name from `optik robots`, a file (.urdf, .xacro, .toml, .json or .py), or robot_descriptions:NAME_description.",
        "paper6r", "--robot", "-r",
    )  # fmt: skip

    def load(self, name: str = "") -> optik.Robot:
        """Load the robot, or the one that is named."""
        return self.load_file(name or self.robot)


class Start(NamedTuple):
    """A robot, its start configuration, a sentence on it if it is the default, and whether it is a random one."""

    arm: optik.Robot
    q: Any
    words: str
    is_random: bool = False

    def print_default(self) -> None:
        """Print the default start on the error stream, which keeps the output stream for programs."""
        if self.words:
            err_console.print(self.words, soft_wrap=True)


@dataclass(frozen=True, kw_only=True)
class StartCommand(RobotCommand):
    """A command that starts at a configuration of a robot and solves inverse kinematics."""

    start_deg: str | None = numbers(
        "Robot",
        "Start configuration [degrees, prismatic mm]: 20,-35,40; by default that of a program's file, the home, or a sample.",
    )
    solver: str = option("Method", f"IK method, one of: {', '.join(optik.ik.solvers())}; or a file: ./jt.py.", "lm")

    def load_start(self) -> Start:
        """Load the robot, and return it with the typed start or its default start."""
        arm = self.load()
        if self.start_deg is not None:
            return Start(arm, read_configuration(arm, self.start_deg), "")
        from optik.arm.library import read_home

        home, factors = read_home(self.robot), unit_factors(arm)
        q = optik.choose_start(arm) if home is None else from_maker(arm, home / factors)
        why = "a sample, because it has no home_deg" if home is None else "its home_deg"
        typed = format_numbers(maker_joints(arm, q) * factors)
        return Start(arm, q, f"start of {arm.name}, {why}: --start-deg {typed}", home is None)


@dataclass(frozen=True, kw_only=True)
class LimitsCommand(RobotCommand):
    """A command with limits of motions."""

    velocity: float | None = option(
        "Limits", "Velocity limit of every joint [rad/s, prismatic m/s]; by default the robot's."
    )
    acceleration: float | None = option(
        "Limits", "Acceleration limit of every joint [rad/s², prismatic m/s²]; by default the robot's."
    )
    jerk: float | None = option("Limits", "Jerk limit of every joint [rad/s³, prismatic m/s³]; by default the robot's.")
    limit: list[str] | None = option("Limits", LIMIT_HELP, metavar="NAME=VALUE")
    limits: Path | None = option(
        "Limits", "MoveIt's joint_limits.yaml: ranges and limits of the joints; the options above replace its values."
    )
    joint_names: str | None = option(
        "Robot", "Names of the joints in the files, comma-separated, in the robot's order; by default the robot's."
    )

    def load(self, name: str = "") -> optik.Robot:
        """Load the robot, with the joint ranges of ``--limits``."""
        return self.limit_ranges(super().load(name))

    def limit_ranges(self, arm: optik.Robot) -> optik.Robot:
        """Return the arm with the joint ranges of ``--limits``."""
        if self.limits is None:
            return arm
        from planners.limits.moveit import load_limits

        return load_limits(self.limits, arm, joint_names=self.read_joint_names(arm))[0]

    def read_joint_names(self, arm: optik.Robot) -> dict[str, str] | None:
        """Return the names of the joints in the files by the robot's."""
        if self.joint_names is None:
            return None
        given = [name.strip() for name in self.joint_names.split(",")]
        if len(set(given)) != arm.n or len(given) != arm.n:
            raise InvalidInput("--joint-names", self.joint_names, f"{arm.n} different names, comma separated")
        return dict(zip(arm.joint_names, given, strict=True))

    def read_typed_limits(self, arm: optik.Robot) -> dict[str, Any]:
        """Return the limits of ``--limits`` and the typed ones by name."""
        from planners.limits import ALL_LIMITS

        typed = {name: getattr(self, name) for name in LIMIT_EXAMPLES if getattr(self, name) is not None}
        pairs = [text.rpartition("=") for text in self.limit or ()]
        for name, equals, value in pairs:
            if not name or name in ALL_LIMITS:
                advice = f"type --{name.replace('_', '-')} {value}" if name else ""
                got = repr(f"{name}{equals}{value}")
                raise InvalidInput("--limit", got, "NAME=VALUE of a further limit", advice=advice)
        if self.limits is not None:
            from planners.limits.moveit import read_limits

            typed = read_limits(self.limits, arm, self.read_joint_names(arm)).given | typed
        return typed | {"extra": {name: readers.read_limit(name, value) for name, _, value in pairs}}


@dataclass(frozen=True, kw_only=True)
class TableCommand(Command):
    """A command that reads a table of another program."""

    columns: str | None = option("Path", "Names of the columns of a file without a header, or new names: x,y,z.")
    ignore: str | None = option("Path", "Columns of the file, or joints of a message, to leave out; comma-separated.")


@dataclass(frozen=True, kw_only=True)
class MotionCommand(LimitsCommand, StartCommand):
    """A command that plans a motion under limits."""

    timing: str = option(
        "Method", f"Time law, one of: {', '.join(names('planners.timing'))}; or a file: ./law.py.", "optimal"
    )

    def read_limits(self, arm: optik.Robot, law: Any) -> Any:
        """Return the typed limits, and the robot's own for the others."""
        return self.complete_limits(arm, law, self.read_typed_limits(arm))

    def complete_limits(self, arm: optik.Robot, law: Any, typed: dict[str, Any]) -> Any:
        """Return typed limits by name, and the robot's own for the others."""
        from planners import MotionLimits

        limits = MotionLimits.of(arm, **typed)
        if missing := law.list_missing(limits, arm):
            named, example = (join_options(missing, values) for values in (False, True))
            got, expected = f"none, and {arm.name} has none of its own", f"limits for {short_name(self.timing)}"
            raise InvalidInput(named, got, expected, advice=f"for example {example}")
        return limits

    def load_start(self) -> Start:
        """Load the robot and its start; if its tip must be named, name the limits that no URDF has, too."""
        try:
            return super().load_start()
        except RobotModelError as error:
            untyped = [name for name in ("acceleration", "jerk") if getattr(self, name) is None]
            if "tip" in str(error) and untyped and not is_path(self.timing):
                limits = f"; a URDF has no limits on {' and '.join(untyped)}: add {join_options(untyped, True)}"
                error.args = (f"{error}{limits}",)
            raise


def join_options(limits: Sequence[str], with_values: bool) -> str:
    """Return limits as options, with values as examples or without."""
    return (
        " ".join(f"--{name} {LIMIT_EXAMPLES[name]}" for name in limits)
        if with_values
        else ", ".join(f"--{name}" for name in limits)
    )


def print_json(data: Any) -> None:
    """Print strict JSON."""
    print(json.dumps(data, allow_nan=False, indent=1))
