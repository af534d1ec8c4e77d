"""Lines timed by laws and peers: certified, continued, compared with the shortest motion known, shown in the report."""

from __future__ import annotations

import copy
import math
import re
import shutil
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from scipy.optimize import linprog

from benchmarks.blocks.base import load_kind
from benchmarks.blocks.block import Target
from benchmarks.blocks.timing.motions import DrawnLine, draw_motion
from benchmarks.blocks.timing.timers import line_rows, maximum_velocity
from benchmarks.peers.base import Absent, Answer
from benchmarks.peers.laws import TIMING_PEERS
from benchmarks.peers.laws.base import TimingPeer, peer_limits
from benchmarks.records import RunFolder
from benchmarks.report.base import Run, load_report
from benchmarks.report.tables import ratio
from benchmarks.report.timing import kind_winners
from benchmarks.run import run_suite
from benchmarks.suite import Suite, suite_of
from optik.errors import InvalidInput, NoSolution
from optik.ik import make_solver
from optik.registry import load_method, names
from optik.types import Array
from planners import MotionLimits, certify, follow, make_law
from planners.following.joint_path import JointPath
from tests.benchmarks.browser import CHROMIUM
from tests.benchmarks.test_report import Page, draws_every_plot, page_of

LIMITS = MotionLimits(velocity=2.0, acceleration=10.0, jerk=100.0)
QUICK: dict[str, Any] = {
    "title": "a few lines",
    "seed": 4,
    "timing": [
        {
            "id": "few lines",
            "title": "A few <b>",
            "lines": [
                {"robot": "paper6r", "kind": "regular", "count": 4},
                {"robot": "paper6r", "kind": "near_singular", "count": 1},
                {"robot": "ur5e", "kind": "regular", "count": 1},
            ],
            "limits": [{"label": "ours", "velocity": 2.0, "acceleration": 10.0, "jerk": 100.0}],
            "laws": [{"law": "quintic"}, {"law": "toppra"}, {"law": "optimal"}],
            "peers": [{"peer": "copp", "label": "copp"}, {"peer": "toppra_spline", "label": "splines", "max_lines": 1}],
            "reference": {"law": "optimal", "label": "reference", "options": {"intervals": 300}},
            "plan": "optimal",
            "samples": 51,
            "rounds": 1,
            "targets": [
                {"law": "optimal", "measure": "worst_ratio", "at_most": 1.0},
                {"law": "optimal", "measure": "worst_optimum", "at_most": 1.01},
                {"law": "quintic", "measure": "worst_jerk", "group": "near_singular", "at_most": 1.0},
                {"law": "copp", "measure": "median_optimum", "at_most": 1.01},
                {"law": "optimal", "measure": "truth_over_bound", "at_most": 1.0},
                {"law": "quintic", "measure": "plan_ms", "at_most": 1.0, "goal": True},
            ],
        }
    ],
}


def quick_suite() -> Suite:
    return suite_of("quick", copy.deepcopy(QUICK))


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "copp_py", None)  # what the import machinery says of a package that is not there
        return run_suite(quick_suite(), tmp_path_factory.mktemp("timing") / "run")


def rows_of(folder: RunFolder) -> pl.DataFrame:
    rows = load_kind("timing").rows(folder, quick_suite().of("timing")[0])
    assert rows is not None
    return rows


def joints_of(line: DrawnLine, samples: int = 51) -> JointPath:
    found = follow(make_solver(line.robot, "lm"), line.path, line.q_start, samples=samples).joint_path
    assert found is not None
    return found


# ---------------------------------------------------------------- a run


def test_every_law_has_every_line_and_a_peer_the_first_of_each_set(quick: RunFolder) -> None:
    counts = dict(rows_of(quick).group_by("method").len().iter_rows())
    assert counts == {"quintic": 6, "toppra": 6, "optimal": 6, "reference": 6, "splines": 3}
    assert rows_of(quick)["solved"].all()


def test_an_absent_peer_says_how_to_install_it(quick: RunFolder) -> None:
    entries = load_kind("timing").facts(quick, quick_suite().of("timing")[0])["entries"]
    assert entries["copp"]["absent"] == "not installed: pip install copp-py"
    assert "absent" not in entries["splines"]
    assert entries["reference"]["kind"] == "reference"
    assert entries["quintic"]["enforced"] == []


def test_a_row_is_what_the_law_and_a_dense_look_say(quick: RunFolder) -> None:
    line = draw_motion("paper6r", "regular", 2, seed=4)
    motion = make_law("optimal").run(joints_of(line), LIMITS)
    row = rows_of(quick).filter((pl.col("method") == "optimal") & (pl.col("line") == 2)).row(0, named=True)
    assert row["duration"] == pytest.approx(motion.duration, rel=1e-9)
    t = np.linspace(0.0, motion.end, 20_001)
    for order, (field, limit) in enumerate((("velocity", 2.0), ("acceleration", 10.0), ("jerk", 100.0)), start=1):
        seen = np.abs(motion(t, order)).max() / limit
        assert seen <= row[field] + 1e-9
        assert row[field] == pytest.approx(seen, rel=1e-2)
    assert row["true_distance"] <= row["distance"] * (1 + 1e-9)
    assert row["length"] == pytest.approx(line.path.end)
    assert row["ms_law"] > 0.0
    assert row["ms_plan"] > row["ms_follow"]


def test_limits_that_are_broken_are_named_promised_or_not(quick: RunFolder) -> None:
    rows = rows_of(quick)
    assert (rows.filter(pl.col("method") == "optimal")["breaks"] == "").all()
    for row in rows.iter_rows(named=True):
        beyond = [field for field in ("velocity", "acceleration", "jerk") if row[field] > 1.0]
        assert row["breaks"].split(", ") == (beyond or [""])
    assert (rows.filter(pl.col("method") == "quintic")["jerk"] > 1.0).any()
    toppra = rows.filter(pl.col("method") == "toppra")
    assert toppra["breaks"].str.contains("jerk").all()
    assert np.isinf(toppra["jerk"].to_numpy()).all()
    assert np.isinf(toppra["least_duration"].to_numpy()).all()


def test_the_quintic_breaks_nothing_at_its_least_duration(quick: RunFolder) -> None:
    line = draw_motion("paper6r", "regular", 0, seed=4)
    row = rows_of(quick).filter((pl.col("method") == "quintic") & (pl.col("line") == 0)).row(0, named=True)
    law = make_law("quintic", duration=row["least_duration"], step=row["least_duration"] / 150)
    proof = certify(line.robot, line.path, law.run(joints_of(line), LIMITS), LIMITS)
    assert max(proof.worst(field)[0] for field in ("velocity", "acceleration", "jerk")) == pytest.approx(1.0, abs=1e-6)


def test_a_stopped_run_is_continued_with_the_same_answers(quick: RunFolder, tmp_path: Path) -> None:
    shutil.copytree(quick.path, tmp_path / "run")
    parts = sorted(f"rows/timing/{file.name}" for file in (quick.path / "rows/timing").glob("few-lines--*.parquet"))
    assert len(parts) == 2
    (tmp_path / "run" / parts[1]).unlink()
    kept = (tmp_path / "run" / parts[0]).stat().st_mtime_ns
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "copp_py", None)
        folder = run_suite(quick_suite(), tmp_path / "run")
    assert (tmp_path / "run" / parts[0]).stat().st_mtime_ns == kept
    same = ["line", "method", "limits", "duration", "jerk", "distance", "breaks"]
    assert rows_of(folder).select(same).equals(rows_of(quick).select(same))


def test_wrong_options_and_missing_limits_are_refused_before_anything_is_written(tmp_path: Path) -> None:
    for path, value in (("laws", [{"law": "toppra", "options": {"gird": 3}}]), ("limits", [{"velocity": 2.0}])):
        settings = copy.deepcopy(QUICK)
        settings["timing"][0] |= {path: value}
        for key in ("plan", "peers", "targets"):
            settings["timing"][0].pop(key)
        with pytest.raises(InvalidInput, match=r"gird|acceleration"):
            run_suite(suite_of("quick", settings), tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_facts_that_are_gone_are_named(quick: RunFolder, tmp_path: Path) -> None:
    shutil.copytree(quick.path, tmp_path / "run")
    (tmp_path / "run" / "rows/timing" / "few-lines.json").unlink()
    with pytest.raises(InvalidInput, match="few lines"):
        load_kind("timing").read(RunFolder(tmp_path / "run"), quick_suite().of("timing")[0])


# ---------------------------------------------------------------- T* and targets


def written(tmp_path: Path, *rows: dict[str, Any]) -> RunFolder:
    folder = RunFolder(tmp_path)
    about = {"line": 0, "robot": "paper6r", "kind": "regular", "limits": "ours"}
    kind, given = load_kind("timing"), about | {"entry": "law", "status": "solved"}
    whole = (kind.lost(**given | row | {"problem": f"regular {row.get('line', 0)}"}) for row in rows)
    folder.write("rows/timing/few-lines--0000.parquet", kind.frame(whole))
    return folder


def test_the_optimum_is_the_shortest_motion_that_keeps_every_limit(tmp_path: Path) -> None:
    good = {"breaks": "", "status": "solved"}
    rows = rows_of(
        written(
            tmp_path,
            good | {"method": "a", "duration": 2.0, "least_duration": 1.8},
            good | {"method": "b", "duration": 1.0, "least_duration": 3.0, "breaks": "jerk"},
            good | {"method": "reference", "entry": "reference", "duration": 2.5, "least_duration": 2.5},
            {"method": "c", "status": "timing_infeasible", "reason": "none"},
            good | {"method": "a", "line": 1, "duration": 3.0, "least_duration": 3.0},
            good | {"method": "reference", "entry": "reference", "line": 1, "duration": 2.5, "least_duration": 2.5},
        )
    )
    found = {(r["line"], r["method"]): r for r in rows.iter_rows(named=True)}
    assert found[0, "a"]["over_optimum"] == 1.0
    assert found[0, "a"]["kept_over_optimum"] == 1.0  # room that is left is no reason to be faster than it is
    assert found[0, "b"]["over_optimum"] == 0.5
    assert found[0, "b"]["kept_over_optimum"] == 1.5
    assert found[0, "c"]["over_optimum"] == found[0, "c"]["kept_over_optimum"] == math.inf  # no motion
    assert found[1, "a"]["over_optimum"] == pytest.approx(1.2)


def test_measures_are_what_their_names_say(tmp_path: Path) -> None:
    def row(line: int, ratios: tuple[float, float, float], **more: Any) -> dict[str, Any]:
        fields = dict(zip(("velocity", "acceleration", "jerk"), ratios, strict=True))
        breaks = ", ".join(f for f, r in fields.items() if r > 1.0)
        facts = {"method": "a", "line": line, "duration": 1.0 + line, "holds": line != 1, "breaks": breaks}
        return facts | fields | {"ms_law": float(line), "distance": 1e-6, "true_distance": 0.99e-6} | more

    table = rows_of(
        written(
            tmp_path,
            row(0, (0.5, 1.0, 0.9), angle=0.0, true_angle=0.0, ms_plan=7.0),
            row(1, (0.7, 1.2, 0.9), angle=1e-10, true_angle=2e-10, kind="near_singular"),
            row(2, (0.6, 0.3, 1.0), angle=0.0, true_angle=0.0, ms_law=10.0),
            {"method": "a", "line": 3, "status": "no_ik", "reason": "x"},
            {"method": "reference", "entry": "reference", "line": 2, "duration": 2.0, "breaks": ""},
        )
    )
    wanted = {
        "solved": 75.0, "kept": 200.0 / 3.0, "holds": 200.0 / 3.0, "worst_ratio": 1.2, "worst_velocity": 0.7,
        "worst_acceleration": 1.2, "worst_jerk": 1.0, "median_ms": 1.0, "p95_ms": 9.1, "plan_ms": 7.0, "deviation_um": 1.0,
        "truth_over_bound": 2.0, "bound_over_truth": 1.0 / 0.99,
    }  # fmt: skip

    def judged(measure: str, **of: Any) -> tuple[float, str]:
        found: tuple[float, str] = load_kind("timing").judge(table, Target(measure=measure, at_least=0.0, **of))
        return found

    for measure, value in wanted.items():
        assert judged(measure, method="a")[0] == pytest.approx(value), measure
    assert judged("median_optimum", method="a") == (pytest.approx(1.25), "3 of 4 motions")  # of 1, 1, 1.5 and none
    assert judged("worst_optimum", method="a", group="near_singular")[0] == pytest.approx(1.0)
    assert judged("worst_optimum", method="a", group="regular")[0] == math.inf
    assert judged("worst_ratio", method="a", group="near_singular") == (1.2, "1 motions")
    assert re.findall(r"\d+", judged("worst_ratio", method="a")[1]) == ["3", "4"]
    assert np.isnan(judged("worst_ratio", method="b")[0])


def test_targets_are_judged_in_the_suites_order(quick: RunFolder) -> None:
    found = Run(quick).outcomes
    assert [o.held for o in found] == [True, True, False, None, True, None]
    assert found[2].what.startswith("quintic: ") and found[2].what.endswith("near-singular")
    assert found[3].note == "copp was not run"
    assert found[5].note == "its whole plans were not timed"


# ---------------------------------------------------------------- peers


@pytest.mark.parametrize("name", names(TIMING_PEERS))
def test_a_peer_says_what_it_is_without_its_package(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kind = load_method(TIMING_PEERS, name, "peer")
    assert kind.settings
    monkeypatch.setitem(sys.modules, kind.package, None)
    monkeypatch.setenv("OPTIK_PEERS", str(tmp_path))  # no environments
    apart = f"no environment in {tmp_path / 'drake'}: optik bench peer drake --install"
    with pytest.raises(Absent) as absent:
        kind.build(LIMITS.arrays(6))
    assert absent.value.why == apart if name == "drake_toppra" else f"not installed: pip install {kind.distribution}"


def peer_or_skip(name: str, limits: dict[str, Array]) -> TimingPeer:
    try:
        return load_method(TIMING_PEERS, name).build(limits)  # type: ignore[no-any-return]
    except Absent as absent:
        pytest.skip(absent.why)


def test_drake_finds_the_optimum_that_toppra_finds_and_takes_its_own_time() -> None:
    theirs, drake = (peer_or_skip(name, LIMITS.arrays(6)) for name in ("toppra_const_accel", "drake_toppra"))
    joints = joints_of(draw_motion("paper6r", "near_singular", 1, seed=4))
    begin = time.perf_counter()
    assert drake.many is not None
    (answer,) = drake.many([(joints,)])
    assert 0.0 < answer.ns < 1e9 * (time.perf_counter() - begin)
    motions = [peer.read(joints, peer.call(joints)) for peer in (theirs, drake)]
    assert motions[1].duration == pytest.approx(motions[0].duration, rel=5e-3)  # two splines through the samples


def test_a_time_that_was_measured_elsewhere_is_the_time_of_the_call(monkeypatch: pytest.MonkeyPatch) -> None:
    class Elsewhere(TimingPeer):
        distribution, package, settings, enforced = "x", "x", "", ()

        def __init__(self, limits: Any) -> None:
            pass

        def call(self, joint_path: JointPath) -> Any: ...

        def many(self, arguments: Any) -> list[Answer]:
            return [Answer(None, int(1234e6 * joint_path.end), None) for (joint_path,) in arguments]

        def read(self, joint_path: JointPath, raw: Any) -> Any:
            raise InvalidInput("motion", "none", "one")

    monkeypatch.setattr("benchmarks.blocks.contest.load_method", lambda *a: Elsewhere)
    settings = copy.deepcopy(QUICK)
    settings["timing"][0] |= {"laws": [{"law": "quintic"}], "peers": [{"peer": "copp"}], "plan": "quintic"}
    for key in ("reference", "targets"):
        settings["timing"][0].pop(key)
    line = draw_motion("paper6r", "regular", 0, seed=4)
    rows = {row["method"]: row for row in line_rows(suite_of("quick", settings).of("timing")[0], line)}
    assert rows["copp"]["ms_law"] == pytest.approx(1234.0 * joints_of(line).end)
    assert rows["quintic"]["ms_law"] < 100.0


@pytest.mark.parametrize("name", names(TIMING_PEERS))
def test_a_peer_that_is_here_times_a_line_nearly_within_what_it_promises(name: str) -> None:
    line = draw_motion("paper6r", "regular", 1, seed=4)
    limits = replace(LIMITS, torque=line.robot.limits.torque) if name.endswith("torque") else LIMITS
    peer = peer_or_skip(name, peer_limits(limits, 6))
    joints = joints_of(line)
    motion = peer.read(joints, peer.call(joints))
    proof = certify(line.robot, line.path, motion, limits, enforced=peer.enforced)
    assert all(proof.worst(field)[0] < 1.3 for field in peer.enforced)
    assert (proof.path_error.distance < 1e-6) == (name != "ruckig_joints")
    np.testing.assert_allclose(motion(0.0), joints(0.0), atol=1e-9)
    np.testing.assert_allclose(motion(motion.end), joints(joints.end), atol=1e-9)
    best = make_law("optimal").run(joints, limits).duration
    assert (0.98 if "jerk" in peer.enforced and name != "ruckig_joints" else 0.5) * best < motion.duration < 1.1 * best


def test_a_motion_that_leaves_the_line_sets_no_shortest_duration(quick: RunFolder) -> None:
    block = quick_suite().of("timing")[0]
    parts = quick.rows("timing", block.id)
    kept = parts.filter((pl.col("method") == "optimal") & (pl.col("breaks") == "")).head(1)
    assert kept.height == 1

    class WithOneMore:
        def __init__(self, **changes: Any) -> None:
            self.frame = pl.concat([parts, kept.with_columns(**{k: pl.lit(v) for k, v in changes.items()})])

        def rows(self, kind: str, block: str) -> pl.DataFrame:
            return self.frame

    def optimum(**changes: Any) -> float:
        rows = load_kind("timing").rows(WithOneMore(duration=1e-3, least_duration=1e-3, **changes), block)  # type: ignore[arg-type]
        return float(rows["optimum"].min())  # type: ignore[arg-type]

    assert optimum() == 1e-3
    assert optimum(distance=0.02) > 0.1
    assert optimum(angle=0.02) > 0.1


def test_a_law_that_fails_is_a_row_that_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[int] = []

    class Failing(TimingPeer):
        distribution, package, settings, enforced = "x", "x", "x", ()

        def __init__(self, limits: Any) -> None: ...

        def call(self, joint_path: JointPath) -> Any:
            calls.append(1)
            raise NoSolution("too hard for it")

        def read(self, joint_path: JointPath, raw: Any) -> Any: ...

    monkeypatch.setattr("benchmarks.blocks.contest.load_method", lambda *a: Failing)
    settings = copy.deepcopy(QUICK)
    settings["timing"][0] |= {"lines": settings["timing"][0]["lines"][:1], "rounds": 3, "laws": [{"law": "quintic"}]}
    settings["timing"][0] |= {"plan": "quintic", "targets": [{"law": "copp", "measure": "solved", "at_least": 1}]}
    settings["timing"][0]["lines"][0]["count"] = 1
    suite = suite_of("quick", settings)
    folder = run_suite(suite, tmp_path / "run")
    row = rows_of(folder).filter(pl.col("method") == "copp").row(0, named=True)
    assert (row["status"], row["reason"]) == ("timing_infeasible", "too hard for it")
    assert len(calls) == 2  # two peers, each once: it would fail again
    assert "too hard for it" in page_of(folder).text


# ---------------------------------------------------------------- the line looked at closely


def test_the_maximum_velocity_curve_is_the_optimum_of_a_linear_programme() -> None:
    rng = np.random.default_rng(3)
    q1, q2 = rng.normal(size=(2, 40, 5))
    q1[:3, 1] = 0.0
    limit = rng.uniform(1.0, 20.0, 5)
    found = maximum_velocity(q1, q2, limit)
    for k in range(40):
        A = np.stack([q1[k], q2[k]], axis=1)  # of s̈ and x = ṡ²
        best = linprog([0.0, -1.0], np.r_[A, -A], np.r_[limit, limit], bounds=[(None, None), (0.0, None)])
        assert found[k] ** 2 == pytest.approx(best.x[1], rel=1e-7)


def test_speeds_of_laws_that_keep_their_limits_stay_below_the_curves(quick: RunFolder) -> None:
    read = load_kind("timing").read(quick, quick_suite().of("timing")[0])
    motions, curve, binding = (read.table(name) for name in ("motions", "curve", "binding"))
    optimal = motions.filter(pl.col("law") == "optimal")
    for field in ("velocity", "acceleration"):
        bound = np.interp(optimal["s"].to_numpy(), curve["s"].to_numpy(), curve[field].to_numpy())
        assert (optimal["speed"].to_numpy() <= bound * (1.0 + 1e-3)).all()
    t, s = optimal["t"].to_numpy(), optimal["s"].to_numpy()
    np.testing.assert_allclose(np.gradient(s, t)[5:-5], optimal["speed"].to_numpy()[5:-5], atol=1e-3)
    pieces = binding.filter(pl.col("law") == "optimal")
    assert pieces["ratio"].to_numpy().max() == pytest.approx(1.0, abs=1e-4)


# ---------------------------------------------------------------- the report


@pytest.fixture(scope="module")
def page(quick: RunFolder, tmp_path_factory: pytest.TempPathFactory) -> Page:
    folder = tmp_path_factory.mktemp("timing-report") / "run"
    shutil.copytree(quick.path, folder)
    return page_of(RunFolder(folder))


def test_a_run_of_timing_alone_has_its_section_and_no_claims(page: Page) -> None:
    assert page.anchors == ["timing", "limitations", "asked", "provenance"]
    assert "time laws along 6 straight lines" in page.text
    assert "3 of 6 targets met, 2 not measured." in page.text
    assert "A few <b>" in page.text
    assert ("b", {}) not in page.tags


def test_a_page_defines_its_symbol_first_and_says_its_findings_in_words(page: Page) -> None:
    first = page.text.index("T*")
    assert page.text[first:].startswith("T* is the shortest known duration")
    findings = page.text[page.text.index("Key findings") :]
    assert re.search(
        r"Shortest computing time: A few <b>, regular: \w+ with [\d.]+ ms; next is \w+ with [\d.]+ ms\.", findings
    )


def laws_table(folder: RunFolder, ending: str) -> dict[str, dict[str, Any]]:
    tables = {table.id: table for table in load_report(load_kind("timing")).tables(Run(folder))}
    return {str(row["label"]): dict(row) for row in tables[f"timing-few-lines-{ending}"].rows}


def test_the_tables_are_what_the_rows_hold(page: Page, quick: RunFolder) -> None:
    rows = rows_of(quick)
    shown = {a["data-table"] for t, a in page.tags if t == "table" and "data-table" in a}
    for ending, part in (
        ("regular", rows.filter(pl.col("kind") == "regular")),
        ("near-singular", rows.filter(pl.col("kind") == "near_singular")),
    ):
        assert f"timing-few-lines-{ending}" in shown
        found = laws_table(quick, ending)
        for label in ("quintic", "toppra", "optimal", "splines"):
            own = part.filter(pl.col("method") == label)
            slowed = {  # what keeps all limits, uniformly slower; none for a motion whose certificate fails otherwise
                (r["line"], r["method"]): max(r["duration"], r["least_duration"]) if r["follows"] else math.inf
                for r in part.iter_rows(named=True)
            }
            best = [min(s for (line, _), s in slowed.items() if line == k) for k in own["line"]]
            least = np.array([slowed[k, label] for k in own["line"]])
            ratios = own["velocity", "acceleration", "jerk"].to_numpy()
            near = (ratios <= 1.001).all(axis=1) & own["follows"].to_numpy()
            expect = {
                "as_is": np.median(own["duration"].to_numpy() / best), "slowed_down": np.median(least / best),
                "kept": 100.0 * np.mean((ratios <= 1.0).all(axis=1)), "nearly": 100.0 * np.mean(near),
            }  # fmt: skip
            assert {key: found[label][key][0] for key in expect} == pytest.approx(expect)
            assert found[label]["ms"] == pytest.approx(np.median(own["ms_law"]))
            assert found[label]["ms_p95"] == pytest.approx(np.quantile(own["ms_law"], 0.95))
            assert found[label]["worst"] == pytest.approx(ratios.max())
            assert found[label]["count"] == len(own)


def test_an_absent_peer_stays_in_the_tables_and_verdicts_are_shown(page: Page, quick: RunFolder) -> None:
    assert laws_table(quick, "regular")["copp"] == {"label": "copp", "kept": "absent"}
    assert page.text.count("not installed: pip install copp-py") >= 2
    assert re.search(r"The [a-z-]+ path number 1( of \d+)? on \w+, within the limits", page.text)
    looks = [a["class"] for t, a in page.tags if t == "span" and "badge" in a.get("class", "")]
    assert looks == [f"badge {look}" for look in ("good", "good", "bad", "none", "good", "none")]


def test_laws_with_a_bounded_jerk_are_ranked_after_the_slow_down(quick: RunFolder) -> None:
    block = Run(quick).of("timing")[0]
    assert kind_winners(block, "near_singular") == []  # one line says nothing of a median
    rows = block.rows
    shortest, fastest = kind_winners(block, "regular")
    assert [entry[0] for entry in shortest.entries] == ["optimal", "quintic"]
    assert "jerk unbounded, not ranked: toppra" in shortest.note
    for label, value, low, high in shortest.entries:
        own = rows.filter((pl.col("method") == label) & (pl.col("kind") == "regular"))
        assert value == pytest.approx(np.median(own["kept_over_optimum"]))
        assert low <= value <= high
    assert {entry[0] for entry in fastest.entries} == {"optimal", "quintic"}
    twice = pl.concat([rows, *(rows.with_columns(line=pl.col("line") + 1000 * k) for k in range(1, 4))])
    times = pl.col("ms_law") * 0 + pl.col("line") % 5 + pl.when(pl.col("method") == "optimal").then(1.0).otherwise(1.2)
    many = kind_winners(replace(block, rows=twice.with_columns(ms_law=times)), "regular")
    assert [winner.tied for winner in many] == [("optimal",), ("optimal",)]  # in pairs, where intervals overlap
    assert many[1].entries[1][2] <= many[1].entries[0][3]


def test_a_motion_that_is_20_ppm_over_is_no_infinite_jerk(tmp_path: Path) -> None:
    def row(law: str, ratio: float, least: float, **more: Any) -> dict[str, Any]:
        facts = {"method": law, "duration": 1.0, "least_duration": least, "breaks": "jerk", "status": "solved"}
        fields = {"velocity": 0.5, "acceleration": 0.5, "jerk": ratio, "worst": ratio}
        return facts | fields | {"distance": 1e-7, "angle": 1e-7, "follows": True} | more

    rows = rows_of(
        written(
            tmp_path,
            row("near", 1.00002, 1.00001),
            row("jump", math.inf, math.inf),
            row("short cut", 1.0, 0.9, breaks="", duration=0.1, distance=2e-4),
            row("half way", 1.0, 0.9, breaks="", duration=0.1, follows=False),
            row("too far", 1.0, 0.9, breaks="position", duration=0.1),
            {"method": "none", "status": "timing_infeasible", "reason": "x"},
        )
    )
    found = {r["method"]: r for r in rows.iter_rows(named=True)}
    assert {law for law, r in found.items() if r["nearly"]} == {"near"}
    assert not found["near"]["keeps_all"]
    assert found["near"]["kept_over_optimum"] == 1.0  # it has the shortest motion once it is slowed
    assert found["near"]["optimum"] == pytest.approx(1.00001)
    assert found["jump"]["kept_over_optimum"] == math.inf
    assert [found[law]["kept_over_optimum"] for law in ("short cut", "half way", "too far", "none")] == [math.inf] * 4
    assert found["short cut"]["over_optimum"] == pytest.approx(0.1, rel=1e-4)  # unchanged, it is what it is


def test_a_ratio_shows_that_it_is_above_one() -> None:
    assert [ratio(x) for x in (1.0, 1.0000057, 0.99999976, 2.0, float("inf"))] == [
        "1.00", "1.0000057", "1.00", "2.00", "∞",
    ]  # fmt: skip


def test_a_run_that_has_just_begun_has_a_page(tmp_path: Path, quick: RunFolder) -> None:
    shutil.copytree(quick.path, tmp_path / "run")
    for part in (tmp_path / "run" / "rows/timing").iterdir():
        part.unlink()
    manifest = quick.manifest() | {"complete": False}
    RunFolder(tmp_path / "run").write_json("run.json", manifest)
    page = page_of(RunFolder(tmp_path / "run"))
    assert "Not started: A few <b>." in page.text


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
def test_a_browser_draws_the_timing_section(quick: RunFolder, tmp_path: Path) -> None:
    shutil.copytree(quick.path, tmp_path / "run")
    draws_every_plot(RunFolder(tmp_path / "run"), tmp_path)
