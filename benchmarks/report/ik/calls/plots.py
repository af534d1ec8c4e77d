"""Plots of single calls: success against time, performance profiles, errors, and success against the singular value."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import polars as pl

from benchmarks.blocks.ik.calls.measures import shared
from benchmarks.blocks.ik.calls.rows import CallRows
from benchmarks.report.board import Board, Control, Json, Plot
from benchmarks.report.figures import HOVER, axis, lean, line, log_axis
from benchmarks.report.run import Run
from benchmarks.report.steps import steps_of
from benchmarks.statistics import performance_profile, wilson
from optik.types import Array

PLOT_ROOM = 0.03
"""Room beside the curves, as a share of the width of a plot [1]."""

LEAST_ERROR = 1e-12
"""Errors below this [m, rad] are drawn here: they are rounding, not a result."""

PROFILE_POINTS = 200
"""Multiples of the least time at which a performance profile is drawn, evenly on its logarithmic axis."""

SIGMA_BINS = 12
"""Bins of the smallest singular value, each as wide as the others on a logarithmic axis."""

FEWEST_IN_BIN = 10
"""Problems of a bin from which a share is drawn: of fewer it says little."""


def _traces(blocks: list[CallRows], run: Run) -> Iterator[tuple[CallRows, str, pl.DataFrame, Json]]:
    """Every method that has rows, with the look of its line."""
    for b in blocks:
        for label, part in b.by_method.items():
            yield b, label, part, {"color": run.colour(label), "width": 2, "dash": run.dash(label), "shape": "hv"}


def _board(id: str, blocks: list[CallRows], run: Run, plots: tuple[Plot, ...], caption: str) -> Board:
    legend = tuple(run.key(label, {"block": [b.block.id]}, marked=False) for b, label, _, _ in _traces(blocks, run))
    controls = (Control("block", "Problems", tuple((b.block.id, b.block.title) for b in blocks)),)
    return Board(id, plots, controls, legend, caption)


def _distribution(values: Array, count: int) -> dict[str, Any]:
    """Share [%] of `count` at or below each value."""
    x, shares = steps_of(values, count)
    return {"x": lean(x, 6), "y": lean(shares, 6)}


def success_in_time(blocks: list[CallRows], run: Run) -> Board:
    """Share of all problems that each method has solved within a time."""
    layout = {
        "xaxis": log_axis("time budget of a call [µs]", dtick=1), "yaxis": axis("problems solved [%]", range=[-2, 102]),
    }  # fmt: skip
    plot = Plot("success-time", "Success against time budget", layout, 420)
    for b, label, part, look in _traces(blocks, run):
        us = part.filter("solved")["ns"].to_numpy() / 1e3
        if len(us):
            hover = f"{label}<br>%{{y:.4~g}} % solved within %{{x:.3g}} µs{HOVER}"
            plot.add(
                line(**_distribution(us, len(part)), name=label, line=look, hovertemplate=hover),
                {"block": [b.block.id]},
            )
    for b in blocks:
        us = b.rows.filter("solved")["ns"].to_numpy() / 1e3
        if len(us):
            plot.vary({"block": [b.block.id]}, {"xaxis": {"range": _around(np.log10(us.min()), np.log10(us.max()))}})
    caption = (
        "Percentage of all problems solved by a call within this time. A curve ends at its method's success rate. The time of "
        "a call is the median of its rounds."
    )
    return _board("success-time-board", blocks, run, (plot,), caption)


def _around(low: float, high: float) -> list[float | None]:
    """A range with room at both ends, so that no curve ends in the frame."""
    room = max(PLOT_ROOM * (high - low), 0.05)
    return lean([low - room, high + room])


def profiles(blocks: list[CallRows], run: Run) -> Board:
    """Performance profiles: share of the shared problems solved within a multiple of the fastest method's time there."""
    layout = {
        "xaxis": log_axis("time / least time of any method on the same problem", dtick=1),
        "yaxis": axis("problems solved [%]", range=[-2, 102]),
    }
    plot = Plot("call-profile", "Performance profile", layout, 380)
    for b in blocks:
        labels = tuple(b.by_method)
        costs = profile_costs(b.rows, labels)
        ratios = _profile_ratios(costs)
        shares = performance_profile(costs, ratios) if len(costs) else np.empty((0, 0))
        for j, (_, label, _, look) in enumerate(_traces([b], run)):
            if not len(costs):
                continue
            hover = f"{label}<br>%{{y:.4~g}} % within %{{x:.3g}} times the least, of {len(costs):,}{HOVER}"
            trace = line(x=lean(ratios), y=lean(100.0 * shares[:, j], 5), name=label, line=look, hovertemplate=hover)
            plot.add(trace, {"block": [b.block.id]})
    caption = (
        "On the problems that all methods were given (Dolan and Moré 2002). At 1: how often a method is the fastest that "
        "solves; at the right end: its success rate. The profile compares each method with the best one only."
    )
    return _board("call-profile-board", blocks, run, (plot,), caption)


def _profile_ratios(costs: Array) -> Array:
    """Multiples of the least time, up to the largest one at which a problem was solved."""
    best = costs.min(axis=1, keepdims=True, initial=np.inf)
    solved = np.isfinite(costs)
    return np.geomspace(1.0, 1.0001 * max((costs / best)[solved].max(initial=1.0), 10.0), PROFILE_POINTS)


def profile_costs(rows: pl.DataFrame, labels: tuple[str, ...]) -> Array:
    """Time of each method on each problem that all were given."""
    both = shared(rows, labels).with_columns(
        cost=pl.when("solved").then(pl.col("ns").cast(pl.Float64)).otherwise(np.inf)
    )
    columns = [both.filter(pl.col("method") == label).sort("problem")["cost"].to_numpy() for label in labels]
    return np.stack(columns, axis=1)


def errors(blocks: list[CallRows], run: Run) -> Board:
    """Distributions of the errors of answers inside the limits, of position and of rotation."""
    plots = []
    for what, unit in (("position", "m"), ("rotation", "rad")):
        layout = {
            "xaxis": log_axis(f"{what} error [{unit}]", dtick=3), "yaxis": axis("problems [%]", range=[-2, 102]),
        }  # fmt: skip
        plot = Plot(f"call-{what}", f"Percentage of problems with at most this {what} error", layout, 360)
        for b, label, part, look in _traces(blocks, run):
            values = part.filter("inside")[f"{what}_error"].to_numpy()
            if len(values):
                hover = f"{label}<br>%{{y:.4~g}} % within %{{x:.2g}} {unit}{HOVER}"
                shares = _distribution(np.maximum(values, LEAST_ERROR), len(part))
                plot.add(line(**shares, name=label, line=look, hovertemplate=hover), {"block": [b.block.id]})
        plots.append(plot)
    caption = f"Answers inside the limits, by optik's forward kinematics. The least error shown is {LEAST_ERROR:g}."
    return _board("call-errors-board", blocks, run, tuple(plots), caption)


def against_singularity(blocks: list[CallRows], run: Run) -> Board | None:
    """Share solved by the smallest singular value at the solution from which a target was made."""
    known = [b for b in blocks if b.rows["sigma"].is_finite().any() and not b.rows["solved"].all()]
    if not known:
        return None
    layout = {
        "xaxis": log_axis("smallest singular value at the solution", dtick=1),
        "yaxis": axis("problems solved [%]", range=[-2, 102]),
    }  # fmt: skip
    plot, some = Plot("call-sigma", "Success against the smallest singular value", layout, 380), False
    for b, label, part, look in _traces(known, run):
        shares = by_sigma(part, singular_edges(b.rows))
        some = some or bool(shares)
        hover = f"{label}<br>%{{text}}{HOVER}"
        trace = line(
            mode="lines+markers", x=lean([s[0] for s in shares]), y=lean([s[1] for s in shares], 6), name=label, line=look,
            text=[f"{y:.4g} % [{low:.4g}, {high:.4g}] of {n:,}" for _, y, low, high, n in shares], hovertemplate=hover,
        )  # fmt: skip
        plot.add(trace, {"block": [b.block.id]})
    caption = (
        f"{SIGMA_BINS} bins of equal width on this axis; bins with fewer than {FEWEST_IN_BIN} problems are omitted. Hover for "
        "the Wilson intervals."
    )
    return _board("call-sigma-board", known, run, (plot,), caption) if some else None


def singular_edges(rows: pl.DataFrame) -> Array:
    """Edges of the bins of the smallest singular value."""
    sigma = np.maximum(rows.filter(pl.col("sigma").is_finite())["sigma"].to_numpy(), LEAST_ERROR)
    return np.geomspace(sigma.min(), sigma.max() * (1.0 + 1e-9), SIGMA_BINS + 1)


def by_sigma(part: pl.DataFrame, edges: Array) -> list[tuple[float, float, float, float, int]]:
    """Share solved in every bin that has enough problems."""
    own = part.filter(pl.col("sigma").is_finite())
    number = np.searchsorted(edges, np.maximum(own["sigma"].to_numpy(), LEAST_ERROR), side="right") - 1
    solved, found = own["solved"].to_numpy(), []
    for i in range(len(edges) - 1):
        count, good = int((number == i).sum()), int(solved[number == i].sum())
        if count >= FEWEST_IN_BIN:
            low, high = wilson(good, count)
            middle = float(np.sqrt(edges[i] * edges[i + 1]))
            found.append((middle, 100.0 * good / count, 100.0 * low, 100.0 * high, count))
    return found
