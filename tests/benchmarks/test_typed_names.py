"""What is typed wrongly is one line that names the option as typed; commands say what a newcomer must know."""

import re
from pathlib import Path
from typing import Any

import pytest

from benchmarks.cli.app import ORDER
from tests.benchmarks.conftest import optik_process

WRONG = {
    "--xyz": ("ik --xyz nan,0,0", "ik --xyz 1,2", "ik --xyz 1e308,0,0", "ik --xyz a"),
    "--rpy-deg": ("ik --xyz 0.3,0.2,0.4 --rpy-deg 1,2",),
    "--solver": ("ik --xyz 0.3,0.2,0.4 --solver nosuch", "plan line --solver ./nosuch.py"),
    "--robot": ("fk 1 --robot nosuch", "ik --xyz 1,2,3 --robot nosuch.urdf"),
    "ROBOT": ("robots nosuch", "robots ./nosuch.urdf"),
    "Q_DEG": ("fk 1,2,3", "fk 1,2,3,4,5,nan"),
    "--timing": ("plan line --timing nosuch", "plan line --timing ./nosuch.py"),
    "--limit": ("plan line --limit nosuch=3", "plan line --limit x"),
    "--tool-speed": ("plan line --tool-speed 1,2", "plan line --tool-speed 0"),
    "--free": ("plan line --free nosuch", "plan line --free turn=-10"),
    "--via": ("plan arc", "plan polyline", "plan arc --via 0.1,0.3,0.2 --to 0.1,0.3,0.2"),
    "--angle-deg": ("plan arc --centre 0.1,0.3,0.2 --angle-deg 0",),
    "--waypoints": ("plan polyline --waypoints nosuch.csv", "plan ptp --waypoints nosuch.csv"),
    "--set": ("plan path line --set goal=3", "plan path line --set a"),
    "PATH": ("plan path nosuch", "plan path ./nosuch.py"),
    "FILE": ("certify nosuch.csv", "certify nosuch.foo"),
    "--on": ("drive line.json --on nosuch",),
    "PLAN": ("drive nosuch.json", "view nosuch.json", "view foreign.csv", "drive foreign.csv"),
    "RUN": ("bench report nosuch",),
    "SUITE": ("bench check nosuch",),
    "B": ("bench compare a b",),
}
USAGE = {
    "nosuch": "No such command 'nosuch'", "plan lin": "Did you mean 'line'", "plan line --mov 1,2,3": "--move",
    "plan line --samples x": "--samples", "view": "Missing argument 'PLAN'", "ik": "Missing option '--xyz'",
    "plan line --out": "--out", "doctor x": "x",
}  # fmt: skip
"""What click refuses, and a part of the line."""


@pytest.fixture(name="folder")
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, typed: Any) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "foreign.csv").write_text("t,joint1\n0,0\n1,1\n")
    return tmp_path


@pytest.mark.parametrize(("option", "words"), [(option, words) for option, each in WRONG.items() for words in each])
def test_an_error_names_the_option_as_typed_in_one_line(option: str, words: str, folder: Path, typed: Any) -> None:
    if "line.json" in words:
        assert typed("plan", "line", "--out", "line.json")[0] == 0
    status, out, said = typed(*words.split())
    assert (status, out) == (2, ""), said
    (line,) = said.strip().splitlines()
    assert line.startswith(f"error: {option}: "), line


@pytest.mark.parametrize("words", USAGE)
def test_what_is_no_command_or_option_is_one_line(words: str, typed: Any) -> None:
    status, out, said = typed(*words.split())
    assert (status, out) == (2, "")
    (line,) = said.strip().splitlines()
    assert line.startswith("error: ") and USAGE[words] in line and re.search(r"; for help: optik.* --help$", line), line


def test_the_help_lists_what_a_user_needs_first() -> None:
    said = optik_process("--help").stdout
    found = [name for line in said.splitlines() if (name := line.strip("│ ").split(" ")[0]) in ORDER]
    assert found == list(ORDER)
    assert optik_process().returncode == 2


def test_a_line_without_a_move_says_that_it_is_a_demonstration(typed: Any) -> None:
    status, _, said = typed("plan", "line")
    assert status == 0 and "a demonstration: --move -0.12,0,0.2; for your own: --robot ROBOT --move X,Y,Z [m]" in said
    assert "demonstration" not in typed("plan", "line", "--move", "-0.1,0,0.1")[2]


def test_a_path_that_ends_far_away_asks_for_its_unit(typed: Any) -> None:
    status, _, said = typed("plan", "line", "--move", "-120,0,200")
    assert status == 1 and "its end is 233.2 m away" in said and "millimetres?" in said


def test_a_law_does_not_enforce_what_was_only_given(typed: Any) -> None:
    status, out, _ = typed("plan", "line", "--timing", "toppra", "--jerk", "500")
    assert status == 1 and "enforced by toppra" in out
    assert re.search(r"jerk .*∞.* no, but given", out) and re.search(r"velocity .* yes", out)


def test_a_message_that_lasts_longer_than_its_plan_says_so(tmp_path: Path, typed: Any) -> None:
    out = typed("plan", "line", "--rate", "125", "--out", str(tmp_path / "line.yaml"))[1]
    longer = re.search(r"line\.yaml: (\d\.\d{4}) s, ([\d.]+) % longer than the plan", out)
    assert longer is not None, out
    plan = re.search(r"mm in (\d\.\d{4}) s", out)
    assert plan is not None
    assert 100.0 * (float(longer[1]) / float(plan[1]) - 1.0) == pytest.approx(float(longer[2]), abs=0.05)
    assert "longer" not in typed("plan", "line", "--out", str(tmp_path / "line.json"))[1]


def test_a_stop_on_request_is_success(tmp_path: Path, typed: Any) -> None:
    file = str(tmp_path / "line.json")
    assert typed("plan", "line", "--out", file)[0] == 0
    status, out, _ = typed("drive", file, "--stop", "0.05")
    assert status == 0 and "stopped" in out
