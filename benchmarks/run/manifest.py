"""The beginning of a run: its manifest, in a locked folder."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from benchmarks.provenance import provenance
from benchmarks.records import FORMAT, LEDGER, MANIFEST, RunFolder
from benchmarks.suite import Suite
from optik.errors import OutputError
from optik.file_io import LOCK, Lock, locked
from optik.plugins.files import expected
from optik.plugins.usage import check_same_plugins, record_plugins

_LEFT_AT_START = re.compile(rf"{re.escape(LOCK)}|\.[0-9a-f]{{12}}\.part")
"""Names of the files of a run that was killed at its start."""


def new_manifest(suite: Suite, workers: int, command: str) -> dict[str, Any]:
    """Return the manifest at the start of a run."""
    return {
        "format": FORMAT,
        "suite": suite.name,
        "title": suite.title,
        "fingerprint": suite.fingerprint,
        "settings": suite.settings,
        "plugins": record_plugins(suite.plugins),
        "command": command,
        "provenance": provenance(suite.seed, workers),
        "continued": [],
        "failed": [],
        "complete": False,
    }


def resumed(folder: RunFolder, manifest: dict[str, Any]) -> dict[str, Any]:
    """Return the manifest of the run in this folder. If the run is resumed, it lists all sessions."""
    path = folder.path
    if path.exists() and not path.is_dir():
        raise OutputError(path, "is a file; choose a folder for the run")
    if _is_empty(folder):
        return manifest
    if not folder.has(MANIFEST):
        raise OutputError(path, "contains something else; choose a new or empty folder for the run")
    old = folder.manifest()
    if old["fingerprint"] != manifest["fingerprint"]:
        raise OutputError(path, f"contains a run of {old['suite']!r} with other settings; choose another folder")
    check_same_plugins(old.get("plugins", []), manifest["plugins"])
    return old if old["complete"] else old | {"continued": _with_session(old["continued"], manifest["provenance"])}


def _with_session(sessions: list[dict[str, Any]], now: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the sessions of a run with one more; if it equals the last one, increase the count ``sessions`` of that."""
    apart = ("created", "sessions")
    if sessions and all(sessions[-1].get(key) == now[key] for key in now if key not in apart):
        return [*sessions[:-1], sessions[-1] | {"sessions": sessions[-1].get("sessions", 1) + 1}]
    return [*sessions, now]


@contextmanager
def begun(folder: RunFolder, manifest: dict[str, Any]) -> Iterator[Lock]:
    """Lock a folder and begin or resume a run in it, with its plug-ins; remove a run that fails before its first other file."""
    existed, fresh = folder.path.exists(), _is_empty(folder)
    try:
        with locked(folder.path) as lock, expected(manifest["plugins"]):
            try:
                _begin(folder, manifest)
                yield lock
            except Exception:
                begun_with = (folder.path / MANIFEST, folder.path / LEDGER)
                if fresh and all(file in begun_with or _LEFT_AT_START.fullmatch(file.name) for file in _files(folder)):
                    for file in begun_with:
                        file.unlink(missing_ok=True)
                raise
    finally:
        if not existed and folder.path.is_dir() and not any(folder.path.iterdir()):
            folder.path.rmdir()


def _begin(folder: RunFolder, manifest: dict[str, Any]) -> None:
    """Write the manifest, remove the remains of a killed process, and check all tables."""
    try:
        folder.write_json(MANIFEST, resumed(folder, manifest))
        for left in folder.path.rglob(".*.part"):
            left.unlink(missing_ok=True)
        folder.verify()
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(folder.path, f"cannot be written ({error.strerror})") from None


def _files(folder: RunFolder) -> Iterator[Path]:
    return (file for file in folder.path.rglob("*") if file.is_file())


def _is_empty(folder: RunFolder) -> bool:
    """Say whether a folder has no files, except those of a run that was killed at its start."""
    return not folder.path.is_dir() or all(_LEFT_AT_START.fullmatch(one.name) for one in folder.path.iterdir())
