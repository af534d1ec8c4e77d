"""The page that plays a motion, in a real browser: the picture against the arm's kinematics, time, keys, touch, themes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

import optik
from optik.scene import Scene
from optik.scene.contact import find_contact
from optik.types import Array
from optik.view.page import embed_arm, write_page
from optik.view.show import Beam, Show, Track
from planners.limits import MotionLimits
from planners.motion.show import plot_limits, sample_track, show_motion
from tests.benchmarks.browser import CHROMIUM, Browser
from tests.planners.motions import planned

SIZE = (1280, 900)
READ = """(() => {
    optikView.draw();
    const canvas = document.getElementById('canvas'), gl = canvas.getContext('webgl2'), c = optikView.camera;
    const w = gl.drawingBufferWidth, h = gl.drawingBufferHeight, pixels = new Uint8Array(4 * w * h);
    gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    let n = 0, x = 0, y = 0;
    for (let k = 0; k < w * h; k++)
        if (pixels[4 * k] === 0x11 && pixels[4 * k + 1] === 0x14 && pixels[4 * k + 2] === 0x17) {
            n++; x += k % w + 0.5; y += h - Math.floor(k / w) - 0.5;
        }
    return { n, at: [x / n, y / n], back: [...pixels.slice(4 * w * (h - 1)).slice(0, 3)], size: [w, h],
        eye: c.eye, target: c.target, opening: c.opening };
})()"""
"""Middle of the pixels in the colour of the tool's mark, and the camera that they were drawn with."""


def shown() -> Show:
    """A motion with an execution 0.01 rad beside it, a beam and a scene."""
    show = show_motion(planned())
    t, q, dq = show.planned[:3]
    late = np.append(t, t[-1] + 0.1)  # it settles for another 0.1 s
    q, dq = (np.vstack([values, values[-1]]) for values in (q, dq))
    T = np.eye(4)
    T[:3, 3] = [0.45, 0.55, 0.25]
    scene = Scene([(T, [0.2, 0.1, 0.3])], [([-0.3, 0.5, 0.3], 0.1)], [([0.4, -0.3, 0.2], [0.6, -0.3, 0.4], 0.05)],
                  [([0.0, 0.65, 0.0], [0.0, -1.0, 0.0])], [([0.5, -0.5, 0.1], [0.6, -0.5, 0.1], 0.04)],
                  [np.array([0.3, -0.6, 0.1]) + 0.1 * np.eye(4, 3)])  # fmt: skip
    return replace(
        show, executed=Track(late, q + 0.01, dq), beam=Beam(np.array([-0.4, -0.2, 0.1]), show.path[-1]), scene=scene
    )


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("view") / "page.html"
    write_page(shown(), file)
    return file


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine")
    with Browser(tmp_path_factory.mktemp("profile"), *SIZE) as browser:
        yield browser


def show_page(browser: Browser, page: Path) -> None:
    """Open a page, unless it is the one that this function opened last and no test has left it since."""
    browser.emulate(width=SIZE[0])
    if not browser.run(f"window.kept === {page.as_uri()!r}"):
        browser.run("window.left = true")
        browser.open(page)
        browser.until("!window.left && window.optikView")
        browser.run(f"window.kept = {page.as_uri()!r}")
        browser.requests.clear()


@pytest.fixture
def opened(drawn: Browser, page: Path) -> Iterator[Browser]:
    """The page at the start of the motion; after the test its console must be empty and nothing must have been asked for."""
    show_page(drawn, page)
    drawn.run("document.activeElement.blur(); optikView.play(false); optikView.seek(0)")
    drawn.run("document.getElementById('reset').click()")
    yield drawn
    assert drawn.errors == []
    assert drawn.asked(page) == []


def press(browser: Browser, key: str, **more: Any) -> None:
    for kind in ("keyDown", "keyUp"):
        browser.send("Input.dispatchKeyEvent", type=kind, key=key, **more)


def time_of(browser: Browser) -> float:
    return float(browser.run("optikView.shown.time"))


def text_of(browser: Browser, name: str) -> str:
    return str(browser.run(f"optikView.draw(), document.getElementById('{name}').textContent"))


def picture(point: Array, found: dict[str, Any], up: Array) -> Array:
    """Where a camera at the eye, upright and turned to its target, sees a point [pixels]."""
    eye, target = np.array(found["eye"]), np.array(found["target"])
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, up) / np.linalg.norm(np.cross(forward, up))
    x, y, depth = np.stack([right, np.cross(right, forward), forward]) @ (point - eye)
    width, height = found["size"]
    scale = 0.5 * height / found["opening"]
    return np.array([0.5 * width + scale * x / depth, 0.5 * height - scale * y / depth])


def test_frames_and_velocities_are_those_of_the_arm(opened: Browser) -> None:
    robot, motion = planned().robot, planned().trajectory
    for t in np.linspace(0.0, motion.duration, 23).tolist():
        found = opened.run(f"(({{q, poses, velocity}}) => ({{q, poses: poses.map(T => [...T]), velocity}}))"
                           f"(optikView.state({t!r}, 'planned'))")  # fmt: skip
        np.testing.assert_allclose(found["q"], motion(t), atol=1e-7)
        poses = np.reshape(found["poses"], (-1, 4, 4))
        np.testing.assert_array_equal(poses[0], np.eye(4))
        np.testing.assert_allclose(poses[1:], robot.frames(motion(t)), atol=1e-6)
        speed = (robot.jacobian(motion(t)) @ motion(t, 1))[:3]
        np.testing.assert_allclose(found["velocity"], speed, atol=1e-4)


def test_the_tool_is_drawn_where_it_is_and_up_is_up(opened: Browser) -> None:
    robot, up = planned().robot, np.array([0.0, -1.0, 0.0])  # this arm's gravity is along +y
    for t, keys in ((0.1, 0), (0.4, 3)):
        opened.run(f"optikView.seek({t}); document.getElementById('canvas').focus()")
        for _ in range(keys):
            press(opened, "ArrowLeft")
        found = opened.run(READ)
        tool = robot.fk(planned().trajectory(t) + 0.01)[:3, 3]
        assert found["n"] > 50
        assert np.abs(np.array(found["at"]) - picture(tool, found, up)).max() < 1.0
        at_base, above = (opened.run(f"optikView.project({p.tolist()})") for p in (0.0 * up, 0.2 * up))
        assert above[1] < at_base[1] - 20.0
        assert abs(above[0] - at_base[0]) < 12.0  # upright, but for the perspective


@pytest.mark.parametrize("b", [[0.3, 0.1, 0.2], [0.1, 0.2, -0.4]], ids=["long", "sphere"])
def test_a_capsules_mesh_is_closed_and_lies_on_it(opened: Browser, b: list[float]) -> None:
    a, end, radius = np.array([0.1, 0.2, -0.4]), np.array(b), 0.05
    mesh = opened.run(
        "(({points, triangles}) => ({points: [...points], triangles: [...triangles]}))(Draw.capsuleMesh())"
    )
    shape, along = np.reshape(mesh["points"], (-1, 4)), end - a
    z = along / np.linalg.norm(along) if along.any() else np.array([0.0, 0.0, 1.0])
    x = np.cross(z, [0.0, 0.0, 1.0] if abs(z[2]) < 0.9 else [1.0, 0.0, 0.0])
    x /= np.linalg.norm(x)
    normals = shape[:, :3] @ np.array([x, np.cross(z, x), z])  # as the shader turns them
    vertices = a + shape[:, 3:] * along + radius * normals
    u = np.clip((vertices - a) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
    np.testing.assert_allclose(np.linalg.norm(vertices - a - u[:, None] * along, axis=1), radius, atol=1e-7)
    corners = vertices[np.reshape(mesh["triangles"], (-1, 3))]
    outwards = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    volume = float(np.sum(corners[:, 0] * outwards)) / 6.0  # by the divergence theorem: outwards, and closed
    exact = np.pi * radius**2 * (np.linalg.norm(along) + 4.0 / 3.0 * radius)
    assert 0.95 * exact < volume < exact


def test_it_plays_to_the_end_and_again_from_the_start(opened: Browser) -> None:
    end = opened.run("optikView.end")
    assert end == pytest.approx(planned().trajectory.duration + 0.1)
    opened.run("document.getElementById('play').click()")
    assert opened.run("document.getElementById('play').getAttribute('aria-pressed')") == "true"
    opened.until("optikView.shown.time > 0.05")
    opened.until("!optikView.shown.playing")
    assert time_of(opened) == end
    assert text_of(opened, "play") == "Play"
    opened.run(
        "document.getElementById('speed').value = '0.1'"
    )  # else a busy machine comes to the end before the next key
    press(opened, " ", text=" ")
    opened.until("optikView.shown.playing && optikView.shown.time < 0.5 * optikView.end")
    press(opened, " ", text=" ")
    assert not opened.run("optikView.shown.playing")
    opened.run("document.getElementById('reset').focus(); optikView.camera.azimuth = 9")
    press(opened, " ", text=" ")
    assert not opened.run("optikView.shown.playing")
    assert opened.run("optikView.camera.azimuth") != 9
    opened.run("document.getElementById('speed').value = '1'")


def test_speed_is_that_of_the_clock(opened: Browser) -> None:
    slow = """(async () => { const s = document.getElementById('speed'); s.value = '0.1'; optikView.play(true);
        const from = performance.now(); await new Promise(r => setTimeout(r, 900)); optikView.play(false);
        s.value = '1'; return optikView.shown.time / (performance.now() - from) * 1e3; })()"""
    assert (
        0.05 < opened.run(slow) < 0.101
    )  # what is shown is late by a picture, which a busy machine takes its time for


def test_the_slider_and_keys_lead_to_a_time_and_its_numbers(opened: Browser) -> None:
    opened.run(
        "(() => { const s = document.getElementById('time'); s.value = 0.3; s.dispatchEvent(new Event('input')); })()"
    )
    assert time_of(opened) == pytest.approx(0.3)
    robot, q = planned().robot, planned().trajectory(0.3) + 0.01
    tool = 1e3 * robot.fk(q)[:3, 3]
    assert text_of(opened, "tool").replace("−", "-") == ", ".join(f"{v:.2f}" for v in tool)
    row = "[...document.querySelectorAll('#joints tbody tr')].map(r => r.cells[1].textContent)"
    assert [c.replace("−", "-") for c in opened.run(row)] == [f"{v:.2f}°" for v in np.rad2deg(q)]
    off = 1e3 * np.linalg.norm(robot.fk(q)[:3, 3] - robot.fk(planned().trajectory(0.3))[:3, 3])
    assert float(text_of(opened, "off")) == pytest.approx(off, abs=1e-3)
    for key, wanted in (("ArrowRight", 0.31), ("ArrowLeft", 0.3), ("End", opened.run("optikView.end")), ("Home", 0.0)):
        press(opened, key)
        assert time_of(opened) == pytest.approx(wanted), key


def test_the_arm_can_be_shown_as_planned(opened: Browser) -> None:
    choose = "(w => { w.value = '{}'; w.dispatchEvent(new Event('change')); })(document.getElementById('which'))"
    opened.run(choose.replace("{}", "planned"))
    tool = 1e3 * planned().robot.fk(planned().trajectory(0.0))[:3, 3]
    assert text_of(opened, "tool").replace("−", "-") == ", ".join(f"{v:.2f}" for v in tool)
    assert text_of(opened, "off") == "0"
    opened.run(choose.replace("{}", "executed"))


def test_the_deviation_is_drawn_larger_on_request(opened: Browser) -> None:
    robot, motion = planned().robot, planned().trajectory
    seen = READ.replace("0x11", "0xc2").replace("0x14", "0x25").replace("0x17", "0x7a")  # the executed path's colour
    once, t = opened.run(seen), np.linspace(0.0, motion.duration, 50)
    choose = "(w => { w.value = '10'; w.dispatchEvent(new Event('change')); })(document.getElementById('magnify'))"
    opened.run(choose)
    tenfold = opened.run(seen)
    opened.run(choose.replace("10", "1"))
    right, did = (robot.fk(q)[:, :3, 3] for q in (motion(t), motion(t) + 0.01))
    up = np.array([0.0, -1.0, 0.0])
    far, near = ([picture(p, once, up) for p in right + k * (did - right)] for k in (10, 1))
    moved = np.mean(far, axis=0) - np.mean(near, axis=0)
    assert np.linalg.norm(moved) > 20.0
    np.testing.assert_allclose(np.array(tenfold["at"]) - once["at"], moved, atol=10.0)  # parts of it are hidden


def test_mouse_wheel_and_two_fingers_move_the_camera(opened: Browser) -> None:
    view = "(({azimuth, elevation, distance, target}) => [azimuth, elevation, distance, ...target])(optikView.camera)"
    mouse = {"x": 400, "y": 400, "button": "left", "clickCount": 1}
    before = opened.run(view)
    for kind, x in (("mousePressed", 400), ("mouseMoved", 460), ("mouseReleased", 460)):
        opened.send("Input.dispatchMouseEvent", type=kind, **(mouse | {"x": x, "buttons": 1}))
    turned = opened.run(view)
    assert turned[0] == pytest.approx(before[0] - 0.48)
    assert turned[1:] == before[1:]
    opened.send("Input.dispatchMouseEvent", type="mouseWheel", x=400, y=400, deltaX=0, deltaY=-240)
    opened.until(f"({view})[2] < {0.9 * before[2]}")
    near = opened.run(view)[2]
    for kind, gap in (("touchStart", 100), ("touchMove", 200), ("touchEnd", 0)):
        points = [{"x": 400 + side * gap, "y": 400, "id": side + 1} for side in (0, 1)] if gap else []
        opened.send("Input.dispatchTouchEvent", type=kind, touchPoints=points)
    opened.until(f"({view})[2] < {0.6 * near}")
    press(opened, "r", text="r")
    np.testing.assert_allclose(opened.run(view), before, atol=1e-9)


def test_it_is_dark_where_the_system_is_and_fits_narrow_screens(opened: Browser) -> None:
    assert opened.run(READ)["back"] == [255, 255, 255]
    opened.emulate(scheme="dark", width=SIZE[0])
    opened.until(f"Math.max(...{READ}.back) < 40", 10.0)
    assert opened.run("getComputedStyle(document.body).color") == "rgb(233, 236, 240)"
    for width in (320, 400):
        opened.emulate(width=width, height=800)
        opened.until(f"innerWidth === {width}")
        assert opened.run("document.documentElement.scrollWidth") <= width
        assert opened.run("document.getElementById('play').getBoundingClientRect().bottom") < 800


BOXES = """(optikView.draw(), [...document.querySelectorAll('#labels span')].map(e => {
    const b = e.getBoundingClientRect(); return [e.textContent, b.left, b.top, b.right, b.bottom]; }))"""
"""Words in the picture, and the box of each."""


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (700, "dark"), (400, "light")])
def test_the_first_view_holds_the_tool_and_no_word_lies_on_another(
    drawn: Browser, tmp_path: Path, width: int, scheme: str
) -> None:
    long = np.eye(4)
    long[:3, 3] = [0.0, 0.3, 0.5]  # a tool far beyond its last capsule
    robot, file = optik.load("panda").with_tool(long), tmp_path / "page.html"
    q = robot.limits.middle + np.linspace(0.0, 0.05, 5)[:, None]
    path = (
        robot.fk(q)[:, :3, 3] if width == 1280 else np.array([[0.3, 0.0, 0.3], [0.35, 0.1, 0.3]])
    )  # or far from the tool
    write_page(Show(robot, f"tool {width}", Track(np.arange(5.0), q, 0.0 * q), path), file)
    drawn.emulate(width=width, scheme=scheme)
    drawn.open(file)
    drawn.until(f"document.title === 'tool {width}' && window.optikView")
    u, v = drawn.run(f"optikView.draw(), optikView.project({robot.fk(q[0])[:3, 3].tolist()})")
    size = drawn.run("(c => [c.clientWidth, c.clientHeight])(document.getElementById('canvas'))")
    assert 0.02 * size[0] < u < 0.98 * size[0] and 0.02 * size[1] < v < 0.98 * size[1]
    boxes = drawn.run(BOXES)
    assert {"start", "goal", "tool"} <= {text for text, *_ in boxes}
    for i, (one, left, top, right, bottom) in enumerate(boxes):
        for other, *box in boxes[:i]:
            apart = box[0] >= right - 1 or box[2] <= left + 1 or box[1] >= bottom - 1 or box[3] <= top + 1
            assert apart, (one, other)
    assert drawn.errors == []


def test_without_webgl_the_numbers_work(drawn: Browser, page: Path) -> None:
    source = "HTMLCanvasElement.prototype.getContext = (own => function (kind, ...more) { return kind === 'webgl2' ? null : own.call(this, kind, ...more); })(HTMLCanvasElement.prototype.getContext)"  # noqa: E501
    script = drawn.send("Page.addScriptToEvaluateOnNewDocument", source=source)
    drawn.open(page)
    drawn.until("window.optikView && !document.getElementById('without').hidden")
    drawn.run("optikView.seek(0.2)")
    assert text_of(drawn, "clock").startswith("0.200 s")
    drawn.send("Page.removeScriptToEvaluateOnNewDocument", identifier=script["identifier"])
    assert drawn.errors == []


def test_an_arm_without_shapes_and_with_a_sliding_joint(drawn: Browser, tmp_path: Path) -> None:
    robot = optik.load("irb910sc")
    assert robot.shapes is None
    assert robot.prismatic.any()
    q = robot.limits.middle + np.linspace(0.0, 0.1, 5)[:, None]
    file = tmp_path / "lines.html"
    write_page(Show(robot, "SCARA", Track(np.arange(5.0), q, np.full_like(q, 0.025)), robot.fk(q)[:, :3, 3]), file)
    drawn.open(file)
    drawn.until("document.title === 'SCARA' && window.optikView")
    found = drawn.run("optikView.state(2.0).poses.map(T => [...T])")
    np.testing.assert_allclose(np.reshape(found[1:], (-1, 4, 4)), robot.frames(q[2]), atol=1e-9)
    speed = (robot.jacobian(q[2]) @ np.full(robot.n, 0.025))[:3]
    np.testing.assert_allclose(drawn.run("optikView.state(2.0).velocity"), speed, atol=1e-9)
    assert "no shapes" in drawn.run("document.getElementById('legend').textContent")
    assert " mm/s" in drawn.run("document.getElementById('joints').textContent")
    assert drawn.errors == []


# ---------------------------------------------------------------- plots, payload and nearest pair


def loaded() -> Show:
    """A motion of an arm with a payload past a wall and a box, with an execution."""
    robot, q = optik.load("panda").with_payload(1.5, (0.0, 0.02, 0.08)), np.deg2rad([0, -45, 0, -135, 0, 90, 45])
    t = np.linspace(0.0, 1.0, 201)
    turn = 0.5 * (1.0 - np.cos(np.pi * t))[:, None] * np.array([0.4, 0.2, 0.1, -0.2, 0.1, 0.3, -0.5])
    rate = np.gradient(turn, t, axis=0)
    second = np.gradient(rate, t, axis=0)
    track, T = Track(t, q + turn, rate, second), np.eye(4)
    T[:3, 3] = [0.6, 0.5, 0.4]
    scene = Scene([(T, [0.1, 0.1, 0.6])], planes=[([0.0, 0.0, -0.2], [0.0, 0.0, 1.0])], margin=0.02)
    limits = MotionLimits.of(robot, velocity=0.8, acceleration=(-6.0, 3.0))
    done = Track(t, q + turn + 0.001, rate, None, np.full_like(turn, 3.0))
    return Show(robot, "loaded", track, robot.fk(track.q)[:, :3, 3], done, scene, plot_limits(limits, robot.n))


@pytest.fixture(scope="module")
def loaded_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("loaded") / "page.html"
    write_page(loaded(), file)
    return file


@pytest.fixture
def full(drawn: Browser, loaded_page: Path) -> Iterator[Browser]:
    show_page(drawn, loaded_page)
    yield drawn
    assert drawn.errors == []


def said_of(browser: Browser, quantity: str) -> str:
    browser.run("optikView.draw()")
    return str(
        browser.run(
            f"document.querySelector('[data-quantity={quantity}]').parentElement.querySelector('output').textContent"
        )
    )


def choose(browser: Browser, name: str, value: str) -> None:
    browser.run(
        f"(s => {{ s.value = '{value}'; s.dispatchEvent(new Event('change')); }})(document.getElementById('{name}'))"
    )


def test_plots_say_which_joint_is_nearest_to_its_limit(full: Browser) -> None:
    show, k = loaded(), 60
    full.run(f"optikView.seek({float(show.planned.t[k])!r})")
    choose(full, "joint", "")
    i = int(np.abs(show.planned.dq[k] / 0.8).argmax())
    speed = np.rad2deg(show.planned.dq[k, i])
    share = 100.0 * abs(show.planned.dq[k, i]) / 0.8
    assert said_of(full, "dq").replace("−", "-") == f"joint{i + 1} {speed:.1f}°/s, {share:.0f} % of limit"
    sides = show.planned.ddq[k] / np.where(show.planned.ddq[k] < 0.0, -6.0, 3.0)
    i = int(sides.argmax())
    assert f"joint{i + 1} " in said_of(full, "ddq")
    assert said_of(full, "ddq").endswith(f", {100.0 * sides[i]:.0f} % of limit")
    assert said_of(full, "q") == ""
    choose(full, "joint", "5")
    assert said_of(full, "torque") == "joint6 3.0 N·m, 25 % of limit"  # measured, of 12 N·m
    assert said_of(full, "q").replace("−", "-") == f"joint6 {np.rad2deg(show.planned.q[k, 5] + 0.001):.1f}°"
    choose(full, "joint", "")


def test_plots_show_limits_and_the_time(full: Browser) -> None:
    inked = """(name => { optikView.draw(); const b = document.querySelector(`[data-quantity=${name}]`);
        const p = b.getContext('2d').getImageData(0, 0, b.width, b.height).data, rows = {}, columns = {};
        for (let k = 0; k < b.width * b.height; k++) if (p[4 * k + 3] > 60) {
            const y = Math.floor(k / b.width), x = k % b.width;
            if (p[4 * k] > 2 * p[4 * k + 2]) rows[y] = (rows[y] || 0) + 1; else columns[x] = (columns[x] || 0) + 1;
        }
        const dark = Object.keys(columns).reduce((a, c) => (columns[c] > columns[a] ? c : a));
        const long = Object.keys(rows).filter(y => rows[y] > 0.2 * b.width);
        return [long.map(y => y / b.height), (dark - 45.5) / (b.width - 54)]; })"""
    full.run("optikView.seek(0.9)")
    choose(full, "joint", "1")  # the orange joint, in a plot that holds its limits of ±0.8 rad/s
    rows, _ = full.run(f"{inked}('dq')")
    assert min(rows) < 0.15
    assert 0.7 < max(rows) < 0.9
    for t in (0.25, 0.75):
        full.run(f"optikView.seek({t})")
        for name in ("q", "dq", "ddq", "torque", "clearance"):
            assert full.run(f"{inked}('{name}')")[1] == pytest.approx(t, abs=0.02)
    choose(full, "joint", "")


def test_the_nearest_pairs_are_those_of_the_shown_arm(full: Browser) -> None:
    show = loaded()
    assert show.executed is not None and show.scene is not None
    for which, track in (("planned", show.planned), ("executed", show.executed)):
        choose(full, "which", which)
        for k in (10, 150):
            full.run(f"optikView.seek({float(track.t[k])!r}); optikView.draw()")
            lines = full.run("[...document.querySelectorAll('#nearest li')].map(l => l.textContent)")
            contact = find_contact(show.robot, show.scene, track.q[k])
            assert any(f": {' and '.join(contact.pair)}, {1e3 * contact.distance:.1f} mm" in line for line in lines)


def test_payload_and_nearest_pair_are_drawn(full: Browser) -> None:
    show = loaded()
    choose(full, "which", "planned")
    full.run("document.getElementById('reset').click(); optikView.seek(0.3)")
    found = full.run(READ.replace("0x11", "0x6a").replace("0x14", "0x4f").replace("0x17", "0xc4"))
    T = show.robot.fk(CubicHermiteSpline(*show.planned[:3])(0.3))
    centre = T[:3, :3] @ [0.0, 0.02, 0.08] + T[:3, 3]
    assert np.abs(np.array(found["at"]) - picture(centre, found, np.array([0.0, 0.0, 1.0]))).max() < 1.5
    assert "payload 1.5 kg" in full.run("document.getElementById('labels').textContent")
    yellow = """(() => { optikView.draw(); const gl = document.getElementById('canvas').getContext('webgl2');
        const w = gl.drawingBufferWidth, h = gl.drawingBufferHeight, p = new Uint8Array(4 * w * h); let n = 0;
        gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, p);
        for (let k = 0; k < p.length; k += 4) if (p[k] > 2.2 * p[k + 2] && p[k + 1] > 0.75 * p[k]) n++; return n; })()"""
    assert full.run(yellow) > 100


def test_paper_is_white(full: Browser) -> None:
    full.emulate(scheme="dark", width=SIZE[0])
    full.until(f"Math.max(...{READ}.back) < 40", 10.0)
    full.run("dispatchEvent(new Event('beforeprint'))")
    assert full.run(READ)["back"] == [255, 255, 255]
    assert full.run("getComputedStyle(document.body).color") == "rgb(27, 30, 34)"
    full.run("dispatchEvent(new Event('afterprint'))")
    assert max(full.run(READ)["back"]) < 40
    full.emulate(width=SIZE[0])


# ---------------------------------------------------------------- the arm in another page


def test_another_page_shows_two_arms(drawn: Browser, tmp_path: Path) -> None:
    robot, file = planned().robot, tmp_path / "report.html"
    motions = {law: sample_track(planned(law).trajectory) for law in ("ruckig", "constant_speed")}
    path = robot.fk(motions["ruckig"].q)[:, :3, 3]
    one, two = embed_arm(robot, motions, path), embed_arm(robot, {"ruckig": motions["ruckig"]}, path)
    assert one.script == two.script
    file.write_text(f"""<!DOCTYPE html><meta charset="utf-8"><title>report</title><style>button {{ color: red }}</style>
        <div id="a"></div><div id="b"></div><script>{one.script}</script><script>
        const arms = ["a", "b"].map((id, k) => optikArm(document.getElementById(id), [{one.data}, {two.data}][k]));</script>""")
    drawn.emulate(width=SIZE[0], height=1400)
    drawn.open(file)
    drawn.until("document.title === 'report' && window.arms === undefined && typeof arms === 'object'")
    drawn.until("arms.every(arm => arm.camera.aspect > 1)")
    for k, ends in enumerate(([motions["ruckig"].t[-1], motions["constant_speed"].t[-1]], [motions["ruckig"].t[-1]])):
        part = f"document.getElementById('{'ab'[k]}').shadowRoot.getElementById"
        assert drawn.run(f"arms[{k}].end") == pytest.approx(ends[0])
        assert drawn.run(f"getComputedStyle({part}('play')).color") != "rgb(255, 0, 0)"
        read = READ.replace("optikView", f"arms[{k}]").replace("document.getElementById", part)
        drawn.run(f"arms[{k}].seek(0.3)")
        found = drawn.run(read)
        tool = robot.fk(planned().trajectory(0.3))[:3, 3]
        assert np.abs(np.array(found["at"]) - picture(tool, found, np.array([0.0, -1.0, 0.0]))).max() < 1.5
        assert drawn.run(f"[...{part}('beside').options].map(o => o.value)") == ["", *list(motions)[: len(ends)]]
    part = "document.getElementById('a').shadowRoot.getElementById"
    count = READ.replace("optikView", "arms[0]").replace("document.getElementById", part)
    exact = "pixels[4 * k] === 0x11 && pixels[4 * k + 1] === 0x14 && pixels[4 * k + 2] === 0x17"
    magenta = count.replace(
        exact, "pixels[4 * k] > 1.4 * pixels[4 * k + 1] && pixels[4 * k + 2] > 1.05 * pixels[4 * k + 1]"
    )
    assert drawn.run(magenta)["n"] < 50
    drawn.run(f"(s => {{ s.value = 'constant_speed'; s.dispatchEvent(new Event('change')); }})({part}('beside'))")
    assert drawn.run("arms[0].end") == pytest.approx(max(motions[law].t[-1] for law in motions))
    assert drawn.run(magenta)["n"] > 300
    drawn.run(f"{part}('play').click()")
    drawn.until("arms[0].shown.time > 0.35")
    assert drawn.errors == []


def test_a_closed_path_has_one_label_and_all_joints_no_limits_of_some(drawn: Browser, tmp_path: Path) -> None:
    show, file = loaded(), tmp_path / "closed.html"
    q, dq = (
        np.concatenate([x, sign * x[-2::-1]]) for x, sign in zip(show.planned[1:3], (1.0, -1.0), strict=True)
    )  # and back
    torque = np.linspace(-20.0, 20.0, q.size).reshape(q.shape)
    track = Track(np.linspace(0.0, 2.0, len(q)), q, dq, None, torque)
    limits = {"torque": (-np.array([87.0] * 4 + [12.0] * 3), np.array([87.0] * 4 + [12.0] * 3))}
    write_page(Show(show.robot, "closed", track, show.robot.fk(q)[:, :3, 3], track, limits=limits), file)
    drawn.open(file)
    drawn.until("document.title === 'closed' && window.optikView")
    labels = drawn.run("[...document.getElementById('labels').children].map(e => e.textContent)")
    assert "start, goal" in labels and "goal" not in labels and "start" not in labels
    drawn.run("""(p => { const old = p.setLineDash; window.dotted = 0;
        p.setLineDash = function (dash) { window.dotted += dash[0] === 1; old.call(this, dash); };
    })(CanvasRenderingContext2D.prototype)""")
    for joint, drawn_limits in (("5", True), ("", False)):
        drawn.run("window.dotted = 0")
        choose(drawn, "joint", joint)
        drawn.run("optikView.draw()")
        assert (drawn.run("window.dotted") > 0) == drawn_limits
    assert drawn.errors == []
