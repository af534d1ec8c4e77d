"""`optik doctor`, `kernels` and `bench peer`: the installation, its compiled code, and environments of peers."""

from __future__ import annotations

import importlib.metadata
import os
import shutil
import subprocess
import venv
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import typer
from numba.core.registry import cpu_target
from numba.extending import is_jitted
from packaging.requirements import Requirement
from rich.table import Table
from rich.text import Text

import optik
from benchmarks.cli.command import Command, JsonCommand, argument, err_console, option, out_console, print_json
from benchmarks.peers.ik import PEERS
from benchmarks.peers.laws import TIMING_PEERS
from benchmarks.provenance import provenance, version_here
from optik.compiled import archive
from optik.compiled.cache import VERSIONS, KernelCache, read_code
from optik.compiled.kernel import Kernel
from optik.errors import InvalidInput, NoSolution, OutputError
from optik.kinematics import forward
from optik.registry import GROUPS, describe_distribution, find_installed, find_refused, load_method, own_names

OPTIK = "optik-toolkit"
"""Name of this distribution."""

CLASHING = "optik-py"
"""Distribution with the same import name: an environment can have only one of the two."""

LAST_WORDS = 400
"""Largest number of characters of pip's last line in an error."""


# ---------------------------------------------------------------- optik doctor


class Check(NamedTuple):
    """One line of `optik doctor`: group, name, state (usable, absent or problem), and the version or the command to type."""

    part: str
    name: str
    state: str
    words: str


@dataclass(frozen=True, kw_only=True)
class DoctorCommand(JsonCommand):
    """Check the installation: versions, compiled code, optional packages, plug-ins. The exit status is 1 if there is a problem.

    An absent optional package is not a problem. Plug-ins are listed but not imported, so a listed plug-in may still fail.
    """

    def run(self) -> None:
        """Check the installation, and print the results."""
        rows = [
            *_check_machine(), *_check_requirements(), *_check_cache(), *_check_extras(), *_check_peers(), *_check_plugins(),
        ]  # fmt: skip
        if self.as_json:
            plugins = [plugin._asdict() for plugin in _installed_plugins()]
            print_json({"version": optik.__version__, "plugins": plugins, "rows": [row._asdict() for row in rows]})
        else:
            looks = {"usable": "green", "absent": "yellow", "problem": "bold red"}
            for part in dict.fromkeys(row.part for row in rows):
                table = Table(title=part, title_justify="left", show_header=False, box=None, padding=(0, 2, 0, 0))
                for row in rows:
                    if row.part == part:
                        table.add_row(row.name, Text(row.state, style=looks[row.state]), row.words)
                out_console.print(table)
                out_console.print()
        if any(row.state == "problem" for row in rows):
            raise typer.Exit(1)


def _check_machine() -> Iterator[Check]:
    facts = provenance(0, 1)
    commit = f", commit {facts['commit'][:12]}{' with changes' if facts['dirty'] else ''}" if facts["commit"] else ""
    yield Check("machine", "optik", "usable", f"{optik.__version__}{commit}, in {os.path.dirname(optik.__file__)}")
    yield Check("machine", "Python", "usable", f"{facts['python']}, {facts['system']}")
    yield Check("machine", "processor", "usable", f"{facts['cpu']}, {facts['cores']} cores for this process")
    if version_here(CLASHING):
        words = f"has the same import name as {OPTIK}: uninstall both, then install one"
        yield Check("machine", CLASHING, "problem", words)


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


def _check_requirements() -> Iterator[Check]:
    for name in _needed(None):
        version = version_here(name)
        yield Check("packages", name, "usable" if version else "problem", version or f"required: pip install {name}")


def _check_cache() -> Iterator[Check]:
    kernel: Any = forward
    if not is_jitted(kernel):
        yield Check(
            "compiled code", "cache", "problem", "NUMBA_DISABLE_JIT is set, so kernels run uncompiled and slowly"
        )
        return
    place = KernelCache(kernel).cache_path
    if place is None:
        words = "no folder is writable, so every process compiles for a minute: set NUMBA_CACHE_DIR to a folder"
        yield Check("compiled code", "cache", "problem", words)
    else:
        yield Check("compiled code", "cache", "usable", place)
    words = describe_shipped()
    usable = words.endswith(" used")
    words += "" if usable else "; a first plan compiles for about a minute (in advance: optik kernels --compile)"
    yield Check("compiled code", "shipped", "usable" if usable else "absent", words)


def _check_extras() -> Iterator[Check]:
    try:
        extras = importlib.metadata.metadata(OPTIK).get_all("Provides-Extra") or []
    except importlib.metadata.PackageNotFoundError:
        return
    for extra in sorted(set(extras) - {"dev", "docs", "peers"}):
        missing = [name for name in _needed(extra) if not version_here(name)]
        words = f"pip install '{OPTIK}[{extra}]' (missing: {', '.join(missing)})"
        versions = ", ".join(f"{name} {version_here(name)}" for name in _needed(extra))
        yield Check("extras", extra, "absent" if missing else "usable", words if missing else versions)


def _check_peers() -> Iterator[Check]:
    for folder, part in ((PEERS, "peers: inverse kinematics"), (TIMING_PEERS, "peers: time laws")):
        for name in sorted(own_names(folder)):
            kind = load_method(folder, name, "peer")
            why = kind.missing()
            state, words = ("absent", why) if why else ("usable", f"{kind.distribution} {kind.version()}")
            yield Check(part, name, state, words)


class _Plugin(NamedTuple):
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


def _check_plugins() -> Iterator[Check]:
    for plugin in _installed_plugins():
        words = f"{plugin.object} of {plugin.distribution}{f': {plugin.refused}' if plugin.refused else ''}"
        yield Check("plug-ins", f"{plugin.group}: {plugin.name}", "problem" if plugin.refused else "usable", words)


# ---------------------------------------------------------------- optik kernels


@dataclass(frozen=True, kw_only=True)
class KernelsCommand(JsonCommand):
    """List compiled kernels (functions compiled by Numba): shipped ones, and those compiled here, with the reason."""

    compile_: bool = option(
        "Options", "Compile the kernels of common calls that are neither shipped nor cached.", False, "--compile"
    )
    native: bool = option(
        "Options", "With --compile: also compile the shipped kernels for this processor.", False, "--native"
    )
    jobs: int = option("Options", "With --compile: number of processes.", os.cpu_count() or 1, min=1)

    def run(self) -> None:
        """Compile if requested, and print the kernels."""
        if self.native and not self.compile_:
            raise InvalidInput("--native", "--native alone", "--compile --native")
        if self.compile_:
            _compile(self.jobs, {"OPTIK_COMPILES": "native"} if self.native else {})
        words, rows = describe_shipped(), list(_list_cached())
        if self.as_json:
            print_json({"shipped": words, "kernels": _name_shipped(), "cached": [row._asdict() for row in rows]})
            return
        out_console.print(f"shipped: {words}", soft_wrap=True)
        title = f"{len(rows)} kernel{'s' if len(rows) != 1 else ''} in the cache"
        table = Table("folder", "kernels", "reason", title=title)
        for (folder, why), count in Counter((row.folder, row.why) for row in rows).items():
            table.add_row(folder, str(count), why)
        if rows and not self.compile_:
            out_console.print(table)


def _compile(jobs: int, environment: dict[str, str]) -> None:
    """Compile common calls in several processes, one such run at a time."""
    from benchmarks.kernels.parts import COMPARED, WARM_UP, Progress, run_parts
    from optik.file_io import locked

    kernel: Any = forward
    folder = KernelCache(kernel).cache_path
    if folder is None:
        raise OutputError("the cache", "no folder is writable; set NUMBA_CACHE_DIR to a folder")
    progress = Progress()
    with locked(Path(folder), wait=True):
        parts = [part for part in WARM_UP if find_spec("polars") is not None or part not in COMPARED]
        failed = run_parts(parts, jobs, progress, **environment)
    err_console.print(f"compiled {progress.end()}")
    if failed:
        raise NoSolution("; ".join(f"{part}: {words}" for part, words in failed.items()))


def describe_shipped() -> str:
    """Describe the shipped kernels, and whether they are used here."""
    shipped = archive.open_archive()
    if isinstance(shipped, str):
        return f"none: {shipped}"
    refusal = shipped.refusal(VERSIONS, archive.CompileTarget(*cpu_target.target_context.codegen().magic_tuple()))
    size = shipped.file.stat().st_size / 1e6
    return f"{len(shipped.names)} kernels for {shipped.cpu}, {size:.1f} MB, {f'not used: {refusal}' if refusal else 'used'}"


class CachedKernel(NamedTuple):
    """A kernel in the machine's cache: its folder, its name and types, and why it was compiled."""

    folder: str
    kernel: str
    why: str


def _name_shipped() -> dict[str, str]:
    """Return the names of the shipped kernels by fingerprint."""
    shipped = archive.open_archive()
    return {} if isinstance(shipped, str) else dict(shipped.names)


def _list_cached() -> Iterator[CachedKernel]:
    """Yield every kernel in the cache, of any processor and any version of its source."""
    names, words = _name_shipped(), describe_shipped()
    known, used = set(names.values()), words.endswith(" used")
    for folder in sorted(_folders()):
        for file in sorted(folder.glob("*.nbk")):
            kernel = file.name.rpartition("-")[0]
            if not used:
                why = "no kernels are shipped" if words.startswith("none") else "the shipped kernels are not used here"
            elif kernel not in known:
                why = "not shipped for these arguments"
            elif names.keys() & read_code(file).keys():
                why = "compiled here although shipped"
            else:
                why = "other source, settings or versions than the shipped kernel, or damaged"
            yield CachedKernel(str(folder), kernel, why)


def _folders() -> set[Path]:
    """Return the cache folders of all modules that define kernels."""
    root = Path(optik.__file__).parents[1]
    found = set()
    for file in sorted(p for package in ("optik", "planners", "benchmarks") for p in (root / package).rglob("*.py")):
        if "from optik.compiled import" in file.read_text(encoding="utf-8"):
            module = import_module(".".join(file.relative_to(root).with_suffix("").parts))
            defined = [k for k in vars(module).values() if isinstance(k, Kernel) and k.__module__ == module.__name__]
            found |= {Path(path) for k in defined[:1] if (path := KernelCache(k).cache_path)}
    return found


# ---------------------------------------------------------------- optik bench peer


@dataclass(frozen=True, kw_only=True)
class PeerCommand(Command):
    """Show the version and settings of a peer, or why it cannot run; with --install, create its environment.

    Environments are folders in $OPTIK_PEERS, by default optik/peers in the user's data folder. To remove one, delete it.
    """

    name: str = argument("NAME", "Name of a peer, from `optik doctor`.")
    install: bool = option("Options", "Create its environment and install its package there.", False, "--install")

    def run(self) -> None:
        """Install the peer if requested, and print its state."""
        kind: Any = load_method(PEERS, self.name, "peer")
        if self.install:
            if not hasattr(kind, "environment"):
                advice = f"this one shares the environment of optik: pip install {kind.distribution}"
                raise InvalidInput("--install", self.name, "a peer with a separate environment", advice=advice)
            _install(kind)
        state = kind.missing() or f"{kind.distribution} {kind.version()}"
        out_console.print(f"{self.name}: {state}", soft_wrap=True)
        out_console.print(kind.settings, soft_wrap=True)


def _install(kind: Any) -> None:
    """Create the environment of a peer, and remove it if this fails."""
    folder, python = kind.folder(), kind.python()
    outside = {k: v for k, v in os.environ.items() if k not in ("PIP_CONSTRAINT", "PYTHONPATH", "PYTHONHOME")}
    try:
        with err_console.status(f"installing {', '.join(kind.requirements)}"):
            venv.create(folder, with_pip=True, clear=True)
            pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *kind.requirements]
            subprocess.run(pip, check=True, capture_output=True, text=True, env=outside | {"PYTHONSAFEPATH": "1"})
    except subprocess.CalledProcessError as error:
        shutil.rmtree(folder, ignore_errors=True)
        said = (str(error.stderr).strip().splitlines() or ["pip failed"])[-1]
        raise OutputError(folder, said[:LAST_WORDS]) from None
    except OSError as error:
        shutil.rmtree(folder, ignore_errors=True)
        raise OutputError(folder, error.strerror or str(error)) from None
