"""The paper's claims about the workspace on executed motions: the same rules, with the noise of the cell."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import polars as pl

from benchmarks.experiments.base import FAILS, HOLDS, PARTLY, UNTESTED, Finding
from benchmarks.experiments.workspace import (
    ALMOST_ALL,
    JUDGED_ERRORS,
    LEAST_IN_BIN,
    TWO_MM,
    Fit,
    fit,
    fit_figures,
    linear_verdict,
    linear_words,
    nearest_that_hold,
    rank_over_distance,
)
from benchmarks.statistics import wilson

READINGS = {
    False: "one solve of k iterations from the start",
    True: "k iterations at each pose of the line, each from the pose before",
}
"""The two readings of section 4.1 of the paper, by the column ``along``."""

OTHER_PARTS = ("laser_error", "path_error", "servo_error")
"""Lengths of the parts of the error that do not depend on the iteration."""


def executed_claims(rows: pl.DataFrame) -> list[Finding]:
    """Return the findings on claims (a), (b) and (c) for each executed reading of section 4.1."""
    known = rows.filter(pl.col("known") & pl.col("budget").is_not_null()).with_columns(axis=_axis())
    dls = known.filter(pl.col("solver") == "dls")
    found = []
    for along, reading in READINGS.items():
        part = dls.filter(pl.col("along") == along)
        if part.is_empty() and along:
            continue
        first = part.filter(pl.col("setting") == part["setting"][0]) if len(part) else part
        judged = _within(first), _more_iterations(first), _linear(part)
        found += [replace(f, claim=f"{f.claim} Read as: {reading}.", summary=f"{reading}: {f.summary}") for f in judged]
    return found


def _axis() -> pl.Expr:
    """Return the largest error on one axis; infinite if nothing was executed."""
    return pl.max_horizontal(*(pl.col(f"error_{axis}").abs() for axis in "xyz")).fill_null(float("inf"))


def _within(rows: pl.DataFrame) -> Finding:
    claim = "With enough iterations the executed tool is within 2 mm of the spot on each of X, Y and Z."
    rule = (
        "Fraction of the spots with a known solution for which the executed tool is within 2 mm on each axis at the largest "
        "budget. Holds if the lower end of its Wilson 95 % interval is at least 99 %. Holds when the spot is closer than d if "
        "this is true of the spots closer than d, for the largest such d, and these are at least half of all. Not tested if "
        "there are too few trials to reach 99 % and the interval contains 99 %. Otherwise it does not hold. A motion that was "
        "not executed to its end counts as a miss."
    )
    if rows.is_empty():
        return Finding("a", claim, UNTESTED, "The run has no spots with dls.", rule)
    most = int(rows["budget"].max())  # type: ignore[arg-type]
    last = rows.filter(pl.col("budget") == most).sort("distance", "problem", "repeat")
    within = (last["axis"] <= TWO_MM).to_numpy()
    count = len(within)
    low, high = wilson(int(within.sum()), count)
    text = (
        f"{rows['setting'][0]}, {most} iterations, executed on the drive {last['drive'][0]}: {100 * within.mean():.1f} % of "
        f"{count:,} trials are within 2 mm on each axis (lower end of the interval {100 * low:.1f} %)."
    )
    share = rows.group_by("budget", maintain_order=True).agg(ok=(pl.col("axis") <= TWO_MM).mean()).sort("budget")
    figures = tuple((f"within 2 mm after {b} iterations", f"{100 * ok:.1f} %") for b, ok in share.iter_rows())
    if low >= ALMOST_ALL:
        return Finding("a", claim, HOLDS, text, rule, figures)
    if wilson(count, count)[0] < ALMOST_ALL <= high:
        return Finding("a", claim, UNTESTED, f"{text} Too few trials to judge.", rule, figures)
    near = nearest_that_hold(within)
    if near >= count / 2:
        d = 1e3 * float(last["distance"][near - 1])
        text += f" For the {near:,} trials within {d:.0f} mm, the lower end of the interval is at least 99 %."
        return Finding("a", claim, f"{PARTLY} the spot is closer than {d:.0f} mm", text, rule, figures)
    text += f" {_why_missed(last)}" if (~within).any() else " There are too few trials for a lower end of 99 %."
    return Finding("a", claim, FAILS, text, rule, figures)


def _why_missed(last: pl.DataFrame) -> str:
    """Name the largest part of the error in the trials that miss."""
    missed = last.filter(pl.col("axis") > TWO_MM)
    executed = missed.filter(pl.col("position_error").is_not_null())
    parts = {
        part: float((executed[f"{part}_error"] == _largest(executed)).sum())
        for part in ("ik", "laser", "path", "servo")
    }
    words = [f"{count:.0f} by {part}" for part, count in parts.items() if count]
    lost = len(missed) - len(executed)
    words += [f"{lost} were not executed"] if lost else []
    return f"{len(missed):,} misses, by the largest part of their error: {', '.join(words)}."


def _largest(rows: pl.DataFrame) -> pl.Series:
    return rows.select(most=pl.max_horizontal("ik_error", *OTHER_PARTS))["most"]


def _more_iterations(rows: pl.DataFrame) -> Finding:
    claim = "A larger motion range needs more iterations for the same accuracy, as executed."
    rule = (
        "Spearman's rank correlation ρ between distance and the least budget from which on the executed tool is within 2 mm "
        "on each axis, over the trials that reach this, and the medians of those budgets in ten bins of equal count over "
        "distance. Holds if ρ ≥ 0.5 with p < 0.001. Holds when medians of many spots count if only the medians of the "
        "bins have ρ ≥ 0.8. Otherwise it does not hold."
    )
    if rows.is_empty():
        return Finding("b", claim, UNTESTED, "The run has no spots with dls.", rule)
    needed = needed_budgets(rows).sort("distance", "problem", "repeat")
    if len(needed) < 10 * LEAST_IN_BIN:
        return Finding("b", claim, UNTESTED, f"Only {len(needed)} trials are within 2 mm: too few to judge.", rule)
    far, took = needed["distance"].to_numpy(), needed["needed"].to_numpy()
    if len(set(took.tolist())) == 1:
        return Finding("b", claim, FAILS, f"All {len(needed):,} trials need {took[0]} iterations.", rule)
    rank = rank_over_distance(far, took, "trials")
    text = f"{rows['setting'][0]}: rank correlation {rank.rho:.2f} over {len(needed):,} trials; {rank.words}"
    return Finding("b", claim, rank.verdict("spots"), text, rule, rank.figures)


def needed_budgets(rows: pl.DataFrame) -> pl.DataFrame:
    """Return the least budget of each trial from which on the executed tool is within 2 mm on each axis."""
    return (
        rows.sort("budget", descending=True)
        .with_columns(ok=(pl.col("axis") <= TWO_MM).cum_min().over("problem", "repeat"))
        .filter("ok")
        .group_by("problem", "repeat", "distance")
        .agg(needed=pl.col("budget").min())
    )


def _linear(dls: pl.DataFrame) -> Finding:
    claim = "At a fixed number of iterations the error of the executed tool grows about linearly with distance, on X, Y and Z."
    rule = (
        "Medians of |error| in twelve bins of equal count over distance, for each setting of dls and each budget at which the "
        "iteration's own error is larger than those of laser, path and servo together in most trials. About linear means "
        "R² ≥ 0.9 and an exponent of 0.75 to 1.33. Holds if every setting has a budget at which the errors on X, Y and Z are "
        "all about linear. Holds when … if only some settings have one, or if only the distance between tool and spot is about "
        "linear. Otherwise it does not hold."
    )
    if dls.is_empty():
        return Finding("c", claim, UNTESTED, "The run has no spots with dls.", rule)
    fits = {str(setting): dict(_fits(part)) for (setting,), part in dls.group_by("setting", maintain_order=True)}
    if not any(fits.values()):
        why = f"No budget has {12 * LEAST_IN_BIN} trials in which the iteration's own error is the largest part."
        return Finding("c", claim, UNTESTED, why, rule)
    return Finding("c", claim, linear_verdict(fits), linear_words(fits), rule, fit_figures(fits))


def _fits(rows: pl.DataFrame) -> Iterator[tuple[int, dict[str, Fit]]]:
    done = rows.filter(pl.col("position_error").is_not_null())
    for (budget,), part in done.sort("budget").group_by("budget", maintain_order=True):
        if len(part) >= 12 * LEAST_IN_BIN and _iteration_leads(part):
            yield int(budget), {c: fit(part["distance"].to_numpy(), np.abs(part[c].to_numpy())) for c in JUDGED_ERRORS}


def _iteration_leads(part: pl.DataFrame) -> bool:
    """Return whether the error of the iteration exceeds the sum of all others in most trials."""
    others = part.select(rest=pl.sum_horizontal(*OTHER_PARTS))["rest"]
    return bool((part["ik_error"] > others).mean() > 0.5)  # type: ignore[operator]
