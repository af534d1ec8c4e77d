"""Pictures of the site and of the README: ``make pictures`` writes docs/pictures, which are committed; it needs Chromium.

``python -m docs.pictures [NAME …]`` makes all of them, or those that are named.
"""

from __future__ import annotations

import base64
import contextlib
import io
import os
import re
import runpy
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
from PIL import Image, ImageDraw, ImageFont

import optik
import planners
from optik.view.page import make_page
from optik.view.show import Show
from planners.cell.show import show_outcome
from planners.motion.motion import World
from planners.motion.show import show_motion
from tests.benchmarks.browser import Browser

ROOT = Path(__file__).parents[1]
OUT = ROOT / "docs" / "pictures"
SIZE = (480, 320)
"""Width and height of a thumbnail [pixels]."""
MOST_BYTES, MOST_MOVING = 40_000, 600_000
"""Largest picture, and largest moving one [bytes]."""
FRAMES, MILLISECONDS = 48, 70
"""Frames of the moving picture, and how long each is shown."""
BARE = (
    "header, aside, #controls, #legend, #labels { display: none !important } "
    "body { display: block !important } #picture { height: 100dvh !important }"
)
"""Style that leaves of a viewer's page what the arm is drawn in."""
BLUE, RED, GREY, GREEN = "#2f6fde", "#d0401b", "#8f99a6", "#2a8f4f"
MAKERS: dict[str, Callable[[Camera], Image.Image | Sequence[Image.Image]]] = {}
"""Functions that make the pictures, by name."""


# ---------------------------------------------------------------- tools


class Camera:
    """A browser that photographs pages."""

    def __init__(self, browser: Browser, scratch: Path) -> None:
        self.browser, self.scratch = browser, scratch

    def open(self, html: str, size: tuple[int, int], ready: str = "true") -> None:
        """Show a page in a window of a size, until an expression is true."""
        self.browser.emulate(width=size[0], height=size[1])
        file = self.scratch / "page.html"
        file.write_text(html, encoding="utf-8")
        self.browser.open(file)
        self.browser.until(f"document.readyState === 'complete' && ({ready})")

    def shoot(self) -> Image.Image:
        """Return what the window shows."""
        self.browser.run("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))")
        data = self.browser.send("Page.captureScreenshot", format="png")["data"]
        return Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")

    def view(self, show: Show, size: tuple[int, int]) -> None:
        """Show an arm, without tables."""
        page = make_page(show).replace("</style>", f"{BARE}</style>", 1)
        self.open(page, size, "window.optikView")
        self.browser.run("optikView.draw(); 1")

    def at(self, t: float) -> Image.Image:
        """Return the arm at a time of its motion."""
        self.browser.run(f"optikView.seek({t}); optikView.draw(); 1")
        return self.shoot()

    def plot(self, figure: go.Figure, size: tuple[int, int] = SIZE) -> Image.Image:
        """Return a figure."""
        figure.update_layout(
            template="plotly_white", width=size[0], height=size[1], margin={"l": 52, "r": 14, "t": 16, "b": 42},
            font={"size": 13, "family": "sans-serif"}, legend={"x": 0.99, "y": 0.99, "xanchor": "right", "bgcolor": "#fffc"},
        )  # fmt: skip
        html = figure.to_html(include_plotlyjs=True, config={"displayModeBar": False})
        self.open(
            html.replace("<body>", '<meta name="viewport" content="width=device-width"><body style="margin: 0">'),
            size,
            "document.querySelector('.main-svg')",
        )
        return self.shoot()


def picture(make: Callable[[Camera], Any]) -> Callable[[Camera], Any]:
    """Enter a function under the name of the picture that it makes."""
    MAKERS[make.__name__] = make
    return make


def font(size: int) -> Any:
    """Return a typeface that is on most machines."""
    return ImageFont.load_default(size)


def beside(pictures: Sequence[Image.Image], titles: Sequence[str] = ()) -> Image.Image:
    """Return pictures in a row, each below its title."""
    out = Image.new("RGB", (sum(one.width for one in pictures), pictures[0].height), "white")
    draw, x = ImageDraw.Draw(out), 0
    for i, one in enumerate(pictures):
        out.paste(one, (x, 0))
        if i:
            draw.line([(x, 0), (x, out.height)], fill="#d5dae0", width=2)
        if titles:
            draw.text((x + 10, 8), titles[i], fill="#1b1e22", font=font(15))
        x += one.width
    return out


@contextlib.contextmanager
def folder() -> Iterator[Path]:
    """Work in an empty folder, and print nothing."""
    with tempfile.TemporaryDirectory() as name, contextlib.redirect_stdout(io.StringIO()):
        before = os.getcwd()
        os.chdir(name)
        try:
            yield Path(name)
        finally:
            os.chdir(before)


def run_example(name: str) -> dict[str, Any]:
    """Return what an example defines."""
    with folder():
        before, sys.argv = sys.argv, [name]
        try:
            return runpy.run_path(str(ROOT / "examples" / f"{name}.py"), run_name="__main__")
        finally:
            sys.argv = before


def run_cells(page: str, last: str) -> dict[str, Any]:
    """Return what the cells of a page define, up to the one that defines a name."""
    defined, file, before = dict[str, Any](), ROOT / "docs" / f"{page}.md", os.getcwd()
    text = file.read_text(encoding="utf-8")
    os.chdir(file.parent)
    with contextlib.redirect_stdout(io.StringIO()):
        for cell in re.findall(r"```\{code-cell\}\n(?::tags:[^\n]*\n)?(.*?)```", text, flags=re.S):
            if last not in defined:
                exec(cell, defined)
    os.chdir(before)
    return defined


# ---------------------------------------------------------------- arms


@picture
def shelf(camera: Camera) -> Image.Image:
    """The hand on its way from one compartment of a shelf to another."""
    camera.view(show_motion(run_example("shelf")["move"]), SIZE)
    return camera.at(0.45 * camera.browser.run("optikView.end"))


@picture
def motion(camera: Camera) -> list[Image.Image]:
    """The same motion as it runs, above a strip of the limit that acts."""
    move = run_example("shelf")["move"]
    size, strip = (640, 360), 64
    camera.view(show_motion(move), size)
    active, end = move.certificate.binding, move.trajectory.duration
    words = [f"{limit} of {joint}".replace("_", " ") for limit, joint in zip(active.limit, active.joint, strict=True)]
    tints = ("#2f6fde", "#d9771b", "#2a8f4f", "#b3379b", "#7a5cd0", "#0f8d94", "#8a6d1f", "#c2257a")
    colours = {word: tints[k % len(tints)] for k, word in enumerate(dict.fromkeys(words))}
    out, low, wide = [], 14, size[0] - 28
    for t in np.linspace(0.0, end, FRAMES):
        frame = Image.new("RGB", (size[0], size[1] + strip), "white")
        frame.paste(camera.at(float(t)), (0, 0))
        draw = ImageDraw.Draw(frame)
        for word, begin, stop in zip(words, active.t[:-1], active.t[1:], strict=True):
            box = [low + wide * begin / end, size[1] + 32, low + wide * stop / end, size[1] + 54]
            draw.rectangle(box, fill=colours[word])
        at = low + wide * t / end
        now = words[min(len(words) - 1, int(np.searchsorted(active.t, t, side="right")) - 1)]
        draw.rectangle([low, size[1] + 9, low + 12, size[1] + 21], fill=colours[now])
        draw.text((low + 20, size[1] + 4), f"at its limit: {now}", fill="#1b1e22", font=font(16))
        draw.text((low + wide, size[1] + 4), f"{t:.2f} s of {end:.2f} s", fill="#5c6570", font=font(16), anchor="ra")
        draw.line([(at, size[1] + 27), (at, size[1] + 59)], fill="#111417", width=3)
        out.append(frame)
    return out + [out[-1]] * 8


@picture
def saddle(camera: Camera) -> Image.Image:
    """The torch at the saddle of two pipes, and its turn along the seam: fixed, and as the law chooses it."""
    known = run_example("pipe_saddle")
    chosen, robot = known["plan"], known["robot"]
    narrow = planners.free(known["seam"], turn=tuple(np.deg2rad([24.95, 25.05])))  # at 0° and 30° the arm meets a pipe
    fixed = planners.plan(robot, narrow, limits=known["limits"], scene=known["cell"])
    figure = go.Figure()
    for name, plan, colour in (("fixed", fixed, GREY), ("chosen", chosen, BLUE)):
        x, y = 1e3 * plan.freedom.s, np.degrees(plan.freedom.values[:, 0])
        title = f"{name}: {plan.trajectory.duration:.2f} s"
        figure.add_scatter(x=x, y=y, name=title, mode="lines", line={"color": colour, "width": 2.5})
    figure.update_xaxes(title="along the seam [mm]").update_yaxes(title="turn of the torch [°]", range=[-5, 45])
    camera.view(show_motion(chosen), (SIZE[0] // 2, SIZE[1]))
    arm = camera.at(0.5 * chosen.trajectory.duration)
    return beside([arm, camera.plot(figure, (SIZE[0] // 2, SIZE[1]))])


@picture
def zones(camera: Camera) -> Image.Image:
    """The corners of a cycle of pick and place that are rounded, within their zones."""
    plan = run_cells("howto/pick", "plan")["plan"]
    camera.view(show_motion(plan), SIZE)
    points = plan.path.pose(np.linspace(0.0, plan.path.end, 200))[:, :3, 3]
    middle = (0.5 * (points.min(axis=0) + points.max(axis=0))).tolist()
    camera.browser.run(f"(c => {{ c.target = {middle}; c.distance *= 0.8; c.azimuth += 0.9 }})(optikView.camera)")
    return camera.at(0.3)


@picture
def positioner(camera: Camera) -> Image.Image:
    """The arm and the table in the middle of the seam."""
    plan = run_cells("howto/positioner", "plan")["plan"]
    camera.view(show_motion(plan), SIZE)
    camera.browser.run("(c => { c.target = [0.35, 0, 0.3]; c.distance *= 0.9; c.azimuth += 1.3 })(optikView.camera)")
    return camera.at(0.5 * plan.duration)


@picture
def bar(camera: Camera) -> Image.Image:
    """Two arms, and the bar that they carry."""
    plan = run_cells("howto/bar", "plan")["plan"]
    group, left = plan.group, plan.group.members["left"]
    held = left.with_shapes(left.shapes.with_part("bar", left.n, [([-0.2, 0, 0], [0.2, 0, 0], 0.03)], left.tool))
    show = show_motion(replace(plan.motion, world=World(optik.Group({**group.members, "left": held}), None)))
    camera.view(show, SIZE)
    return camera.at(0.7 * plan.duration)


def view_example(name: str, variable: str = "plan", share: float = 0.6) -> Callable[[Camera], Image.Image]:
    """Return the function that makes the picture of the plan of an example."""

    def make(camera: Camera) -> Image.Image:
        camera.view(show_motion(run_example(name)[variable]), SIZE)
        return camera.at(share * camera.browser.run("optikView.end"))

    return make


MAKERS |= {
    "own_urdf": view_example("own_urdf"),
    "seam": view_example("seam_to_ros"),
    "replan": view_example("replan", "on"),
}


@picture
def laser(camera: Camera) -> Image.Image:
    """The arm of the laser cell on its way to the spot."""
    camera.view(show_outcome(run_cells("howto/laser", "outcome")["outcome"]), SIZE)
    return camera.at(0.2)


@picture
def cup(camera: Camera) -> Image.Image:
    """A container on its way along a line, and the angle of its liquid with and without a limit of 15°."""
    robot = optik.load("ur5e")
    q = np.deg2rad([0.0, -100.0, 110.0, -100.0, -90.0, 0.0])
    start = robot.fk(q)
    line = planners.Line(start, optik.se3.pose(start[:3, :3], start[:3, 3] + [0.0, 0.4, 0.0]))
    loose = planners.MotionLimits(velocity=3.0, acceleration=15.0, jerk=150.0)
    level = planners.limits.OpenContainer(np.deg2rad(15.0), axis="-z")
    figure, plans = go.Figure(), {}
    for name, colour, extra in (("no limit", GREY, {}), ("at most 15°", BLUE, {"open_container": level})):
        limits = planners.MotionLimits(3.0, 15.0, 150.0, extra=extra) if extra else loose
        plan = plans[name] = planners.plan(robot, line, q, limits=limits)
        t = np.linspace(0.0, plan.trajectory.duration, 801)
        pose = robot.fk(plan.trajectory(t))
        force = np.gradient(np.gradient(pose[:, :3, 3], t, axis=0), t, axis=0) - 9.81 * robot.gravity
        angle = np.degrees(np.arccos(-np.einsum("ki,ki->k", force, pose[:, :3, 2]) / np.linalg.norm(force, axis=1)))
        figure.add_scatter(x=t, y=angle, name=name, line={"color": colour, "width": 2.5})
    figure.add_hline(15.0, line={"color": RED, "dash": "dash", "width": 2})
    figure.update_xaxes(title="t [s]").update_yaxes(title="angle of the liquid [°]", range=[0, 60])
    camera.view(show_motion(plans["at most 15°"]), (SIZE[0] // 2 - 40, SIZE[1]))
    arm = camera.at(0.15)
    return beside([arm, camera.plot(figure, (SIZE[0] // 2 + 40, SIZE[1]))])


# ---------------------------------------------------------------- maps, curves and a report


@picture
def reach(camera: Camera) -> Image.Image:
    """Where an arm can hold its tool downwards, and how well it moves there."""
    known = run_example("reachability_map")
    grid = known["sigma"].reshape(len(known["x"]), len(known["y"]))
    bar = {"title": {"text": "σ<sub>min</sub>"}, "thickness": 14}
    figure = go.Figure(go.Heatmap(x=known["x"], y=known["y"], z=grid.T, colorscale="Viridis", colorbar=bar))
    figure.add_scatter(x=[0.0], y=[0.0], name="base", mode="markers", showlegend=False,
                       marker={"color": RED, "size": 9})  # fmt: skip
    figure.update_xaxes(title="x [m]", constrain="domain").update_yaxes(
        title="y [m]", scaleanchor="x", constrain="domain"
    )
    return camera.plot(figure)


@picture
def stream(camera: Camera) -> Image.Image:
    """The velocity of joint 1 over its limit: targets that replace each other, and the stream through them."""
    known = run_example("policy_stream")
    figure = go.Figure()
    for name, colour, t, x in (
        ("hard replacement", GREY, known["t_target"], known["hard"]), ("stream", BLUE, known["t"], known["q"])
    ):  # fmt: skip
        rate = np.diff(x[:, 0]) * 1e3 / known["v"][0]
        figure.add_scatter(
            x=t[1:], y=rate.clip(-2.5, 2.5), name=name, line={"color": colour, "width": 1.2 if colour == GREY else 2.5}
        )
    for side in (-1.0, 1.0):
        figure.add_hline(side, line={"color": RED, "dash": "dash", "width": 2})
    figure.update_xaxes(title="t [s]", range=[0.0, 4.5]).update_yaxes(title="velocity / limit", range=[-2.6, 2.6])
    return camera.plot(figure)


@picture
def certificate(camera: Camera) -> Image.Image:
    """How far a controller's motion leaves its line, the bound that is proved of it, and a limit."""
    known = run_cells("tutorial/certificate", "received")
    robot, plan, received = known["robot"], known["plan"], known["received"]
    proof = planners.certify(robot, plan.path, received, known["limits"])
    t = np.linspace(0.0, received.duration, 1500)
    ends = plan.path.pose(np.array([0.0, plan.path.end]))[:, :3, 3]
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    off = robot.fk(received(t))[:, :3, 3] - ends[0]
    distance = np.linalg.norm(off - np.outer(off @ along, along), axis=1)
    bound = 1e6 * proof.path_error.distance
    figure = go.Figure(go.Scatter(x=t, y=1e6 * distance, name="tool off its line", line={"color": BLUE, "width": 2.5}))
    for name, y, colour, dash in (
        ("proved bound", bound, GREEN, "solid"),
        ("limit", np.ceil(14.0 * bound) / 10.0, RED, "dash"),
    ):
        look = {"color": colour, "width": 2, "dash": dash}
        figure.add_scatter(x=t[[0, -1]], y=[y] * 2, name=name, mode="lines", line=look)
    figure.update_xaxes(title="t [s]").update_yaxes(title="distance [µm]", range=[0, 2.0 * bound])
    figure.update_layout(legend_orientation="h")
    return camera.plot(figure)


@picture
def report(camera: Camera) -> Image.Image:
    """The first screen of the report of the page "Compare a method"."""
    from benchmarks.report import write_report
    from benchmarks.run import run_suite
    from benchmarks.suite import load_suite

    with folder() as here:
        text = (ROOT / "docs/howto/compare.md").read_text(encoding="utf-8")
        exec(re.findall(r"```\{code-cell\}\n(from pathlib.*?)```", text, flags=re.S)[0], {})
        html = write_report(run_suite(load_suite("suite.toml", allow_plugins=True), here / "run")).read_text(
            encoding="utf-8"
        )
    camera.open(html, (960, 640))
    return camera.shoot().resize((720, 480), Image.Resampling.LANCZOS)


# ---------------------------------------------------------------- files


def write(name: str, made: Image.Image | Sequence[Image.Image]) -> None:
    """Write a picture as large as it may be."""
    file = OUT / f"{name}.webp"
    first, *others = [made] if isinstance(made, Image.Image) else made
    most = MOST_MOVING if others else MOST_BYTES
    for quality in (90, 80, 70, 60, 50, 40, 30):
        first.save(
            file,
            quality=quality,
            method=6,
            **({"save_all": True, "append_images": others, "duration": MILLISECONDS, "loop": 0} if others else {}),
        )
        if file.stat().st_size <= most:
            size = f"{first.width} × {first.height}, {file.stat().st_size / 1e3:.1f} kB"
            print(f"{file.relative_to(ROOT)}: {size}, quality {quality}")
            return
    raise SystemExit(f"{file} is larger than {most} bytes")


def main(names: Sequence[str]) -> None:
    """Make pictures."""
    OUT.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch, Browser(Path(scratch)) as browser:
        camera = Camera(browser, Path(scratch))
        for name in names or MAKERS:
            write(name, MAKERS[name](camera))


if __name__ == "__main__":
    main(sys.argv[1:])
