"""`optik cell`: the paper's task end to end, the page and the data it writes, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import optik
from benchmarks.cli import cell as command
from benchmarks.cli.app import app
from optik.errors import InvalidInput, OutputError, UnknownName
from tests.seeds import shift_seed


def typed(tmp_path: Path, *arguments: str) -> Result:
    return CliRunner().invoke(app, ["cell", "--out", str(tmp_path / "task.html"), *arguments])


def test_the_paper_s_task_goes_end_to_end(tmp_path: Path) -> None:
    done = typed(tmp_path, "--drive", "ideal", "--corrections", "1", "--miscalibration", "2,2", "--seed", "3")
    assert done.exit_code == 0, done.output
    assert "simulated drive ideal" in done.output and "task.html" in done.output and "after each round" in done.output
    data = json.loads((tmp_path / "task.json").read_text(encoding="utf-8"))
    assert data["status"] == "arrived" and data["drive"] == "ideal" and len(data["rounds"]) == 2
    first, second = (np.linalg.norm(each["error"]) for each in data["rounds"])
    assert 3e-4 < first < 1e-2 and second < 0.5 * first
    parts = (np.array(data["error"][name]) for name in ("laser", "ik", "path", "servo"))
    assert np.abs(sum(parts) - data["error"]["total"]).max() < 1e-12
    assert "<html" in (tmp_path / "task.html").read_text(encoding="utf-8")


def test_the_same_seed_gives_the_same_task(tmp_path: Path) -> None:
    found = [json.loads(typed(tmp_path, "--drive", "ideal", "--seed", s, "--json").stdout)["error"] for s in "774"]
    assert found[0] == found[1] != found[2]


def test_a_task_that_fails_names_its_step_and_writes_no_page(tmp_path: Path) -> None:
    done = typed(tmp_path, "--drive", "ideal", "--spot", "3,0,0", "--start-deg", "20,-35,40,25,50,-30")
    assert done.exit_code == 1
    assert "not arrived: no_plan at step target: out of reach" in done.stderr and done.stderr.count("\n") == 1
    assert not (tmp_path / "task.html").exists()
    assert json.loads((tmp_path / "task.json").read_text(encoding="utf-8"))["failed"] == "target"


def test_a_motion_of_too_many_set_points_is_refused(tmp_path: Path) -> None:
    done = typed(tmp_path, "--drive", "ideal", "--velocity", "1e-9", "--timing", "ruckig")
    assert done.exit_code == 1 and "refused at step execution" in done.stderr and "500,000 periods" in done.stderr


def test_the_direction_of_a_miscalibration_has_nothing_of_the_noise() -> None:
    laser = command.make_laser(optik.load("paper6r"), np.array([0.1, 0.3, 0.4]), "1,1")
    cosines = []
    for seed in range(1000 * shift_seed(0), 1000 * shift_seed(0) + 60):
        off = command.displace_laser(laser, [2.0, 0.0], seed).pose[:3, 3] - laser.pose[:3, 3]
        noise = np.random.default_rng(seed).normal(size=3)  # what the readings of a cell with this seed begin with
        cosines.append(off @ noise / np.linalg.norm(off) / np.linalg.norm(noise))
    assert abs(np.mean(cosines)) < 4.0 * np.sqrt(1.0 / 3.0 / 60.0)  # 1 where both came from the same numbers


def test_without_mujoco_it_says_which_drive_it_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    assert command.choose_drive("mujoco")[0] == "mujoco"
    monkeypatch.setattr(command, "find_spec", lambda name: None)
    name, why = command.choose_drive("")
    assert name == "ideal" and "MuJoCo" in why and "sim" in why


@pytest.mark.parametrize(
    ("words", "error", "argument"),
    [
        (("--spot", "1,2"), InvalidInput, "--spot"),
        (("--spot", "a,b,c"), InvalidInput, "--spot"),
        (("--spot", "nan,0,0"), InvalidInput, "--spot"),
        (("--drive", "ros"), InvalidInput, "--drive"),
        (("--noise", "-1,0"), InvalidInput, "--noise"),
        (("--noise", "nan,0"), InvalidInput, "--noise"),
        (("--miscalibration", "1"), InvalidInput, "--miscalibration"),
        (("--seed", "-1"), InvalidInput, "--seed"),
        (("--corrections", "-1"), InvalidInput, "--corrections"),
        (("--readings", "0"), InvalidInput, "--readings"),
        (("--readings", "100000000"), InvalidInput, "--readings"),
        (("--corrections", "101"), InvalidInput, "--corrections"),
        (("--timing", "nope"), UnknownName, "nope"),
        (("--out", "page.txt"), InvalidInput, "--out"),
        (("--robot", "ur5e"), InvalidInput, "--jerk"),
        (("--spot", "3,0,0", "--out", "no/such/folder/x.html"), OutputError, "folder"),
    ],
)
def test_wrong_input_is_refused_by_name(tmp_path: Path, words: tuple[str, ...], error: type, argument: str) -> None:
    done = typed(tmp_path, *(() if "--drive" in words else ("--drive", "ideal")), *words)
    assert isinstance(done.exception, error) and argument in str(done.exception)
    assert "\n" not in str(done.exception)
