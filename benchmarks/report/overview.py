"""The head of the page: subjects and scope of the comparison, and the key findings, with computed numbers."""

from __future__ import annotations

from collections import Counter
from typing import Any

from benchmarks.experiments.base import PARTLY
from benchmarks.report.base import load_report
from benchmarks.report.failures import failure_words
from benchmarks.report.run import Run
from benchmarks.report.winners import won
from optik.errors import UnknownName
from optik.registry import short_name


def overview(run: Run) -> dict[str, Any]:
    """Return subjects, scope and key findings of the comparison."""
    begun = [b.block for b in run.begun]
    # A kind that says who wins has its findings in that table.
    shown = [load_report(kind) for kind in run.suite.kinds]
    own = [words for kind in shown if not kind.winners(run) for words in kind.findings(run)]
    return {
        "title": run.suite.title,
        "suite": run.suite.name,
        "complete": bool(run.manifest.get("complete")),
        "failed": failure_words(run),
        "created": run.manifest["provenance"].get("created", ""),
        "robots": [(short_name(name), _axes(run, name)) for name in run.suite.robots],
        "subjects": _subjects(run),
        "missing": [block.title for _, block in run.suite.pairs() if block not in begun],
        "findings": [words for words in (*own, _verdicts(run)) if words],
        "won": won(run),
    }


def _axes(run: Run, name: str) -> str:
    try:
        return f"{run.robot(name).n} joints"
    except UnknownName:  # a robot that this version has no longer
        return "not in this version"


def _subjects(run: Run) -> str:
    """Describe the compared subjects; one that is part of a more specific subject is left out."""
    found = dict.fromkeys(
        words for kind in run.suite.kinds for words in load_report(kind).subjects(run.suite.of(kind.name))
    )
    own = [words for words in found if not any(other != words and other.startswith(words) for other in found)]
    return ", and ".join(own) + ("," if len(own) > 1 else "")


def _verdicts(run: Run) -> str:
    """Describe how many claims hold."""
    if not run.on_paper:
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
