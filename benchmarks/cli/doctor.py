"""`optik doctor`: what works on this machine, what does not, why, and what to type."""

from __future__ import annotations

import importlib.metadata
import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import typer
from numba.extending import is_jitted
from packaging.requirements import Requirement
from rich.markup import escape
from rich.table import Table

import optik
from benchmarks.cli.kernels import describe_shipped
from benchmarks.cli.shared import AsJson, out_console, print_json
from benchmarks.peers.ik import PEERS
from benchmarks.peers.ik.base import missing, version_of
from benchmarks.peers.laws import TIMING_PEERS
from benchmarks.provenance import provenance
from optik.compiled.cache import KernelCache
from optik.kinematics import forward
from optik.registry import GROUPS, describe_distribution, find_installed, find_refused, load_method, own_names

OPTIK = "optik-toolkit"
"""Name of this distribution."""

CLASHING = "optik-py"
"""Distribution with the same import name: an environment can have only one of the two."""


@dataclass(frozen=True)
class Row:
    """One line of the output.

    Attributes
    ----------
    part : str
        Heading of its group.
    name : str
        What was checked.
    state : str
        ``usable``, ``absent`` (not installed, not needed) or ``problem``.
    words : str
        Its version, or the reason and what to type.
    """

    part: str
    name: str
    state: str
    words: str


def doctor(as_json: AsJson = False) -> None:
    """Check the installation: versions, compiled code, optional packages, plug-ins. The exit status is 1 if there is a problem.

    An absent optional package is not a problem. Plug-ins are listed but not imported, so a listed plug-in may still fail.
    """
    rows = [*_machine(), *_requirements(), *_cache(), *_extras(), *_peers(), *_plugins()]
    if as_json:
        plugins = [asdict(plugin) for plugin in _installed_plugins()]
        print_json({"version": optik.__version__, "plugins": plugins, "rows": [asdict(row) for row in rows]})
    else:
        looks = {"usable": "green", "absent": "yellow", "problem": "bold red"}
        for part in dict.fromkeys(row.part for row in rows):
            table = Table(title=part, title_justify="left", show_header=False, box=None, padding=(0, 2, 0, 0))
            for row in rows:
                if row.part == part:
                    table.add_row(escape(row.name), f"[{looks[row.state]}]{row.state}", escape(row.words))
            out_console.print(table, highlight=False)
            out_console.print()
    if any(row.state == "problem" for row in rows):
        raise typer.Exit(1)


def _machine() -> Iterator[Row]:
    facts = provenance(0, 1)
    commit = f", commit {facts['commit'][:12]}{' with changes' if facts['dirty'] else ''}" if facts["commit"] else ""
    yield Row("machine", "optik", "usable", f"{optik.__version__}{commit}, in {os.path.dirname(optik.__file__)}")
    yield Row("machine", "Python", "usable", f"{facts['python']}, {facts['system']}")
    yield Row("machine", "processor", "usable", f"{facts['cpu']}, {facts['cores']} cores for this process")
    if _version(CLASHING):
        words = f"has the same import name as {OPTIK}: uninstall both, then install one"
        yield Row("machine", CLASHING, "problem", words)


def _version(distribution: str) -> str | None:
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return None


def _needed(extra: str | None) -> list[str]:
    """List the distributions that this one or one of its extras requires; none if it is not installed."""
    try:
        asked = importlib.metadata.requires(OPTIK) or []
    except importlib.metadata.PackageNotFoundError:
        return []
    found = []
    for requirement in map(Requirement, asked):
        marker = requirement.marker
        here = marker is None or marker.evaluate({"extra": extra or ""})  # sys_platform and such decide too
        if here and ("extra" in str(marker)) == (extra is not None) and requirement.name != OPTIK:
            found.append(requirement.name)
    return list(dict.fromkeys(found))


def _requirements() -> Iterator[Row]:
    for name in _needed(None):
        version = _version(name)
        yield Row("packages", name, "usable" if version else "problem", version or f"required: pip install {name}")


def _cache() -> Iterator[Row]:
    kernel: Any = forward
    if not is_jitted(kernel):
        yield Row("compiled code", "cache", "problem", "NUMBA_DISABLE_JIT is set, so kernels run uncompiled and slowly")
        return
    place = KernelCache(kernel).cache_path
    if place is None:
        words = "no folder is writable, so every process compiles for a minute: set NUMBA_CACHE_DIR to a folder"
        yield Row("compiled code", "cache", "problem", words)
    else:
        yield Row("compiled code", "cache", "usable", place)
    words = describe_shipped()
    yield Row("compiled code", "shipped", "usable" if words.endswith(" used") else "absent", words)


def _extras() -> Iterator[Row]:
    try:
        extras = importlib.metadata.metadata(OPTIK).get_all("Provides-Extra") or []
    except importlib.metadata.PackageNotFoundError:
        return
    for extra in sorted(set(extras) - {"dev", "docs", "peers"}):
        missing = [name for name in _needed(extra) if not _version(name)]
        words = f"pip install '{OPTIK}[{extra}]' (missing: {', '.join(missing)})"
        versions = ", ".join(f"{name} {_version(name)}" for name in _needed(extra))
        yield Row("extras", extra, "absent" if missing else "usable", words if missing else versions)


def _peers() -> Iterator[Row]:
    for folder, part in ((PEERS, "peers: inverse kinematics"), (TIMING_PEERS, "peers: time laws")):
        for name in sorted(own_names(folder)):
            kind = load_method(folder, name, "peer")
            why = missing(kind)
            yield Row(
                part, name, "absent" if why else "usable", why or f"{kind.distribution} {version_of(name, folder)}"
            )


@dataclass(frozen=True)
class _Plugin:
    """An entry point of an installed package: its group, name, object and distribution, and the reason of a refusal."""

    group: str
    name: str
    object: str
    distribution: str
    refused: str


def _installed_plugins() -> Iterator[_Plugin]:
    for group in GROUPS:
        for name, point in find_installed(group).items():
            yield _Plugin(group, name, point.value, describe_distribution(point), "")
    for group in GROUPS:
        for row in find_refused(group):
            yield _Plugin(row.group, row.name, row.value, row.distribution, row.reason)


def _plugins() -> Iterator[Row]:
    for plugin in _installed_plugins():
        words = f"{plugin.object} of {plugin.distribution}"
        state = "problem" if plugin.refused else "usable"
        yield Row(
            "plug-ins",
            f"{plugin.group}: {plugin.name}",
            state,
            words + (f": {plugin.refused}" if plugin.refused else ""),
        )
