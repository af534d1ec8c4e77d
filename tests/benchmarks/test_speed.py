"""Speed: calls are timed in rounds, judged by us, continued, and held against what was asked; a missing peer is a row."""

from __future__ import annotations

import copy
import shutil
import sys
import types
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

import optik
from benchmarks.blocks.base import load_kind
from benchmarks.blocks.block import Entry, Target, TargetOutcome, measure_named
from benchmarks.blocks.calls import MEASURES, CallRows, median_ratio
from benchmarks.blocks.contest import Contestant, ProcessFailed, fresh, timed, timed_part
from benchmarks.blocks.entries import judged, shared, wrapped
from benchmarks.peers.base import Absent
from benchmarks.peers.ik import PEERS
from benchmarks.peers.ik.base import Solutions, SolverPeer
from benchmarks.peers.models import urdf
from benchmarks.problems.base import ProblemSet
from benchmarks.problems.near_start import near_start
from benchmarks.records import RunFolder
from benchmarks.report.base import Run
from benchmarks.report.calls import winners
from benchmarks.report.calls.tables import success_and_time
from benchmarks.run import run_suite
from benchmarks.suite import suite_of
from optik.errors import InvalidInput
from optik.registry import load_method, names
from tests.outside import hide

QUICK: dict[str, Any] = {
    "title": "a quick look",
    "seed": 3,
    "calls": [
        {
            "id": "warm",
            "robot": "paper6r",
            "set": "near_start",
            "options": {"count": 24},
            "methods": [{"solver": "dls"}, {"label": "few", "solver": "dls", "options": {"step": 0.5}, "max_problems": 4}],
            "peers": [{"peer": "eaik"}, {"peer": "plain_casadi", "label": "plain", "max_problems": 4}],
            "targets": [
                {"measure": "success", "at_least": 10},
                {"method": "few", "measure": "median_ratio", "to": "plain", "at_most": 1e9},
                {"measure": "median_ratio", "to": "eaik", "at_most": 0.5, "goal": True},
            ],
        },
        {
            "id": "hard", "robot": "paper6r", "set": "hard", "options": {"count": 10}, "rounds": 1,
            "methods": [{"solver": "dls", "options": {"max_iterations": 1}}],
        },
    ],
    "batch": [
        {
            "id": "many", "robot": "paper6r", "set": "near_start", "options": {"count": 300}, "solver": "dls",
            "threads": [1], "repeats": 2, "targets": [{"measure": "million_per_second", "at_least": 1000}],
        }
    ],
}  # fmt: skip


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    with pytest.MonkeyPatch.context() as patch:
        hide(patch, "eaik")
        return run_suite(suite_of("quick", copy.deepcopy(QUICK)), tmp_path_factory.mktemp("speed") / "run")


def rows_of(folder: RunFolder, index: int = 0) -> pl.DataFrame:
    suite = suite_of("quick", copy.deepcopy(QUICK))
    rows = load_kind("calls").rows(folder, suite.of("calls")[index])
    assert rows is not None
    return rows


# ---------------------------------------------------------------- a run


def test_rows_hold_every_problem_of_every_method(quick: RunFolder) -> None:
    rows = rows_of(quick)
    counts = dict(rows.group_by("method").len().iter_rows())
    assert counts == {"dls": 24, "few": 4, "plain": 4}
    assert (rows["ns"] > 0).all()
    chosen = [set(rows.filter(pl.col("method") == m)["problem"]) for m in ("few", "plain")]
    assert chosen[0] == chosen[1]
    assert rows_of(quick, 1)["group"].n_unique() == 5


def test_an_absent_peer_is_a_row_that_says_how_to_install_it(quick: RunFolder) -> None:
    block = suite_of("quick", copy.deepcopy(QUICK)).of("calls")[0]
    entries = load_kind("calls").facts(quick, block)["entries"]
    assert entries["eaik"]["absent"] == "not installed: pip install EAIK"
    assert "absent" not in entries["plain"]
    assert entries["dls"]["kind"] == "ours"


def test_a_hidden_package_is_absent_though_parts_of_it_were_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("eaik", "eaik.IK_Homogeneous"):
        monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
    with pytest.MonkeyPatch.context() as patch:
        hide(patch, "eaik")
        with pytest.raises(Absent, match=r"^not installed: pip install EAIK$"):
            load_method(PEERS, "eaik").build(optik.load("paper6r"))
    assert "eaik.IK_Homogeneous" in sys.modules


def test_targets_are_judged_in_the_suites_order(quick: RunFolder) -> None:
    found = Run(quick).outcomes
    assert [o.held for o in found] == [True, True, None, False]
    assert found[1].value == pytest.approx(median_ratio(rows_of(quick), "few", "plain"))
    assert found[2].note == "eaik was not run"


def test_a_batch_is_counted_by_our_own_kinematics(quick: RunFolder) -> None:
    rows = load_kind("batch").rows(quick, suite_of("quick", copy.deepcopy(QUICK)).of("batch")[0])
    assert rows["count"].to_list() == [300, 300]
    assert rows["solved"].to_list() == rows["claimed"].to_list()
    assert rows["solved"][0] > 250
    assert (rows["seconds"] > 0).all()


def test_a_stopped_run_is_continued(quick: RunFolder, tmp_path: Path) -> None:
    shutil.copytree(quick.path, tmp_path / "run")
    parts = sorted((tmp_path / "run" / "rows/calls").iterdir())
    kept = {p.name: p.stat().st_mtime_ns for p in parts if p.name != "hard--0000.parquet"}
    (tmp_path / "run" / "rows/calls" / "hard--0000.parquet").unlink()
    folder = run_suite(suite_of("quick", copy.deepcopy(QUICK)), tmp_path / "run")
    changed = {p.name for p in parts if p.stat().st_mtime_ns != kept.get(p.name)}
    assert changed <= {"hard--0000.parquet", "hard.json"}
    assert rows_of(folder, 1).height == 10


def test_answers_at_equal_iterations_are_parts_of_their_own(tmp_path: Path) -> None:
    settings = QUICK["calls"][1] | {"evaluation_budgets": [2, 5]}
    suite = suite_of("quick", {"calls": [copy.deepcopy(settings)]})
    folder, top = run_suite(suite, tmp_path / "run"), tmp_path / "run" / "rows/calls"
    parts = {file.name: file.stat().st_mtime_ns for file in top.glob("*.parquet")}
    assert set(parts) == {"hard--0000.parquet", "hard--2-0000.parquet", "hard--5-0000.parquet"}
    (top / "hard--5-0000.parquet").unlink()
    facts = (top / "hard.json").stat().st_mtime_ns
    run_suite(suite, tmp_path / "run")
    again = {file.name: file.stat().st_mtime_ns for file in top.glob("*.parquet")}
    assert {name for name in parts if again[name] != parts[name]} == {"hard--5-0000.parquet"}
    assert (top / "hard.json").stat().st_mtime_ns == facts
    found = load_kind("calls").read(folder, suite.of("calls")[0])
    assert isinstance(found, CallRows)
    assert found.rows.height == 10
    assert found.evaluations.group_by("budget").len().sort("budget").rows() == [(2, 10), (5, 10)]


def test_wrong_options_are_refused_before_anything_is_written(tmp_path: Path) -> None:
    for part, options in (("calls", {"cuont": 3}), ("calls", {"count": 0}), ("batch", {"x": 1})):
        settings = copy.deepcopy(QUICK)
        settings[part][0]["options"] = options
        with pytest.raises(InvalidInput, match=r"count|options"):
            run_suite(suite_of("quick", settings), tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_facts_that_are_gone_are_named(quick: RunFolder, tmp_path: Path) -> None:
    shutil.copytree(quick.path, tmp_path / "run")
    (tmp_path / "run" / "rows/calls" / "warm.json").unlink()
    with pytest.raises(InvalidInput, match="warm"):
        load_kind("calls").read(RunFolder(tmp_path / "run"), suite_of("quick", copy.deepcopy(QUICK)).of("calls")[0])


def test_where_no_target_has_a_solution_nobody_wins_and_the_table_says_so(tmp_path: Path) -> None:
    methods = [{"solver": "dls", "label": label} for label in ("a", "b")]
    block = {
        "robot": "paper6r",
        "set": "beyond_reach",
        "options": {"count": 2, "excesses_m": [0.1]},
        "methods": methods,
    }
    suite = suite_of(
        "s", {"calls": [block | {"id": "far"}, block | {"id": "near", "set": "near_start", "options": {"count": 2}}]}
    )
    far, near = Run(run_suite(suite, tmp_path / "run")).of("calls")
    assert (far.unreachable, near.unreachable) == (True, False)
    assert {winner.question.rpartition(": ")[2] for winner in winners(Run(far.folder))} == {"near"}
    assert "No target" in success_and_time(far).note
    assert "No target" not in success_and_time(near).note


# ---------------------------------------------------------------- timing and judgement


def problems_of(count: int) -> tuple[optik.Robot, ProblemSet]:
    robot = optik.load("paper6r")
    return robot, near_start(robot, 5, count=count)


def test_every_contestant_takes_all_problems_in_every_round() -> None:
    robot, problems = problems_of(6)
    seen: list[str] = []

    def called(label: str) -> Contestant:
        def call(target: Any, q0: Any) -> Any:
            seen.append(label)
            return q0

        return Contestant(Entry(label, label, {}), {}, call, lambda raw: Solutions(raw[None], None, 1, 2))

    rows = timed_part(robot, problems, np.arange(6), [called("a"), called("b")], rounds=3)
    blocks = seen[12:]  # after the warm-up of both
    assert "".join(blocks[::6]) == "abbaab"
    assert rows.height == 12
    assert rows["iterations"].to_list() == [1] * 12
    assert rows["restarts"].to_list() == [2] * 12


def test_a_call_is_timed_with_the_collector_off_and_it_is_on_again() -> None:
    import gc

    took, raws = timed(lambda x: gc.isenabled(), [(1,), (2,)])
    assert raws == [False, False]
    assert gc.isenabled()
    assert took.dtype == np.int64


def test_any_branch_counts_but_only_inside_the_limits() -> None:
    robot = optik.load("paper6r")
    q = np.linspace(robot.limits.lower + 0.3, robot.limits.upper - 0.3, 8)
    targets = robot.fk(q)
    good = judged(robot, targets, [np.stack([v + 0.2, v, v * np.nan]) for v in q], wraps=True)
    assert good["solved"].all()
    assert good["position_error"].max() < 1e-9  # type: ignore[operator]
    bad = judged(robot, targets, [np.stack([v + 0.01, v + 0.2]) for v in q], wraps=True)
    assert not bad["solved"].any()
    none = judged(robot, targets, [np.empty((0, 6))] * 8, wraps=True)
    assert not none["solved"].any()
    assert none["position_error"].is_nan().all()


def test_full_turns_are_added_only_where_asked() -> None:
    robot = optik.load("paper6r")
    q = np.linspace(robot.limits.lower + 0.3, robot.limits.upper - 0.3, 8)
    turned = [(v + 2.0 * np.pi * np.array([1, -2, 0, 1, 0, -1]))[None] for v in q]
    for wraps in (True, False):
        assert judged(robot, robot.fk(q), turned, wraps=wraps)["solved"].all() == wraps


def test_wrapping_moves_no_joint_that_stands_inside() -> None:
    robot = optik.load("ur5e")  # two turns of room on every joint
    q = np.random.default_rng(1).uniform(robot.limits.lower, robot.limits.upper, (50, 6))
    np.testing.assert_array_equal(wrapped(robot, q), q)
    far = wrapped(robot, q + 6.0 * np.pi)
    assert robot.limits.contains(far).all()
    np.testing.assert_allclose(np.cos(far), np.cos(q), atol=1e-9)


# ---------------------------------------------------------------- targets


def rows(**methods: list[tuple[int, int, bool]]) -> pl.DataFrame:
    flat = [(m, *r) for m, given in methods.items() for r in given]
    return pl.DataFrame(flat, schema=["method", "problem", "ns", "solved"], orient="row")


def test_measures_are_what_their_names_say() -> None:
    table = rows(a=[(i, 1000 * (i + 1), i != 3) for i in range(100)])
    expect = {
        "success": 99.0, "median_us": 50.5, "mean_us": 50.5, "max_us": 100.0,
        "p90_us": np.percentile(np.arange(1, 101), 90), "p99_us": np.percentile(np.arange(1, 101), 99),
    }  # fmt: skip
    for measure, value in expect.items():
        found, note = load_kind("calls").judge(table, Target(measure=measure, method="a", at_most=1.0))
        assert found == pytest.approx(value)
        assert note.startswith("100 calls")


def test_a_ratio_is_on_the_problems_that_both_were_given() -> None:
    table = rows(
        a=[(0, 100, True), (1, 300, True), (2, 9000, True)], b=[(1, 100, True), (2, 1000, True)], c=[(7, 1, True)]
    )
    assert median_ratio(table, "a", "b") == pytest.approx(np.median([300, 9000]) / np.median([100, 1000]))
    assert np.isnan(median_ratio(table, "a", "c"))
    assert set(shared(table, ("a", "b"))["problem"]) == {1, 2}
    ratio = Target(measure="median_ratio", method="a", to="b", at_most=1.0)
    assert load_kind("calls").judge(table, ratio)[1] == "2 problems, both"


@pytest.mark.parametrize(
    ("value", "bounds", "held", "asked"),
    [
        (8.0, {"at_most": 8.0}, True, "≤ 8"),
        (8.1, {"at_most": 8.0}, False, "≤ 8"),
        (99.999, {"at_least": 99.999}, True, "≥ 99.999"),
        (99.998, {"at_least": 99.999}, False, "≥ 99.999"),
        (float("nan"), {"at_least": 1.0}, None, "≥ 1"),
    ],
)
def test_a_bound_is_held_at_the_bound(value: float, bounds: dict[str, float], held: bool | None, asked: str) -> None:
    outcome = TargetOutcome(
        "x", "X", Target(measure="success", method="a", **bounds), measure_named(MEASURES, "success", "x"), value, ""
    )  # type: ignore[arg-type]
    assert outcome.held is held
    assert outcome.asked == asked


def test_a_batch_is_judged_at_its_largest_number_of_threads() -> None:
    table = pl.DataFrame(
        {
            "threads": [1, 2, 2, 2], "count": [100] * 4, "solved": [100, 100, 98, 100], "seconds": [9.0, 1.0, 2.0, 4.0],
        }
    )  # fmt: skip
    judge = load_kind("batch").judge
    assert judge(table, Target(measure="success", at_least=0.0))[0] == 98.0
    assert judge(table, Target(measure="million_per_second", at_least=0.0))[0] == pytest.approx(49e-6)
    assert judge(None, Target(measure="success", at_least=0.0))[1] == "it was not run"


# ---------------------------------------------------------------- peers


@pytest.mark.parametrize("name", [name for name in names(PEERS) if name != "scipy"])  # which we need ourselves
def test_a_peer_says_what_it_is_without_its_package(name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    kind = load_method(PEERS, name, "peer")
    assert kind.settings
    monkeypatch.setenv("OPTIK_PEERS", str(tmp_path))
    why = f"not installed: pip install {kind.distribution}"
    if hasattr(kind, "environment"):
        why = f"no environment in {tmp_path / name}: optik bench peer {name} --install"
    else:
        hide(monkeypatch, kind.package)
    with pytest.raises(Absent) as absent:
        kind.build(optik.load("paper6r"))
    assert (absent.value.why, absent.value.outcome) == (why, "absent")


def test_a_peer_that_cannot_take_an_arm_says_so() -> None:
    limits = optik.JointLimits(np.zeros(2), np.ones(2))
    sliding = optik.Robot.from_mdh([optik.DHRow(prismatic=True), optik.DHRow(a=0.1)], limits, name="slides")
    for name in ("eaik", "ssik", "pytracik"):
        kind = load_method(PEERS, name)
        if kind.version():
            with pytest.raises(Absent, match="does not support slides"):
                kind.build(sliding)


def test_a_broken_import_of_a_peer_shows_itself() -> None:
    class Broken(SolverPeer):
        distribution, package, settings = "x", "x", "x"

        def __init__(self, robot: optik.Robot) -> None:
            import nothing_like_that  # noqa: F401

        def read(self, raw: Any) -> Any: ...

    with pytest.raises(ModuleNotFoundError, match="nothing_like_that"):
        Broken.build(optik.load("paper6r"))


def test_the_urdf_of_an_arm_has_its_numbers() -> None:
    robot = optik.load("puma560")
    text = urdf(robot)
    assert text.count("<joint") == 7
    assert repr(float(robot.limits.lower[2])) in text


# ---------------------------------------------------------------- fresh processes


def test_a_fresh_process_prints_json_or_its_last_words_are_told() -> None:
    assert (
        fresh(["-c", "import benchmarks.blocks.contest, json, os; print(json.dumps(os.environ['A']))"], "x", A="b")
        == "b"
    )
    with pytest.raises(ProcessFailed, match=r"^batch 'x': ValueError: no"):
        fresh(["-c", "raise ValueError('no')"], "batch 'x'")
