"""Whether pip finds wheels for all that the core needs, on each platform and Python; nothing is installed."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

from packaging.requirements import Requirement

from tests.figures.figure import Row, Value, main

PLATFORMS = {
    "Linux x86_64": ("linux", "x86_64", [f"manylinux_2_{n}_x86_64" for n in (5, 12, 17, 24, 27, 28)]),
    "Linux aarch64": ("linux", "aarch64", [f"manylinux_2_{n}_aarch64" for n in (17, 24, 27, 28)]),
    "macOS arm64": ("darwin", "arm64", [f"macosx_{n}_0_arm64" for n in (11, 12, 13, 14)]),
    "Windows": ("win32", "AMD64", ["win_amd64"]),
}
"""`sys_platform`, `platform_machine` and the wheels' platforms; pip evaluates markers for this machine, so they are ours."""
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
CASES = tuple((platform, python) for platform in PLATFORMS for python in PYTHONS)


def measure(case: int) -> Row:
    """The requirements of one platform and Python for which pip finds no wheels, their own requirements included."""
    platform, python = CASES[case]
    system, machine, wheels = PLATFORMS[platform]
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    place = {"sys_platform": system, "platform_machine": machine, "python_version": python}
    wanted = [r for r in map(Requirement, project["dependencies"]) if r.marker is None or r.marker.evaluate(place)]
    lost = []
    with tempfile.TemporaryDirectory() as target:
        options = ["--dry-run", "--only-binary=:all:", "--python-version", python, "--target", target]
        options += [f"--platform={each}" for each in wheels]
        for requirement in wanted:
            asked = f"{requirement.name}{requirement.specifier}"
            command = [sys.executable, "-m", "pip", "install", "--quiet", *options, asked]
            if subprocess.run(command, capture_output=True, check=False).returncode:
                lost.append(asked)
    return {"name": f"{platform}, {python}", "wanted": len(wanted), "lost": lost}


def judge(rows: list[Row]) -> list[Value]:
    """The figures."""
    return [
        Value(
            row["name"],
            f"{row['wanted']} resolved",
            f"without wheels: {', '.join(row['lost']) or 'none'}",
            not row["lost"],
        )
        for row in rows
    ]


if __name__ == "__main__":
    main("platforms", measure, len(CASES), judge, part=1.0)
