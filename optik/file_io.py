"""Reading of files within a size limit, and atomic writing."""

from __future__ import annotations

import json
import os
import tomllib
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

from optik.errors import InvalidInput, MissingDependency, OutputError

MOST_BYTES = 2**30
"""Default size limit of a file [bytes]."""
BYTES_AT_ONCE = 2**20
"""Bytes read in one call, for which Python reserves memory."""
MOST_LEVELS = 100
"""Most levels of a YAML file that are read."""
MOST_ALIASES = 1000
"""Most aliases of a YAML file that are read."""


def check_suffix(file: str | os.PathLike[str], known: tuple[str, ...], argument: str = "file") -> str:
    """Check the suffix of a file's name; return it in lower case."""
    suffix = Path(file).suffix.lower() if isinstance(file, str | os.PathLike) else None
    if suffix not in known:
        came = os.fspath(file) if isinstance(file, os.PathLike) else file
        raise InvalidInput(argument, repr(came)[:120], f"a name that ends in {', '.join(known)}")
    return str(suffix)


def read_bytes(
    file: Path, *, argument: str = "file", expected: str = "a readable file", most: int = MOST_BYTES
) -> bytes:
    """Read the content of a file."""
    content = bytearray()
    try:
        with file.open("rb") as opened:
            while len(content) <= most and (part := opened.read(BYTES_AT_ONCE)):
                content += part
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        reason = getattr(error, "strerror", None) or error
        raise InvalidInput(argument, f"{str(file)[:120]!r} ({reason})", expected) from None
    if len(content) > most:
        raise InvalidInput(argument, f"more than {most // 2**20} MB", expected)
    return bytes(content)


def decode_text(content: bytes, argument: str = "content") -> str:
    """Decode UTF-8."""
    try:
        return content.decode("utf-8", errors="surrogatepass")
    except UnicodeDecodeError as error:
        raise InvalidInput(argument, str(error)[:120], "text in UTF-8") from None


def parse_json(text: str, argument: str) -> Any:
    """Parse strict JSON, without NaN and Infinity."""

    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is not a number in JSON")

    try:
        return json.loads(text, parse_constant=refuse)
    except (ValueError, RecursionError) as error:
        raise InvalidInput(argument, f"{str(error)[:120]}", "JSON") from None


def parse_toml(text: str, argument: str) -> dict[str, Any]:
    """Parse TOML."""
    try:
        return tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InvalidInput(argument, str(error)[:120], "TOML") from None


def parse_yaml(text: str, argument: str, purpose: str) -> Any:
    """Parse one document of YAML by a loader that makes plain data only."""
    try:
        import yaml
    except ModuleNotFoundError:
        raise MissingDependency("PyYAML", purpose, "ros") from None
    base: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

    class Loader(base):  # type: ignore[misc]
        """The loader of plain data that refuses a key given twice, of which PyYAML takes the last."""

        def construct_mapping(self, node: Any, deep: bool = False) -> Any:
            keys = [(key.tag, key.value) for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
            if len(set(keys)) < len(keys):
                twice = next(key for _, key in keys if sum(other == key for _, other in keys) > 1)
                raise yaml.YAMLError(f"the key {twice!r} twice in one mapping")
            return super().construct_mapping(node, deep)

    try:
        depth = aliases = 0
        for event in yaml.parse(text, base):  # the loader calls itself for each level, in C without a limit
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            aliases += isinstance(event, yaml.AliasEvent)
            if depth > MOST_LEVELS or aliases > MOST_ALIASES:
                got = f"more than {MOST_LEVELS} levels" if depth > MOST_LEVELS else f"more than {MOST_ALIASES} aliases"
                raise InvalidInput(argument, got, f"YAML with at most {MOST_LEVELS} levels and {MOST_ALIASES} aliases")
        documents = [d for d in yaml.load_all(text, Loader) if d is not None]
    except (yaml.YAMLError, ValueError, TypeError, RecursionError) as error:  # the last three: dates, keys, nesting
        raise InvalidInput(argument, " ".join(str(error).split())[:160], "complete YAML") from None
    if len(documents) != 1:
        raise InvalidInput(argument, f"{len(documents)} documents", "one document")
    return documents[0]


def write_atomically(path: str | os.PathLike[str], write: Callable[[Path], object]) -> None:
    """Write a file completely or not at all, by renaming a temporary file."""
    target = Path(path)
    if not target.name or "\0" in str(target):
        raise OutputError(target, "is not a valid file name")
    part = target.parent / f".{uuid.uuid4().hex[:12]}.part"
    try:
        try:
            write(part)
            part.replace(target)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(target, f"cannot be written ({error.strerror or error})") from None
