"""Fresh processes: run a few lines of Python that print JSON, and raise an error if they fail."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from optik.errors import OptikError

ROOT = Path(__file__).resolve().parents[2]
"""Folder of our packages, so that a fresh process imports the same code."""


class ProcessFailed(OptikError, RuntimeError):
    """A fresh process ended with an error; the message is its last line."""


def fresh(arguments: list[str], what: str, **environment: str) -> Any:
    """Run ``python ARGUMENTS`` and read what it prints as JSON. Nothing is imported from the working folder."""
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        [sys.executable, *arguments],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": path, "PYTHONSAFEPATH": "1"} | environment,
    )
    if done.returncode != 0:
        raise ProcessFailed(
            f"{what}: {(done.stderr.strip().splitlines() or ['the process ended without a message'])[-1]}"
        )
    return json.loads(done.stdout)
