"""How many files and functions of the project run in a command: what a reader of that command has to open.

Kernels are excluded, and what runs while modules are imported. The baseline is the commit of `equal_results`, run here too.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

from tests.figures.equal_results import baseline_folder
from tests.figures.figure import ROOT, Row, Value, main

COMMANDS = (
    (0.6, ("plan", "line", "--robot", "paper6r", "--start-deg", "20,-35,40,25,50,-30", "--move", "-0.12,0,0.2")),
    (0.5, ("bench", "run", "ik-speed-quick", "--out", "{out}")),
)
"""Share of the files of before that is asked, and a command; every call has an output folder of its own."""
WORKER = """
import gc, json, sys, tempfile
from pathlib import Path
from numba.core.dispatcher import Dispatcher
root = Path(sys.argv[1])
from benchmarks.cli.app import app
words = sys.argv[2:]
seen = set()
def note(frame, event, _):
    code = frame.f_code
    if event == "call" and code.co_filename.startswith(f"{root}/") and code.co_name != "<module>":
        seen.add(code)
def run():
    sys.argv = ["optik", *(word.replace("{out}", tempfile.mkdtemp()) for word in words)]
    try:
        app()
    except SystemExit:
        pass
run()  # compiles, and imports
sys.setprofile(note)
run()
sys.setprofile(None)
kernels = {one.py_func.__code__ for one in gc.get_objects() if issubclass(type(one), Dispatcher)}
seen = {code for code in seen - kernels if "/compiled/" not in code.co_filename}
print("\\n" + json.dumps([len({code.co_filename for code in seen}), len(seen)]))
"""


def count(root: Path, command: tuple[str, ...]) -> list[int]:
    """Files and functions that run in the version in a folder."""
    env = os.environ | {"PYTHONPATH": str(root)}
    done = subprocess.run(
        [sys.executable, "-c", WORKER, str(root), *command],
        env=env,
        cwd=root,
        check=True,
        capture_output=True,
        text=True,
    )
    found: list[int] = json.loads(done.stdout.splitlines()[-1])
    return found


def measure(case: int) -> Row:
    """Counts of both versions."""
    command = COMMANDS[case][1]
    return {"before": count(baseline_folder(), command), "now": count(ROOT, command)}


def judge(rows: list[Row]) -> list[Value]:
    """The figures."""
    found = []
    for (share, command), row in zip(COMMANDS, rows, strict=True):
        (files, functions), (now, called) = row["before"], row["now"]
        words = f"{now} of {files} files ({100 * now / files:.0f} %), {called} of {functions} functions"
        name = f"files that run in `optik {' '.join(command[:2])}`"
        found.append(Value(name, f"≤ {100 * share:.0f} % of before", words, now <= share * files))
    return found


if __name__ == "__main__":
    main("reader_path", measure, len(COMMANDS), judge)
