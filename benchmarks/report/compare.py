"""Comparison of two runs: each method with itself, better, worse or within noise, by tests for each type of value.

Two folders of ``optik bench run --against`` have the same times from several fresh processes, which ran alternately: their
times are judged by the interval of the median ratio.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from benchmarks.blocks.base import Field, Kind
from benchmarks.blocks.block import Block
from benchmarks.provenance import REFERENCE_LOOPS
from benchmarks.records import RunFolder, slug
from benchmarks.report.base import Run
from benchmarks.report.tables import quote_label
from benchmarks.run.against import LEAST_PROCESSES, process_folders
from benchmarks.statistics import holm, mcnemar, ratio_interval, signed_rank, wilson
from optik.errors import InvalidInput
from optik.plugins.files import forbid_code
from optik.types import Array

BETTER_VERDICT, WORSE_VERDICT, NOISE_VERDICT, MACHINE_VERDICT = "better", "worse", "within noise", "the machine"
"""Verdicts. The last is of a time that changed where the reference computation did not take the same time in both runs."""

WORK, SECONDS = {"short": 2e-4, "middle": 4e-3, "long": math.inf}, {"µs": 1e-6, "ms": 1e-3, "s": 1.0}
"""Work that takes less [s] is compared with this reference computation; and the units of times [s]."""
SAME_SPEED = 0.05
"""Relative difference of the reference computation in two runs that counts as the same speed of the machine."""

CLOCK_NOISE = 0.15
"""Relative change of a time that two runs of the same code on a shared machine show."""

NARROW = 3.0
"""Width of the 95 % interval [%] at which no further processes are needed; a change of a time below it is noise."""

FALSE_ALARMS = 0.05
"""Probability that a comparison of two runs without any difference calls anything better or worse."""

UNCHANGED = 1e-6
"""Relative difference of two values that counts as no change: iterative laws stop within it."""


@dataclass(frozen=True)
class Difference:
    """One measure of one method in both runs."""

    block: str
    label: str
    measure: str
    unit: str
    a: float
    b: float
    """Values in the runs: shares in percent, medians of all else."""
    change: float
    """From the first run to the second: percentage points of a share, percent of all else."""
    low: float = math.nan
    high: float = math.nan
    """Ends of the 95 % interval of the change; NaN where there is none."""
    pairs: int = 0
    """Problems that both runs have; 0 where a problem has several rows."""
    p: float = math.nan
    """p-value of the paired test, corrected for all that are compared; NaN where there is none."""
    noise: float = 0.0
    """Change [%] that rounds of the same calls show."""
    machine: float = 1.0
    """Time of the reference computation in the second run over that in the first; 1 where the measure is no time, NaN where
    it is not known."""
    verdict: str = NOISE_VERDICT
    loss: float = 0.0
    """By how much it is worse, in the units of `change`; negative where it is better."""


class SettingDifference(NamedTuple):
    """A setting of a suite that is not the same in two runs: its key, and its value in each; None where it is not set."""

    key: str
    a: Any
    b: Any


@dataclass(frozen=True)
class Comparison:
    """A comparison of two runs: differences, different settings, and the parts that could not be compared with the reason."""

    differences: tuple[Difference, ...]
    left_out: tuple[str, ...]
    settings: tuple[SettingDifference, ...] = ()

    def worse_than(self, threshold: float) -> list[Difference]:
        """Return the measures that are worse beyond noise by more than a threshold."""
        return [d for d in self.differences if d.verdict == WORSE_VERDICT and d.loss > threshold]


@forbid_code()
def compare_runs(a: Run, b: Run) -> Comparison:
    """Compare the blocks that two runs have in common."""
    left_out: list[str] = []
    found = list(_differences(a, b, left_out))
    if not found:
        why = "; ".join(left_out) or "no block of one is a block of the other"
        raise InvalidInput(
            "runs", f"{a.folder.path} and {b.folder.path} ({why})", "two runs with a block of the same problems"
        )
    corrected = holm([d.p for d, _, _ in found])
    judged = tuple(_judged(d, m, p, far) for (d, m, far), p in zip(found, corrected, strict=True))
    return Comparison(judged, tuple(left_out), tuple(different_settings(a, b)))


def different_settings(a: Run, b: Run) -> list[SettingDifference]:
    """Return the settings of two suites that differ; blocks and methods are matched by their id, label or name."""
    first, second = (dict(_flat(run.manifest["settings"], "")) for run in (a, b))
    keys = (key for key in {**first, **second} if first.get(key) != second.get(key))
    return [SettingDifference(key, first.get(key), second.get(key)) for key in keys]


def _flat(value: Any, key: str) -> Iterator[tuple[str, Any]]:
    """Yield keys such as ``speed[ik].methods[lm].options.max_restarts`` with their values."""
    if isinstance(value, dict) and value:
        for name, inner in value.items():
            yield from _flat(inner, f"{key}.{name}" if key else str(name))
    elif isinstance(value, list) and any(isinstance(one, dict) for one in value):
        for i, one in enumerate(value):
            names = (one.get(k) for k in ("id", "label", "solver", "law", "peer")) if isinstance(one, dict) else ()
            yield from _flat(one, f"{key}[{next((n for n in names if n), i)}]")
    else:
        yield key, value


def _differences(a: Run, b: Run, left_out: list[str]) -> Iterator[tuple[Difference, Field, bool]]:
    """Yield every difference, and whether unpaired values differ by more than their noise."""
    others = {(kind.name, block.id): block for kind, block in b.suite.pairs()}
    for kind, block in a.suite.pairs():
        other = others.pop((kind.name, block.id), None)
        if other is None:
            left_out.append(f"{block.id}: only in the first run")
        elif not kind.compared:
            left_out.append(f"{block.id}: its kind of block, {kind.name}, does not say what to compare")
        else:
            yield from _of_block(kind, (a, block), (b, other), left_out)
    left_out += [f"{id}: only in the second run" for _, id in others]


def _of_block(
    kind: Kind, first: tuple[Run, Block], second: tuple[Run, Block], left_out: list[str]
) -> Iterator[tuple[Difference, Field, bool]]:
    (a, block), (b, other) = first, second
    read = [(one, kind.rows(run.folder, one)) for run, one in (first, second)]
    there = [kind.compared_rows(one, rows) for one, rows in read if rows is not None]
    if len(there) < 2:
        left_out.append(f"{block.id}: not run in both")
        return
    x, y = there
    if (why := different_problems(a, kind, block, b, other)) is not None:
        left_out.append(f"{block.id}: {why}")
        return
    machines = _compare_machines(a, b, kind.file(block))
    alternated = process_rows(kind, (a.folder, block), (b.folder, other))
    labels = x["method"].unique(maintain_order=True).to_list()
    theirs = set(y["method"])
    missing = [label for label in labels if label not in theirs] + sorted(theirs - set(labels))
    left_out += [f"{block.id}: {quote_label(label)} is in one run only" for label in missing]
    for label in (label for label in labels if label in theirs):
        for name, field in kind.compared.items():
            mine, other_rows = (frame.filter(pl.col("method") == label) for frame in (x, y))
            if field.clock and alternated:
                difference = _alternated(label, name, field, alternated)
            elif name in mine.columns and name in other_rows.columns:
                difference = _difference(name, field, mine, other_rows, machines)
            else:
                continue
            if difference is not None:
                yield replace(difference[0], block=block.id, label=str(label)), field, difference[1]


def different_problems(a: Run, kind: Kind, block: Block, b: Run, other: Block) -> str | None:
    """Return why two blocks are not known to have the same problems, or None: both hashes must be there and equal."""
    made = [run.manifest.get("problems", {}).get(f"{kind.name}/{one.id}") for run, one in ((a, block), (b, other))]
    if None in made:
        return "a run of an older version has no hash of its problems, so that they are taken as different"
    stored = [run.folder.read_json(f"problems/{slug(one.id)}.json") or {} for run, one in ((a, block), (b, other))]
    whole = stored[0].get("sha256_of") == stored[1].get("sha256_of")  # not where motions are still to be sampled
    if made[0] != made[1] or (whole and stored[0].get("sha256") != stored[1].get("sha256")):
        return "the problems differ"
    return None


RowPair = tuple[pl.DataFrame, pl.DataFrame]
"""Rows of a block from the processes of two interpreters that ran one after the other."""


def process_rows(kind: Kind, first: tuple[RunFolder, Block], second: tuple[RunFolder, Block]) -> list[RowPair]:
    """Return the rows of a block from the alternate processes of two folders; none for folders that were made apart."""
    tokens = [folder.manifest().get("alternated") for folder, _ in (first, second)]
    if tokens[0] is None or tokens[0] != tokens[1]:
        return []
    rows = [
        [kind.compared_rows(block, one) for at in process_folders(folder, kind, block)
         if (one := kind.rows(RunFolder(at), block)) is not None]
        for folder, block in (first, second)
    ]  # fmt: skip
    return list(zip(*rows, strict=False))


def is_settled(kind: Kind, block: Block, first: RunFolder, second: RunFolder) -> bool:
    """Say whether the interval of each median ratio of times is narrower than `NARROW`."""
    pairs = process_rows(kind, (first, block), (second, block))
    if len(pairs) < LEAST_PROCESSES:
        return False
    found = [
        _alternated(label, name, field, pairs)
        for label in pairs[0][0]["method"].unique().to_list()
        for name, field in kind.compared.items()
        if field.clock
    ]
    return all(one is None or one[0].high - one[0].low < NARROW for one in found)


def _alternated(label: str, column: str, measure: Field, pairs: Sequence[RowPair]) -> tuple[Difference, bool] | None:
    """Return the median ratio of a time over pairs of processes, and whether its interval is beyond `NARROW`."""
    from scipy.stats import quantile_test

    medians = []
    for pair in pairs:
        x, y = (frame.filter(pl.col("method") == label) for frame in pair)
        matched = _matched(measure, x, y, column) if column in x.columns and column in y.columns else None
        if matched is not None:
            medians.append([float(np.median(frame[column].to_numpy())) for frame in matched[:2]])
    if not medians:
        return None
    a, b = measure.scale * np.array(medians).T
    interval = quantile_test(b / a, p=0.5).confidence_interval()  # of order statistics: valid for any distribution
    change, low, high = (_percent(float(one)) for one in (np.median(b / a), interval.low, interval.high))
    base = Difference("", "", measure.words, measure.unit, float(np.median(a)), float(np.median(b)), change, low, high)
    return replace(base, pairs=len(medians)), low > NARROW or high < -NARROW


class MachineChange(NamedTuple):
    """Time of a reference computation in the second run over that in the first, and the larger spread within a run."""

    ratio: float = math.nan
    spread: float = 0.0


def _compare_machines(a: Run, b: Run, file: str) -> dict[str, MachineChange]:
    """Return the change of each reference computation beside a block."""
    before, after = (run.manifest.get("reference", {}).get(file, []) for run in (a, b))
    found = {}
    for name in (f"{loop}{clock}" for loop in REFERENCE_LOOPS for clock in ("", "_cpu")) if before and after else ():
        x, y = (np.array([one[name] for one in times]) for times in (before, after))
        spread = max(float(np.diff(np.quantile(v, (0.1, 0.9)))[0] / np.median(v)) for v in (x, y))
        found[name] = MachineChange(float(np.median(y) / np.median(x)), spread)
    return found


def _difference(
    column: str, measure: Field, a: pl.DataFrame, b: pl.DataFrame, machines: dict[str, MachineChange]
) -> tuple[Difference, bool] | None:
    """Return one measure of one label; None if there is nothing to compare."""
    matched = _matched(measure, a, b, column)
    if matched is None:
        return None
    a, b, repeated = matched
    x, y = (frame[column].to_numpy() for frame in (a, b))
    pairs = 0 if repeated else len(a)
    if measure.exact or (pairs == 1 and not measure.clock):
        return _exact(measure, measure.scale * x.astype(float), measure.scale * y.astype(float), pairs)
    if measure.is_share:
        return _shares(measure, x, y, pairs)
    x, y = measure.scale * x.astype(float), measure.scale * y.astype(float)
    noise = max(_spread(column, measure, frame) for frame in (a, b))
    if repeated:
        noise = max(noise, *((float(v.max() - v.min()) / float(np.median(v))) for v in (x, y)))
    seconds = float(np.median(x)) * SECONDS.get(measure.unit, 1.0)
    if not measure.clock:
        return _values(measure, x, y, pairs, noise, 1.0)
    loop, clock = next(name for name, most in WORK.items() if seconds < most), "_cpu" if measure.clock == "cpu" else ""
    machine = machines.get(loop + clock, MachineChange())
    return _values(measure, x, y, pairs, max(noise, machine.spread, CLOCK_NOISE), machine.ratio)


def _matched(
    measure: Field, a: pl.DataFrame, b: pl.DataFrame, column: str
) -> tuple[pl.DataFrame, pl.DataFrame, bool] | None:
    """Return the rows that are compared, and whether a problem has several; None if there are none.

    They are of the problems that both runs have, in the same order, where `only` is true in both.
    """
    repeated = any(frame["problem"].is_duplicated().any() for frame in (a, b))
    a, b = (frame.filter(pl.col(column).is_not_null()) for frame in (a, b))
    if measure.only:
        a, b = a.filter(measure.only), b.filter(measure.only)
    if not repeated:
        a, b = (x.join(y, on="problem", how="semi").sort("problem") for x, y in ((a, b), (b, a)))
    return None if a.is_empty() or b.is_empty() else (a, b, repeated)


def _spread(column: str, measure: Field, rows: pl.DataFrame) -> float:
    """Return the relative spread of the rounds of a call: the median over all calls."""
    if not measure.rounds or not set(measure.rounds) <= set(rows.columns):
        return 0.0
    timed = rows.filter(pl.all_horizontal(pl.col(column, *measure.rounds) > 0))
    if timed.is_empty():
        return 0.0
    value, least, most = (timed[name].to_numpy().astype(float) for name in (column, *measure.rounds))
    return float(np.median((most - least) / value))


def _shares(measure: Field, x: Array, y: Array, pairs: int) -> tuple[Difference, bool]:
    before, after = (100.0 * float(v.mean()) for v in (x, y))
    base = Difference("", "", measure.words, measure.unit, before, after, after - before, pairs=pairs)
    if pairs:
        return replace(base, p=mcnemar(y, x).p), False
    (low_a, high_a), (low_b, high_b) = (wilson(int(v.sum()), len(v)) for v in (x, y))
    return base, low_a > high_b or low_b > high_a


def _values(measure: Field, x: Array, y: Array, pairs: int, noise: float, machine: float) -> tuple[Difference, bool]:
    a, b = float(np.median(x)), float(np.median(y))
    base = Difference("", "", measure.words, measure.unit, a, b, 0.0, pairs=pairs, noise=100.0 * noise, machine=machine)
    if pairs and (x > 0).all() and (y > 0).all():
        ratio, low, high = ratio_interval(y, x)
        p = 1.0 if np.array_equal(x, y) else signed_rank(y, x)
        return replace(base, change=_percent(ratio), low=_percent(low), high=_percent(high), p=p), False
    ratio = b / a if a else math.nan
    apart = float(y.min()) > float(x.max()) or float(y.max()) < float(x.min())
    return replace(base, change=_percent(ratio)), apart and len(x) > 1 and len(y) > 1


def _exact(measure: Field, x: Array, y: Array, pairs: int) -> tuple[Difference, bool]:
    """Compare values without noise: a change beyond rounding counts."""
    a, b = (100.0 * float(v.mean()) if measure.is_share else float(np.median(v)) for v in (x, y))
    change = b - a if measure.is_share else _percent(b / a if a else math.nan)
    base = Difference("", "", measure.words, measure.unit, a, b, change, pairs=pairs)
    return base, not math.isclose(a, b, rel_tol=UNCHANGED)


def _percent(ratio: float) -> float:
    return 100.0 * (ratio - 1.0)


def _judged(d: Difference, measure: Field, p: float, apart: bool) -> Difference:
    """Return the verdict: a difference must be significant in its test and exceed the spread of repeated rounds."""
    loss = d.change if measure.better == "less" else -d.change
    verdict = NOISE_VERDICT
    if (apart if math.isnan(p) else p < FALSE_ALARMS) and abs(d.change) > d.noise:
        verdict = WORSE_VERDICT if loss > 0 else BETTER_VERDICT
        if not abs(d.machine - 1.0) <= SAME_SPEED:  # nor where it is not known
            verdict = MACHINE_VERDICT
    return replace(d, p=p, loss=loss, verdict=verdict)


def as_data(d: Difference) -> dict[str, Any]:
    """Return a difference as plain data for JSON."""
    return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in vars(d).items()}
