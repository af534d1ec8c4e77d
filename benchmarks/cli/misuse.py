"""Errors of the parser as one line: the option or argument as typed, the value, and what to type."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from difflib import get_close_matches
from enum import Enum
from typing import Any, get_args, get_type_hints

import typer

from optik.errors import InvalidInput, OptikError

UsageError: Any = typer.BadParameter.__base__
"""Base class of the parser's errors: of the package click, or of the copy of it in newer versions of Typer."""

VALUES = {float: "a number", int: "a whole number"}
"""Values of options by their type, for messages."""


def describe_usage(error: Any, context: Any, words: Sequence[str], kind: type) -> OptikError:
    """Return the parser's error about the words of a command as one of ours; `kind` is the class of the command."""
    name, param = str(getattr(error, "option_name", "") or ""), getattr(error, "param", None)
    example = f"; for example: {(context.command.epilog or '').removeprefix('Example: ').strip('`')}"
    options = {typed: p for p in context.command.params for typed in (*p.opts, *p.secondary_opts)}
    if name and name not in options:
        near = get_close_matches(name, [each for each in options if each.startswith("--")], n=2)
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
    return InvalidInput(named, repr(typed), _describe_values(kind, param.name))


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
    return next((words for part, words in VALUES.items() if part in parts), "another value") + least
