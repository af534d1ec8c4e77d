"""`optik plan program` and `optik program check`: the examples, what they print and write, and one line for a mistake."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import optik
import planners
from benchmarks.cli.app import app
from planners.cell.drives.ideal import METHOD as Ideal
from planners.cell.show import restore_plan, show_execution
from planners.motion.show import show_motion
from tests.oracles import REPOSITORY

EXAMPLES = REPOSITORY / "examples" / "programs"
LIMITS = ["--acceleration", "10", "--jerk", "100"]


def run(*words: str | Path) -> Result:
    return CliRunner().invoke(app, [str(word) for word in words])


def test_a_program_is_planned_written_viewed_and_sent(tmp_path: Path) -> None:
    done = run("plan", "program", EXAMPLES / "pick_and_place.toml", *LIMITS, "--out", tmp_path / "m.json")
    assert done.exit_code == 0, done.output
    assert "7 parts in 3 sections" in done.output and "certificate valid" in done.output
    assert "with payloads none, 1.5 kg" in " ".join(done.output.split())
    motion = planners.load_motion(tmp_path / "m.json")
    assert [event.signal for event in motion.events] == ["grip", "grip"] and motion.certificate.is_valid
    assert run("view", tmp_path / "m.json", "--html", tmp_path / "m.html").exit_code == 0
    page = (tmp_path / "m.html").read_text()
    assert all(
        words in page for words in ("rounded corners", "events", "7 parts, 3 sections; stops at", "grip = True at")
    )
    shown = show_motion(motion)
    assert len(shown.zones) == 4 and shown.events.shape == (2, 3)
    np.testing.assert_allclose(shown.events[:, 2], min(shown.path[:, 2]), atol=1e-6)
    facts = dict(shown.facts)
    stops = [text for name, text in shown.facts if name.startswith("At ")]
    assert stops == ["wait of 0.2 s, payload 1.5 kg", "wait of 0.2 s, payload none"] and "Program" in facts
    driven = show_execution(Ideal(motion.robot, motion.trajectory(0.0)).execute(restore_plan(motion)))
    assert len(driven.zones) == 4 and driven.events.shape == (2, 3) and driven.executed is not None
    assert {name for name, _ in driven.facts} >= {"Program", "Event", "Drive"}
    sent = run(
        "plan", "program", EXAMPLES / "pick_and_place.toml", *LIMITS, "--out", tmp_path / "m.yaml", "--rate", "125"
    )
    assert sent.exit_code == 0 and (tmp_path / "m.events.json").exists(), sent.output


def test_another_arm_and_another_start_can_be_typed(tmp_path: Path) -> None:
    (tmp_path / "p.toml").write_text(
        'robot = "ur5e"\nstart = [0, -90, 90, -90, -90, 0]\n[[part]]\nvector_mm = [0, 0, 50]\n'
    )
    done = run("plan", "program", tmp_path / "p.toml", *LIMITS, "--json")
    assert json.loads(done.stdout)["robot"] == "ur5e"
    other = run(
        "plan",
        "program",
        tmp_path / "p.toml",
        "--robot",
        "ur10e",
        "--start-deg",
        "10,-80,90,-90,-90,0",
        *LIMITS,
        "--json",
    )
    data = json.loads(other.stdout)
    assert data["robot"] == "ur10e" and data["knots"]["q"][0][0] == pytest.approx(0.174533, abs=1e-6)


def test_check_shows_the_parts_and_a_mistake_is_one_line(tmp_path: Path) -> None:
    done = run("program", "check", EXAMPLES / "weld_seam.toml")
    assert done.exit_code == 0 and "5 parts, 2 events: no errors" in done.output
    rows = json.loads(run("program", "check", EXAMPLES / "pick_and_place.toml", "--json").stdout)["items"]
    assert rows[1] == {
        "name": "pick",
        "motion": "line by 0, 0, 100 mm in the frame of the tool",
        "end": "stop",
        "limits": "250 mm/s",
    }
    assert rows[3] == {"change": "payload 1.5 kg"}
    (tmp_path / "p.toml").write_text('robot = "ur5e"\n[[part]]\nname = "up"\nvector_mm = [0, 0]\n')
    words = "[[part]] 1 'up': vector_mm: expected 3 finite numbers"
    checked, planned = (run(*command, tmp_path / "p.toml") for command in (("program", "check"), ("plan", "program")))
    assert checked.exit_code == 2 and words in checked.output and words in str(planned.exception)
    (tmp_path / "p.toml").write_text(
        'robot = "ur5e"\nstart = [0, -90, 90, -90, -90, 0]\n[[part]]\nvector_mm = [0, 0, 50]\n'
    )
    loaded = run("plan", "program", tmp_path / "p.toml", *LIMITS, "--payload", "3")
    assert "with 3 kg" in " ".join(loaded.output.split())  # options on the arm count for the one in the file


def test_a_part_that_cannot_be_followed_is_named(tmp_path: Path) -> None:
    (tmp_path / "p.toml").write_text(
        'robot = "ur5e"\nstart = [0, -90, 90, -90, -90, 0]\n[[part]]\nname = "far"\nvector_mm = [0, 0, 1500]\n'
    )
    done = run("plan", "program", tmp_path / "p.toml", *LIMITS)
    assert "part 1 'far' (line)" in str(done.exception)


@pytest.mark.parametrize(
    ("parts", "lowest"),
    [
        ("[[part]]\nvector_mm = [0, 0, 50]\n[[part]]\nvector_mm = [0, 0, 1500]\n", -1.2),
        ("[[part]]\nvector_mm = [0, 0, 1500]\n", -1.2),
        ("[[part]]\npose = { xyz_mm = [3000, 0, 0] }\nmove = 'joint'\n", 0.0),
    ],
)
def test_a_failed_program_is_shown_up_to_its_failure(tmp_path: Path, parts: str, lowest: float) -> None:
    (tmp_path / "p.toml").write_text('robot = "ur5e"\nstart = [0, -90, 90, -90, -90, 0]\n' + parts)
    done = run("plan", "program", tmp_path / "p.toml", *LIMITS, "--out-failed", tmp_path / "f.json")
    assert done.exit_code == 1 and "to see it: optik view" in done.output
    assert run("view", tmp_path / "f.json", "--html", tmp_path / "f.html").exit_code == 0
    data = json.loads((tmp_path / "f.json").read_text())
    z = optik.load("ur5e").fk(np.array(data["q"]))[:, 2, 3]
    assert z[0] == pytest.approx(0.488, abs=0.01) and (lowest == 0.0 or z[-1] - z[0] < lowest + 0.1)
    assert np.abs(np.diff(data["q"], axis=0)).max(initial=0.0) < 0.2  # no jump between two parts


def test_corners_that_are_narrower_or_stops_are_listed(tmp_path: Path) -> None:
    (tmp_path / "p.toml").write_text(
        'robot = "ur5e"\nstart = [0, -90, 90, -90, -90, 0]\n[[part]]\nvector_mm = [0, 0, 100]\nblend_mm = 5\n[[part]]\n'
        'name = "side"\nvector_mm = [0, 60, 0]\nblend_mm = 5\n[[part]]\nvector_mm = [0, -60, 0]\nblend_mm = 50\n[[part]]\n'
        "vector_mm = [0, 0, -80]\n"
    )
    words = " ".join(run("plan", "program", tmp_path / "p.toml", *LIMITS).output.split())
    assert "4 parts in 2 sections" in words and "2 rounded corners, at most 12.9 mm" in words
    assert "after part 2 'side': a stop: the path reverses its direction there" in words
    assert "of 50 mm: the shorter of its parts ends" in words and "after part 1" not in words


@pytest.mark.parametrize(
    ("event", "words"),
    [("time_s = 99", "expected times in [0, "), ("part = 1\ndistance_mm = 0\nbefore_s = 3", "got 's' at t = -3 s")],
)
def test_an_event_outside_of_the_motion_is_named(tmp_path: Path, event: str, words: str) -> None:
    (tmp_path / "p.toml").write_text(
        'robot = "ur5e"\nstart = [0, -90, 90, -90, -90, 0]\n[[part]]\nvector_mm = [0, 0, 50]\n[[event]]\ntime_s = 0.1\n'
        f'signal = "a"\n[[event]]\nsignal = "s"\n{event}\n'
    )
    said = str(run("plan", "program", tmp_path / "p.toml", *LIMITS).exception)
    assert f"p.toml: [[event]] 2: {words.split(' [')[0]}" in said or words in said


def test_check_asks_for_a_start_and_counts_in_words(tmp_path: Path) -> None:
    (tmp_path / "p.toml").write_text('robot = "ur5e"\n[[part]]\nvector_mm = [0, 0, 50]\n')
    done = run("program", "check", tmp_path / "p.toml")
    assert done.exit_code == 0 and "1 part, 0 events: no errors" in done.output
    assert "no start in the file: `optik plan program` needs --start-deg" in done.output
    assert "by default that of a program's file" in " ".join(
        run("plan", "program", "--help").output.replace("│", " ").split()
    )
    assert str(run("program", "check", tmp_path / "none.toml").exception).startswith("FILE: expected a readable file")


def test_a_limit_on_goods_counts_where_they_are_carried(tmp_path: Path) -> None:
    cup = ["--limit", "suction=friction:0.5,force:42"]
    done = run("plan", "program", EXAMPLES / "pick_and_place.toml", *LIMITS, *cup, "--out", tmp_path / "m.json")
    assert done.exit_code == 0, done.output
    said = " ".join(done.output.split())
    assert "limit on suction, not applied in sections 1, 3 (no payload)" in said and "certificate valid" in said


def test_a_first_move_to_the_start_is_nothing_to_do(tmp_path: Path) -> None:
    home = "[[part]]\nconfiguration = 'home'\n"
    (tmp_path / "p.toml").write_text(
        "robot = 'kr6'\nstart = 'home'\n[configurations]\nhome = [10, -80, 90, 0, 20, 0]\n"
        f"{home}[[part]]\njoints = [0, -70, 80, 10, 20, 0]\n{home}[[part]]\nvector_mm = [0, 0, 0]\n"
    )
    assert run("program", "check", tmp_path / "p.toml").exit_code == 0
    done = run("plan", "program", tmp_path / "p.toml", *LIMITS)
    assert done.exit_code == 0, done.output
    assert "4 parts in 2 sections, nothing to do in parts 1, 4 in" in " ".join(done.output.split())


def test_an_empty_start_is_refused() -> None:
    for words in (
        ["joints", "--robot", "ur5e", "--to-deg", "0,-80,80,0,0,0"],
        ["program", EXAMPLES / "pick_and_place.toml"],
    ):
        done = run("plan", *words, *LIMITS, "--start-deg", "")
        assert done.exit_code and "--start-deg: expected 6 joint values of ur5e" in str(done.exception)
