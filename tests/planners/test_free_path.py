"""Ranges of the coordinates of a path with freedoms."""

import json
from pathlib import Path

import numpy as np
import pytest

import optik
from optik import se3
from optik.errors import InvalidInput, UnknownName
from planners import Line, free, load_motion, plan
from planners.paths.free_path import FreePath
from tests import forks
from tests.planners.test_freedom import LIMITS, PANDA, line


def test_the_range_of_the_elbow_holds_its_coordinate_along_the_motion() -> None:
    robot = optik.load("panda")
    path = free(line(robot, PANDA), elbow=0.1, turn=0.5)
    found = plan(robot, path, PANDA, limits=LIMITS)
    assert found.freedom is not None and path.ranges[0].reached == (0.0, 0.0)
    elbow, turn = found.freedom.ranges
    low, high = elbow.reached
    assert (elbow.name, turn.name, elbow.allowed) == (
        "elbow",
        "turn",
        (-0.1, 0.1),
    ) and -0.1 - 1e-9 <= low < high <= 0.1 + 1e-9
    chosen = type(path).from_dict(found.path.to_dict(), robot)
    assert isinstance(chosen, FreePath) and chosen.null_space is not None and chosen.ranges == found.freedom.ranges
    s = np.linspace(0.0, path.end, 50)
    change = (
        found.joint_path(s) @ chosen.null_space.rows.T - path.spline.basis(s).combine(chosen.null_space.initial)[:, 0]
    )
    assert np.abs(change).max() > 0.02 and low - 1e-6 <= change.min() and change.max() <= high + 1e-6
    np.testing.assert_allclose(chosen.values_of_ranges(s)[:, 0], change[:, 0], atol=1e-6)
    values = found.freedom.values
    assert values.shape == (found.freedom.s.size, 2)
    for k, one in enumerate(found.freedom.ranges):
        assert one.reached[0] - 1e-12 <= values[:, k].min() < values[:, k].max() <= one.reached[1] + 1e-12


@pytest.mark.parametrize(("off", "breaks"), [(0.5e-9, 4), (2e-9, 5)])
def test_a_knot_that_differs_by_rounding_from_a_break_of_a_short_path_is_that_break(off: float, breaks: int) -> None:
    end = 0.01

    class Broken(Line):
        breaks = end * np.array([0.0, 1.0 / 3.0 + off, 1.0])

    given = Broken(np.eye(4), se3.pose(np.eye(3), np.array([end, 0.0, 0.0])))
    path = FreePath(given, {"turn": (-1.0, 1.0)}, count=8, coefficients=np.ones((8, 1)))
    assert path.spline.breaks == pytest.approx(end * np.arange(4) / 3.0)
    assert path.breaks.size == breaks


SLIDE = """
from planners.freedom import Freedom

class Slide(Freedom):
    unit = "m"
    screws = ((1.0, 0.0, 0.0, 0.0, 0.0, 0.0),)

METHOD = Slide
"""


def test_a_freedom_of_a_file_is_called_by_its_stem_and_no_data_run_the_file(tmp_path: Path) -> None:
    (tmp_path / "slide.py").write_text(SLIDE, encoding="utf-8")
    robot = optik.load("panda")
    path = free(line(robot, PANDA), **{str(tmp_path / "slide.py"): 0.01})
    found = plan(robot, path, PANDA, limits=LIMITS)
    assert found.freedom is not None and found.freedom.gain > 0.01 and found.certificate.is_valid
    (one,) = found.freedom.ranges
    assert (one.name, one.unit, one.allowed) == ("slide", "m", (-0.01, 0.01)) and -0.01 <= one.reached[0] < -1e-4
    found.save(tmp_path / "motion.json")
    assert load_motion(tmp_path / "motion.json").path.ranges == found.freedom.ranges
    code = f"import planners; planners.load_motion({str(tmp_path / 'motion.json')!r})"
    said = forks.start(code)().stderr
    assert "unknown freedom 'slide'" in said and "planners.free" in said
    data = json.loads(json.dumps(path.to_dict()))
    data["bounds"] = {str(tmp_path / "slide.py"): [-0.01, 0.01]}
    with pytest.raises((InvalidInput, UnknownName), match="unknown freedom"):
        type(path).from_dict(data, robot)


def test_more_starts_are_different_sequences_inside_the_range() -> None:
    robot = optik.load("panda")
    for starts in (1, 3):
        path = free(line(robot, PANDA), turn=(-1.0, 1.0), hold_start=False, starts=starts)
        found = plan(robot, path, PANDA, limits=LIMITS)
        assert found.freedom is not None and 1 <= found.freedom.starts <= starts
        assert max(map(abs, found.freedom.ranges[0].reached)) <= 1.0
