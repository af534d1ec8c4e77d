"""Freedoms of paths, point to point and ways around obstacles, as people type them."""

import json
import re
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import optik
import planners
from planners.paths.free_path import FreePath

START = ("--start-deg", "20,-35,40,25,50,-30")
LINE = ("plan", "line", *START)
PANDA = ("--robot", "panda", "--start-deg=-51.6,-45,0,-135,0,90,45")
JOINTS = "q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg"
CYCLE = f"{JOINTS},x_mm,y_mm,z_mm,tolerance_mm,tolerance_deg\n20,-35,40,25,50,-30,,,,,\n,,,,,,114,403,250,5,5\n"
GOAL = "60,-25,25,25,70,-30,,,,,\n"


@pytest.fixture
def wall(tmp_path: Path) -> str:
    """A scene with a wall between two configurations of panda."""
    at = np.eye(4)
    at[:3, 3] = [0.5, 0.0, 0.45]
    file = tmp_path / "wall.json"
    file.write_text(json.dumps(optik.Scene(boxes=[(at, (0.5, 0.02, 0.7))], margin=0.005).to_dict()))
    return str(file)


def test_a_free_tilt_is_in_degrees_and_its_gain_is_printed(typed: Any) -> None:
    status, out, said = typed(*LINE, "--free", "tilt=10")
    assert status == 0, said
    saved = re.search(r"freedoms: chosen, ([\d.]+) % shorter than 0\.603 s", out)
    assert saved is not None and float(saved[1]) > 4.0
    assert "tilt [0, 10]° of [0, 10]°" in out
    assert "start of the motion" not in out  # held


def test_a_free_start_turns_the_tool_and_programs_read_it(typed: Any, tmp_path: Path) -> None:
    file = tmp_path / "free.json"
    options = ("--free", "tilt=10", "--free", "turn=-30:90", "--start-free", "--out", str(file))
    status, out, said = typed(*LINE, *options, "--json")
    assert status == 0, said
    found = json.loads(out)["freedom"]
    tilt, turn = found["ranges"]
    np.testing.assert_allclose(tilt["allowed"] + turn["allowed"], np.deg2rad([0.0, 10.0, -30.0, 90.0]), atol=1e-12)
    path = planners.load_motion(file).path
    assert isinstance(path, FreePath) and not path.hold_start
    assert np.abs(np.array(found["values"][0])).max() > 0.1
    tilted, tilted_too, turned = path.coordinates(np.array(found["s"]))[:, 0].T
    np.testing.assert_allclose(found["values"], np.stack([np.hypot(tilted, tilted_too), turned], axis=1), atol=1e-9)
    status, out, _ = typed(*LINE, "--free", "turn=-30:90", "--start-free")
    assert status == 0 and "start of the motion: --start-deg" in out


@pytest.mark.parametrize(
    ("freedoms", "words"), [(("turn,tilt",), ""), (("turn", "tilt"), ""), (("turn",), "° of the axis")]
)
def test_a_small_arm_follows_points_or_points_and_axes(typed: Any, freedoms: tuple[str, ...], words: str) -> None:
    limits = ("--velocity", "2", "--acceleration", "10", "--jerk", "100")
    start = ("--robot", "wx200", "--start-deg=12,17,-23,29,17", "--move=-0.05,0.06,0.03")
    status, out, said = typed(
        "plan", "line", *start, *limits, *(word for name in freedoms for word in ("--free", name))
    )
    assert status == 0, said
    flat = " ".join(out.split())
    off = flat.split("path error at most ")[1].split(", tool")[0]
    assert words in off and ("°" in off) is bool(words) and " mm" in off


def test_a_small_arm_that_cannot_follow_a_pose_is_told_the_option(typed: Any) -> None:
    start = ("--robot", "wx200", "--start-deg=12,17,-23,29,17", "--move=-0.05,0.06,0.03")
    status, out, said = typed("plan", "line", *start, "--velocity", "2", "--acceleration", "10", "--jerk", "100")
    assert status == 1 and "--free turn,tilt, which asks the tool's point alone; or" in " ".join((out + said).split())


def test_another_law_says_what_it_does_with_freedoms(typed: Any) -> None:
    status, out, _ = typed(*LINE, "--free", "tilt=10", "--timing", "toppra")
    assert status == 0
    assert "freedoms: chosen by the law optimal" in out and "tilt [" in out


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("--resolve", "global", '"auto" or "local"'),
        ("--time-limit", "0", "above 0"),
        ("--reconfigurations", "-1", "≥ 0"),
    ],
)
def test_a_wrong_option_of_the_resolution_is_named(typed: Any, option: str, value: str, said: str) -> None:
    status, _, error = typed(*LINE, option, value)
    assert status == 2 and len(error.strip().splitlines()) == 1
    assert error.startswith(f"error: {option}") and said in error


def test_a_line_that_only_a_turn_makes_possible_is_planned_and_says_how(typed: Any) -> None:
    line = [*LINE, "--move", "0.4,0,0.3"]
    assert typed(*line)[0] == 1
    status, out, said = typed(*line, "--free", "turn=115", "--free", "tilt=34")
    assert status == 0, said
    assert re.search(r"resolved: \d+ layers, \d+ configurations, no reconfiguration", out)
    assert typed(*line, "--free", "turn=115", "--free", "tilt=34", "--resolve", "local")[0] == 1


def test_point_to_point_follows_a_table(typed: Any, tmp_path: Path) -> None:
    table, file = tmp_path / "cycle.csv", tmp_path / "cycle.npz"
    table.write_text(CYCLE + GOAL)
    status, out, said = typed("plan", "ptp", "--waypoints", str(table), "--out", str(file))
    assert status == 0, said
    assert "certificate valid" in out and "freedoms: chosen" in out
    assert re.search(r"via points: \d, passed in order, at most \d\.?\d* mm and \d\.?\d*° away", out)
    motion = planners.load_motion(file)
    q = motion.trajectory.sample(1000)[1]
    np.testing.assert_allclose(
        np.rad2deg(q[[0, -1]]), [[20, -35, 40, 25, 50, -30], [60, -25, 25, 25, 70, -30]], atol=1e-6
    )
    tool = optik.load("paper6r").fk(q)[:, :3, 3]
    assert 1e-4 < np.linalg.norm(tool - [0.114, 0.403, 0.25], axis=1).min() < 5e-3


def test_joints_go_around_a_wall_and_straight_ones_do_not(
    typed: Any, wall: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        import_module("planners.choice.ways"), "DENSITIES", (1.0,)
    )  # what is printed does not depend on the grid
    move = ("plan", "joints", *PANDA, "--to-deg", "51.6,-45,0,-135,0,90,45", "--scene", wall)
    assert typed(*move)[0] == 1
    status, out, said = typed(*move, "--avoid")
    assert status == 0, said
    assert re.search(
        r"search: rrt_connect with \d+ random configurations, 1 initial path, \d rounds? of path and timing", out
    )
    status, out, _ = typed(*move, "--avoid", "--json")
    data = json.loads(out)
    assert (status, data["search"]["planner"], data["certificate"]["is_valid"]) == (0, "rrt_connect", True)
    assert data["freedom"]["gain"] > 0.0 and data["freedom"]["distance"] is None


def test_a_search_without_a_way_is_in_the_answer_of_programs(typed: Any, wall: str) -> None:
    into = ("plan", "joints", *PANDA, "--to-deg", "0,-45,0,-135,0,90,45", "--scene", wall, "--avoid")
    status, out, _ = typed(*into, "--json")
    data = json.loads(out)
    assert (status, data["status"], data["search"]["paths"]) == (1, "contact", 1)
    status, _, said = typed(*into)
    assert (status, said.count("\n")) == (1, 1) and "the goal is in collision" in said


def test_a_free_path_avoids_obstacles_in_rounds(typed: Any, wall: str) -> None:
    status, out, said = typed(
        "plan", "line", *PANDA, "--move", "0,0,0.1", "--scene", wall, "--avoid", "--free", "elbow"
    )
    assert status == 0, said
    assert re.search(r"search: \d rounds? of path and timing", out)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--free", "turm"), "did you mean turn"),
        (("--free", "turn=a"), "--free: expected turn, turn=90 or turn=-90:45 [degrees]"),
        (("--free", "turn=30:10"), "the lower bound first; got 'turn=30:10'"),
        (("--free", "turn=1:2:3"), "turn=-90:45 [degrees]"),
        (
            ("--free", "tilt"),
            "--free: expected --free turn,tilt, of which only the tool's point follows; or a half-angle; got tilt without turn",
        ),
        (("--free", "tilt=-5:5"), "tilt=RADIUS above 0, at most 180 [degrees]"),
        (("--free", "turn", "--free", "turn=9"), "turn twice"),
        ((*PANDA, "--free", "elbow=10:20"), "elbow=0 inside; got 'elbow=10:20'"),
        (("--free", "elbow"), "an arm with more than six joints; got elbow for paper6r with 6 joints"),
        (("--start-free",), "--start-free: expected a freedom"),
        (("--coefficients", "9"), "--coefficients: expected a freedom"),
        (("--free", "tilt=9", "--coefficients", "5"), "--coefficients: expected a whole number from 6 to 1,000,000"),
        (("--free", "tilt=9", "--coefficients", "900"), "the number of grid points of the law; got 900"),
        (("--avoid",), "--avoid: expected a scene"),
        (("--avoid", "--scene", "self"), "--avoid: expected a freedom"),
    ],
)
def test_misuse_of_freedoms_names_what_is_allowed(typed: Any, arguments: tuple[str, ...], words: str) -> None:
    status, out, said = typed(*LINE, *arguments)
    assert (status, out, said.strip().count("\n")) == (2, "", 0), said
    assert words in said


@pytest.mark.parametrize(
    ("text", "options", "status", "words"),
    [
        ("x_mm,y_mm,z_mm\n1,2,3\n4,5,6\n", (), 2, "q1_deg,…,q6_deg (or q1,…"),
        (CYCLE + GOAL, ("--robot", "panda"), 2, "q7_deg (or q1,… [rad, m]) for panda"),
        (CYCLE, (), 2, "expected the goal, without a tolerance"),
        (CYCLE + GOAL, START, 2, "the first row of --waypoints is the start"),
        (CYCLE + GOAL, ("--branch", "start"), 2, "--branch: expected no branch"),
        (CYCLE + GOAL, ("--avoid",), 2, "--avoid: expected a scene"),
        (CYCLE.replace("114", "2114") + GOAL, (), 1, "cycle.csv, line 3, from"),
        (
            CYCLE.replace("114", "9114") + GOAL,
            (),
            2,
            "of the base; got a coordinate of 9.114 m\n",
        ),  # the header says mm
        (CYCLE + GOAL.replace("60", "600"), (), 2, "cycle.csv, line 4, column q1: expected a value in [-180, 180]°"),
        (CYCLE.replace("_deg,", ",") + GOAL, (), 2, "got 1146°; q1 is in radians, q1_deg in degrees"),
        (
            CYCLE.replace(",5,5", ",-5,5") + GOAL,
            (),
            2,
            "cycle.csv, line 3, column tolerance_mm: expected a tolerance of",
        ),
    ],
)
def test_misuse_of_via_points(
    typed: Any, tmp_path: Path, text: str, options: tuple[str, ...], status: int, words: str
) -> None:
    file = tmp_path / "cycle.csv"
    file.write_text(text)
    found, out, said = typed("plan", "ptp", "--waypoints", str(file), *options)
    assert (found, out, said.strip().count("\n")) == (status, "", 0), said
    assert words in said
