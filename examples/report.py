"""A comparison from Python: two methods on an arm from a URDF, and its report in one HTML file.

    python examples/report.py [FOLDER]

The same from the command line: a suite in TOML and `optik bench run SUITE --out FOLDER`, `optik bench report FOLDER`.
"""

import sys
from pathlib import Path

import polars as pl

from benchmarks.records import RunFolder
from benchmarks.report import write_report
from benchmarks.run import run_suite
from benchmarks.suite import suite_of

here = Path(__file__).parent
folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("comparison")

suite = suite_of(
    "our-arm",
    {
        "title": "The paper's iteration and the default on our arm",
        "seed": 1,
        "calls": [
            {
                "id": "random",
                "title": "Random reachable targets, one start",
                "robot": str(here / "arm.urdf"),
                "set": "random_reachable",
                "options": {"count": 500, "start_deg": [0, 30, 60, 0, 30, 0]},
                "methods": [{"solver": "dls"}, {"solver": "lm"}],
            }
        ],
    },
)
run_suite(suite, folder)  # the same call resumes an interrupted run
print(f"report: {write_report(RunFolder(folder))}")

# The rows are Parquet files; docs/suites.md says what the columns are.
rows = RunFolder(folder).rows("calls", "random")
print(rows.group_by("method").agg(pl.col("solved").mean(), (pl.col("ns").median() / 1e3).alias("median µs")))
