"""Provenance: the code, package versions and machine that produced a run."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import statistics
import subprocess
import sys
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
"""Folder of our packages, so that a fresh process imports the same code."""
PACKAGES = ("optik-toolkit", "numpy", "scipy", "numba", "casadi", "ruckig", "toppra", "polars", "plotly", "mujoco",
            "ompl", "vamp-planner")  # fmt: skip
"""This package, its dependencies, and the simulator if installed; versions of peers are stored with their results."""


def provenance(seed: int, workers: int) -> dict[str, Any]:
    """Return code, versions, machine and settings, which are needed to judge and repeat a run, as plain data."""
    commit, dirty = _commit()
    return {
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "commit": commit,
        "dirty": dirty,
        "python": platform.python_version(),
        "versions": {p: version_here(p) for p in PACKAGES},
        "system": f"{platform.system()} {platform.machine()}",
        "cpu": _cpu(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "workers": workers,
        "seed": seed,
        "byteorder": sys.byteorder,
    }


REFERENCE_LOOPS = {"short": (1_000, 101), "middle": (25_000, 15), "long": (300_000, 3)}
"""Steps of the reference computations, about 40 µs, 1 ms and 12 ms, and how often each is timed: load interrupts long work."""


def time_reference() -> dict[str, float | None]:
    """Return median times of fixed computations [s] by both clocks, and the load average: is the machine slow, or the code."""
    found: dict[str, float | None] = {"load": os.getloadavg()[0] if hasattr(os, "getloadavg") else None}
    for name, (loops, repeats) in REFERENCE_LOOPS.items():
        took: dict[str, list[float]] = {name: [], f"{name}_cpu": []}
        for _ in range(repeats):
            begin, begin_cpu = time.perf_counter(), time.process_time()
            sum(i * i for i in range(loops))
            took[f"{name}_cpu"].append(time.process_time() - begin_cpu)
            took[name].append(time.perf_counter() - begin)
        found |= {clock: statistics.median(seconds) for clock, seconds in took.items()}
    return found


def version_here(package: str) -> str | None:
    """Return the installed version of a distribution; None if it is not installed."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def _commit() -> tuple[str | None, bool | None]:
    """Return the commit of the checkout with this code and whether it has local changes; None if the package is installed."""
    here = Path(__file__).resolve().parent.parent
    if not (here / ".git").exists():
        return None, None
    try:
        commit = subprocess.run(["git", "rev-parse", "HEAD"], cwd=here, capture_output=True, text=True, timeout=10)
        status = subprocess.run(["git", "status", "--porcelain"], cwd=here, capture_output=True, text=True, timeout=10)
    except (OSError, subprocess.TimeoutExpired):
        return None, None
    if commit.returncode != 0:
        return None, None
    return commit.stdout.strip(), bool(status.stdout.strip())


def _cpu() -> str:
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or "unknown"
