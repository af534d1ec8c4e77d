"""Reading files that others may have written or damaged: bytes, text and strict JSON, or a named error."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from optik.errors import InvalidInput

LARGEST = 2**30
"""Longest file that is read [bytes]."""
PART = 2**20
"""Bytes read at once: Python reserves as many as are asked for, also where the file is short."""


def suffix_of(file: str | os.PathLike[str], known: tuple[str, ...]) -> str:
    """Return the suffix of a file's name, in small letters.

    Raises
    ------
    InvalidInput
        No path, or a suffix that is not known.
    """
    suffix = Path(file).suffix.lower() if isinstance(file, str | os.PathLike) else None
    if suffix not in known:
        raise InvalidInput("file", repr(file)[:120], f"a name that ends in {', '.join(known)}")
    return str(suffix)


def content_of(file: Path) -> bytes:
    """Return what a file holds.

    Raises
    ------
    InvalidInput
        Nothing that can be read, or far too much.
    """
    content = bytearray()
    try:
        with file.open("rb") as opened:
            while len(content) <= LARGEST and (part := opened.read(PART)):
                content += part
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        reason = getattr(error, "strerror", None) or error
        raise InvalidInput("file", f"nothing that can be read ({reason})", "a file") from None
    if len(content) > LARGEST:
        raise InvalidInput("file", f"more than {LARGEST // 2**20} MB", "a file of a motion")
    return bytes(content)


def text_of(content: bytes) -> str:
    """Return text in UTF-8.

    Raises
    ------
    InvalidInput
        Other bytes.
    """
    try:
        return content.decode("utf-8", errors="surrogatepass")
    except UnicodeDecodeError as error:
        raise InvalidInput("content", str(error)[:120], "text in UTF-8") from None


def parsed(text: str, argument: str) -> Any:
    """Return what strict JSON holds: no NaN, no Infinity.

    Raises
    ------
    InvalidInput
        Text that is none.
    """

    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is no number in JSON")

    try:
        return json.loads(text, parse_constant=refuse)
    except (ValueError, RecursionError) as error:
        raise InvalidInput(argument, f"{str(error)[:120]}", "JSON, whole") from None
