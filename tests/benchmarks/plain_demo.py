"""The demo's own figures, out of the files of a run by NumPy alone: nothing of ours is imported."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from numpy.typing import NDArray

Column = NDArray[Any]


def read(file: Path) -> dict[str, Column]:
    frame = pl.read_parquet(file).drop("target", "start", strict=False)
    return {name: column.to_numpy() for name, column in frame.to_dict().items()}


def block(run: Path, name: str) -> dict[str, Column]:
    """All rows of a block, with what its problems are; a problem that anyone solved is known."""
    parts = [read(file) for file in sorted((run / "rows/budgets").glob(f"{name}--*.parquet"))]
    rows = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
    problems = read(run / "problems" / f"{name}.parquet")
    known = problems["known"].astype(bool)
    known[rows["problem"][rows["status"] == "solved"]] = True
    for key in ("group", "x", "y", "z", "distance", "sigma", "spread"):
        rows[key] = problems[key][rows["problem"]]
    return rows | {"known": known[rows["problem"]]}


def keep(rows: dict[str, Column], which: Column) -> dict[str, Column]:
    return {key: values[which] for key, values in rows.items()}


def at_the_end(rows: dict[str, Column]) -> dict[str, Column]:
    return keep(rows, rows["budget"] == rows["budget"].max())


def given_to_all(rows: dict[str, Column], methods: list[str]) -> dict[str, dict[str, Column]]:
    """Rows of each method on the known problems that all of them were given, sorted by problem."""
    rows = keep(at_the_end(rows), at_the_end(rows)["known"])
    shared = set.intersection(*(set(rows["problem"][rows["method"] == m].tolist()) for m in methods))
    out = {}
    for m in methods:
        mine = keep(rows, (rows["method"] == m) & np.isin(rows["problem"], list(shared)))
        out[m] = keep(mine, np.argsort(mine["problem"]))
    return out


def solved(rows: dict[str, Column], tolerance: float) -> Column:
    near = (rows["position_error"] <= tolerance) & (rows["rotation_error"] <= tolerance)
    return near & (rows["status"] != "outside_limits") & (rows["status"] != "rejected")


def wilson(hits: int, count: int) -> tuple[float, float]:
    z, p = 1.959963984540054, hits / count
    middle, half = p + z**2 / (2 * count), z * np.sqrt(p * (1 - p) / count + z**2 / (4 * count**2))
    low, high = (middle - half) / (1 + z**2 / count), (middle + half) / (1 + z**2 / count)
    return (0.0 if hits == 0 else low), (1.0 if hits == count else high)


def rates(run: Path, name: str) -> dict[str, dict[str, float]]:
    """The table of methods of a block."""
    rows = block(run, name)
    methods = list(dict.fromkeys(rows["method"].tolist()))
    own = {m: given_to_all(rows, [m])[m] for m in methods}
    most = max(len(part["problem"]) for part in own.values())
    ranked = [m for m in methods if len(own[m]["problem"]) >= min(1000, most / 2)]
    return {m: figures(mine) for m, mine in (own | given_to_all(rows, ranked)).items()}


def figures(mine: dict[str, Column]) -> dict[str, float]:
    """A row of the table of methods."""
    hits, took = solved(mine, 1e-6), mine["iterations"][mine["status"] == "solved"]
    position, rotation = 1e3 * mine["position_error"], np.degrees(mine["rotation_error"])
    return {
        "count": len(hits), "fine": 100 * hits.mean(), "low": 100 * wilson(int(hits.sum()), len(hits))[0],
        "coarse": 100 * solved(mine, 1e-3).mean(),
        "position": np.median(position), "position_95": np.quantile(position, 0.95),
        "rotation": np.median(rotation), "rotation_95": np.quantile(rotation, 0.95),
        "iterations": np.median(took) if len(took) else np.nan,
    }  # fmt: skip


def check_figures(row: Any, expect: dict[str, float]) -> None:
    """A row of the table of methods has these figures."""
    assert row["count"] == expect["count"]
    for key in ("position", "position_95", "rotation", "rotation_95", "iterations"):
        assert row[key] == pytest.approx(expect[key], nan_ok=True)
    assert row["fine"][:2] == pytest.approx((expect["fine"], expect["low"]))
    assert row["coarse"][0] == pytest.approx(expect["coarse"])


def claim_a(run: Path) -> tuple[float, int, float]:
    """Share within 2 mm on each axis at the end [%], how many miss, and their median position error [mm]."""
    rows = block(run, "workspace")
    rows = keep(rows, (rows["method"] == "dls λ=0.01") & rows["known"] & (rows["budget"] == rows["budget"].max()))
    worst = np.max([np.abs(rows[f"error_{axis}"]) for axis in "xyz"], axis=0)
    missed = worst > 2e-3
    return 100 * (1 - missed.mean()), int(missed.sum()), 1e3 * float(np.median(rows["position_error"][missed]))


def claim_b(run: Path) -> float:
    """Spearman's rank correlation: that of Pearson on average ranks."""
    rows = block(run, "workspace")
    chosen = (rows["method"] == "dls λ=0.01") & (rows["budget"] == rows["budget"].max()) & (rows["status"] == "solved")
    rows = keep(rows, chosen)

    def ranks(values: Column) -> Column:
        return np.array([(values < v).sum() + ((values == v).sum() + 1) / 2 for v in values])

    return float(np.corrcoef(ranks(rows["distance"]), ranks(rows["iterations"]))[0, 1])


def claim_c(run: Path, method: str, budget: int, column: str) -> tuple[float, float]:
    """R² of a line through the medians of twelve bins, and the exponent of their power law."""
    rows = block(run, "workspace")
    rows = keep(rows, (rows["method"] == method) & rows["known"] & (rows["budget"] == budget))
    order = np.argsort(rows["distance"], kind="stable")
    parts = np.array_split(order, 12)
    d = np.array([np.median(rows["distance"][p]) for p in parts])
    e = np.array([np.median(np.abs(rows[column][p])) for p in parts])
    return float(np.corrcoef(d, e)[0, 1] ** 2), float(np.polyfit(np.log(d), np.log(np.maximum(e, 1e-12)), 1)[0])


def claim_d(run: Path, group: str, method: str) -> tuple[float, float]:
    """Median and 95th percentile of the peak error over the first."""
    rows = at_the_end(block(run, "damping"))
    peak = rows["peak"][(rows["group"] == group) & (rows["method"] == method)]
    return float(np.median(peak)), float(np.quantile(peak, 0.95))


def durations(run: Path) -> dict[str, tuple[float, bool]]:
    """Duration of every law by the first IK method, and whether it keeps every limit."""
    rows = pl.read_parquet(run / "rows/timing" / "line--*.parquet").to_dicts()
    out = {}
    for row in (row for row in rows if row["solver"] == rows[0]["solver"] and row["status"] == "solved"):
        ratios = [row[field] for field in ("velocity", "acceleration", "jerk", "torque")]
        out[row["method"]] = row["duration"], max(ratios) <= 1.0 and "position" not in row["breaks"]
    return out


def call_medians(run: Path, methods: list[str]) -> dict[str, float]:
    """Median time of a solved call [µs] on the problems that all of the methods were given."""
    parts = [read(file) for file in sorted((run / "rows/calls").glob("calls--*.parquet"))]
    rows = {key: np.concatenate([part[key] for part in parts]) for key in ("problem", "method", "ns", "solved")}
    shared = set.intersection(*(set(rows["problem"][rows["method"] == m].tolist()) for m in methods))
    mine = np.isin(rows["problem"], list(shared)) & rows["solved"].astype(bool)
    return {m: float(np.median(rows["ns"][mine & (rows["method"] == m)])) / 1e3 for m in methods}
