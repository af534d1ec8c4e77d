"""Claims about the parameters of the iteration and its start: damping, step size and initial configuration."""

from __future__ import annotations

import numpy as np
import polars as pl

from benchmarks.experiments.base import FAILS, HOLDS, PARTLY, UNTESTED, Finding
from benchmarks.records import RunFolder

DECIDES = 0.2
"""Least range of the success rate [1] for which a parameter decides whether the iteration converges."""


def damping_trade(folder: RunFolder) -> Finding:
    """Claim (d): small damping is faster far from singularities, large damping is smoother near them."""
    claim = "A small λ converges faster far from singular configurations; a large λ calms the iteration near them."
    rule = (
        "Smallest against largest λ. Far (stratum of the largest singular values): the smallest λ has the lower median number "
        "of iterations. Near (stratum of the smallest): the largest λ has the lower fraction of iterations that raise the "
        "error (mean over targets), and a lower median and 95th percentile of peak error / first error. Holds if all of these "
        "are true. Holds when the worst targets count if, near, only the 95th percentile and the fraction are lower. Holds "
        "when only one stratum counts if the criterion fails in the other. Otherwise it does not hold."
    )
    rows = folder.rows("budgets", "damping")
    if rows is None:
        return Finding("d", claim, UNTESTED, "The run has no damping block.", rule)
    # the claim is about a constant λ; methods that adapt it are shown for comparison
    rows = rows.filter(pl.col("solver") == "dls")
    table = _at_the_end(rows, "group").sort("method_index")
    order = rows.group_by("group").agg(pl.col("sigma").median()).sort("sigma")["group"].to_list()
    near, far = (table.filter(pl.col("group") == g) for g in (order[0], order[-1]))
    if far["iterations"].null_count():
        return Finding("d", claim, UNTESTED, "Far from singularities, one λ solves no problem.", rule)
    small, large = table["method"][0], table["method"][-1]
    text = (
        f"Far ({order[-1]}): a median of {far['iterations'][0]:.0f} iterations with {small}, {far['iterations'][-1]:.0f} with "
        f"{large}. Near ({order[0]}): peak error / first error has a median of {near['peak'][0]:.2f} and a 95th percentile of "
        f"{near['peak_95'][0]:.1f} with {small}, {near['peak'][-1]:.2f} and {near['peak_95'][-1]:.1f} with {large}. Solved "
        f"near singularities: {100 * near['solved'][0]:.0f} % with {small}, {100 * near['solved'][-1]:.0f} % with {large}."
    )
    figures = tuple(
        (
            f"{r['group']}, {r['method']}",
            f"{100 * r['solved']:.0f} % solved, median of {_number(r['iterations'])} iterations, peak: median "
            f"×{r['peak']:.2f}, 95th percentile ×{r['peak_95']:.1f}; "
            f"a mean of {100 * r['rises']:.1f} % of a target's iterations raise the error",
        )
        for g in order
        for r in table.filter(pl.col("group") == g).iter_rows(named=True)
    )
    return Finding("d", claim, _trade_verdict(near, far), text, rule, figures)


def _trade_verdict(near: pl.DataFrame, far: pl.DataFrame) -> str:
    def lower(column: str) -> bool:
        return bool(near[column][-1] < near[column][0])

    faster = far["iterations"][0] < far["iterations"][-1]
    worst = lower("peak_95") and lower("rises")
    if faster and worst:
        return HOLDS if lower("peak") else f"{PARTLY} the worst targets near a singularity count, not the median"
    if faster:
        return f"{PARTLY} only the targets far from singularities count"
    return f"{PARTLY} only the targets near singularities count" if worst else FAILS


def start_and_step(folder: RunFolder) -> Finding:
    """Claim (e): initial configuration and step size decide convergence."""
    claim = "The initial configuration and the step size decide whether the iteration converges."
    rule = (
        "Range of the success rate at the largest budget over the distance of the start (step size 1), and over the step size "
        "(nearest start). Holds if both ranges are at least 20 percentage points. Holds when only the start, or only the step "
        "size, counts if one of them is. Otherwise it does not hold."
    )
    rows = folder.rows("budgets", "step")
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
    deciding = [name for name, by in (("start", by_start), ("step size", by_step)) if by >= DECIDES]
    verdict = {0: FAILS, 1: f"{PARTLY} only the {''.join(deciding)} counts", 2: HOLDS}[len(deciding)]
    return Finding("e", claim, verdict, text, rule, figures)


def _why(nearest: pl.DataFrame) -> str:
    """Explain the extreme step sizes if the run has them and they solve less than 10 %."""
    few = {m for m, share in nearest.select("method", "solved").iter_rows() if share < 0.1}
    reasons = {
        "α=2": " A step size of 2 reverses the sign of the error instead of removing it.",
        "α=0.1": " A step size of 0.1 removes a tenth of the error per iteration: too slow for the budget, not divergent.",
    }
    return "".join(text for method, text in reasons.items() if method in few)


def _at_the_end(rows: pl.DataFrame, by: str) -> pl.DataFrame:
    """Return success rate, iterations, peak and rises at the largest budget, by method and one more column."""
    ok = pl.col("status") == "solved"
    return (
        rows.filter(pl.col("budget") == pl.col("budget").max())
        .group_by(by, "method", "method_index", maintain_order=True)
        .agg(
            solved=ok.mean(),
            iterations=pl.col("iterations").filter(ok).median(),
            peak=pl.col("peak").median(),
            peak_95=pl.col("peak").quantile(0.95, interpolation="linear"),
            rises=(pl.col("rises") / pl.col("iterations").clip(1)).mean(),
        )
    )


def _number(value: float | None) -> str:
    return "no" if value is None else f"{value:.0f}"
