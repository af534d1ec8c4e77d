"""Columns of a log: times, and positions, velocities and accelerations of joints, found by the words of the headers.

A header is divided into words at separators, between letters and digits, and in camelCase. Its end may be a unit. A column of a
joint has the joint's name, or a number where the numbers of such columns run from 0 or 1. The other words are those of one
quantity. Components of a path, such as the name of a topic, may have any words.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from decimal import Decimal

import numpy as np

from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.tables import UNIT_SIZES, Names, TableColumn, TextTable, find_size, read_names, split_unit
from planners.ros.message import POINT_FIELDS, MessagePoints

CLOCKS = ("t", "time", "times", "timestamp", "timestamps", "stamp", "elapsed", "clock", "epoch")
"""Last words of the name of a column of times."""
SINCE_START = ["time", "from", "start"]
"""Words of a column of times from the start of the motion, as in messages."""
WORDS = (
    "q pos position positions angle angles A@", "dq qd qdot v vel velocity velocities speed speeds",
    "ddq qdd qddot a acc accel acceleration accelerations",
    "@ j joint joints axis axes state states value values actual measured target desired command commanded",
)  # fmt: skip
"""Words of quantities by the order of the derivative, and words beside them; @ is the joint: A1 is an axis of KUKA's arms."""
PLAIN = 3
"""Index of the words without a quantity."""
ORDERS = {word: order for order, words in enumerate(WORDS) for word in words.split()}
"""Order of the derivative of each word."""
CONTRARY = {"error", "errors"}
"""Words that make a quantity another one, also in a path."""
NUMBER = re.compile(r"(?<!\d)\d{1,4}(?!\d)")
"""Numbers of joints."""
LONGEST_HEADER = 200
"""Longest header that is divided into words."""
ROS_TIME = 4.2e15
"""Least whole number without a unit that is a time in nanoseconds [ns]: microseconds since 1970 are smaller until 2103."""
Quantities = dict[str, tuple[str, str]]
"""Units of columns, or empty strings, and their units in the SI, by the headers."""


def read_units(given: Names) -> dict[str, str]:
    """Return the units of ``unit=`` for m, rad and s."""
    names, bases = read_names(given, "unit"), {unit: next(iter(sizes)) for sizes in UNIT_SIZES for unit in sizes}
    found = {bases[unit]: unit for unit in names if unit in bases}
    if len(found) < len(names):
        known = "; ".join(map(", ".join, UNIT_SIZES))
        raise InvalidInput("unit", ",".join(names)[:60], f"one unit of each quantity, such as 'ms,deg': {known}")
    return found


def read_log(table: TextTable, robot: Robot, names: list[str], units: Mapping[str, str]) -> MessagePoints:
    """Return the setpoints of a table."""
    sets, clocks = _find_sets(table, robot, names), _find_clocks(table)
    used: Quantities = {header: given for own in sets.values() for header, given in own.items()}
    clocks = {header: given for header, given in clocks.items() if header not in used}
    stems = {split_unit(header)[0] for header in clocks}
    found = {"times": clocks, POINT_FIELDS[0]: {}, **{POINT_FIELDS[order]: own for order, own in sets.items()}}
    pair = len(stems) == 1 and {unit for unit, _ in clocks.values()} == {"s", "ns"}
    expected = (
        f"one column of times (t, timestamp, time_ms …), and one for each of {', '.join(names)} (by name, or q1 …)"
    )
    if len(clocks) != 1 + pair or 0 not in sets or (2 in sets and 1 not in sets):
        known = "; ".join(f"{kind}: {', '.join(own) or 'none'}" for kind, own in found.items())
        advice = f"found are {known}"[:200]
        raise table.make_header_error(
            expected, f"{advice}; columns='t,{','.join(names)}' names all columns, ignore= leaves some out"
        )
    table.refuse_others([*clocks, *used], expected)
    table, assumed = _measure(table, clocks | used, units)
    clock, first = list(clocks), table.read_numbers(list(clocks))[:1].sum()
    rows = [[Decimal(cell.replace(",", ".")) for cell in table.read_cells(i, clock)] for i in range(len(table.lines))]
    sizes = [table.columns[header].size for header in clock]
    if "s" in assumed and abs(first) >= ROS_TIME and all(time[0] == int(time[0]) for time in rows):
        assumed, sizes, first = [unit for unit in assumed if unit != "s"], [1e-9], first * 1e-9
        table.notes.append("the times are in nanoseconds, because they are so large")
    # differences of decimals are exact for times since 1970, too
    t = [sum(float(x - x0) * size for x, x0, size in zip(time, rows[0], sizes, strict=True)) for time in rows]
    if assumed:
        table.notes.append(f"no units in the header, read in {', '.join(assumed)}: unit='ms,deg' gives others")
    values, since = [table.read_numbers(list(sets[order])) for order in sorted(sets)], _find_words(stems.pop().lower())
    locate, from_start = lambda i: table.locate(i, *clock), since[-3:] == SINCE_START
    return MessagePoints(np.array(t), float(first), values, from_start, locate, table.notes, assumed)


def _measure(table: TextTable, used: Quantities, units: Mapping[str, str]) -> tuple[TextTable, list[str]]:
    """Return the used columns with the sizes of their units, and the units that are assumed."""
    columns, assumed = {}, []
    for header, (unit, usual) in used.items():
        base, slash, per = usual.partition("/")
        given = units.get(base, base) + slash + per
        size = find_size(unit, given) or 1.0
        if unit and base in units and size != find_size("", given):
            raise InvalidInput("unit", repr(units[base]), f"{unit}, the unit in {table.locate(None, header)}, or none")
        columns[header] = TableColumn(table.columns[header].at, unit, size)
        assumed += [usual] * (not unit and base not in units and usual not in assumed)
    return table._replace(columns=columns), assumed


def _find_sets(table: TextTable, robot: Robot, names: list[str]) -> dict[int, Quantities]:
    """Return the columns of each order of derivative: those with the joints' names, or with numbers in their order."""
    known = [re.compile(rf"(?<![^\W_]){re.escape(name)}(?![^\W_])", re.IGNORECASE) for name in names]
    found: dict[int, Quantities] = {}
    for by_name in (True, False):
        groups: dict[str, dict[int, list[tuple[str, str]]]] = {}
        headers = [h for h in table.columns if len(h) <= LONGEST_HEADER and not any(h in own for own in found.values())]
        for header in headers:
            marks = [(i, m) for i, pattern in enumerate(known) for m in pattern.finditer(header)]
            marks = [(i, m) for i, m in marks if len(m[0]) == max(len(other[0]) for _, other in marks)]
            for i, m in marks if by_name else ((int(m[0]), m) for m in NUMBER.finditer(header)):
                stem, unit = split_unit(f"{header[: m.start()]}@{header[m.end() :]}")
                groups.setdefault(stem, {}).setdefault(i, []).append((header, unit))
        for stem, members in groups.items():
            order, begin = _find_order(stem), min(members)
            if order is None or begin > 1 or sorted(members) != [*range(begin, begin + robot.n)]:
                continue
            usual = [("m" if slides else "rad") + ("", "/s", "/s2")[order] for slides in robot.prismatic]
            own = {h: (unit, si) for i, si in enumerate(usual) for h, unit in members[begin + i] if find_size(unit, si)}
            both = found.get(order, {}) | own
            if len(own) >= robot.n < len(both):
                advice = f"ignore={','.join([*both][robot.n :])!r} leaves columns out"
                raise InvalidInput(
                    table.locate(),
                    f"{','.join(both)}"[:160],
                    f"one column of {POINT_FIELDS[order]} for each joint",
                    advice=advice,
                )
            if len(own) == robot.n and order not in found:
                found[order] = own
                if not by_name:
                    table.notes.append(f"the columns {','.join(own)} are {','.join(names)}, by their numbers"[:200])
    return found


def _find_order(stem: str) -> int | None:
    """Return the order of the derivative that the words around a joint state; None for another quantity."""
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


def _find_clocks(table: TextTable) -> Quantities:
    """Return the columns of times."""
    found = {}
    for header in table.columns:
        stem, unit = split_unit(header)
        unit, words = "ns" if header.startswith("%") else unit, _find_words(stem.lower())
        if find_size(unit, "s") and (
            words[-3:] == SINCE_START or (words[-1] in CLOCKS if words else bool(unit) and len(header) > 1)
        ):
            found[header] = (unit, "s")
    return found
