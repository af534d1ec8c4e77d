"""`optik bench new` and `optik bench check`: write a template of a suite, and explain every key of a suite."""

from __future__ import annotations

import json
import os
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.padding import Padding
from rich.table import Column, Table

from benchmarks.cli.shared import AsJson, Base, RobotName, Tip, command, load_arm, out_console, print_json
from optik.errors import InvalidInput, OutputError
from optik.plugins.files import is_path
from optik.plugins.usage import record_plugins

if TYPE_CHECKING:
    from benchmarks.cli.explain import Explained

ALL_SHOWN = 60
"""Largest number of characters of a value in the table; `--json` has all."""

BESIDE_KEYS = 70
"""Terminal columns that the value, default, unit and meaning of a key need beside it in a table."""

NEW_SUITE = """\
# A comparison on {name}. For the meaning of each key: optik bench check {file}
# To run it and write its report: optik bench run {file} --out {run} --report
title = {title}
seed = 1

# Inverse kinematics, single calls: success rates, errors and times.
[[speed]]
id = "ik"
robot = {robot}
set = "random_reachable"  # or: {sets}
options = {{ count = 200, starts = ["near", "random"] }}  # starts: near, far, random, zero
methods = [{{ solver = "lm" }}, {{ solver = "dls", options = {{ max_restarts = 20 }} }}]  # or: {methods}
# peers = [{{ peer = "roboticstoolbox" }}]  # methods of other packages: {peers}
# rounds = 3  # timed rounds; the time of a problem is their median
# [[speed.targets]]  # an acceptance target, which the report checks
# method = "lm"
# measure = "success"
# at_least = 99

# Your own poses: set = "file", options = {{ path = "poses.csv" }}, columns x_m,y_m,z_m,qw,qx,qy,qz

# Time laws on the same motions: durations, limit violations, computing times.
[[timing]]
id = "laws"
lines = [{{ robot = {robot}, kind = "{kind}", count = 3 }}]  # kinds: {kinds}
limits = [{{ velocity = 2.0, acceleration = 10.0, jerk = 100.0 }}]  # of every joint [rad/s, rad/s², rad/s³; m]
laws = [{{ law = "optimal" }}, {{ law = "smooth" }}]  # or: {laws}
# Your own seam: lines = [{{ robot = {robot}, kind = "file", path = "seam.csv" }}]

# Success against iterations: [[blocks]] with budgets = [5, 20, 100]. All keys: docs/suites.md
"""
"""Template of `optik bench new`."""


def add_suites(group: typer.Typer) -> None:
    """Add the commands of this module to a group."""
    command(group, "new")(bench_new)
    command(group, "check")(bench_check)


def bench_new(
    file: Annotated[Path, typer.Argument(help="Suite to write, such as own.toml.")],
    robot: RobotName = "paper6r",
    tip: Tip = None,
    base: Base = None,
    as_json: AsJson = False,
) -> None:
    """Write a commented suite for one arm, as a template. An existing file is never overwritten."""
    if file.suffix.lower() != ".toml":
        raise InvalidInput("file", str(file), "a name that ends in .toml")
    arm = load_arm(robot, tip, base)
    text = _suite_text(file, _named(file, robot, tip, base), arm.name, arm.n)
    try:
        with file.open("x", encoding="utf-8") as opened:
            opened.write(text)
    except FileExistsError:
        raise OutputError(file, "exists; choose another name") from None
    except OSError as error:
        raise OutputError(file, f"cannot be written ({error.strerror})") from None
    if as_json:
        print_json({"suite": str(file), "robot": arm.name, "joints": arm.n})
        return
    shown = shlex.quote(str(file))
    out_console.print(
        f"{file} compares on {arm.name} ({arm.n} joints); run it: "
        f"optik bench run {shown} --out {shlex.quote(str(file.with_suffix('')))}-run --report",
        highlight=False, markup=False, soft_wrap=True,
    )  # fmt: skip


def _named(file: Path, robot: str, tip: str | None, base: str | None) -> str:
    """Return the robot's name in a suite: a path relative to the suite's folder, with the links of a URDF."""
    if not is_path(robot):
        return robot
    path, _, links = robot.partition("#")
    relative = Path(os.path.relpath(Path(path).resolve(), file.resolve().parent)).as_posix()
    links = links or "&".join(f"{key}={link}" for key, link in (("tip", tip), ("base", base)) if link)
    return (relative if relative.startswith("..") else f"./{relative}") + (f"#{links}" if links else "")


def _suite_text(file: Path, robot: str, name: str, joints: int) -> str:
    """Return the text of a suite."""
    from benchmarks.blocks.timing.laws.motions import MOTION_KINDS
    from optik.registry import own_names

    def others(group: str, *taken: str) -> str:
        return ", ".join(sorted(own_names(group) - set(taken)))

    return NEW_SUITE.format(
        name=name,
        file=shlex.quote(file.name),
        run=shlex.quote(f"{file.stem}-run"),
        title=json.dumps(f"Inverse kinematics and time laws on {name}", ensure_ascii=False),
        robot=json.dumps(robot, ensure_ascii=False),
        kind="regular" if joints >= 6 else "joints",
        kinds=", ".join(MOTION_KINDS),
        sets=others("benchmarks.problems", "random_reachable"),
        methods=others("optik.ik", "lm", "dls"),
        peers=others("benchmarks.peers.ik"),
        laws=others("planners.timing", "optimal", "smooth"),
    )


def bench_check(
    suite: Annotated[str, typer.Argument(help="A name from `optik bench list`, or a TOML file.")],
    every: Annotated[bool, typer.Option("--all", help="Also show possible keys with their defaults.")] = False,
    as_json: AsJson = False,
) -> None:
    """Check a suite and explain its keys: meaning, unit, default and value. Files of code are not run."""
    from benchmarks.cli.explain import explain
    from benchmarks.suite import SUITES, load_suite
    from optik.registry import data_file

    asked = load_suite(suite)
    rows = record_plugins(asked.plugins)
    keys = explain(asked, data_file(SUITES, suite, "suite").parent)
    shown = [key for key in keys if key.given or every]
    if as_json:
        about = {"suite": asked.name, "fingerprint": asked.fingerprint, "plugins": rows}
        print_json(about | {"keys": [key._asdict() for key in shown]})
        return
    _print_keys(shown)
    words = f"{asked.name}: no errors"
    if any(str(row.get("path", "")).endswith(".py") for row in rows):
        words += "; its Python files were not run"
    out_console.print(words, highlight=False, markup=False, soft_wrap=True)
    for row in rows:
        what = f"{row['path']}, SHA-256 {row['sha256']}" if "path" in row else f"{row['distribution']} {row['version']}"
        out_console.print(f"{row['group']} {row['name']}: {what}", highlight=False, markup=False, soft_wrap=True)


def _print_keys(keys: Sequence[Explained]) -> None:
    """Print the keys as a table, or as a list if the table is too narrow for the longest key."""
    longest = max((len(key.key) for key in keys), default=0)
    if out_console.width >= longest + BESIDE_KEYS:
        table = Table(Column("key", no_wrap=True), "value", "default", "unit", "meaning")
        for key in keys:
            table.add_row(*(_cell(part) for part in (key.key, _value(key), key.default, key.unit, key.meaning)))
        out_console.print(table)
        return
    for key in keys:
        words = f"{key.key} = {_value(key)}{f' {key.unit}' if key.unit else ''}"
        out_console.print(_cell(words), soft_wrap=True)
        default = f" Default: {key.default}." if key.default and key.default != "required" else ""
        about = f"{'Required. ' if key.default == 'required' else ''}{key.meaning}{default}".strip()
        if about:
            out_console.print(Padding(_cell(about), (0, 0, 0, 4)), highlight=False)


def _value(key: Any) -> str:
    """Return the value of a key as in the file; “…” for a table, whose keys follow."""
    if not key.given:
        return "–"
    value = key.value
    if isinstance(value, dict) or (isinstance(value, list) and any(isinstance(item, dict) for item in value)):
        return "…"
    text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= ALL_SHOWN else f"{text[:ALL_SHOWN]}…"


def _cell(text: str) -> Any:
    """Return text without markup, because names in a suite may have brackets."""
    from rich.text import Text

    return Text(text)
