"""Explanation of every key of a suite: meaning and unit from docstrings, default from the code that reads it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.blocks._problems import ProblemBlock, check_set
from benchmarks.blocks.base import Block, Entry, Kind
from benchmarks.blocks.cell.settings import Noise
from benchmarks.blocks.timing.laws.motions import path_in_file
from benchmarks.blocks.timing.laws.sets import LineSet
from benchmarks.blocks.timing.laws.settings import Example, LawBlock
from benchmarks.settings import NAMED_KEYS, Target, naming
from benchmarks.suite import ALIASES, Suite
from optik.errors import InvalidInput, OptikError
from optik.plugins.files import is_path
from optik.plugins.options import NO_DEFAULT, ParameterDoc, defaults, find_nearest_name, read_parameter_docs
from optik.plugins.usage import collect_plugins
from optik.registry import load_method

SUITE_KEYS = {
    "title": ("Heading of the report.", "the suite's name"),
    "seed": ("Seed of all random numbers, 0 or more.", "0"),
}
"""Keys of a suite itself: meaning and default."""

PEERS_OF = {"calls": ("benchmarks.peers.ik", "peer"), "laws": ("benchmarks.peers.laws", "peer of timing")}
"""Group and noun of the peers of each kind."""

ENTRY_KEYS = {
    "solver": "IK method: a name from `optik doctor`, or the path of a file.",
    "law": "Time law: a name, or the path of a file.",
    "peer": "Outside method: a name, or the path of a file.",
    "label": "Name in reports; by default its own.",
    "options": "Options of the method.",
    "max_problems": "Largest number of problems, for slow methods; by default all.",
    "whole": "Whether each problem is one call with default settings and restarts, instead of one attempt.",
    "along": "Whether the method iterates at each of 151 poses of the line, starting from its previous solution.",
    "without": "Limits that the law does not know; its motions are judged by them.",
    "max_lines": "Largest number of motions of each set, for slow laws; by default all.",
}
"""Keys of an entry of ``methods``, ``laws``, ``peers`` or ``reference``."""

MOTION_LIMIT_KEYS = {
    "label": ParameterDoc("str", "Name of these limits in reports.", ""),
    "velocity": ParameterDoc("", "Velocity limit: a number, one per joint, or 'robot' [rad/s, m/s].", "rad/s, m/s"),
    "acceleration": ParameterDoc("", "Acceleration limit [rad/s², m/s²].", "rad/s², m/s²"),
    "jerk": ParameterDoc("", "Jerk limit [rad/s³, m/s³].", "rad/s³, m/s³"),
    "tool_speed": ParameterDoc("", "Limit on the speed of the tool point [m/s].", "m/s"),
    "rotation_speed": ParameterDoc("", "Limit on the angular speed of the tool [rad/s].", "rad/s"),
    "torque": ParameterDoc("", "Torque limit, for an arm with known masses [N·m, N].", "N·m, N"),
    "torque_rate": ParameterDoc("", "Torque rate limit [N·m/s, N/s].", "N·m/s, N/s"),
}  # fmt: skip
"""Keys of an entry of ``limits``."""

TARGET_LABELS = ("method", "law")
"""Keys with which a target names its entry."""


class Explained(NamedTuple):
    """One key of a suite.

    Attributes
    ----------
    key : str
        Its path in the suite, such as ``speed.warm.options.count``.
    value : object
        Its value in the file; None if it is absent.
    default : str
        Its default; ``required`` if it has none, empty if it is unknown.
    unit : str
        Unit of its value, or empty.
    meaning : str
        Its meaning.
    given : bool
        Whether it is in the file.
    """

    key: str
    value: Any
    default: str
    unit: str
    meaning: str
    given: bool = True


def explain(suite: Suite, folder: Path) -> list[Explained]:
    """Explain every key of a suite, including possible keys that it lacks."""
    found = [
        Explained(key, suite.settings.get(key), default, "", meaning, key in suite.settings)
        for key, (meaning, default) in SUITE_KEYS.items()
    ]
    kinds = {kind.name: kind for kind in suite.kinds}
    for key, data in suite.settings.items():
        name = ALIASES.get(key, key)
        kind = kinds.get(name)
        if key in SUITE_KEYS or kind is None:
            continue
        blocks, tables = suite.of(kind.name), [data] if kind.single else data
        for block, table in zip(blocks, tables, strict=True):
            with collect_plugins(folder):
                found += _block(kind, block, table, key if kind.single else f"{key}.{block.id}")
    return found


def _block(kind: Kind, block: Block, table: dict[str, Any], at: str) -> Iterator[Explained]:
    """Explain the keys of one block."""
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
    """Say whether a kind has a key: it may refuse a value, but not the key."""
    try:
        kind.settings(table | {key: None})
    except InvalidInput as error:
        return not error.got.startswith("the key")
    except OptikError:
        return True
    return True


def _default(kind: Kind, block: Block, table: dict[str, Any], key: str) -> str:
    """Return the default of a key: the value that the kind reads without it."""
    if key in table:
        try:
            block = kind.settings({name: value for name, value in table.items() if name != key})
        except OptikError:
            return "required"
    return _shown(getattr(block, key, None))


def _shown(value: Any) -> str:
    """Format a default."""
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
    """Explain the keys of the tables inside a block."""
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
    """Explain one key of an entry of a list: of a method, a target, a set of motions, limits."""
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
    """Return the keys of a target; for laws its entry is ``law``."""
    found = read_parameter_docs(Target)
    both = ParameterDoc("float", "Bound; give one of the two.", "")
    return found | dict.fromkeys(TARGET_LABELS, found["method"]) | {"at_most": both, "at_least": both}


def _entry_options(kind: Kind, item: dict[str, Any], at: str) -> Iterator[Explained]:
    """Explain the options of a method, a law or a peer."""
    for named in ("solver", "law"):
        if named in item:
            yield from _options(*NAMED_KEYS[named], item[named], item["options"], at)
    if "peer" in item and kind.name in PEERS_OF:
        yield from _options(*PEERS_OF[kind.name], item["peer"], item["options"], at)


def _code(name: Any) -> bool:
    """Say whether a name is a Python file, which checking does not run."""
    return is_path(name) and str(name).lower().endswith(".py")


def _options(group: str, word: str, name: Any, given: dict[str, Any], at: str) -> Iterator[Explained]:
    """Explain all options of a named object; those of a file are not read."""
    if _code(name):
        words = f"Not explained: option of {Path(name).name}, which this check does not run."
        yield from (Explained(f"{at}.{key}", value, "", "", words) for key, value in given.items())
        return
    method: Any = None
    with suppress(OptikError):  # its package is not installed: the run reports this
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
