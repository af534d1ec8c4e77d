"""Compile common calls for every supported processor, and pack the kernels: ``python -m benchmarks.kernels.build``."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from numba.core.caching import _CacheLocator
from numba.core.registry import cpu_target

from benchmarks.kernels.parts import SHIPPED, Progress, run_parts
from benchmarks.provenance import ROOT
from optik.compiled import archive
from optik.compiled.cache import VERSIONS, read_code

BASELINE = {"x86_64": "x86-64-v3", "amd64": "x86-64-v3", "arm64": "apple-m1"}
"""Processors to compile for, by machine and with LLVM's names; otherwise the baseline of the architecture."""


def main() -> None:
    """Write the archive of this platform and Python into the package."""
    cpu = BASELINE.get(platform.machine().lower(), "generic")
    jobs = os.cpu_count() or 1
    with TemporaryDirectory() as cache:
        target = {"NUMBA_CPU_NAME": cpu, "NUMBA_CPU_FEATURES": "", "NUMBA_CACHE_DIR": cache, "OPTIK_COMPILES": "native"}
        print(f"compiling the kernels of {', '.join(SHIPPED)} for {cpu}", file=sys.stderr)
        progress = Progress()
        failed = run_parts(list(SHIPPED), jobs, progress, **target)
        print(f"compiled {progress.end()}", file=sys.stderr)
        if failed:
            sys.exit("; ".join(f"{part}: {words}" for part, words in failed.items()))
        kernels = dict(_kernels(Path(cache)))
    triple, _, _ = cpu_target.target_context.codegen().magic_tuple()
    file = archive.ARCHIVES / archive.file_name()
    archive.pack_archive(file, VERSIONS, archive.CompileTarget(triple, cpu, ""), kernels)
    print(f"{len(kernels)} kernels in {file}, {file.stat().st_size / 1e6:.2f} MB")


def _kernels(cache: Path) -> Iterator[tuple[str, tuple[str, bytes]]]:
    """Yield fingerprint, name and code of each cached kernel of our packages, without plug-ins of the documentation."""
    files = (file for package in ("optik", "planners", "benchmarks") for file in (ROOT / package).rglob("*.py"))
    for folder in sorted({_CacheLocator.get_suitable_cache_subpath(str(file)) for file in files}):
        for file in sorted((cache / folder).glob("*.nbk")):
            for fingerprint, code in read_code(file).items():
                yield fingerprint, (file.name.rsplit("-", 1)[0], code)


if __name__ == "__main__":
    main()
