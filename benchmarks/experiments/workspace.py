"""Claims about the workspace: accuracy after many iterations, iterations and error over distance (Fig. 11–13)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import polars as pl
from scipy import stats

from benchmarks.experiments.base import FAILS, HOLDS, PARTLY, UNTESTED, Finding
from benchmarks.records import RunFolder
from benchmarks.statistics import wilson
from optik.types import Array, Flags

WORKSPACE = "workspace"
"""Name of the block on which the claims are evaluated."""
TWO_MM = 2e-3
"""Accuracy that the paper claims on each axis [m]."""
ALMOST_ALL = 0.99
"""Least lower end of the interval of the rate of targets within the accuracy, for the claim to hold."""
ROTATION_RAD = np.deg2rad(0.1)
"""Rotation error up to which a target also counts as reached in orientation [rad]; the paper claims none."""
STOP_TOLERANCE = 1e-6
"""Tolerance at which the iteration stops [m, rad]: errors below it do not show how the error grows."""


LEAST_IN_BIN = 3
"""Solved targets in each of the ten bins of claim (b): a median of fewer is not informative."""

AXIS_ERRORS = ("error_x", "error_y", "error_z")
"""Columns of the errors on the axes."""

JUDGED_ERRORS = {"error_x": "X", "error_y": "Y", "error_z": "Z", "position_error": "distance"}
"""Columns of the errors of claim (c), and their names in the report."""


class Fit(NamedTuple):
    """Regression of error on distance: slope [mm/m] and R² of a line, exponent of a power law through the same points."""

    slope: float
    r2: float
    exponent: float

    @property
    def linear(self) -> bool:
        """Whether the error grows about linearly, by the rule of claim (c)."""
        return self.slope > 0.0 and self.r2 >= 0.9 and 0.75 <= self.exponent <= 1.33


def baseline(folder: RunFolder) -> pl.DataFrame | None:
    """Return the rows of the paper's method: the first `dls` of the block, on targets with a known solution."""
    rows = folder.rows("budgets", WORKSPACE)
    if rows is None:
        return None
    dls = rows.filter((pl.col("solver") == "dls") & pl.col("known"))
    if dls.is_empty():
        return None
    worst = pl.max_horizontal(*(pl.col(f"error_{axis}").abs() for axis in "xyz"))
    return dls.filter(pl.col("method_index") == pl.col("method_index").min()).with_columns(axis=worst)


def within_two_millimetres(folder: RunFolder) -> Finding:
    """Claim (a): with enough iterations the error on each axis is within 2 mm."""
    claim = "With enough iterations the error on each of X, Y and Z is within 2 mm."
    rule = (
        "Fraction of the targets with a known solution whose error is within 2 mm on each axis at the largest budget. Holds if "
        "the lower end of its Wilson 95 % interval is at least 99 %. Holds when the target is closer than d if this is true of "
        "the targets closer than d, for the largest such d, and these are at least half of all. Otherwise it does not hold."
    )
    rows = baseline(folder)
    if rows is None:
        return Finding("a", claim, UNTESTED, "The run has no workspace block with dls.", rule)
    method, most = rows["method"][0], int(rows["budget"].max())  # type: ignore[arg-type]
    last = rows.filter(pl.col("budget") == most).sort("distance")
    within = last.select(ok=pl.col("axis") <= TWO_MM)["ok"].to_numpy()
    count, low = len(within), wilson(int(within.sum()), len(within))[0]
    text = (
        f"{method}, {most} iterations: {100 * within.mean():.1f} % of {count:,} targets are within 2 mm on each axis (lower "
        f"end of the interval {100 * low:.1f} %)."
    )
    figures = _within_figures(rows, last, most)
    if low >= ALMOST_ALL:
        return Finding("a", claim, HOLDS, text, rule, figures)
    if (missed := last.filter(pl.col("axis") > TWO_MM)).is_empty():
        return Finding("a", claim, UNTESTED, text, rule, figures)
    text += (
        f" {len(missed):,} are not: their median position error is {1e3 * missed['position_error'].median():.0f} mm, and "  # type: ignore[operator]
        f"the nearest is {1e3 * missed['distance'][0]:.0f} mm from the start."
    )
    near = nearest_that_hold(within)
    if near >= count / 2:
        d = 1e3 * float(last["distance"][near - 1])
        text += f" For the {near:,} targets within {d:.0f} mm, the lower end of the interval is at least 99 %."
        return Finding("a", claim, f"{PARTLY} the target is closer than {d:.0f} mm", text, rule, figures)
    text += f" The lower end of the interval reaches 99 % for at most the nearest {near:,} targets." if near else ""
    return Finding("a", claim, FAILS, text, rule, figures)


def nearest_that_hold(within: Flags) -> int:
    """Return the largest number of nearest targets for which claim (a) holds."""
    solved = np.cumsum(within)
    return next((k for k in range(len(within), 0, -1) if wilson(int(solved[k - 1]), k)[0] >= ALMOST_ALL), 0)


def _within_figures(rows: pl.DataFrame, last: pl.DataFrame, most: int) -> tuple[tuple[str, str], ...]:
    share = rows.group_by("budget", maintain_order=True).agg(ok=(pl.col("axis") <= TWO_MM).mean())
    turned = (
        last.select(ok=(pl.col("axis") <= TWO_MM) & (pl.col("rotation_error") <= ROTATION_RAD))["ok"].to_numpy().mean()
    )
    return (
        *(
            (f"within 2 mm after {b} iteration{'s' if b != 1 else ''}", f"{100 * ok:.1f} %")
            for b, ok in share.iter_rows()
        ),
        (f"within 2 mm and 0.1° after {most} iterations", f"{100 * turned:.1f} %"),
    )


def more_iterations(folder: RunFolder) -> Finding:
    """Claim (b): a larger motion range needs more iterations."""
    claim = "A larger motion range needs more iterations for the same accuracy."
    rule = (
        "Spearman's rank correlation ρ between distance and iterations to 1e-6 m and rad, on solved targets, and the medians "
        "of the iterations in ten bins of equal count over distance. Holds if ρ ≥ 0.5 with p < 0.001. Holds when medians of "
        "many targets count if only the medians of the bins have ρ ≥ 0.8. Otherwise it does not hold."
    )
    rows = baseline(folder)
    if rows is None:
        return Finding("b", claim, UNTESTED, "The run has no workspace block with dls.", rule)
    solved = _select_solved(rows).sort("distance")
    if len(solved) < 10 * LEAST_IN_BIN:
        return Finding("b", claim, UNTESTED, f"Only {len(solved)} solved targets: too few to judge.", rule)
    rank = rank_over_distance(solved["distance"].to_numpy(), solved["iterations"].to_numpy(), "targets")
    text = f"{rows['method'][0]}: rank correlation {rank.rho:.2f} over {len(solved):,} solved targets; {rank.words}"
    return Finding("b", claim, rank.verdict("targets"), text, rule, rank.figures)


class Ranking(NamedTuple):
    """Rank correlation of the needed iterations with the distance, and their medians in ten bins of equal count."""

    rho: float
    p: float
    medians: list[float]
    figures: tuple[tuple[str, str], ...]

    @property
    def words(self) -> str:
        """The medians of the first and the last bin in words."""
        first, last = self.medians[0], self.medians[-1]
        return f"the median goes from {first:g} iterations for the nearest tenth to {last:g} for the farthest."

    def verdict(self, noun: str) -> str:
        """Return the verdict on claim (b)."""
        if self.rho >= 0.5 and self.p < 1e-3:
            return HOLDS
        level = len(set(self.medians)) == 1  # equal medians have no rank correlation
        middle = 0.0 if level else float(stats.spearmanr(np.arange(10), self.medians).statistic)
        return f"{PARTLY} medians of many {noun} count, not single ones" if middle >= 0.8 else FAILS


def rank_over_distance(far: Array, took: Array, noun: str) -> Ranking:
    """Rank the needed iterations over the distance, both ordered by the distance."""
    parts = np.array_split(np.arange(len(far)), 10)
    medians = [float(np.median(took[p])) for p in parts]
    figures = tuple(
        (f"median iterations, {1e3 * far[p[0]]:.0f} to {1e3 * far[p[-1]]:.0f} mm away", f"{m:g} ({len(p)} {noun})")
        for p, m in zip(parts, medians, strict=True)
    )
    rank = stats.spearmanr(far, took)
    return Ranking(float(rank.statistic), float(rank.pvalue), medians, figures)


def linear_error(folder: RunFolder) -> Finding:
    """Claim (c): at a fixed number of iterations the error on X, Y and Z grows about linearly with distance."""
    claim = "At a fixed number of iterations the error grows about linearly with distance, on X, Y and Z."
    rule = (
        "Medians of |error| in twelve bins of equal count over distance, on targets with a known solution, for each setting of "
        "dls and each budget at which most targets are still above the stop tolerance. An error is about linear if a line "
        "through the medians has R² ≥ 0.9 and their power law an exponent of 0.75 to 1.33. Holds if every setting has a budget "
        "at which the errors on X, Y and Z are all about linear. Holds when … if only some settings have one, or if only the "
        "distance between tool and target is about linear. Otherwise it does not hold."
    )
    rows = folder.rows("budgets", WORKSPACE)
    if rows is None or (dls := rows.filter((pl.col("solver") == "dls") & pl.col("known"))).is_empty():
        return Finding("c", claim, UNTESTED, "The run has no workspace block with dls.", rule)
    fits = {str(method): dict(_fits(part)) for (method,), part in dls.group_by("method", maintain_order=True)}
    text = (
        f"{linear_words(fits)} A full step is a Newton step: its remaining error is of second order in the distance, and of "
        "higher order after each further step. With a step size α < 1 the fraction 1 − α of the error remains, which is "
        "proportional to the distance."
    )
    return Finding("c", claim, linear_verdict(fits), text, rule, fit_figures(fits))


def fit_figures(fits: dict[str, dict[int, dict[str, Fit]]]) -> tuple[tuple[str, str], ...]:
    """Return the fits of every setting at every budget in words."""
    return tuple(
        (f"{setting}, {budget} iteration{'s' if budget > 1 else ''}", fit_words(found))
        for setting, at in fits.items()
        for budget, found in at.items()
    )


def linear_words(fits: dict[str, dict[int, dict[str, Fit]]]) -> str:
    """Describe the fits of every setting at its most linear budget."""
    words = []
    for method, at in fits.items():
        if at:
            budget = max(at, key=lambda b: min(at[b][c].r2 for c in AXIS_ERRORS))
            words.append(f"{method} after {budget}: {fit_words(at[budget])}")
    return ("Best linear fits of X, Y and Z: " + "; ".join(words) + ".") if words else "No budget can be judged."


def fit_words(fit: dict[str, Fit]) -> str:
    """Describe the fits of one setting at one budget."""
    return ", ".join(f"{name} R² {fit[c].r2:.2f} ~d^{fit[c].exponent:.2f}" for c, name in JUDGED_ERRORS.items())


def linear_verdict(fits: dict[str, dict[int, dict[str, Fit]]]) -> str:
    """Return the verdict on claim (c)."""
    axes = {m: [b for b, fit in at.items() if all(fit[c].linear for c in AXIS_ERRORS)] for m, at in fits.items()}
    whole = {m: [b for b, fit in at.items() if fit["position_error"].linear] for m, at in fits.items()}
    if all(axes.values()):
        return HOLDS
    for keep, meant in ((axes, ""), (whole, "the distance of the tool counts, not each axis, and ")):
        if any(keep.values()):
            settings = ", ".join(f"{m} ({_span(b)} iteration{'s' if b[-1] > 1 else ''})" for m, b in keep.items() if b)
            return f"{PARTLY} {meant}the setting is {settings}"
    return FAILS


def _fits(rows: pl.DataFrame) -> Iterator[tuple[int, dict[str, Fit]]]:
    for (budget,), part in rows.group_by("budget", maintain_order=True):
        if (part["position_error"] > STOP_TOLERANCE).mean() < 0.5:  # type: ignore[operator]
            return
        yield int(budget), {c: fit_line(part["distance"].to_numpy(), np.abs(part[c].to_numpy())) for c in JUDGED_ERRORS}


def fit_line(distance: Array, error: Array, bins: int = 12) -> Fit:
    """Fit the medians of the error over the distance in bins of equal count, which is robust against diverging targets."""
    parts = np.array_split(np.argsort(distance, kind="stable"), bins)
    d = np.array([np.median(distance[p]) for p in parts])
    e = np.maximum([np.median(error[p]) for p in parts], 1e-12)
    line = stats.linregress(d, 1e3 * e)
    power = stats.linregress(np.log(d), np.log(e))
    return Fit(float(line.slope), float(line.rvalue) ** 2, float(power.slope))


def _span(budgets: list[int]) -> str:
    return f"{budgets[0]}" if len(budgets) == 1 else f"{budgets[0]} to {budgets[-1]}"


def _select_solved(rows: pl.DataFrame) -> pl.DataFrame:
    return rows.filter((pl.col("budget") == pl.col("budget").max()) & (pl.col("status") == "solved"))
