"""`optik bench list`, `new` and `check`: the suites, a template of a suite, and the keys of a suite explained."""

from __future__ import annotations

import json
import os
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.padding import Padding
from rich.table import Column, Table

from benchmarks.cli.command import JsonCommand, RobotCommand, argument, option, out_console, print_json
from benchmarks.cli.readers import load_or_error, read_held
from optik.errors import InvalidInput, OutputError
from optik.file_io import check_suffix
from optik.plugins.files import CODE, is_path, record_plugins, split_links

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
[[calls]]
id = "ik"
robot = {robot}
set = "random_reachable"  # or: {sets}
options = {{ count = 200, starts = ["near", "random"] }}  # starts: near, far, random, zero
methods = [{{ solver = "lm" }}, {{ solver = "dls", options = {{ max_restarts = 20 }} }}]  # or: {methods}
# peers = [{{ peer = "roboticstoolbox" }}]  # methods of other packages: {peers}
# rounds = 3  # timed rounds; the time of a problem is their median
# [[calls.targets]]  # an acceptance target, which the report checks
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

# Success against iterations: [[budgets]] with budgets = [5, 20, 100]. All keys: docs/suites.md
"""
"""Template of `optik bench new`."""


@dataclass(frozen=True, kw_only=True)
class ListCommand(JsonCommand):
    """List the suites of optik and of installed packages, with the error of each that cannot be read."""

    def run(self) -> None:
        """Print the suites."""
        from benchmarks.suite import SUITES, load_suite
        from optik.registry import names

        found = {name: load_or_error(load_suite, name) for name in names(SUITES)}
        if self.as_json:
            print_json([_suite_row(name, suite) for name, suite in found.items()])
            return
        table = Table("suite", "title", "blocks")
        for name, suite in found.items():
            if isinstance(suite, Exception):
                table.add_row(name, f"error: {suite}")
                continue
            blocks = (f"{kind.title}: {', '.join(b.id for b in suite.of(kind.name))}" for kind in suite.kinds)
            table.add_row(suite.name, suite.title, "\n".join(blocks))
        out_console.print(table)


def _suite_row(name: str, suite: Any) -> dict[str, Any]:
    """Return a suite, or its error, as plain data for ``optik bench list --json``."""
    if isinstance(suite, Exception):
        return {"name": name, "error": str(suite)}
    return {"name": name, "title": suite.title, "fingerprint": suite.fingerprint, "settings": suite.settings}


@dataclass(frozen=True, kw_only=True)
class NewCommand(RobotCommand):
    """Write a commented suite for one arm, as a template. An existing file is never overwritten."""

    file: Path = argument("FILE", "Suite to write, such as own.toml.")

    def run(self) -> None:
        """Write the suite."""
        file = self.file
        check_suffix(file, (".toml",), "FILE")
        arm = self.load()
        text = _suite_text(file, self._name_robot(), arm.name, arm.n)
        try:
            with file.open("x", encoding="utf-8") as opened:
                opened.write(text)
        except FileExistsError:
            raise OutputError(file, "exists; choose another name") from None
        except OSError as error:
            raise OutputError(file, f"cannot be written ({error.strerror})") from None
        if self.as_json:
            print_json({"suite": str(file), "robot": arm.name, "joints": arm.n})
            return
        typed = f"{shlex.quote(str(file))} --out {shlex.quote(str(file.with_suffix('')))}-run"
        words = f"{file} compares on {arm.name} ({arm.n} joints); run it: optik bench run {typed} --report"
        out_console.print(words, soft_wrap=True)

    def _name_robot(self) -> str:
        """Return the robot's name in the suite: a path relative to the suite's folder, with the links of a URDF."""
        path, links = split_links(self.robot)
        gravity = self.gravity and ",".join(self.gravity.replace(",", " ").split())
        if gravity and not path.lower().endswith((".urdf", ".xml", ".xacro")):
            raise InvalidInput(
                "--gravity", f"{gravity} for {path}, which is no URDF", "the gravity of the robot's file"
            )
        if not is_path(self.robot):
            return self.robot
        relative = Path(os.path.relpath(Path(path).resolve(), self.file.resolve().parent)).as_posix()
        fragment = dict(part.partition("=")[::2] for part in links.split("&") if part)
        typed = {
            "tip": self.tip,
            "base": self.base,
            "gravity": gravity,
            "hold": ",".join(f"{joint}:{value!r}" for joint, value in (read_held(self.values) or {}).items()),
            "without_shape": ",".join(self.without_shape or ()),
            "packages": self.package_dir and str(Path(self.package_dir).resolve()),
            "srdf": self.srdf and str(Path(self.srdf).resolve()),
        }
        fragment |= {key: value for key, value in typed.items() if value}
        options = "&".join(f"{key}={value}" for key, value in fragment.items())
        return (relative if relative.startswith("..") else f"./{relative}") + (f"#{options}" if options else "")


def _suite_text(file: Path, robot: str, name: str, joints: int) -> str:
    """Return the text of a suite."""
    from benchmarks.blocks.timing.settings import MOTION_KINDS
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


@dataclass(frozen=True, kw_only=True)
class CheckCommand(JsonCommand):
    """Check a suite and explain its keys: meaning, unit, default and value. Files of code are not run."""

    suite: str = argument("SUITE", "A name from `optik bench list`, or a TOML file.")
    every: bool = option("Output", "Also show possible keys with their defaults.", False, "--all")

    def run(self) -> None:
        """Print the keys."""
        from benchmarks.cli.explain import explain
        from benchmarks.suite import SUITES, load_suite
        from optik.registry import data_file

        suite = load_suite(self.suite)
        rows = record_plugins(suite.plugins)
        code = any(str(row.get("path", "")).endswith(CODE) for row in rows)
        keys = explain(suite, data_file(SUITES, self.suite, "suite").parent)
        for kind, block in () if code else suite.pairs():
            kind.prepare(block, suite.seed)  # what only trying shows
        shown = [key for key in keys if key.given or self.every]
        if self.as_json:
            about = {"suite": suite.name, "fingerprint": suite.fingerprint, "plugins": rows}
            print_json(about | {"keys": [key._asdict() for key in shown]})
            return
        _print_keys(shown)
        words = f"{suite.name}: no errors"
        if code:
            words += "; its Python files were not run"
        out_console.print(words, soft_wrap=True)
        for row in rows:
            file = (
                f"{row['path']}, SHA-256 {row['sha256']}"
                if "path" in row
                else f"{row['distribution']} {row['version']}"
            )
            out_console.print(f"{row['group']} {row['name']}: {file}", soft_wrap=True)


def _print_keys(keys: Sequence[Explained]) -> None:
    """Print the keys as a table, or as a list if the table is too narrow for the longest key."""
    longest = max((len(key.key) for key in keys), default=0)
    if out_console.width >= longest + BESIDE_KEYS:
        table = Table(Column("key", no_wrap=True), "value", "default", "unit", "meaning")
        for key in keys:
            table.add_row(key.key, _format_value(key), key.default, key.unit, key.meaning)
        out_console.print(table)
        return
    for key in keys:
        out_console.print(f"{key.key} = {_format_value(key)}{f' {key.unit}' if key.unit else ''}", soft_wrap=True)
        default = f" Default: {key.default}." if key.default and key.default != "required" else ""
        about = f"{'Required. ' if key.default == 'required' else ''}{key.meaning}{default}".strip()
        if about:
            out_console.print(Padding(about, (0, 0, 0, 4)))


def _format_value(key: Explained) -> str:
    """Return the value of a key as in the file; “…” for a table, whose keys follow."""
    if not key.given:
        return "–"
    value = key.value
    if isinstance(value, dict) or (isinstance(value, list) and any(isinstance(item, dict) for item in value)):
        return "…"
    text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= ALL_SHOWN else f"{text[:ALL_SHOWN]}…"
