"""Run the cases of a figure one by one, keep each result, and print what was measured beside what was asked.

A script defines ``measure(case) -> dict`` (its random numbers are seeded by the case) and calls `main`. Results are kept in
``.figures/NAME.jsonl``, so an interrupted run resumes; ``--fresh`` begins anew, which is needed after a change of the code.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[2]
Row = dict[str, Any]


class Value(NamedTuple):
    """A figure: what it is, what was asked, what was measured, and whether that is reached."""

    what: str
    asked: str
    measured: str
    reached: bool


def main(
    name: str,
    measure: Callable[[int], Row],
    count: int,
    judge: Callable[[list[Row]], Sequence[Value]],
    part: float = 1.0,
) -> None:
    """Measure the cases that are not yet kept, then print the figures; exits with 1 if one is not reached.

    `part` is the fraction of the cases that runs by default: below 1 where all of them take over 30 CPU-minutes.
    """
    parser = argparse.ArgumentParser(
        prog=f"python -m tests.figures.{name}", description=sys.modules["__main__"].__doc__
    )
    parser.add_argument("--part", type=float, default=part, help="fraction of the cases to run (default %(default)s)")
    parser.add_argument("--workers", type=int, default=1, help="processes (default 1)")
    parser.add_argument("--fresh", action="store_true", help="forget the results of an earlier run")
    given = parser.parse_args()
    kept = Path(os.environ.get("FIGURES", ROOT / ".figures")) / f"{name}.jsonl"
    kept.parent.mkdir(parents=True, exist_ok=True)
    if given.fresh:
        kept.unlink(missing_ok=True)
    rows = {row["case"]: row for row in map(json.loads, kept.read_text().splitlines())} if kept.exists() else {}
    cases = range(max(1, round(given.part * count)))
    waiting, begin = [case for case in cases if case not in rows], time.monotonic()
    with kept.open("a") as out, ProcessPoolExecutor(given.workers) as pool:
        results = map(measure, waiting) if given.workers == 1 else pool.map(measure, waiting)
        for done, (case, row) in enumerate(zip(waiting, results, strict=True), start=1):
            rows[case] = {"case": case, **row}
            out.write(json.dumps(rows[case]) + "\n")
            out.flush()
            if sys.stderr.isatty() or done % max(1, len(waiting) // 10) == 0:
                print(f"{done} of {len(waiting)} cases, {time.monotonic() - begin:.0f} s", file=sys.stderr)
    print(f"{name}: {len(cases)} of {count} cases")
    values = judge([rows[case] for case in cases])
    for value in values:
        mark = "reached    " if value.reached else "NOT REACHED"
        print(f"  {mark}  {value.what}: asked {value.asked}, measured {value.measured}")
    sys.exit(not all(value.reached for value in values))
