"""Columns of a log: times, and positions, velocities and accelerations of joints, found by the words of the headers.

A header is divided into words at separators, between letters and digits, and in camelCase. Its end may be a unit. A column of a
joint contains the joint's name, or a number: such numbers count from 0 or 1, or are those of the joints' names if these have
others. The other words name one quantity. Components of a path, such as the name of a topic, may contain any words.
"""

from __future__ import annotations

import re
from decimal import Decimal

import numpy as np

from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.tables import TableColumn, TextTable, find_size, read_cell, split_unit
from planners.ros.export import POINT_FIELDS, MessagePoints

CLOCKS = ("t", "time", "times", "timestamp", "timestamps", "stamp", "elapsed", "clock", "epoch")
"""Last words of the name of a column of times."""
SINCE_START = ["time", "from", "start"]
"""Words of a column of times from the start of the motion, as in messages."""
WORDS = (
    "q pos position positions angle angles A@", "dq qd qdot v vel velocity velocities speed speeds",
    "ddq qdd qddot a acc accel acceleration accelerations",
    "@ j joint joints axis axes state states value values actual measured target desired command commanded",
)  # fmt: skip
"""Words of positions, velocities and accelerations, and neutral words. @ stands for the joint; A1 is an axis of KUKA arms."""
PLAIN = 3
"""Index of the neutral words."""
ORDERS = {word: order for order, words in enumerate(WORDS) for word in words.split()}
"""Order of the derivative of each word."""
CONTRARY = {"error", "errors"}
"""Words that exclude a column, also in the name of a topic."""
NUMBER, LONGEST_HEADER = re.compile(r"(?<!\d)\d{1,4}(?!\d)"), 200
"""Numbers of joints, and the longest header that is divided into words."""
Columns = dict[str, TableColumn]
"""Columns by their headers."""


def list_units(robot: Robot, order: int) -> list[str]:
    """Return the units of the joints' positions, or of their derivatives."""
    return [("m" if slides else "rad") + ("", "/s", "/s2")[order] for slides in robot.prismatic]


def read_log(table: TextTable, robot: Robot, names: list[str]) -> MessagePoints:
    """Return the setpoints of a table, in SI units where the header states no others."""
    sets = _find_sets(table, robot, names)
    if set(sets) == {2} and all("joint" in header.lower() and not column.unit for header, column in sets[2].items()):
        sets = {0: sets[2]}  # joint_a1 is KUKA's name of a joint: accelerations alone are no motion
    bare = sorted(k for k, group in sets.items() if not any(column.unit for column in group.values()))
    for k in bare if 0 in sets and 0 not in bare else ():
        sets[k] = {h: like._replace(at=sets[k][h].at) for h, like in zip(sets[k], sets[0].values(), strict=True)}
        table.notes.append(f"the {POINT_FIELDS[k]} have no units, and are read in those of the positions{'/s' * k}")
    used = {header: column for group in sets.values() for header, column in group.items()}
    clocks = {header: column for header, column in _find_clocks(table).items() if header not in used}
    stems = {split_unit(header)[0] for header in clocks}
    pair = len(stems) == 1 and {column.unit for column in clocks.values()} == {"s", "ns"} and _are_parts(table, clocks)
    expected = f"times, and a column for each joint, {_abbreviate(names)} (or q1 …)"
    if len(clocks) != 1 + pair or 0 not in sets or (2 in sets and 1 not in sets):
        lacks = "accelerations without velocities" if 0 in sets else "no positions"
        advice = f"it has {lacks if clocks else 'no times'}: columns='t,{_abbreviate(names)}' names all columns"
        if len(clocks) > 1 + pair:
            advice = f"ignore={' or '.join(map(repr, clocks))[:60]} leaves times out"
        elif len(table.columns) - len(clocks) < robot.n:
            advice = f"{robot.name} has {robot.n} joints: robot= names another arm"
        raise table.make_header_error(expected, advice)
    table.refuse_others([*clocks, *used], expected)
    table, clock, sizes = table._replace(columns=clocks | used), [*clocks], [c.size for c in clocks.values()]
    begin = float(table.read_numbers(clock)[:1].sum())
    rows = [[Decimal(cell.replace(",", ".")) for cell in table.read_cells(i, clock)] for i in range(len(table.lines))]
    t = np.array([sum(float(x - x0) * size for x, x0, size in zip(row, rows[0], sizes, strict=True)) for row in rows])
    orders, from_start = sorted(sets), _find_words(stems.pop().lower())[-3:] == SINCE_START
    values = [table.read_numbers(list(sets[order])) for order in orders]
    bases = [unit for k in bare if 0 in bare for unit in list_units(robot, k)]
    assumed = dict.fromkeys(["s"] * (not clocks[clock[0]].unit) + bases)
    told = table.notes, assumed, dict.fromkeys(column.unit for column in (clocks | used).values() if column.unit)
    places = [clock, *([header] for header in sets[0])]
    return MessagePoints(t, begin, values, from_start, lambda i, j=-1: table.locate(i, *places[j + 1]), *told)


def _are_parts(table: TextTable, clocks: Columns) -> bool:
    """Return whether all times are whole, and the nanoseconds below a second: not the same times in two units."""
    cells = [(read_cell(cells[column.at]), column.unit) for _, cells in table.lines for column in clocks.values()]
    return not any(x % 1.0 > 0.0 or (unit == "ns" and not 0.0 <= x < 1e9) for x, unit in cells)


def _find_sets(table: TextTable, robot: Robot, names: list[str]) -> dict[int, Columns]:
    """Return the columns of each order of derivative: those with the joints' names, or with their numbers."""
    named = [re.compile(rf"(?<![^\W_]){re.escape(name)}(?![^\W_])", re.IGNORECASE) for name in names]
    counts, sets = [[*range(robot.n)], [*range(1, robot.n + 1)]], dict[int, Columns]()
    ends = [int(number) for name in names for number in re.findall(r"\d+", name)[-1:]]
    for by_name in (True, False):
        orders = counts[:1] if by_name else [ends] if len({*ends}) == robot.n and ends != counts[1] else counts
        groups: dict[str, dict[int, Columns]] = {}
        others = [
            h for h in table.columns if len(h) <= LONGEST_HEADER and not any(h in group for group in sets.values())
        ]
        for header in others:
            marks = [(i, m) for i, pattern in enumerate(named) for m in pattern.finditer(header)]
            marks = [(i, m) for i, m in marks if len(m[0]) == max(len(other[0]) for _, other in marks)]
            inside = {i for _, m in marks for i in range(*m.span())}  # the number of another joint
            numbers = [(int(m[0]), m) for m in NUMBER.finditer(header) if m.start() not in inside]
            for i, m in marks if by_name else numbers:
                stem, unit = split_unit(f"{header[: m.start()]}@{header[m.end() :]}")
                groups.setdefault(stem, {}).setdefault(i, {})[header] = table.columns[header]._replace(unit=unit)
        for stem, members in groups.items():
            order, at = _find_order(stem), next((x for x in orders if {*x} == {*members}), None)
            if order is None or at is None:
                continue
            pairs = [(unit, *x) for i, unit in enumerate(list_units(robot, order)) for x in members[at[i]].items()]
            group = {header: c._replace(size=size) for usual, header, c in pairs if (size := find_size(c.unit, usual))}
            if len(group) >= robot.n and len(both := sets.get(order, {}) | group) > robot.n:
                first = sets.get(order) or [next(iter(each)) for each in members.values()]
                advice = (
                    f"ignore={','.join(h for h in both if h not in first)!r} or {','.join(first)!r} leaves some out"
                )
                expected = f"one column of {POINT_FIELDS[order]} for each joint"
                raise InvalidInput(table.locate(), ",".join(both)[:160], expected, advice=advice)
            if len(group) == robot.n and order not in sets:
                sets[order] = group
                words = f"{_abbreviate([*group])} are read as {_abbreviate(names)} of {robot.name}, by number (robot=)"
                table.notes.extend([words] * (not by_name))
    return sets


def _abbreviate(names: list[str]) -> str:
    return ",".join(names if len(names) < 4 else [names[0], "…", names[-1]])


def _find_order(stem: str) -> int | None:
    """Return the order of derivative given by the words around a joint; None for another quantity."""
    orders = {PLAIN}
    for part in re.split("[/.:]", stem):
        words = [word if word in ORDERS else word.lower() for word in _find_words(part) if not word.isdigit()]
        own = {ORDERS.get(word, -1) for word in words}
        if not CONTRARY.isdisjoint(words) or (-1 in own and (own - {-1, PLAIN} or "@" in part)):
            return None
        orders |= own
    found = orders - {-1, PLAIN}
    return found.pop() if len(found) == 1 else 0 if orders == {PLAIN} else None


def _find_words(text: str) -> list[str]:
    return re.findall(r"A@|[^\W\d_]+|\d+|@", re.sub(r"(?<=[a-z])(?=[A-Z])", "_", text))


def _find_clocks(table: TextTable) -> Columns:
    """Return the columns of times."""
    found = {}
    for header, column in table.columns.items():
        stem, unit = split_unit(header)
        whole, words = all(cells[column.at].isdigit() for _, cells in table.lines), _find_words(stem.lower())
        unit = "ns" if header == "%time" and whole else unit  # of rostopic echo -p
        named = words[-1] in CLOCKS or words[-3:] == SINCE_START if words else bool(unit) and header.lower() != "s"
        if named and (size := find_size(unit, "s")):
            found[header] = TableColumn(column.at, unit, size)
    return found
