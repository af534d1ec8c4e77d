"""The one way a hot loop is compiled: kept on disk, and never older than its source."""

import os
import subprocess
import sys

import numpy as np

from optik._compile import compiled
from tests.oracles import REPOSITORY

INNER = "from optik._compile import compiled\n\n@compiled\ndef inner(x):\n    return {} * x\n"
OUTER = "from inner import inner\nfrom optik._compile import compiled\n\n@compiled\ndef outer(x):\n    return inner(x) + 1.0\n"


def outer_of_one(folder):
    """What a fresh process computes with the two files in the folder."""
    path = os.pathsep.join([str(REPOSITORY), str(folder)])
    done = subprocess.run(
        [sys.executable, "-c", "from outer import outer; print(outer(1.0))"],
        capture_output=True,
        text=True,
        check=True,
        cwd=folder,
        env=os.environ | {"PYTHONPATH": path},
    )
    return float(done.stdout)


def write(file, text, second):
    file.write_text(text)
    os.utime(file, (second, second))  # so that two writes within one tick of the clock differ too


def test_a_changed_function_is_compiled_anew(tmp_path):
    write(tmp_path / "inner.py", INNER.format("2.0"), 1_700_000_000)
    write(tmp_path / "outer.py", OUTER, 1_700_000_000)
    assert outer_of_one(tmp_path) == outer_of_one(tmp_path) == 3.0
    write(tmp_path / "outer.py", OUTER.replace("+ 1.0", "+ 7.0"), 1_700_000_100)
    assert outer_of_one(tmp_path) == 9.0


def test_a_changed_function_is_compiled_anew_into_its_callers_in_other_files(tmp_path):
    write(tmp_path / "inner.py", INNER.format("2.0"), 1_700_000_000)
    write(tmp_path / "outer.py", OUTER, 1_700_000_000)
    assert outer_of_one(tmp_path) == 3.0
    write(tmp_path / "inner.py", INNER.format("5.0"), 1_700_000_100)
    assert outer_of_one(tmp_path) == 6.0


def test_division_by_zero_is_infinite_and_nan_stays_nan():
    @compiled
    def divided(x, y):
        return x / y

    assert divided(1.0, 0.0) == np.inf
    assert np.isnan(divided(0.0, 0.0))
    assert np.isnan(divided(np.nan, 1.0) * 0.0)  # no fast-math
