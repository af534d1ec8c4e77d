"""`optik kernels`: list the shipped kernels and those compiled on this machine, or compile in advance."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer
from numba.core.registry import cpu_target
from rich.table import Table

import optik
from benchmarks.cli.shared import AsJson, err_console, out_console, print_json
from optik.compiled import archive
from optik.compiled.cache import KernelCache, read_code
from optik.compiled.fingerprint import VERSIONS
from optik.compiled.kernel import Kernel
from optik.errors import InvalidInput, NoSolution, OutputError
from optik.kinematics import forward


def kernels(
    compile_: Annotated[
        bool,
        typer.Option("--compile", help="Compile the kernels of common calls that are neither shipped nor cached."),
    ] = False,
    native: Annotated[
        bool, typer.Option("--native", help="With --compile: also compile the shipped kernels for this processor.")
    ] = False,
    jobs: Annotated[int, typer.Option(min=1, help="With --compile: number of processes.")] = os.cpu_count() or 1,
    as_json: AsJson = False,
) -> None:
    """List compiled kernels (functions compiled by Numba): shipped ones, and those of this machine with the reason."""
    if native and not compile_:
        raise InvalidInput("--native", "--native alone", "--compile --native")
    if compile_:
        _compile(jobs, {"OPTIK_COMPILES": "native"} if native else {})
    words, rows = describe_shipped(), list(_list_cached())
    if as_json:
        print_json({"shipped": words, "kernels": _names(), "cached": [row._asdict() for row in rows]})
        return
    out_console.print(f"shipped: {words}", highlight=False, markup=False, soft_wrap=True)
    table = Table(
        "folder", "kernels", "reason", title=f"{len(rows)} kernel{'s' if len(rows) != 1 else ''} in the cache"
    )
    for (folder, why), count in Counter((row.folder, row.why) for row in rows).items():
        table.add_row(folder, str(count), why)
    if rows and not compile_:
        out_console.print(table)


def _compile(jobs: int, environment: dict[str, str]) -> None:
    """Compile common calls in several processes, one such run at a time."""
    from benchmarks.kernels.parts import WARM_UP
    from benchmarks.kernels.run import Progress, run_parts
    from benchmarks.run.lock import locked

    kernel: Any = forward
    folder = KernelCache(kernel).cache_path
    if folder is None:
        raise OutputError("the cache", "no folder is writable; set NUMBA_CACHE_DIR to a folder")
    progress = Progress()
    with locked(Path(folder), wait=True):
        failed = run_parts(list(WARM_UP), jobs, progress, **environment)
    err_console.print(f"compiled {progress.end()}", highlight=False)
    if failed:
        raise NoSolution("; ".join(f"{part}: {words}" for part, words in failed.items()))


def describe_shipped() -> str:
    """Describe the shipped kernels, and whether they are used here."""
    shipped = archive.open_archive()
    if isinstance(shipped, str):
        return f"none: {shipped}"
    refusal = shipped.refusal(VERSIONS, archive.Target(*cpu_target.target_context.codegen().magic_tuple()))
    size = shipped.file.stat().st_size / 1e6
    return f"{len(shipped.names)} kernels for {shipped.cpu}, {size:.1f} MB, {f'not used: {refusal}' if refusal else 'used'}"


class Row(NamedTuple):
    """A kernel in the machine's cache: its folder, its name and types, and why it was compiled."""

    folder: str
    kernel: str
    why: str


def _names() -> dict[str, str]:
    """Return the names of the shipped kernels by fingerprint."""
    shipped = archive.open_archive()
    return {} if isinstance(shipped, str) else dict(shipped.names)


def _list_cached() -> Iterator[Row]:
    """Yield every kernel in the cache, of any processor and any version of its source."""
    names, words = _names(), describe_shipped()
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
            yield Row(str(folder), kernel, why)


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
