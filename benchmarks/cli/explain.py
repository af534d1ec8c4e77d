"""Every key of a suite in words: its meaning and unit from docstrings, its default from the code that reads it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.kinds._block import Entry
from benchmarks.kinds._problems import ProblemBlock, check_set
from benchmarks.kinds.base import Block, Kind
from benchmarks.kinds.cell.settings import Noise
from benchmarks.kinds.laws.motions import path_in_file
from benchmarks.kinds.laws.sets import LineSet
from benchmarks.kinds.laws.settings import Example, LawBlock
from benchmarks.settings import NAMED_KEYS, Target, naming
from benchmarks.suite import ALIASES, Suite
from optik.errors import InvalidInput, OptikError
from optik.plugins.files import is_path
from optik.plugins.options import NO_DEFAULT, ParameterDoc, defaults, find_nearest_name, read_parameter_docs
from optik.plugins.usage import collect_plugins
from optik.registry import load_method

SUITE_KEYS = {
    "title": ("Heading of the report.", "the suite's name"),
    "seed": ("Seed of everything that is drawn, 0 or more.", "0"),
}
"""Keys of a suite itself: meaning and default."""

PEERS_OF = {"calls": ("benchmarks.peers.ik", "peer"), "laws": ("benchmarks.peers.laws", "peer of timing")}
"""Where the kinds find their peers."""

ENTRY_KEYS = {
    "solver": "IK method: a name from `optik doctor`, or the path of a file.",
    "law": "Time law: a name, or the path of a file.",
    "peer": "Outside method: a name, or the path of a file.",
    "label": "What reports call it; by default its name.",
    "options": "Its options.",
    "max_problems": "Number of problems that a slow one is given; all by default.",
    "whole": "Whether each problem is one call with all that the method does by itself, where others make one attempt.",
    "along": "Whether a method makes its iterations at each of 151 poses of the line, each from the pose before.",
    "without": "Limits that a law is not told of; its motions are judged by them.",
    "max_lines": "Number of motions of each set that a slow one is given; all by default.",
}
"""Keys of an entry of ``methods``, ``laws``, ``peers`` or ``reference``."""

MOTION_LIMIT_KEYS = {
    "label": ParameterDoc("str", "What reports call these limits.", ""),
    "velocity": ParameterDoc("", "Limit of the joints' speeds: a number, one a joint, or 'robot' [rad/s, m/s].", "rad/s, m/s"),
    "acceleration": ParameterDoc("", "Limit of the joints' accelerations [rad/s², m/s²].", "rad/s², m/s²"),
    "jerk": ParameterDoc("", "Limit of the joints' jerks [rad/s³, m/s³].", "rad/s³, m/s³"),
    "tool_speed": ParameterDoc("", "Limit of the speed of the tool's point [m/s].", "m/s"),
    "rotation_speed": ParameterDoc("", "Limit of the angular speed of the tool [rad/s].", "rad/s"),
    "torque": ParameterDoc("", "Limit of the joints' torques, of an arm whose masses are known [N·m, N].", "N·m, N"),
    "torque_rate": ParameterDoc("", "Limit of the rates of the torques [N·m/s, N/s].", "N·m/s, N/s"),
}  # fmt: skip
"""Keys of an entry of ``limits``."""

TARGET_LABELS = ("method", "law")
"""Keys by which a target names the entry that it applies to."""


class Explained(NamedTuple):
    """One key of a suite.

    Attributes
    ----------
    key : str
        Where it stands, such as ``speed.warm.options.count``.
    value : object
        What the file has; None where it is left out.
    default : str
        What it is where the file has none; ``required`` where it must be there, empty where nothing is known of it.
    unit : str
        Unit of its value; empty where it has none.
    meaning : str
        In words.
    given : bool
        Whether the file has it.
    """

    key: str
    value: Any
    default: str
    unit: str
    meaning: str
    given: bool = True


def explain(suite: Suite, folder: Path) -> list[Explained]:
    """Explain every key of a suite, and those that could be added to its tables."""
    found = [
        Explained(key, suite.settings.get(key), default, "", meaning, key in suite.settings)
        for key, (meaning, default) in SUITE_KEYS.items()
    ]
    kinds = {kind.name: kind for kind in suite.kinds}
    for key, data in suite.settings.items():
        name = ALIASES.get(key, key)
        kind = kinds.get(name) or next((k for k in suite.kinds if suite.sources[k.name] and is_path(key)), None)
        if key in SUITE_KEYS or kind is None:
            continue
        blocks, tables = suite.of(kind.name), [data] if kind.single else data
        for block, table in zip(blocks, tables, strict=True):
            with collect_plugins(folder):
                found += _block(kind, block, table, key if kind.single else f"{key}.{block.id}", suite.unread)
    return found


def _block(kind: Kind, block: Block, table: dict[str, Any], at: str, unread: Sequence[str]) -> Iterator[Explained]:
    """Keys of one block; those of a kind that comes from a file are shown without words."""
    if kind.name in unread:
        words = "Its kind comes from a file, which is not run here."
        yield from (Explained(f"{at}.{key}", value, "", "", words) for key, value in table.items())
        return
    words_of = read_parameter_docs(type(block))
    known = {field.name for field in fields(block)} & set(words_of)
    for key in [*table, *(key for key in sorted(known - set(table)) if _taken(kind, table, key))]:
        about = words_of.get(key, ParameterDoc("", "", ""))
        value, given = table.get(key), key in table
        yield Explained(f"{at}.{key}", value, _default(kind, block, table, key), about.unit, about.meaning, given)
        if given:
            yield from _inside(kind, table, key, value, f"{at}.{key}")
    if isinstance(block, ProblemBlock) and not _code(block.set) and not _code(block.robot):
        check_set(block)
    for line in block.lines if isinstance(block, LawBlock) else ():
        if line.path and not _code(line.robot):
            with naming(f"block {block.id!r}"):
                path_in_file(line.load(), Path(line.path))


def _taken(kind: Kind, table: dict[str, Any], key: str) -> bool:
    """Whether a kind takes a key: that is, whether it refuses another value of it, or none, but not the key."""
    try:
        kind.settings(table | {key: None})
    except InvalidInput as error:
        return not error.got.startswith("the key")
    except OptikError:
        return True
    return True


def _default(kind: Kind, block: Block, table: dict[str, Any], key: str) -> str:
    """Default of a key: what the kind reads where it is left out."""
    if key in table:
        try:
            block = kind.settings({name: value for name, value in table.items() if name != key})
        except OptikError:
            return "required"
    return _shown(getattr(block, key, None))


def _shown(value: Any) -> str:
    """A default in few words."""
    if value is None or value in ((), {}, ""):
        return "none"
    if isinstance(value, tuple):
        return ", ".join(_shown(part) for part in value)
    if isinstance(value, Entry):
        return value.label
    if is_dataclass(value):
        return ", ".join(str(getattr(value, field.name)) for field in fields(value) if getattr(value, field.name))
    return str(value).lower() if isinstance(value, bool) else str(value)


# ---------------------------------------------------------------- tables inside a block


def _inside(kind: Kind, table: dict[str, Any], key: str, value: Any, at: str) -> Iterator[Explained]:
    """Keys of the tables inside a block."""
    if key in ("options", "solver_options") and isinstance(value, dict):
        named = "set" if key == "options" else "solver"
        yield from _options(*NAMED_KEYS[named], table.get(named), value, at)
        return
    for number, item in enumerate(value if isinstance(value, list) else [value]):
        if not isinstance(item, dict):
            continue
        where = f"{at}[{number}]" if isinstance(value, list) else at
        for inner, given in item.items():
            yield _entry(key, inner, given, where)
            if inner == "options":
                yield from _entry_options(kind, item, f"{where}.options")


def _entry(key: str, inner: str, value: Any, where: str) -> Explained:
    """One key of an entry of a list: of a method, a target, a set of motions, limits."""
    tables = {
        "lines": read_parameter_docs(LineSet),
        "example": read_parameter_docs(Example),
        "limits": MOTION_LIMIT_KEYS,
        "targets": _target_keys(),
        "noise": read_parameter_docs(Noise),
    }
    if key in tables:
        about = tables[key].get(inner, ParameterDoc("", "", ""))
        return Explained(f"{where}.{inner}", value, "", about.unit, about.meaning)
    needed = "required" if inner in ("solver", "law", "peer") else ""
    return Explained(f"{where}.{inner}", value, needed, "", ENTRY_KEYS.get(inner, ""))


def _target_keys() -> dict[str, ParameterDoc]:
    """Keys of a target; one of laws calls its entry ``law``."""
    found = read_parameter_docs(Target)
    both = ParameterDoc("float", "The bound, as one of the two.", "")
    return found | dict.fromkeys(TARGET_LABELS, found["method"]) | {"at_most": both, "at_least": both}


def _entry_options(kind: Kind, item: dict[str, Any], at: str) -> Iterator[Explained]:
    """Options of a method, a law or a peer."""
    for named in ("solver", "law"):
        if named in item:
            yield from _options(*NAMED_KEYS[named], item[named], item["options"], at)
    if "peer" in item and kind.name in PEERS_OF:
        yield from _options(*PEERS_OF[kind.name], item["peer"], item["options"], at)


def _code(name: Any) -> bool:
    """Whether a name means a Python file, which checking does not run."""
    return is_path(name) and str(name).lower().endswith(".py")


def _options(group: str, word: str, name: Any, given: dict[str, Any], at: str) -> Iterator[Explained]:
    """Options of what is found by a name, those that are not given, too; in a file they are not looked at."""
    if _code(name):
        words = f"An option of {Path(name).name}, which is not run here."
        yield from (Explained(f"{at}.{key}", value, "", "", words) for key, value in given.items())
        return
    method: Any = None
    with suppress(OptikError):  # a method whose package is not installed: the run says so
        method = load_method(group, name, word)
    if method is None:
        return
    known, words_of = defaults(method), read_parameter_docs(method)
    for key in given:
        if key not in known:
            near = find_nearest_name(key, known)
            expected = (f"{near!r}, or another of " if near else "options out of ") + ", ".join(known)
            raise InvalidInput(f"{at} ({word} {name})", f"the option {key!r}", expected)
    for key in [*given, *(k for k in known if k not in given)]:
        about = words_of.get(key, ParameterDoc("", "", ""))
        default = "required" if known[key] is NO_DEFAULT else _shown(known[key])
        yield Explained(f"{at}.{key}", given.get(key), default, about.unit, about.meaning, key in given)
