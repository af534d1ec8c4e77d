"""Random tables of waypoints and of trajectories: the numbers that were written, or a refusal with the place and a way out.

Each table has a random separator, decimal mark, header, order of columns, units, extra columns, comments and line ends. A table
that is complete and unambiguous must be read; every other one must be refused. The oracle is the numbers that were written.
"""

from __future__ import annotations

import re
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import optik
import planners
from optik.errors import AssumptionWarning, InvalidInput
from tests.figures.figure import Row, Value, main

COUNT = 500
ROWS = 6
UNITS = {"m": 1.0, "mm": 1e3, "cm": 100.0, "rad": 1.0, "deg": 180.0 / np.pi, "s": 1.0, "ms": 1e3, "": 1.0}
"""Units of columns, per SI unit."""
HELP = r"ignore=|columns=|unit=|separator|decimal|a unit for each|header line|start=|one for each column"
"""What messages offer: an argument, or a change of the file."""
JOINT = (
    '<link name="l{0}"/><joint name="j{0}" type="revolute"><parent link="l{1}"/><child link="l{0}"/><axis xyz="0 0 1"/>'
    '<origin xyz="0.3 0 0"/><limit lower="-3" upper="3" velocity="2" effort="9"/></joint>'
)
ARM = f'<robot name="arm"><link name="l0"/>{"".join(JOINT.format(i, i - 1) for i in (1, 2, 3))}</robot>'
"""An arm with three joints."""


class Drawn:
    """A random table: its text, its numbers in SI units by column, the arguments that read it, and why it is refused."""

    def __init__(self, case: int, kinds: list[tuple[str, tuple[str, ...]]], columns: dict[str, Any]) -> None:
        rng = np.random.default_rng([41, case])
        self.rng, self.refused, self.options = rng, "", dict[str, Any]()
        self.digits, self.columns = int(rng.integers(3, 17)), {}
        names, cells = [], []
        separator, comma = str(rng.choice([",", ";", "\t", " "])), bool(rng.random() < 0.4)
        header, bare, written = rng.random() < 0.75, rng.random() < 0.35, 1.0
        for units, group in kinds:
            unit = "" if not units or not header or rng.random() < 0.4 else str(rng.choice(units.split()))
            written = written if group[:1] == ("dq_j1",) else UNITS[unit]  # rates have the unit of the positions
            if "mm" in units and not unit and rng.random() < 0.4:  # lengths whose unit only the writer knows
                written = UNITS["mm"]
                self.options |= {"unit": "mm"} if rng.random() < 0.6 else {}
                self.refused = "" if self.options else "millimetres called x"
            style = rng.choice(
                [f"_{unit}", f" [{unit}]", f"({unit})"] if separator != " " else [f"_{unit}", f"({unit})"]
            )
            for name in group:
                word = [f"{x * written:.{self.digits}f}" for x in columns[name]]
                self.columns[name] = np.array([float(x) for x in word]) / written
                names.append(f"{name}{style}" if unit else name)
                cells.append([x.replace(".", ",") if comma else x for x in word])
        extras = [str(x) for x in rng.choice(["feed", "flag", "n1", "remark"], rng.integers(0, 3), replace=False)]
        for name in extras:
            names.append(name)
            cells.append([str(rng.choice(["a", "ok", "b.c"])) if name == "remark" else f"{i}" for i in range(ROWS)])
        order = rng.permutation(len(names))
        self.names, rows = [names[i] for i in order], np.array(cells)[order].T
        quoted = separator == "," and comma and rng.random() < 0.5
        lines = [separator.join(f'"{x}"' if quoted else x for x in row) for row in rows]
        if separator == "," and comma:
            self.refused = self.refused or "decimal commas between commas"
        if not header:
            if bare and not self.refused:
                self.refused = "no header"
            else:
                self.options["columns"] = self.names
        else:
            lines.insert(0, separator.join(self.names))
            if rng.random() < 0.2 and not self.refused:  # renamed by the caller
                self.options["columns"], lines[0] = self.names, separator.join(f"c{i}" for i in range(len(names)))
        if rng.random() < 0.1 and separator in ",;":
            lines = [f"{line}{separator}" for line in lines]
        if extras and (bare or self.refused):
            self.refused = self.refused or "extra columns"
        elif extras:
            self.options["ignore"] = extras
        if rng.random() < 0.06 and separator == ";" and not comma:
            lines[-1], self.refused = lines[-1].replace(".", ",", 1), "two decimal marks"
        if rng.random() < 0.06 and not lines[-1].endswith(separator):
            lines[-1], self.refused = lines[-1].rpartition(separator)[0], self.refused or "a cell is missing"
        lines = ["# made by a program", *lines] if rng.random() < 0.3 else lines
        end = str(rng.choice(["\n", "\r\n"]))
        self.text = str(rng.choice(["", "\ufeff"])) + end.join(lines) + end


def draw_seam(case: int, rng: np.random.Generator) -> tuple[list[tuple[str, tuple[str, ...]]], dict[str, Any]]:
    """Draw the columns of waypoints at 0.25 to 0.9 m, with one kind of orientation."""
    p = rng.normal(size=(ROWS, 3))
    p *= rng.uniform(0.25, 0.9, (ROWS, 1)) / np.linalg.norm(p, axis=1)[:, None]
    turned = Rotation.from_rotvec(0.3 * rng.normal(size=(ROWS, 3)))
    values = {
        "": np.empty((ROWS, 0)), "qx qy qz qw": turned.as_quat(), "roll pitch yaw": turned.as_euler("ZYX")[:, ::-1],
        "rx ry rz": turned.as_rotvec(), "i j k": -turned.as_matrix()[:, :, 2] * rng.uniform(0.5, 2.0, (ROWS, 1)),
        "nx ny nz": -turned.as_matrix()[:, :, 2],
    }  # fmt: skip
    kind = list(values)[case // 2 % len(values)]
    group = tuple(kind.split())
    kinds = [("m mm cm", ("x", "y", "z")), ("rad deg" if "r" in kind else "", group)]
    return kinds, dict(zip(("x", "y", "z", *group), np.hstack([p, values[kind]]).T, strict=True))


def draw_trajectory(rng: np.random.Generator) -> tuple[list[tuple[str, tuple[str, ...]]], dict[str, Any]]:
    """Draw the columns of a trajectory: times of some clock, positions, and perhaps velocities."""
    t = rng.choice([0.0, 70.0, 1.7e9]) + np.cumsum(rng.uniform(0.1, 0.4, ROWS))
    t -= t[0] if rng.random() < 0.5 else 0.0
    kinds = [("s ms", (str(rng.choice(["t", "time"])),)), ("rad deg", ("j1", "j2", "j3"))]
    columns = {kinds[0][1][0]: t} | {name: rng.uniform(-1.0, 1.0, ROWS) for name in kinds[1][1]}
    if rng.random() < 0.5:
        kinds.append(("", ("dq_j1", "dq_j2", "dq_j3")))
        columns |= {f"dq_{name}": rng.uniform(-1.0, 1.0, ROWS) for name in kinds[1][1]}
    return kinds, columns


def read_seam(file: Path, made: Drawn) -> float:
    """Return the largest difference of the waypoints that are read [m, 1]."""
    found = planners.Polyline.from_csv(file, orientation=np.eye(3), blend=1e-9, blend_rotation=1e-9, **made.options)
    names, T = made.columns, found._given  # as the file has them; some may be merged
    off = np.abs(T[:, :3, 3] - np.stack([names[x] for x in "xyz"], axis=1)).max()
    group = [name for name in names if name not in "xyz"]
    v = np.stack([names[name] for name in group], axis=1) if group else np.empty((ROWS, 0))
    if group[:1] in (["i"], ["nx"]):
        return float(max(off, np.abs(T[:, :3, 2] + v / np.linalg.norm(v, axis=1)[:, None]).max()))
    R = {"qx": Rotation.from_quat, "rx": Rotation.from_rotvec}.get(group[0] if group else "")
    expected = R(v).as_matrix() if R else Rotation.from_euler("ZYX", v[:, ::-1]).as_matrix() if group else np.eye(3)
    return float(max(off, np.abs(T[:, :3, :3] - expected).max()))


def read_trajectory(file: Path, made: Drawn) -> float:
    """Return the largest difference of the positions and velocities that are read [rad, rad/s]."""
    (arm := file.with_name("arm.urdf")).write_text(ARM)
    found = planners.load_trajectory(file, optik.load(arm), **made.options)
    clock = made.columns["t" if "t" in made.columns else "time"]
    off = np.abs(found.knots - (clock - clock[0])).max() / (1.0 + 1e-6 * abs(clock[0]))
    for order, prefix in enumerate(("", "dq_")):
        if f"{prefix}j1" in made.columns:
            rows = np.stack([made.columns[f"{prefix}j{i}"] for i in (1, 2, 3)], axis=1)
            off = max(off, np.abs(found(found.knots, order) - rows).max())
    return float(off)


def measure(case: int) -> Row:
    """One table."""
    seam, rng = case % 2 == 0, np.random.default_rng([43, case])
    made = Drawn(case, *(draw_seam(case, rng) if seam else draw_trajectory(rng)))
    words, off = "", np.inf
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", AssumptionWarning)
        file = Path(folder) / "table.csv"
        file.write_bytes(made.text.encode())
        try:
            off = (read_seam if seam else read_trajectory)(file, made)
        except InvalidInput as error:
            words = str(error).replace(folder, "")
    return {"kind": "seam" if seam else "trajectory", "refused": made.refused, "words": words, "off": off}


def judge(rows: list[Row]) -> list[Value]:
    """The figures."""
    read = [row for row in rows if not row["words"]]
    wrong = [row for row in read if not row["off"] <= 1e-9]
    lost = [row for row in rows if row["words"] and not row["refused"]]
    silent = [row for row in read if row["refused"]]
    refused = [row for row in rows if row["words"]]
    place = [row for row in refused if re.search(r"table\.csv, line \d+", row["words"])]
    helped = [row for row in refused if "expected" in row["words"] and re.search(HELP, row["words"])]
    return [
        Value("misread tables", "0", f"{len(wrong)} of {len(read)} read", not wrong),
        Value("complete tables that are refused", "0", f"{len(lost)} of {len(rows)}", not lost),
        Value("ambiguous or incomplete tables that are read", "0", f"{len(silent)} of {len(rows)}", not silent),
        Value("refusals that name the line", "all", f"{len(place)} of {len(refused)}", len(place) == len(refused)),
        Value("refusals that name a way out", "all", f"{len(helped)} of {len(refused)}", len(helped) == len(refused)),
    ]


if __name__ == "__main__":
    main("tables", measure, COUNT, judge)
