"""draw_frames: the link frames of an arm, its joint axes and the lengths of its Denavit–Hartenberg table."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from docs.drawings.sheet import MARGIN, WIDTH, Sheet, text_width
from docs.drawings.view import View, fit_view, make_view
from optik.arm.robot import Robot
from optik.types import Array

AXIS = 0.16
"""Length of an axis, over the size of the arm [1]."""

HEIGHT = 380.0
"""Height of the picture above the table [px]."""

TABLE_PITCH = 18.0
"""Distance between lines of the table [px]."""

SAME_FRAME = 1e-6
"""Largest difference of two origins [m] or directions [1] that are drawn as one."""

SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
"""Subscript digits of a frame's number."""


class DHLink(NamedTuple):
    """Modified Denavit–Hartenberg parameters between two frames: twist α [rad], lengths a and d [m]."""

    alpha: float
    a: float
    d: float


def draw_frames(robot: Robot, q: ArrayLike | None = None) -> str:
    """Return the drawing of an arm's base and joint frames (x and z axes) with lengths and the table of parameters."""
    q = np.zeros(robot.n) if q is None else robot.configuration(q)
    frames = np.concatenate([np.eye(4)[None], robot.frames(q)])
    links = [dh_link(np.linalg.solve(frames[i], frames[i + 1])) for i in range(robot.n)]
    if np.abs(frames[-1] - frames[-2]).max() <= SAME_FRAME:
        frames = frames[:-1]
    size = max(float(np.ptp(frames[:, :3, 3], axis=0).max()), SAME_FRAME)
    ends = (frames[:, None, :3, 3] + AXIS * size * frames[:, :3, [0, 2]].swapaxes(1, 2)).reshape(-1, 3)
    around = np.concatenate([frames[:, :3, 3], ends])
    view = fit_view(
        make_view(robot.gravity), around, (MARGIN + 28.0, MARGIN + 20.0, WIDTH - 2 * MARGIN - 60.0, HEIGHT - 72.0)
    )
    sheet = Sheet(f"Link frames of {robot.name}")
    for i, link in enumerate(links, start=1):
        _link(sheet, view, frames[i - 1 : i + 1], link, i)
    if len(frames) == robot.n + 2:
        sheet.line(view(frames[-2:, :3, 3]), "body", width=7.0)
    for frame in {tuple(np.round(T[:3, 3] / SAME_FRAME)): T[:3, 3] for T in frames}.values():
        _axes(sheet, view, frames, frame, AXIS * size)
    _gravity(sheet, view)
    return sheet.svg(_table(sheet, robot, links))


def dh_link(A: Array) -> DHLink | None:
    """Return the modified Denavit–Hartenberg parameters of a transform: Rot(x, α) Trans(x, a) Rot(z, θ) Trans(z, d)."""
    alpha = float(np.arctan2(-A[1, 2], A[2, 2]))
    d = float(-np.sin(alpha) * A[1, 3] + np.cos(alpha) * A[2, 3])
    residual = (A[0, 2], np.cos(alpha) * A[1, 3] + np.sin(alpha) * A[2, 3])
    return DHLink(alpha, float(A[0, 3]), d) if np.abs(residual).max() <= SAME_FRAME else None


def _link(sheet: Sheet, view: View, frames: Array, link: DHLink | None, i: int) -> None:
    """Draw the link from one origin to the next: along x by a, then along z by d, or straight if there are no parameters."""
    start, end = frames[0, :3, 3], frames[1, :3, 3]
    if link is None:
        parts = [("ℓ", i, start, end)]
    else:
        corner = start + link.a * frames[0, :3, 0]
        parts = [("a", i - 1, start, corner), ("d", i, corner, end)]
    for name, number, a, b in parts:
        length = float(np.linalg.norm(b - a))
        if length > SAME_FRAME:
            flat = view(np.stack([a, b]))
            sheet.line(flat, "body", width=7.0)
            label = f"{_numbered(name, number)} = {1e3 * length:.4g} mm"
            _length_label(sheet, flat, label)


def _length_label(sheet: Sheet, flat: Array, label: str) -> None:
    """Write the length of a line: beside a steep line, above a long flat one, below a short one."""
    dx, dy = np.abs(flat[1] - flat[0])
    if dy > dx:
        sheet.words(flat.mean(axis=0), label, "soft", by=(10.0, 4.0))
    elif dx > text_width(label) / 2:
        sheet.words(flat.mean(axis=0), label, "soft", by=(6.0, -12.0))
    else:
        sheet.words(flat.mean(axis=0), label, "soft", by=(-6.0, 18.0), anchor="end")


def _axes(sheet: Sheet, view: View, frames: Array, origin: Array, length: float) -> None:
    """Draw the x and z axes of all frames with one origin; axes of one direction are one arrow with all names."""
    here = [i for i, T in enumerate(frames) if np.abs(T[:3, 3] - origin).max() <= SAME_FRAME]
    named: dict[tuple[float, ...], tuple[Array, str, list[str]]] = {}
    for axis, column in (("z", 2), ("x", 0)):
        for i in here:
            along = frames[i, :3, column]
            key = tuple(np.round(along, 3) + 0.0)
            named.setdefault(key, (along, axis, []))[2].append(_numbered(axis, i))
    for along, axis, names in named.values():
        start, tip = view(origin), view(origin + length * along)
        sheet.arrow([start, tip], axis, width=2.0)
        out = (tip - start) / max(float(np.linalg.norm(tip - start)), 1.0)
        anchor = "middle" if abs(out[0]) < 0.5 else ("start" if out[0] > 0.0 else "end")
        sheet.words(tip + 7.0 * out, " ".join(names), axis, by=(0.0, 4.0 + 5.0 * float(out[1])), anchor=anchor)
    sheet.dot(view(origin), "ink")


def _gravity(sheet: Sheet, view: View) -> None:
    """Draw the direction of gravity in the corner."""
    at = np.array([WIDTH - MARGIN - 20.0, MARGIN + 18.0])
    down = view(-view.up) - view(np.zeros(3))
    sheet.arrow([at, at + 34.0 * down / np.linalg.norm(down)], "soft")
    sheet.words(at, "gravity", "soft", by=(0.0, -6.0), anchor="middle")


def _table(sheet: Sheet, robot: Robot, links: list[DHLink | None]) -> float:
    """Write the table below the picture; return the total height [px]."""
    columns = (44.0, 140.0, 226.0, 312.0, 452.0)
    y = HEIGHT + 14.0
    for x, word in zip(columns, ("i", "αᵢ₋₁ [°]", "aᵢ₋₁ [mm]", "dᵢ [mm]", "range [°, mm]"), strict=True):
        sheet.words((x, y), word, "soft", anchor="end")
    sheet.line([(MARGIN, y + 6.0), (WIDTH - MARGIN, y + 6.0)], "edge", width=1.0)
    for i, link in enumerate(links):
        y += TABLE_PITCH if i else TABLE_PITCH + 4.0
        per = 1e3 if robot.prismatic[i] else 180.0 / np.pi
        low, high = per * robot.limits.lower[i], per * robot.limits.upper[i]
        shown = ("–",) * 3 if link is None else (np.degrees(link.alpha), 1e3 * link.a, 1e3 * link.d)
        cells = [
            str(i + 1),
            *(s if isinstance(s, str) else _plain(s) for s in shown),
            f"{_plain(low)} … {_plain(high)}",
        ]
        for x, cell in zip(columns, cells, strict=True):
            sheet.words((x, y), cell, anchor="end")
    return y + MARGIN


def _plain(value: float) -> str:
    """Return a number with a typographic minus sign."""
    return f"{np.round(value, 2) + 0.0:g}".replace("-", "−")


def _numbered(name: str, number: int) -> str:
    return f"{name}{str(number).translate(SUBSCRIPTS)}"
