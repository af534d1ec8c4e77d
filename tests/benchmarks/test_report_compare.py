"""Two runs compared: what is the same, better and worse, against tests computed by hand, and the exit status."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from benchmarks.blocks.base import Field, load_kind
from benchmarks.blocks.block import hash_problems
from benchmarks.cli.app import app
from benchmarks.records import RunFolder, update_manifest
from benchmarks.report.base import Run
from benchmarks.report.compare import Difference, compare_runs, is_settled
from benchmarks.run.against import process_folders
from optik.errors import InvalidInput
from tests.oracles import REPOSITORY

Change = Callable[[pl.DataFrame], pl.DataFrame]

TIME = Field(pl.Float64, None, "time", "µs", "less", 1e6, clock="wall")


def other(run: RunFolder, folder: Path, pattern: str, change: Change) -> RunFolder:
    """A copy of a run with some of its rows changed."""
    shutil.copytree(run.path, folder)
    found = RunFolder(folder)
    files = [f"rows/budgets/{file.name}" for file in (folder / "rows/budgets").glob(pattern)]
    assert files
    for file in files:
        rows = found.read(file)
        found.write(file, change(rows))
    return found


def failing(count: int) -> Change:
    """The first problems, with another ending."""
    status = pl.when(pl.col("problem") < count).then(pl.lit("stalled")).otherwise("status").alias("status")
    return lambda rows: rows.with_columns(status)


def slower(factor: float) -> Change:
    return lambda rows: rows.with_columns(pl.col("position_error") * factor)


def of(found: tuple[Difference, ...], block: str, label: str, measure: str) -> Difference:
    return next(d for d in found if (d.block, d.label, d.measure) == (block, label, measure))


def compare(*arguments: Any) -> tuple[int, dict[str, Any]]:
    done = CliRunner().invoke(app, ["bench", "compare", *map(str, arguments), "--json"])
    return done.exit_code, json.loads(done.stdout) if done.exit_code < 2 else {}


def test_a_run_is_like_itself(small_run: RunFolder) -> None:
    code, found = compare(small_run.path, small_run.path)
    assert code == 0
    assert {d["verdict"] for d in found["differences"]} == {"within noise"}
    assert {(d["change"], d["loss"]) for d in found["differences"]} == {(0.0, 0.0)}
    assert found["worse_past_threshold"] == 0


def test_what_got_worse_ends_with_status_1_and_what_got_better_does_not(small_run: RunFolder, tmp_path: Path) -> None:
    worse = other(small_run, tmp_path / "worse", "misprint--01*", failing(20))
    rows = [small_run.rows("budgets", "misprint"), worse.rows("budgets", "misprint")]
    solved = []
    for part in rows:
        last = part.filter((pl.col("method") == "corrected") & (pl.col("budget") == 100)).sort("problem")
        solved.append((last["status"] == "solved").to_list())
    lost = sum(a and not b for a, b in zip(*solved, strict=True))
    assert lost > 10
    code, found = compare(small_run.path, worse.path)
    assert code == 1
    d = next(d for d in found["differences"] if d["label"] == "corrected" and d["unit"] == "%")
    assert d["verdict"] == "worse"
    assert d["loss"] == pytest.approx(100.0 * lost / 40)
    # McNemar's exact test by hand: all that changed changed the same way; Holm multiplies by the number of tests.
    tests = sum(x["p"] is not None for x in found["differences"])
    assert d["p"] == pytest.approx(min(1.0, tests * 2.0 * 0.5**lost))
    code, found = compare(worse.path, small_run.path)
    assert code == 0
    assert [d["verdict"] for d in found["differences"] if d["label"] == "corrected" and d["unit"] == "%"] == ["better"]
    assert compare(small_run.path, worse.path, "--threshold", "90")[0] == 0


def test_one_problem_more_or_less_is_noise(small_run: RunFolder, tmp_path: Path) -> None:
    nearly = other(small_run, tmp_path / "nearly", "misprint--01*", failing(2))
    assert compare(small_run.path, nearly.path)[0] == 0


@pytest.mark.parametrize(
    ("factor", "noise", "verdict"), [(2.0, 0.1, "worse"), (0.5, 0.1, "better"), (1.05, 0.1, "within noise")]
)
def test_a_time_must_differ_by_more_than_its_rounds(
    small_run: RunFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, factor: float, noise: float, verdict: str
) -> None:
    kind = type(load_kind("budgets"))
    monkeypatch.setattr(kind, "compared", {"position_error": replace(TIME, clock="", rounds=("least", "most"))})
    own = kind.compared_rows

    def with_rounds(self: Any, block: Any, rows: pl.DataFrame) -> pl.DataFrame:
        spread = [
            (pl.col("position_error") * (1.0 + sign * noise)).alias(name) for sign, name in ((-1, "least"), (1, "most"))
        ]
        return own(self, block, rows).with_columns(spread)

    monkeypatch.setattr(kind, "compared_rows", with_rounds)
    changed = other(small_run, tmp_path / "changed", "misprint--01*", slower(factor))
    found = compare_runs(Run(small_run), Run(changed)).differences
    d = of(found, "misprint", "corrected", "time")
    assert d.verdict == verdict
    assert d.change == pytest.approx(100.0 * (factor - 1.0))
    assert d.noise == pytest.approx(200.0 * noise)
    assert d.p < 0.05  # Wilcoxon's test alone would call even 5 % a difference
    assert of(found, "misprint", "as printed", "time").verdict == "within noise"


def test_a_motion_that_is_longer_is_worse_without_a_test(small_run: RunFolder, copied: RunFolder) -> None:
    file = "rows/timing/line--0000.parquet"
    rows = copied.read(file)
    first = pl.int_range(pl.len()) == 0
    copied.write(file, rows.with_columns(duration=pl.col("duration") * pl.when(first).then(1.001).otherwise(1.0)))
    found = compare_runs(Run(small_run), Run(copied))
    changed = [d for d in found.differences if d.verdict != "within noise"]
    assert [(d.label, d.measure) for d in changed] == [(rows["method"][0], "duration")]
    assert changed[0].loss == pytest.approx(0.1)
    assert not any("does not say what to compare" in words for words in found.left_out)
    assert of(found.differences, changed[0].block, "all laws", "time of a whole plan").pairs == len(rows)


@pytest.mark.parametrize("what", ["settings", "targets", "no hash"])
def test_other_problems_are_not_compared(small_run: RunFolder, tmp_path: Path, what: str) -> None:
    changed = other(small_run, tmp_path / "other", "misprint--01*", failing(40))
    about, manifest = changed.read_json("problems/misprint.json"), changed.manifest()
    if what == "targets":
        changed.write_json("problems/misprint.json", about | {"sha256": "another"})
    else:
        manifest["problems"]["budgets/misprint"] = "another"
        if what == "no hash":
            del manifest["problems"]
        changed.write_json("run.json", manifest)
    words = "no hash of its problems" if what == "no hash" else "the problems differ"
    if what == "no hash":
        with pytest.raises(InvalidInput, match=words):
            compare_runs(Run(small_run), Run(changed))
        return
    found = compare_runs(Run(small_run), Run(changed))
    assert [text for text in found.left_out if words in text] == [f"misprint: {words}"]
    assert {d.block for d in found.differences} == {"workspace", "line"}


LINE: dict[str, Any] = {
    "robot": "paper6r",
    "kind": "line",
    "start_deg": [20, -35, 40, 25, 50, -30],
    "move_m": [0, 0, 0.1],
}
PLAN: dict[str, Any] = {"id": "line", "detail": True, "lines": [LINE], "laws": [{"law": "smooth"}],
                        "limits": [{"velocity": 2.0, "jerk": 100.0}]}  # fmt: skip
IK: dict[str, Any] = {"id": "a", "robot": "paper6r", "set": "near_start", "options": {"count": 5}, "budgets": [5],
                      "methods": [{"solver": "dls"}]}  # fmt: skip
TIMED: dict[str, Any] = {"id": "a", "lines": [{"robot": "paper6r", "kind": "regular", "count": 3}],
                         "limits": [{"velocity": 2.0, "jerk": 100.0}], "laws": [{"law": "smooth"}]}  # fmt: skip
CONTACT: dict[str, Any] = {"id": "a", "robot": "panda", "scene": "table", "count": 5}
OTHER: list[tuple[str, dict[str, Any], dict[str, Any]]] = [
    ("timing", PLAN, {"scene": "plates"}), ("timing", PLAN, {"lines": [LINE | {"payload": 1.0}]}),
    ("timing", PLAN, {"lines": [LINE | {"move_m": [0, 0, 0.2]}]}), ("timing", PLAN, {"lines": [LINE | {"robot": "ur5e"}]}),
    ("budgets", IK, {"options": {"count": 6}}), ("budgets", IK, {"set": "hard"}), ("budgets", IK, {"robot": "puma560"}),
    ("timing", TIMED, {"limits": [{"velocity": 2.0, "jerk": 50.0}]}),
    ("timing", TIMED, {"lines": [{"robot": "paper6r", "kind": "regular", "count": 4}]}),
    ("clearance", CONTACT, {"scene": "plates"}), ("clearance", CONTACT, {"margin": 0.01}), ("clearance", CONTACT, {"count": 6}),
]  # fmt: skip
EQUAL: list[tuple[str, dict[str, Any], dict[str, Any]]] = [
    ("timing", PLAN, {"laws": [{"law": "quintic"}], "solvers": ["dls"]}), ("budgets", IK, {"budgets": [5, 10]}),
    ("budgets", IK, {"methods": [{"solver": "lm"}], "title": "x"}), ("timing", TIMED, {"rounds": 2}),
]  # fmt: skip


def test_the_hash_of_the_problems_is_that_of_what_makes_them() -> None:
    def hashed(kind: str, settings: dict[str, Any], seed: int = 1) -> str:
        return hash_problems(load_kind(kind).settings(settings), seed)

    for kind, settings, change in OTHER:
        assert hashed(kind, settings) != hashed(kind, settings | change), (kind, change)
    for kind, settings, change in EQUAL:
        assert hashed(kind, settings) == hashed(kind, settings | change), (kind, change)
    assert hashed("budgets", IK) != hashed("budgets", IK, seed=2)


def test_the_content_of_a_robot_s_file_counts_and_not_its_name(tmp_path: Path) -> None:
    found = []
    for name, limit in (("one", "2.0"), ("two", "2.0"), ("three", "2.5")):
        text = (REPOSITORY / "examples" / "plugins" / "arm.toml").read_text(encoding="utf-8")
        (tmp_path / name).mkdir()
        file = tmp_path / name / "arm.toml"
        file.write_text(text + f"\n# {limit}\n", encoding="utf-8")
        found.append(hash_problems(load_kind("budgets").settings(IK | {"robot": str(file)}), 1))
    assert found[0] == found[1] != found[2]


@pytest.mark.parametrize(
    ("factor", "machine", "verdict"),
    [
        (1.4, 1.4, "the machine"),
        (1.2, 1.0, "worse"),
        (1.2, 1.04, "worse"),
        (1.2, 1.06, "the machine"),
        (0.84, 0.7, "the machine"),
        (1.0, 1.4, "within noise"),
        (0.5, 0.97, "better"),
        (0.5, None, "the machine"),
        (1.04, 1.04, "within noise"),
    ],
)
def test_a_time_is_judged_only_where_the_reference_took_the_same_time(
    copied: RunFolder,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    factor: float,
    machine: float | None,
    verdict: str,
) -> None:
    kind = type(load_kind("budgets"))
    monkeypatch.setattr(kind, "compared", {"position_error": TIME})
    noise = 0.03 * np.random.default_rng(3).uniform(-1.0, 1.0, 10_000)

    def noisy(rows: pl.DataFrame) -> pl.DataFrame:
        return rows.with_columns(position_error=pl.col("position_error") * factor * (1.0 + noise[: rows.height]))

    changed = other(copied, tmp_path / "changed", "misprint--01*", noisy)
    for run, by in ((copied, 1.0), (changed, machine)):
        times = [dict.fromkeys(("short", "short_cpu", "middle", "middle_cpu", "long", "long_cpu"), by)] * 3
        if by is not None:
            run.write_json("run.json", run.manifest() | {"reference": {"rows/budgets/misprint.parquet": times}})
    found = compare_runs(Run(copied), Run(changed))
    d = of(found.differences, "misprint", "corrected", "time")
    assert d.verdict == verdict
    assert bool([one for one in found.worse_than(5.0) if one.label == "corrected"]) == (verdict == "worse")


def with_processes(run: RunFolder, token: str, factors: list[float]) -> None:
    """Add processes to a run, whose times are those of its rows by some factors."""
    update_manifest(run, alternated=token)
    kind, block = next((kind, block) for kind, block in Run(run).suite.pairs() if block.id == "misprint")
    tables = [f"rows/budgets/{file.name}" for file in (run.path / "rows/budgets").glob("misprint--*")]
    for at, factor in zip(process_folders(run, kind, block), factors, strict=False):
        at.mkdir(parents=True)
        RunFolder(at).write("problems/misprint.parquet", pl.read_parquet(run.path / "problems/misprint.parquet"))
        for name in tables:
            rows = pl.read_parquet(run.path / name)
            RunFolder(at).write(name, rows.with_columns(position_error=pl.col("position_error") * factor))


SPREAD = [1.0, 1.01, 0.99, 1.005, 0.995, 1.0, 1.3]
"""Factors of the times of the second interpreter: one process was disturbed."""


@pytest.mark.parametrize(
    ("by", "verdict"),
    [(1.0, "within noise"), (1.03, "within noise"), (1.08, "worse"), (0.9, "within noise"), (0.7, "better")],
)
def test_alternate_processes_are_judged_by_the_interval_of_the_median_ratio(
    copied: RunFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, by: float, verdict: str
) -> None:
    kind = type(load_kind("budgets"))
    monkeypatch.setattr(kind, "compared", {"position_error": TIME})
    second = RunFolder(Path(shutil.copytree(copied.path, tmp_path / "second")))
    with_processes(copied, "one", [1.0, 1.2, 1.0, 2.0, 1.0, 1.0, 1.0])
    with_processes(
        second, "one", [by * x * y for x, y in zip(SPREAD, [1.0, 1.2, 1.0, 2.0, 1.0, 1.0, 1.0], strict=True)]
    )
    d = of(compare_runs(Run(copied), Run(second)).differences, "misprint", "corrected", "time")
    assert (d.verdict, d.pairs) == (verdict, 7)
    # of seven sorted values, the median's 95 % interval is from the first to the last: 1 - 2/2^7 = 0.984
    assert (d.low, d.change, d.high) == pytest.approx(tuple(100.0 * (by * x - 1.0) for x in (0.99, 1.0, 1.3)))
    update_manifest(second, alternated="another")
    assert of(compare_runs(Run(copied), Run(second)).differences, "misprint", "corrected", "time").pairs != 7


def test_a_block_is_settled_when_its_interval_is_narrow(
    copied: RunFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kind = load_kind("budgets")
    monkeypatch.setattr(type(kind), "compared", {"position_error": TIME})
    block = next(block for _, block in Run(copied).suite.pairs() if block.id == "misprint")
    second = RunFolder(Path(shutil.copytree(copied.path, tmp_path / "second")))
    for name, factors, settled in (("few", SPREAD[:5], False), ("wide", SPREAD, False), ("narrow", SPREAD[:6], True)):
        for run, some in ((copied, [1.0] * len(factors)), (second, factors)):
            shutil.rmtree(run.path / "processes", ignore_errors=True)
            with_processes(run, name, some)
        assert is_settled(kind, block, copied, second) == settled


def test_runs_with_nothing_in_common_are_refused(small_run: RunFolder, copied: RunFolder, tmp_path: Path) -> None:
    manifest = copied.manifest()
    del manifest["settings"]["timing"]
    manifest["settings"]["budgets"] = [b | {"id": f"other-{b['id']}"} for b in manifest["settings"]["budgets"]]
    copied.write_json("run.json", manifest)
    with pytest.raises(InvalidInput, match="workspace: only in the first run"):
        compare_runs(Run(small_run), Run(copied))
    with pytest.raises(InvalidInput, match="optik bench run"):
        compare_runs(Run(small_run), Run(RunFolder(tmp_path)))


def test_settings_that_differ_are_shown(small_run: RunFolder, copied: RunFolder, typed: Any) -> None:
    assert compare(small_run.path, small_run.path)[1]["settings"] == []
    manifest = copied.manifest()
    block = manifest["settings"]["budgets"][1]
    block["methods"][1]["options"] = {"damping": 0.02}
    block["title"] = "other"
    manifest["settings"]["seed"] = 8
    del manifest["settings"]["timing"][0]["samples"]
    copied.write_json("run.json", manifest)
    _, found = compare(small_run.path, copied.path)
    assert {(one["key"], one["a"], one["b"]) for one in found["settings"]} == {
        ("budgets[misprint].methods[corrected].options.damping", None, 0.02),
        ("budgets[misprint].title", None, "other"),
        ("seed", 7, 8),
        ("timing[line].samples", 31, None),
    }
    _, out, _ = typed("bench", "compare", str(small_run.path), str(copied.path))
    assert out.startswith("setting ")
    assert "setting seed: 7 in A, 8 in B" in out
    assert "setting timing[line].samples: 31 in A, not set in B" in out
