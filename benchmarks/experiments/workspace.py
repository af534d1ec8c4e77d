"""Claims about the workspace: accuracy after many iterations, iterations and error over distance (Fig. 11–13)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import polars as pl
from scipy import stats

from benchmarks.experiments.base import FAILS, HOLDS, PARTLY, UNTESTED, Finding
from benchmarks.records import RunFolder
from optik.types import Array

WORKSPACE = "workspace"
"""Name of the block that the claims are evaluated on."""
TWO_MM = 2e-3
"""Accuracy that the paper claims on each axis [m]."""
ALMOST_ALL = 0.99
"""Share of targets that must be within the accuracy for the claim to hold."""
ROTATION_RAD = np.deg2rad(0.1)
"""Rotation error up to which a target counts as reached in orientation too [rad]; the paper claims none."""
STOP_TOLERANCE = 1e-6
"""Tolerance at which the iteration stops [m, rad]: errors below it do not show how the error grows."""


class Fit(NamedTuple):
    """Regression of error on distance: slope [mm/m] and R² of a line, exponent of a power law through the same points."""

    slope: float
    r2: float
    exponent: float


def baseline(folder: RunFolder) -> pl.DataFrame | None:
    """Rows of the paper's method: the first `dls` of the block, on targets with a known solution.

    Parameters
    ----------
    folder : RunFolder
        The run.

    Returns
    -------
    DataFrame or None
        The rows with a column ``axis``, the largest error on one axis [m]; None if the run has no such rows.
    """
    rows = folder.rows(WORKSPACE)
    if rows is None:
        return None
    dls = rows.filter((pl.col("solver") == "dls") & pl.col("known"))
    if dls.is_empty():
        return None
    worst = pl.max_horizontal(*(pl.col(f"error_{axis}").abs() for axis in "xyz"))
    return dls.filter(pl.col("method_index") == pl.col("method_index").min()).with_columns(axis=worst)


def within_two_millimetres(folder: RunFolder) -> Finding:
    """Claim (a): with enough iterations the error on each axis is within 2 mm.

    Parameters
    ----------
    folder : RunFolder
        The run.

    Returns
    -------
    Finding
        The verdict with its figures; "not tested" if the run has no data for it.
    """
    claim = "With enough iterations the error on each of X, Y and Z is within 2 mm."
    rule = (
        "Largest error on one axis at the largest budget, on targets with a known solution. Holds if 99 % are within 2 mm; "
        "otherwise holds up to the distance of the nearest target that is not, if at least 20 targets are nearer."
    )
    rows = baseline(folder)
    if rows is None:
        return Finding("a", claim, UNTESTED, "The run has no workspace block with dls.", rule)
    method, most = rows["method"][0], int(rows["budget"].max())  # type: ignore[arg-type]
    share = rows.group_by("budget", maintain_order=True).agg(ok=(pl.col("axis") <= TWO_MM).mean())
    last = rows.filter(pl.col("budget") == most).sort("distance")
    within = last.select(ok=pl.col("axis") <= TWO_MM)["ok"].to_numpy()
    turned = float((within & (last["rotation_error"].to_numpy() <= ROTATION_RAD)).mean())
    overall = float(within.mean())
    figures = (
        *((f"within 2 mm after {b} iterations", f"{100 * ok:.1f} %") for b, ok in share.iter_rows()),
        (f"within 2 mm and 0.1° after {most} iterations", f"{100 * turned:.1f} %"),
    )
    text = f"{method}: {100 * overall:.1f} % of {len(within)} targets after {most} iterations"
    if overall >= ALMOST_ALL:
        return Finding("a", claim, HOLDS, text + ".", rule, figures)
    failed = last.filter(pl.col("axis") > TWO_MM)
    text += f"; the median position error of the others is {1e3 * failed['position_error'].median():.0f} mm"  # type: ignore[operator]
    if share.height > 1:
        (before, _), (after, _) = share.rows()[-2:]
        text += (
            f"; raising the budget from {before} to {after} adds {100 * (share['ok'][-1] - share['ok'][-2]):.1f} points"
        )
    nearest = int(np.argmin(within))
    if nearest < 20:
        return Finding("a", claim, FAILS, text + ".", rule, figures)
    reach = np.floor(1e3 * float(failed["distance"][0]))
    text += f". The nearest that fails is {reach:.0f} mm from the start; {nearest} targets are nearer."
    return Finding("a", claim, f"{PARTLY} the target is within {reach:.0f} mm of the start", text, rule, figures)


def more_iterations(folder: RunFolder) -> Finding:
    """Claim (b): a larger motion range needs more iterations.

    Parameters
    ----------
    folder : RunFolder
        The run.

    Returns
    -------
    Finding
        The verdict with its figures; "not tested" if the run has no data for it.
    """
    claim = "A larger motion range needs more iterations for the same accuracy."
    rule = (
        "Spearman's rank correlation between distance and iterations to 1e-6 m and rad, on solved targets. Holds if it is "
        "at least 0.5 with p < 0.001."
    )
    rows = baseline(folder)
    if rows is None:
        return Finding("b", claim, UNTESTED, "The run has no workspace block with dls.", rule)
    solved = _solved(rows)
    if len(solved) < 10:
        return Finding("b", claim, UNTESTED, f"Only {len(solved)} solved targets: too few to judge.", rule)
    rank = stats.spearmanr(solved["distance"], solved["iterations"])
    bins = solved.with_columns(bin=(pl.col("distance") * 10).floor()).group_by("bin").agg(
        pl.col("iterations").median().alias("median"), pl.len()
    ).filter(pl.col("len") >= 10).sort("bin")  # fmt: skip
    figures = tuple(
        (f"median iterations, {100 * b:.0f} to {100 * (b + 1):.0f} mm away", f"{median:.0f} ({count} targets)")
        for b, median, count in bins.iter_rows()
    )
    if bins.is_empty():
        return Finding("b", claim, UNTESTED, f"Only {len(solved)} solved targets: too few to judge.", rule)
    holds = rank.statistic >= 0.5 and rank.pvalue < 1e-3
    text = (
        f"{rows['method'][0]}: rank correlation {rank.statistic:.2f} over {len(solved)} solved targets; the median grows from "
        f"{bins['median'][0]:.0f} to {bins['median'][-1]:.0f} iterations."
    )
    return Finding("b", claim, HOLDS if holds else FAILS, text, rule, figures)


def linear_error(folder: RunFolder) -> Finding:
    """Claim (c): at a fixed number of iterations the error grows about linearly with distance.

    Parameters
    ----------
    folder : RunFolder
        The run.

    Returns
    -------
    Finding
        The verdict with its figures; "not tested" if the run has no data for it.
    """
    claim = "At a fixed number of iterations the error grows about linearly with distance, on X, Y and Z."
    rule = (
        "Medians of the error in twelve bins of equal count over distance, at each budget where most targets are still "
        "above the stop tolerance. A method fulfils the claim at a budget if the distance error has R² ≥ 0.9 for a line "
        "and a power-law exponent of 0.75 to 1.33, and |error| on each axis has an exponent of 0.67 to 1.5 (the error on "
        "an axis also depends on the direction of the motion, so R² of its line is not used)."
    )
    rows = folder.rows(WORKSPACE)
    if rows is None or (dls := rows.filter((pl.col("solver") == "dls") & pl.col("known"))).is_empty():
        return Finding("c", claim, UNTESTED, "The run has no workspace block with dls.", rule)
    figures, keep, words = [], {}, []
    for (method,), part in dls.group_by("method", maintain_order=True):
        fits = list(_fits(part))
        good = [budget for budget, fit in fits if linear(fit)]
        if good:
            keep[method] = good
        whole = [f"{fit['position_error'].exponent:.1f}" for _, fit in fits]
        words.append(
            f"{method}: error ~ distance to the power {', '.join(whole)} after {', '.join(str(b) for b, _ in fits)}"
        )
        for budget, fit in fits:
            line = ", ".join(
                f"{name[6:].upper() if name[5] == '_' else 'distance'} {f.slope:.0f} mm/m R² {f.r2:.2f} ~d^{f.exponent:.1f}"
                for name, f in fit.items()
            )
            figures.append((f"{method}, {budget} iterations", line))
    text = "; ".join(words) + " iterations."
    if not keep:
        verdict = FAILS
    elif len(keep) == dls["method"].n_unique():
        verdict = HOLDS
    else:
        verdict = f"{PARTLY} the iteration is slowed: " + ", ".join(
            f"{m} ({_range(b)} iterations)" for m, b in keep.items()
        )
    text += (
        " A full step is a Newton step: it leaves an error of second order in the distance, and of higher order after each "
        "further step. A step size α < 1 leaves the fraction 1 − α of the error, which stays proportional to the distance."
    )
    return Finding("c", claim, verdict, text, rule, tuple(figures))


def _fits(rows: pl.DataFrame) -> Iterator[tuple[int, dict[str, Fit]]]:
    for (budget,), part in rows.group_by("budget", maintain_order=True):
        if (part["position_error"] > STOP_TOLERANCE).mean() < 0.5:  # type: ignore[operator]
            return
        columns = ("error_x", "error_y", "error_z", "position_error")
        yield int(budget), {c: fit(part["distance"].to_numpy(), np.abs(part[c].to_numpy())) for c in columns}


def fit(distance: Array, error: Array, bins: int = 12) -> Fit:
    """Fit medians of error in bins of equal count over distance: robust against targets that do not converge.

    Parameters
    ----------
    distance : (k,) array
        Distances between start and target [m].
    error : (k,) array
        Errors [m].
    bins : int
        Number of bins.

    Returns
    -------
    Fit
        The line and the power law.
    """
    parts = np.array_split(np.argsort(distance, kind="stable"), bins)
    d = np.array([np.median(distance[p]) for p in parts])
    e = np.maximum([np.median(error[p]) for p in parts], 1e-12)
    line = stats.linregress(d, 1e3 * e)
    power = stats.linregress(np.log(d), np.log(e))
    return Fit(float(line.slope), float(line.rvalue) ** 2, float(power.slope))


def linear(fits: dict[str, Fit]) -> bool:
    """Whether the errors at one budget count as about linear, by the rule of claim (c).

    Parameters
    ----------
    fits : dict
        The fits of ``error_x``, ``error_y``, ``error_z`` and ``position_error``.

    Returns
    -------
    bool
        Whether all of them keep the rule.
    """
    whole = fits["position_error"]
    axes = all(0.67 <= fits[f"error_{axis}"].exponent <= 1.5 for axis in "xyz")
    return axes and whole.r2 >= 0.9 and 0.75 <= whole.exponent <= 1.33


def _range(budgets: list[int]) -> str:
    return f"{budgets[0]}" if len(budgets) == 1 else f"{budgets[0]} to {budgets[-1]}"


def _solved(rows: pl.DataFrame) -> pl.DataFrame:
    return rows.filter(
        (pl.col("budget") == pl.col("budget").max()) & (pl.col("status") == "solved") & (pl.col("distance") > 0.0)
    )
