"""Explanation of every key of a suite, from the models that read it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from pydantic_core import PydanticUndefined

from benchmarks.blocks.block import Block
from benchmarks.blocks.entries import IKPeer, LawPeer, ProblemBlock, check_set
from benchmarks.blocks.timing.motions import path_in_file
from benchmarks.blocks.timing.settings import LawBlock
from benchmarks.settings import NAMED_KEYS, Entries, Settings, naming
from benchmarks.suite import OWN_KEYS, Suite
from optik.errors import InvalidInput, OptikError
from optik.plugins import files
from optik.plugins.files import CODE, collect_plugins, defaults, find_nearest_name, is_path, read_parameter_docs
from optik.registry import load_method
from planners.limits import kind_of

PEERS_OF = {IKPeer: ("benchmarks.peers.ik", "peer"), LawPeer: ("benchmarks.peers.laws", "peer of time laws")}
"""Group and noun of peers."""


class Explained(NamedTuple):
    """One key of a suite: its path, such as ``speed.warm.options.count``, and its meaning."""

    key: str
    value: Any  # in the file; None if it is absent
    default: str  # required if it has none, empty if it is unknown
    unit: str
    meaning: str
    given: bool = True  # whether it is in the file


def explain(suite: Suite, folder: Path) -> list[Explained]:
    """Explain every key of a suite, including possible keys that it lacks."""
    found = [
        Explained(key, suite.settings.get(key), default, "", meaning, key in suite.settings)
        for key, (meaning, default) in OWN_KEYS.items()
    ]
    for key, data in suite.settings.items():
        for block, table in zip(suite.of(key), data, strict=True) if key in suite.asked else ():
            with collect_plugins(folder):
                found += _table(type(block), table, f"{key}.{block.id}")
                _check(block)
    return found


def _check(block: Block) -> None:
    """Check the settings that depend on data files."""
    if isinstance(block, ProblemBlock) and not _code(block.set) and not _code(block.robot):
        check_set(block)
    for line in block.lines if isinstance(block, LawBlock) else ():
        if line.path and not _code(line.robot):
            with naming(f"block {block.id!r}"):
                path_in_file(line.load(), Path(line.path))


def _table(model: type[Settings], table: dict[str, Any], at: str, absent: bool = True) -> Iterator[Explained]:
    """Explain the keys of a table, and on request those that it lacks."""
    keys = model.keys()
    for key in [*table, *(key for key in sorted(set(keys) - set(table)) if absent)]:
        value, given = table.get(key), key in table
        if key not in keys:  # a further limit of a `LimitSet`
            kind = kind_of(key)
            yield Explained(f"{at}.{key}", value, "none", kind.units[0], (kind.__doc__ or "").splitlines()[0], given)
            continue
        field = keys[key]
        unit = (field.json_schema_extra or {}).get("unit", "")
        yield Explained(f"{at}.{key}", value, _default(field), unit, field.description or "", given)
        if key in ("options", "solver_options") and isinstance(value, dict):
            yield from _options(*_named(model, table, key), value, f"{at}.{key}")
        elif (inner := _model(field)) is not None and isinstance(value, dict):
            yield from _table(inner, value, f"{at}.{key}", absent=False)
        elif inner is not None and isinstance(value, list):
            for number, item in enumerate(value):
                yield from _table(inner, item, f"{at}.{key}[{number}]", absent=False)


def _model(field: Any) -> type[Settings] | None:
    """Return the model of the tables that a key has."""
    for one in field.metadata:
        if isinstance(one, Entries):
            return one.model
    found = [field.annotation, *getattr(field.annotation, "__args__", ())]
    return next((one for one in found if isinstance(one, type) and issubclass(one, Settings)), None)


def _named(model: type[Settings], table: dict[str, Any], key: str) -> tuple[str, str, Any]:
    """Return group, noun and name of the object whose options a table has."""
    name = next(
        n for n in (("set",) if key == "options" and "set" in table else ("solver", "law", "peer")) if n in table
    )
    group, noun = PEERS_OF[model] if name == "peer" else NAMED_KEYS[name]
    return group, noun, table[name]


def _default(field: Any) -> str:
    """Return the default of a key: ``required`` if it has none."""
    if field.is_required():
        return "required"
    return "" if field.default is PydanticUndefined else _shown(field.default)


def _shown(value: Any) -> str:
    """Format a default."""
    if value is None or value in ((), {}, ""):
        return "none"
    if isinstance(value, tuple):
        return ", ".join(_shown(part) for part in value)
    if isinstance(value, Settings):
        return ", ".join(f"{key} {_shown(given)}" for key, given in value if given) or "none"
    return str(value).lower() if isinstance(value, bool) else str(value)


def _code(name: Any) -> bool:
    """Say whether a name is a Python file, which checking does not run."""
    return is_path(name) and str(name).lower().endswith(CODE)


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
        about = words_of.get(key, files.ParameterDoc("", "", ""))
        default = "required" if known[key] is files.NO_DEFAULT else _shown(known[key])
        yield Explained(f"{at}.{key}", given.get(key), default, about.unit, about.meaning, key in given)
