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
from benchmarks.report.run import BlockRows, Run
from benchmarks.targets import outcomes
from optik.errors import UnknownName
from optik.robot import load


def overview(run: Run) -> dict[str, Any]:
    """What was compared, on what, and what came out."""
    asked = [(b.id, b.title) for b in run.suite.blocks] + [(b.id, b.title) for b in run.suite.speed]
    begun = {b.block.id for b in run.blocks} | {b.block.id for b in run.speed}
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
        "findings": [f for f in (*map(_rates, run.comparisons), _durations(run), _verdicts(run), _targets(run)) if f],
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
    """How many targets of speed are held, and which are not."""
    found = outcomes(run.suite, run.folder)
    if not found:
        return ""
    missed = [o for o in found if o.held is False]
    words = "; ".join(
        f"{o.what} {number(o.value)} {o.unit} ({o.where}, asked {o.asked})".replace("  ", " ") for o in missed
    )
    held, unknown = sum(o.held is True for o in found), sum(o.held is None for o in found)
    return (
        f"Of {len(found)} targets of speed, {held} {'is' if held == 1 else 'are'} held"
        + (f", {unknown} could not be measured" if unknown else "")
        + (f". Not held: {words}." if missed else ".")
    )
