"""Logs under the headers of many programs, in several units: the motion that was written, or a refusal that names a way out.

A style is a name of the column of times, or the names of the columns of joints. Each file has a random motion in random units.
The oracle is the motion that the script wrote. The unit is stated by the header, by the size of the times, or by ``unit=``.
"""

from __future__ import annotations

import re
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np

import optik
import planners
from optik.errors import AssumptionWarning, InvalidInput
from tests.figures.figure import Row, Value, main

CLOCKS = (
    "t", "time", "times", "timestamp", "__time", "%time", "sec", "secs", "seconds", "elapsed", "stamp", "time_from_start",
    "header.stamp", "/joint_states/header/stamp", "Time (s)", "t_ms", "time[ns]", "timestamp_us", "elapsed_s",
    "field.header.stamp", "header.stamp.sec,header.stamp.nanosec", "recv_timestamp",
)  # fmt: skip
"""Columns of times."""
JOINTS = (
    "{name}", "{name}.pos", "{name}_pos", "/joint_states/{name}/position", "q_{name}", "position_{name}", "{name}.position",
    "pos_{name}", "joint_states.{name}.q", "q{i1}", "q_{i0}", "J{i1}", "A{i1}", "joint_{i1}", "actual_q_{i0}", "q[{i0}]",
    "field.position{i0}", "state/actual/positions[{i0}]",
)  # fmt: skip
"""Columns of positions: by the joint's name, or by its number from 0 or 1."""
RATES = {"q": "qd", "pos": "vel", "position": "velocity", "positions": "velocities"}
"""Words of velocities beside those of positions."""
FILES, ROWS = 10, 8
UNITS = [(time, angle) for time in ("s", "ms", "ns") for angle in ("rad", "deg")]
SIZES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "rad": 1.0, "deg": np.pi / 180.0}
COUNT = (len(CLOCKS) + len(JOINTS)) * FILES * len(UNITS)
NAMES = ("shoulder", "elbow", "wrist")
JOINT = (
    '<link name="l{0}"/><joint name="{2}" type="revolute"><parent link="l{1}"/><child link="l{0}"/><axis xyz="0 0 1"/>'
    '<origin xyz="0.3 0 0"/><limit lower="-3" upper="3" velocity="2" effort="9"/></joint>'
)
ARM = f'<robot name="arm"><link name="l0"/>{"".join(JOINT.format(i + 1, i, name) for i, name in enumerate(NAMES))}</robot>'
STATED = re.compile(r"(?:^|[_ (\[.])(s|ms|us|ns|sec|secs|seconds|nanosec)[)\]]?$")
"""The unit in a column of times."""


class Log:
    """A random log: its text, the motion in SI units, the options that read it, and whether units are stated."""

    def __init__(self, case: int) -> None:
        rng = np.random.default_rng([20261128, case])
        style, rest = divmod(case, FILES * len(UNITS))
        self.time, self.angle = UNITS[rest % len(UNITS)]
        clock = CLOCKS[style] if style < len(CLOCKS) else str(rng.choice(["t", "timestamp", "__time"]))
        joint = (
            JOINTS[style - len(CLOCKS)] if style >= len(CLOCKS) else str(rng.choice(["{name}", "q{i1}", "{name}.pos"]))
        )
        began = 0 if clock == "time_from_start" else int(rng.choice([0, 70, 1_700_000_000]))
        self.t = np.append(0.0, np.cumsum(np.round(rng.uniform(0.1, 0.5, ROWS - 1), 6)))
        self.q = [rng.uniform(-2.5, 2.5, (ROWS, len(NAMES)))]
        self.options: dict[str, Any] = {}
        stated = STATED.search(clock)
        if "," in clock or clock == "%time":
            self.time = "s" if "," in clock else "ns"
        elif stated:
            self.time = {"sec": "s", "secs": "s", "seconds": "s"}.get(stated[1], stated[1])
        ticks = [began * 10**9 + round(x * 1e9) for x in self.t]
        cells = {clock: [str(x) if self.time == "ns" else self._divide(x) for x in ticks]}
        if "," in clock:
            cells = dict(
                zip(clock.split(","), zip(*(map(str, divmod(x, 10**9)) for x in ticks), strict=True), strict=True)
            )
        self.knows_time = bool(stated) or clock == "%time" or self.time == "s" or (self.time == "ns" and began > 1e9)
        if not self.knows_time and rng.random() < 0.5:
            self.options["unit"], self.knows_time = [self.time], True
        words = set(re.findall(r"[a-z]+", joint)) & set(RATES)
        kinds = [joint]
        if words and rng.random() < 0.5:
            kinds.append(re.sub(words.copy().pop(), RATES[words.pop()], joint))
            self.q.append(rng.uniform(-1.0, 1.0, (ROWS, len(NAMES))))
        where = "header" if rng.random() < 0.34 else "option" if rng.random() < 0.5 else ""
        self.knows_angle = bool(where) or self.angle == "rad"
        if where == "option":
            self.options["unit"] = [*self.options.get("unit", []), self.angle]
        style = str(rng.choice(["_{}", " [{}]", "({})"]))
        for k, (kind, q) in enumerate(zip(kinds, self.q, strict=True)):
            for i, name in enumerate(NAMES):
                head = kind.format(name=name, i0=i, i1=i + 1)
                head += style.format(self.angle + "/s" * k) if where == "header" else ""
                cells[head] = [repr(float(x)) for x in q[:, i] / SIZES[self.angle]]
        order = rng.permutation(len(cells))
        heads = [list(cells)[i] for i in order]
        self.text = (
            "\n".join([";".join(heads), *(";".join(row) for row in zip(*(cells[h] for h in heads), strict=True))])
            + "\n"
        )

    def _divide(self, ticks: int) -> str:
        """Return whole nanoseconds as a decimal in the unit of the times."""
        digits = {"s": 9, "ms": 6, "us": 3}[self.time]
        whole, part = divmod(ticks, 10**digits)
        return f"{whole}.{part:0{digits}d}"


def measure(case: int) -> Row:
    """One log."""
    made = Log(case)
    row: Row = {"head": made.text.splitlines()[0], "time": made.time, "angle": made.angle, "options": made.options}
    row |= {"stated": made.knows_time and made.knows_angle, "words": "", "off": np.inf, "notes": ""}
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", AssumptionWarning)
        (arm := Path(folder) / "arm.urdf").write_text(ARM)
        (file := Path(folder) / "log.csv").write_text(made.text)
        try:
            found = planners.load_trajectory(file, optik.load(arm), **made.options)
        except InvalidInput as error:
            return row | {"words": str(error).replace(folder, "")}
    row["notes"] = "; ".join(found.notes)
    time, angle = 1.0 if made.knows_time else SIZES[made.time], 1.0 if made.knows_angle else SIZES[made.angle]
    if found.knots.size == ROWS:
        off = [found.knots * time / made.t[-1] - made.t / made.t[-1]]
        off += [found(found.knots, order) * angle - q for order, q in enumerate(made.q)]
        row["off"] = float(max(np.abs(x).max() for x in off))
    return row


def judge(rows: list[Row]) -> list[Value]:
    """The figures."""
    stated, others = [row for row in rows if row["stated"]], [row for row in rows if not row["stated"]]
    wrong = [row for row in stated if not row["words"] and not row["off"] <= 1e-9]
    lost = [row for row in stated if row["words"]]
    plain = [row for row in others if row["off"] <= 1e-9 and "no units in the header" in row["notes"]]
    refused = [row for row in others if re.search(r"log\.csv, line \d.*unit=", row["words"])]
    bad = [row for row in others if row not in plain and row not in refused]
    for row in (wrong + lost + bad)[:5]:
        print(f"  {row}")
    return [
        Value("units stated: misread", "0", f"{len(wrong)} of {len(stated)}", not wrong),
        Value("units stated: refused", "0", f"{len(lost)} of {len(stated)}", not lost),
        Value("others: neither read as s and rad with the note, nor refused by line with unit=", "0",
              f"{len(bad)} of {len(others)} ({len(plain)} read, {len(refused)} refused)", not bad),
    ]  # fmt: skip


if __name__ == "__main__":
    main("headers", measure, COUNT, judge)
