"""Claims about the parameters of the iteration and its start: damping, step size and initial configuration."""

from __future__ import annotations

import numpy as np
import polars as pl

from benchmarks.experiments.base import FAILS, HOLDS, UNTESTED, Finding
from benchmarks.records import RunFolder


def damping_trade(folder: RunFolder) -> Finding:
    """Claim (d): small damping is faster far from singularities, large damping is smoother near them.

    Parameters
    ----------
    folder : RunFolder
        The run.

    Returns
    -------
    Finding
        The verdict with its figures; "not tested" if the run has no data for it.
    """
    claim = "A small λ converges faster far from singular configurations; a large λ calms the iteration near them."
    rule = (
        "Far: in the stratum of the largest singular values the median number of iterations is lower for the smallest λ "
        "than for the largest. Near: in the stratum of the smallest singular values, the 95th percentile of the ratio of "
        "peak error to first error, and the share of iterations that raise the error, are lower for the largest λ."
    )
    rows = folder.rows("damping")
    if rows is None:
        return Finding("d", claim, UNTESTED, "The run has no damping block.", rule)
    rows = rows.filter(
        pl.col("solver") == "dls"
    )  # the claim is about a constant λ; methods that adapt it are shown for comparison
    table = _at_the_end(rows, "group").sort("method_index")
    order = rows.group_by("group").agg(pl.col("sigma").median()).sort("sigma")["group"].to_list()
    near, far = (table.filter(pl.col("group") == g) for g in (order[0], order[-1]))
    if far["iterations"].null_count():
        return Finding("d", claim, UNTESTED, "Far from singularities one of the λ solves no problem.", rule)
    faster = far["iterations"][0] < far["iterations"][-1]
    calmer = near["peak"][-1] < near["peak"][0] and near["rises"][-1] < near["rises"][0]
    small, large = table["method"][0], table["method"][-1]
    text = (
        f"Far ({order[-1]}): {far['iterations'][0]:.0f} median iterations with {small}, {far['iterations'][-1]:.0f} with "
        f"{large}. Near ({order[0]}): the error peaks at {near['peak'][0]:.1f} times its first value with {small} and at "
        f"{near['peak'][-1]:.1f} with {large}. Solved near singularities: {100 * near['solved'][0]:.0f} % with {small}, "
        f"{100 * near['solved'][-1]:.0f} % with {large}."
    )
    figures = tuple(
        (
            f"{r['group']}, {r['method']}",
            f"{100 * r['solved']:.0f} % solved, {_number(r['iterations'])} iterations, peak ×{r['peak']:.1f}, "
            f"{100 * r['rises']:.1f} % of iterations raise the error",
        )
        for g in order
        for r in table.filter(pl.col("group") == g).iter_rows(named=True)
    )
    return Finding("d", claim, HOLDS if faster and calmer else FAILS, text, rule, figures)


def start_and_step(folder: RunFolder) -> Finding:
    """Claim (e): initial configuration and step size decide convergence.

    Parameters
    ----------
    folder : RunFolder
        The run.

    Returns
    -------
    Finding
        The verdict with its figures; "not tested" if the run has no data for it.
    """
    claim = "The initial configuration and the step size decide whether the iteration converges."
    rule = (
        "Success rate at the largest budget. Holds if it varies by at least 20 percentage points with the distance of the "
        "start at step size 1, and by at least 20 points with the step size at the nearest start."
    )
    rows = folder.rows("step")
    if rows is None:
        return Finding("e", claim, UNTESTED, "The run has no step block.", rule)
    table = _at_the_end(rows, "spread")
    one = table.filter(pl.col("method") == "α=1").sort("spread")
    if one.is_empty():
        return Finding("e", claim, UNTESTED, "The run's step block has no method labelled α=1.", rule)
    nearest = table.filter(pl.col("spread") == table["spread"].min()).sort("method_index")
    by_start, by_step = (float(np.ptp(part["solved"].to_numpy())) for part in (one, nearest))
    words = ", ".join(f"{m} {100 * s:.0f} %" for m, s in nearest.select("method", "solved").iter_rows())
    text = (
        f"Start: {100 * one['solved'][0]:.0f} % solved from {one['spread'][0]:g} rad away, "
        f"{100 * one['solved'][-1]:.0f} % from {one['spread'][-1]:g} rad (step 1). "
        f"Step size, from {nearest['spread'][0]:g} rad: {words}.{_why(nearest)}"
    )
    figures = tuple(
        (
            f"{r['method']}, start {r['spread']:g} rad away",
            f"{100 * r['solved']:.0f} % solved, {_number(r['iterations'])} iterations",
        )
        for r in table.sort("method_index", "spread").iter_rows(named=True)
    )
    holds = by_start >= 0.2 and by_step >= 0.2
    return Finding("e", claim, HOLDS if holds else FAILS, text, rule, figures)


def _why(nearest: pl.DataFrame) -> str:
    """Explain the extreme step sizes if the run has them and they solve less than 10 %."""
    few = {m for m, share in nearest.select("method", "solved").iter_rows() if share < 0.1}
    reasons = {
        "α=2": " A step size of 2 reverses the sign of the error instead of removing it.",
        "α=0.1": " A step size of 0.1 removes a tenth of the error per iteration: too slow for the budget, not divergent.",
    }
    return "".join(text for method, text in reasons.items() if method in few)


def _at_the_end(rows: pl.DataFrame, by: str) -> pl.DataFrame:
    """Success rate, median iterations, peak and rises at the largest budget, by method and one more column."""
    ok = pl.col("status") == "solved"
    return (
        rows.filter(pl.col("budget") == pl.col("budget").max())
        .group_by(by, "method", "method_index", maintain_order=True)
        .agg(
            solved=ok.mean(),
            iterations=pl.col("iterations").filter(ok).median(),
            peak=pl.col("peak").quantile(0.95),
            rises=(pl.col("rises") / pl.col("iterations").clip(1)).mean(),
        )
    )


def _number(value: float | None) -> str:
    return "no" if value is None else f"{value:.0f}"
