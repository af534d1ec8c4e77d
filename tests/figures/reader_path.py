"""How many files and functions of the project run in one `optik plan line`: what a reader of that command has to open.

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

COMMAND = ("plan", "line", "--robot", "paper6r", "--start-deg", "20,-35,40,25,50,-30", "--move", "-0.12,0,0.2")
WORKER = """
import gc, json, sys
from pathlib import Path
from numba.core.dispatcher import Dispatcher
root = Path(sys.argv[1])
from benchmarks.cli.app import app
sys.argv = ["optik", *sys.argv[2:]]
seen = set()
def note(frame, event, _):
    code = frame.f_code
    if event == "call" and code.co_filename.startswith(f"{root}/") and code.co_name != "<module>":
        seen.add(code)
def run():
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


def count(root: Path) -> list[int]:
    """Files and functions that run in the version in a folder."""
    env = os.environ | {"PYTHONPATH": str(root)}
    command = [sys.executable, "-c", WORKER, str(root), *COMMAND]
    done = subprocess.run(command, env=env, cwd=root, check=True, capture_output=True, text=True)
    found: list[int] = json.loads(done.stdout.splitlines()[-1])
    return found


def measure(case: int) -> Row:
    """Counts of both versions."""
    return {"before": count(baseline_folder()), "now": count(ROOT)}


def judge(rows: list[Row]) -> list[Value]:
    """The figures."""
    (files, functions), (now, called) = rows[0]["before"], rows[0]["now"]
    words = f"{now} of {files} files ({100 * now / files:.0f} %), {called} of {functions} functions"
    return [Value("files that run in `optik plan line`", "≤ 60 % of before", words, now <= 0.6 * files)]


if __name__ == "__main__":
    main("reader_path", measure, 1, judge)
