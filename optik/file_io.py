"""Reading of files within a size limit, atomic writing, and the lock of a folder that one process writes."""

from __future__ import annotations

import json
import os
import sys
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import radians
from pathlib import Path
from typing import Any

from optik.errors import InvalidInput, OutputError

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

MOST_BYTES = 2**30
"""Default size limit of a file [bytes]."""
BYTES_AT_ONCE = 2**20
"""Bytes read in one call, for which Python reserves memory."""
MOST_LEVELS = 100
"""Most levels of a YAML file that are read."""
MOST_ALIASES = 1000
"""Most aliases of a YAML file that are read."""
LOCK = ".lock"
"""File of the lock that a writing process holds."""
WAIT = 0.2
"""Time between two attempts to get a lock that another process holds [s]."""

LOCK_BYTES = 4096
"""Largest size of the file of a lock [bytes]."""


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
    """Parse TOML, after a byte order mark too."""
    import tomllib

    try:
        return tomllib.loads(text.removeprefix("\ufeff"))
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InvalidInput(argument, str(error)[:120], "TOML") from None


def parse_yaml(text: str, argument: str) -> Any:
    """Parse one document of YAML by a loader that makes plain data only."""
    import yaml

    base: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

    class Loader(base):  # type: ignore[misc]
        """The loader of plain data that refuses a key given twice, of which PyYAML takes the last."""

        def construct_mapping(self, node: Any, deep: bool = False) -> Any:
            keys = [(key.tag, key.value) for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
            if len(set(keys)) < len(keys):
                twice = next(key for _, key in keys if sum(other == key for _, other in keys) > 1)
                raise yaml.YAMLError(f"the key {twice!r} twice in one mapping")
            return super().construct_mapping(node, deep)

    Loader.add_constructor("!degrees", lambda _, node: radians(float(node.value)))  # as Universal Robots' files have it

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
        why = error.strerror or error if target.parent.is_dir() else f"create the folder {target.parent} first"
        raise OutputError(target, f"cannot be written ({why})") from None


# ---------------------------------------------------------------- locks


class Lock:
    """A lock that this process holds. Its file has the number of the process and its current work.

    The file remains only after a crash. Then it tells the next process how often its work has crashed.
    """

    def __init__(self, file: Path, opened: int) -> None:
        self._file, self._opened = file, opened
        left = _parse(os.read(opened, LOCK_BYTES))
        self._crashed, self._crashes = str(left.get("work", "")), int(left.get("crashes", 0))
        self.is_void = not self._crashed
        self._write(self._crashed, self._crashes)

    def crashes(self, work: str) -> int:
        """Return how often the process crashed in some work."""
        return self._crashes if work == self._crashed else 0

    @contextmanager
    def at_work(self, work: str) -> Iterator[None]:
        """Record the work of this context; a process that ends in it without an exception has crashed."""
        self.is_void = True
        self._write(work, self.crashes(work) + 1)
        yield
        self._write("", 0)

    def _write(self, work: str, crashes: int) -> None:
        """Overwrite the first line of the file; only this line is read."""
        line = json.dumps({"process": os.getpid(), "work": work, "crashes": crashes})
        try:
            os.lseek(self._opened, 0, os.SEEK_SET)
            os.write(self._opened, line.encode() + b"\n")
        except OSError as error:
            raise OutputError(self._file, f"cannot be written ({error.strerror})") from None

    def release(self) -> None:
        """Release the lock. The file is kept if it records a crash whose work is still to be repeated."""
        if sys.platform == "win32":
            os.close(self._opened)  # an open file cannot be removed
        if self.is_void:
            self._file.unlink(missing_ok=True)  # before another process can hold it
        if sys.platform != "win32":
            os.close(self._opened)


@contextmanager
def locked(folder: Path, wait: bool = False) -> Iterator[Lock]:
    """Lock a folder for this process; create the folder if it does not exist.

    The operating system releases the lock when the process ends, also after a crash.
    """
    file = folder / LOCK
    try:
        folder.mkdir(parents=True, exist_ok=True)
        while (opened := _opened(file)) is None and wait:
            time.sleep(WAIT)
    except OSError as error:
        raise OutputError(folder, f"cannot be written ({error.strerror})") from None
    if opened is None:
        words = f"another process writes to it{_holder(file)}; wait for its end, or choose another folder"
        raise OutputError(folder, words)
    lock = Lock(file, opened)
    try:
        yield lock
    finally:
        lock.release()


def _opened(file: Path) -> int | None:
    """Open and lock the file of the lock; return None if another process holds it."""
    while True:
        opened = os.open(file, os.O_RDWR | os.O_CREAT, 0o644)
        if not _taken(opened):
            os.close(opened)
            return None
        try:
            same = os.path.sameopenfile(opened, again := os.open(file, os.O_RDWR))
            os.close(again)
        except FileNotFoundError:
            same = False
        if same:
            return opened
        os.close(opened)  # its last holder has removed it meanwhile


def _taken(opened: int) -> bool:
    """Try to lock the file; return whether this process holds the lock."""
    try:
        if sys.platform == "win32":
            msvcrt.locking(opened, msvcrt.LK_NBLCK, 1)
        else:
            fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):
        return False
    except OSError:  # a file system without locks
        return True
    return True


def _parse(content: bytes) -> dict[str, Any]:
    """Return the content of the first line of a lock's file; nothing if it is damaged."""
    try:
        found = json.loads(content.partition(b"\n")[0])
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def _holder(file: Path) -> str:
    """Describe the holder of a lock."""
    try:
        return f" (process {_parse(file.read_bytes())['process']})"
    except (OSError, KeyError):
        return ""
