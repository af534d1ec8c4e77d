"""The example scripts run as their first lines say, from any folder, and print what a reader expects."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests import forks
from tests.oracles import REPOSITORY

EXAMPLES = REPOSITORY / "examples"
EXPECTED = {
    "own_urdf": r"certificate valid: True", "own_method": r"lm +100\.0 % solved",
    "compare_laws": r"optimal +0\.\d+ .*jerk\nquintic +3\.000 .* 192\.\d+  none", "batch": r"3,000 of 3,000 solved",
    "reachability_map": r"\d+ of 1681 poses reached; proved out of reach: \d+", "replan": r"certificate valid: True",
    "report": r"report: .*report.html", "seam_to_ros": r"certificate valid: True",
    "shelf": r"compartment: solved, \d\.\d+ s.*\nproved to the scene: at least \d+\.\d\d mm \(margin 5 mm\).*"
    r"\nproved between links: at least \d+\.\d\d mm \(margin 0 mm\)",
    "policy_stream": r"not joined: none[\s\S]*\nRuckig to each target: [3-9]\d[\s\S]*\nstream: [5-9]\.\d mrad RMS",
    "pipe_saddle": r"gain [1-9]\d*\.\d %, turn between -?\d+° and -?\d+°\ncertificate valid: True",
}  # fmt: skip
"""What each prints, by its name."""
ARGUMENTS = {"batch": ["3000"]}
"""What the tests give them, to be quick."""
MOST_LINES = 60


def test_every_script_is_here() -> None:
    assert {file.stem for file in EXAMPLES.glob("*.py")} == set(EXPECTED)


RUN = """
import runpy, sys
sys.argv, sys.path[0] = sys.argv[1:], sys.argv[1].rpartition("/")[0]
runpy.run_path(sys.argv[0], run_name="__main__")
"""


@pytest.mark.parametrize("name", EXPECTED)
def test_an_example_prints_what_a_reader_expects(name: str, tmp_path: Path) -> None:
    file = EXAMPLES / f"{name}.py"
    done = forks.start(RUN, file.as_posix(), *ARGUMENTS.get(name, []), cwd=tmp_path)()
    assert (done.returncode, done.stderr) == (0, "")
    assert re.search(EXPECTED[name], done.stdout), done.stdout
    assert len(file.read_text(encoding="utf-8").splitlines()) <= MOST_LINES


def test_an_example_runs_by_its_name_from_any_folder(tmp_path: Path) -> None:
    command = [sys.executable, str(EXAMPLES / "own_method.py")]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=True)
    assert re.search(EXPECTED["own_method"], done.stdout) and not done.stderr
