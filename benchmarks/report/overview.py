"""The head of the page: what was compared on what, and the key findings, every number computed."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import polars as pl

from benchmarks.experiments.base import PARTLY
from benchmarks.metrics import LEVELS, level_words, success
from benchmarks.report.laws import broken_limits
from benchmarks.report.numbers import number, percent
from benchmarks.report.run import BlockRows, Run, TimingRows
from benchmarks.targets import outcomes
from optik.arm.library import load
from optik.errors import UnknownName


def overview(run: Run) -> dict[str, Any]:
    """What was compared, on what, and what came out."""
    suite = run.suite
    asked = [(b.id, b.title) for part in (suite.blocks, suite.speed, suite.timing) for b in part]
    begun = {b.block.id for part in (run.blocks, run.speed, run.timing) for b in part}
    return {
        "title": run.suite.title,
        "suite": run.suite.name,
        "levels": [level_words(level) for level in LEVELS],
        "complete": bool(run.manifest.get("complete")),
        "created": run.manifest["provenance"].get("created", ""),
        "robots": [(name, _axes(name)) for name in run.suite.robots],
        "blocks": [_block(b, run) for b in run.blocks],
        "missing": [title for key, title in asked if key not in begun],
        "timed": bool(run.suite.speed or run.suite.batch),
        "line": _line(run),
        "lines": sum(part.count for b in suite.timing for part in b.lines),
        "solvers": bool(suite.blocks or suite.speed or suite.batch or suite.line),
        "findings": [
            f
            for f in (
                *map(_rates, run.comparisons),
                _durations(run),
                *map(_timings, run.timing),
                _verdicts(run),
                _targets(run),
            )
            if f
        ],
    }


def _axes(name: str) -> str:
    try:
        return f"{load(name).n} joints"
    except UnknownName:  # a robot that this version has no longer
        return "not in this version"


def _block(b: BlockRows, run: Run) -> dict[str, Any]:
    total, known = b.problems()
    ran = {m: b.last.filter(pl.col("method") == m).height for m in b.methods}
    methods = []
    for m in b.block.methods:
        options = ", ".join(f"{k} = {v}" for k, v in m.options.items()) or "no options"
        part = "" if ran.get(m.label, 0) == total else f"; {ran.get(m.label, 0):,} of the problems"
        methods.append({"label": m.label, "colour": run.method_colour(m.label), "what": f"{m.solver}, {options}{part}"})
    return {
        "id": b.block.id, "title": b.block.title, "set": b.block.set.replace("_", " "), "robot": b.block.robot,
        "total": total, "known": known, "methods": methods, "budgets": b.block.budgets,
    }  # fmt: skip


def _line(run: Run) -> dict[str, Any] | None:
    task = run.suite.line
    if task is None:
        return None
    return {
        "length": number(1e3 * float(np.linalg.norm(task.move_m))),
        "move": ", ".join(number(1e3 * x) for x in task.move_m),
        "start": ", ".join(f"{x:g}".replace("-", "−") for x in task.start_deg),
        "samples": task.samples, "ik": task.ik, "laws": task.laws, "robot": task.robot,
    }  # fmt: skip


def _rates(b: BlockRows) -> str:
    """Share solved and median time of every method on the paired problems."""
    known = b.paired.filter((pl.col("budget") == b.budget) & pl.col("known"))
    if known.is_empty():
        return ""
    words = []
    for label in b.methods:
        part = known.filter(pl.col("method") == label)
        share, low, high = success(part, LEVELS[-1])
        seconds = part.filter(pl.col("status") == "solved")["seconds"]
        took = f", {number(1e6 * float(np.median(seconds)))} µs a solved call" if len(seconds) else ""
        words.append(f"{label} solves {percent(share)} ({low:.1f} to {high:.1f} %){took}")
    count = known["problem"].n_unique()
    return (
        f"{b.block.title}, {count:,} targets with a known solution, at most {b.budget} iterations: "
        + "; ".join(words)
        + "."
    )


def _durations(run: Run) -> str:
    """Durations of the laws with what each breaks, for the first IK method."""
    if not run.solved_plans:
        return ""
    ik = run.solved_plans[0]["ik"]
    words = []
    for p in run.solved_plans:
        if p["ik"] == ik:
            breaks = broken_limits(p["certificate"])
            words.append(
                f"{p['law']} {p['duration']:.3f} s ("
                + (f"breaks limits: {', '.join(breaks)}" if breaks else "keeps every limit")
                + ")"
            )
    return f"The line of {number(1e3 * run.solved_plans[0]['length'])} mm by {ik}: " + "; ".join(words) + "."


def _timings(b: TimingRows) -> str:
    """Durations and times of every law of ours, and of the peers that were here, on all lines."""
    words = []
    for label in b.entries:
        rows = b.rows.filter((pl.col("law") == label) & pl.col("solved"))
        if rows.is_empty():
            continue
        kept = int(rows["keeps_all"].sum())
        keeps = (
            "keeps every limit" if kept == len(rows) else f"keeps every limit on {percent(100.0 * kept / len(rows))}"
        )
        ratio, ms = (float(np.median(rows[column].to_numpy())) for column in ("over_optimum", "ms_law"))
        words.append(f"{label} {number(ratio, 4)} T* ({keeps}, {number(ms)} ms)")
    lines = b.rows["line"].n_unique()
    return f"{b.block.title}, {lines:,} of them, medians: " + "; ".join(words) + "." if words else ""


def _verdicts(run: Run) -> str:
    """How many claims hold."""
    if not run.suite.blocks and run.suite.line is None:
        return ""
    verdicts = Counter(PARTLY if f.verdict.startswith(PARTLY) else f.verdict for f in run.findings)
    if not verdicts:
        return ""
    words = {
        "holds": ("holds", "hold"), PARTLY: ("holds under a condition", "hold under a condition"),
        "does not hold": ("does not hold", "do not hold"), "not tested": ("is not tested here", "are not tested here"),
    }  # fmt: skip
    parts = [f"{verdicts[v]} {one if verdicts[v] == 1 else many}" for v, (one, many) in words.items() if v in verdicts]
    return f"Of the paper's {sum(verdicts.values())} claims, " + ", ".join(parts) + "."


def _targets(run: Run) -> str:
    """How many targets are held, and which are not."""
    found = outcomes(run.suite, run.folder)
    if not found:
        return ""
    missed = [o for o in found if o.held is False]
    words = "; ".join(
        f"{o.what} {number(o.value)} {o.unit} ({o.where}, asked {o.asked})".replace("  ", " ") for o in missed
    )
    held, unknown = sum(o.held is True for o in found), sum(o.held is None for o in found)
    return (
        f"Of {len(found)} targets, {held} {'is' if held == 1 else 'are'} held"
        + (f", {unknown} could not be measured" if unknown else "")
        + (f". Not held: {words}." if missed else ".")
    )
