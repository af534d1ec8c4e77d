"""The example scripts run as their first lines say, from any folder, and print what a reader expects."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.oracles import REPOSITORY

EXAMPLES = REPOSITORY / "examples"
EXPECTED = {
    "own_urdf": r"certificate valid: True", "own_method": r"lm +100\.0 % solved",
    "compare_laws": r"quintic enforces none(.|\n)*optimal +0\.\d+ .*True", "batch": r"3,000 of 3,000 solved",
    "reachability_map": r"\d+ of 1681 poses reached; proved out of reach: \d+", "replan": r"certificate valid: True",
    "report": r"report: .*report.html", "seam_to_ros": r"certificate valid: True",
    "shelf": r"compartment: solved, \d\.\d+ s.*\nproved to the scene: at least \d+\.\d\d mm \(margin 5 mm\).*"
    r"\nproved between links: at least \d+\.\d\d mm \(margin 0 mm\)",
    "pipe_saddle": r"gain [1-9]\d*\.\d %, turn between -?\d+° and -?\d+°\ncertificate valid: True",
}  # fmt: skip
"""What each prints, by its name."""
ARGUMENTS = {"batch": ["3000"]}
"""What the tests give them, to be quick."""
MOST_LINES = 60


def test_every_script_is_here() -> None:
    scripts = {file.stem for file in EXAMPLES.glob("*.py") if "METHOD" not in file.read_text(encoding="utf-8")}
    assert scripts == set(EXPECTED)


@pytest.mark.parametrize("name", EXPECTED)
def test_an_example_runs(name: str, tmp_path: Path) -> None:
    file = EXAMPLES / f"{name}.py"
    assert len(file.read_text(encoding="utf-8").splitlines()) <= MOST_LINES
    command = [sys.executable, str(file), *ARGUMENTS.get(name, [])]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert re.search(EXPECTED[name], done.stdout), done.stdout
