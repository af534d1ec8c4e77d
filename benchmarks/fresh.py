"""Fresh processes: run a few lines of Python that print JSON, and say what went wrong where they end otherwise."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from optik.errors import OptikError

ROOT = Path(__file__).resolve().parent.parent


class ProcessFailed(OptikError, RuntimeError):
    """A fresh process ended without figures; its last words are told."""


def fresh(arguments: list[str], what: str, **environment: str) -> Any:
    """What ``python ARGUMENTS`` prints, read as JSON.

    Parameters
    ----------
    arguments : list of str
        Of this interpreter; our packages can be imported.
    what : str
        What the error calls it.
    **environment
        Variables added to ours.

    Raises
    ------
    ProcessFailed
        It ended with an error.
    """
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        [sys.executable, *arguments],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": path} | environment,
    )
    if done.returncode != 0:
        raise ProcessFailed(f"{what}: {(done.stderr.strip().splitlines() or ['it ended without a word'])[-1]}")
    return json.loads(done.stdout)
