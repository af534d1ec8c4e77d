"""A new user's suite: written, checked, run with its report, and every key and column of it on the page docs/suites.md."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

import optik
from benchmarks.blocks.base import GROUP, load_kind
from benchmarks.cli.app import app
from benchmarks.cli.explain import Explained, explain
from benchmarks.problems.base import SETS
from benchmarks.records import RunFolder
from benchmarks.suite import SUITES, load_suite
from docs import suite_keys
from optik.errors import InvalidInput, OutputError, UnknownName
from optik.plugins.files import defaults
from optik.registry import load_method, own_names
from tests.oracles import REPOSITORY

PAGE = (REPOSITORY / "docs/suites.md").read_text(encoding="utf-8")


def optik_bench(*arguments: str, columns: int = 200) -> str:
    done = CliRunner().invoke(app, ["bench", *arguments], env={"COLUMNS": str(columns)}, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a new user types, from a URDF to a report: one file and one command."""
    folder = tmp_path_factory.mktemp("own")
    shutil.copy(REPOSITORY / "examples/arm.urdf", folder / "arm.urdf")
    optik_bench("new", str(folder / "own.toml"), "--robot", str(folder / "arm.urdf"))
    optik_bench("run", str(folder / "own.toml"), "--out", str(folder / "run"), "--report")
    return folder


def test_a_new_suite_for_an_own_urdf_has_few_lines_and_its_run_a_report(own: Path) -> None:
    lines = (own / "own.toml").read_text().splitlines()
    assert len([line for line in lines if line.strip() and not line.startswith("#")]) <= 15
    assert 'robot = "./arm.urdf"' in "\n".join(lines)
    run = RunFolder(own / "run")
    assert run.manifest()["complete"]
    assert "arm" in (own / "run/report.html").read_text()
    rows = pl.read_parquet(own / "run/rows/calls/ik--*.parquet")
    assert rows.filter(pl.col("method") == "lm")["solved"].mean() == 1.0
    assert set(pl.read_parquet(own / "run/problems/ik.parquet")["group"]) == {
        "random, near start",
        "random, random start",
    }
    with pytest.raises(OutputError, match="exists"):
        optik_bench("new", str(own / "own.toml"))


def test_a_new_suite_is_checked_and_names_the_links_of_a_urdf(own: Path) -> None:
    folder = own / "suites"
    folder.mkdir()
    arm = optik.load(str(own / "arm.urdf"))
    optik_bench("new", str(folder / "b.toml"), "--robot", str(own / "arm.urdf"), "--tip", "tool", "--base", "base")
    assert 'robot = "../arm.urdf#tip=tool&base=base"' in (folder / "b.toml").read_text()
    words = optik_bench("check", str(folder / "b.toml"))
    assert "b: no errors" in words
    assert arm.name in words
    for name in ("panda", "irb910sc"):
        optik_bench("new", str(folder / f"{name}.toml"), "--robot", name)
        kinds = load_suite(str(folder / f"{name}.toml")).of("timing")[0].kinds
        assert kinds == (("regular",) if optik.load(name).n >= 6 else ("joints",))
    with pytest.raises(UnknownName, match="pandas"):
        optik_bench("new", str(folder / "c.toml"), "--robot", "pandas")
    with pytest.raises(InvalidInput, match="toml"):
        optik_bench("new", str(folder / "c.txt"))
    assert not (folder / "c.toml").exists()


@pytest.fixture(scope="module")
def keys() -> dict[str, list[Explained]]:
    """Every key of every suite of ours, explained."""
    return {name: explain(load_suite(name), Path()) for name in sorted(own_names(SUITES))}


def test_every_key_of_our_suites_is_explained_with_the_default_that_the_code_has(
    keys: dict[str, list[Explained]],
) -> None:
    assert [key.key for found in keys.values() for key in found if not key.meaning] == []
    found = {row["key"]: row for row in json.loads(optik_bench("check", "timing-quick", "--all", "--json"))["keys"]}
    assert found["timing.lines.lines"]["default"] == "required"
    assert (found["timing.lines.rounds"]["value"], found["timing.lines.rounds"]["default"]) == (1, "3")
    assert found["timing.lines.samples"] | {"meaning": ""} == {
        "key": "timing.lines.samples", "value": None, "default": "151", "unit": "", "meaning": "", "given": False,
    }  # fmt: skip
    assert found["timing.lines.reference.options.intervals"]["value"] == 400
    assert found["timing.lines.limits[0].jerk"]["unit"].startswith("rad/s³")
    paper = {row.key: row for row in keys["paper"]}
    assert paper["budgets.workspace.options.spacing_m"][1:4] == (0.05, "0.05", "m")
    assert paper["budgets.workspace.options.start_deg"].default == "required"
    assert paper["budgets.workspace.methods[0].options.damping"].value == 0.01
    assert paper["timing.line.lines[0].move_m"].unit == "m"


@pytest.mark.parametrize("columns", [80, 150])
def test_no_key_is_broken_however_narrow_the_terminal(columns: int) -> None:
    lines = optik_bench("check", "ik-speed-quick", columns=columns).splitlines()
    keys = [row.key for row in explain(load_suite("ik-speed-quick"), Path()) if row.given]
    found = [line.replace("│", " ").split() for line in lines]
    assert [words[0] for words in found if words and words[0] in keys] == keys


def suite_with(folder: Path, text: str) -> str:
    (folder / "s.toml").write_text(text)
    return str(folder / "s.toml")


BLOCK = 'id = "a"\nrobot = "paper6r"\nset = "at_limits"\nmethods = [{ solver = "lm" }]\n'


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[[budgets]]\n" + BLOCK.replace("methods", "metods"), r"expected 'methods', .*got the key 'metods'"),
        ("[[budgets]]\n" + BLOCK + "options = { coutn = 3 }\n", r"a\.options.*expected 'count', .*the option 'coutn'"),
        ("[[budgets]]\n" + BLOCK + "options = { joints = [9] }\n", "joints"),
        ("[[budgets]]\n" + BLOCK.replace('"lm"', '"lm", options = { gian = 1 }'), r"expected 'gain', .*'gian'"),
        ("[[budgets]]\n" + BLOCK + "options = { count = 0 }\n", r"^block 'a': options: count: expected .*; got 0$"),
        (
            '[[timing]]\nid = "b"\nlines = [{ robot = "paper6r", kind = "file", path = "one.csv" }]\n'
            'laws = [{ law = "smooth" }]\n'
            "limits = [{ velocity = 2.0, acceleration = 10.0, jerk = 100.0 }]\n",
            r"^block 'b': .*one\.csv: expected two waypoints or more; got one row$",
        ),
        (
            '[[freedom]]\nid = "f"\nlimits = [{ velocity = 2.0, acceleration = 10.0, jerk = 100.0 }]\n'
            'sets = [{ robot = "paper6r", kind = "regular", count = 1, freedom = "elbow" }]\n',
            r"^freedom 'f': sets\[0\]: freedom: .*more than six joints; got 'elbow' of paper6r with 6 joints$",
        ),
        ("[[budget]]\n" + BLOCK, "budgets"),
        ("[[budgets]]\n" + BLOCK + "[[budgets]]\n" + BLOCK.replace('"a"', '"A"'), "differ in more than case"),
        ("[[budgets]]\nid = = 1\n", r"at line 2, column 6"),
        ("[[budgets]]\n" + BLOCK.replace('"paper6r"', '"./s.urdf"'), r"s\.urdf"),
    ],
)
def test_a_mistake_is_one_line_that_names_it_and_what_was_meant(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "s.urdf").write_text("no robot")
    (tmp_path / "one.csv").write_text("x_m,y_m,z_m,qw,qx,qy,qz\n0.3,0,0.4,1,0,0,0\n")
    with pytest.raises((InvalidInput, UnknownName, optik.errors.RobotModelError), match=says) as caught:
        optik_bench("check", suite_with(tmp_path, text))
    assert "\n" not in str(caught.value)


def test_checking_does_not_run_what_a_suite_names(tmp_path: Path) -> None:
    (tmp_path / "set.py").write_text("raise RuntimeError('run')\n")
    text = "[[budgets]]\n" + BLOCK.replace('"at_limits"', '"./set.py"') + "options = { anything = 1 }\n"
    file = suite_with(tmp_path, text)
    assert "not run" in optik_bench("check", file)
    keys = {row["key"]: row for row in json.loads(optik_bench("check", file, "--json"))["keys"]}
    assert keys["budgets.a.options.anything"]["meaning"].startswith("Not explained")


# ---------------------------------------------------------------- the page


def test_the_suite_on_the_page_runs_on_own_poses_and_an_own_seam(own: Path) -> None:
    found = re.search(r"```toml\n(# station\.toml\n.*?)```", PAGE, re.DOTALL)
    assert found
    arm = optik.load(str(own / "arm.urdf"))
    q = arm.limits.clip(np.full((2, arm.n), 0.3) + np.array([[0.0], [0.05]]))
    rows = [[*T[:3, 3], *T[:3, :3].ravel()] for T in arm.fk(q)]
    header = ",".join(["x_m,y_m,z_m", *(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))])
    for name in ("poses.csv", "seam.csv"):
        np.savetxt(own / name, rows, delimiter=",", header=header, comments="", fmt="%.17g")
    suite = own / "station.toml"
    suite.write_text(found[1])
    optik_bench("run", str(suite), "--out", str(own / "station"))
    calls = pl.read_parquet(own / "station/rows/calls/*.parquet")
    assert calls.filter("solved")["method"].unique().sort().to_list() == ["closed_form", "lm"]
    motions = pl.read_parquet(own / "station/rows/timing/seam-4--*.parquet")
    assert motions.select("method", "kind", "status", "breaks").rows() == [
        ("optimal", "seam.csv", "solved", ""), ("smooth", "seam.csv", "solved", "")
    ]  # fmt: skip


def section(title: str) -> str:
    """The part of the page under a heading, or after a line, that begins so."""
    found = re.search(rf"^(?:#+ )?{re.escape(title)}.*?\n(.*?)(?=^#|^`BLOCK\.|\Z)", PAGE, re.MULTILINE | re.DOTALL)
    assert found, title
    return found[1]


def columns_in(title: str) -> set[str]:
    rows = [line.split("|")[1] for line in section(title).splitlines() if line.startswith("| `")]
    return {name for row in rows for name in re.findall(r"`(\w+)`", row)}


def test_the_page_has_the_columns_of_every_table_of_a_run(own: Path, small_run: RunFolder) -> None:
    found = {
        "`problems/": set(pl.read_parquet(small_run.path / "problems/workspace.parquet").columns),
        "`rows/budgets/": set(pl.read_parquet(small_run.path / "rows/budgets/misprint--*.parquet").columns),
        "`rows/calls/": set(pl.read_parquet(own / "run/rows/calls/ik--*.parquet").columns),
        "`rows/timing/": set(pl.read_parquet(own / "run/rows/timing/laws--*.parquet").columns),
    }
    for name in sorted(own_names(GROUP)):
        stored = {name for name, field in load_kind(name).fields.items() if field.stored}
        assert found.setdefault(f"`rows/{name}/", stored) == stored | ({"block"} & found[f"`rows/{name}/"])
    found |= {
        f"`BLOCK.{t}.parquet": set(pl.read_parquet(small_run.path / f"rows/timing/line.{t}.parquet").columns)
        for t in ("joints", "tool")
    }
    for title, columns in found.items():
        assert columns_in(title) == columns - ({"block", "method", "problem"} if "problems/" not in title else set()), (
            title
        )


def test_every_table_of_rows_begins_with_block_method_and_problem(own: Path, small_run: RunFolder) -> None:
    files = [file for run in (own / "run", small_run.path) for file in (run / "rows").glob("*/*--*.parquet")]
    assert {file.parent.name for file in files} == {"budgets", "calls", "timing"}
    for file in files:
        rows = pl.read_parquet(file)
        assert rows.columns[:3] == ["block", "method", "problem"], file
        assert rows["block"].unique().to_list() == [file.name.partition("--")[0]], file
        assert not rows["method"].has_nulls() and not rows["problem"].has_nulls(), file


def test_the_page_has_every_key_and_every_option_of_every_set(keys: dict[str, list[Explained]]) -> None:
    names = {row.key.split(".")[-1] for found in keys.values() for row in found if "options." not in row.key}
    assert [name for name in sorted(names) if not re.search(rf"[`{{ ]{name}[`, ]", PAGE)] == []
    for name in sorted(own_names(SETS)):
        row = next(line for line in section("Problem sets").splitlines() if line.startswith(f"| `{name}`"))
        assert set(re.findall(r"`(\w+)`", row.split("|")[3])) == set(defaults(load_method(SETS, name, "set")))


def test_the_tables_of_keys_are_those_of_the_models() -> None:
    assert set(re.findall(r"<!-- keys: ([\w ]+) -->", PAGE)) == set(suite_keys.TABLES)
    assert suite_keys.fill(PAGE) == PAGE, "make tables"
    empty = re.sub(r"(<!-- keys: budgets -->\n)(?:\|.*\n)*", r"\1", PAGE)
    assert empty != PAGE
    assert suite_keys.fill(empty) == PAGE, "marks without a table between them are filled, too"
