"""Judging is fair and cannot be cheated: order of the methods, false claims, stale answers, changed inputs, remembered ones."""

from __future__ import annotations

import copy
import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

import optik
from benchmarks.blocks.base import load_kind
from benchmarks.blocks.calls import CallRows, timed_by_first_round
from benchmarks.blocks.entries import JUDGED_AT, judged, solved_at
from benchmarks.records import RunFolder
from benchmarks.report.base import Run, load_report
from benchmarks.report.calls import block_winners, by_sigma, profile_ratios
from benchmarks.report.calls.tables import block_tables
from benchmarks.report.tables import Table, shown_rows
from benchmarks.run import run_suite
from benchmarks.statistics import wilson
from benchmarks.suite import suite_of
from optik.errors import InvalidInput
from optik.ik import make_solver
from optik.registry import names
from optik.types import Array
from tests.oracles import off_by

PEER = '''
"""A peer of a test."""
import time
import numpy as np
from benchmarks.peers.ik.base import SolverPeer, Solutions, one
from optik.ik import make_solver

class Method(SolverPeer):
    distribution, package, settings, random = "of-a-test", "numpy", "{words}", {random}

    def __init__(self, robot, **options):
        solver, last, known = make_solver(robot, "lm"), [np.zeros(robot.n)], {{}}
        def call(target, q0):
            {body}
        self.call = call

    def read(self, raw):
        return Solutions(one(raw), claimed=True)

METHOD = Method
'''
"""A peer as a file outside the package; all of them claim success."""

BODIES = {
    "liar": "return q0 + 0.0",
    "stale": "answer = last[0]; last[0] = solver.solve(target, q0).q; return answer",
    "mutator": "q0[:] = solver.solve(target, q0).q; target[:3, 3] = 9.0; return q0 + 0.0",
    "dice": "return solver.solve(target, q0).q if np.random.default_rng().random() < 0.5 else q0 + 0.0",
    "remembers": """
            key = target.tobytes()
            if key not in known:
                until = time.perf_counter() + 4e-4
                while time.perf_counter() < until: pass
                known[key] = solver.solve(target, q0).q
            return known[key]""",
}
"""What each does when it is called; the stale one answers the target before."""

COUNT = 60
"""Problems of the block."""

OURS: list[dict[str, Any]] = [
    {"solver": "lm"},
    {"solver": "dls"},
    {"label": "few", "solver": "dls", "options": {"max_iterations": 12}, "max_problems": 25},
]
"""Methods of the block."""


def suite_data(folder: Path, *, reverse: bool = False) -> dict[str, Any]:
    """A block with our methods and all cheats, in one order or the other."""
    peers = [{"peer": str(folder / f"{name}.py"), "label": name} for name in BODIES]
    methods = copy.deepcopy(OURS)
    block = {
        "id": "block", "title": "A block", "robot": "paper6r", "set": "hard", "options": {"count": COUNT, "spread": 0.3},
        "methods": methods[::-1] if reverse else methods, "peers": peers[::-1] if reverse else peers, "rounds": 3,
        "evaluation_budgets": [3, 30],
    }  # fmt: skip
    return {"title": "fair", "seed": 5, "calls": [block]}


@pytest.fixture(scope="module")
def cheats(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder: Path = tmp_path_factory.mktemp("cheats")
    for name, body in BODIES.items():
        (folder / f"{name}.py").write_text(PEER.format(words=name, body=body, random=name == "dice"), encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def run(cheats: Path, tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    return run_suite(suite_of("fair", suite_data(cheats)), tmp_path_factory.mktemp("judging") / "run")


@pytest.fixture(scope="module")
def block(run: RunFolder) -> CallRows:
    found: CallRows = Run(run).of("calls")[0]
    return found


def table(block: CallRows, ending: str = "") -> dict[str, dict[str, Any]]:
    """Rows of a table of the block by label."""
    found = next(t for t in block_tables(block) if t.id == f"calls-block{ending}")
    return {str(row["label"]): dict(row) for row in found.rows}


# ---------------------------------------------------------------- who judges


def fk_extended(robot: optik.Robot, q: Array) -> Any:
    """Forward kinematics in extended precision, written out."""
    T = np.eye(4, dtype=np.longdouble)
    for i in range(robot.n):
        step = np.eye(4, dtype=np.longdouble)
        if robot.prismatic[i]:
            step[2, 3] = q[i]
        else:
            c, s = np.cos(np.longdouble(q[i])), np.sin(np.longdouble(q[i]))
            step[:2, :2] = [[c, -s], [s, c]]
        T = T @ robot.fixed[i].astype(np.longdouble) @ step
    return T @ robot.tool.astype(np.longdouble)


@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="no extended precision on this machine")
@pytest.mark.parametrize("name", names("optik.robots"))
def test_the_judge_is_exact_far_below_its_finest_tolerance(name: str) -> None:
    robot = optik.load(name)
    for q in robot.limits.sample(np.random.default_rng(1), 12):
        target = fk_extended(robot, q).astype(np.float64)
        rows = judged(robot, target[None], [q[None]], wraps=False)
        assert max(rows["position_error"][0], rows["rotation_error"][0]) < 1e-15
        target[0, 3] += 0.9e-9
        assert judged(robot, target[None], [q[None]], wraps=False).select(solved_at(1e-9)).item()
        target[0, 3] += 0.2e-9
        assert not judged(robot, target[None], [q[None]], wraps=False).select(solved_at(1e-9)).item()


def test_answers_are_judged_as_plain_kinematics_does(run: RunFolder) -> None:
    robot, rng = optik.load("paper6r"), np.random.default_rng(3)
    q = robot.limits.sample(rng, 40)
    targets = np.stack([fk_extended(robot, v).astype(np.float64) for v in q])
    offered = q + rng.normal(size=q.shape) * 10.0 ** rng.uniform(-11, -2, size=(40, 1))
    offered[0] = np.r_[robot.limits.upper[0] + 1e-3, q[0, 1:]]
    targets[0] = fk_extended(robot, offered[0]).astype(np.float64)  # met exactly, outside the limits
    rows = judged(robot, targets, [v[None] for v in offered], wraps=False)
    for i, v in enumerate(offered):
        position, rotation = off_by(fk_extended(robot, v).astype(np.float64), targets[i])
        inside = bool((v >= robot.limits.lower - 1e-9).all() and (v <= robot.limits.upper + 1e-9).all())
        for level in JUDGED_AT:
            expected = inside and float(position) <= level and float(rotation) <= level
            assert rows[i].select(solved_at(level)).item() == expected


# ---------------------------------------------------------------- cheats


def test_wrong_and_stale_answers_are_not_solved_whatever_is_claimed(block: CallRows) -> None:
    success = table(block)
    for cheat in ("liar", "stale"):
        assert success[cheat]["solved"][0] < 5.0
        assert success[cheat]["count"] == COUNT
        assert success[cheat]["false_claims"] >= 0.95 * COUNT
    assert success["lm"]["solved"][0] == 100.0
    assert success["lm"]["false_claims"] == 0
    note = block_tables(block)[0].note
    assert "liar claimed" in note
    assert "outside the limits or more than 1e-3 m or rad off" in note
    assert "lm claimed" not in note


def test_a_cheat_wins_nothing(run: RunFolder) -> None:
    won = load_report(load_kind("calls")).winners(Run(run))
    for winner in won:
        assert not {"liar", "stale"} & set(winner.tied)
        assert winner.entries[0][0] != "remembers"


def test_a_method_that_changes_its_input_harms_none_and_is_named(block: CallRows) -> None:
    success = table(block)
    assert success["mutator"]["changed_input"] == COUNT
    assert {label: success[label]["changed_input"] for label in ("lm", "dls", "few", "liar")} == dict.fromkeys(
        ("lm", "dls", "few", "liar"), 0
    )
    assert "mutator changed its input" in block_tables(block)[0].note
    assert success["mutator"]["solved"] == success["lm"]["solved"]  # its first start, not its last answer
    assert success["mutator"]["median"] > 0.7 * success["lm"]["median"]  # no round starts at the answer of another


def test_a_method_that_remembers_answers_is_named(block: CallRows) -> None:
    assert table(block)["remembers"]["first_round"] > 3.0
    assert table(block)["remembers"]["median"] >= 400.0  # of its first round, in which it had to wait
    assert "remembers took" in block_tables(block)[0].note


def test_a_first_round_counts_by_the_ratios_of_single_problems_not_of_the_medians() -> None:
    fast, slow = 1_000, 12_700  # times of two kinds of problem, of which the median of all is one or the other
    ns = [fast] * 6 + [slow] * 5
    first = [*ns[:5], slow, *ns[6:]]  # one fast problem was disturbed in the first round
    rows = pl.DataFrame({"method": "two kinds", "ns": [float(x) for x in ns], "first_ns": first})
    assert np.median(first) / np.median(ns) > 12.0
    found = timed_by_first_round(rows)
    assert found["first_round"].unique().to_list() == [1.0]
    assert found["ns"].to_list() == ns
    slower = timed_by_first_round(rows.with_columns(first_ns=pl.col("ns") * 3.5))
    assert slower["first_round"].unique().to_list() == [3.5]
    assert slower["ns"].to_list() == [3.5 * x for x in ns]


# ---------------------------------------------------------------- the order of the methods


def test_the_order_of_the_methods_changes_no_success_and_no_error(
    block: CallRows, cheats: Path, tmp_path: Path
) -> None:
    data = suite_data(cheats, reverse=True)
    other: CallRows = Run(run_suite(suite_of("fair", data), tmp_path / "run")).of("calls")[0]
    same = ["method", "problem", "solved", "inside", "position_error", "rotation_error", "iterations"]
    for mine, theirs in ((block.rows, other.rows), (block.evaluations, other.evaluations)):
        assert theirs is not None
        columns = [name for name in (*same, "budget") if name in mine.columns]
        fixed = [frame.select(columns).sort(columns) for frame in (mine, theirs)]
        settled = ~pl.col("method").is_in(["stale", "dice"])  # what these answer hangs on the call before, and on luck
        assert fixed[0].filter(settled).equals(fixed[1].filter(settled))
    for ending, keys in (("", ("solved", "count", "false_claims")), ("-groups", ("g0", "g1"))):
        a, b = table(block, ending), table(other, ending)
        del a["dice"]
        assert {label: [a[label].get(k) for k in keys] for label in a} == {
            label: [b[label].get(k) for k in keys] for label in a
        }
    a, b = table(block, "-tolerance"), table(other, "-tolerance")
    del a["dice"]
    assert repr(a) == repr({label: b[label] for label in a})  # NaN is no number's equal
    counts = [int(found.by_method["dice"]["solved"].sum()) for found in (block, other)]
    ends = [wilson(k, COUNT, 0.99999) for k in counts]  # so that luck alone fails the test once in a billion runs
    assert max(low for low, _ in ends) <= min(high for _, high in ends)
    assert table(block)["dice"]["varies"] == "random numbers"
    for label in ("lm", "dls"):  # times: within what the rounds of both runs differ by, and what a busy machine adds
        noise = 1.0 + (table(block)[label]["noise"] + table(other)[label]["noise"]) / 100.0
        ratio = table(block)[label]["median"] / table(other)[label]["median"]
        assert 1.0 / (2.0 * noise) < ratio < 2.0 * noise


# ---------------------------------------------------------------- the tables, recomputed by plain NumPy


def plain_wilson(k: int, n: int) -> tuple[float, float, float]:
    """Share and Wilson's interval [%], as the roots of its quadratic equation."""
    z = 1.959963984540054
    roots = sorted(np.roots([1 + z * z / n, -(2 * k / n + z * z / n), (k / n) ** 2]).real)
    return 100.0 * k / n, 100.0 * float(roots[0]), 100.0 * float(roots[1])


@pytest.fixture(scope="module")
def raw(run: RunFolder) -> dict[str, dict[str, Any]]:
    """Columns of every method as arrays, straight from the Parquet files."""
    files = sorted((run.path / "rows/calls").glob("block--*.parquet"))
    rows = pl.concat([pl.read_parquet(file) for file in files]).filter(pl.col("budget").is_null())
    found = {
        str(key[0]): {name: part[name].to_numpy() for name in part.columns}
        for key, part in rows.sort("problem").partition_by("method", as_dict=True).items()
    }
    found["remembers"]["ns"] = found["remembers"]["first_ns"]  # it is timed by its first round
    return found


def test_success_and_times_are_what_numpy_finds(block: CallRows, raw: dict[str, dict[str, Any]]) -> None:
    found = table(block)
    for label, c in raw.items():
        ok, us, n = c["solved"], c["ns"] / 1e3, len(c["ns"])
        near = c["inside"] & (np.fmax(c["position_error"], c["rotation_error"]) <= 1e-6)
        np.testing.assert_array_equal(ok, near)
        assert found[label]["solved"] == pytest.approx(plain_wilson(int(ok.sum()), n), abs=1e-6)
        assert found[label]["shifted"] == pytest.approx(np.prod((us + 10.0) ** (1.0 / n)) - 10.0)
        for prefix, part in (("", us[ok]), ("failed_", us[~ok])):
            for key, level in (("median", 50), ("p95", 95), ("p99", 99), ("max", 100)):
                value = found[label][prefix + key]
                assert value == pytest.approx(np.percentile(part, level)) if len(part) else math.isnan(value)
        both = np.intersect1d(c["problem"][ok], raw["lm"]["problem"][raw["lm"]["solved"]])
        if not len(both):
            assert math.isnan(found[label]["ratio"])
            continue
        medians = [np.median(m["ns"][np.isin(m["problem"], both)]) for m in (c, raw["lm"])]
        assert found[label]["ratio"] == pytest.approx(medians[0] / medians[1])
        if label != "lm":
            assert found[label]["ratio"] == pytest.approx(table(block, "-pairs")[label]["ratio"][0])


def test_tolerances_and_iterations_are_counted(block: CallRows, raw: dict[str, dict[str, Any]], run: RunFolder) -> None:
    at, steps = table(block, "-tolerance"), table(block, "-iterations")
    answers = pl.read_parquet(run.path / "rows/calls/block--*.parquet").filter(pl.col("budget").is_not_null())
    for label, c in raw.items():
        for name, level in (("1e-3", 1e-3), ("1e-6", 1e-6), ("1e-9", 1e-9)):
            k = int((c["inside"] & (c["position_error"] <= level) & (c["rotation_error"] <= level)).sum())
            assert at[label][f"at{name}"] == pytest.approx(plain_wilson(k, len(c["ns"])), abs=1e-6)
        if label in BODIES:
            assert steps[label] == {"label": label, "n3": "no iteration limit"}
            continue
        for budget in (3, 30):
            part = answers.filter((pl.col("method") == label) & (pl.col("budget") == budget))
            expected = plain_wilson(int(part["solved"].sum()), len(c["ns"]))
            assert steps[label][f"n{budget}"] == pytest.approx(expected, abs=1e-6)
    assert steps["lm"]["n3"][0] < steps["lm"]["n30"][0]


def test_a_number_of_iterations_is_kept(run: RunFolder) -> None:
    robot, problems = Run(run).of("calls")[0].block.draw(5)
    answers = pl.read_parquet(run.path / "rows/calls/block--*.parquet").filter(pl.col("budget").is_not_null())
    mine = answers.filter((pl.col("method") == "dls") & (pl.col("budget") == 3)).sort("problem")
    for row in mine.head(20).iter_rows(named=True):
        target, start = problems.targets[row["problem"]], problems.starts[row["problem"]]
        result = make_solver(robot, "dls", max_iterations=3, max_restarts=0).solve(target, start)
        assert row["position_error"] == pytest.approx(result.position_error, rel=1e-9, abs=1e-15)


def test_pairs_are_counted_problem_by_problem(block: CallRows, raw: dict[str, dict[str, Any]]) -> None:
    from scipy.stats import wilcoxon

    failed = block.rows.with_columns(solved=pl.col("solved") & ~((pl.col("method") == "lm") & (pl.col("problem") < 10)))
    found = table(CallRows(block.block, failed, block.folder, block.facts), "-pairs")
    reference = raw["lm"] | {"solved": raw["lm"]["solved"] & (raw["lm"]["problem"] >= 10)}
    solved = dict(zip(reference["problem"], reference["solved"], strict=True))
    times = dict(zip(reference["problem"], reference["ns"], strict=True))
    p_solved, p_time = {}, {}
    for label, c in raw.items():
        if label == "lm":
            continue
        pairs = [(bool(ok), bool(solved[p])) for p, ok in zip(c["problem"], c["solved"], strict=True)]
        cells = {
            "both": (True, True),
            "only": (True, False),
            "only_reference": (False, True),
            "neither": (False, False),
        }
        for key, pair in cells.items():
            assert found[label][key] == pairs.count(pair)
        n = pairs.count((True, False)) + pairs.count((False, True))
        tail = (
            sum(math.comb(n, k) for k in range(min(pairs.count((True, False)), pairs.count((False, True))) + 1)) / 2**n
        )
        p_solved[label] = min(1.0, 2.0 * tail) if n else 1.0
        both = [
            (ns, times[p]) for p, ok, ns in zip(c["problem"], c["solved"], c["ns"], strict=True) if ok and solved[p]
        ]
        if both:
            mine, other = np.array(both, dtype=float).T
            value, low, high = found[label]["ratio"]
            assert value == pytest.approx(np.median(mine) / np.median(other))
            assert low <= value <= high
            p_time[label] = wilcoxon(
                np.log(mine) - np.log(other)
            ).pvalue  # rounded as the ratios are, so that ties are the same
    for key, plain in (("p_solved", p_solved), ("p_time", p_time)):
        order = sorted(plain, key=lambda label: plain[label])
        corrected = [min(1.0, (len(order) - i) * plain[label]) for i, label in enumerate(order)]
        for i, label in enumerate(order):
            assert found[label][key] == pytest.approx(max(corrected[: i + 1]), rel=1e-6)


def test_the_profile_and_the_bins_of_singular_values_are_counted(
    block: CallRows, raw: dict[str, dict[str, Any]]
) -> None:
    labels = ("lm", "dls", "few")
    shared = set.intersection(*(set(raw[label]["problem"]) for label in labels))
    found = profile_ratios(block.rows.filter(pl.col("method").is_in(labels)), labels)
    for k, problem in enumerate(sorted(shared)):
        rows = {label: list(raw[label]["problem"]).index(problem) for label in labels}
        costs = {label: raw[label]["ns"][i] if raw[label]["solved"][i] else math.inf for label, i in rows.items()}
        for label, cost in costs.items():
            assert found[label][k] == (cost / min(costs.values()) if math.isfinite(cost) else math.inf)
    part = block.by_method["dls"]
    edges = np.quantile(np.maximum(part["sigma"].to_numpy(), 1e-12), [0.0, 0.3, 0.7, 1.0]) + np.array(
        [0.0, 1e-13, 1e-13, 1e-6]
    )
    expected = []
    for low, high in pairwise(edges):
        ok = [s for s, x in part.select("solved", "sigma").iter_rows() if low <= max(x, 1e-12) < high]
        if len(ok) >= 10:
            expected.append((math.sqrt(low * high), *plain_wilson(sum(ok), len(ok)), len(ok)))
    assert len(expected) >= 2
    assert np.array(by_sigma(part, edges)) == pytest.approx(np.array(expected), abs=1e-6)


# ---------------------------------------------------------------- who is missing, and who wins


def test_refused_and_absent_are_words_and_no_rates(block: CallRows) -> None:
    facts = copy.deepcopy(block.facts)
    facts["entries"]["few"] |= {"absent": "does not support paper6r", "outcome": "refused"}
    facts["entries"]["liar"] |= {"absent": "not installed"}
    rows = block.rows.filter(~pl.col("method").is_in(["few", "liar"]))
    found = CallRows(block.block, rows, block.folder, facts)
    assert table(found)["few"] == {"label": "few", "solved": "refused"}
    assert table(found)["liar"] == {"label": "liar", "solved": "absent"}
    assert "few: refused (does not support paper6r)." in block_tables(found)[0].note
    assert "few" not in table(found, "-pairs")
    assert all(label not in ("few", "liar") for w in block_winners(found) for label, *_ in w.entries)


def test_outcomes_claims_and_processor_time_are_shown_where_a_run_has_them(block: CallRows) -> None:
    mine = block.rows["method"] == "lm"
    rows = block.rows.with_columns(
        outcome=pl.when(mine).then(pl.lit("answered")).otherwise(pl.lit("raised")),
        claimed=pl.when(mine).then(None).otherwise(pl.lit(value=True)),
        cpu_ns=2 * pl.col("ns"),
    )
    found = table(CallRows(block.block, rows, block.folder, block.facts))
    assert found["lm"]["false_claims"] is None
    assert found["dls"]["false_claims"] == found["dls"]["failed"]
    assert (found["dls"]["raised"], found["dls"]["crashed"], found["lm"]["raised"]) == (COUNT, 0, 0)
    assert found["dls"]["cpu"] == pytest.approx(2.0)


def test_methods_that_vary_are_marked(block: CallRows) -> None:
    facts = copy.deepcopy(block.facts)
    facts["entries"]["dls"] |= {"clocked": True, "random": True}
    found = CallRows(block.block, block.rows, block.folder, facts)
    assert table(found)["dls"]["varies"] == "the clock, random numbers"
    assert table(found)["lm"]["varies"] == ""
    assert "dls varies between runs with the clock, random numbers." in block_tables(found)[0].note


def test_winners_are_decided_problem_by_problem_on_those_that_all_were_given(block: CallRows) -> None:
    most, fastest = block_winners(block)
    assert most.entries[0][1] == 100.0
    assert [entry[1] for entry in most.entries] == sorted((entry[1] for entry in most.entries), reverse=True)
    given = len(block.by_method["few"])
    assert 2 * given < COUNT
    assert "few" not in [entry[0] for entry in (*most.entries, *fastest.entries)]
    assert (
        most.note
        == f"the same {COUNT} problems for all, each with a known solution; not ranked (fewer problems): few ({given})"
    )
    assert {entry[0] for entry in fastest.entries} == set(most.tied)
    ok = [set(block.by_method[label].filter("solved")["problem"]) for label in most.tied]
    both = pl.col("problem").is_in(list(set.intersection(*ok)))
    for label, value, low, high in fastest.entries:
        assert value == pytest.approx(np.median(block.by_method[label].filter(both)["ns"].to_numpy()) / 1e3)
        assert low <= value <= high


def test_intervals_that_overlap_are_no_tie_where_each_pair_shows_the_same(block: CallRows) -> None:
    spread = 10.0 ** (3.0 + pl.col("problem") % 7)  # each method's times overlap with the other's: only pairs tell
    factor = pl.when(pl.col("method") == "lm").then(1.0).otherwise(1.05)
    rows = block.rows.filter(pl.col("method").is_in(["lm", "dls"]))
    rows = rows.with_columns(solved=pl.lit(value=True), ns=factor * spread)
    most, fastest = block_winners(CallRows(block.block, rows, block.folder, block.facts))
    assert set(most.tied) == {"lm", "dls"}
    assert fastest.tied == ("lm",)
    assert fastest.entries[1][2] <= fastest.entries[0][3]  # the intervals do overlap
    unknown = rows.with_columns(known=pl.col("problem") >= 10)
    note = block_winners(CallRows(block.block, unknown, block.folder, block.facts))[0].note
    assert note == f"the same {COUNT} problems for all, {COUNT - 10} of them with a known solution"


def test_the_best_is_marked_among_methods_that_were_given_the_same(block: CallRows) -> None:
    rows = block.rows.with_columns(solved=pl.col("method") == "few")
    for found in block_tables(CallRows(block.block, rows, block.folder, block.facts))[:2]:
        shown = {row[0].text: row for row in shown_rows(found)}
        assert not any(cell.best for cell in shown["few"])
        assert {row["label"]: row.get("given") for row in found.rows} == {
            label: "" if label == "few" else "yes" for label in block.by_method
        }


def test_every_table_has_an_id_of_its_own_and_cells_of_its_columns(run: RunFolder) -> None:
    tables: list[Table] = list(load_report(load_kind("calls")).tables(Run(run)))
    assert len({found.id for found in tables}) == len(tables)
    for found in tables:
        keys = {column.key for column in found.columns}
        assert all(set(row) <= keys for row in found.rows)
        assert found.columns[0].key == "label"


@pytest.mark.parametrize("budgets", [[], [0], [1.5], [10, 10], "many"])
def test_wrong_numbers_of_iterations_are_named(budgets: Any, cheats: Path) -> None:
    data = suite_data(cheats)
    data["calls"][0]["evaluation_budgets"] = budgets
    with pytest.raises(InvalidInput, match="evaluation_budgets"):
        suite_of("fair", data)
