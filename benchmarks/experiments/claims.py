"""The claims of the paper on executed motions, on parameters of the iteration and on the line, from the data of a run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl

from benchmarks.experiments import workspace
from benchmarks.experiments.base import FAILS, HOLDS, PARTLY, UNTESTED, Finding
from benchmarks.experiments.workspace import ALMOST_ALL, JUDGED_ERRORS, TWO_MM, Fit, fit_line, nearest_that_hold
from benchmarks.records import RunFolder
from benchmarks.statistics import wilson

# ---------------- the paper's claims about the workspace on executed motions


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
    if len(needed) < 10 * workspace.LEAST_IN_BIN:
        return Finding("b", claim, UNTESTED, f"Only {len(needed)} trials are within 2 mm: too few to judge.", rule)
    far, took = needed["distance"].to_numpy(), needed["needed"].to_numpy()
    if len(set(took.tolist())) == 1:
        return Finding("b", claim, FAILS, f"All {len(needed):,} trials need {took[0]} iterations.", rule)
    rank = workspace.rank_over_distance(far, took, "trials")
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
        why = f"No budget has {12 * workspace.LEAST_IN_BIN} trials in which the iteration's own error is the largest part."
        return Finding("c", claim, UNTESTED, why, rule)
    return Finding(
        "c", claim, workspace.linear_verdict(fits), workspace.linear_words(fits), rule, workspace.fit_figures(fits)
    )


def _fits(rows: pl.DataFrame) -> Iterator[tuple[int, dict[str, Fit]]]:
    done = rows.filter(pl.col("position_error").is_not_null())
    for (budget,), part in done.sort("budget").group_by("budget", maintain_order=True):
        if len(part) >= 12 * workspace.LEAST_IN_BIN and _iteration_leads(part):
            yield (
                int(budget),
                {c: fit_line(part["distance"].to_numpy(), np.abs(part[c].to_numpy())) for c in JUDGED_ERRORS},
            )


def _iteration_leads(part: pl.DataFrame) -> bool:
    """Return whether the error of the iteration exceeds the sum of all others in most trials."""
    others = part.select(rest=pl.sum_horizontal(*OTHER_PARTS))["rest"]
    return bool((part["ik_error"] > others).mean() > 0.5)  # type: ignore[operator]


# ---------------- claims about the parameters of the iteration and its start


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


# ---------------- claims about the line


BARELY = 1e-9
"""Jumps of q [rad], q̇ [rad/s] and q̈ [rad/s²] at knots up to this size are rounding."""

ROUNDING = 1e-12
"""Jumps up to this [rad, rad/s, rad/s²] are rounding of double precision: reports write ≤ this."""

ON_LINE_M, ON_LINE_RAD = 1e-4, np.deg2rad(0.01)
"""Largest distance [m] and angle [rad] at which the tool counts as on the line at constant orientation."""


def quintic_row(folder: RunFolder) -> dict[str, Any] | None:
    """Return the row of the first motion with the time law of the paper, along a line that is shown in detail."""
    blocks = [one for one in folder.manifest()["settings"].get("timing", []) if one.get("detail")]
    for block in blocks:
        rows = folder.rows("timing", block["id"])
        found = [] if rows is None else rows.filter(method="quintic", status="solved").head(1).to_dicts()
        if found:
            return found[0] | {"samples": block.get("samples", 151)}
    return None


def smooth_joints(folder: RunFolder) -> Finding:
    """Claim (f): quintic segments give smooth joint motion."""
    claim = "Quintic segments between the samples give smooth joint motion without jumps."
    rule = (
        "Exact one-sided values at the knots. Holds if position, velocity and acceleration are continuous, and velocity, "
        "acceleration and jerk are within the limits of the robot. Holds when smooth means continuous acceleration if they are "
        "continuous but exceed a limit. Does not hold if one of them is discontinuous."
    )
    plan = quintic_row(folder)
    if plan is None:
        return Finding("f", claim, UNTESTED, "The run has no solved line with the quintic law.", rule)
    jumps = dict(zip(("position", "velocity", "acceleration", "jerk"), plan["jumps"], strict=True))
    smooth = all(jumps[k] <= BARELY for k in ("position", "velocity")) and plan["continuous"] >= 2
    worst = {f: _worst(plan, f) for f in ("velocity", "acceleration", "jerk")}
    figures = (
        ("discontinuity of position at knots", _jump(jumps["position"], "rad")),
        ("discontinuity of velocity at knots", _jump(jumps["velocity"], "rad/s")),
        ("discontinuity of acceleration at knots", _jump(jumps["acceleration"], "rad/s²")),
        ("discontinuity of jerk at knots and at the start", f"{jumps['jerk']:.0f} rad/s³"),
        *((f"peak {f} / limit", words) for f, (_, words) in worst.items()),
    )
    text = (
        f"Position, velocity and acceleration are continuous to rounding. But going from rest to full speed within one "
        f"sample takes {worst['acceleration'][0]:.1f} times the acceleration limit and {worst['jerk'][0]:.0f} times the jerk "
        f"limit. The jerk changes at the knots by up to {jumps['jerk']:.0f} rad/s³."
    )
    if not smooth:
        return Finding("f", claim, FAILS, "The motion is discontinuous at its knots.", rule, figures)
    if all(ratio <= 1.0 for ratio, _ in worst.values()):
        return Finding("f", claim, HOLDS, "Continuous and within every limit.", rule, figures)
    return Finding("f", claim, f"{PARTLY} smooth means continuous acceleration", text, rule, figures)


def on_the_line(folder: RunFolder) -> Finding:
    """Claim (g): the tool stays on the line at constant orientation."""
    claim = "The tool stays on the straight line at constant orientation."
    rule = (
        "The largest deviation of the tool from line and orientation, a bound that holds at every instant. Holds within 0.1 mm "
        "and 0.01°. Holds when only the samples count if the tool is that near at the samples but not between them. "
        "Otherwise it does not hold."
    )
    plan = quintic_row(folder)
    if plan is None:
        return Finding("g", claim, UNTESTED, "The run has no solved line with the quintic law.", rule)
    figures = (
        ("largest distance from the line", f"{1e6 * plan['distance']:.3g} µm at t = {plan['distance_time']:.3f} s"),
        (
            "largest rotation from the constant orientation",
            f"{1e6 * plan['angle']:.3g} µrad at t = {plan['angle_time']:.3f} s",
        ),
        (
            "largest IK error at samples, before refinement",
            f"{1e6 * plan['ik_position_error']:.3g} µm, {1e6 * plan['ik_rotation_error']:.3g} µrad",
        ),
    )
    text = (
        f"The tool is never more than {1e6 * plan['distance']:.2g} µm off the line and {1e6 * plan['angle']:.2g} µrad off its "
        f"orientation over {1e3 * plan['length']:.0f} mm, with {plan['samples']} samples."
    )
    if plan["distance"] <= ON_LINE_M and plan["angle"] <= ON_LINE_RAD:
        verdict = HOLDS
    else:
        near = plan["ik_position_error"] <= ON_LINE_M and plan["ik_rotation_error"] <= ON_LINE_RAD
        verdict = f"{PARTLY} only the samples count" if near else FAILS
    return Finding("g", claim, verdict, text, rule, figures)


def _jump(size: float, unit: str) -> str:
    """Format a discontinuity with its unit; one up to `ROUNDING` is not a result."""
    return f"≤ 1e-12 {unit}" if size <= ROUNDING else f"{size:.1g} {unit}"


def _worst(plan: dict[str, Any], field: str) -> tuple[float, str]:
    ratio = float("nan") if plan[field] is None else float(plan[field])
    return ratio, f"{ratio:.3g} ({plan[f'{field}_joint']} at t = {plan[f'{field}_time']:.4f} s)"


# ---------------- the claims of the paper


CLAIMS = (
    workspace.within_two_millimetres,
    workspace.more_iterations,
    workspace.linear_error,
    damping_trade,
    start_and_step,
    smooth_joints,
    on_the_line,
)
"""Claims in the order of the report."""


def judge_claims(folder: RunFolder) -> list[Finding]:
    """Return the findings on all claims; a claim without data in the run is "not tested"."""
    return [claim(folder) for claim in CLAIMS]
