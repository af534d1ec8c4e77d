"""optik view shows what a drive did and plans that failed; no reader of motions takes either."""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import optik
import planners
from optik.errors import NoSolution, OptikError
from planners.cell.show import show_recorded
from planners.following.failure import PlanFailure
from planners.plan import PlanStatus
from planners.planning.failed import FAILED_PLAN, failed_plan_data

WALL = """[[planes]]
name = "wall"
point_mm = [450.0, 0.0, 0.0]
normal = [-1.0, 0.0, 0.0]
"""


def read(file: Path) -> Any:
    return json.loads(file.read_text())


def facts(file: Path) -> dict[str, str]:
    return dict(show_recorded(read(file)).facts)


@pytest.fixture
def motion(typed: Any, tmp_path: Path) -> Path:
    file = tmp_path / "line.json"
    assert typed("plan", "line", "--duration", "2", "--out", str(file))[0] == 0
    return file


@pytest.mark.parametrize("stop", [[], ["--stop", "0.2"]], ids=["done", "stopped"])
def test_an_execution_is_shown(typed: Any, motion: Path, tmp_path: Path, stop: list[str]) -> None:
    did, page = tmp_path / "did.json", tmp_path / "did.html"
    typed("drive", str(motion), "--out", str(did), *stop)
    status, _, said = typed("view", str(did), "--html", str(page))
    assert status == 0, said
    assert page.stat().st_size > 10_000
    show, data = show_recorded(read(did)), read(did)
    np.testing.assert_allclose(show.executed.q[-1], data["q"][-1])
    np.testing.assert_allclose(show.planned.q, data["setpoints"]["q"])
    np.testing.assert_array_equal(show.planned.ddq, data["setpoints"]["ddq"])
    old = data | {"setpoints": {name: data["setpoints"][name] for name in ("t", "q")}}  # as files were
    assert show_recorded(old).planned.ddq is None
    assert set(show.limits) >= {"dq", "ddq"}
    assert dict(show.facts)["Execution"] == data["status"] == ("stopped" if stop else "done")
    status, _, said = typed("drive", str(did))
    assert status == 2
    assert "an execution" in said


def failed(typed: Any, file: Path, *words: str) -> str:
    status, _, said = typed("plan", *words, "--out-failed", str(file), "--out", str(file.with_name("never.json")))
    assert status == 1, said
    assert not file.with_name("never.json").exists()
    return str(said)


def test_a_path_that_ends_early_is_shown_up_to_its_end(typed: Any, tmp_path: Path) -> None:
    file = tmp_path / "failed.json"
    assert f"optik view {file}" in failed(typed, file, "line", "--move", "0,0,0.9")
    data = read(file)
    assert data["format"] == FAILED_PLAN
    assert data["failed"] is True
    arm, show = optik.load("paper6r"), show_recorded(data)
    tool = arm.fk(data["q"][-1])[:3, 3] - arm.fk(data["q"][0])[:3, 3]
    np.testing.assert_allclose(tool, [0.0, 0.0, data["s"]], atol=2e-3)
    np.testing.assert_allclose(show.planned.q, data["q"])
    assert dict(show.facts)["Plan"] == f"FAILED: {data['status'].replace('_', ' ')}"
    assert dict(show.facts)["Reason"] == data["reason"]
    page = tmp_path / "failed.html"
    assert typed("view", str(file), "--html", str(page))[0] == 0
    assert "plan FAILED" in page.read_text()


def test_a_contact_names_its_pair(typed: Any, tmp_path: Path) -> None:
    file, scene = tmp_path / "failed.json", tmp_path / "wall.toml"
    scene.write_text(WALL)
    move = ("line", "-r", "panda", "--acceleration", "5", "--jerk", "50", "--move", "0.3,0,0", "--scene", str(scene))
    failed(typed, file, *move)
    data = read(file)
    assert data["status"] == "contact"
    pair = data["nearest"]["pair"]
    assert "wall" in pair
    assert " and ".join(pair) in str(facts(file))
    arm = optik.load("panda")
    forward = [arm.fk(q)[0, 3] for q in data["q"]]
    assert forward[0] < forward[-1] < 0.45
    assert show_recorded(data).scene is not None


def test_an_invalid_motion_is_shown_whole() -> None:
    arm = optik.load("panda")
    q = np.deg2rad([0, -45, 0, -135, 0, 90, 45])
    plan = planners.plan(arm, optik.se3.pose(arm.fk(q)[:3, :3], arm.fk(q)[:3, 3] + [0.1, 0.0, 0.0]), q)
    assert plan
    failure = PlanFailure(PlanStatus.NOT_PROVED, 0.05, None, "not proved", "another law")
    data = failed_plan_data(replace(plan, status=PlanStatus.NOT_PROVED, failure=failure))
    np.testing.assert_allclose(data["q"][-1], plan.trajectory(plan.trajectory.end))
    assert show_recorded(json.loads(json.dumps(data))).duration == pytest.approx(plan.trajectory.duration)


def test_a_failed_plan_is_no_motion(typed: Any, tmp_path: Path) -> None:
    file = tmp_path / "failed.json"
    failed(typed, file, "line", "--move", "0,0,0.9")
    with pytest.raises(OptikError):
        planners.load_motion(file)
    status, _, said = typed("drive", str(file))
    assert status == 1
    assert "failed plan" in said
    status, _, said = typed("view", str(file), "--drive", "ideal")
    assert status == 2
    assert "--drive" in said and str(file) in said
    assert ".json" in typed("plan", "line", "--out-failed", str(tmp_path / "x.npz"))[2]


def test_nothing_is_written_of_a_plan_that_holds(typed: Any, tmp_path: Path) -> None:
    file = tmp_path / "failed.json"
    assert typed("plan", "line", "--out-failed", str(file))[0] == 0
    assert not file.exists()


def test_damaged_files_are_named(typed: Any, motion: Path, tmp_path: Path) -> None:
    did, bad = tmp_path / "did.json", tmp_path / "bad.json"
    typed("drive", str(motion), "--out", str(did))
    failed(typed, tmp_path / "failed.json", "line", "--move", "0,0,0.9")
    for whole in (read(did), read(tmp_path / "failed.json")):
        for key in whole:
            with suppress(OptikError, NoSolution):
                show_recorded(whole | {key: "x" if isinstance(whole[key], list) else [[1.0]]})
            with suppress(OptikError, NoSolution):
                show_recorded({k: v for k, v in whole.items() if k != key})
    bad.write_text("[" * 100_000)
    assert typed("view", str(bad), "--html", str(tmp_path / "x.html"))[0] == 2
