"""Drawings of the cell: the committed ones are up to date, everything is inside the sheet, and they show what is there."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import optik
from docs.drawings import cell as page
from docs.drawings.frames import dh_link, draw_frames
from docs.drawings.layers import COMMANDS, draw_layers, limits_in_words
from docs.drawings.setting import draw_setting
from docs.drawings.sheet import DARK, LIGHT, break_lines, text_width
from docs.drawings.view import fit_view, make_view
from docs.drawings.workflow import draw_workflow
from optik.errors import InvalidInput
from planners import MotionLimits
from planners.cell import Cell, PanTiltLaser, Plane, Spot, make_drive
from tests import oracles
from tests.robots import USUAL

SVG = "{http://www.w3.org/2000/svg}"
NUMBER = re.compile(r"-?\d+\.?\d*")
ROUNDING = 0.25
"""Two roundings to a tenth of a pixel, of numbers that other processors compute with another last digit [px]."""


@pytest.fixture(scope="module")
def drawings() -> dict[str, str]:
    return page.drawings()


def words_of(svg: str) -> list[str]:
    return [part.text for part in ElementTree.fromstring(svg).iter(f"{SVG}text")]


def assert_inside(svg: str) -> None:
    """Valid XML, no request to anywhere, and every point, box and word inside the sheet."""
    root = ElementTree.fromstring(svg)
    assert root.find(f"{SVG}title").text
    assert "href" not in svg
    assert "url(" not in svg
    _, _, width, height = map(float, root.get("viewBox").split())
    for part in root.iter():
        pairs = [tuple(map(float, p.split(","))) for p in part.get("points", "").split()]
        if part.tag == f"{SVG}text":
            x, y, long = float(part.get("x")), float(part.get("y")), text_width(part.text)
            left = x - long * {"start": 0.0, "middle": 0.5, "end": 1.0}[part.get("text-anchor")]
            pairs += [(left, y), (left + long, y - 10.0)]
        if part.tag == f"{SVG}rect" and part.get("x"):
            x, y, w, h = (float(part.get(k)) for k in ("x", "y", "width", "height"))
            pairs += [(x, y), (x + w, y + h)]
        for x, y in pairs:
            assert -1.0 <= x <= width + 1.0, (part.attrib, part.text)
            assert 0.0 <= y <= height, (part.attrib, part.text)


def test_the_committed_drawings_are_those_of_the_objects(drawings: dict[str, str]) -> None:
    folder = oracles.REPOSITORY / "docs"
    assert {p.name for p in folder.glob("cell-*.svg")} == set(drawings), "make drawings writes them anew"
    for name, text in drawings.items():
        kept = (folder / name).read_text(encoding="utf-8")
        assert NUMBER.sub("#", kept) == NUMBER.sub("#", text), f"{name} is out of date: make drawings"
        off = np.subtract([float(x) for x in NUMBER.findall(kept)], [float(x) for x in NUMBER.findall(text)])
        assert np.abs(off).max() <= ROUNDING, f"{name} is out of date: make drawings"


def test_the_page_shows_every_drawing(drawings: dict[str, str]) -> None:
    text = (oracles.REPOSITORY / "docs" / "cell.md").read_text(encoding="utf-8")
    assert set(re.findall(r"!\[[^\]]{20,}\]\((cell-\w+\.svg)\)", text)) == set(drawings)


def test_every_drawing_is_inside_its_sheet(drawings: dict[str, str]) -> None:
    for text in drawings.values():
        assert_inside(text)


def luminance(colour: str) -> float:
    """Relative luminance of a colour, as WCAG 2 defines it."""
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return float(np.dot(linear, (0.2126, 0.7152, 0.0722)))


@pytest.mark.parametrize("colours", [LIGHT, DARK])
def test_words_can_be_read_on_the_ground_and_on_boxes(colours: dict[str, str]) -> None:
    for name in ("ink", "soft", "beam", "x", "y", "z"):
        for ground in ("page", "box"):
            light, dark = sorted((luminance(colours[name]), luminance(colours[ground])), reverse=True)
            assert (light + 0.05) / (dark + 0.05) >= 4.5, (name, ground)


# ---------------------------------------------------------------- layers and workflow
def test_the_layers_hold_what_this_cell_has() -> None:
    limits = MotionLimits(velocity=[1.0, 2.0, 2.0, 2.0, 2.0, 2.5], tool_speed=0.25)
    laser = PanTiltLaser(np.eye(4), angle_noise=3e-4, range_noise=7e-3, pan_limits=(-0.5, 1.0))
    other = Cell(page.ROBOT, laser, make_drive("ideal", page.ROBOT, period=0.002), limits)
    text = " ".join(words_of(draw_layers(other)))
    shown = (
        "velocity 1 to 2.5 rad/s", "tool speed 0.25 m/s", "servo period 2 ms", "0.3 mrad, 7 mm", "pan −28.65 … 57.3°",
    )  # fmt: skip
    for words in (*shown, "range 0 … ∞ m", "set-points, every 2 ms", "paper6r, 6 joints"):
        assert words in text, words
    assert "gripper" not in text
    assert "calibrated" not in text
    assert "opens 60 mm, 0.4 kg" in " ".join(words_of(draw_layers(page.cell())))


def test_limits_of_a_sliding_arm_have_both_units() -> None:
    text = limits_in_words(optik.load("irb910sc"), MotionLimits(velocity=[1.0, 2.0, 0.5, 3.0], tool_speed=1.0))
    assert text == "velocity 0.5 to 3 rad/s, m/s; tool speed 1 m/s"
    assert limits_in_words(optik.load("paper6r"), MotionLimits()) == "none"


def test_the_workflow_has_every_step_of_the_tasks_once_in_order() -> None:
    cell = page.cell()
    outcomes = [cell.open(), cell.move_to_spot(cell.read(page.SPOT))]
    assert outcomes[1]
    shown = [w for w in words_of(draw_workflow(outcomes)) if w in {s.name for o in outcomes for s in o.steps}]
    assert shown == list(dict.fromkeys(s.name for o in outcomes for s in o.steps))
    refused = cell.move_to_spot(Spot(0.0, 0.0, 100.0))
    assert not refused
    assert_inside(draw_workflow(refused))


def test_the_loops_of_the_workflow_are_drawn(drawings: dict[str, str]) -> None:
    assert {"correct the error", "the spot moved", "a new line"} <= set(words_of(drawings["cell-workflow.svg"]))


# ---------------------------------------------------------------- frames and setting
@given(st.floats(-3.1, 3.1), st.floats(-1, 1), st.floats(-3.1, 3.1), st.floats(-1, 1))
def test_the_parameters_of_a_link_are_those_of_the_table(alpha: float, a: float, theta: float, d: float) -> None:
    link = dh_link(oracles.rot_x(alpha) @ oracles.trans(x=a) @ oracles.rot_z(theta) @ oracles.trans(z=d))
    assert link == pytest.approx((alpha, a, d), abs=1e-12)


def test_a_transform_that_no_table_has_is_drawn_straight() -> None:
    assert dh_link(oracles.pose((0.3, 0.4, 0.5), (0.1, 0.2, 0.3))) is None
    assert dh_link(oracles.trans(y=0.2)) is None


@pytest.mark.parametrize("name", USUAL)
def test_frames_and_lengths_of_any_arm_are_inside_the_sheet(name: str) -> None:
    robot = optik.load(name)
    middle = np.clip(np.zeros(robot.n), robot.limits.lower, robot.limits.upper) + 0.01
    for q in (None, middle):
        text = draw_frames(robot, q)
        assert_inside(text)
        shown = " ".join(words_of(text))
        assert {"z₁", "x₁", "z₀"} <= set(re.split(r"\s", shown))
        assert "gravity" in shown


def test_the_papers_lengths_are_written_at_its_links() -> None:
    shown = words_of(draw_frames(optik.load("paper6r")))
    assert {"a₂ = 472 mm", "a₃ = 55 mm", "d₄ = 470 mm", "d₆ = 261 mm"} <= set(shown)
    assert "x₀ x₁ x₂" in shown  # frames 0, 1 and 2 share an origin, 4 and 5, too


def test_up_is_against_gravity_and_points_fill_their_box() -> None:
    view = make_view(np.array([0.0, 1.0, 0.0]))
    assert view((0.0, -1.0, 0.0))[1] < 0.0 == pytest.approx(view((0.0, -1.0, 0.0))[0], abs=1e-15)
    points = np.random.default_rng(0).normal(size=(50, 3))
    there = fit_view(view, points, (10.0, 20.0, 200.0, 100.0))(points)
    assert (there.min(axis=0) >= (10.0 - 1e-9, 20.0 - 1e-9)).all()
    assert (there.max(axis=0) <= (210.0 + 1e-9, 120.0 + 1e-9)).all()
    assert np.isclose(np.ptp(there, axis=0), (200.0, 100.0)).any()


@pytest.mark.parametrize("name", USUAL)
def test_the_setting_of_any_arm_is_inside_the_sheet(name: str) -> None:
    robot = optik.load(name)
    up = -robot.gravity
    q = np.clip(np.full(robot.n, 0.3), robot.limits.lower, robot.limits.upper)
    aside = np.linalg.svd(up[None])[2][1:]
    pose = np.eye(4)
    pose[:3, :3] = np.stack([aside[0], np.cross(up, aside[0]), up], axis=1)
    pose[:3, 3] = 0.5 * up - 0.6 * aside[0]
    laser = PanTiltLaser(pose, angle_noise=1e-3, range_noise=1e-3)
    text = draw_setting(robot, laser, Plane(0.05 * up, up), 0.3, -0.5, q)
    assert_inside(text)
    seen = laser.intersect_plane(0.3, -0.5, Plane(0.05 * up, up))
    assert f"range {seen.spot.range:.3f} m" in " ".join(words_of(text))
    with pytest.raises(InvalidInput, match="behind"):
        draw_setting(robot, laser, Plane(0.05 * up, up), 0.3, 0.5, q)


def test_lines_are_broken_between_words() -> None:
    assert break_lines("one two three", text_width("one two")) == ["one two", "three"]
    assert break_lines("incomprehensibilities of", 10.0) == ["incomprehensibilities", "of"]


def test_the_commands_of_the_application_layer_exist() -> None:
    from typer.main import get_command

    from benchmarks.cli.app import app

    group = get_command(app)
    missing = [command for command in COMMANDS if command.split()[1] not in group.commands]
    assert not missing
    suites = {command.split()[3] for command in COMMANDS if command.startswith("optik bench run ")}
    assert suites <= {p.stem for p in (oracles.REPOSITORY / "benchmarks" / "suites").glob("*.toml")}
